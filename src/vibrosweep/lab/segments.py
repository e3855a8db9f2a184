"""Samples of tracks, cut at gaps, and the low points between flights."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from vibrosweep.arrays import Array, Indices

# Gaps of more frames may hide a whole flight: no landing is sought across them.
GAP_FRAMES: Final = 3.5
# Standard deviations of the noise by which a low point must lie below the samples on both sides: of
# a million samples near the top of a flight hardly one does so by chance.
PROMINENCE: Final = 5.0
# Largest height of a low point over that of the neighbouring flights: with four frames in a flight
# the lowest one can be at 0.44 of it.
LOW: Final = 0.5
# Frames between a landing and the frame nearest to it, which is therefore above the base.
LOW_QUANTILE: Final = 0.25


@dataclass(frozen=True)
class Samples:
    """Measured positions of all particles, particle after particle."""

    # time, height: s and m, shape (sample,)
    time: Array
    height: Array
    # frame, particle: indices in the table of tracks
    frame: Indices
    particle: Indices
    piece: Indices  # number of the uninterrupted piece of track; pieces are numbered in order

    @property
    def bounds(self) -> Indices:
        """Index of the first sample of each piece, and the number of samples; (piece + 1,)."""
        return np.searchsorted(self.piece, np.arange(self.piece[-1] + 2))


def samples_of(time: Array, height: Array, cuts: NDArray[np.bool_]) -> Samples:
    """Collect the measured positions, in pieces that end at long gaps and at cuts.

    Times rise.  Heights and cuts are of shape (frame, particle): NaN where a particle is not seen,
    and True where a flight cannot continue from the frame before.
    """
    particle, frame = np.nonzero(np.isfinite(height.T))
    when = time[frame]
    interval = float(np.median(np.diff(time)))
    passed = np.cumsum(cuts, axis=0)[frame, particle]
    new = (
        (np.diff(particle, prepend=-1) != 0)
        | (np.diff(when, prepend=-np.inf) > GAP_FRAMES * interval)
        | (np.diff(passed, prepend=0) != 0)
    )
    return Samples(when, height[frame, particle], frame, particle, np.cumsum(new) - 1)


def rough_noise(samples: Samples) -> float:
    """Noise of a position in m from third differences, before any flight is known.

    They vanish on a parabola, and are large across a landing; hence a low quantile is used.  If
    flights last few frames, the noise is too large by up to a factor of two.
    """
    third = np.abs(np.diff(samples.height, 3))[np.diff(samples.piece, 3) == 0]
    # quartile of the absolute value of a normal deviate, and norm of (1, -3, 3, -1)
    return float(np.quantile(third, 0.25)) / (0.3186 * np.sqrt(20.0)) if third.size else 0.0


def low_points(samples: Samples, noise: float, base: float | None) -> tuple[Indices, float]:
    """Indices of the lowest samples between flights, and the height of the base in m.

    If the height is not given, it is a first guess from the low points.  `noise` is the standard
    deviation of a position, m.
    """
    least = max(PROMINENCE * noise, 1e-6 * float(np.ptp(samples.height)))
    bounds = samples.bounds
    found = [
        first + find_peaks(-samples.height[first:last], prominence=least)[0]
        for first, last in pairwise(bounds)
    ]
    low = np.concatenate(found).astype(np.intp)
    if base is None:
        lowest = samples.height[low] if low.size else samples.height
        base = float(np.quantile(lowest, LOW_QUANTILE))
    # a point not well below the flights beside it is noise near a top
    edges = np.unique(np.concatenate([bounds[:-1], low]))
    tops = np.maximum.reduceat(samples.height, edges)
    place = np.searchsorted(edges, low)
    above = np.maximum(tops[place - 1], tops[place]) - base
    return low[samples.height[low] - base <= LOW * above + 2.0 * noise], base
