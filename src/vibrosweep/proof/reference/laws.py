"""Shapes of the motion of the base, and laws of rebound and of restitution, in ball arithmetic.

The base has the velocity V0 w(x) and the height (V0 / f) W(x), W' = w, at the phase x in turns; w
has the period 1 and the mean zero.  Phases are given in half turns, because sin(pi h) needs no
product.  The weights and phases of harmonics are taken as exact doubles.

Over the high-bounce base the speed after an impact is w = kept + kick.  Where w is negative the
particle is pushed into the base: it rests, or the law of rebound turns it back with the speed -w.

A law of restitution has a restitution e and a speed v_r, whose unit is that of all speeds.  Where a
ball of speeds holds a kink, values and slopes of both sides are enclosed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final, NamedTuple, Protocol, TypeAlias

from vibrosweep.model.restitution_laws import CONSTANT, OUTSIDE, POINTS, POWER, name_of, numbers_of
from vibrosweep.model.restitution_laws import Law as OutsideLaw
from vibrosweep.model.shapes import HARMONICS_NAME, PARABOLIC_NAME, SINE, Waveform
from vibrosweep.proof.reference.arithmetic import (
    FRAME_BITS,
    Course,
    Jet,
    UncertainError,
    arb,
    certain_above,
    ctx,
    narrowed,
    nearest_integer,
)

ZERO, ONE = arb(0), arb(1)
QUARTER: Final = arb(0.25)
PIECES: Final = 64  # of a period, which are halved further where a zero may hide
OFF: Final = arb(0.49087)  # start of the first piece, where a zero of a waveform is unlikely
FALLS: Final = "the base ever falls faster than gravity"
AtLiftoff: TypeAlias = Sequence[tuple[arb, arb]]  # values of a shape at the phase of a lift-off


class ShapeBounds(NamedTuple):
    """Bounds of a shape."""

    # fast, steep, bend, jolt: of |w| and the moduli of its derivatives, in turns
    fast: arb
    steep: arb
    bend: arb
    jolt: arb
    top: arb  # of W
    # Largest of `fast`, 2 pi `top` and `steep` / 2 pi: a sine of this size is at least as fast,
    # high and steep
    size: float
    # Roundings of w and of w' in doubles, relative to `fast` and `steep`, beyond those of a sine
    blur: float


class Wave(Protocol):
    """A shape, at one precision."""

    @property
    def bounds(self) -> ShapeBounds:
        """Bounds of the shape."""

    def level(self, h: arb) -> arb:
        """W at a phase."""

    def velocity(self, h: arb) -> arb:
        """Velocity w at a phase."""

    def slope(self, h: arb) -> arb:
        """Derivative of w."""

    def rate(self, h: arb) -> arb:
        """Second derivative of w; for a shape with corners, its value between them."""

    def slope_change(self, h: arb, error: float) -> float:
        """Bound on the change of w' within an error of a phase, in turns."""
        return float(self.bounds.bend) * error

    def at_liftoff(self, h: arb) -> AtLiftoff:
        """Return the values at the phase x of a lift-off that `rise` and `gain` need."""

    def rise(self, at_liftoff: AtLiftoff, s: arb) -> arb:
        """W(x + s) - W(x) - s w(x), computed without cancellation."""

    def gain(self, at_liftoff: AtLiftoff, s: arb) -> arb:
        """w(x + s) - w(x)."""

    def rises(self, a: arb, r: arb, impact: int) -> list[arb]:
        """Phases in turns at which the kick a w(x), a of any sign, rises through r."""

    def falls(self, alpha: arb, impact: int) -> tuple[list[arb], list[arb]]:
        """Phases in turns at which 1 + G falls and rises through 0, G = alpha w' / 2."""


