"""Times of an observation: in seconds, or in forcing periods of each realization."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrosweep.arrays import Array


@dataclass(frozen=True)
class Periods:
    """A time in forcing periods; in s it depends on the frequency of the realization."""

    number: float


Time = float | Periods  # a plain number is in s


def amount(time: Time) -> float:
    """Return the number of seconds or periods."""
    return time.number if isinstance(time, Periods) else time


def fraction_of(time: Time, share: float) -> Time:
    """Return a share of a time, in the same unit."""
    return Periods(time.number * share) if isinstance(time, Periods) else time * share


def in_seconds(time: Time, frequency: Array) -> Array:
    """Return a time in s for each realization; `frequency` in Hz, shape (realization,)."""
    if isinstance(time, Periods):
        return np.asarray(time.number / frequency)
    return np.full(frequency.shape, time)


def in_periods(time: Time, frequency: Array) -> Array:
    """Return a time in periods for each realization; `frequency` in Hz, shape (realization,)."""
    if isinstance(time, Periods):
        return np.full(frequency.shape, time.number)
    return np.asarray(frequency * time)


def precedes(first: Time, second: Time, frequency: Array) -> bool:
    """Return whether one time is before another at every frequency (Hz)."""
    if isinstance(first, Periods) == isinstance(second, Periods):
        return amount(first) < amount(second)
    return bool(np.all(in_seconds(first, frequency) < in_seconds(second, frequency)))


def unit_of(time: Time) -> str:
    """Return the unit of a time in words, for messages."""
    return "forcing periods" if isinstance(time, Periods) else "s"
