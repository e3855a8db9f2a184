"""The motion of a base of finite mass, recorded beside every landing."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, part, uncounted
from vibrosweep.kernels.bases.drives import phase_of, place, side_of
from vibrosweep.kernels.bases.sprung import Load, loaded, mount, move, velocity
from vibrosweep.kernels.coupled.state import NOW, System
from vibrosweep.kernels.record import Record, Scale, Units, seconds
from vibrosweep.kernels.unwritten import unwritten
from vibrosweep.model.parameters import Dimensionless, Mounts


class Track(NamedTuple):
    """Motion of the base after every event, each array of shape (realization, event)."""

    time: Floats  # s; NaN past the last event
    # deviation, beyond: deviation from the forced oscillation under the present load, in
    # g / (2 f^2), and its velocity beyond that of slow decay, in g / (2 f)
    deviation: Floats
    beyond: Floats
    riders: Integers  # how many particles ride
    side: Floats  # of the drive


class MotionRecord(NamedTuple):
    """Record of every landing and of the motion of the base, as far as its arrays reach."""

    record: Record
    track: Track
    units: Units


def empty_track(realizations: int, events: int) -> Track:
    """Allocate the motion up to so many events of each realization."""
    time, deviation, beyond, side = (np.full((realizations, events), np.nan) for _ in range(4))
    return Track(time, deviation, beyond, unwritten((realizations, events), np.int64), side)


@part
def write_base(state: System, load: Load, scale: Scale, i: int, event: int, out: Track) -> None:
    """Write the motion of the base after an event of realization i."""
    if event < out.time.shape[1]:
        out.time[i, event] = seconds(scale, state.now[NOW.N], state.now[NOW.X])
        out.deviation[i, event], out.beyond[i, event] = state.now[NOW.D], state.now[NOW.B]
        out.riders[i, event], out.side[i, event] = load.riders, side_of(load.drive)


@uncounted
def trace(
    problem: Dimensionless,
    mounts: Mounts,
    scale: Scale,
    i: int,
    track: Track,
    times: Floats,
    out: Floats,
) -> None:
    """Write the height and velocity of the base of realization i at increasing times.

    Times in s, none before the first event; `out` is of shape (2, time), in g / (2 f^2) and
    g / (2 f).
    """
    fixed, event = mount(problem, mounts, i), 0
    for k in range(times.size):
        while event + 1 < track.time.shape[1] and track.time[i, event + 1] <= times[k]:
            event += 1
        load = loaded(fixed, track.riders[i, event], track.side[i, event])
        turns = scale.frequency * track.time[i, event] + scale.phase
        at = phase_of(turns - np.rint(turns))
        d, b = track.deviation[i, event], track.beyond[i, event]
        passed = scale.frequency * (times[k] - track.time[i, event])
        motion, forced = move(load, at, d, b, passed), place(load.drive, at)
        speed = forced.speed + velocity(load, d, b)
        out[0, k] = (forced.height + load.level + d) + speed * passed + motion.rise
        out[1, k] = speed + motion.gain
