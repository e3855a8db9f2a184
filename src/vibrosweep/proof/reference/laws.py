"""Laws of rebound and of restitution in ball arithmetic.

Over the high-bounce base the speed after an impact is w = kept + kick.  Where w is negative the
particle is pushed into the base: it rests, or the law of rebound turns it back with the speed -w.

A law of restitution has a restitution e and a speed v_r, whose unit is that of all speeds.  Where a
ball of speeds holds a kink, values and slopes of both sides are enclosed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Protocol

from vibrosweep.model.outside_laws import OUTSIDE
from vibrosweep.model.outside_laws import Law as OutsideLaw
from vibrosweep.model.restitution_laws import CONSTANT
from vibrosweep.model.shapes import SINE, Waveform
from vibrosweep.proof.reference._flint import arb
from vibrosweep.proof.reference.jets import Jet


class Laws(NamedTuple):
    """Laws of an impact by their names, and the shape of the motion of the base."""

    rebound: str = "rest"
    restitution: str = "constant"
    waveform: Waveform = SINE

    @property
    def turns_back(self) -> bool:
        """True if a particle that is pushed into the base is turned back."""
        return self.rebound == "reflect"

    def in_periods(self, p: Mapping[str, arb]) -> Impact:
        """Return `impact` for physical parameters, with speeds in units of g / 2 f."""
        speed = p.get("restitution_speed")
        unit = p["gravity"] / (2 * p["frequency"])
        return self.impact(p["restitution"], None if speed is None else speed / unit)

    def impact(self, e: arb, speed: arb | None) -> Impact:
        """Return the law for a restitution e and, if it has one, a speed v_r."""
        if self.restitution == CONSTANT or speed is None:
            return Constant(e)
        if self.restitution in OF_SPEED:
            return OF_SPEED[self.restitution](e, speed)
        return Outside(OUTSIDE[self.restitution], e, speed)


class Impact(Protocol):
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
class Constant(Impact):
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
class Plastic(Impact):
    """The same share up to a speed, and e (v / speed)^(-1/4) above it."""

    e: arb
    speed: arb

    def _chosen(self, v: arb, below: arb, above: Callable[[], arb]) -> arb:
        if v <= self.speed:
            return below
        return above() if v > self.speed else below.union(above())

    def share(self, v: arb) -> arb:
        """Share of v that is left."""
        return self._chosen(v, self.e, lambda: self.e * (self.speed / v).sqrt().sqrt())

    def slope(self, v: arb) -> arb:
        """Derivative of `kept`."""
        return self._chosen(v, self.e, lambda: 0.75 * self.e * (self.speed / v).sqrt().sqrt())

    def bend(self, v: arb) -> arb:
        """Derivative of `slope`, which jumps at the kink."""
        if v < self.speed:
            return arb(0)
        return -0.25 * self.slope(v) / v if v > self.speed else arb("nan")


class Viscoelastic(Impact):
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


class Random(Impact):
    """A law under noise: random numbers are added to its share and to the speed after impact.

    If `thrown`, a speed that would be negative changes its sign.  No derivative of the slope is
    given: only closed orbits need it, and they have no noise.
    """

    def __init__(self, law: Impact, slip: arb, push: arb, thrown: bool) -> None:
        self._law, self._slip, self._push, self._thrown = law, slip, push, thrown

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


class Outside(Impact):
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


OF_SPEED: Final[Mapping[str, Callable[[arb, arb], Impact]]] = {
    "plastic": Plastic,
    "viscoelastic": Viscoelastic,
}


def slope_change(impact: Impact, v: arb, error: float) -> float:
    """Bound on the change of the slope if a speed changes by an error."""
    if isinstance(impact, Constant):
        return 0.0
    return float((impact.slope(v + arb(0, error)) - impact.slope(v)).abs_upper())


def mean_logarithm(
    law: Impact, factor: Callable[[arb], arb], speeds: Sequence[arb], error: float
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
