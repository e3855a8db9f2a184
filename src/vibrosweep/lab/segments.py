"""Samples of tracks, cut at gaps, and the low points between flights."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from vibrosweep.arrays import Array, Indices

# Length in frames above which a gap may hide a whole flight, so that no landing is sought across it
GAP_FRAMES: Final = 3.5
# Standard deviations of the noise by which a low point must lie below the samples on both sides;
# hardly one in a million samples near the top of a flight does so by chance
PROMINENCE: Final = 5.0
# Largest height of a low point relative to the higher of the neighbouring flights; with four frames
# in a flight the lowest can be at 0.44
LOW: Final = 0.5
# Quantile of the heights of low points that estimates the base: the frame nearest to a landing is
# up to half a frame from it, and above the base.
LOW_QUANTILE: Final = 0.25


@dataclass(frozen=True)
class Samples:
    """Measured positions of all particles, particle after particle."""

    # time, height: in s and m; all arrays have the shape (sample,)
    time: Array
    height: Array
    # frame, particle: indices in the table of tracks
    frame: Indices
    particle: Indices
    piece: Indices  # number of the uninterrupted piece of track, rising

    @property
    def bounds(self) -> Indices:
        """Index of the first sample of each piece, then the number of samples; (piece + 1,)."""
        return np.searchsorted(self.piece, np.arange(self.piece[-1] + 2))


def samples_of(time: Array, height: Array, cuts: NDArray[np.bool_]) -> Samples:
    """Collect the measured positions, in pieces that end at long gaps and at cuts.

    Times rise.  Heights and cuts have the shape (frame, particle): a height is NaN where a particle
    is not seen, a cut is True where no flight continues from the previous frame.
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
    """Estimate the noise of a position in m from third differences, before any flight is known.

    These are zero on a parabola and large across a landing, so that a low quantile is used.  If
    flights last few frames, the estimate is too large by up to a factor of two.
    """
    third = np.abs(np.diff(samples.height, 3))[np.diff(samples.piece, 3) == 0]
    # quartile of the absolute value of a normal deviate, and norm of (1, -3, 3, -1)
    return float(np.quantile(third, 0.25)) / (0.3186 * np.sqrt(20.0)) if third.size else 0.0


def low_points(samples: Samples, noise: float, base: float | None) -> tuple[Indices, float]:
    """Find the lowest samples between flights, and the height of the base in m.

    The height is estimated from the low points if `base` is None.  `noise` is the standard
    deviation of a position (m).
    """
    least = max(PROMINENCE * noise, 1e-6 * float(np.ptp(samples.height)))
    bounds = samples.bounds
    found = [
        begin + find_peaks(-samples.height[begin:end], prominence=least)[0]
        for begin, end in pairwise(bounds)
    ]
    low = np.concatenate(found).astype(np.intp)
    if base is None:
        lowest = samples.height[low] if low.size else samples.height
        base = float(np.quantile(lowest, LOW_QUANTILE))
    # a point that is not well below the flights beside it is noise near an apex
    edges = np.unique(np.concatenate([bounds[:-1], low]))
    tops = np.maximum.reduceat(samples.height, edges)
    place = np.searchsorted(edges, low)
    above = np.maximum(tops[place - 1], tops[place]) - base
    return low[samples.height[low] - base <= LOW * above + 2.0 * noise], base
