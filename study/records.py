"""Quantities of a record that claims need: order of landings, meetings, crossings, mean kicks.

Each function takes a record of every landing, as `vibrosweep.simulate` returns it.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from study.arrays import Array, Flags
from study.bases import HIGH_BOUNCE
from vibrosweep import positions

NOBODY: Final = -1


def order_of_landings(record: xr.Dataset, *, since: float = 0.0) -> xr.Dataset:
    """Count changes of the sequence of landings, and overtakings of particles.

    The sequence s_1, s_2, ... names the particle of each landing from `since` on, in the order of
    time (particles that land together stand in the order of their numbers).  N particles keep their
    order as long as each landing repeats the one N places before, s_(k+N) = s_k; each k at which
    this fails is a change.  One of two particles overtakes the other where the first of them to
    make impact n is the second to make impact n + 1.

    Dim ``realization``: ``sequence_changes`` among the ``sequence_pairs`` compared, ``overtakings``
    among ``impact_pairs``, and both fractions, NaN if nothing was compared.
    """
    times = record["landing_time"].values
    times = np.where(times >= since, times, np.nan)
    changes, pairs = np.array([_sequence_changes(one) for one in times]).reshape(-1, 2).T
    turns, steps = np.array([_overtakings(one) for one in times]).reshape(-1, 2).T
    with np.errstate(invalid="ignore"):
        fractions = changes / pairs, turns / steps
    return _table(
        sequence_changes=changes,
        sequence_pairs=pairs,
        sequence_change_fraction=fractions[0],
        overtakings=turns,
        impact_pairs=steps,
        overtaking_fraction=fractions[1],
    )


def _table(**columns: NDArray[Any]) -> xr.Dataset:
    return xr.Dataset({name: ("realization", values) for name, values in columns.items()})


def _sequence_changes(times: Array) -> tuple[int, int]:
    """Changes and comparisons of one realization; times of shape (particle, impact)."""
    particles = times.shape[0]
    known = np.isfinite(times)
    sequence = np.nonzero(known)[0][np.argsort(times[known], kind="stable")]
    pairs = max(sequence.size - particles, 0)
    return int(np.count_nonzero(sequence[particles:] != sequence[:pairs])), pairs


def _overtakings(times: Array) -> tuple[int, int]:
    """Overtakings and comparisons of one realization; times of shape (particle, impact)."""
    overtakings = pairs = 0
    for i in range(times.shape[0] - 1):
        ahead = np.sign(times[i + 1 :] - times[i])
        product = ahead[:, 1:] * ahead[:, :-1]
        overtakings += int(np.count_nonzero(product < 0.0))
        pairs += int(np.count_nonzero(np.isfinite(product)))
    return overtakings, pairs


def separation_changes(
    record: xr.Dataset, *, since: float = 0.0, landed_before: int = 0
) -> xr.Dataset:
    """Changes of the separation of two particles from one impact to the next (Eqs. 23, 24).

    The separation of particles i and j at impact n is t_j(n) - t_i(n).  Landings before `since`,
    and the first `landed_before` impacts of each particle, are left out.

    Dim ``realization``: ``change_max`` and ``change_median`` (s) over all pairs of particles and
    successive impacts, the ``preserved_fraction`` that changes by at most the contact time, and the
    number ``steps`` of changes; if it is 0, the others are NaN.
    """
    times = record["landing_time"].values[..., landed_before:]
    times = np.where(times >= since, times, np.nan)
    contact = np.broadcast_to(record["contact_time"].values, times.shape[:1])
    found = [_changes(one, float(tau)) for one, tau in zip(times, contact, strict=True)]
    largest, middle, preserved, steps = np.array(found).reshape(-1, 4).T
    return _table(
        change_max=largest,
        change_median=middle,
        preserved_fraction=preserved,
        steps=steps.astype(np.int64),
    )


def _changes(times: Array, contact_time: float) -> tuple[float, float, float, float]:
    steps = np.diff(times, axis=1)
    pairs = [np.abs(steps[i + 1 :] - steps[i]).ravel() for i in range(times.shape[0] - 1)]
    changes = np.concatenate([np.empty(0), *pairs])
    changes = changes[np.isfinite(changes)]
    if not changes.size:
        return np.nan, np.nan, np.nan, 0.0
    preserved = float(np.mean(changes <= contact_time))
    return float(changes.max()), float(np.median(changes)), preserved, float(changes.size)


def first_shared_base(record: xr.Dataset) -> xr.Dataset:
    """First time at which two particles share the base, and which ones.

    A particle is on the base from its landing to its lift-off, and at least for the contact time.
    A stay that begins at the instant at which another ends does not share the base with it.

    Dim ``realization``: ``first_shared_time`` (s; NaN where it never happens), ``occupant`` and
    ``newcomer``, the numbers of the particles, or -1.
    """
    landing, liftoff = record["landing_time"].values, record["liftoff_time"].values
    contact = np.broadcast_to(record["contact_time"].values, landing.shape[:1])
    found = [_first(*one) for one in zip(landing, liftoff, contact, strict=True)]
    times, occupants, newcomers = (np.array(column) for column in zip(*found, strict=True))
    shared = _table(first_shared_time=times, occupant=occupants, newcomer=newcomers)
    words = "first time at which two particles share the base"
    shared["first_shared_time"].attrs = {"units": "s", "long_name": words}
    return shared


def _first(landing: Array, liftoff: Array, contact_time: float) -> tuple[float, int, int]:
    """Time, occupant and newcomer; arrays of shape (particle, impact)."""
    known = np.isfinite(landing)
    # a particle without a lift-off stays on the base
    leaves = np.where(np.isnan(liftoff), np.inf, np.maximum(liftoff, landing + contact_time))
    order = np.argsort(landing[known], kind="stable")
    who, begin, end = np.nonzero(known)[0][order], landing[known][order], leaves[known][order]
    # stays of one particle do not overlap: one that has not yet ended is another particle's
    latest = np.maximum.accumulate(end)[:-1]
    sharing = np.flatnonzero((begin[1:] < latest) & _another(who, end))
    if not sharing.size:
        return np.nan, NOBODY, NOBODY
    k = int(sharing[0]) + 1
    return float(begin[k]), int(who[int(np.argmax(end[:k]))]), int(who[k])


def _another(who: NDArray[np.int64], end: Array) -> Flags:
    """Return whether the latest end before each stay but the first is that of another particle.

    After a flight of exactly one contact time, rounding may make it the particle's own.
    """
    holder = np.zeros(who.size, np.int64)
    new = np.flatnonzero(end[1:] > np.maximum.accumulate(end)[:-1]) + 1
    holder[new] = new
    return np.asarray(who[np.maximum.accumulate(holder)[:-1]] != who[1:])


class Flights(NamedTuple):
    """Flights of all particles of one realization, in the order of their starts."""

    particle: NDArray[np.int64]
    # start, end: s; a flight in progress at the end of the observation ends there
    start: Array
    end: Array
    velocity: Array  # at the start, m s-1
    height: Array  # of the base at the start, m


def flights(record: xr.Dataset) -> Flights:
    """Flights of a record of one realization, including those that begin at the launches."""
    until = float(record["duration"])
    start = _begun(record, "launch_time", "liftoff_time")[0]
    velocity = _begun(record, "launch_velocity", "rebound_velocity")[0]
    end = np.pad(record["landing_time"].values[0], ((0, 0), (0, 1)), constant_values=np.nan)
    end = np.fmin(end, until)  # a flight whose landing is not recorded lasts until the end
    flies = (start < until) & (end > start)
    particle, _ = np.nonzero(flies)
    order = np.argsort(start[flies], kind="stable")
    begins = start[flies][order]
    height = positions(record, begins)["base_height"].values[0]
    return Flights(particle[order], begins, end[flies][order], velocity[flies][order], height)


def _begun(record: xr.Dataset, at_launch: str, after_landing: str) -> Array:
    """Values at the start of each flight, of which the first begins with the launch."""
    later = record[after_landing]
    first = record[at_launch].broadcast_like(later.isel(impact=0, drop=True))
    first = first.transpose("realization", "particle")
    return np.concatenate([first.values[..., np.newaxis], later.values], axis=-1)


def crossings(record: xr.Dataset) -> xr.Dataset:
    """Every crossing of two particles of one realization while both are in flight (Eq. 18).

    Both fall with the same acceleration: where two flights overlap, y_i - y_j is linear in time.
    With d = s_j - s_i >= 0 between their beginnings and x the time since the later one,

        y_i - y_j = h_i - h_j + v_i d - g d^2 / 2 + (v_i - g d - v_j) x,

    where h are the heights of the base at the lift-offs.  The difference has at most one root,
    unless the flights coincide.

    Dim ``crossing``, in the order of time: ``time`` (s), ``height`` (m), ``first`` and ``second``
    particle.  Scalars: ``flight_overlaps`` (pairs of flights that overlap in time),
    ``flights_alike`` (pairs of flights at equal heights throughout), ``pairs`` of particles and
    ``pairs_crossing``.
    """
    flown, gravity = flights(record), float(record["gravity"])
    i, j = _overlapping(flown)
    apart = flown.start[j] - flown.start[i]
    offset = apart * (flown.velocity[i] - 0.5 * gravity * apart)
    offset += flown.height[i] - flown.height[j]
    slope = flown.velocity[i] - gravity * apart - flown.velocity[j]
    with np.errstate(invalid="ignore", divide="ignore"):
        since = -offset / slope
    together = np.minimum(flown.end[i], flown.end[j]) - flown.start[j]
    crosses = np.flatnonzero((since > 0.0) & (since < together))
    time = (flown.start[j] + since)[crosses]
    order = np.argsort(time, kind="stable")
    crosses, time = crosses[order], time[order]
    since, j_crossing = since[crosses], j[crosses]
    fallen = since * (flown.velocity[j_crossing] - 0.5 * gravity * since)
    first, second = flown.particle[i][crosses], flown.particle[j][crosses]
    who = {(min(pair), max(pair)) for pair in zip(first.tolist(), second.tolist(), strict=True)}
    particles = record.sizes["particle"]
    return xr.Dataset(
        {
            "time": ("crossing", time),
            "height": ("crossing", flown.height[j_crossing] + fallen),
            "first": ("crossing", first),
            "second": ("crossing", second),
            "flight_overlaps": i.size,
            "flights_alike": int(np.count_nonzero((slope == 0.0) & (offset == 0.0))),
            "pairs": particles * (particles - 1) // 2,
            "pairs_crossing": len(who),
        }
    )


def _overlapping(flown: Flights) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices of flights of different particles in the air together, the earlier one first."""
    index = np.arange(flown.start.size)
    beyond = np.searchsorted(flown.start, flown.end, side="left")
    count = np.maximum(beyond - index - 1, 0)
    i = np.repeat(index, count)
    j = i + 1 + (np.arange(i.size) - np.repeat(np.cumsum(count) - count, count))
    other = flown.particle[i] != flown.particle[j]
    return i[other], j[other]


