"""Forced motion of a base on a mount, by the type of its waveform.

Yf = alpha W(x) is the forced motion of the base without riders.  With riders, `mass` is the total
mass in units of that of the base, and the forced motion Y solves

    mass Y'' + 2 zeta w Y' + w^2 Y = Yf'' + 2 zeta w Yf' + w^2 Yf.

Each harmonic of Yf is multiplied by (b + i c) / (b - (mass - 1) v^2 + i c) with v = 2 pi h,
c = 2 zeta w v, b = w^2 - v^2.  A drive whose velocity has corners (`parabolic_drive`) has a closed
form from one corner to the next.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from vibrosweep.kernels._jit import fma, generic, implements, jit
from vibrosweep.kernels.bases.landing_search import turn
from vibrosweep.kernels.bases.shaped_search import next_harmonic, next_turns
from vibrosweep.kernels.harmonics import Harmonics, for_each
from vibrosweep.kernels.sine import cos_turns, sin_turns
from vibrosweep.kernels.waveforms import Shape, Sine
from vibrosweep.model.shapes import TWO_PI

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


class Place(NamedTuple):
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


class Reach(NamedTuple):
    """Bounds of the forced motion: of its height and of the moduli of its derivatives."""

    # height; pull, jerk, snap: of Y'', Y''' and Y''''
    height: float
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
def forced(shape: Shape, alpha: float, w: float, zeta: float, mass: float, side: float) -> Drive:
    """Forced motion, on a side, of a base that without riders has the velocity alpha w(x)."""


@generic
def place(drive: Drive, at: Phase) -> Place:
    """Return the forced motion at a phase."""


@generic
def reach_of(drive: Drive) -> Reach:
    """Bound the forced motion."""


@generic
def onto(drive: Drive, at: Phase, s: float, free: Motion) -> Motion:
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
def _answered(p: float, q: float, v: float, w: float, zeta: float, mass: float) -> Oscillation:
    """Response of the loaded base where the bare one moves as p cos(v x) + q sin(v x)."""
    if not mass > 1.0:
        return Oscillation(p, q)
    damping = 2.0 * zeta * w * v
    bare = w * w - v * v
    full = bare - (mass - 1.0) * v * v
    norm = full * full + damping * damping
    along, across = bare * full + damping * damping, damping * (full - bare)
    return Oscillation((p * along + q * across) / norm, (q * along - p * across) / norm)


@implements(forced, Sine)
def forced_sine(
    shape: Shape, alpha: float, w: float, zeta: float, mass: float, side: float
) -> Oscillation:
    p, q = -alpha / TWO_PI, 0.0
    if mass > 1.0:
        # the response to the forcing that moves the bare base with the amplitude p
        damping = 2.0 * zeta * w * TWO_PI
        bare = w * w - TWO_PI * TWO_PI
        full = bare - (mass - 1.0) * TWO_PI * TWO_PI
        norm = full * full + damping * damping
        q = -p * damping * (full - bare) / norm
        p = p * (bare * full + damping * damping) / norm
    return Oscillation(p, q)


@implements(place, Oscillation)
def place_oscillation(drive: Oscillation, at: Phase) -> Place:
    height = drive.p * at.cosine + drive.q * at.sine
    slope = drive.q * at.cosine - drive.p * at.sine
    return Place(height, TWO_PI * slope, -(TWO_PI**2) * height, -(TWO_PI**3) * slope)


@implements(forcing, Oscillation)
def forcing_oscillation(drive: Oscillation, at: Phase, stiffness: float, drag: float) -> float:
    """Return the forcing of the base without riders, for which q is 0."""
    driven = (stiffness - TWO_PI**2) * at.cosine
    driven -= 2.0 * drag * TWO_PI * at.sine
    return drive.p * driven


@implements(reach_of, Oscillation)
def reach_of_oscillation(drive: Oscillation) -> Reach:
    height = math.sqrt(fma(drive.p, drive.p, drive.q * drive.q))
    pull = TWO_PI**2 * height
    return Reach(height, pull, TWO_PI * pull, TWO_PI**2 * pull)


@implements(onto, Oscillation)
def onto_oscillation(drive: Oscillation, at: Phase, s: float, free: Motion) -> Motion:
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
    return _answered(-alpha * shape.p[k] / v, alpha * shape.q[k] / v, v, w, zeta, mass)


_GIVEN = "alpha, w, zeta, mass"
_cosines = for_each("p", f"harmonic(shape, {_GIVEN}, {{k}}).p", _GIVEN, harmonic=_harmonic)
_sines = for_each("p", f"harmonic(shape, {_GIVEN}, {{k}}).q", _GIVEN, harmonic=_harmonic)


@implements(forced, Harmonics)
def forced_harmonics(
    shape: Harmonics, alpha: float, w: float, zeta: float, mass: float, side: float
) -> Oscillations:
    return Oscillations(_cosines(shape, alpha, w, zeta, mass), _sines(shape, alpha, w, zeta, mass))


@implements(place, Oscillations)
def place_oscillations(drive: Oscillations, at: Phase) -> Place:
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
    return Place(height, speed, pull, jerk)


@implements(forcing, Oscillations)
def forcing_oscillations(drive: Drive, at: Phase, stiffness: float, drag: float) -> float:
    forced = place(drive, at)
    return forced.pull + 2.0 * drag * forced.speed + stiffness * forced.height


@implements(reach_of, Oscillations)
def reach_of_oscillations(drive: Oscillations) -> Reach:
    height, pull, jerk, snap = 0.0, 0.0, 0.0, 0.0
    for k in range(len(drive.p)):
        v, p, q = TWO_PI * (k + 1), drive.p[k], drive.q[k]
        size = math.sqrt(fma(p, p, q * q))
        height += size
        pull = fma(v * v, size, pull)
        jerk = fma(v * v * v, size, jerk)
        snap = fma(v * v * v * v, size, snap)
    return Reach(height, pull, jerk, snap)


@implements(onto, Oscillations)
def onto_oscillations(drive: Oscillations, at: Phase, s: float, free: Motion) -> Motion:
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
