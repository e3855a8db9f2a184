"""Decisions of ball arithmetic, or a request for more precision."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from vibrosweep.proof.reference._flint import UndecidableError, arb

T = TypeVar("T")
HALF = arb(0.5)


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


def nearest_integer(ball: arb) -> int:
    """Integer next to the midpoint: a choice of representation, so never uncertain."""
    return int((ball.mid() + HALF).mid().floor().fmpz())  # the sum may round


def decided(attempt: Callable[[int], T], bits: int, max_bits: int) -> T:
    """Return the result of an attempt at the lowest precision that decides everything.

    The precision is doubled from `bits` on; an UndecidableError where `max_bits` is not enough.
    """
    while True:
        try:
            return attempt(bits)
        except UncertainError as uncertain:
            if 2 * bits > max_bits:
                raise UndecidableError(uncertain.decision, uncertain.impact, bits) from None
        bits *= 2
