"""Rigorous error bounds, carried along with each trajectory.

The error of the state (x, u) is enclosed in a box in a frame that turns with the orbit (Lohner's
method).  The Jacobian of each impact is applied to the frame, and the longer image becomes the
first axis of the next frame.  The sides of the box change by the remaining triangular factor, and
grow by the rounding of the step and a bound of the nonlinear remainder.  An error therefore grows
as the orbit stretches it, not as a sum of absolute values would.

The bound is relative to the exact orbit of the model for the exact values of the given doubles.  It
becomes infinite when a decision (rest or not, landing before the end or not, this period or the
next) is within the error, since the exact orbit may then continue differently.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import Floats, jit, uncounted
from vibrosweep.kernels.arithmetic import LAUNCH_ERROR, ROUNDING
from vibrosweep.kernels.bases import Constants, Flight, Instant, Jacobian, StateError
from vibrosweep.kernels.impact import Batch, carry, land, launch, launch_speed
from vibrosweep.kernels.memory import empty

# The bound is itself computed in rounded arithmetic.
INFLATION = 1.0 + 2.0**-40
LOST = 0.125  # turns; errors beyond this are not bounded


class Trust(NamedTuple):
    """Error bounds of trajectories, each array of shape (trajectory,)."""

    # Time in forcing periods up to which all landings are known to the tolerance; infinite if all
    # landings are, NaN if none is
    until: Floats
    # Largest error of any landing, and with noise also of any lift-off from rest, in forcing
    # periods; infinite where a decision is uncertain, NaN where the impact budget ended before all
    # landings were simulated
    landing_error: Floats
    # Largest error of the absolute speed after any landing, as the duration in forcing periods of a
    # flight from a base at rest; infinite or NaN where that of the landings is
    flight_error: Floats


def empty_trust(trajectories: int) -> Trust:
    """Allocate the bounds of a batch."""
    return empty(Trust, trajectories)


class Enclosure(NamedTuple):
    """A box that holds the error of a state, phase and speed, its sides along a frame."""

    # c, s: the first axis of the orthonormal frame
    c: float
    s: float
    # along, across: largest error along this axis and across it
    along: float
    across: float


@jit
def landing_error(box: Enclosure, derivative: Jacobian) -> float:
    """Largest change of the phase of the landing by changes of the state before it within a box."""
    c, s, by_phase, by_speed = box.c, box.s, derivative.phase_phase, derivative.phase_speed
    along, across = by_phase * c + by_speed * s, by_speed * c - by_phase * s
    return abs(along) * box.along + abs(across) * box.across


@jit
def extent(box: Enclosure) -> StateError:
    """Largest changes of phase and speed in a box, by rounded arithmetic."""
    c, s = abs(box.c), abs(box.s)
    return StateError(c * box.along + s * box.across, s * box.along + c * box.across)


@jit
def spread_of(box: Enclosure) -> StateError:
    """Bounds on the errors of phase and speed in a box."""
    phase, speed = extent(box)
    return StateError(phase * INFLATION, speed * INFLATION)


@jit
def upright(error: StateError) -> Enclosure:
    """Return the box of errors of phase and speed."""
    return Enclosure(1.0, 0.0, error.phase, error.speed)


@jit
def turn_box(box: Enclosure, derivative: Jacobian) -> Enclosure:
    """Carry a box through a Jacobian."""
    c, s, first, second = box
    ax, ay = carry(c, s, derivative)
    bx, by = carry(-s, c, derivative)
    if (bx * bx + by * by) * (second * second) > (ax * ax + ay * ay) * (first * first):
        ax, ay, bx, by = bx, by, ax, ay
        first, second = second, first
    # the differences above may cancel, so their rounding is bounded relative to their terms
    slack = ROUNDING * derivative.size * (first + second)
    length = math.sqrt(ax * ax + ay * ay)
    if length == 0.0:
        return Enclosure(c, s, slack, slack)
    c, s = ax / length, ay / length
    along, across = c * bx + s * by, c * by - s * bx
    return Enclosure(
        c,
        s,
        (length * first + abs(along) * second + slack) * INFLATION,
        (abs(across) * second + slack) * INFLATION,
    )


class Bounded(NamedTuple):
    """An impact with the bounds on its errors."""

    # x, passed: phase of the landing, and whole periods passed
    x: float
    passed: float
    w: float  # speed after it, if the particle leaves at once
    # error, spread: of the phase of the landing, and of both (x, w)
    error: float
    spread: StateError
    box: Enclosure  # of the error of (x, w)
    fixed: Constants  # with the random numbers of the impact


@jit
def _impact(
    fixed: Constants,
    at: Instant,
    u: float,
    box: Enclosure,
    cycles: float,
    particle: float = 0.0,
    number: float = 0.0,
) -> Bounded:
    """An impact of a particle that leaves with speed u, and whose error is in a box.

    Over all cycles the error is `cycles` times as large.  Random numbers of the impact depend on
    the particle, the number of its impacts until then, and the periods from time 0 to the instant.
    """
    n, x = at
    time, v = bases.fly(fixed, x, u)
    x_land, passed = land(x, time)
    flight = Flight(x, u, time, x_land, v)
    fixed = bases.random(fixed, particle, number, n + passed, x_land)
    derivative = bases.jacobian(fixed, flight)
    off, faster = spread_of(box)
    spread = StateError(cycles * off, cycles * faster)
    added = bases.landing_added(fixed, flight, spread)
    rounding = added.phase
    error = (landing_error(box, derivative) + rounding) * INFLATION
    kicked = bases.rebound_error(fixed, flight, added, error, spread)
    c, s, along, across = turn_box(box, derivative)
    box = Enclosure(
        c,
        s,
        along + (abs(c) * rounding + abs(s) * kicked) * INFLATION,
        across + (abs(s) * rounding + abs(c) * kicked) * INFLATION,
    )
    w = bases.rebound(fixed, x_land, v)
    return Bounded(x_land, passed, w, error, spread_of(box), box, fixed)


@jit
def is_certain(fixed: Constants, x: float, u: float, impacts: int, modulus: float) -> bool:
    """Return whether no rounding can change a decision along a cycle.

    (x, u) is a state of the cycle; if it has rests, the lift-off from one.  `modulus` is that of
    the leading multiplier, by which the error of one cycle is passed on to the next; it is 0 for a
    cycle with rests, after which the error starts again.
    """
    if not modulus < 1.0:
        return False
    begin = bases.liftoff_error(fixed) if modulus == 0.0 else StateError(0.0, 0.0)
    box, x_error = upright(begin), begin.phase
    all_cycles = 1.0 / (1.0 - modulus)
    for _ in range(impacts):
        hit = _impact(fixed, Instant(0.0, x), u, box, all_cycles)
        if not all_cycles * hit.error < LOST:
            return False
        off, faster = hit.spread
        spread = StateError(all_cycles * off, all_cycles * faster)
        if bases.rest_is_doubtful(fixed, hit.x, hit.w, spread):
            return False
        _, x, u, leaves = bases.lift_off(fixed, 0.0, hit.x, hit.w)
        box = hit.box
        if not leaves:
            if not abs(hit.x - x) > hit.error + x_error:
                return False
            box = upright(bases.liftoff_error(fixed))
    return True


@jit
def _simulate(
    batch: Batch, i: int, p: int, tolerance: float, budget: int
) -> tuple[float, float, float]:
    """Bounds of one trajectory, as the fields of `Trust`."""
    problem = batch.problem
    fixed = bases.constants(batch.base, problem, i)
    x_end = problem.end_phase[i]
    n_end, (n, x) = problem.end_count[i], launch(batch.launches, i, p, problem.phase[i])
    n -= n_end
    u = launch_speed(fixed, problem, i, x)
    box = upright(StateError(LAUNCH_ERROR, bases.launch_error(fixed, x, u)))
    until, worst, flight_error = np.nan, 0.0, 0.0
    known = True
    for number in range(budget):
        hit = _impact(fixed, Instant(n + n_end, x), u, box, 1.0, p, number)
        n += hit.passed
        remaining = (x_end - hit.x) - n
        if remaining < -hit.error - LAUNCH_ERROR:
            return (np.inf if known else until), worst, flight_error
        if remaining <= hit.error + LAUNCH_ERROR or not hit.error < LOST:
            break
        worst = max(worst, hit.error)
        known = known and hit.error <= tolerance
        if known:
            until = (n + n_end) + (hit.x - problem.phase[i])
        if bases.rest_is_doubtful(fixed, hit.x, hit.w, hit.spread):
            break
        n_hit = n
        n, x, u, leaves = bases.lift_off(hit.fixed, n, hit.x, hit.w)
        if leaves:
            flight_error = max(flight_error, bases.absolute_error(fixed, x, u, hit.spread))
            box = hit.box
            continue
        lifted = bases.liftoff_error_after(fixed, n_hit + n_end, hit.x, hit.error, Instant(n, x))
        box = upright(lifted)
        if lifted.phase == np.inf:
            break
        if fixed.base.noise is not None:  # a random lift-off is not known without error
            worst = max(worst, lifted.phase)
        n, x = bases.later_lift_off(fixed, n, x, n_end)
        if n == np.inf:
            return (np.inf if known else until), worst, flight_error
        flight_error = max(flight_error, bases.absolute_error(fixed, x, u, lifted))
    else:
        return until, np.nan, np.nan
    return until, np.inf, np.inf


@uncounted
def trust(first: int, last: int, batch: Batch, tolerance: Floats, budget: int, out: Trust) -> None:
    """Bound the errors of trajectories first ... last - 1, whose slots alone are written.

    `tolerance` is the largest error of a landing time that is trusted, in forcing periods, of shape
    (realization,).
    """
    particles = batch.launches.whole.shape[1]
    for t in range(first, last):
        i = t // particles
        found = _simulate(batch, i, t % particles, tolerance[i], budget)
        out.until[t], out.landing_error[t], out.flight_error[t] = found
