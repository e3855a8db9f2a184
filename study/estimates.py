"""Numbers with their 95 % intervals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, SupportsFloat

import numpy as np
from numpy.typing import ArrayLike

CONFIDENCE: Final = 0.95
# A statement about all cases passes if no exception is found and Wilson's interval of the share
# of true cases begins here or above
ENOUGH: Final = 0.95


@dataclass(frozen=True)
class Estimate:
    """A number, and the ends of its interval, which coincide with it if nothing is random."""

    value: float
    low: float
    high: float
    # Number of realizations or seeds from which it is estimated; None if nothing is random
    cases: int | None = None


def exact(value: Estimate | SupportsFloat) -> Estimate:
    """Return an estimate unchanged, and an exact number as an interval of width zero."""
    if isinstance(value, Estimate):
        return value
    return Estimate(float(value), float(value), float(value))


def share(flags: ArrayLike, known: ArrayLike = True) -> Estimate:
    """Share of true ones among independent realizations, with Wilson's interval.

    NaN if there are no realizations.  If some are unknown, so is the share; its interval then
    reaches from the low end with all of these false to the high end with all of them true.
    """
    from scipy.stats import binomtest

    each = np.asarray(flags, np.bool_)
    unknown = ~np.broadcast_to(np.asarray(known, np.bool_), each.shape)
    if not each.size:
        return Estimate(np.nan, np.nan, np.nan, 0)
    least, most = (int(np.count_nonzero(some)) for some in (each & ~unknown, each | unknown))
    low, high = (
        binomtest(count, each.size).proportion_ci(CONFIDENCE, method="wilson")
        for count in (least, most)
    )
    value = least / each.size if least == most else np.nan
    return Estimate(value, float(low.low), float(high.high), each.size)


def exceptions(flags: ArrayLike) -> Estimate:
    """Count the exceptions to a statement about all realizations, which a single one refutes.

    Without an exception the interval ends at 0 only if Wilson's interval of the true share begins
    at `ENOUGH` or above; otherwise, with too few realizations, it has no upper end.
    """
    each = np.asarray(flags, np.bool_)
    found = float(np.count_nonzero(~each))
    open_end = found == 0.0 and not share(each).low >= ENOUGH
    return Estimate(found, found, np.inf if open_end else found, each.size)


def mean(values: ArrayLike, least: float = -np.inf) -> Estimate:
    """Mean over the seeds whose value is known, with Student's interval, cut off at `least`.

    `least` is a bound below which the number cannot be, such as 0 for a magnitude.  NaN if fewer
    than two values, or fewer than half of them, are known.
    """
    from scipy.stats import t

    each = np.asarray(values, np.float64)
    known = each[np.isfinite(each)]
    if known.size < max(2, 0.5 * each.size):
        return Estimate(np.nan, np.nan, np.nan, known.size or None)
    middle = float(known.mean())
    half = float(t.ppf(0.5 + 0.5 * CONFIDENCE, known.size - 1) * known.std(ddof=1))
    half /= known.size**0.5
    return Estimate(middle, max(middle - half, least), middle + half, known.size)


def magnitude(signed: Estimate) -> Estimate:
    """Magnitude of a signed number; its interval begins at 0 if the number's interval holds 0."""
    ends = sorted((abs(signed.low), abs(signed.high)))
    low = 0.0 if signed.low < 0.0 < signed.high else ends[0]
    return Estimate(abs(signed.value), low, ends[1], signed.cases)
