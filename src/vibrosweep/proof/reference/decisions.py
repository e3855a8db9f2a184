"""Decisions in ball arithmetic; an uncertain one requests more precision."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final, TypeVar

from vibrosweep.proof.reference._flint import UndecidableError, arb

T = TypeVar("T")
HALF = arb(0.5)
GUARD_BITS: Final = 64


class UncertainError(Exception):
    """More precision is needed to decide `decision` at impact `impact`."""

    def __init__(self, decision: str, impact: int) -> None:
        super().__init__(decision, impact)
        self.decision = decision
        self.impact = impact


def certain_above(left: arb, right: arb, decision: str, impact: int) -> bool:
    """Decide left > right, or raise `UncertainError`."""
    if left > right:
        return True
    if left <= right:
        return False
    raise UncertainError(f"whether {decision}", impact)


class WidthLimits:
    """Check that results are as narrow as a number of digits requires.

    Attributes
    ----------
    bits
        Relative accuracy that is enough for any result.
    phase, time, velocity
        Radii that are enough for less accurate results: in turns or periods, s, and m s-1.
    """

    def __init__(self, digits: int, parameters: Mapping[str, float]) -> None:
        self.bits = accuracy_bits(digits)
        self.phase = arb(10) ** -digits
        self.time = self.phase * arb(parameters["contact_time"])
        self.velocity = self.time * arb(parameters["gravity"]) / 2

    def require(self, impact: int, *found: tuple[arb, arb]) -> None:
        """Raise `UncertainError` unless all results, each given with its radius, are narrow."""
        for ball, radius in found:
            if not (ball.rel_accuracy_bits() >= self.bits or ball.rad() <= radius):
                raise UncertainError("a result to the digits asked for", impact)


def accuracy_bits(digits: int) -> int:
    """Relative accuracy in bits that gives the digits."""
    return math.ceil(digits * math.log2(10.0)) + 2


def nearest_integer(ball: arb) -> int:
    """Integer next to the midpoint: a choice of representation, so never uncertain."""
    return int((ball.mid() + HALF).mid().floor().fmpz())  # the sum may round


def first_precision(digits: int) -> int:
    """Precision in bits at which results to these digits are tried first."""
    return GUARD_BITS * (2 + accuracy_bits(digits) // GUARD_BITS)


def decided(attempt: Callable[[int], T], bits: int, max_bits: int) -> T:
    """Return the result of an attempt at the lowest precision that decides everything.

    The precision starts at `bits` and is doubled.  Raises an UndecidableError where `max_bits` is
    not enough.
    """
    while True:
        try:
            return attempt(bits)
        except UncertainError as uncertain:
            if 2 * bits > max_bits:
                raise UndecidableError(uncertain.decision, uncertain.impact, bits) from None
        bits *= 2
