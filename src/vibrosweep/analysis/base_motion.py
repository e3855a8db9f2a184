"""Motion of the base of a record."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vibrosweep.abilities import refusal
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError
from vibrosweep.model.parameters import HIGH_BOUNCE, NOISE, SPRUNG
from vibrosweep.model.restitution_laws import CONSTANT, law_in
from vibrosweep.model.shapes import SINE, SINE_NAME, Waveform, name_in
from vibrosweep.store.arranged import require_dataset

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["BaseMotion", "recoils"]


@dataclass(frozen=True)
class BaseMotion:
    """Motion of the base of one realization, which the particles do not affect."""

    speed: float  # peak velocity V0 = A / (1 + e), m s-1; 0 where the base stays at height 0
    frequency: float  # Hz
    phase: float  # rad
    waveform: Waveform = field(default=SINE, kw_only=True)

    def velocity(self, time: ArrayLike) -> Array:
        """Velocity V0 w(f t + phi / 2 pi), m s-1, at times in s of any shape."""
        if self.waveform == SINE:
            return np.asarray(self.speed * np.sin(self._angle(time)))
        return self.speed * self.waveform.velocity(self._turns(time))

    def height(self, time: ArrayLike) -> Array:
        """Height V0 / f W(f t + phi / 2 pi), m, at times in s of any shape."""
        if self.waveform == SINE:
            return np.asarray(-self.displacement * np.cos(self._angle(time)))
        return self.speed / self.frequency * self.waveform.height(self._turns(time))

    @property
    def displacement(self) -> float:
        """Half the height from the lowest to the highest level, m."""
        return self.speed / (self.waveform.per_displacement * self.frequency)

    @property
    def reach(self) -> float:
        """Upper bound of the distance from height 0, m."""
        return self.displacement if self.waveform == SINE else 2.0 * self.displacement

    def _turns(self, time: ArrayLike) -> Array:
        return np.asarray(self.frequency * np.asarray(time) + self.phase / (2.0 * np.pi))

    def _angle(self, time: ArrayLike) -> Array:
        return np.asarray(2.0 * np.pi * self.frequency * np.asarray(time) + self.phase)


def base_name(dataset: xr.Dataset) -> str:
    """Return the base of a dataset, one of `BASES`; by default the high-bounce base."""
    require_dataset(dataset)
    return str(dataset.attrs.get("base", HIGH_BOUNCE))


def moves(dataset: xr.Dataset) -> bool:
    """Return whether the base of a dataset moves."""
    return base_name(dataset) != HIGH_BOUNCE


def recoils(dataset: xr.Dataset) -> bool:
    """Return whether the base of a dataset has finite mass and so couples its particles."""
    return base_name(dataset) == SPRUNG


def has_closed_forms(dataset: xr.Dataset) -> bool:
    """Return whether closed forms hold: they need a sine, constant restitution, no coupling."""
    plain = name_in(dataset.attrs) == SINE_NAME and law_in(dataset.attrs) == CONSTANT
    return plain and not recoils(dataset)


def require_scene(dataset: xr.Dataset, analysis: str) -> None:
    """Raise a DataError if an analysis cannot take the scene of a dataset."""
    wrong = refusal(
        base_name(dataset),
        restitution=law_in(dataset.attrs),
        waveform=name_in(dataset.attrs),
        analysis=analysis,
        noise=[name for name in NOISE if name in dataset.variables],
    )
    if wrong:
        raise DataError(f"{analysis} {wrong}")
