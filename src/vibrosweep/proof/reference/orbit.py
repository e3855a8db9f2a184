"""A trajectory at one precision; an uncertain decision, or a ball too wide, requires more.

The semantics of the branches are stated in `vibrosweep.proof.reference.ball`.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import zip_longest

from vibrosweep.model.status import Status
from vibrosweep.proof.reference._flint import ctx
from vibrosweep.proof.reference.decisions import WidthLimits, certain_above, nearest_integer
from vibrosweep.proof.reference.motion import Landed, Left, Motion, Problem
from vibrosweep.proof.reference.results import Flight, Impact, Trajectory


def _orbit(motion: Motion, problem: Problem) -> tuple[list[Landed], list[Left], Status]:
    """Landings at the current precision, each with the launch or lift-off of the flight before it.

    The last one is beyond the end or the budget, unless the particle comes to rest for good.
    """
    landings, lifted = [], [motion.launched]
    limits = WidthLimits(problem.digits, problem.parameters)
    for n in range(1, problem.max_impacts + 2):
        landed = motion.land(n)
        landings.append(landed)
        if certain_above(landed.flown, motion.end, "the landing is after the end", n):
            return landings, lifted, Status.COMPLETED
        if n > problem.max_impacts:
            break
        left = motion.leave(n)
        # the phase, which is reduced later, must be narrow in turns, however late the landing is
        phase = landed.half_turns - landed.half_turns.mid()
        found = [(phase, limits.phase), (landed.duration, limits.phase)]
        found.append((motion.time(landed.flown), limits.time))
        if left is not None:
            found += [(motion.time(left.flown), limits.time), (left.velocity, limits.velocity)]
        limits.require(n, *found)
        if left is None:
            return landings, lifted, Status.COMPLETED
        lifted.append(left)
    return landings, lifted, Status.BUDGET_EXCEEDED


def _impact(motion: Motion, landed: Landed, left: Left | None, flight: Flight | None) -> Impact:
    """Physical and dimensionless values of a landing."""
    turns = landed.half_turns / 2
    count = nearest_integer(turns)
    phase, time = turns - count, motion.time(landed.flown)
    if left is None:
        return Impact(time, None, None, True, count, phase, None, landed.arrival)
    liftoff = motion.time(left.flown) if left.rested else time
    return Impact(time, liftoff, left.velocity, left.rested, count, phase, flight, landed.arrival)


def attempt(problem: Problem, motion_of: Callable[[Problem], Motion], bits: int) -> Trajectory:
    """Return the trajectory at one precision, or raise `UncertainError`."""
    with ctx.workprec(bits):
        motion = motion_of(problem)
        landings, lifted, status = _orbit(motion, problem)
        launch, *flights = [
            Flight(left.speed, left.height, landed.duration, landed.slopes)
            for left, landed in zip(lifted, landings, strict=True)
        ]
        at_rest = status is Status.COMPLETED and not landings[-1].flown > motion.end
        counted = landings if at_rest else landings[:-1]
        after = zip_longest(counted, lifted[1:], flights)
        return Trajectory(
            launch=launch,
            impacts=tuple(_impact(motion, *found) for found in after),
            at_rest=at_rest,
            status=status,
            precision_bits=bits,
        )
