"""A base of finite mass on a linear mount: its motion between impacts, and what an impact does.

Time is in forcing periods, speed in g / (2 f), so that gravity is 2.  Without particles the base
moves as the one of infinite mass does, at the height alpha W(x).  With n particles that ride it, mu
being the mass of one in units of that of the base, its height Y obeys

    (1 + n mu) Y'' + 2 zeta w Y' + w^2 Y = forcing - 2 n mu,        w = 2 pi f0 / f.

Y is the sum of a forced motion (`drive_of`), the sag under the load, and a free oscillation D,
which impacts excite.  Every impact pushes the base down.

An overdamped mount does not oscillate: D decays with a slow and a fast rate.  Once the fast part
has decayed, D' = -slow D, and the acceleration would be a small difference of large terms: at a
damping ratio of 1000 six digits would be lost.  The state is therefore D and B = D' + slow D, which
decays with the fast rate alone.  For a mount that oscillates, slow is 0 and B is the velocity D'.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from vibrosweep.kernels import arithmetic
from vibrosweep.kernels._jit import fma, generic, implements, jit, part
from vibrosweep.kernels.arithmetic import cos_turns, sin_turns
from vibrosweep.kernels.bases.harmonics import next_harmonic, next_turns
from vibrosweep.kernels.bases.moving import turn
from vibrosweep.kernels.bases.parabolic import CORNER, TOP, stretch_at
from vibrosweep.kernels.noise import SILENT, Noise, Source, source_of
from vibrosweep.kernels.restitution import Restitution, ratio, scale_of
from vibrosweep.kernels.waveforms import Harmonics, Parabolic, Shape, Sine, for_each, steepness
from vibrosweep.model.parameters import Dimensionless, Mounts
from vibrosweep.model.shapes import TWO_PI

# --- Forced motion, by the type of the waveform ---------------------------------------------------
# Yf = alpha W(x) is the forced motion of the base without riders.  With riders, `mass` is the total
# mass in units of that of the base, and the forced motion Y solves
#
#     mass Y'' + 2 zeta w Y' + w^2 Y = Yf'' + 2 zeta w Yf' + w^2 Yf.
#
# Each harmonic of Yf is multiplied by (b + i c) / (b - (mass - 1) v^2 + i c) with v = 2 pi h, c = 2
# zeta w v, b = w^2 - v^2.  A drive whose velocity has corners has a closed form from one corner to
# the next.


Drive = Any  # one of the following named tuples


class Oscillation(NamedTuple):
    """The forced oscillation p cos(2 pi x) + q sin(2 pi x)."""

    p: float
    q: float


class Oscillations(NamedTuple):
    """The sum of p_h cos(2 pi h x) + q_h sin(2 pi h x)."""

    p: tuple[float, ...]
    q: tuple[float, ...]


class Phase(NamedTuple):
    """A phase in turns, its sine and its cosine."""

    x: float
    sine: float
    cosine: float


class ForcedMotion(NamedTuple):
    """Forced motion at a phase: height, velocity, acceleration and its rate."""

    height: float
    speed: float
    pull: float
    jerk: float


class Motion(NamedTuple):
    """Motion of the base some time after an instant."""

    # rise, gain: height and velocity beyond those of uniform motion, Y(s) - Y - Y' s and Y'(s) - Y'
    rise: float
    gain: float
    # d, b: deviation from the forced oscillation, and its velocity beyond that of slow decay
    d: float
    b: float
    # pull, jerk: acceleration Y''(s) and its rate
    pull: float
    jerk: float


class Bounds(NamedTuple):
    """Bounds of a motion of the base, that of the drive alone or that until the next impact."""

    height: float  # upper bound
    # pull, jerk, snap: of the absolute values of Y'', Y''' and Y''''
    pull: float
    jerk: float
    snap: float


@generic
def side_at(shape: Shape, x: float) -> float:
    """Side of a phase: the sign of the acceleration there; 1 for a shape without corners."""


@generic
def side_of(drive: Drive) -> float:
    """Side of a drive; 1 for a drive without corners."""


@generic
def until_corner(drive: Drive, x: float) -> float:
    """Periods from a phase until the present stretch ends; infinite if there are no corners."""


@generic
def drive_of(shape: Shape, alpha: float, w: float, zeta: float, mass: float, side: float) -> Drive:
    """Forced motion, on a side, of a base that without riders has the velocity alpha w(x)."""


@generic
def forced_motion(drive: Drive, at: Phase) -> ForcedMotion:
    """Return the forced motion at a phase."""


@generic
def forced_bounds(drive: Drive) -> Bounds:
    """Bound the forced motion."""


@generic
def add_forced(drive: Drive, at: Phase, s: float, free: Motion) -> Motion:
    """Add the forced motion s periods after a phase to the free one."""


@generic
def forcing(drive: Drive, at: Phase, stiffness: float, drag: float) -> float:
    """Y'' + 2 drag Y' + stiffness Y of the forced motion Y."""