class _Sine(Wave):
    """w = sin(2 pi x)."""

    @property
    def bounds(self) -> ShapeBounds:
        turn = 2 * arb.pi()
        return ShapeBounds(ONE, turn, turn**2, turn**3, 1 / turn, 1.0, 0.0)

    def level(self, h: arb) -> arb:
        return -h.cos_pi() / (2 * arb.pi())

    def velocity(self, h: arb) -> arb:
        return h.sin_pi()

    def slope(self, h: arb) -> arb:
        return 2 * arb.pi() * h.cos_pi()

    def rate(self, h: arb) -> arb:
        return -4 * arb.pi() ** 2 * h.sin_pi()

    def at_liftoff(self, h: arb) -> AtLiftoff:
        sine, cosine = h.sin_cos_pi()
        return ((sine, cosine),)

    def rise(self, at_liftoff: AtLiftoff, s: arb) -> arb:
        ((sine, cosine),) = at_liftoff
        half, turn = s.sin_pi(), 2 * arb.pi()
        return (2 * cosine * half * half - sine * (turn * s - (2 * s).sin_pi())) / turn

    def gain(self, at_liftoff: AtLiftoff, s: arb) -> arb:
        ((sine, cosine),) = at_liftoff
        half, half_cosine = s.sin_cos_pi()
        return -2 * half * (sine * half - cosine * half_cosine)

    def rises(self, a: arb, r: arb, impact: int) -> list[arb]:
        above = certain_above(abs(a), r, "A > v_rest", impact)
        return [_rising((r / a).asin() / (2 * arb.pi()))] if above else []

    def falls(self, alpha: arb, impact: int) -> tuple[list[arb], list[arb]]:
        gamma = arb.pi() * alpha
        if not certain_above(gamma, ONE, FALLS, impact):
            return [], []
        lift = (-1 / gamma).acos() / (2 * arb.pi())
        return [lift], [-lift]


def _rising(x: arb) -> arb:
    """Return the one of two crossings, x and 1/2 - x, at which the kick rises."""
    return x if x > 0 else arb(0.5) - x


SINE_WAVE: Final[Wave] = _Sine()


class _Harmonics(Wave):
    """w = sum of c sin(2 pi h x + psi) = p sin(2 pi h x) + q cos(2 pi h x)."""

    def __init__(self, waveform: Waveform) -> None:
        self._terms = []
        for number, weight, phase in waveform.tones:
            sine, cosine = arb(phase).sin_cos()
            self._terms.append((number, arb(weight) * cosine, arb(weight) * sine))
        self._tones = waveform.tones

    def _sum(self, power: int) -> arb:
        """Sum of (2 pi h)^power |c|."""
        total = ZERO
        for h, c, _ in self._tones:
            total += (2 * arb.pi() * h) ** power * abs(arb(c))
        return total

    @property
    def bounds(self) -> ShapeBounds:
        fast, steep, bend, jolt, top = (self._sum(power) for power in (0, 1, 2, 3, -1))
        most, turn = max(h for h, _, _ in self._tones), 2 * arb.pi()
        size = max(float(one) for one in (fast, steep / turn, turn * top)) * (1.0 + 2.0**-40)
        return ShapeBounds(fast, steep, bend, jolt, top, size, 6.0 * most * most + most + 32.0)

    def _along(self, half_turns: arb, term: Callable[[arb, arb, arb], arb]) -> arb:
        """Sum of a function of 2 pi h, c sin and c cos."""
        total = ZERO
        for (h, *_), (u, v) in zip(self._terms, self.at_liftoff(half_turns), strict=True):
            total += term(2 * arb.pi() * h, u, v)
        return total

    def level(self, h: arb) -> arb:
        return self._along(h, lambda turn, u, v: -v / turn)

    def velocity(self, h: arb) -> arb:
        return self._along(h, lambda turn, u, v: u)

    def slope(self, h: arb) -> arb:
        return self._along(h, lambda turn, u, v: turn * v)

    def rate(self, h: arb) -> arb:
        return self._along(h, lambda turn, u, v: -turn * turn * u)

    def at_liftoff(self, h: arb) -> AtLiftoff:
        found = []
        for number, p, q in self._terms:
            sine, cosine = (number * h).sin_cos_pi()
            found.append((p * sine + q * cosine, p * cosine - q * sine))
        return found

    def rise(self, at_liftoff: AtLiftoff, s: arb) -> arb:
        total = ZERO
        for (number, *_), (u, v) in zip(self._terms, at_liftoff, strict=True):
            q, half = 2 * arb.pi() * number * s, (number * s).sin_pi()
            turned = (2 * number * s).sin_pi()
            total += (2 * v * half * half - u * (q - turned)) / (2 * arb.pi() * number)
        return total

    def gain(self, at_liftoff: AtLiftoff, s: arb) -> arb:
        total = ZERO
        for (number, *_), (u, v) in zip(self._terms, at_liftoff, strict=True):
            half, half_cosine = (number * s).sin_cos_pi()
            total -= 2 * half * (u * half - v * half_cosine)
        return total

    def rises(self, a: arb, r: arb, impact: int) -> list[arb]:
        kick = self.velocity, self.slope
        found = crossings(lambda n, x: a * kick[n](2 * x) - (ZERO if n else r), impact)
        return [x for x, rising in found if rising]

    def falls(self, alpha: arb, impact: int) -> tuple[list[arb], list[arb]]:
        half = alpha / 2
        press = self.slope, self.rate
        found = crossings(lambda n, x: half * press[n](2 * x) + (ZERO if n else 1), impact)
        return [x for x, rising in found if not rising], [x for x, rising in found if rising]


