"""How far a trajectory can be trusted: a bound of its error, carried along with it.

The error of the state (x, u) is enclosed in a box in a frame that turns with the orbit (Lohner's
method): the Jacobian of each impact is applied to the frame, its larger image becomes the first
axis of the next frame, and the box grows by the triangular factor that remains, by the rounding of
the step and by a bound of what the linearisation leaves out.  An error therefore grows as the orbit
itself stretches it, not as a sum of absolute values would.

The bound is against the exact model at the exact doubles of the physical parameters.  It ends
where a decision (rest or not, landing before the end or not, this period or the next) lies within
the error: what follows is then unknown.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Floats, jit, kernel
from vibrosweep.kernels.impact import Scene, land, launch, lift_off, rebound, scene
from vibrosweep.kernels.sine import sin_turns
from vibrosweep.kernels.tangent import HALF_ULP, ROUNDING, carry, kick_slope
from vibrosweep.scene import Dimensionless, Launches

__all__ = ["Trust", "empty_trust", "is_certain", "trust", "turn_box"]

# Relative error of `sin_turns`, proved: benchmarks/sine_error.py finds 3.42 half ulps at most.
SINE_ERROR = 3.5 * HALF_ULP
# The cosine is the sine of 1/4 - |x|, itself rounded; absolute.
COSINE_ERROR = SINE_ERROR + 2.0 * math.pi * 2.0**-56
# x0 is a reduced sum of launch and phase, each rounded; a staggered launch is known to an ulp.
LAUNCH_ERROR = 4.0 * HALF_ULP
# A landing phase is a sum below 1 of two exact numbers; near 0 its rounding is smaller.
LANDING_ERROR = 0.5 * HALF_ULP
# a = 2 f A / g and u0 = 2 f v0 / g take two roundings, r = f tau_c one.
KICK_ERROR = 2.0 * HALF_ULP
REST_ERROR = HALF_ULP
# x_lift = asin(r / a) / 2 pi: four roundings of the ratio, then the function, of which libraries
# promise 4 ulp, then 2 pi and the quotient.
RATIO_ERROR = 4.0 * HALF_ULP
ARCSINE_ERROR = 10.0 * HALF_ULP
# The bound is itself computed in rounded arithmetic.
INFLATION = 1.0 + 2.0**-40
CURVATURE = 2.0 * math.pi * math.pi  # half the second derivative of sin(2 pi x)
SMALLEST = 2.0**-1020  # absolute, of a product or quotient that is subnormal
LOST = 0.125  # turns; beyond, a linearisation says nothing


class Trust(NamedTuple):
    """Error bounds of trajectories, each array of shape (trajectory,).

    Attributes
    ----------
    until
        Time in forcing periods of the last landing that is known to the tolerance, all before it
        included; infinite where all landings are, NaN where none is.
    landing_error
        Largest error of any landing in forcing periods; infinite where a decision is uncertain,
        NaN where the impact budget ended before all landings were followed.
    flight_error
        Largest error of any flight time after a landing, in forcing periods; infinite and NaN as
        that of the landings.
    """

    until: Floats
    landing_error: Floats
    flight_error: Floats


def empty_trust(trajectories: int) -> Trust:
    """Room for the bounds of a batch."""
    until, landing, flight = (np.empty(trajectories) for _ in range(3))
    return Trust(until, landing, flight)


@jit
def turn_box(
    frame: tuple[float, float], box: tuple[float, float], e: float, k: float, sign: float
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Carry frame and box through the Jacobian [[1, 1], [k, e + k]], second row times sign."""
    c, s = frame
    first, second = box
    ax, ay = carry(c, s, e, k, sign)
    bx, by = carry(-s, c, e, k, sign)
    if (bx * bx + by * by) * (second * second) > (ax * ax + ay * ay) * (first * first):
        ax, ay, bx, by = bx, by, ax, ay
        first, second = second, first
    # differences above and below may cancel: their rounding is relative to the terms
    slack = ROUNDING * (2.0 + e + 2.0 * abs(k)) * (first + second)
    length = math.sqrt(ax * ax + ay * ay)
    if length == 0.0:
        return frame, (slack, slack)
    c, s = ax / length, ay / length
    along, across = c * bx + s * by, c * by - s * bx
    box = (
        (length * first + abs(along) * second + slack) * INFLATION,
        (abs(across) * second + slack) * INFLATION,
    )
    return (c, s), box


@jit
def _lift_error(r: float, a: float, x_lift: float) -> float:
    """Error of the phase of lift-off."""
    ratio = r / a
    slope = math.sqrt(max(0.0, (1.0 - ratio) * (1.0 + ratio)))
    change = RATIO_ERROR * ratio
    if slope * slope <= 8.0 * change:  # the kick barely reaches the threshold
        return np.inf
    return 2.0 * change / (2.0 * math.pi * slope) + ARCSINE_ERROR * x_lift


@jit
def _land(
    x: float, u: float, frame: tuple[float, float], box: tuple[float, float]
) -> tuple[float, float, float, float]:
    """Phase of a landing and whole periods passed; its own rounding, and its error in all."""
    moved = x + (u - np.rint(u))
    rounding = min(LANDING_ERROR, HALF_ULP * abs(moved))
    x, passed = land(x, u)
    c, s = frame
    error = (abs(c + s) * box[0] + abs(c - s) * box[1] + rounding) * INFLATION
    return x, passed, rounding, error


