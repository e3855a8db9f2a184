"""Comparison of a stored number with its proved value, or with one implied by other numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

from vibrosweep.proof.statistics import Proved


@dataclass(frozen=True)
class Judgement:
    """Result of the comparison for one stored number."""

    variable: str  # its name
    particle: int | None  # number of the particle; None for a number of the whole realization
    # Distance from the proved value; NaN where both are undefined, infinite where one is
    error: float
    claim: float | None  # largest error that the dataset allows; None where it claims nothing
    # Certified decimal digits, from the sum of the claim and the reference's radius, relative to
    # the value; 0 where the sum exceeds it.  None for exact, zero or undefined values.
    digits: float | None = None
    # Description of the failure; empty if the number is within its claim or nothing is claimed
    complaint: str = ""


def judge(
    variable: str, particle: int | None, stored: float, proved: Proved, claim: float | None
) -> Judgement:
    """Compare a stored number with its proved value, and its error with the claim."""
    least = error = math.inf
    digits = None
    if proved is None:
        least = error = math.nan if math.isnan(stored) else math.inf
    elif isinstance(proved, int | float):
        if not math.isnan(stored):
            least = error = 0.0 if stored == proved else abs(stored - proved)
    elif math.isfinite(stored):
        distance = proved - stored
        least, error = float(distance.abs_lower()), float(distance.abs_upper())
        size, bound = float(proved.abs_lower()), (claim or 0.0) + float(proved.rad())
        if claim is not None and size > 0.0 and bound > 0.0:
            digits = max(0.0, -math.log10(bound / size))
    complaint = ""
    if claim is not None and least > claim:
        known = "undefined" if proved is None else f"{float(proved)!r}"
        complaint = f"is {stored!r}, proved {known}: off by {error:.3g}, claimed {claim:.3g}"
    return Judgement(variable, particle, error, claim, digits, complaint)
