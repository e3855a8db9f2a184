"""The one place where python-flint is imported, and the errors of the proved reference."""

from __future__ import annotations

from fractions import Fraction

from vibrosweep.errors import VibrosweepError

__all__ = ["MissingFlintError", "UndecidableError", "arb", "arb_mat", "ctx", "exact", "fmpq"]


class MissingFlintError(VibrosweepError, ImportError):
    """The proved reference needs python-flint, which is not installed."""


class UndecidableError(VibrosweepError, ArithmeticError):
    """A decision, or the digits asked for, stayed uncertain at the largest precision.

    Either two numbers that the model compares are equal (a tie: no precision can tell which is
    larger unless both are exact), or the orbit loses more digits than the precision holds.

    Attributes
    ----------
    decision
        The uncertain decision, in words.
    impact
        Number of the impact, from 1.
    bits
        Largest precision that was tried.
    """

    def __init__(self, decision: str, impact: int, bits: int) -> None:
        super().__init__(
            f"impact {impact}: {decision} stays uncertain at {bits} bits: if this is an exact tie, "
            f"change a parameter by a rounding unit; if the orbit loses more digits than that, "
            f"raise max_bits, shorten the duration or ask for fewer digits"
        )
        self.decision = decision
        self.impact = impact
        self.bits = bits


try:
    from flint import arb, arb_mat, ctx, fmpq
except ImportError as error:
    raise MissingFlintError(
        "the proved reference computes in ball arithmetic with python-flint, which is not "
        'installed: pip install "vibrosweep[verify]"'
    ) from error


def exact(number: float | Fraction) -> arb:
    """Ball that holds a number; its radius is 0 for a double."""
    if isinstance(number, Fraction):
        return arb(fmpq(number.numerator, number.denominator))
    return arb(number)