@jit
def _rebound(
    fixed: Scene,
    x: float,
    u: float,
    landing: tuple[float, float],
    frame: tuple[float, float],
    box: tuple[float, float],
    reflect: int | None,
) -> tuple[float, float, tuple[float, float], tuple[float, float]]:
    """Next flight of a particle that leaves at once, its error, and the frame and box after it.

    `landing` holds the rounding and the error of the landing.
    """
    e, a = fixed[0], fixed[1]
    rounding, error = landing
    w = rebound(x, u, e, a, None)
    k = kick_slope(x, a)
    kicked = abs(k) * rounding + HALF_ULP * abs(w) + SMALLEST
    kicked += a * (SINE_ERROR + KICK_ERROR + HALF_ULP) * abs(sin_turns(x))
    kicked += a * (2.0 * math.pi * COSINE_ERROR + CURVATURE * error) * error
    sign = -1.0 if (reflect is not None and w < 0.0) else 1.0
    frame, box = turn_box(frame, box, e, k, sign)
    c, s = frame
    box = (
        box[0] + (abs(c) * rounding + abs(s) * kicked) * INFLATION,
        box[1] + (abs(s) * rounding + abs(c) * kicked) * INFLATION,
    )
    return sign * w, (abs(s) * box[0] + abs(c) * box[1]) * INFLATION, frame, box


@jit
def is_certain(
    fixed: Scene, x: float, u: float, impacts: int, modulus: float, reflect: int | None
) -> bool:
    """Whether no rounding can change a decision along a cycle.

    Parameters
    ----------
    fixed
        The scene of the realization.
    x, u
        A state of the cycle; of one with a rest, the lift-off from it.
    impacts
        In one cycle.
    modulus
        Of the leading multiplier, by which the error of one cycle is passed on to the next; 0 of
        a cycle with a rest, which begins anew.
    reflect
        None, or 1 for the `reflect` law.
    """
    a, r, x_lift = fixed[1], fixed[2], fixed[3]
    if not modulus < 1.0:
        return False
    frame, box, x_error = (1.0, 0.0), (0.0, 0.0), 0.0
    if modulus == 0.0:
        x_error = _lift_error(r, a, x_lift)
        box = (x_error, REST_ERROR * r)
    all_cycles = 1.0 / (1.0 - modulus)
    for _ in range(impacts):
        x, _, rounding, error = _land(x, u, frame, box)
        if not all_cycles * error < LOST:
            return False
        u, u_error, frame, box = _rebound(fixed, x, u, (rounding, error), frame, box, reflect)
        if abs(u - r) <= all_cycles * u_error + REST_ERROR * r:
            return False
        if u <= r:
            barely = abs(a - r) <= KICK_ERROR * a + REST_ERROR * r
            return not (barely or abs(x - x_lift) <= error + x_error)
    return True


@jit
def _follow(
    problem: Dimensionless,
    launches: Launches,
    i: int,
    p: int,
    tolerance: float,
    budget: int,
    reflect: int | None,
) -> tuple[float, float, float]:
    """Bounds of one trajectory, as the fields of `Trust`."""
    fixed = scene(problem, i)
    _, a, r, x_lift, wait, u_lift = fixed
    x_end = problem.end_phase[i]
    n, x = launch(problem, launches, i, p)
    n -= problem.end_count[i]
    u = problem.launch_flight[i]
    frame, box = (1.0, 0.0), (LAUNCH_ERROR, KICK_ERROR * u + SMALLEST)
    until, landing_error, flight_error = np.nan, 0.0, 0.0
    known = True
    for _ in range(budget):
        x, passed, rounding, error = _land(x, u, frame, box)
        n += passed
        remaining = (x_end - x) - n
        if remaining < -error - LAUNCH_ERROR:
            return (np.inf if known else until), landing_error, flight_error
        if remaining <= error + LAUNCH_ERROR or not error < LOST:
            break
        landing_error = max(landing_error, error)
        known = known and error <= tolerance
        if known:
            until = (n + problem.end_count[i]) + (x - problem.phase[i])
        w, w_error, frame, box = _rebound(fixed, x, u, (rounding, error), frame, box, reflect)
        if abs(w - r) <= w_error + REST_ERROR * r:
            break
        x_landed = x
        n, x, u, leaves = lift_off(n, x, w, r, x_lift, wait, u_lift)
        if leaves:
            flight_error = max(flight_error, w_error)
            continue
        if abs(a - r) <= KICK_ERROR * a + REST_ERROR * r:
            break
        if n == np.inf:
            return (np.inf if known else until), landing_error, flight_error
        x_error = _lift_error(r, a, x_lift)
        if abs(x_landed - x_lift) <= error + x_error:
            break
        flight_error = max(flight_error, REST_ERROR * r)
        frame, box = (1.0, 0.0), (x_error, REST_ERROR * r)
    else:
        return until, np.nan, np.nan
    return until, np.inf, np.inf


@kernel
def trust(
    first: int,
    last: int,
    problem: Dimensionless,
    launches: Launches,
    tolerance: Floats,
    budget: int,
    reflect: int | None,
    out: Trust,
) -> None:
    """Bound the errors of trajectories first ... last - 1.

    Parameters
    ----------
    first, last
        Range of trajectories; trajectory t is particle t % N of realization t // N.
    problem : vibrosweep.scene.Dimensionless
    launches : vibrosweep.scene.Launches
    tolerance
        Largest error of a landing time that is trusted, in forcing periods, shape (realization,).
    budget
        Impacts after which a trajectory is given up.
    reflect
        None, or 1 for the `reflect` law; chosen at compile time.
    out : Trust
        Only the slots first ... last - 1 are written.
    """
    particles = launches.whole.shape[1]
    for t in range(first, last):
        i = t // particles
        found = _follow(problem, launches, i, t % particles, tolerance[i], budget, reflect)
        out.until[t], out.landing_error[t], out.flight_error[t] = found
