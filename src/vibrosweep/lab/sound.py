"""Clicks of impacts in a sound file."""

from __future__ import annotations

import io
import warnings
from typing import Final

import numpy as np

from vibrosweep.arrays import Array

APART: Final = 0.02  # s, least time between two clicks
RISE: Final = 10.0  # dB by which a click stands above the noise and above what is before it
WINDOW: Final = 5e-4  # s over which loudness is averaged
ONSET: Final = 0.2  # share of the loudness of a click at which it begins


def clicks_of(content: bytes, source: str) -> tuple[Array, Array, float]:
    """Return times (s) and loudness of the clicks in a WAV file, and the step of its samples (s).

    A ValueError says why there are none.
    """
    from scipy.io import wavfile
    from scipy.ndimage import uniform_filter1d
    from scipy.signal import find_peaks

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks that hold no sound
            rate, samples = wavfile.read(io.BytesIO(content))
    except Exception as error:  # damaged files: its errors have no common base
        raise ValueError(f"{source}: is not a WAV file that can be read: {error}") from error
    if not (samples.size and rate > 0):
        raise ValueError(f"{source}: is a WAV file without a sound")
    sound = np.asarray(samples, np.float64).reshape(len(samples), -1).mean(axis=1)
    # differences, because hum and voices are lower than clicks
    width = max(int(WINDOW * rate), 1)
    change = np.abs(np.diff(sound, prepend=sound[:1]))
    loudness = uniform_filter1d(change, width)
    noise = max(float(np.median(loudness)), 1e-12 * float(loudness.max(initial=0.0)), 1e-300)
    level = 20.0 * np.log10(np.maximum(loudness, noise) / noise)
    places, _ = find_peaks(level, height=RISE, prominence=RISE, distance=max(int(APART * rate), 1))
    if len(places) < 2:
        raise ValueError(f"{source}: holds {len(places)} clicks; at least two are needed")
    onsets = []
    for place in places:
        begin = max(place - int(APART * rate) // 2, 0)
        loud = np.flatnonzero(loudness[begin : place + 1] >= ONSET * loudness[place])
        onsets.append(begin + loud[0])
    return np.array(onsets) / rate, loudness[places], 1.0 / rate
