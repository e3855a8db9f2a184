"""What the joint state of all particles and their base settles on, and how it spreads.

The state recurs where all of it returns bit for bit, apart from whole periods; compared at landings
with a kept state that is renewed after 1, 2, 4, ... landings (Brent 1980).
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, Integers, jit, kernel
from vibrosweep.kernels.bases.sprung import Mount, bounds, loaded, mount
from vibrosweep.kernels.coupled.deviations import follow_event, propagate
from vibrosweep.kernels.coupled.follow import Coupled
from vibrosweep.kernels.coupled.state import (
    EVENT,
    MODE,
    NOW,
    PARTICLE,
    System,
    begin,
    motion_after,
    riders,
)
from vibrosweep.kernels.sine import cos_turns, sin_turns

__all__ = ["BLOCKS", "JointOrbit", "carry", "empty_joint", "settle_jointly"]

BLOCKS: Final = 16  # of equal time, from whose means the error of the exponent follows


class JointOrbit(NamedTuple):
    """What joint states settle on; each array of shape (realization,) but for `growth`.

    Attributes
    ----------
    impacts, periods, rests
        Of the cycle: landings of all particles, forcing periods, landings that stick; 0 where no
        recurrence was found.
    since
        Forcing periods after which the state was on the cycle at the latest.
    landings
        In the window.
    growth
        Logarithm of the growth of a deviation in each block of the window; shape (realization,
        block).
    at_rest
        1 where all particles rest for good.
    """

    impacts: Integers
    periods: Integers
    rests: Integers
    since: Floats
    landings: Integers
    growth: Floats
    at_rest: Integers


def empty_joint(realizations: int) -> JointOrbit:
    """Allocate the orbits of a batch, none known."""
    impacts, periods, rests, landings, at_rest = (np.zeros(realizations, np.int64) for _ in "12345")
    growth = np.full((realizations, BLOCKS), np.nan)
    return JointOrbit(
        impacts, periods, rests, np.full(realizations, np.nan), landings, growth, at_rest
    )


@jit
def _same(a: System, b: System) -> bool:
    """Whether two states differ by whole periods only."""
    if a.now[NOW.X] != b.now[NOW.X] or a.now[NOW.D] != b.now[NOW.D] or a.now[NOW.V] != b.now[NOW.V]:
        return False
    for j in range(a.mode.size):
        if a.mode[j] != b.mode[j] or a.mode[j] == MODE.WAITING:
            return False
        for row in (PARTICLE.HEIGHT, PARTICLE.SPEED):
            if a.mode[j] == MODE.FLYING and a.particle[row, j] != b.particle[row, j]:
                return False
    return True


@jit
def _keep(of: System, kept: System) -> None:
    """Copy a state."""
    kept.particle[:, :] = of.particle
    kept.now[:] = of.now
    kept.mode[:] = of.mode


@jit
def _shrink(deviations: Floats) -> float:
    """Bring a deviation to length 1; return the logarithm of what it was."""
    length = math.sqrt(np.sum(deviations * deviations))
    if not 0.0 < length < np.inf:
        return -np.inf if length == 0.0 else np.nan
    deviations /= length
    return math.log(length)


@kernel
def _one(
    fixed: Mount, batch: Coupled, i: int, budget: int, work: tuple[System, System], out: JointOrbit
) -> None:
    """Follow realization i to the end of its window."""
    of, kept = work
    problem = batch.problem
    begin(of, problem, batch.launches, i)
    start = (problem.begin_count[i] - problem.end_count[i]) + problem.begin_phase[i]
    length = problem.end_phase[i] - start
    deviations = np.full((2 * of.mode.size + 2, 1), 1.0)
    growth, landed, rests, mark, seen_at, rested = 0.0, 0, 0, 1, 0, 0
    _keep(of, kept)
    while landed < budget:
        until = (problem.end_phase[i] - of.now[NOW.X]) - of.now[NOW.N]
        event = follow_event(of, fixed, problem.launch_flight[i], until, deviations)
        if event.kind == EVENT.FINISHED:
            out.at_rest[i] = 1
        if event.kind <= EVENT.LOST:
            break
        growth = _shrink(deviations)
        place = math.floor(BLOCKS * (of.now[NOW.N] + of.now[NOW.X] - start) / length)
        if 0 <= place < BLOCKS:
            before = out.growth[i, place]
            out.growth[i, place] = growth if np.isnan(before) else before + growth
        if not np.isfinite(growth):
            break
        if event.kind != EVENT.BOUNCE and event.kind != EVENT.STICK:
            continue
        landed += 1
        rests += 1 if event.kind == EVENT.STICK else 0
        out.landings[i] += 1 if place >= 0 else 0
        if out.impacts[i] == 0 and _same(of, kept):
            out.impacts[i], out.rests[i] = landed - seen_at, rests - rested
            out.periods[i] = int(of.now[NOW.N] - kept.now[NOW.N])
            out.since[i] = (
                kept.now[NOW.N] + problem.end_count[i] + (kept.now[NOW.X] - problem.phase[i])
            )
        if landed == mark:
            _keep(of, kept)
            mark, seen_at, rested = 2 * mark, landed, rests


@kernel
def settle_jointly(
    first: int,
    last: int,
    batch: Coupled,
    budget: int,
    work: tuple[System, System],
    out: JointOrbit,
) -> None:
    """Find what realizations first ... last - 1 settle on until the end of their windows.

    Parameters
    ----------
    first, last
        Range of realizations.
    batch : vibrosweep.kernels.coupled.follow.Coupled
    budget
        Largest number of landings of all particles of a realization.
    work
        Two states, not shared between threads.
    out : JointOrbit
        Only the slots of these realizations are written.
    """
    for i in range(first, last):
        fixed = mount(batch.problem, batch.mounts, i)
        if np.isfinite(fixed.alpha):
            _one(fixed, batch, i, budget, work, out)


@kernel
def carry(of: System, fixed: Mount, periods: float, deviations: Floats) -> int:
    """Carry a state, and deviations from it, on for some time.

    Parameters
    ----------
    of : vibrosweep.kernels.coupled.state.System
        Modes, heights and speeds of the particles above the base, phase, and deviation of the base
        from its forced oscillation are given; what is known of times to come is not.
    fixed : vibrosweep.kernels.bases.sprung.Mount
    periods
        The time, in forcing periods.
    deviations
        Shape (2 * particle + 2, column): heights and velocities of the particles, height and
        velocity of the base.

    Returns
    -------
    int
        The number of landings, -1 where the search for one was given up.
    """
    load = loaded(fixed, riders(of))
    of.now[NOW.N] = 0.0
    of.now[NOW.HIGHEST] = bounds(load, of.now[NOW.D], of.now[NOW.V]).height
    of.now[NOW.LIFT] = 0.0 if load.riders > 0 else np.inf
    of.particle[PARTICLE.SAFE, :] = 0.0
    of.particle[PARTICLE.ABOVE, :] = 0.0
    begun, landings = of.now[NOW.X], 0
    while True:
        left = periods - of.now[NOW.N] - (of.now[NOW.X] - begun)
        event = follow_event(of, fixed, 0.0, left, deviations)
        if event.kind == EVENT.LOST:
            return -1
        if event.kind <= EVENT.LOST:
            break
        landings += 1 if event.kind != EVENT.LIFT else 0
    load = loaded(fixed, riders(of))
    mode, x = of.mode.copy(), of.now[NOW.X]
    motion = motion_after(of, load, (sin_turns(x), cos_turns(x)), left)
    propagate(load, left, mode, deviations)
    for j in range(mode.size):
        if mode[j] == MODE.FLYING:
            w = of.particle[PARTICLE.SPEED, j]
            of.particle[PARTICLE.HEIGHT, j] += left * (w - left) - motion.rise
            of.particle[PARTICLE.SPEED, j] = w - 2.0 * left - motion.gain
    of.now[NOW.X] += left - np.rint(left)
    of.now[NOW.D], of.now[NOW.V] = motion.d, motion.v
    return landings
