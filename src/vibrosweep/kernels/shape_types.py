"""Shapes of waveforms as kernels take them, and their motion."""

from __future__ import annotations

import functools

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.kernels.harmonics import Harmonics
from vibrosweep.kernels.rounding import HALF_ULP
from vibrosweep.kernels.sine import waves
from vibrosweep.kernels.waveforms import Parabolic, Shape, Sine
from vibrosweep.model.shapes import (
    HARMONICS_NAME,
    PARABOLIC_NAME,
    SINE_NAME,
    TWO_PI,
    Waveform,
    zeros,
)
from vibrosweep.model.turns import turns_of_radians


def motion(waveform: Waveform, turns: Array) -> tuple[Array, Array]:
    """Velocity w of a shape and 2 pi times its height W, at phases in turns."""
    if waveform.name == PARABOLIC_NAME:
        return waveform.velocity(turns), TWO_PI * waveform.height(turns)
    turns = turns - np.rint(turns)
    velocities: list[Array] = []
    levels: list[Array] = []
    for h, weight, phase in waveform.harmonics:
        angle = h * turns + turns_of_radians(np.asarray(phase))
        sines, cosines = np.empty_like(turns), np.empty_like(turns)
        waves(np.ravel(angle), sines.ravel(), cosines.ravel())
        velocities.append(weight * sines)
        levels.append(-weight / h * cosines)
    return sum(velocities[1:], velocities[0]), sum(levels[1:], levels[0])


@functools.lru_cache(maxsize=64)
def shape_of(waveform: Waveform) -> Shape:
    """Return the shape that kernels are compiled for."""
    if waveform.name != HARMONICS_NAME:
        return {SINE_NAME: Sine, PARABOLIC_NAME: Parabolic}[waveform.name]()
    most = max(h for h, _, _ in waveform.tones)
    weight, phase = np.zeros(most), np.zeros(most)
    for h, c, psi in waveform.tones:
        weight[h - 1], phase[h - 1] = c, psi
    sines, cosines = np.empty(most), np.empty(most)
    waves(turns_of_radians(phase), sines, cosines)
    p, q = weight * cosines, weight * sines
    number = np.arange(1.0, most + 1.0)
    size = np.abs(p) + np.abs(q)
    # (5.3 h^2 + h + 4.5) half ulps in the sum, 9 of a coefficient
    rounding = HALF_ULP * float(np.sum(size * (6.0 * number**2 + number + 14.0)))
    sloped = HALF_ULP * float(np.sum(size * number * (6.0 * number**2 + number + 16.0)))
    turns = zeros(waveform, 1)
    valleys = np.concatenate([[turns[-1] - 1.0], turns[:-1]])
    rises = waveform.slope(0.5 * (valleys + turns)) > 0.0
    rises &= waveform.velocity(turns) > 0.0
    bends = zeros(waveform, 2)
    around = np.concatenate([[bends[-1] - 1.0], bends, [bends[0] + 1.0]])
    places = np.append(np.sort(np.where(turns < 0.0, turns + 1.0, turns)), 1.0)
    extremes, _ = motion(waveform, places)
    dips = (waveform.slope(bends) < waveform.slope(around[:-2])) & (waveform.slope(bends) < 0.0)
    levels = waveform.height(zeros(waveform, 0))
    return Harmonics(
        tuple(p.tolist()),
        tuple(q.tolist()),
        tuple(valleys[rises].tolist()),
        tuple(turns[rises].tolist()),
        tuple(places.tolist()),
        tuple(extremes.tolist()),
        tuple(bends[dips].tolist()),
        tuple(around[:-2][dips].tolist()),
        tuple(around[2:][dips].tolist()),
        waveform.highest,
        -float(extremes.min()),
        float(np.abs(waveform.velocity(turns)).max()),
        waveform.fall,
        float(np.abs(waveform.slope(bends)).max()),
        float(levels.max()),
        float(levels.min()),
        rounding,
        TWO_PI * sloped,
        0.5005 * waveform.sum_of(2),
    )
