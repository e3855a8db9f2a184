"""Periodic orbits without rests: found by their equations, and continued with their bifurcations.

Orbits are solutions of equations, found whether they attract or not.  The time-shifted copies of an
orbit (slots) count as one.  Along one parameter orbits form branches; over two, bifurcations form
curves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.common import (
    KEPT,
    attributes,
    coded,
    grid_axes,
    meaning,
    require_ability,
    require_memory,
    shared,
)
from vibrosweep.analysis.continuation import (
    AT_CORNER,
    AT_YIELDING,
    BEGUN,
    DOUBLED,
    FIX_DRIVE,
    FIX_E,
    LEFT,
    LOST,
    RETURNED,
    SPENT,
    TOUCHED,
    Equations,
    Line,
    Mark,
    Nodes,
    follow,
    same_orbit,
)
from vibrosweep.arrays import Array
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.bifurcations import (
    BORN,
    CORNER,
    DOUBLING,
    GRAZE,
    LANDING,
    REST,
    SADDLE_NODE,
    YIELD,
    OrbitType,
)
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
from vibrosweep.mistakes import argument
from vibrosweep.model.forcing import AMPLITUDE, INPUTS, forcing_of, refuse_extreme
from vibrosweep.model.measures import VARIABLES
from vibrosweep.model.parameters import HIGH_BOUNCE, Dimensionless, dimensionless, taken
from vibrosweep.model.restitution_laws import kinks_of
from vibrosweep.model.shapes import PARABOLIC_NAME
from vibrosweep.runs.result import attributes_of
from vibrosweep.scene.design import open_design
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import Sweep

__all__ = ["SEEDS", "Plane", "boundaries", "branches", "line_summary", "orbits", "summary"]

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
                argument(name),
                f"{value}: must be at most {most}, since the number of orbits grows exponentially "
                f"with it",
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


# --- Branches and their bifurcations --------------------------------------------------------------

CORNER_PHASE: Final = 0.25  # the parabolic waveform has corners at plus and minus this phase
EVENTS: Final = (
    (SADDLE_NODE, "saddle_node"),
    (DOUBLING, "period_doubling"),
    (GRAZE, "grazing"),
    (REST, "rest"),
    (BORN, "born_at_doubling"),
    (CORNER, "corner"),
    (YIELD, "kink"),
    (LANDING, "grazing_at_landing"),
)
ENDS: Final = (
    (LEFT, "border"),
    (RETURNED, "closed"),
    (DOUBLED, "born_at_doubling"),
    (TOUCHED, "touches_base"),
    (LOST, "lost"),
    (SPENT, "points_spent"),
    (BEGUN, "begins_at_doubling"),
    (AT_CORNER, "corner"),
    (AT_YIELDING, "kink"),
)
# Bifurcations that are continued as curves
OF_CURVES: Final = tuple(event for event in EVENTS if event[0] != BORN)
FEWEST_POINTS: Final = 10
NONE: Final = -2
MOST_DOUBLINGS: Final = 6
LONGEST: Final = 64  # impacts of an orbit born at a doubling


def branches(
    spec: Sweep, threads: int, *, wanted: tuple[int, int], doublings: int, points: int
) -> xr.Dataset:
    """Orbits along the axis of a sweep, as `vibrosweep.branches`.

    `wanted` holds the largest numbers of impacts and periods.  Raises a SpecError unless the only
    axis of the design is the restitution or a forcing.
    """
    require_ability("branches", spec.scene, spec.design.sampled)
    _require(wanted, doublings, points)
    forcing = forcing_of({*spec.design.sampled, *spec.scene.given})
    along = "restitution" if "restitution" in spec.design.axes else forcing
    values = grid_axes(spec, "branches", along)[along]
    e = np.array([spec.scene.inputs["restitution"]]) if along == forcing else values
    drive = values if along == forcing else np.array([spec.scene.inputs[forcing]])
    _require_range(along, values)
    plane = Plane(spec.scene, forcing, e, drive, points)
    condition = FIX_E if along == forcing else FIX_DRIVE
    with Workers(threads) as workers:
        lines = branches_along(plane, condition, wanted, doublings, workers)
    data = _lines(lines, plane, "branch", [along], spec) | _events(lines, plane, along)
    parents = np.array([line.parent for line in lines], np.int64)
    words = "branch whose orbit doubles where this one is born, -1 if there is none"
    data["parent"] = ("branch", parents, meaning(words))
    data |= shared(spec.scene, [along])
    return xr.Dataset(data, attrs=attributes(spec, spec.scene, launched=False, along=along))


def boundaries(
    spec: Sweep, threads: int, *, wanted: tuple[int, int], doublings: int, points: int
) -> xr.Dataset:
    """Curves of bifurcations over the plane of a sweep, as `vibrosweep.boundaries`.

    `wanted` holds the largest numbers of impacts and periods.  Raises a SpecError unless the
    design is a grid of the restitution and a forcing.
    """
    require_ability("boundaries", spec.scene, spec.design.sampled)
    _require(wanted, doublings, points)
    forcing = forcing_of(spec.design.sampled)
    axes = grid_axes(spec, "boundaries", forcing, ("restitution",))
    if "restitution" not in axes:
        axes |= grid_axes(spec, "boundaries", "restitution", (forcing,))
    for name, values in axes.items():
        _require_range(name, values)
    e, drive = axes["restitution"], axes[forcing]
    with Workers(threads) as workers:
        lines = [
            line
            for one in e
            for line in branches_along(
                Plane(spec.scene, forcing, np.array([one]), drive, points),
                FIX_E,
                wanted,
                doublings,
                workers,
            )
        ]
    plane = Plane(spec.scene, forcing, e, drive, points)
    curves = curves_of(plane, lines)
    data = _lines(curves, plane, "curve", ["restitution", forcing], spec)
    kinds = [curve.kind for curve in curves]
    data["bifurcation"] = coded(["curve"], kinds, "kind of bifurcation", OF_CURVES)
    varied = ("restitution", forcing)
    quantities = spec.scene.quantities({name: data[name][1].ravel() for name in varied})
    dims, values, _ = data[forcing]
    for name in (name for name in KEPT if name != forcing):
        words = attributes_of(name)
        data[name] = (dims, quantities[name].reshape(values.shape), words)
    data |= shared(spec.scene, varied)
    return xr.Dataset(data, attrs=attributes(spec, spec.scene, launched=False, forcing=forcing))


def _require(wanted: tuple[int, int], doublings: int, points: int) -> None:
    for name, value, low, high in (
        ("impacts", wanted[0], 1, MOST_IMPACTS),
        ("periods", wanted[1], 1, MOST_PERIODS),
        ("doublings", doublings, 0, MOST_DOUBLINGS),
        ("points", points, FEWEST_POINTS, 10**6),
    ):
        if not low <= value <= high:
            rule = f"{value}: must be at least {low} and at most {high}"
            raise ParameterError(argument(name), rule)
    if wanted[0] * 2**doublings > LONGEST:
        raise ParameterError(
            *(argument("impacts"), f"{wanted[0]} and ", argument("doublings")),
            f"{doublings}: these orbits have up to "
            f"{wanted[0] * 2**doublings} impacts, and orbits are continued up to {LONGEST}; lower "
            f"one of the two",
        )


def _require_range(name: str, values: Array) -> None:
    if values.size < 2:
        raise ParameterError(
            f"{name}: must be two values or more; the least and the largest are the ends of its "
            f"range"
        )


def _lines(
    lines: Sequence[Line], plane: Plane, dim: str, along: Sequence[str], spec: Sweep
) -> dict[str, Any]:
    """Variables of lines and their points, NaN past the last point of each line."""
    impacts = max((line.p for line in lines), default=1)
    points = max((line.z.shape[0] for line in lines), default=0)
    trace = _stacked([line.trace for line in lines], points)
    determinant = _stacked([line.determinant for line in lines], points)
    real, imaginary = multipliers(trace, determinant)
    # the trace is infinite where a landing grazes
    stable = np.where(np.isnan(trace), -1, np.hypot(real, imaginary)[..., 0] < 1.0)
    speed = _stacked([line.speed for line in lines], points, impacts)
    phase = _stacked([_phases(line.z, line.p) for line in lines], points, impacts)
    unit = spec.scene.inputs["gravity"] / (2.0 * spec.scene.inputs["frequency"])
    dims, landing = (dim, "point"), (dim, "point", "impact")
    data: dict[str, Any] = {
        name: (
            dims,
            _stacked([_values(line, plane, name, line.z) for line in lines], points),
            attributes_of(name),
        )
        for name in along
    }
    cycles = np.array([(line.p, line.q) for line in lines], np.int64).reshape(-1, 2)
    for name, values in zip(("cycle_impacts", "cycle_periods"), cycles.T, strict=True):
        data[name] = (dim, values, VARIABLES[name].attributes)
    ends = np.array([line.ends for line in lines]).reshape(-1, 2)
    return data | {
        "stable": coded(
            dims, stable, "whether it attracts", ((-1, "no_point"), (0, "no"), (1, "yes"))
        ),
        "admissible": coded(
            dims,
            _stacked([line.admissible for line in lines], points, blank=NONE),
            "whether a particle can follow the orbit: no earlier landing, no rest",
            ((NONE, "no_point"), (RESTS, "rests"), (MEETS_BASE, "lands_earlier"), (1, "yes")),
        ),
        "ends": coded((dim, "end"), ends, "why the line ends", ENDS),
        "multiplier_real": ((*dims, "multiplier"), real, meaning("multiplier, real part")),
        "multiplier_imaginary": (
            (*dims, "multiplier"),
            imaginary,
            meaning("multiplier, imaginary part"),
        ),
        "impact_phase": (landing, phase, meaning("phase of the impact, turns")),
        "rebound_velocity": (landing, speed * unit, meaning("velocity at lift-off", "m s-1")),
    }


def _values(line: Line, plane: Plane, name: str, z: Array) -> Array:
    """Values of a parameter at points of a line, in the unit of the parameter."""
    e, drive = z[..., line.p], z[..., line.p + 1]
    return e if name == "restitution" else np.asarray(drive / plane.scale)


def _phases(z: Array, p: int) -> Array:
    """Phases of the p impacts at points of a line, in [-1/2, 1/2] turns."""
    times = z[:, :p]
    return times - np.rint(times)


def _stacked(rows: Sequence[NDArray[Any]], *shape: int, blank: float = np.nan) -> Array:
    """Stack arrays of different sizes, each padded to one shape."""
    found = np.full((len(rows), *shape), blank)
    for i, row in enumerate(rows):
        found[i][tuple(slice(size) for size in row.shape)] = row
    return found


def _events(lines: Sequence[Line], plane: Plane, along: str) -> dict[str, Any]:
    """Bifurcations on lines, in their order along each line."""
    impacts = max((line.p for line in lines), default=1)
    most = max((len(line.events) for line in lines), default=0)
    points = [np.array([e.z for e in line.events]).reshape(-1, line.p + 2) for line in lines]
    pairs = list(zip(lines, points, strict=True))
    kinds = [np.array([event.kind for event in line.events]) for line in lines]
    values = _stacked([_values(line, plane, along, z) for line, z in pairs], most)
    phases = _stacked([_phases(z, line.p) for line, z in pairs], most, impacts)
    dims = ("branch", "event")
    flags = ((NONE, "none"), *EVENTS)
    return {
        "bifurcation": coded(dims, _stacked(kinds, most, blank=NONE), "kind of bifurcation", flags),
        f"bifurcation_{along}": (dims, values, attributes_of(along)),
        "bifurcation_phase": ((*dims, "impact"), phases, meaning("phase of the impact, turns")),
    }


def line_summary(found: xr.Dataset) -> Iterator[str]:
    """Describe each branch, or each curve, in one line."""
    dim = "branch" if "branch" in found.dims else "curve"
    if not found.sizes[dim]:
        yield "no orbit was found" if dim == "branch" else "no bifurcation was found"
    kinds, ends = dict(EVENTS), dict(ENDS)
    along = str(found.attrs["along" if dim == "branch" else "forcing"])
    unit = "" if INPUTS[along].units == "1" else f" {INPUTS[along].units}"
    for i in range(found.sizes[dim]):
        one = found.isel({dim: i})
        p, q = int(one["cycle_impacts"]), int(one["cycle_periods"])
        why = ", ".join(ends[int(code)].replace("_", " ") for code in one["ends"].values)
        if dim == "branch":
            events = [
                f"{kinds[int(k)].replace('_', ' ')} at {value:.12g}{unit}"
                for k, value in zip(
                    one["bifurcation"].values, one[f"bifurcation_{along}"].values, strict=True
                )
                if k != NONE
            ]
            text = "; ".join(events) or "no bifurcation"
        else:
            text = kinds[int(one["bifurcation"])].replace("_", " ")
        yield f"{cycle_name(p, q):24}{int(one[along].count())} points ({why}); {text}"


class Plane:
    """A rectangle of restitution and forcing in which lines are continued.

    Parameters
    ----------
    scene
        Scene of the orbits.
    forcing
        Name of the forcing.
    restitution, values
        Ascending values of the restitution and the forcing; their ends are the borders.
    points
        Most points of a line in each direction.
    """

    def __init__(
        self, scene: Scene, forcing: str, restitution: Array, values: Array, points: int
    ) -> None:
        self.forcing, self.points = forcing, points
        self.relative = forcing != AMPLITUDE
        top = {"restitution": restitution[-1:], forcing: values[-1:]}
        refuse_extreme(scene.quantities(top), forcing, scene.restitution_law)
        unit = {"restitution": np.array([0.0]), forcing: np.array([1.0])}
        self.problem = dimensionless(scene.parameters(unit), scene.duration)
        self.scale = float(self.problem.kick[0])  # drive of a forcing of 1
        self.base: Any = base_of(*scene.mechanics)
        self.corner = CORNER_PHASE if scene.waveform.name == PARABOLIC_NAME else math.inf
        self.kinks = np.array(kinks_of(scene.restitution_law)) * self.problem.restitution_speed[0]
        self.balances = scene.base == HIGH_BOUNCE and scene.rebound == "rest"
        self.restitution, self.drives = restitution, values * self.scale

    def orbits(
        self, e: Array, drive: Array, wanted: tuple[int, int], workers: Workers
    ) -> list[list[tuple[int, int, Array]]]:
        """Return p, q and the point of each admissible orbit, a list for each pair (e, drive)."""
        kick = drive * (1.0 + e) if self.relative else drive
        problem = taken(self.problem, np.zeros(e.size, np.int64))
        problem = problem._replace(restitution=np.array(e), kick=np.array(kick))
        found = find_all(self.base, problem, Wanted(*wanted, SEEDS, self.balances), workers)
        return [
            [
                (int(p), int(q), np.array([*found.times[i, k, :p], e[i], drive[i]]))
                for k, (p, q) in enumerate(zip(found.impacts[i], found.periods[i], strict=True))
                if p > 0 and found.admissible[i, k] == ADMISSIBLE
            ]
            for i in range(e.size)
        ]

    def _nodes(self, z: Array, p: int, q: int, condition: int) -> Nodes:
        """Return the nodes of lines through `z` along which `condition` holds."""
        cycle = OrbitType(p, q, self.relative, self.corner, self.kinks)
        equations = Equations(self.base, self.problem, cycle, condition, z)
        free = self.drives if condition == FIX_E else self.restitution
        column = p + (condition == FIX_E)
        ends = [0] * free.size
        ends[0], ends[-1] = 1, -1
        marks = [Mark(column, float(free[k]), end, k) for k, end in enumerate(ends)]
        if condition >= 0:
            borders = ((self.drives[0], 1), (self.drives[-1], -1))
            marks += [Mark(p + 1, float(value), end) for value, end in borders]
        return Nodes(equations, marks)

    def follow(self, z: Array, p: int, q: int, condition: int) -> Line:
        """Follow a line from a point in both directions; `condition` holds along it."""
        nodes = self._nodes(z, p, q, condition)
        return follow(nodes, z, nodes.equations.direction(z), self.points)

    def doubled(self, z: Array, p: int, q: int, condition: int) -> Line:
        """Follow the orbit of 2 p impacts that is born where one of p impacts doubles."""
        split = self._nodes(z, p, q, condition).equations.splitting(z)
        start = np.concatenate([z[:p], z[:p] + q, z[p:]])
        nodes = self._nodes(start, 2 * p, 2 * q, condition)
        return follow(nodes, start, split, self.points, born=True)


@dataclass(eq=False)
class Task:
    """A line to be continued: from an orbit at one of the values, or from a doubling."""

    p: int
    q: int
    k: int  # index of the value, -1 for a doubling
    z: Array
    parent: int = -1  # index of the line that doubles
    level: int = 0  # number of doublings before

    def is_at(self, p: int, q: int, k: int, z: Array) -> bool:
        """Return whether the line begins at this orbit."""
        return (self.p, self.q, self.k) == (p, q, k) and same_orbit(self.z, z, p, q)


def branches_along(
    plane: Plane, condition: int, wanted: tuple[int, int], doublings: int, workers: Workers
) -> list[Line]:
    """Follow all orbits of up to the `wanted` impacts and periods along a parameter.

    `condition` fixes the other parameter; orbits are searched at the values of the free one.
    Among orbits of equally many impacts, those born at doublings are continued first.
    """
    e, drive = plane.restitution, plane.drives
    size = max(e.size, drive.size)  # one of the two is fixed
    starts = plane.orbits(np.resize(e, size), np.resize(drive, size), wanted, workers)
    tasks = [Task(p, q, k, z) for k, found in enumerate(starts) for p, q, z in found]
    lines: list[Line] = []
    while tasks:
        task = min(tasks, key=lambda one: (one.p, one.parent < 0, one.q))
        tasks.remove(task)
        p, q = task.p, task.q
        if task.parent < 0:
            line = plane.follow(task.z, p, q, condition)
        elif _already_born(lines, task):
            continue
        else:
            line = plane.doubled(task.z, p // 2, q // 2, condition)
            line.parent = task.parent
        lines.append(line)
        if task.level < doublings:
            tasks += [
                Task(2 * p, 2 * q, -1, event.z, len(lines) - 1, task.level + 1)
                for event in line.events
                if event.kind == DOUBLING
            ]
        # at a fold a search may find one orbit twice
        first = [(task.k, task.z)] if task.parent < 0 else []
        for k, z in first + line.marks:
            tasks = [one for one in tasks if not one.is_at(p, q, k, z)]
    return lines


def _already_born(lines: list[Line], task: Task) -> bool:
    """Return whether the line that begins at a doubling was followed before, from its other end."""
    p, q = task.p // 2, task.q // 2
    return any(
        event.kind == BORN and same_orbit(event.z[[*range(p), -2, -1]], task.z, p, q)
        for line in lines
        if (line.p, line.q) == (task.p, task.q)
        for event in line.events
    )


def curves_of(plane: Plane, lines: list[Line]) -> list[Line]:
    """Follow each bifurcation of the lines once, as a curve along both parameters.

    Each line is at one of the restitutions of the plane.
    """
    waiting = [
        (event.kind, line.p, line.q, event.z)
        for line in lines
        for event in line.events
        if event.kind != BORN
    ]
    curves: list[Line] = []
    while waiting:
        kind, p, q, z = waiting.pop(0)
        curve = plane.follow(z, p, q, kind)
        curves.append(curve)
        for _, met in curve.marks:
            waiting = [
                one
                for one in waiting
                if one[:3] != (kind, p, q) or not same_orbit(one[3], met, p, q)
            ]
    return curves
