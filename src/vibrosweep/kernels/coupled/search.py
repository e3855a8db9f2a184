"""Search for the next landing on a base of finite mass.

Every impact moves the base and so changes all later landings.  For each particle a lower bound of
the time of its landing is kept, and only the particle with the earliest bound is examined.  Three
facts give these bounds:

- The step (F' + sqrt(F'^2 + 2 K F)) / K from a clearance F passes no root, because F'' >= -K with a
  bound K from the energy of the free oscillation, which does not grow between impacts.
- An impact pushes the base down.  For half a free oscillation the base is nowhere higher than it
  would have been, so that a bound found before the impact remains valid.
- The base stays below a height that follows from its energy.  The time at which a particle falls to
  that height remains a bound, whatever other particles do, until the energy exceeds the one
  assumed.

If F' < 0 and 4 K F <= F'^2, the next root is unique within the step, and Newton's iteration with
the next two derivatives finds it, or with only the next one while a recoil that decays at once
makes the cubic useless.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import fma, jit, part
from vibrosweep.kernels.bases.drives import Motion, until_corner
from vibrosweep.kernels.bases.sprung import Bounds, Load, bounds
from vibrosweep.kernels.coupled.state import NOW, PARTICLE, System, motion_after

NEAR = 2.0**-50  # relative error that ends Newton's iteration
ROUNDING = 2.0**-40  # relative margin of speeds and clearances within which rounding may decide

STEPS = 50  # of the search for a lift-off before particles are examined again


@jit
def _to_root(f: float, f1: float, f2: float) -> float:
    """Return the step to the root of the parabola with these derivatives, f1 < 0."""
    inside = f1 * f1 - 2.0 * f * f2
    return 2.0 * f / (math.sqrt(inside if inside > 0.0 else 0.0) - f1)


@jit
def _ahead(f: float, f1: float, k: float) -> float:
    """Return a step that passes no root of a function with this value and slope, and f'' >= -k."""
    if f1 >= 0.0:
        return (f1 + math.sqrt(f1 * f1 + 2.0 * k * f)) / k if k > 0.0 else np.inf
    return _to_root(f, f1, -k)


@jit
def _step(f: float, f1: float, f2: float, f3: float, k: float) -> float:
    """Return the step to the root of the cubic with these derivatives, f1 < 0, to third order.

    It is the step to the root of the parabola if f3 would change f2 by more than its bound k.
    """
    step = _to_root(f, f1, f2)
    slope = f1 + f2 * step
    return (
        step - f3 * step * step * step / (6.0 * slope)
        if slope < 0.0 and abs(f3 * step) <= k
        else step
    )


@jit
def _clearance(state: System, j: int, motion: Motion, t: float) -> tuple[float, float]:
    """Return the height of particle j above the base and its rate after time t."""
    h, w = state.particle[PARTICLE.HEIGHT, j], state.particle[PARTICLE.SPEED, j]
    return fma(t, w - t, h) - motion.rise, w - 2.0 * t - motion.gain


@jit
def crossings(left: float, u: float) -> tuple[float, float]:
    """Return when a particle of speed u rises to the height `left` above it, and falls back to it.

    Infinity and 0 if it does not reach that height.
    """
    spare = 0.25 * u * u - left
    if not spare > 0.0:
        return np.inf, 0.0
    return 0.5 * u - math.sqrt(spare), 0.5 * u + math.sqrt(spare)


class First(NamedTuple):
    """The particle that may be the next to land or to be launched, and the one after it."""

    # who, time: the particle, -1 if there is none, and its time
    who: int
    time: float
    # other, then: the same for the one after it
    other: int
    then: float


@part
def earliest(state: System) -> First:
    """Return the earliest particles; of equal times, the particle of the lower number is first."""
    who, time, other, then = -1, np.inf, -1, np.inf
    for j in range(state.mode.size):
        safe = state.particle[PARTICLE.SAFE, j]
        if safe < then:
            if safe < time:
                who, time, other, then = j, safe, who, time
            else:
                other, then = j, safe
    return First(who, time, other, then)


@jit
def is_first(state: System, first: First) -> bool:
    """Return whether the earliest particle still is the earliest, after its time has moved."""
    time = state.particle[PARTICLE.SAFE, first.who]
    return time < first.then or (time == first.then and first.who < first.other)


@part
def look(state: System, load: Load, limit: Bounds, j: int) -> bool:
    """Advance the time before which particle j does not land; return whether it lands then."""
    t = state.particle[PARTICLE.SAFE, j]
    motion = motion_after(state, load, t)
    f, f1 = _clearance(state, j, motion, t)
    scale, k = state.particle[PARTICLE.SCALE, j], 2.0 + limit.pull  # F'' = -2 - Y'' >= -k
    if f <= 0.0:
        if f1 <= 0.0:
            return True
        f = 0.0
    if f1 < 0.0 and 4.0 * k * f <= f1 * f1:
        state.particle[PARTICLE.SAFE, j] = _landing(state, load, limit, j, motion)
        return True
    if t > 0.0 and f1 >= 0.0 and f <= ROUNDING * scale * scale:
        state.now[NOW.UNDECIDED] += 1.0
    ahead = t + _ahead(f, f1, k)
    if state.now[NOW.HEIGHT] + state.now[NOW.SPEED] * t + motion.rise + f > state.now[NOW.HIGHEST]:
        ahead = max(ahead, state.particle[PARTICLE.ABOVE, j])
    state.particle[PARTICLE.SAFE, j] = ahead
    return not ahead > t


@part
def _landing(state: System, load: Load, limit: Bounds, j: int, motion: Motion) -> float:
    """Return when particle j lands, if its clearance has a single root within the next step.

    `motion` is that of the base up to the time before which the particle does not land.
    """
    t, last, k = state.particle[PARTICLE.SAFE, j], np.inf, 2.0 + limit.pull
    for _ in range(20):
        f, f1 = _clearance(state, j, motion, t)
        step = _step(f, f1, -2.0 - motion.pull, -motion.jerk, k)
        t = max(t + step, 0.0)
        # ends where the error of the cubic is negligible, or rounding keeps steps from shrinking
        square = step * step
        if limit.snap * square * square <= -f1 * NEAR * t or abs(step) >= 0.5 * last:
            break
        last = abs(step)
        motion = motion_after(state, load, t)
    return float(t)


@part
def lift(state: System, load: Load, until: float) -> bool:
    """Advance the time before which the riders do not leave; return whether they leave then.

    At most `STEPS` steps are taken; if the time is still not after `until`, nothing is known yet.
    """
    now = state.now
    jumps = until_corner(load.drive, 0.0) < np.inf
    for _ in range(STEPS):
        t = now[NOW.LIFT]
        if t > until:
            break
        motion = motion_after(state, load, t)
        limit = bounds(load, motion.d, motion.b)
        if limit.pull <= 2.0:
            now[NOW.LIFT] = np.inf
            return False
        g = motion.pull + 2.0
        if g <= 0.0 and (motion.jerk <= 0.0 or jumps):
            return True
        ahead = t + _ahead(max(g, 0.0), motion.jerk, limit.snap)
        if not ahead > t:
            return True
        now[NOW.LIFT] = ahead
    return False