@jit
def phase_of(x: float) -> Phase:
    """Return a phase in [-1/2, 1/2] with its sine and cosine."""
    return Phase(x, sin_turns(x), cos_turns(x))


@implements(side_at, Sine, Harmonics)
def side_at_smooth(shape: Shape, x: float) -> float:
    return 1.0


@implements(side_of, Oscillation, Oscillations)
def side_of_smooth(drive: Drive) -> float:
    return 1.0


@implements(until_corner, Oscillation, Oscillations)
def until_corner_smooth(drive: Drive, x: float) -> float:
    return np.inf


@jit
def _response(p: float, q: float, v: float, w: float, zeta: float, mass: float) -> Oscillation:
    """Response of the loaded base where the bare one moves as p cos(v x) + q sin(v x)."""
    if not mass > 1.0:
        return Oscillation(p, q)
    damping = 2.0 * zeta * w * v
    bare = w * w - v * v
    full = bare - (mass - 1.0) * v * v
    norm = full * full + damping * damping
    along, across = bare * full + damping * damping, full - bare
    return Oscillation(
        (p * along + q * damping * across) / norm, (q * along - p * damping * across) / norm
    )


@implements(drive_of, Sine)
def drive_of_sine(
    shape: Shape, alpha: float, w: float, zeta: float, mass: float, side: float
) -> Oscillation:
    return _response(-alpha / TWO_PI, 0.0, TWO_PI, w, zeta, mass)


@implements(forced_motion, Oscillation)
def forced_motion_oscillation(drive: Oscillation, at: Phase) -> ForcedMotion:
    height = drive.p * at.cosine + drive.q * at.sine
    slope = drive.q * at.cosine - drive.p * at.sine
    return ForcedMotion(height, TWO_PI * slope, -(TWO_PI**2) * height, -(TWO_PI**3) * slope)


@implements(forcing, Oscillation)
def forcing_oscillation(drive: Oscillation, at: Phase, stiffness: float, drag: float) -> float:
    """Return the forcing of the base without riders, for which q is 0."""
    driven = (stiffness - TWO_PI**2) * at.cosine
    driven -= 2.0 * drag * TWO_PI * at.sine
    return drive.p * driven


@implements(forced_bounds, Oscillation)
def forced_bounds_oscillation(drive: Oscillation) -> Bounds:
    height = math.sqrt(fma(drive.p, drive.p, drive.q * drive.q))
    pull = TWO_PI**2 * height
    return Bounds(height, pull, TWO_PI * pull, TWO_PI**2 * pull)


@implements(add_forced, Oscillation)
def add_forced_oscillation(drive: Oscillation, at: Phase, s: float, free: Motion) -> Motion:
    turned, lag, c = turn(s)
    height = drive.p * at.cosine + drive.q * at.sine
    slope = drive.q * at.cosine - drive.p * at.sine
    h = height * (1.0 - c) + slope * turned
    h1 = slope * (1.0 - c) - height * turned
    return Motion(
        free.rise - height * c - slope * lag,
        free.gain - TWO_PI * (height * turned + slope * c),
        free.d,
        free.b,
        free.pull - TWO_PI**2 * h,
        free.jerk - TWO_PI**3 * h1,
    )


@jit
def _harmonic(
    shape: Harmonics, alpha: float, w: float, zeta: float, mass: float, k: int
) -> Oscillation:
    """Harmonic k + 1 of the forced motion of the loaded base."""
    v = TWO_PI * (k + 1)
    return _response(-alpha * shape.p[k] / v, alpha * shape.q[k] / v, v, w, zeta, mass)


_GIVEN = "alpha, w, zeta, mass"
_cosines = for_each("p", f"harmonic(shape, {_GIVEN}, {{k}}).p", _GIVEN, harmonic=_harmonic)
_sines = for_each("p", f"harmonic(shape, {_GIVEN}, {{k}}).q", _GIVEN, harmonic=_harmonic)


@implements(drive_of, Harmonics)
def drive_of_harmonics(
    shape: Harmonics, alpha: float, w: float, zeta: float, mass: float, side: float
) -> Oscillations:
    return Oscillations(_cosines(shape, alpha, w, zeta, mass), _sines(shape, alpha, w, zeta, mass))


