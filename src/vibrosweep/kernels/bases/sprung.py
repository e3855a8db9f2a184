"""A base of finite mass on a linear mount: its motion between impacts, and what an impact does.

Time is in forcing periods, speed in g / (2 f), so that gravity is 2.  Without particles the base
moves as the one of infinite mass does, at the height alpha W(x).  With n particles that ride it, mu
being the mass of one in units of that of the base, its height Y obeys

    (1 + n mu) Y'' + 2 zeta w Y' + w^2 Y = forcing - 2 n mu,        w = 2 pi f0 / f.

Y is the sum of a forced motion (`drives`), the sag under the load, and a free oscillation D, which
impacts excite.  Every impact pushes the base down.

An overdamped mount does not swing: D decays with a slow and a fast rate.  Once the fast part has
decayed, D' = -slow D, and the acceleration would be a small difference of large terms: at a damping
ratio of 1000 six digits would be lost.  The state is therefore D and B = D' + slow D, which decays
with the fast rate alone.  For a mount that swings, slow is 0 and B is the velocity D'.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels import elementary
from vibrosweep.kernels._jit import fma, jit, part
from vibrosweep.kernels.bases import parabolic_drive  # noqa: F401 -- implementations
from vibrosweep.kernels.bases.drives import Drive, Motion, Phase, Reach, forced, onto, reach_of
from vibrosweep.kernels.bases.landing_search import turn
from vibrosweep.kernels.noise import SILENT, Noise, Source, source_of
from vibrosweep.kernels.restitution import Restitution, ratio, scale_of
from vibrosweep.kernels.waveforms import Shape, Sine, steepness
from vibrosweep.model.parameters import Dimensionless, Mounts
from vibrosweep.model.shapes import TWO_PI

LARGEST_GAMMA = 1e9  # as over the base of infinite mass
SERIES = 1.0  # largest s (2 drag + natural) for which the series of overdamped motion is summed
TERMS = 40
TAYLOR = tuple(1.0 / math.factorial(k) for k in range(16))  # of the exponential up to 1/2


class Mount(NamedTuple):
    """Numbers that decide the motion of one realization."""

    # e, alpha, r: restitution, factor of the velocity of the base without particles, and threshold
    # of rest
    e: float
    alpha: float
    r: float
    # Law of restitution, and its scale of speeds
    law: Restitution
    scale: float
    # mu, w, zeta: mass of a particle in units of that of the base, natural frequency in radians per
    # forcing period, and damping ratio of the mount
    mu: float
    w: float
    zeta: float
    # noise, source: kinds of noise of impacts, and its strengths in this realization
    noise: Noise | None = None
    source: Source = SILENT
    waveform: Shape = Sine()  # of its motion without particles


class Load(NamedTuple):
    """The base under the load of the particles that ride it."""

    riders: int  # how many
    # stiffness, drag: of the free oscillation D'' + 2 drag D' + stiffness D = 0
    stiffness: float
    drag: float
    drive: Drive  # the forced motion
    level: float  # height about which it oscillates
    # Time after a push down during which the base is nowhere higher than without it: half a free
    # oscillation
    keeps: float
    swing: float  # radians of the free oscillation per period; 0 where it is overdamped
    # slow, fast: rates of decay of an overdamped one, else 0
    slow: float
    fast: float
    reach: Reach  # bounds of the forced motion
    # natural, grip: a free motion with the energy of the velocity v reaches the height v / natural
    # and the acceleration grip v
    natural: float
    grip: float


class Free(NamedTuple):
    """The free oscillation some time after an instant."""

    # rise, gain: D(s) - D - D' s and D'(s) - D'
    rise: float
    gain: float
    # d, b: its state
    d: float
    b: float


class Bounds(NamedTuple):
    """Bounds that hold until the next impact."""

    height: float  # upper bound of the height of the base
    # pull, jerk, snap: of the absolute values of Y'', Y''' and Y''''
    pull: float
    jerk: float
    snap: float


@jit
def mount(problem: Dimensionless, mounts: Mounts, i: int) -> Mount:
    """Return the numbers that decide the motion of realization i."""
    e, law, shape = problem.restitution[i], mounts.restitution, mounts.waveform
    alpha = problem.kick[i] / (1.0 + e)
    if 0.5 * alpha * steepness(shape) > LARGEST_GAMMA:
        alpha = np.nan
    return Mount(
        e,
        alpha,
        problem.rest_flight[i],
        law,
        scale_of(law, e, problem.restitution_speed[i]),
        mounts.mass_ratio[i],
        TWO_PI * mounts.natural[i],
        mounts.damping[i],
        mounts.noise,
        source_of(problem.noise, problem.end_count, i),
        shape,
    )


@part
def loaded(fixed: Mount, riders: int, side: float) -> Load:
    """Return the base under the load of so many particles, on a side of its drive."""
    mass = 1.0 + riders * fixed.mu
    stiffness, drag = fixed.w * fixed.w / mass, fixed.zeta * fixed.w / mass
    drive = forced(fixed.waveform, fixed.alpha, fixed.w, fixed.zeta, mass, side)
    swing = math.sqrt(max(stiffness - drag * drag, 0.0))
    keeps = math.pi / swing if swing > 0.0 else np.inf
    fast = slow = 0.0
    if swing == 0.0:
        fast = drag + math.sqrt(max(fma(drag, drag, -stiffness), 0.0))
        slow = stiffness / fast
    level = -2.0 * (mass - 1.0) / (fixed.w * fixed.w) if mass > 1.0 else 0.0
    reach, natural = reach_of(drive), math.sqrt(stiffness)
    grip = math.sqrt(4.0 * drag * drag + stiffness)
    return Load(
        riders, stiffness, drag, drive, level, keeps, swing, slow, fast, reach, natural, grip
    )


@jit
def velocity(load: Load, d: float, b: float) -> float:
    """Return the velocity of the free oscillation."""
    return b - load.slow * d


@jit
def free_pull(load: Load, d: float, b: float) -> tuple[float, float]:
    """Return the acceleration of the free oscillation and its rate."""
    slow, fast = load.slow, load.fast
    if slow > 0.0:
        rate = (slow * slow + load.stiffness + fast * fast) * b - slow * slow * slow * d
        return slow * slow * d - 2.0 * load.drag * b, rate
    pull = -2.0 * load.drag * b - load.stiffness * d
    return pull, -2.0 * load.drag * pull - load.stiffness * b


@jit
def bounds(load: Load, d: float, b: float) -> Bounds:
    """Bound the motion from the state d, b on.

    The energy of the free motion never grows, nor do the two exponentials of overdamped motion.
    Where their rates are far apart, the exponentials bound it more closely.
    """
    base, reach = load.level + load.reach.height, load.reach
    slow, fast = load.slow, load.fast
    if fast > 14.0 * slow:
        brief = abs(b) / (fast - slow)
        steep, flat = brief * fast * fast, (abs(d) + brief) * slow * slow
        return Bounds(
            base + abs(d) + 2.0 * brief,
            reach.pull + (steep + flat),
            reach.jerk + (steep * fast + flat * slow),
            reach.snap + (steep * fast * fast + flat * slow * slow),
        )
    v = velocity(load, d, b)
    speed = math.sqrt(v * v + load.stiffness * d * d)
    twice = 2.0 * load.drag
    jerk = twice * load.grip + load.stiffness
    snap = twice * jerk + load.stiffness * load.grip
    return Bounds(
        base + (speed / load.natural if speed > 0.0 else 0.0),
        reach.pull + load.grip * speed,
        reach.jerk + jerk * speed,
        reach.snap + snap * speed,
    )


@jit
def _bend(z: float) -> float:
    """Return exp(-z) - 1 + z for z >= 0 to a few roundings."""
    if z > 0.5:
        return elementary.exp(-z) - 1.0 + z
    z2 = z * z
    even, odd = fma(z2, TAYLOR[14], TAYLOR[12]), fma(z2, TAYLOR[15], TAYLOR[13])
    even, odd = fma(z2, even, TAYLOR[10]), fma(z2, odd, TAYLOR[11])
    even, odd = fma(z2, even, TAYLOR[8]), fma(z2, odd, TAYLOR[9])
    even, odd = fma(z2, even, TAYLOR[6]), fma(z2, odd, TAYLOR[7])
    even, odd = fma(z2, even, TAYLOR[4]), fma(z2, odd, TAYLOR[5])
    even, odd = fma(z2, even, TAYLOR[2]), fma(z2, odd, TAYLOR[3])
    return z2 * fma(-z, odd, even)


@jit
def _decayed(z: float) -> tuple[float, float, float]:
    """Return exp(-z), 1 - exp(-z) and 1 - (1 + z) exp(-z) for z >= 0, each to a few roundings."""
    if z > 0.5:
        left = elementary.exp(-z)
        return left, 1.0 - left, 1.0 - left - z * left
    bent = _bend(z)
    lost = z - bent
    return 1.0 - lost, lost, fma(-bent, 1.0 + z, z * z)


@jit
def _series(load: Load, b: float, s: float) -> tuple[float, float]:
    """Sum the power series of the free motion from the state 0, b, from the second degree on."""
    slowed, turned = 2.0 * load.drag * s, load.stiffness * s * s
    before, term = 0.0, b * s
    rise = gain = 0.0
    for k in range(2, TERMS):
        before, term = term, -(slowed * term + turned * before / (k - 1)) / k
        rise += term
        gain += k * term
        if abs(before) + abs(term) <= 2.0**-60 * abs(rise):
            break
    return rise, gain / s


@part
def _overdamped(load: Load, d: float, b: float, s: float) -> Free:
    """Return the same as `free_motion`, for a mount that does not swing."""
    slow, fast, width = load.slow, load.fast, load.fast - load.slow
    left, ended = elementary.exp(-slow * s), elementary.exp(-fast * s)
    rise, gain = d * _bend(slow * s), -slow * d * elementary.expm1(-slow * s)
    if s * (2.0 * load.drag + load.natural) <= SERIES:
        risen, gained = _series(load, b, s)
        return Free(rise + risen, gain + gained, d * left + (b * s + risen), b * ended)
    odd = left * (-elementary.expm1(-width * s) / width if width > 0.0 else s)
    rise += b * (odd - s)
    gain += b * (elementary.expm1(-fast * s) - slow * odd)
    return Free(rise, gain, d * left + b * odd, b * ended)


@jit
def free_motion(load: Load, d: float, b: float, s: float) -> Free:
    """Return the free oscillation after s periods from the state d, b.

    Neither its rise nor its gain is a difference of nearly equal numbers while the oscillation has
    hardly begun: with A = exp(-drag s), sin and cos of the angle q s of the swing, L = s - sin / q,
    and the stiffness K, they are

        -d (1 - (1 + drag s) A + A (1 - cos + drag L)) - b ((1 - A) s + A L)
        -b (1 - A + A (1 - cos + drag sin / q)) - d K A sin / q,

    and where it is overdamped, with S = exp(-slow s), F = exp(-fast s), O = (S - F) / (fast - slow)

        d (S - 1 + slow s) + b (O - s)
        slow d (1 - S) - b (1 - F + slow O).
    """
    if s == 0.0 or (d == 0.0 and b == 0.0):
        return Free(0.0, 0.0, d, b)
    if load.swing == 0.0:
        return _overdamped(load, d, b, s)
    turns = load.swing / TWO_PI * s
    sine, lag, c = turn(turns)
    sine, lag = sine / load.swing, lag / load.swing
    left, lost, bent = _decayed(load.drag * s)
    rise = -d * fma(left, fma(load.drag, lag, c), bent) - b * fma(left, lag, lost * s)
    gain = -b * fma(left, fma(load.drag, sine, c), lost) - d * (load.stiffness * left * sine)
    return Free(rise, gain, d + b * s + rise, b + gain)


@jit
def move(load: Load, at: Phase, d: float, b: float, s: float) -> Motion:
    """Return the motion of the base s periods after a phase."""
    rise, gain, d, b = free_motion(load, d, b, s)
    pull, jerk = free_pull(load, d, b)
    return onto(load.drive, at, s, Motion(rise, gain, d, b, pull, jerk))


@jit
def _pushed(fixed: Mount, riders: int) -> float:
    """Speed that the base with its riders loses for each unit of change of the relative speed."""
    mass = fixed.mu / (1.0 + riders * fixed.mu)
    return mass / (1.0 + mass)


@jit
def recoil(fixed: Mount, riders: int, c: float, sticks: bool) -> float:
    """Speed that an impact with the approach speed c takes from the base.

    Momentum is conserved, and `riders` particles are one body with the base; a particle that sticks
    then has the velocity of the base, one that bounces leaves it with the relative speed E(c).
    """
    share = ratio(fixed.law, fixed.e, fixed.scale, c)
    return _pushed(fixed, riders) * (c if sticks else (1.0 + share) * c)


@jit
def recoil_from(noise: Noise | None, fixed: Mount, riders: int, c: float, w: float) -> float:
    """Speed that a bounce with the relative speeds c before and w after it takes from the base.

    Without noise w is E(c).
    """
    if noise is None:
        return recoil(fixed, riders, c, False)
    return _pushed(fixed, riders) * (c + w)


@jit
def recoil_share(fixed: Mount, riders: int, share: float, sticks: bool) -> float:
    """Speed that the base loses per unit of approach speed, of which a bounce keeps `share`."""
    return _pushed(fixed, riders) * (1.0 if sticks else 1.0 + share)
