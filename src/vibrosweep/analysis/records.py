"""Flights of a record and the base under them, heights at any times, the return map."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from numbers import Integral
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from vibrosweep.analysis.datasets import require, table, variable
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError, ParameterError, finite
from vibrosweep.model.measures import (
    LANDING,
    OF_TRAJECTORIES,
    RAGGED_DIMS,
    RECORD,
    SAMPLES,
    Status,
    counts_agree,
    padded,
)
from vibrosweep.model.parameters import (
    HIGH_BOUNCE,
    MOUNT,
    OF_RESTITUTION,
    PARAMETERS,
    SPRUNG,
    STAGGERED,
    Periods,
    as_numbers,
)
from vibrosweep.model.restitution_laws import CONSTANT, law_in, restitution_at
from vibrosweep.model.shapes import SINE, SINE_NAME, Waveform, name_in
from vibrosweep.scene.scene import Scene, stored
from vibrosweep.store.arranged import arranged, require_dataset

if TYPE_CHECKING:
    from vibrosweep.engine.coupled import BaseTrack

__all__ = [
    "BaseMotion",
    "base_motion",
    "course",
    "landing_phases",
    "landing_separations",
    "positions",
    "recoils",
    "rectangle",
    "return_map",
    "return_points",
]

OF_SCENE: Final = ("base", "rebound", "waveform", "restitution_law")  # attributes that are kept
SOURCES: Final = "simulate(..., ragged=True), or of a sweep with ragged = true in [record]"
# Largest distance from the base at which a flight may end, relative to the lengths that it sums
FLIGHT: Final = 1e-6
NEEDS: Final = ("restitution", "amplitude", "frequency", "phase")
FLIGHTS: Final = (
    "landing_time",
    "liftoff_time",
    "rebound_velocity",
    "launch_time",
    "launch_velocity",
    "gravity",
    "duration",
)
TO_FOLLOW: Final = (*PARAMETERS, *MOUNT, "launch_time", "impact_count", "status", "duration")
PER_PERIOD: Final = 64  # of the height, in a forcing period
MOST_SAMPLES: Final = 100_000


def positions(record: xr.Dataset, times: ArrayLike) -> xr.Dataset:
    """Height of every particle and of the base at any times.

    Between landings a particle follows its parabola, and while it rests it follows the base:
    nothing is interpolated.  Uses are films, spectra and comparison with a camera.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` and `open_record` return it.
    times
        One-dimensional, in s, in any order, up to the end of the record.

    Returns
    -------
    xarray.Dataset
        Dims ``realization``, ``particle`` and ``time``: ``height`` (m); dims ``realization`` and
        ``time``: ``base_height`` (m), which is 0 over base ``"high-bounce"``.  The height of a
        particle is NaN before its launch, and after it was abandoned (`Status`).

    Raises
    ------
    ParameterError
        A time is not finite, or there is more than one dimension.
    DataError
        The record lacks a variable, or ends before one of the times.

    Examples
    --------
    >>> import numpy as np, vibrosweep as vs
    >>> film = vs.positions(vs.simulate(launch_time=[0.0, 0.125]), np.arange(0.0, 12.0, 1 / 240))
    >>> film.height.dims, float(film.height.sel(time=0.5).isel(particle=0, realization=0))
    (('realization', 'particle', 'time'), 1.27375)
    """
    instants = as_numbers("times", times)
    if instants.ndim != 1 or not np.all(np.isfinite(instants)):
        raise ParameterError("times: a list of finite times in s is expected")
    record = arranged(record)
    require(record, "positions", *FLIGHTS, "rested", "status")
    end = float(record["duration"].min())
    if np.any(instants > end):
        raise DataError(
            f"positions: the record ends at {end:g} s, and the last of the times is "
            f"{float(instants.max()):g} s; simulate it with a longer duration"
        )
    heights, levels = [], []
    for realization in range(record.sizes["realization"]):
        one = record.isel(realization=realization)
        base = base_motion(one, "positions")
        levels.append(base.height(instants))
        heights.append(_heights(one, base, levels[-1], instants))
    dims = ("realization", "particle", "time")
    kept = {n: c for n, c in record.coords.items() if set(c.dims) <= {"realization", "particle"}}
    return xr.Dataset(
        {
            "height": variable(dims, np.array(heights), "height of the particle", "m"),
            "base_height": variable(dims[::2], np.array(levels), "height of the base", "m"),
        },
        {**kept, "time": variable(("time",), instants, "time", "s")},
        {name: record.attrs[name] for name in OF_SCENE if name in record.attrs},
    )


def _heights(one: xr.Dataset, base: BaseMotion, levels: Array, times: Array) -> Array:
    """Height of each particle of one realization, (particle, time), where the base is at `levels`.

    After the landing of its latest flight a particle stays on the base until its next flight.
    """
    flights, gravity = course(one, base, np.inf), float(one["gravity"])
    followed = one["status"].values == Status.COMPLETED
    heights = np.full((followed.size, times.size), np.nan)
    for particle in np.flatnonzero(one["status"].values != Status.REFUSED):
        height = heights[particle]
        start = flights.start[particle]
        flight = np.searchsorted(start, times, side="right") - 1  # NaN come last
        last = np.count_nonzero(np.isfinite(start)) - 1
        since = times - start[flight]
        velocity, low = flights.velocity[particle, flight], flights.height[particle, flight]
        flies = (flight >= 0) & (times < flights.end[particle, flight])
        stays = (flight >= 0) & ~flies & (followed[particle] | (flight < last))
        height[stays] = levels[stays]
        height[flies] = (low + since * (velocity - 0.5 * gravity * since))[flies]
    return heights


def return_map(record: xr.Dataset, *, realization: int = 0, since: float = 0.0) -> xr.Dataset:
    """Pairs of successive speeds of arrival of all particles of one realization.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    realization
        Its position in the record.
    since
        Landings from this time on, in s, are taken.

    Returns
    -------
    xarray.Dataset
        Dim ``point``: ``arrival_speed``, ``next_arrival_speed``, ``kick`` = w - e v (m s-1), where
        w is the speed of lift-off, ``landing_time`` (s), ``particle`` and ``rested``.  Under the
        law `rest` the kick is at most A in size where the particle did not rest: the points lie
        in a strip of slope e, whose half-width is A over the high-bounce base and A + 2 V0 over a
        moving one (derived in `vibrosweep.theory.liftoff_speed_bound`).

    Raises
    ------
    DataError
        The record lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import return_map
    >>> points = return_map(vs.simulate(launch_time=[0.0, 0.125]))
    >>> bool((abs(points.kick.where(points.rested == 0).dropna("point")) <= 1.2).all())
    True
    """
    record = arranged(record)
    needed = ("landing_time", "rebound_velocity", "launch_velocity", "restitution", "rested")
    require(record, "return_map", *needed)
    one, since = chosen(record, realization), finite("since", since)
    before, after, known = return_points(one)
    time, leaving = one["landing_time"].values, one["rebound_velocity"].values
    known &= time >= since
    # over a moving base a particle may still be rising when it lands
    kept = restitutions(one, np.abs(before[known])) * before[known]
    rested = variable(
        "point",
        one["rested"].values[known],
        "the particle rested between the two",
        flag_values=np.array([0, 1], np.int8),
        flag_meanings="bounced rested",
    )
    return table(
        "point",
        arrival_speed=(before[known], "velocity of arrival, downwards", "m s-1"),
        next_arrival_speed=(after[known], "next velocity of arrival, downwards", "m s-1"),
        kick=(leaving[known] - kept, "kick w - e v", "m s-1"),
        landing_time=(time[known], "time of landing", "s"),
        particle=(np.nonzero(known)[0], "particle"),
    ).assign(rested=rested)


def return_points(one: xr.Dataset) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Speeds of arrival at each landing and at the next (m s-1), and where both are known.

    Each array has the shape (particle, impact).  Over the high-bounce base a flight lands as fast
    as it began, so that the next speed of arrival is known for the last landing too.
    """
    before, after = arrival_speeds(one, "return_map"), one["rebound_velocity"].values
    if moves(one):
        after = np.concatenate([before[:, 1:], np.full_like(before[:, :1], np.nan)], axis=1)
    return before, after, np.isfinite(before) & np.isfinite(after)


def landing_phases(record: xr.Dataset, *, realization: int = 0) -> xr.Dataset:
    """Phase of the forcing at every landing of one realization.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    realization
        Its position in the record.

    Returns
    -------
    xarray.Dataset
        Dim ``landing``, particle by particle: ``landing_time`` (s), ``phase`` (turns, from 0 to
        1) and ``particle``.

    Raises
    ------
    DataError
        The record lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> phases = vs.analysis.landing_phases(vs.simulate()).phase
    >>> bool(((phases >= 0.0) & (phases < 1.0)).all())
    True
    """
    record = arranged(record)
    require(record, "landing_phases", "landing_time", "frequency", "phase")
    one = chosen(record, realization)
    time = one["landing_time"].values
    landed = np.isfinite(time)
    particle, time = np.nonzero(landed)[0], time[landed]
    turns = float(one["frequency"]) * time + float(one["phase"]) / (2.0 * np.pi)
    return table(
        "landing",
        landing_time=(time, "time of landing", "s"),
        phase=(turns % 1.0, "phase of landing in turns"),
        particle=(particle, "particle"),
    )


def landing_separations(record: xr.Dataset, *, realization: int = 0) -> xr.Dataset:
    """Time from each landing to the next one, where that is a landing of another particle.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    realization
        Its position in the record.

    Returns
    -------
    xarray.Dataset
        Dim ``landing``, in the order of time: ``separation`` (s), whose smallest value is
        ``dt_min``; ``landing_time`` (s) and ``particle`` of the later landing,
        ``previous_particle`` of the earlier.

    Raises
    ------
    DataError
        The record lacks a variable.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> found = vs.analysis.landing_separations(vs.simulate(launch_time=[0.0, 0.125]))
    >>> bool((found.particle != found.previous_particle).all())
    True
    """
    record = arranged(record)
    require(record, "landing_separations", "landing_time")
    time = chosen(record, realization)["landing_time"].values
    landed = np.isfinite(time)
    particle, time = np.nonzero(landed)[0], time[landed]
    order = np.argsort(time, kind="stable")
    particle, time = particle[order], time[order]
    other = particle[1:] != particle[:-1]
    return table(
        "landing",
        separation=(np.diff(time)[other], "time since another particle landed", "s"),
        landing_time=(time[1:][other], "time of landing", "s"),
        particle=(particle[1:][other], "particle"),
        previous_particle=(particle[:-1][other], "particle that landed before"),
    )


def rectangle(record: xr.Dataset) -> xr.Dataset:
    """Return a ragged record as a rectangle, padded to the most impacts of any particle.

    Parameters
    ----------
    record
        Result of ``simulate(..., ragged=True)``, or of `open_record` where the sweep file has
        ``ragged = true`` in its ``[record]``.

    Returns
    -------
    xarray.Dataset
        The record as `simulate` returns it without ``ragged``, with the dims (realization,
        particle, impact).

    Raises
    ------
    DataError
        The dataset is not a ragged record, or lacks landings.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> scene = {"launch_time": [0.0, 0.125], "amplitude": [1.2, 2.0]}
    >>> vs.rectangle(vs.simulate(**scene, ragged=True)).equals(vs.simulate(**scene))
    True
    """
    record = arranged(record)
    require(record, "rectangle", *RECORD, *OF_TRAJECTORIES, source=SOURCES)
    count = record["impact_count"].values
    if not counts_agree(count, record["landing_time"].values):
        landings = f"{record.sizes.get(LANDING)} landings where impact_count has {count.sum()}"
        raise DataError(f"rectangle takes whole records, and the dataset has {landings}")
    shape = tuple(int(record[name].max()) + 1 for name in OF_TRAJECTORIES)
    places = np.indices(shape).reshape(2, -1)
    held = [record[name].values for name in OF_TRAJECTORIES]
    sizes = (record.sizes.get("realization", 1), record.sizes.get("particle", shape[1]))
    if not np.array_equal(held, places) or sizes != shape:
        raise DataError(
            "rectangle takes whole records, with all realizations and particles in their order: "
            "select from the rectangle instead"
        )
    rectangles: dict[str, Any] = {}
    for dims, ragged in RAGGED_DIMS.items():
        names = [str(n) for n, one in record.data_vars.items() if one.dims == ragged]
        for name in (n for n in names if n not in OF_TRAJECTORIES):
            values = record[name].values
            values = padded(values, count) if ragged == (LANDING,) else values
            attributes = {k: v for k, v in record[name].attrs.items() if k != SAMPLES}
            rectangles[name] = (dims, values.reshape(*shape, *values.shape[1:]), attributes)
    return record.drop_vars([*rectangles, *OF_TRAJECTORIES]).assign(rectangles)


def chosen(record: xr.Dataset, realization: int) -> xr.Dataset:
    """Select a realization of a record by position; raises a ParameterError if there is none."""
    number = record.sizes["realization"]
    if not isinstance(realization, Integral) or not -number <= realization < number:
        raise ParameterError(
            f"realization = {realization!r} is not in the record: give 0 to {number - 1}"
        )
    return record.isel(realization=realization)


def as_rectangle(record: xr.Dataset) -> xr.Dataset:
    """Return a record as a rectangle, from either form."""
    return rectangle(record) if LANDING in record.dims else record


class ParticleFlights(NamedTuple):
    """Flights of the particles of one realization; each array of shape (particle, flight).

    The first flight of each particle is that from its launch; each landing begins another.
    """

    # start, end: s; a flight in progress at the end of the interval ends there
    start: Array
    end: Array
    velocity: Array  # at the start, m s-1
    height: Array  # at the start, m
    flies: NDArray[np.bool_]  # False in places without a flight


def base_motion(one: xr.Dataset, analysis: str) -> BaseMotion:
    """Motion of the base of one realization of a record, which must hold all particles.

    Messages name the `analysis` that the user called.  Raises a DataError if the record lacks a
    parameter of the motion, or, over the base of finite mass, a particle.
    """
    _require_all_landings(one, analysis)
    motion = _alone(one, analysis)
    if not recoils(one):
        _require_flights(one, motion, analysis)
        return motion
    return recoiling(one, motion, analysis)


def _alone(one: xr.Dataset, analysis: str) -> BaseMotion:
    """Motion of the base without particles."""
    if not moves(one):
        return BaseMotion(0.0, 1.0, 0.0)
    require(one, analysis, *NEEDS)
    e, amplitude, frequency, phase = (float(one[name]) for name in NEEDS)
    return BaseMotion(amplitude / (1.0 + e), frequency, phase, waveform=stored(one.attrs))


def _require_all_landings(one: xr.Dataset, analysis: str) -> None:
    """Raise a DataError unless a record holds every landing that it counts."""
    if "impact_count" not in one.variables or "landing_time" not in one.variables:
        return
    count = one["impact_count"].values
    held = np.count_nonzero(np.isfinite(one["landing_time"].values), axis=1)
    if np.any((count >= 0) & (held != count)):
        raise DataError(
            f"{analysis} needs every landing of a particle, and the record lacks some: select "
            f"realizations and particles only"
        )


def _require_flights(one: xr.Dataset, base: BaseMotion, analysis: str) -> None:
    """Raise a DataError unless each flight of a record ends on the base where it is then.

    The flights show whether the attributes of the base are those of the record.
    """
    needed = ("landing_time", "liftoff_time", "rebound_velocity", "launch_time", "launch_velocity")
    if not all(name in one.variables for name in (*needed, "gravity")):
        return
    start = _begun(one, "launch_time", "liftoff_time")[:, :-1]
    velocity = _begun(one, "launch_velocity", "rebound_velocity")[:, :-1]
    end, gravity = one["landing_time"].values, float(one["gravity"])
    since = end - start
    miss = base.height(start) + since * (velocity - 0.5 * gravity * since) - base.height(end)
    size = np.abs(since * velocity) + gravity * since * since + base.reach
    if np.any(np.abs(miss) > FLIGHT * size):
        raise DataError(
            f"{analysis}: flights of the record do not end on the base that its attributes "
            f"describe; records of different bases cannot be combined, nor landings left out"
        )


def course(one: xr.Dataset, base: BaseMotion, until: float) -> ParticleFlights:
    """Flights of one realization of a record that begin before `until`, in s.

    A flight whose landing is not recorded lasts until the end.  Over a moving base the flight after
    the last landing of a particle that was abandoned is left out: its end is not known.
    """
    start = _begun(one, "launch_time", "liftoff_time")
    velocity = _begun(one, "launch_velocity", "rebound_velocity")
    end = np.pad(one["landing_time"].values, ((0, 0), (0, 1)), constant_values=np.nan)
    if moves(one):
        followed = one["status"].values[:, np.newaxis] == Status.COMPLETED
        unrecorded = np.where(followed, until, start)
    else:
        unrecorded = start + 2.0 * velocity / float(one["gravity"])
    end = np.minimum(np.where(np.isnan(end), unrecorded, end), until)
    # no flight: the particle rests for good, or lands at once
    flies = (start < until) & ((end > start) if moves(one) else (velocity > 0.0))
    if "status" in one.variables:  # nothing is known of a realization behind a mask
        flies = flies & (one["status"].values != Status.REFUSED)[:, np.newaxis]
    return ParticleFlights(start, end, velocity, base.height(start), flies)


def _begun(one: xr.Dataset, at_launch: str, after_landing: str) -> Array:
    """Values at the start of each flight, of which the first begins with the launch."""
    later = one[after_landing].values
    first = np.broadcast_to(one[at_launch].values, later.shape[:1])
    return np.concatenate([first[:, np.newaxis], later], axis=1)


def arrival_speeds(one: xr.Dataset, analysis: str) -> Array:
    """Speed of arrival of every landing of one realization, m s-1 downwards; (particle, impact).

    Over the high-bounce base a flight lands as fast as it began.  Over a moving base a particle may
    still be rising when the base catches up with it: its speed of arrival is then below 0.  Raises
    a DataError that names the `analysis` if the record lacks a variable.
    """
    require(one, analysis, "landing_time", "rebound_velocity", "launch_velocity")
    _require_all_landings(one, analysis)
    if not recoils(one):
        _require_flights(one, _alone(one, analysis), analysis)
    begun = _begun(one, "launch_velocity", "rebound_velocity")[:, :-1]
    if not moves(one):
        return begun
    require(one, analysis, "liftoff_time", "launch_time", "gravity")
    left = _begun(one, "launch_time", "liftoff_time")[:, :-1]
    return np.asarray(float(one["gravity"]) * (one["landing_time"].values - left) - begun)


def restitutions(one: xr.Dataset, speed: Array) -> Array:
    """Restitution of impacts of one realization at relative speeds in m s-1."""
    law, e = law_in(one.attrs), float(one["restitution"])
    of_law = () if law == CONSTANT else (law, float(one["restitution_speed"]))
    return restitution_at(speed, e, *of_law)


@dataclass(frozen=True)
class BaseMotion:
    """Motion of the base of one realization, which the particles do not affect."""

    speed: float  # peak velocity V0 = A / (1 + e), m s-1; 0 where the base stays at height 0
    frequency: float  # Hz
    phase: float  # rad
    waveform: Waveform = field(default=SINE, kw_only=True)

    def velocity(self, time: ArrayLike) -> Array:
        """Velocity V0 w(f t + phi / 2 pi), m s-1, at times in s of any shape."""
        if self.waveform == SINE:
            return np.asarray(self.speed * np.sin(self._angle(time)))
        return self.speed * self.waveform.velocity(self._turns(time))

    def height(self, time: ArrayLike) -> Array:
        """Height V0 / f W(f t + phi / 2 pi), m, at times in s of any shape."""
        if self.waveform == SINE:
            return np.asarray(-self.displacement * np.cos(self._angle(time)))
        return self.speed / self.frequency * self.waveform.height(self._turns(time))

    @property
    def displacement(self) -> float:
        """Half the height from the lowest to the highest level, m."""
        return self.speed / (self.waveform.per_displacement * self.frequency)

    @property
    def reach(self) -> float:
        """Upper bound of the distance from height 0, m."""
        return self.displacement if self.waveform == SINE else 2.0 * self.displacement

    def _turns(self, time: ArrayLike) -> Array:
        return np.asarray(self.frequency * np.asarray(time) + self.phase / (2.0 * np.pi))

    def _angle(self, time: ArrayLike) -> Array:
        return np.asarray(2.0 * np.pi * self.frequency * np.asarray(time) + self.phase)


def base_name(dataset: xr.Dataset) -> str:
    """Return the base of a dataset, one of `BASES`; by default the high-bounce base."""
    require_dataset(dataset)
    return str(dataset.attrs.get("base", HIGH_BOUNCE))


def moves(dataset: xr.Dataset) -> bool:
    """Return whether the base of a dataset moves."""
    return base_name(dataset) != HIGH_BOUNCE


def recoils(dataset: xr.Dataset) -> bool:
    """Return whether the base of a dataset has finite mass and so couples its particles."""
    return base_name(dataset) == SPRUNG


def has_closed_forms(dataset: xr.Dataset) -> bool:
    """Return whether closed forms hold: they need a sine, constant restitution, no coupling."""
    plain = name_in(dataset.attrs) == SINE_NAME and law_in(dataset.attrs) == CONSTANT
    return plain and not recoils(dataset)


@dataclass(frozen=True)
class Recoiling(BaseMotion):
    """Motion of a base of finite mass; before the first launch it is that of `BaseMotion`."""

    track: BaseTrack  # motion disturbed by the particles
    # begin, end: first launch, and end of the observation, s
    begin: float
    end: float

    def velocity(self, time: ArrayLike) -> Array:
        """Velocity, m s-1, at times in s of any shape; at an impact, the velocity after it."""
        return self._at(time, 1)

    def height(self, time: ArrayLike) -> Array:
        """Height above the mean level of the undisturbed base, m, at times in s of any shape."""
        return self._at(time, 0)

    @cached_property
    def reach(self) -> float:
        """Largest sampled distance from height 0, m."""
        count = int(min(PER_PERIOD * self.frequency * (self.end - self.begin), MOST_SAMPLES)) + 2
        return float(np.max(np.abs(self.height(np.linspace(self.begin, self.end, count)))))

    def _at(self, time: ArrayLike, which: int) -> Array:
        times = np.asarray(time, dtype=np.float64)
        instants, places = np.unique(times[np.isfinite(times)], return_inverse=True)
        found = super().velocity(times) if which else super().height(times)
        followed = self.track.at(instants)[which][places]
        # before the first launch the base is undisturbed
        found[np.isfinite(times)] = np.where(
            np.isnan(followed), found[np.isfinite(times)], followed
        )
        return found


def recoiling(one: xr.Dataset, alone: BaseMotion, analysis: str) -> Recoiling:
    """Motion of the base of one realization of a record, from its undisturbed motion `alone`.

    Messages name the `analysis` that the user called.  Raises a DataError if the record lacks a
    variable or a particle.
    """
    require(one, analysis, *TO_FOLLOW)
    begin, end = float(one["launch_time"].min()), float(one["duration"])
    track, shape = _track(one, analysis), alone.waveform
    return Recoiling(alone.speed, alone.frequency, alone.phase, track, begin, end, waveform=shape)


def _track(one: xr.Dataset, analysis: str) -> BaseTrack:
    """Compute the trajectories of a record again, this time keeping the motion of the base."""
    # these load numba, which other bases do not need
    from vibrosweep.engine.coupled import base_track
    from vibrosweep.engine.workers import Workers

    names = (*PARAMETERS, *(name for name in OF_RESTITUTION if name in one.variables), *MOUNT)
    parameters = {name: np.array([float(one[name])]) for name in names}
    times = np.broadcast_to(one["launch_time"].values, one["impact_count"].shape)
    listed = one.attrs.get("launch") != STAGGERED
    periods = one.attrs.get("duration_periods")
    landings, followed = one["impact_count"].values, np.all(one["status"] == Status.COMPLETED)
    scene = Scene(
        landings.size,
        tuple(times.tolist()) if listed else STAGGERED,
        float(one["duration"]) if periods is None else Periods(float(periods)),
        str(one.attrs["rebound"]),
        base=SPRUNG,
        restitution_law=law_in(one.attrs),
        waveform=stored(one.attrs),
    ).recorded(None if followed else max(int(landings.max()), 1))
    with Workers(1) as workers:
        track = base_track(parameters, scene, workers)
    if not np.array_equal(track.landings, landings):
        raise DataError(
            f"{analysis}: the landings of the record cannot be repeated, which the motion of "
            f"the base requires: use a record of all particles, computed by this version"
        )
    return track