class _Triangle(Wave):
    """w = 4 x for |x| <= 1/4 and 2 - 4 x up to 3/4: its height is made of parabolas."""

    @property
    def bounds(self) -> ShapeBounds:
        return ShapeBounds(ONE, arb(4), ZERO, ZERO, arb(0.125), 1.0, 0.0)

    def _pieces(self, h: arb) -> list[tuple[int, arb]]:
        """Sign of the slope, and phase from the middle, of each piece in which a phase may be."""
        x = h / 2
        near = x - nearest_integer(x)
        found = []
        for middle, sign in ((ZERO, 1), (arb(0.5), -1), (arb(-0.5), -1), (ONE, 1), (-ONE, 1)):
            if abs(near - middle).lower() <= QUARTER:
                found.append((sign, near - middle))
        return found

    def _joined(self, h: arb, value: Callable[[int, arb], arb]) -> arb:
        first, *others = (value(*piece) for piece in self._pieces(h))
        for other in others:
            first = first.union(other)
        return first

    def level(self, h: arb) -> arb:
        return self._joined(h, lambda sign, y: sign * (2 * y * y - arb(0.125)))

    def velocity(self, h: arb) -> arb:
        return self._joined(h, lambda sign, y: 4 * sign * y)

    def slope(self, h: arb) -> arb:
        return self._joined(h, lambda sign, y: arb(4 * sign))

    def rate(self, h: arb) -> arb:
        return ZERO

    def slope_change(self, h: arb, error: float) -> float:
        near = h + arb(0, 2.0 * error)
        return 8.0 if len(self._pieces(near)) > 1 else 0.0

    def at_liftoff(self, h: arb) -> AtLiftoff:
        return ((h, self.velocity(h)),)

    def rise(self, at_liftoff: AtLiftoff, s: arb) -> arb:
        ((h, velocity),) = at_liftoff
        before, after = self._pieces(h), self._pieces(h + 2 * s)
        if s < 0.25 and len(before) == 1 and len(after) == 1 and before[0][0] == after[0][0]:
            return 2 * before[0][0] * s * s
        return self.level(h + 2 * s) - self.level(h) - s * velocity

    def gain(self, at_liftoff: AtLiftoff, s: arb) -> arb:
        ((h, velocity),) = at_liftoff
        return self.velocity(h + 2 * s) - velocity

    def rises(self, a: arb, r: arb, impact: int) -> list[arb]:
        above = certain_above(abs(a), r, "A > v_rest", impact)
        return [_rising(r / (4 * a))] if above else []

    def falls(self, alpha: arb, impact: int) -> tuple[list[arb], list[arb]]:
        falls = certain_above(2 * alpha, ONE, FALLS, impact)
        return ([QUARTER], [-QUARTER]) if falls else ([], [])


def wave_of(waveform: Waveform) -> Wave:
    """Return the shape of a waveform, at the current precision."""
    if waveform.name == HARMONICS_NAME:
        return _Harmonics(waveform)
    return _Triangle() if waveform.name == PARABOLIC_NAME else SINE_WAVE