def energy_balance(
    record: xr.Dataset, *, since: float = 0.0, impacts: int | None = None
) -> xr.Dataset:
    """Mean kick and mean loss of every particle under a sine, which Eq. 26 compares.

    Each landing with speed v and kick U = A sin(2 pi f t + phi) is followed by v' = e v + U where
    the particle bounces.  Over n landings, those from `since` on or the last `impacts` of each
    particle, the mean kick therefore exceeds the mean loss (1 - e) v by (v_last - v_first) / n plus
    the speed lost in flights, which over a moving base end at another height than they began.  A
    rest breaks the balance, since v' is then not e v + U.

    Dims (realization, particle): ``mean_loss``, the ``balance`` of mean kick less mean loss,
    ``end_effect`` = (v_last - v_first) / n (m s-1), ``balanced_impacts`` and ``rests``.
    """
    e, amplitude, frequency, phase, gravity = (
        record[name].values.reshape(-1, 1, 1)
        for name in ("restitution", "amplitude", "frequency", "phase", "gravity")
    )
    time, after = record["landing_time"].values, record["rebound_velocity"].values
    before = _begun(record, "launch_velocity", "rebound_velocity")[..., :-1]
    if record.attrs["base"] != HIGH_BOUNCE:
        left = _begun(record, "launch_time", "liftoff_time")[..., :-1]
        before = gravity * (time - left) - before
    known = np.isfinite(before) & np.isfinite(after) & (time >= since)
    if impacts is not None:
        known &= np.cumsum(known[..., ::-1], axis=-1)[..., ::-1] <= impacts
    kick = amplitude * np.sin(2.0 * np.pi * frequency * time + phase)
    loss = (1.0 - e) * before
    lost = np.zeros_like(before)  # in the flight to a landing
    lost[..., 1:] = np.where(known[..., :-1], after[..., :-1] - before[..., 1:], 0.0)
    count = known.sum(axis=-1).astype(np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        balance, mean_loss, end_effect = (
            np.sum(np.where(known, values, 0.0), axis=-1) / count
            for values in (kick - loss, loss, after - before - lost)
        )
    rests = ((record["rested"].values == 1) & known).sum(axis=-1)
    of_particles = {
        "balance": balance,
        "mean_loss": mean_loss,
        "end_effect": end_effect,
        "balanced_impacts": count.astype(np.int64),
        "rests": rests,
    }
    dims = ("realization", "particle")
    return xr.Dataset({name: (dims, values) for name, values in of_particles.items()})
