"""A sample of realizations of a finished dataset: their scene and their stored numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.model.observables import Observable
from vibrosweep.model.parameters import SPRUNG, STREAM
from vibrosweep.model.times import Periods, Time
from vibrosweep.proof.deviates import deviates_of
from vibrosweep.proof.reference.bases import REFERENCE_OF, Reference
from vibrosweep.proof.reference.laws import Laws
from vibrosweep.proof.reference.motion import Deviates
from vibrosweep.scene.scene import Scene


@dataclass(frozen=True)
class Realization:
    """One realization of a scene, with exact times."""

    scene: Scene
    # All of `vibrosweep.model.parameters.PARAMETERS`, and those of OF_RESTITUTION and MOUNT that
    # the law of restitution and the base need
    parameters: Mapping[str, float]
    stream: float | None = None  # of random numbers; None where nothing is random

    @cached_property
    def launch_times(self) -> tuple[Fraction, ...]:
        """Launch times in s; a staggered particle j is launched at j / (particles frequency)."""
        if not isinstance(self.scene.launch, str):
            return tuple(map(Fraction, self.scene.launch))
        particles = self.scene.particles
        return tuple(j * self._period / particles for j in range(particles))

    @property
    def transient(self) -> float | Fraction:
        """Beginning of the window in s; a `Fraction` where it was given in forcing periods."""
        return self._seconds(self.scene.measures.transient)

    @property
    def duration(self) -> float | Fraction:
        """End of the window in s; a `Fraction` where it was given in forcing periods."""
        return self._seconds(self.scene.duration)

    @property
    def launch_rounding(self) -> float:
        """Rounding error in s of the comparison of a launch with the edges of the window."""
        end = float(self.duration)
        if isinstance(self.scene.launch, str):
            return 2.0**-51 * (end + float(self._period))
        times = (self.scene.measures.transient, self.scene.duration)
        return 2.0**-51 * end if any(isinstance(time, Periods) for time in times) else 0.0

    @property
    def laws(self) -> Laws:
        """Laws of an impact, and the shape of the motion."""
        return Laws(self.scene.rebound, self.scene.restitution_law, self.scene.waveform)

    @property
    def deviates(self) -> Callable[[int], Deviates] | None:
        """Deviates of each particle; None where nothing is random."""
        if self.stream is None:
            return None
        return partial(deviates_of, self.scene.noise_seed, self.stream)

    @property
    def coupled(self) -> bool:
        """True if the base couples the particles."""
        return self.scene.base == SPRUNG

    @property
    def reference(self) -> Reference:
        """Reference of a base over which particles are independent."""
        return REFERENCE_OF[self.scene.base]

    @property
    def _period(self) -> Fraction:
        return 1 / Fraction(self.parameters["frequency"])

    def _seconds(self, time: Time) -> float | Fraction:
        return Fraction(time.number) * self._period if isinstance(time, Periods) else time

    @cached_property
    def liftoff_error(self) -> float:
        """Largest error in turns of a lift-off after a rest that is computed in doubles."""
        return self.reference.liftoff_error(self.parameters, self.laws)

    @cached_property
    def velocity(self) -> float:
        """Velocity in m s-1 of a sine at least as fast, high and steep as the base's motion."""
        return self.reference.velocity(self.parameters, self.laws)


@dataclass(frozen=True)
class Sample:
    """Realizations drawn from a dataset; its record of every landing is a sample of one."""

    total: int  # number of realizations in the dataset
    rows: NDArray[np.int64]  # indices of those drawn, in increasing order
    parameters: Mapping[str, Array]  # as of a `Realization`, each of shape (row,)
    scene: Scene
    current: bool  # True if this version and git revision computed the dataset
    stored: Mapping[str, NDArray[Any]]  # the dataset's measured variables, each of shape (row, ...)
    # Coordinates of the dataset: numbers, arrays over the particles, or sampled ones, (row,)
    coordinates: Mapping[str, NDArray[Any]]
    others: Mapping[str, str]  # reasons why other variables cannot be compared, by name
    # Observables that are compared, with their values in the rows
    observables: Mapping[Observable, NDArray[Any]]

    def realization(self, row: int) -> Realization:
        """Return the realization of one of the rows."""
        parameters = {name: float(values[row]) for name, values in self.parameters.items()}
        stream = parameters.pop(STREAM, None)
        return Realization(self.scene, parameters, stream)
