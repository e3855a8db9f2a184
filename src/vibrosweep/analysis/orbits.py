"""Closed orbits without rests, up to given numbers of impacts and forcing periods.

Orbits are solutions of equations, found whether they attract or not.  The time-shifted copies of an
orbit (slots) count as one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.common import (
    attributes,
    coded,
    meaning,
    require_ability,
    require_memory,
    shared,
)
from vibrosweep.arrays import Array
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.closed import (
    ADMISSIBLE,
    MEETS_BASE,
    NO_ORBIT,
    RESTS,
    Closed,
    Wanted,
    empty_closed,
    find_closed,
)
from vibrosweep.kernels.impact import base_of
from vibrosweep.kernels.memory import require_written
from vibrosweep.model.measures import VARIABLES
from vibrosweep.model.parameters import HIGH_BOUNCE, Dimensionless, dimensionless, taken
from vibrosweep.runs.result import attributes_of
from vibrosweep.scene.realizations import open_design

if TYPE_CHECKING:
    from vibrosweep.scene.sweep import Sweep

__all__ = ["SEEDS", "orbits", "summary"]

MOST_IMPACTS: Final = 12
MOST_PERIODS: Final = 64
# Least number for one impact under a sine
SEEDS: Final = 8
PIECE: Final = 256  # points searched at a time
CAPACITY: Final = 64  # orbits per point for which memory is reserved at first
PROBLEMS_PER_TASK: Final = 4
BYTES_PER_IMPACT: Final = 40
OF_ORBITS: Final = Closed._fields[1 : Closed._fields.index("seeds")]
ABSENT: Final = -1


def orbits(sweep: Sweep, threads: int, *, impacts: int, periods: int, seeds: int) -> xr.Dataset:
    """Closed orbits of the realizations of a sweep, as `vibrosweep.orbits`."""
    scene, design = sweep.scene, open_design(sweep)
    require_ability("orbits", scene, design.sampled)
    bounds = (("impacts", impacts, MOST_IMPACTS), ("periods", periods, MOST_PERIODS))
    for name, value, most in bounds:
        if value > most:
            raise ParameterError(
                f"{name} = {value}: must be at most {most}, since the number of orbits grows "
                f"exponentially with it"
            )
    varied = design.take(0, design.realizations)
    quantities = scene.quantities(varied)
    problem = dimensionless(scene.parameters(varied), scene.duration)
    balances = scene.base == HIGH_BOUNCE and scene.rebound == "rest"
    wanted = Wanted(impacts, periods, seeds, balances)
    with Workers(threads) as workers:
        found = find_all(base_of(*scene.mechanics), problem, wanted, workers)
    unit_speed = quantities["gravity"] / (2.0 * quantities["frequency"])
    data = _orbits(found, unit_speed, 1.0 / quantities["frequency"])
    data |= _searched(found, wanted, problem.restitution < 1.0) | shared(scene, [*varied])
    coordinates: dict[str, Any] = {
        n: ("realization", quantities[n], attributes_of(n)) for n in scene.varying(varied)
    }
    places = (("impacts", impacts, "impacts of an orbit"), ("periods", periods, "its periods"))
    for name, most, words in places:
        coordinates[name] = (name, np.arange(1, most + 1), {"long_name": words})
    attrs = attributes(sweep, scene, launched=False, seeds_of_each_phase=seeds)
    dataset = xr.Dataset(data, coordinates, attrs)
    if not design.sampled:
        return dataset.isel(realization=0)
    return _on_axes(dataset, sweep.design.axes) if sweep.design.axes else dataset


def _on_axes(found: xr.Dataset, axes: Mapping[str, Sequence[float]]) -> xr.Dataset:
    """Return the dataset with the axes of a grid as dims."""
    sizes = {name: len(values) for name, values in axes.items()}
    variables: dict[Any, Any] = {}
    for name, one in found.variables.items():
        variables[name] = one
        if "realization" in one.dims:
            variables[name] = one.unstack(realization=sizes).transpose(*sizes, ...)
    variables |= {n: (n, np.array(v), attributes_of(n)) for n, v in axes.items()}
    return xr.Dataset(variables, attrs=found.attrs).set_coords([*found.coords])


def find_all(base: Any, problem: Dimensionless, wanted: Wanted, workers: Workers) -> Closed:
    """Search for the closed orbits of a batch, sorted for each problem as by `_ordered`.

    Pieces of the batch are searched in turn; the search of a piece is repeated with a larger
    capacity until all its orbits fit.
    """
    pieces = []
    for start in range(0, problem.kick.size, PIECE):
        piece = taken(problem, slice(start, start + PIECE))
        found, capacity = _searched_all(base, piece, wanted, CAPACITY, workers), CAPACITY
        while (found.orbits < 0).any():
            capacity *= 2
            found = _searched_all(base, piece, wanted, capacity, workers)
        require_written(found)
        pieces.append(_ordered(found))
    most = max(piece.impacts.shape[1] for piece in pieces)
    return Closed(
        *(
            np.concatenate([_padded(v, most, name) for v in values])
            for name, values in zip(Closed._fields, zip(*pieces, strict=True), strict=True)
        )
    )


def _searched_all(
    base: Any, problem: Dimensionless, wanted: Wanted, capacity: int, workers: Workers
) -> Closed:
    """Search for the orbits of a piece, with memory for `capacity` orbits of each point."""
    size = problem.kick.size
    require_memory("orbits", size * capacity, 2 * BYTES_PER_IMPACT * wanted.impacts)
    out = empty_closed(size, capacity, wanted)
    workers.run(
        lambda first, last: find_closed(first, last, base, problem, wanted, out),
        size,
        PROBLEMS_PER_TASK,
    )
    return out


def _ordered(found: Closed) -> Closed:
    """Sort the orbits of each problem by impacts, periods and first phase."""
    most = int(found.orbits.max())
    absent = np.arange(found.impacts.shape[1]) >= found.orbits[:, np.newaxis]
    order = np.lexsort((found.times[:, :, 0], found.periods, found.impacts, absent), axis=1)
    rows, order = np.arange(order.shape[0])[:, np.newaxis], order[:, :most]
    return found._replace(**{name: getattr(found, name)[rows, order] for name in OF_ORBITS})


def _padded(values: NDArray[Any], most: int, name: str) -> NDArray[Any]:
    """Pad the values of a field of orbits to `most` of them; return any other field unchanged."""
    if name not in OF_ORBITS:
        return values
    blank = NO_ORBIT if name == "admissible" else np.nan if values.dtype.kind == "f" else 0
    shape = ((0, 0), (0, most - values.shape[1]), *[(0, 0)] * (values.ndim - 2))
    return np.pad(values, shape, constant_values=blank)


def _orbits(found: Closed, unit_speed: Array, unit_time: Array) -> dict[str, Any]:
    """Variables of the orbits, from the units of speed (m s-1) and time (s) of each realization."""
    dims, landing = ("realization", "orbit"), ("realization", "orbit", "impact")
    present = found.impacts > 0
    at = np.arange(found.times.shape[2])
    times, ends = found.times, np.full_like(found.times, np.nan)
    ends[..., :-1] = times[..., 1:]
    last = at == found.impacts[..., np.newaxis] - 1
    ends = np.where(last, times[..., :1] + found.periods[..., np.newaxis], ends)
    speed, time = (unit[:, np.newaxis, np.newaxis] for unit in (unit_speed, unit_time))
    real, imaginary = multipliers(found.trace, found.determinant)
    modulus = np.hypot(real, imaginary)[..., 0]
    return {
        "cycle_impacts": (dims, found.impacts, VARIABLES["cycle_impacts"].attributes),
        "cycle_periods": (dims, found.periods, VARIABLES["cycle_periods"].attributes),
        "admissible": coded(
            dims,
            found.admissible,
            "whether a particle can follow the orbit: no earlier landing, no rest",
            ((NO_ORBIT, "no_orbit"), (RESTS, "rests"), (MEETS_BASE, "lands_earlier"), (1, "yes")),
        ),
        "stable": coded(
            dims,
            np.where(present, modulus < 1.0, ABSENT),
            "whether both multipliers are inside the unit circle",
            ((ABSENT, "no_orbit"), (0, "no"), (1, "yes")),
        ),
        "multiplier_real": (
            (*dims, "multiplier"),
            real,
            meaning("multiplier of the orbit, real part, the larger first"),
        ),
        "multiplier_imaginary": (
            (*dims, "multiplier"),
            imaginary,
            meaning("multiplier of the orbit, imaginary part"),
        ),
        "impact_phase": (landing, times - np.rint(times), meaning("phase of the impact, turns")),
        "flight_time": (
            landing,
            (ends - times) * time,
            meaning("duration of the flight after the impact", "s"),
        ),
        "rebound_velocity": (
            landing,
            found.speed * speed,
            meaning("velocity at lift-off", "m s-1"),
        ),
        "impact_speed": (
            landing,
            found.arrival * speed,
            meaning("speed at the end of the flight that follows the impact", "m s-1")
            | {"comment": "relative to the base"},
        ),
    }


def multipliers(trace: Array, determinant: Array) -> tuple[Array, Array]:
    """Roots of z^2 - trace z + determinant, the one of larger modulus first; shape (..., 2)."""
    square = 0.25 * trace * trace - determinant
    root = np.sqrt(np.abs(square))
    larger = 0.5 * trace + np.copysign(root, trace)
    with np.errstate(invalid="ignore", divide="ignore"):  # both are 0
        smaller = np.where(larger == 0.0, 0.0, determinant / larger)
    real = np.where(square >= 0.0, [larger, smaller], 0.5 * trace)
    imaginary = np.where(square >= 0.0, 0.0, [root, -root])
    return np.moveaxis(real, 0, -1), np.moveaxis(imaginary, 0, -1)


def _searched(found: Closed, wanted: Wanted, contracts: NDArray[np.bool_]) -> dict[str, Any]:
    """Variables that may show that the search is not complete.

    Where the map contracts, and `wanted` says that orbits balance, there are as many saddle points
    as others unless orbits were missed (`vibrosweep.kernels.closed`); a pair that was missed
    changes both numbers alike.
    """
    dims = ("realization", "impacts", "periods")
    balances = wanted.balances & contracts[:, np.newaxis, np.newaxis]
    numbers = {
        "seeds": (found.seeds, "points from which orbits were searched"),
        "late_orbits": (found.late, "new orbits that the last half of the seeds led to"),
        "saddle_points": (found.saddles, "points of orbits with a real multiplier above 1"),
        "other_points": (found.others, "points of the other orbits"),
    }
    comment = "of all solutions of p impacts in q periods, including shorter orbits run d times"
    data: dict[str, Any] = {
        name: (dims, values, meaning(words)) for name, (values, words) in numbers.items()
    }
    for name in ("saddle_points", "other_points"):
        data[name][2]["comment"] = comment
    data["balanced"] = coded(
        dims,
        np.where(balances, found.saddles == found.others, ABSENT),
        "whether points with a real multiplier above 1 are as many as the others",
        ((ABSENT, "unknown"), (0, "no"), (1, "yes")),
    )
    count = meaning("number of orbits")
    return {"orbit_count": (("realization",), found.orbits, count), **data}


def cycle_name(impacts: int, periods: int) -> str:
    """Return the name of an orbit by its numbers of impacts and forcing periods."""
    some = [
        f"{number} {what}{'s' if number > 1 else ''}"
        for number, what in ((impacts, "impact"), (periods, "period"))
    ]
    return " / ".join(some)


def summary(found: xr.Dataset) -> Iterator[str]:
    """Describe the orbits in a line for each number of impacts and periods, and the search."""
    p, q = found["cycle_impacts"].values, found["cycle_periods"].values
    stable = (found["stable"].values == 1) & (found["admissible"].values == ADMISSIBLE)
    points = max(1, found["orbit_count"].size)
    for impacts in found["impacts"].values:
        for periods in found["periods"].values:
            counted = (p == impacts) & (q == periods)
            if counted.any():
                admissible = counted & (found["admissible"].values == ADMISSIBLE)
                yield (
                    f"{cycle_name(impacts, periods):24}{counted.sum()} orbits at {points} points, "
                    f"{admissible.sum()} of them admissible, {(counted & stable).sum()} of these "
                    f"stable"
                )
    late, balanced = int(found["late_orbits"].sum()), found["balanced"].values
    completeness = "no count would show a missing orbit"
    if (balanced != ABSENT).any():
        completeness = (
            f"saddle points and other points, equal in number unless orbits are missing, differ in "
            f"{np.count_nonzero(balanced == 0)} of {np.count_nonzero(balanced != ABSENT)} searches"
        )
    yield (
        f"{'search':24}{int(found['seeds'].sum())} seeds, the last half of which led to {late} new "
        f"orbits; {completeness}"
    )
