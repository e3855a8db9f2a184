"""Numbers with their 95 % intervals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, SupportsFloat

import numpy as np
from numpy.typing import ArrayLike

CONFIDENCE: Final = 0.95


@dataclass(frozen=True)
class Estimate:
    """A number, and the ends of its interval; they coincide where chance has no part in it."""

    value: float
    low: float
    high: float


def exact(value: Estimate | SupportsFloat) -> Estimate:
    """An estimate as it is, or a number without doubt as an interval of no width."""
    if isinstance(value, Estimate):
        return value
    return Estimate(float(value), float(value), float(value))


def share(flags: ArrayLike, known: ArrayLike = True) -> Estimate:
    """Share of independent realizations that are true, with Wilson's interval.

    Of none it is NaN.  Where some are not known, so is the share: its interval then reaches from
    that with all of these false to that with all of them true.
    """
    from scipy.stats import binomtest

    each = np.asarray(flags, np.bool_)
    unknown = ~np.broadcast_to(np.asarray(known, np.bool_), each.shape)
    if not each.size:
        return Estimate(np.nan, np.nan, np.nan)
    least, most = (int(np.count_nonzero(some)) for some in (each & ~unknown, each | unknown))
    low, high = (
        binomtest(count, each.size).proportion_ci(CONFIDENCE, method="wilson")
        for count in (least, most)
    )
    value = least / each.size if least == most else np.nan
    return Estimate(value, float(low.low), float(high.high))


def mean(values: ArrayLike) -> Estimate:
    """Mean over seeds, with Student's interval; NaN if a value is, or if there are not two."""
    from scipy.stats import t

    each = np.asarray(values, np.float64)
    if each.size < 2:
        return Estimate(np.nan, np.nan, np.nan)
    middle = float(each.mean())
    half = float(t.ppf(0.5 + 0.5 * CONFIDENCE, each.size - 1) * each.std(ddof=1)) / each.size**0.5
    return Estimate(middle, middle - half, middle + half)


def magnitude(signed: Estimate) -> Estimate:
    """Magnitude of a number of either sign; it may be 0 where the interval holds 0."""
    ends = sorted((abs(signed.low), abs(signed.high)))
    low = 0.0 if signed.low < 0.0 < signed.high else ends[0]
    return Estimate(abs(signed.value), low, ends[1])
