"""What is watched and measured, for every realization alike."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.abilities import refusal
from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.advance import LOOK_AFTER
from vibrosweep.model.measures import Measures
from vibrosweep.model.parameters import HIGH_BOUNCE
from vibrosweep.model.times import Periods, Time, amount, in_periods


@dataclass(frozen=True)
class Observation:
    """What is launched, how long it is watched and what is measured.

    Raises
    ------
    ParameterError
        The base does not implement the law of rebound.
    """

    particles: int  # number of particles per realization
    launch: str | tuple[float, ...]  # ``"staggered"`` or the launch times of all particles in s
    duration: Time  # end of the observation: a number in s, or `Periods`
    rebound: str  # ``"rest"`` or ``"reflect"``
    measures: Measures
    # Whether what is known already is counted instead of followed; off where every landing is kept,
    # and to compare
    skip: bool = True
    base: str = HIGH_BOUNCE  # one of `vibrosweep.model.parameters.BASES`

    def __post_init__(self) -> None:
        wrong = refusal(self.base, law=self.rebound)
        if wrong:
            raise ParameterError(wrong)

    def measuring(self, **changes: float | Periods) -> Observation:
        """Return the same observation with other values of some keys of [measure]."""
        asked: dict[str, Any] = changes
        return replace(self, measures=replace(self.measures, **asked))

    @property
    def budget(self) -> int:
        """Impacts after which a particle is given up: the budget up to a whole number of looks."""
        return -(-self.measures.impact_budget // LOOK_AFTER) * LOOK_AFTER

    @property
    def windowed(self) -> bool:
        """Whether landings before the window are possible."""
        # a launch before a window that begins at 0 is early in any unit
        begin = amount(self.measures.transient)
        early_launch = not isinstance(self.launch, str) and min(self.launch) < begin
        return begin > 0.0 or early_launch


def launched_in_window(observation: Observation, frequency: Array) -> NDArray[np.bool_]:
    """Whether particles are launched inside the window; shape (realization or 1, particle)."""
    frequency = frequency[:1] if np.all(frequency == frequency[:1]) else frequency
    begin, end = observation.measures.transient, observation.duration
    if isinstance(observation.launch, str):
        particles = observation.particles
        each = np.arange(particles, dtype=np.float64)
        first = _launches_until(begin, particles, frequency)[:, np.newaxis]
        last = _launches_until(end, particles, frequency)[:, np.newaxis]
        return np.asarray((first <= each) & (each <= last))
    times = np.asarray(observation.launch)[np.newaxis, :]
    if not isinstance(begin, Periods) and not isinstance(end, Periods):
        return np.asarray((begin <= times) & (times <= end))
    first, last = (in_periods(time, frequency)[:, np.newaxis] for time in (begin, end))
    periods = frequency[:, np.newaxis] * times
    return np.asarray((first <= periods) & (periods <= last))


def _launches_until(time: Time, particles: int, frequency: Array) -> Array:
    """Staggered launches up to a time, if they went on for ever; not rounded."""
    per_time = particles * (np.ones_like(frequency) if isinstance(time, Periods) else frequency)
    return np.asarray(per_time * amount(time))
