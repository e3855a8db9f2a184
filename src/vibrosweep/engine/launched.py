"""Launches inside the window of measures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.model.times import Periods, Time, amount, in_periods
from vibrosweep.scene.scene import Scene


def launched_in_window(scene: Scene, frequency: Array) -> NDArray[np.bool_]:
    """Return whether particles are launched in the window; shape (realization or 1, particle)."""
    frequency = frequency[:1] if np.all(frequency == frequency[:1]) else frequency
    begin, end = scene.measures.transient, scene.duration
    if isinstance(scene.launch, str):
        particles = scene.particles
        number = np.arange(particles, dtype=np.float64)
        first = _launches_until(begin, particles, frequency)[:, np.newaxis]
        last = _launches_until(end, particles, frequency)[:, np.newaxis]
        return np.asarray((first <= number) & (number <= last))
    times = np.asarray(scene.launch)[np.newaxis, :]
    if not isinstance(begin, Periods) and not isinstance(end, Periods):
        return np.asarray((begin <= times) & (times <= end))
    first, last = (in_periods(time, frequency)[:, np.newaxis] for time in (begin, end))
    periods = frequency[:, np.newaxis] * times
    return np.asarray((first <= periods) & (periods <= last))


def _launches_until(time: Time, particles: int, frequency: Array) -> Array:
    """Return a time in units of the interval between staggered launches."""
    per_time = particles * (np.ones_like(frequency) if isinstance(time, Periods) else frequency)
    return np.asarray(per_time * amount(time))
