"""Times as they are stamped: rounded, with gaps, on any clock."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

import numpy as np

from vibrosweep.arrays import Array

__all__ = ["even_times", "origin_of", "rounding_of", "strongest_rate"]

FAR: Final = 100.0  # durations from its zero at which a clock counts from 1970 or from midnight
STEADY: Final = 0.02  # largest relative difference between a rate and its first estimate


def rounding_of(cells: Iterable[str]) -> float:
    """Step to which numbers are rounded, from the decimals with which they are written."""
    decimals = 0
    for cell in cells:
        mantissa, _, exponent = cell.lower().partition("e")
        digits = len(mantissa.partition(".")[2].rstrip("0"))
        decimals = max(decimals, digits - int(exponent or 0))
    return float(10.0**-decimals)


def even_times(time: Array, rounding: float, rate: float | None = None) -> tuple[Array, float]:
    """Undo the rounding of times (s) that a steady clock stamped; gaps are allowed.

    Returns times and the rate in Hz, which is `rate`, a whole number or 1000/1001 of one if
    the stamps allow it.  Times that no steady clock explains stay as they are, and the rate is
    that of the median step.
    """
    steps = np.diff(time)
    if time.size < 2:
        return time, np.nan
    usual = float(np.median(steps))
    if time.size < 4:
        return time, 1.0 / usual
    usual = float(steps[steps < 1.5 * usual].mean())
    frame = np.concatenate([[0.0], np.cumsum(np.rint(steps / usual))])
    since = time - time[0]
    found = 1.0 / float(np.polyfit(frame, since, 1)[0])
    slack = (1.0 + 1e-6) * rounding + 4.0 * float(np.spacing(np.abs(time).max()))
    for candidate in _rates(found, rate):
        rest = since - frame / candidate
        if abs(candidate / found - 1.0) < STEADY and np.ptp(rest) <= slack:
            middle = 0.5 * float(rest.min() + rest.max())
            return time[0] + middle + frame / candidate, candidate
    return time, 1.0 / float(np.median(steps))


def _rates(found: float, rate: float | None) -> Iterator[float]:
    """Yield rates near one that was found, the likeliest first."""
    if rate is not None:
        yield rate
    for candidate in (round(found), 1000.0 * round(1.001 * found) / 1001.0, round(found, 1), found):
        if candidate > 0.0:
            yield float(candidate)


def origin_of(time: Array) -> float:
    """Whole second from which to count times, so that phases hold: 0 unless it is far away."""
    begin, span = float(time[0]), float(time[-1] - time[0])
    return float(np.floor(begin)) if abs(begin) > FAR * span else 0.0


def strongest_rate(time: Array, values: Array, padding: int = 1) -> float:
    """Frequency in Hz of the highest peak of the spectrum of values without mean or trend.

    Values are put on an even clock of the usual step, and gaps hold zeros: where all steps are
    multiples of one this is the spectrum of Lomb and Scargle but for its norm.
    """
    step = 1.0 / even_times(time, 0.0)[1]
    place = np.rint((time - time[0]) / step).astype(np.intp)
    even = np.zeros(place[-1] + 1)
    even[place] = values
    power = np.abs(np.fft.rfft(even, padding * even.size)) ** 2
    return (int(np.argmax(power[1:])) + 1) / (padding * even.size * step)
