"""Balls with their derivatives by several variables (automatic differentiation, forward)."""

from __future__ import annotations

from collections.abc import Sequence

from vibrosweep.proof.reference._flint import arb


class Jet:
    """A ball that holds a function of some variables, and balls that hold its derivatives."""

    __slots__ = ("d", "v")

    def __init__(self, v: arb, d: Sequence[arb]) -> None:
        self.v, self.d = v, d

    def __add__(self, other: Jet | arb | int) -> Jet:
        if isinstance(other, Jet):
            return Jet(self.v + other.v, [a + b for a, b in zip(self.d, other.d, strict=True)])
        return Jet(self.v + other, self.d)

    __radd__ = __add__

    def __neg__(self) -> Jet:
        return Jet(-self.v, [-a for a in self.d])

    def __sub__(self, other: Jet | arb | int) -> Jet:
        return self + -other

    def __rsub__(self, other: arb | int) -> Jet:
        return -self + other

    def __mul__(self, other: Jet | arb | int) -> Jet:
        if isinstance(other, Jet):
            v, w = self.v, other.v
            d = [a * w + v * b for a, b in zip(self.d, other.d, strict=True)]
            return Jet(v * w, d)
        return Jet(self.v * other, [a * other for a in self.d])

    __rmul__ = __mul__

    def __truediv__(self, other: Jet | arb | int) -> Jet:
        if isinstance(other, Jet):
            ratio = self.v / other.v
            d = [(a - ratio * b) / other.v for a, b in zip(self.d, other.d, strict=True)]
            return Jet(ratio, d)
        return Jet(self.v / other, [a / other for a in self.d])

    def __rtruediv__(self, other: arb | int) -> Jet:
        ratio = other / self.v
        return Jet(ratio, [-ratio * a / self.v for a in self.d])


def variables(values: Sequence[arb]) -> list[Jet]:
    """Return independent variables."""
    n = len(values)
    return [Jet(v, [arb(int(i == k)) for i in range(n)]) for k, v in enumerate(values)]
