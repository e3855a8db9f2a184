"""Trajectories with proved error bounds, in ball arithmetic (python-flint's `arb`).

Parameters are taken as the exact doubles that they are.  The precision is doubled until every
branch is certain and every result is as narrow as requested: the results are theorems about those
doubles, up to the correctness of FLINT.  The rules of the branches:

* A landing at t' counts if and only if t' <= duration.
* High-bounce base: a flight lasts 2 v / g.  With w = e v + A sin(2 pi f t' + phi), or its absolute
  value under the `reflect` law, the particle rests if and only if w <= v_rest = g tau_c / 2; else
  it leaves at once with v' = w.
* On this base a resting particle lifts off, with v' = v_rest, at the first t >= t' at which the
  kick A sin(2 pi f t + phi) rises through v_rest.  If A <= v_rest it never does.
* Moving base, of velocity A / (1 + e) sin(2 pi f t + phi): a flight ends at the first point where
  it meets the base, at once if it begins slower than the base, or as fast while the base presses
  the particle, 1 + Gamma cos(2 pi f t + phi) > 0.  After a landing with the relative speed z the
  particle leaves with e z; it rests if and only if e z <= v_rest and the base presses it.
* On this base a resting particle lifts off, with the velocity of the base, when the base begins to
  fall faster than gravity, cos(2 pi f t + phi) = -1 / Gamma and falling.  If Gamma <= 1 it never
  does.
* With noise, e v becomes (e + sigma_e xi) v, with the factor limited to [0, 1], plus
  (1 + e) sigma_V xi; over the moving base the modulus of this sum is taken.  In each forcing period
  A becomes A (1 + sigma_A xi).  A particle rests if and only if w <= v_rest; it leaves with v_rest,
  or over the moving base with the velocity of the base, as soon as the base alone lifts it.
* For another shape w of the motion, w replaces the sine, and its derivative the cosine; a particle
  is lifted at the next of possibly several phases.
* A particle that never lifts off again is at rest for good, and its trajectory ends.  A lift-off is
  reported with its landing even where it is later than the duration.

A comparison of equal numbers can be certain only if both are exact.  That is the case without
excitation (A = 0), for A against v_rest, and as long as every landing falls on a zero or a peak of
the sine.  Any other tie that involves a sine raises `UndecidableError`.

python-flint keeps its working precision in one place for the whole process, and it is set here: use
processes, not threads, to compute several trajectories at once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import partial
from itertools import zip_longest
from typing import Final, NamedTuple

from vibrosweep.model.measures import Status
from vibrosweep.model.parameters import NOISE
from vibrosweep.model.restitution_laws import CONSTANT
from vibrosweep.model.shapes import SINE, Waveform
from vibrosweep.proof.reference import high_bounce, moving
from vibrosweep.proof.reference.arithmetic import (
    WidthLimits,
    certain_above,
    ctx,
    decided,
    first_precision,
    nearest_integer,
)
from vibrosweep.proof.reference.laws import Laws, wave_of
from vibrosweep.proof.reference.motion import (
    Deviates,
    Left,
    ParticleMotion,
    PeriodMap,
    ProvedFlight,
    ProvedImpact,
    ProvedLanding,
    Trajectory,
    TrajectoryProblem,
)


class Reference(NamedTuple):
    """Reference of a base: its motion, its map and its errors in doubles."""

    motion: Callable[[TrajectoryProblem], ParticleMotion]  # of a particle, from a problem
    # Impacts in forcing periods, from physical parameters and the laws of an impact
    period_map: Callable[[Mapping[str, float], Laws], PeriodMap]
    # Velocity of a sine at least as fast, high and steep as the base's motion, m s-1, from physical
    # parameters
    velocity: Callable[[Mapping[str, float], Laws], float]
    # Largest error in turns of a lift-off after a rest in doubles, from physical parameters
    liftoff_error: Callable[[Mapping[str, float], Laws], float]


def _over_moving_base(problem: TrajectoryProblem) -> ParticleMotion:
    """Motion over the moving base; a base of amplitude 0 is fixed, so that ties are decided."""
    still = problem.parameters["amplitude"] == 0.0 and problem.deviates is None
    return high_bounce.BounceMotion(problem) if still else moving.MovingMotion(problem)


def _velocity(parameters: Mapping[str, float], laws: Laws) -> float:
    size = wave_of(laws.waveform).bounds.size
    return size * parameters["amplitude"] / (1.0 + parameters["restitution"])


REFERENCE_OF: Final[Mapping[str, Reference]] = {
    "high-bounce": Reference(
        motion=high_bounce.BounceMotion,
        period_map=high_bounce.BounceMap.from_parameters,
        velocity=lambda parameters, laws: 0.0,
        liftoff_error=high_bounce.liftoff_error,
    ),
    "moving": Reference(
        motion=_over_moving_base,
        period_map=moving.MovingMap.from_parameters,
        velocity=_velocity,
        liftoff_error=moving.liftoff_error,
    ),
}


def _orbit(
    motion: ParticleMotion, problem: TrajectoryProblem
) -> tuple[list[ProvedLanding], list[Left], Status]:
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


def _impact(
    motion: ParticleMotion, landed: ProvedLanding, left: Left | None, flight: ProvedFlight | None
) -> ProvedImpact:
    """Physical and dimensionless values of a landing."""
    turns = landed.half_turns / 2
    count = nearest_integer(turns)
    phase, time = turns - count, motion.time(landed.flown)
    if left is None:
        return ProvedImpact(time, None, None, True, count, phase, None, landed.arrival)
    liftoff = motion.time(left.flown) if left.rested else time
    return ProvedImpact(
        time, liftoff, left.velocity, left.rested, count, phase, flight, landed.arrival
    )


def attempt(
    problem: TrajectoryProblem, motion_of: Callable[[TrajectoryProblem], ParticleMotion], bits: int
) -> Trajectory:
    """Return the trajectory at one precision, or raise `UncertainError`."""
    with ctx.workprec(bits):
        motion = motion_of(problem)
        landings, lifted, status = _orbit(motion, problem)
        launch, *flights = [
            ProvedFlight(left.speed, left.height, landed.duration, landed.slopes)
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


def trajectory(
    *,
    launch_time: float | Fraction,
    duration: float | Fraction,
    base: str = "high-bounce",
    rebound: str = "rest",
    restitution_law: str = CONSTANT,
    waveform: Waveform = SINE,
    deviates: Deviates | None = None,
    max_impacts: int = 100_000,
    digits: int = 20,
    max_bits: int = 1 << 17,
    **parameters: float,
) -> Trajectory:
    """Every landing of one particle, with proved error bounds.

    The dimensionless trajectory (e, a, r, x0, u0) over some periods is the physical one with
    restitution e, amplitude a, frequency 1, phase 0, gravity 2, launch_velocity u0, contact_time r,
    launch_time x0 and duration in periods: velocities are then flight times.

    Parameters are all of `vibrosweep.model.parameters.PARAMETERS`, `restitution_speed` under a law
    that has one, and the strengths of noise, which also needs the deviates of the particle.  All
    are taken as exact; they come from a scene that was checked, and are not checked again.

    Landings at t <= duration (s) count; a `Fraction` gives a time exactly.  Radii are at most
    10**-digits times the larger of a velocity and v_rest, the larger of a time and the contact
    time, or one turn for a phase.

    Raises an UndecidableError where a decision stays uncertain at `max_bits`: a tie, or an orbit
    that loses more digits.
    """
    problem = TrajectoryProblem(
        dict.fromkeys(NOISE, 0.0) | {name: float(value) for name, value in parameters.items()},
        Fraction(launch_time),
        Fraction(duration),
        Laws(rebound, restitution_law, waveform),
        max_impacts,
        digits,
        deviates,
    )
    attempt_at = partial(attempt, problem, REFERENCE_OF[base].motion)
    return decided(attempt_at, first_precision(digits), max_bits)