@implements(forced_motion, Oscillations)
def forced_motion_oscillations(drive: Oscillations, at: Phase) -> ForcedMotion:
    height, speed, pull, jerk = 0.0, 0.0, 0.0, 0.0
    sine, cosine = at.sine, at.cosine
    for k in range(len(drive.p)):
        v, p, q = TWO_PI * (k + 1), drive.p[k], drive.q[k]
        even, odd = fma(p, cosine, q * sine), fma(q, cosine, -p * sine)
        height += even
        speed = fma(v, odd, speed)
        pull = fma(-v * v, even, pull)
        jerk = fma(-v * v * v, odd, jerk)
        sine, cosine = next_harmonic(sine, cosine, (at.sine, at.cosine))
    return ForcedMotion(height, speed, pull, jerk)


@implements(forcing, Oscillations)
def forcing_oscillations(drive: Drive, at: Phase, stiffness: float, drag: float) -> float:
    forced = forced_motion(drive, at)
    return forced.pull + 2.0 * drag * forced.speed + stiffness * forced.height


@implements(forced_bounds, Oscillations)
def forced_bounds_oscillations(drive: Oscillations) -> Bounds:
    height, pull, jerk, snap = 0.0, 0.0, 0.0, 0.0
    for k in range(len(drive.p)):
        v, p, q = TWO_PI * (k + 1), drive.p[k], drive.q[k]
        size = math.sqrt(fma(p, p, q * q))
        height += size
        pull = fma(v * v, size, pull)
        jerk = fma(v * v * v, size, jerk)
        snap = fma(v * v * v * v, size, snap)
    return Bounds(height, pull, jerk, snap)


@implements(add_forced, Oscillations)
def add_forced_oscillations(drive: Oscillations, at: Phase, s: float, free: Motion) -> Motion:
    turned, lag, c = turn(s - np.rint(s))
    whole, turns = np.rint(s), (turned, lag, c, lag, c)
    rise, gain, d, b, pull, jerk = free
    sine, cosine = at.sine, at.cosine
    for k in range(len(drive.p)):
        v, p, q = TWO_PI * (k + 1), drive.p[k], drive.q[k]
        even, odd = fma(p, cosine, q * sine), fma(q, cosine, -p * sine)
        s_h, d_h, c_h, _, _ = turns
        ahead = 1.0 - c_h
        rise = rise - even * c_h - odd * fma(v, whole, d_h)
        gain -= v * fma(even, s_h, odd * c_h)
        pull -= v * v * fma(even, ahead, odd * s_h)
        jerk -= v * v * v * fma(odd, ahead, -even * s_h)
        sine, cosine = next_harmonic(sine, cosine, (at.sine, at.cosine))
        turns = next_turns(turns, turned, c)
    return Motion(rise, gain, d, b, pull, jerk)


# --- Forced parabolic motion ----------------------------------------------------------------------
# The acceleration Yf'' of the bare base is 4 alpha or -4 alpha; under a load the base oscillates
# about a level that is (mass - 1) Yf'' / w^2 lower.


class Parabola(NamedTuple):
    """One stretch of the parabolic motion, from one corner of the velocity to the next."""

    alpha: float
    side: float  # 1 where the base is accelerated upwards, around phase 0; -1 in the other half
    sag: float  # under the load, due to the acceleration of the drive


@implements(side_at, Parabolic)
def side_at_parabolic(shape: Shape, x: float) -> float:
    return stretch_at(x)[0]


@implements(side_of, Parabola)
def side_of_parabola(drive: Parabola) -> float:
    return drive.side


@jit
def _from_middle(drive: Parabola, x: float) -> float:
    """Phase relative to the middle of the present stretch."""
    return x if drive.side > 0.0 else x - math.copysign(0.5, x)


@implements(until_corner, Parabola)
def until_corner_parabola(drive: Parabola, x: float) -> float:
    left = CORNER - _from_middle(drive, x)
    return left if left > 0.0 else 0.0


@implements(drive_of, Parabolic)
def drive_of_parabolic(
    shape: Shape, alpha: float, w: float, zeta: float, mass: float, side: float
) -> Parabola:
    return Parabola(alpha, side, 4.0 * alpha * side * (mass - 1.0) / (w * w))


@implements(forced_motion, Parabola)
def forced_motion_parabola(drive: Parabola, at: Phase) -> ForcedMotion:
    y, pull = _from_middle(drive, at.x), 4.0 * drive.alpha * drive.side
    height = drive.alpha * drive.side * fma(2.0 * y, y, -TOP)
    return ForcedMotion(height - drive.sag, pull * y, pull, 0.0)


