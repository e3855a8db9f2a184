"""Heights of the bases of virtual experiments: at rest, oscillating, or recoiling on a mount."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from vibrosweep.arrays import Array
from vibrosweep.engine.coupled import BaseTrack
from vibrosweep.model.shapes import SINE, Waveform

STEPS_PER_PERIOD: Final = 1000


class Surface(NamedTuple):
    """Height of a base in m, and its integral over time in m s, as functions of time in s."""

    height: Callable[[Array], Array]
    area: Callable[[Array], Array]


LEVEL: Final = Surface(np.zeros_like, np.zeros_like)


def oscillating_surface(scene: Mapping[str, float], waveform: Waveform = SINE) -> Surface:
    """Make the surface of `base = "moving"`: y = (V0 / f) W(f t + phi / 2 pi).

    V0 is A / (1 + e).  A sine is -B cos(2 pi f t + phi) with 2 pi f B = V0.
    """
    frequency, phase = scene["frequency"], scene["phase"]
    omega = 2.0 * math.pi * frequency
    size = scene["amplitude"] / ((1.0 + scene["restitution"]) * omega)
    if waveform != SINE:
        unit = 2.0 * math.pi * size
        return Surface(
            lambda t: unit * waveform.height(frequency * t + phase / (2.0 * math.pi)),
            lambda t: unit / frequency * waveform.area(frequency * t + phase / (2.0 * math.pi)),
        )
    return Surface(
        lambda t: np.asarray(-size * np.cos(omega * t + phase)),
        lambda t: np.asarray(-size / omega * np.sin(omega * t + phase)),
    )


def recoiling_surface(track: BaseTrack, frequency: float, end: float) -> Surface:
    """Make the surface of `base = "sprung"`, exact at a thousand instants of each forcing period.

    `track` is the motion of the base in one realization from the first launch on, before which the
    base is taken to rest at its first height.  The surface extends to `end` (s).
    """
    begin = float(track.track.time[0, 0])
    time = begin + np.arange(int((end - begin) * frequency * STEPS_PER_PERIOD) + 2) / (
        frequency * STEPS_PER_PERIOD
    )
    spline = CubicHermiteSpline(time, *track.at(time))
    integral = spline.antiderivative()
    start = float(spline(begin))
    return Surface(
        lambda t: np.asarray(spline(np.maximum(t, begin))),
        lambda t: np.asarray(integral(np.maximum(t, begin)) + start * np.minimum(t - begin, 0.0)),
    )