def crossings(c: Course, impact: int) -> list[tuple[arb, bool]]:
    """All zeros in a period of a function of the phase in turns, and whether it rises there.

    Pieces of the period are halved until balls prove that the function has no zero, or is monotone,
    over the whole piece.
    """
    least = arb(2) ** (-FRAME_BITS // 2)
    step = ONE / PIECES
    pieces = [(k * step - OFF, (k + 1) * step - OFF) for k in range(PIECES)]
    found = []
    while pieces:
        low, high = pieces.pop()
        with ctx.workprec(FRAME_BITS):
            piece = low.union(high)
            over = c(0, piece)
            if over > 0 or over < 0:
                continue
            slopes = c(1, piece)
        if slopes > 0 or slopes < 0:
            before, after = c(0, low), c(0, high)
            if not (before > 0 or before < 0) or not (after > 0 or after < 0):
                raise UncertainError("a phase at which a rest may end", impact)
            if bool(before > 0) != bool(after > 0):
                found.append((narrowed(c, piece), bool(after > 0)))
            continue
        if high - low < least:
            raise UncertainError("a phase at which a rest may end", impact)
        middle = ((low + high) / 2).mid()
        pieces += [(middle, high), (low, middle)]
    return found


def next_of(phases: Sequence[arb], turns: arb, impact: int) -> arb:
    """First time in turns, not earlier than a given one, that has one of some phases."""
    found = []
    for phase in phases:
        periods = (turns - phase).ceil().unique_fmpz()
        if periods is None:
            raise UncertainError("whether a rest begins before the lift-off phase", impact)
        found.append(phase + periods)
    first = found[0]
    for other in found[1:]:
        first = (
            first if certain_above(other, first, "which lift-off is the next", impact) else other
        )
    return first


class Laws(NamedTuple):
    """Laws of an impact by their names, and the shape of the motion of the base."""

    rebound: str = "rest"
    restitution: str = "constant"
    waveform: Waveform = SINE

    @property
    def turns_back(self) -> bool:
        """True if a particle that is pushed into the base is turned back."""
        return self.rebound == "reflect"

    def in_periods(self, p: Mapping[str, arb]) -> Restitution:
        """Return `impact` for physical parameters, with speeds in units of g / 2 f."""
        speed = p.get("restitution_speed")
        unit = p["gravity"] / (2 * p["frequency"])
        return self.impact(p["restitution"], None if speed is None else speed / unit)

    def impact(self, e: arb, speed: arb | None) -> Restitution:
        """Return the law for a restitution e and, if it has one, a speed v_r."""
        if self.restitution == CONSTANT or speed is None:
            return Constant(e)
        if name_of(self.restitution) == POWER:
            return Power(e, speed, arb(numbers_of(self.restitution)))
        if name_of(self.restitution) == POINTS:
            pairs = [(arb(v), arb(kept)) for v, kept in numbers_of(self.restitution)]
            return Points([(v / pairs[-1][0] * speed, kept) for v, kept in pairs])
        if self.restitution in OF_SPEED:
            return OF_SPEED[self.restitution](e, speed)
        return Outside(OUTSIDE[self.restitution], e, speed)


class Restitution(Protocol):
    """A law of restitution: the speed that an impact leaves."""

    def share(self, v: arb) -> arb:
        """Share of v that is left."""

    def kept(self, v: arb) -> arb:
        """Speed that is left of v."""
        return self.share(v) * v

    def slope(self, v: arb) -> arb:
        """Derivative of `kept`."""

    def bend(self, v: arb) -> arb:
        """Derivative of `slope`; NaN where it has none, or none is known."""
        return arb("nan")


@dataclass(frozen=True)
class Constant(Restitution):
    """The same share of any speed."""

    e: arb

    def share(self, v: arb) -> arb:
        """Share of v that is left."""
        return self.e

    def slope(self, v: arb) -> arb:
        """Derivative of `kept`."""
        return self.e

    def bend(self, v: arb) -> arb:
        """Derivative of `slope`."""
        return arb(0)


@dataclass(frozen=True)
class Power(Restitution):
    """The same share up to a speed, and e (v / speed)^(-p) above it."""

    e: arb
    speed: arb
    p: arb

    def _fallen(self, v: arb) -> arb:
        return self.e * (self.p * (self.speed / v).log()).exp()

    def _chosen(self, v: arb, below: arb, above: Callable[[], arb]) -> arb:
        if v <= self.speed:
            return below
        return above() if v > self.speed else below.union(above())

    def share(self, v: arb) -> arb:
        """Share of v that is left."""
        return self._chosen(v, self.e, lambda: self._fallen(v))

    def slope(self, v: arb) -> arb:
        """Derivative of `kept`."""
        return self._chosen(v, self.e, lambda: (1 - self.p) * self._fallen(v))

    def bend(self, v: arb) -> arb:
        """Derivative of `slope`, which jumps at the kink."""
        if v < self.speed:
            return arb(0)
        return -self.p * self.slope(v) / v if v > self.speed else arb("nan")


class Plastic(Power):
    """A power of 1/4."""

    def __init__(self, e: arb, speed: arb) -> None:
        super().__init__(e, speed, arb(0.25))

    def _fallen(self, v: arb) -> arb:
        return self.e * (self.speed / v).sqrt().sqrt()


class Points(Restitution):
    """A share that is linear between points, and constant beyond both ends."""

    def __init__(self, points: Sequence[tuple[arb, arb]]) -> None:
        last = points[-1]
        # pieces: from and to a speed, with the share at the first and its slope
        self._pieces = [(arb("-inf"), points[0][0], points[0][1], arb(0))]
        for (v, e), (faster, less) in pairwise(points):
            self._pieces.append((v, faster, e, (less - e) / (faster - v)))
        self._pieces.append((last[0], arb("inf"), last[1], arb(0)))

    def _united(self, v: arb, value: Callable[[arb, arb, arb, arb], arb]) -> arb:
        """Return the union of a function on the pieces that may hold a speed."""
        found = None
        for low, high, e, rise in self._pieces:
            if not (v < low or v > high):
                one = value(v.max(low).min(high) if rise != 0 else v, low, e, rise)
                found = one if found is None else found.union(one)
        return arb("nan") if found is None else found

    def share(self, v: arb) -> arb:
        """Share of v that is left."""
        return self._united(v, lambda at, low, e, rise: e + rise * (at - low) if rise != 0 else e)

    def slope(self, v: arb) -> arb:
        """Derivative of `kept`."""
        return self._united(
            v, lambda at, low, e, rise: e + rise * (2 * at - low) if rise != 0 else e
        )

    def bend(self, v: arb) -> arb:
        """Derivative of `slope`, which jumps at points."""
        holding = [rise for low, high, _, rise in self._pieces if v > low and v < high]
        return 2 * holding[0] if holding else arb("nan")


class Viscoelastic(Restitution):
    """The share P(y) of the speed with y = y_0 (v / speed)^(1/10), where P(y_0) = e."""

    def __init__(self, e: arb, speed: arb) -> None:
        self._speed, self._root = speed, _root_at(e)

    def _scaled(self, v: arb) -> arb:
        """Return y, of speeds that are not negative."""
        t = v / self._speed
        if t > 0:
            return self._root * t.root(10)
        highest = arb(t.abs_upper())
        return self._root * (highest.root(10).union(arb(0)) if highest > 0 else arb(0))

    def share(self, v: arb) -> arb:
        """Share of v that is left."""
        top, higher, _, _ = _terms(self._scaled(v))
        return top / (top + higher)

    def slope(self, v: arb) -> arb:
        """Derivative of `kept`."""
        return _slope_at(self._scaled(v))

    def bend(self, v: arb) -> arb:
        """Derivative of `slope`."""
        y = self._scaled(v)
        return _slope_at(Jet(y, [arb(1)])).d[0] * y / (10 * v)


class Random(Restitution):
    """A law under noise: random numbers are added to its share and to the speed after impact.

    If `thrown`, a speed that would be negative changes its sign.  No derivative of the slope is
    given: only closed orbits need it, and they have no noise.
    """

    def __init__(self, law: Restitution, slip: arb, push: arb, thrown: bool) -> None:
        self._law, self._slip, self._push, self._thrown = law, slip, push, thrown

    @classmethod
    def drawn(
        cls,
        law: Restitution,
        p: Mapping[str, arb],
        unit: arb,
        deviates: tuple[float, float],
        thrown: bool,
    ) -> Random:
        """Law with the deviates of the restitution and of the kick; `unit` is that of speeds."""
        slip, push = deviates
        size = p.get("restitution_noise", ZERO)
        size += p.get("restitution_noise_relative", ZERO) * p["restitution"]
        kick = (1 + p["restitution"]) * p.get("kick_noise", ZERO)
        return cls(law, size * slip, kick * push / unit, thrown)

    def share(self, v: arb) -> arb:
        """Share of v that is left, from 0 to 1."""
        return (self._law.share(v) + self._slip).max(arb(0)).min(arb(1))

    def _left(self, v: arb) -> arb:
        return self.share(v) * v + self._push

    def kept(self, v: arb) -> arb:
        """Speed that is left of v, with the random push."""
        left = self._left(v)
        return abs(left) if self._thrown else left

    def slope(self, v: arb) -> arb:
        """Derivative of `kept`."""
        moved = self._law.share(v) + self._slip
        found = self._law.slope(v) + self._slip
        found = found if moved > 0 else arb(0) if moved <= 0 else found.union(arb(0))
        found = found if moved < 1 else arb(1) if moved >= 1 else found.union(arb(1))
        if not self._thrown or self._left(v) > 0:
            return found
        return -found if self._left(v) < 0 else found.union(-found)


def _slope_at(y: Any) -> Any:
    """Derivative of `kept` at y, a ball or a jet."""
    top, higher, by_top, by_higher = _terms(y)
    bottom = top + higher
    fall = y * (by_top * higher - top * by_higher) / bottom
    return (top + fall / 10) / bottom


def _terms(y: Any) -> tuple[Any, Any, Any, Any]:
    """Numerator of P, its denominator minus the numerator, and the derivatives of both."""
    n1, d2, d3, d4 = arb("0.501086"), arb("1.15345"), arb("0.577977"), arb("0.532178")
    higher = y * y * (d2 + y * (d3 + y * d4))
    return 1 + n1 * y, higher, n1, y * (2 * d2 + y * (3 * d3 + y * 4 * d4))


def _root_at(e: arb) -> arb:
    """Return y > 0 with P(y) = e, by Newton's interval method; P falls from 1 at 0."""
    if e == 1:
        return arb(0)
    y = arb(1)
    for _ in range(30):  # solves (1 - e) top = e higher; each step leaves a fifth of the error
        top, higher, _, _ = _terms(y)
        y = arb((y * ((1 - e) * top / (e * higher)).sqrt()).mid())
    found = y * arb(1, 2.0**-40)
    while True:
        top, higher, _, _ = _terms(y)
        _, _, by_top, by_higher = _terms(found)
        step = ((1 - e) * top - e * higher) / ((1 - e) * by_top - e * by_higher)
        closer = (y - step).intersection(found)
        if not closer.rad() < 0.5 * found.rad():
            return closer
        found, y = closer, arb(closer.mid())


class Outside(Restitution):
    """A law from outside the package, as it is now.

    Its slope can be evaluated on a ball, but the derivative of the slope is not known.
    """

    def __init__(self, law: OutsideLaw, e: arb, speed: arb) -> None:
        self._ratio, self._slope = law.ball_ratio or law.ratio, law.ball_slope or law.slope
        self._e, self._speed = e, speed

    def share(self, v: arb) -> arb:
        """Share of v that is left."""
        return self._ratio(self._e, v / self._speed)

    def slope(self, v: arb) -> arb:
        """Derivative of `kept`."""
        return self._slope(self._e, v / self._speed)


OF_SPEED: Final[Mapping[str, Callable[[arb, arb], Restitution]]] = {
    "plastic": Plastic,
    "viscoelastic": Viscoelastic,
}


def slope_change(impact: Restitution, v: arb, error: float) -> float:
    """Bound on the change of the slope if a speed changes by an error."""
    if isinstance(impact, Constant):
        return 0.0
    return float((impact.slope(v + arb(0, error)) - impact.slope(v)).abs_upper())


def mean_logarithm(
    law: Restitution, factor: Callable[[arb], arb], speeds: Sequence[arb], error: float
) -> tuple[arb | float, float]:
    """Mean logarithm of a factor at some speeds, and a bound on its change by their error."""
    exact = [factor(v) for v in speeds[: 1 if isinstance(law, Constant) else None]]
    if any(one == 0 for one in exact):
        return -math.inf, 0.0
    mean = sum((one.log() for one in exact), arb(0)) / len(exact)
    if isinstance(law, Constant):
        return mean, 0.0
    off = [(factor(v + arb(0, error)) / one).log() for v, one in zip(speeds, exact, strict=True)]
    return mean, max(float(one.abs_upper()) for one in off)
