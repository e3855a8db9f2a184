"""Basins of attraction: the attractor of each launch, shares along a parameter, and slots."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.common import (
    attributes,
    grid_axes,
    lift_off_speeds,
    meaning,
    require_ability,
    require_memory,
    settling,
    shared,
)
from vibrosweep.analysis.datasets import require, share_interval, variable
from vibrosweep.arrays import Array
from vibrosweep.engine.landings import launch_times
from vibrosweep.engine.measure import NO_ORBIT, find_orbits, label_orbits, slots
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import DataError
from vibrosweep.kernels.impact import base_of
from vibrosweep.kernels.settle import Orbits, empty_shortest, shortest_flights
from vibrosweep.mistakes import Mistake
from vibrosweep.model.forcing import FORCINGS
from vibrosweep.model.measures import VARIABLES, Regime
from vibrosweep.model.parameters import Dimensionless, Launches, dimensionless, reduced_turns, taken
from vibrosweep.runs.result import attributes_of, short_observation
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import Sweep
from vibrosweep.store.arranged import arranged

__all__ = ["UNSETTLED", "basins", "capacity", "name_of", "summary"]

Codes = NDArray[np.int64]
BYTES_PER_LAUNCH: Final = 300
BYTES_KEPT: Final = 16
MOST_LINES: Final = 12  # attractors in a summary along a parameter
PLANE: Final = ("launch_velocity", "launch_time")
ALONG: Final = ("restitution", *FORCINGS)
SHAPES: Final = {  # name and number format in a summary
    "unsettled_fraction": ("unsettled, on no attractor", "{:.2%}"),
    "basin_entropy": ("basin entropy", "{:.3g} nats"),
    "uncertainty_exponent": ("uncertainty exponent", "{:.3g}"),
}
UNSETTLED: Final = -1  # instead of the index of an attractor
OF_KIND: Final = ("regime", "cycle_periods", "cycle_rests")  # constant along a parameter
BOX: Final = 5  # launches along each side of a box
STEPS: Final = (1, 2, 4, 8, 16)  # distances of the launches that are compared, along the axis
FEWEST: Final = 64  # values of an axis along which launches are compared
EVEN: Final = 1e-6  # largest relative difference between the steps of an even axis
SHAPE: Final = {
    "unsettled_fraction": "fraction of unsettled launches",
    "basin_entropy": f"mean entropy in boxes of {BOX} x {BOX} launches, nats",
    "boundary_entropy": f"mean entropy in boxes of {BOX} x {BOX} with several basins, nats",
    "uncertainty_exponent": (
        "slope of the logarithm of the share of launches with a neighbour of another basin"
    ),
    "uncertainty_exponent_error": "standard error of the slope",
}


def basins(sweep: Sweep, threads: int) -> xr.Dataset:
    """Launch a particle at every point of a plane and find its attractor: `vibrosweep.basins`.

    The launch times are those of the sweep's particles, the speeds those of its grid; the result
    holds each value once, ascending.  All launches that end at rest for good count as one
    attractor, and so do all aperiodic ones; unsettled launches have none.  Raises a SpecError
    unless the axes of the design are the launch velocity and at most one of `ALONG`.
    """
    require_ability("basins", sweep.scene, sweep.design.sampled)
    axes = grid_axes(sweep, "basins", "launch_velocity", ALONG)
    speeds = axes.pop("launch_velocity")
    if len(axes) > 1:
        other = [*axes][-1]
        raise sweep.refusal(Mistake(f"sample.{other}", f"basins take one axis besides {PLANE[0]}"))
    scanned = axes.get("restitution")
    highest = sweep.scene.inputs["restitution"] if scanned is None else float(scanned[-1])
    scene = settling(sweep, highest)
    frequency = scene.inputs["frequency"]
    times = np.unique(launch_times(scene.launch, scene.particles, frequency))
    steps = max((values.size for values in axes.values()), default=1)
    bytes_each = BYTES_PER_LAUNCH + steps * BYTES_KEPT
    require_memory("launches", speeds.size * times.size, bytes_each)
    words = attributes_of("launch_velocity")
    coordinates = {
        "launch_time": ("launch_time", times, meaning("time of launch", "s")),
        "launch_velocity": ("launch_velocity", speeds, words),
    }
    with Workers(threads) as workers:
        planes = [
            _basins_at(scene, {n: v[k] for n, v in axes.items()}, coordinates, workers)
            for k in range(steps)
        ]
    (found,) = planes if not axes else (_along(planes, axes),)
    total = speeds.size * times.size
    counted = found["launches"]
    share = counted.values / total
    shares = {"fraction": (counted.dims, share, meaning("fraction of launches in the basin"))}
    for side, values in share_interval(counted.values, total).items():
        end = f"{side} end of the Wilson 95 % interval of the fraction of launches"
        shares[f"fraction_{side}"] = (counted.dims, values, meaning(end))
    notes = short_observation(scene, highest, frequency)
    along: dict[str, Any] = dict(zip(("along",), axes, strict=False))
    return (
        found.drop_vars("launches")
        .assign(shares | shared(scene, ["launch_velocity", *axes]))
        .assign_attrs(attributes(sweep, scene, notes, **along))
    )


def _basins_at(
    scene: Scene, varied: Mapping[str, float], coordinates: dict[str, Any], workers: Workers
) -> xr.Dataset:
    """Basins at one value of a parameter, or at the values of the scene."""
    speeds, times = (coordinates[name][1] for name in PLANE)
    shape = (speeds.size, times.size)
    inputs = {name: np.full(speeds.size * times.size, value) for name, value in varied.items()}
    parameters = scene.parameters({"launch_velocity": np.repeat(speeds, times.size), **inputs})
    problem = dimensionless(parameters, scene.duration, scene.measures.transient)
    whole, phase = reduced_turns(scene.inputs["frequency"], np.tile(times, speeds.size), 0.0)
    launch = Launches(whole[:, np.newaxis], phase[:, np.newaxis])
    alone = replace(scene.only(), particles=1, launch=tuple(times))
    orbits = find_orbits(problem, launch, alone, workers)
    labels = label_orbits(orbits, 1)[0]
    # orbits without a cycle have a label for each regime
    labels = np.where(labels == NO_ORBIT, -1 - orbits.regime.astype(np.int64), labels)
    first, index, count = _by_frequency(labels, orbits.regime != Regime.UNSETTLED)
    landed, speed = _shortest(scene, problem, orbits, first, workers)
    plane = index.reshape(shape)
    attrs = meaning("index of the attractor that the launch leads to")
    attrs["comment"] = f"{UNSETTLED} for an unsettled launch"
    data: dict[str, Any] = {
        "basin": (PLANE, plane, attrs),
        "slot": (PLANE, slots(orbits).reshape(shape), VARIABLES["slot"].attributes),
        **_attractors(orbits, landed, speed, first, count),
        **basin_measures(plane, speeds),
    }
    return xr.Dataset(data, coordinates)


def _along(planes: list[xr.Dataset], axes: Mapping[str, Array]) -> xr.Dataset:
    """Join basins along a parameter; an attractor keeps its index as long as it exists."""
    tracks = _tracks(planes)
    count = max((int(track.max(initial=-1)) for track in tracks), default=-1) + 1
    total = np.zeros(count)
    for plane, track in zip(planes, tracks, strict=True):
        total[track] += plane["launches"].values
    rank = np.empty(count, np.int64)
    rank[np.argsort(-total, kind="stable")] = np.arange(count)
    placed = []
    for plane, track in zip(planes, tracks, strict=True):
        ranks = np.append(rank[track], UNSETTLED)  # the index -1 takes the last entry
        basin = plane["basin"].copy(data=ranks[plane["basin"].values])
        placed.append(plane.assign(basin=basin).assign_coords(attractor=ranks[:-1]))
    ((name, values),) = axes.items()
    axis = xr.DataArray(values, dims=name, name=name, attrs=attributes_of(name))
    joined = xr.concat(
        placed,
        axis,
        data_vars="all",
        coords="minimal",
        compat="override",
        join="outer",
        combine_attrs="override",
        fill_value={**dict.fromkeys(OF_KIND, -1), "cycle_impacts": 0, "launches": 0},
    )
    same = {kind: joined[kind].max(name, keep_attrs=True) for kind in OF_KIND}
    return joined.assign(same).drop_vars("attractor")


def _tracks(planes: list[xr.Dataset]) -> list[Codes]:
    """Number the attractors so that each keeps its number along a parameter.

    An attractor is matched with one of the same kind at earlier values.  If there are several,
    those are matched whose impacts before the shortest flight are nearest in phase and speed.
    """
    from scipy.optimize import linear_sum_assignment

    known: list[tuple[tuple[int, ...], Array]] = []
    tracks = []
    speeds = np.concatenate([plane["rebound_velocity"].values for plane in planes])
    fastest = np.nanmax(speeds, initial=0.0) or 1.0
    for plane in planes:
        impacts = np.where(plane["regime"] == Regime.LOCKED, plane["cycle_impacts"], 0)
        kinds = list(zip(impacts, *(plane[name].values for name in OF_KIND), strict=True))
        turn = np.exp(2j * np.pi * plane["impact_phase"].values)
        speed = plane["rebound_velocity"].values / fastest
        places = np.nan_to_num(np.stack([turn.real, turn.imag, speed], axis=1))
        track = np.full(len(kinds), -1)
        for kind in dict.fromkeys(kinds):
            new = [i for i, other in enumerate(kinds) if other == kind]
            old = [k for k, (other, _) in enumerate(known) if other == kind]
            there = np.array([known[k][1] for k in old]).reshape(len(old), 3)
            distances = np.abs(places[new][:, np.newaxis] - there).sum(axis=-1)
            for row, column in zip(*linear_sum_assignment(distances), strict=True):
                track[new[row]] = old[column]
        for i in np.flatnonzero(track < 0).tolist():
            track[i] = len(known)
            known.append((kinds[i], places[i]))
        for i, number in enumerate(track.tolist()):
            known[number] = kinds[i], places[i]
        tracks.append(track)
    return tracks


def name_of(attractor: xr.Dataset) -> str:
    """Name of one attractor: its regime, and for a cycle its impacts and periods.

    The number of impacts is left out where it changes along a parameter, as it may with rests.
    """
    regime = Regime(int(attractor["regime"]))
    if regime not in (Regime.RESTING, Regime.LOCKED):
        return regime.meaning.replace("_", " ")
    impacts, periods = np.unique(attractor["cycle_impacts"]), int(attractor["cycle_periods"])
    p = int(impacts[-1])
    number = f"{p} impact{'s' if p > 1 else ''} / " if (impacts > 0).sum() == 1 else ""
    return f"{regime.meaning}, {number}{periods} period{'s' if periods > 1 else ''}"


def summary(found: xr.Dataset) -> Iterator[str]:
    """Describe the fraction of launches that leads to each attractor, and how basins interlace."""
    along = str(found.attrs.get("along", ""))
    count = found.sizes["attractor"]
    shown = min(count, MOST_LINES) if along else count
    for i in range(shown):
        one = found.isel(attractor=i)
        if along:
            exists = one["fraction"] > 0.0
            values = found[along].values[exists.values]
            yield (
                f"{name_of(one):32}{float(one['fraction'].min()):.2%} to "
                f"{float(one['fraction'].max()):.2%} at {values.size} values of {along}, the first "
                f"{values[0]:.6g}, the last {values[-1]:.6g}"
            )
        else:
            low, high = float(one["fraction_low"]), float(one["fraction_high"])
            yield f"{name_of(one):32}{float(one['fraction']):.2%} ({low:.2%} to {high:.2%})"
    if shown < count:
        rest = found["fraction"][:, shown:].sum("attractor")
        yield f"{f'{count - shown} others':32}{float(rest.min()):.2%} to {float(rest.max()):.2%}"
    for name, (words, form) in SHAPES.items():
        values = np.atleast_1d(found[name].values)
        values = values[np.isfinite(values)]
        if values.any() or (values.size and name == "basin_entropy"):
            ends = dict.fromkeys((values.min(), values.max()))
            error = f"{name}_error"
            known = error in found and not along
            yield (
                f"{words:32}{' to '.join(form.format(end) for end in ends)}"
                f"{f' +- {float(found[error]):.1g}' if known else ''}"
            )


def _by_frequency(labels: Codes, settled: NDArray[np.bool_]) -> tuple[Codes, Codes, Codes]:
    """First launch of each label, index of the label of each launch, and launches per label.

    Labels are ordered by their numbers of launches, the most frequent first.  Launches that have
    not settled have the index `UNSETTLED`.
    """
    launches = np.flatnonzero(settled)
    _, first, inverse, count = np.unique(
        labels[launches], return_index=True, return_inverse=True, return_counts=True
    )
    order = np.lexsort((first, -count))
    rank = np.empty_like(order)
    rank[order] = np.arange(order.size)
    index = np.full(labels.size, UNSETTLED)
    index[launches] = rank[inverse]
    return launches[first[order]], index, count[order]


def _shortest(
    scene: Scene, problem: Dimensionless, orbits: Orbits, first: Codes, workers: Workers
) -> tuple[Array, Array]:
    """Phase of landing in turns, and speed at lift-off in m/s, before each shortest flight.

    One value for each attractor, to which a launch of `first` leads; NaN unless it is a cycle.
    """
    recurs = orbits.impacts[first] > 0
    rows = first[recurs]
    problems = taken(problem, rows)
    base, found = base_of(*scene.mechanics), empty_shortest(rows.size)
    states = (orbits.phase[rows], orbits.flight[rows], orbits.impacts[rows])
    workers.run(
        lambda begin, end: shortest_flights(begin, end, base, problems, *states, found),
        rows.size,
        16,
        found,
    )
    landed, speed = (np.full(first.size, np.nan) for _ in range(2))
    landed[recurs] = found.landed
    speed[recurs] = lift_off_speeds(scene, problems, found.left, found.speed)
    return landed, speed * (scene.inputs["gravity"] / (2.0 * scene.inputs["frequency"]))


def _attractors(
    orbits: Orbits, landed: Array, speed: Array, first: Codes, count: Codes
) -> dict[str, Any]:
    """Variables along the dim attractor, computed from the first launch that leads to each."""
    recurs = orbits.impacts[first] > 0
    same = recurs | (orbits.regime[first] == Regime.AT_REST)
    values = {
        "regime": orbits.regime[first],
        "cycle_impacts": orbits.impacts[first],
        "cycle_periods": orbits.periods[first],
        "cycle_rests": orbits.rests[first],
        "lyapunov_largest": np.where(same, orbits.largest[first], np.nan),
    }
    data: dict[str, Any] = {n: ("attractor", v, VARIABLES[n].attributes) for n, v in values.items()}
    comment = "NaN where orbits do not repeat, since each has its own"
    data["lyapunov_largest"][2]["comment"] = comment
    words = meaning("phase in turns of the impact before the shortest flight")
    data["impact_phase"] = ("attractor", landed, words)
    words = meaning("speed at the lift-off to the shortest flight", "m s-1")
    data["rebound_velocity"] = ("attractor", speed, words)
    return data | {"launches": ("attractor", count)}


def basin_measures(index: NDArray[np.int64], speeds: Array) -> dict[str, Any]:
    """Variables that measure how basins interlace.

    `index`, of shape (launch_velocity, launch_time), numbers the attractor of each launch.  It is
    negative for unsettled launches, which are left out of the entropies and of the exponent.
    Basin entropy: Daza et al. (2016), Scientific Reports 6, 31416; uncertainty exponent: McDonald
    et al. (1985), Physica D 17, 125.
    """
    values: tuple[float, ...] = (
        float(np.mean(index < 0)),
        *_entropies(index),
        *_exponent(index, speeds),
    )
    return {
        name: ((), value, {"units": "1", "long_name": words})
        for (name, words), value in zip(SHAPE.items(), values, strict=True)
    }


def _entropies(index: NDArray[np.int64]) -> tuple[float, float]:
    """Basin entropy, NaN if no box has a basin, and boundary entropy, NaN if no box has several."""
    rows, columns = (size // BOX * BOX for size in index.shape)
    cut = index[:rows, :columns].reshape(rows // BOX, BOX, columns // BOX, BOX)
    boxes = cut.transpose(0, 2, 1, 3).reshape(-1, BOX * BOX)
    counts = [np.unique(box[box >= 0], return_counts=True)[1] for box in boxes]
    entropy = np.array([-np.sum(k / k.sum() * np.log(k / k.sum())) for k in counts if k.size])
    mixed = entropy[[k.size > 1 for k in counts if k.size]]
    basin, boundary = (float(v.mean()) if v.size else np.nan for v in (entropy, mixed))
    return basin, boundary


def _exponent(index: NDArray[np.int64], speeds: Array) -> tuple[float, float]:
    """Uncertainty exponent along the speed of launch, with its standard error.

    A launch is uncertain at a distance if a neighbour that much faster or slower is in another
    basin.  The share of uncertain launches grows as a power of the distance, whose exponent this
    is.  NaN if the speeds are few or uneven, or no launch is uncertain at some distance.
    """
    from scipy.stats import linregress

    steps = np.diff(speeds)
    if speeds.size < FEWEST or np.ptp(steps) > EVEN * steps.mean():
        return np.nan, np.nan
    # with the same launches at every distance a straight boundary has exactly the exponent 1
    first, last = STEPS[-1], speeds.size - STEPS[-1]
    middle, shares = index[first:last], []
    for step in STEPS:
        up, down = index[first + step : last + step], index[first - step : last - step]
        known = (middle >= 0) & (up >= 0) & (down >= 0)
        differs = ((up != middle) | (down != middle)) & known
        shares.append(differs.sum() / max(1, known.sum()))
    if min(shares) == 0.0:
        return np.nan, np.nan
    line = linregress(np.log(STEPS), np.log(shares))
    return float(line.slope), float(line.stderr)


def capacity(basins: xr.Dataset) -> xr.Dataset:
    """Count the slots of all attractors that a dense set of launches leads to.

    An attractor that repeats after q forcing periods exists in q copies, shifted by whole periods.
    More particles than there are slots cannot stay separated, however they are launched.  An
    attractor that no launch leads to is not counted: the number is a lower bound that rises with
    the density of the launches.

    Parameters
    ----------
    basins
        Result of `vibrosweep.basins`.

    Returns
    -------
    xarray.Dataset
        ``capacity`` and its part ``capacity_without_rests`` (attractors on which no particle
        rests); ``unsettled_fraction`` of the launches, which found no recurrent orbit; dim
        ``attractor``: ``slots``, 0 for an index that is not a recurrent orbit.

    Raises
    ------
    DataError
        The dataset lacks a variable, or holds basins along a parameter.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import capacity
    >>> plane = vs.basins(launch_velocity=[3.0, 5.0, 10.0], particles=50, duration=2000.0)
    >>> int(capacity(plane).capacity)
    2
    """
    basins = arranged(basins)
    needed = ("regime", "cycle_periods", "cycle_rests", "fraction", "unsettled_fraction")
    require(basins, "capacity", *needed, source="basins")
    if basins["fraction"].dims != ("attractor",):
        raise DataError(
            f"capacity takes basins at one value of {basins.attrs['along']}: compute them with a "
            f"single value"
        )
    orbit = np.isin(basins["regime"].values, (Regime.LOCKED, Regime.RESTING))
    slots = np.where(orbit, basins["cycle_periods"].values, 0).astype(np.int64)
    without = basins["regime"].values == Regime.LOCKED
    return xr.Dataset(
        {
            "capacity": variable((), int(slots.sum()), "slots of all attractors found"),
            "capacity_without_rests": variable(
                (), int(slots[without].sum()), "slots of attractors on which no particle rests"
            ),
            "unsettled_fraction": variable(
                (),
                float(basins["fraction"].values[~orbit].sum() + basins["unsettled_fraction"]),
                "fraction of launches that found no recurrent orbit",
            ),
            "slots": variable(("attractor",), slots, "slots of the attractor"),
        }
    )
