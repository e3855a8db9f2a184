"""Closed forms of locked orbits over any plane in which one axis is the forcing."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from vibrosweep import theory
from vibrosweep.arrays import Array
from vibrosweep.explore.points import Points
from vibrosweep.figures.windows import per_amplitude
from vibrosweep.model.forcing import FORCINGS
from vibrosweep.model.locked_theory import lower_end
from vibrosweep.model.shapes import SINE
from vibrosweep.theory import FIXED

MODES: Final = (1, 2, 3)
SAMPLES: Final = 201
# Parameters, apart from the forcing, on which the ends of a window depend
SOURCES: Final = ("restitution", "frequency", "gravity")


class WindowEnd(NamedTuple):
    """An end of the window of mode k along the axes of a plane."""

    mode: int
    is_upper: bool
    x: Array
    y: Array


def window_ends(points: Points, axes: tuple[str, str]) -> tuple[list[WindowEnd], str]:
    """Curves A_min and A_max of the modes over a plane, converted to the forcing on its axis.

    Returns the curves that cross the range of the points, and the reason if there are none.
    """
    forcing = next((name for name in axes if name in FORCINGS), None)
    base = points.base_choice.scene.base
    if base not in FIXED:
        return [], "closed forms hold for a base that particles do not act on"
    if points.base_choice.scene.waveform != SINE:
        return [], "closed forms of windows hold for a base that moves as a sine"
    if forcing is None:
        return [], "closed forms are drawn where an axis is the forcing"
    other = axes[1 - axes.index(forcing)]
    along = _span(points.columns[other].values)
    known: dict[str, Array | float] = {}
    for name in SOURCES:
        value = along if name == other else _common(points, name)
        if value is None:
            return [], f"closed forms depend on {name}, which differs between the points"
        known[name] = value
    low, high = _range(points.columns[forcing].values)
    found = []
    for is_upper in (False, True):
        for mode in MODES:
            values = _end(mode, is_upper, forcing, base, known) * np.ones_like(along)
            if np.any((values > low) & (values < high)):
                pair = (along, values) if axes[1] == forcing else (values, along)
                found.append(WindowEnd(mode, is_upper, *pair))
    return found, "" if found else "no window of modes 1 to 3 ends in this range"


def _end(
    mode: int, is_upper: bool, forcing: str, base: str, known: Mapping[str, Array | float]
) -> Array:
    e, frequency, gravity = (np.asarray(known[name]) for name in SOURCES)
    if is_upper:
        amplitude = theory.amplitude_max(mode, e, frequency, gravity, base=base)
    else:
        amplitude = lower_end(mode, e, frequency, gravity, base)
    return np.asarray(amplitude * per_amplitude(forcing, e, frequency, gravity))


def _common(points: Points, name: str) -> float | None:
    """Value that all points share, or None."""
    if name not in points.columns:
        return points.base_choice.inputs.get(name)
    values = points.columns[name].values
    return float(values[0]) if np.ptp(values) == 0.0 else None


def _range(values: Array) -> tuple[float, float]:
    known = values[np.isfinite(values)]
    return float(known.min()), float(known.max())


def _span(values: Array) -> Array:
    return np.linspace(*_range(values), SAMPLES)
