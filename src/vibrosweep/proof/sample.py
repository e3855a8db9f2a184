"""A sample of realizations of a finished dataset: their settings and their stored numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.model.observables import Observable
from vibrosweep.model.parameters import SPRUNG
from vibrosweep.model.times import Periods, Time
from vibrosweep.proof.reference.bases import REFERENCE_OF, Reference
from vibrosweep.proof.reference.laws import Laws
from vibrosweep.scene.scene import Scene


@dataclass(frozen=True)
class Realization:
    """One realization as the reference takes it."""

    # Every parameter of `vibrosweep.model.parameters.PARAMETERS`, and of OF_RESTITUTION and MOUNT
    # there what the law of restitution and the base have
    parameters: Mapping[str, float]
    # Exact, s; a staggered particle j is launched at j / (particles frequency)
    launch_times: tuple[Fraction, ...]
    # transient, duration: window of the measures, s; a `Fraction` where it was given in forcing
    # periods
    transient: float | Fraction
    duration: float | Fraction
    # True if landings before the window are possible; if not, every landing up to the end counts
    windowed: bool
    # Error in s with which a launch is compared with the edges of the window
    launch_rounding: float
    laws: Laws
    base: str  # one of `vibrosweep.model.parameters.BASES`

    @property
    def coupled(self) -> bool:
        """True if the base couples the particles."""
        return self.base == SPRUNG

    @property
    def reference(self) -> Reference:
        """Reference of a base over which particles are independent."""
        return REFERENCE_OF[self.base]


@dataclass(frozen=True)
class Sample:
    """Realizations drawn from a dataset; its record of every landing is a sample of one."""

    total: int  # number of realizations in the dataset
    rows: NDArray[np.int64]  # indices of those drawn, in increasing order
    parameters: Mapping[str, Array]  # as of a `Realization`, each of shape (row,)
    scene: Scene
    current: bool  # True if this version and git revision computed the dataset
    stored: Mapping[str, NDArray[Any]]  # the dataset's measured variables, each of shape (row, ...)
    # Its coordinates: numbers, arrays over the particles, or sampled ones of shape (row,)
    coordinates: Mapping[str, NDArray[Any]]
    others: Mapping[str, str]  # reasons why other variables cannot be compared, by name
    # Observables that are compared, with their values in the rows
    observables: Mapping[Observable, NDArray[Any]]

    def realization(self, row: int) -> Realization:
        """Return the realization of one of the rows."""
        scene, rounding = self.scene, 0.0
        parameters = {name: float(values[row]) for name, values in self.parameters.items()}
        begin, end = (
            _exact(time, parameters["frequency"])
            for time in (scene.measures.transient, scene.duration)
        )
        if isinstance(scene.launch, str):
            period = 1 / Fraction(parameters["frequency"])
            steps = range(scene.particles)
            rounding = 2.0**-51 * (float(end) + float(period))
            launch = tuple(j * period / scene.particles for j in steps)
        else:
            launch = tuple(Fraction(time) for time in scene.launch)
            if isinstance(begin, Fraction) or isinstance(end, Fraction):
                rounding = 2.0**-51 * float(end)  # launches are compared in periods
        return Realization(
            parameters=parameters,
            launch_times=launch,
            transient=begin,
            duration=end,
            windowed=scene.windowed,
            launch_rounding=rounding,
            laws=Laws(scene.rebound, scene.restitution_law),
            base=scene.base,
        )


def _exact(time: Time, frequency: float) -> float | Fraction:
    """Time in s, without rounding."""
    return Fraction(time.number) / Fraction(frequency) if isinstance(time, Periods) else time