@implements(forced_bounds, Parabola)
def forced_bounds_parabola(drive: Parabola) -> Bounds:
    return Bounds(drive.alpha * TOP + abs(drive.sag), 4.0 * drive.alpha, 0.0, 0.0)


@implements(add_forced, Parabola)
def add_forced_parabola(drive: Parabola, at: Phase, s: float, free: Motion) -> Motion:
    pull = 4.0 * drive.alpha * drive.side
    rise, gain = fma(0.5 * pull * s, s, free.rise), fma(pull, s, free.gain)
    return Motion(rise, gain, free.d, free.b, free.pull + pull, free.jerk)


implements(forcing, Parabola)(forcing_oscillations)


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
    frequency: float  # angular, of the free oscillation, per period; 0 where it is overdamped
    # slow, fast: rates of decay of an overdamped one, else 0
    slow: float
    fast: float
    reach: Bounds  # bounds of the forced motion
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
    drive = drive_of(fixed.waveform, fixed.alpha, fixed.w, fixed.zeta, mass, side)
    frequency = math.sqrt(max(stiffness - drag * drag, 0.0))
    keeps = math.pi / frequency if frequency > 0.0 else np.inf
    fast = slow = 0.0
    if frequency == 0.0:
        fast = drag + math.sqrt(max(fma(drag, drag, -stiffness), 0.0))
        slow = stiffness / fast
    level = -2.0 * (mass - 1.0) / (fixed.w * fixed.w) if mass > 1.0 else 0.0
    reach, natural = forced_bounds(drive), math.sqrt(stiffness)
    grip = math.sqrt(4.0 * drag * drag + stiffness)
    return Load(
        riders, stiffness, drag, drive, level, keeps, frequency, slow, fast, reach, natural, grip
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
        return arithmetic.exp(-z) - 1.0 + z
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
        left = arithmetic.exp(-z)
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
    """Return the same as `free_motion`, for an overdamped mount."""
    slow, fast, width = load.slow, load.fast, load.fast - load.slow
    left, ended = arithmetic.exp(-slow * s), arithmetic.exp(-fast * s)
    rise, gain = d * _bend(slow * s), -slow * d * arithmetic.expm1(-slow * s)
    if s * (2.0 * load.drag + load.natural) <= SERIES:
        risen, gained = _series(load, b, s)
        return Free(rise + risen, gain + gained, d * left + (b * s + risen), b * ended)
    odd = left * (-arithmetic.expm1(-width * s) / width if width > 0.0 else s)
    rise += b * (odd - s)
    gain += b * (arithmetic.expm1(-fast * s) - slow * odd)
    return Free(rise, gain, d * left + b * odd, b * ended)


@jit
def free_motion(load: Load, d: float, b: float, s: float) -> Free:
    """Return the free oscillation after s periods from the state d, b.

    Neither its rise nor its gain is a difference of nearly equal numbers while the oscillation has
    hardly begun: with A = exp(-drag s), sin and cos of the angle q s, q being its angular
    frequency, L = s - sin / q, and the stiffness K, they are

        -d (1 - (1 + drag s) A + A (1 - cos + drag L)) - b ((1 - A) s + A L)
        -b (1 - A + A (1 - cos + drag sin / q)) - d K A sin / q,

    and where it is overdamped, with S = exp(-slow s), F = exp(-fast s), O = (S - F) / (fast - slow)

        d (S - 1 + slow s) + b (O - s)
        slow d (1 - S) - b (1 - F + slow O).
    """
    if s == 0.0 or (d == 0.0 and b == 0.0):
        return Free(0.0, 0.0, d, b)
    if load.frequency == 0.0:
        return _overdamped(load, d, b, s)
    turns = load.frequency / TWO_PI * s
    sine, lag, c = turn(turns)
    sine, lag = sine / load.frequency, lag / load.frequency
    left, lost, bent = _decayed(load.drag * s)
    rise = -d * fma(left, fma(load.drag, lag, c), bent) - b * fma(left, lag, lost * s)
    gain = -b * fma(left, fma(load.drag, sine, c), lost) - d * (load.stiffness * left * sine)
    return Free(rise, gain, d + b * s + rise, b + gain)


@jit
def move(load: Load, at: Phase, d: float, b: float, s: float) -> Motion:
    """Return the motion of the base s periods after a phase."""
    rise, gain, d, b = free_motion(load, d, b, s)
    pull, jerk = free_pull(load, d, b)
    return add_forced(load.drive, at, s, Motion(rise, gain, d, b, pull, jerk))


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
    """Speed that the base loses per unit of approach speed, of which a bounce retains `share`."""
    return _pushed(fixed, riders) * (1.0 if sticks else 1.0 + share)
