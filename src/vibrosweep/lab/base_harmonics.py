"""Amplitudes and phases of the harmonics of a base, from the factors of their sines and cosines.

The harmonic that is strongest in the velocity has the weight 1 and the phase 0: V0 and phi are its
amplitude and phase, as they are for a sine alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.model.shapes import HARMONICS_NAME, SINE, Waveform

STEP: Final = 1e-5  # step of weights and phases in finite differences


def polar(
    values: Array, covariance: Array, numbers: Sequence[int] = (1,)
) -> tuple[Array, Array, Waveform]:
    """Transform e, S, C, f, ... with their covariance to e, V0, phi, f, ...; add the waveform.

    Without other harmonics f may be missing.  S and C of each of the other `numbers` follow f, and
    become the weight and the phase psi of that harmonic.
    """
    s, c = values[1:3]
    amplitude = float(np.hypot(s, c))
    change = np.eye(values.size)
    change[1, 1:3] = s / amplitude, c / amplitude
    change[2, 1:3] = np.array([-c / amplitude**2, s / amplitude**2]) / numbers[0]
    plain = values.copy()
    plain[1:3] = amplitude, np.arctan2(c, s) / numbers[0]
    tones = [(numbers[0], 1.0, 0.0)]
    for k, h in enumerate(numbers[1:]):
        s, c = values[4 + 2 * k : 6 + 2 * k]
        size, pair = float(np.hypot(s, c)), slice(4 + 2 * k, 6 + 2 * k)
        psi = float(np.arctan2(c, s) - h * plain[2])
        psi -= 2.0 * np.pi * np.rint(psi / (2.0 * np.pi))
        change[pair, pair] = (
            np.array([[s / amplitude, c / amplitude], [-c / size, s / size]]) / size
        )
        change[pair.start, 1:3] = -size / amplitude**2 * change[1, 1:3]
        change[pair.start + 1, 1:3] = -h * change[2, 1:3]
        plain[pair] = size / amplitude, psi
        tones.append((h, float(plain[pair.start]), psi))
    shape = SINE if len(tones) == 1 and numbers[0] == 1 else _waveform(tones)
    return plain, change @ covariance @ change.T, shape


def _waveform(tones: Sequence[tuple[int, float, float]]) -> Waveform:
    return Waveform(HARMONICS_NAME, tuple(sorted(tones)))


def with_values(shape: Waveform, values: Mapping[str, float]) -> Waveform:
    """Return the waveform with other weights and phases, named as in `names_of`."""
    tones = [
        (h, values.get(f"weight_{h}", weight), values.get(f"phase_{h}", psi))
        for h, weight, psi in shape.tones
    ]
    return _waveform(tones) if tones else shape


def names_of(numbers: Sequence[int]) -> list[str]:
    """Names of the weights and phases of all harmonics but the first, the strongest."""
    return [f"{name}_{h}" for h in numbers[1:] for name in ("weight", "phase")]


def slopes_of_sizes(shape: Waveform, numbers: Sequence[int]) -> Array:
    """Derivatives of ln(B f / V0) and ln(Gamma g / (f V0)) by the parameters of `names_of`."""

    def sizes(waveform: Waveform) -> Array:
        return np.log([1.0 / waveform.per_displacement, waveform.fall])

    values = {f"weight_{h}": weight for h, weight, _ in shape.tones}
    values |= {f"phase_{h}": psi for h, _, psi in shape.tones}
    columns = []
    for name in names_of(numbers):
        up, down = (sizes(with_values(shape, {name: values[name] + s})) for s in (STEP, -STEP))
        columns.append((up - down) / (2.0 * STEP))
    return np.array(columns).reshape(-1, 2).T
