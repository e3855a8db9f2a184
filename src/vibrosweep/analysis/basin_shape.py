"""Measures of basins: intervals of their shares, entropies, the uncertainty exponent."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array

BOX: Final = 5  # launches along each side of a box
CONFIDENCE: Final = 0.95
STEPS: Final = (1, 2, 4, 8, 16)  # distances of the launches that are compared, along the axis
FEWEST: Final = 64  # values of an axis along which launches are compared
EVEN: Final = 1e-6  # largest relative difference between the steps of an even axis
SHAPE: Final = {
    "unsettled_fraction": "fraction of unsettled launches",
    "basin_entropy": f"mean entropy in boxes of {BOX} x {BOX} launches, nats",
    "boundary_entropy": f"mean entropy in boxes of {BOX} x {BOX} with several basins, nats",
    "uncertainty_exponent": (
        "slope of the logarithm of the share of launches with a neighbour of another basin"
    ),
    "uncertainty_exponent_error": "standard error of the slope",
}


def basin_measures(index: NDArray[np.int64], speeds: Array) -> dict[str, Any]:
    """Variables that measure how basins interlace.

    `index`, of shape (launch_velocity, launch_time), numbers the attractor of each launch.  It is
    negative for unsettled launches, which are left out of the entropies and of the exponent.
    Basin entropy: Daza et al. (2016), Scientific Reports 6, 31416; uncertainty exponent: McDonald
    et al. (1985), Physica D 17, 125.
    """
    values: tuple[float, ...] = (
        float(np.mean(index < 0)),
        *_entropies(index),
        *_exponent(index, speeds),
    )
    return {
        name: ((), value, {"units": "1", "long_name": words})
        for (name, words), value in zip(SHAPE.items(), values, strict=True)
    }


def share_interval(counts: NDArray[np.int64], total: int) -> dict[str, Array]:
    """Return the ends ``low`` and ``high`` of the 95 % intervals of shares of a total."""
    from scipy.stats import binomtest

    intervals = [
        binomtest(int(count), total).proportion_ci(CONFIDENCE, method="wilson")
        for count in counts.ravel()
    ]
    return {
        side: np.array([getattr(interval, side) for interval in intervals]).reshape(counts.shape)
        for side in ("low", "high")
    }


def _entropies(index: NDArray[np.int64]) -> tuple[float, float]:
    """Basin entropy, NaN if no box has a basin, and boundary entropy, NaN if no box has several."""
    rows, columns = (size // BOX * BOX for size in index.shape)
    cut = index[:rows, :columns].reshape(rows // BOX, BOX, columns // BOX, BOX)
    boxes = cut.transpose(0, 2, 1, 3).reshape(-1, BOX * BOX)
    counts = [np.unique(box[box >= 0], return_counts=True)[1] for box in boxes]
    entropy = np.array([-np.sum(k / k.sum() * np.log(k / k.sum())) for k in counts if k.size])
    mixed = entropy[[k.size > 1 for k in counts if k.size]]
    basin, boundary = (float(v.mean()) if v.size else np.nan for v in (entropy, mixed))
    return basin, boundary


def _exponent(index: NDArray[np.int64], speeds: Array) -> tuple[float, float]:
    """Uncertainty exponent along the speed of launch, with its standard error.

    A launch is uncertain at a distance if a neighbour that much faster or slower is in another
    basin.  The share of uncertain launches grows as a power of the distance, whose exponent this
    is.  NaN if the speeds are few or uneven, or no launch is uncertain at some distance.
    """
    from scipy.stats import linregress

    steps = np.diff(speeds)
    if speeds.size < FEWEST or np.ptp(steps) > EVEN * steps.mean():
        return np.nan, np.nan
    # with the same launches at every distance a straight boundary has exactly the exponent 1
    first, last = STEPS[-1], speeds.size - STEPS[-1]
    middle, shares = index[first:last], []
    for step in STEPS:
        up, down = index[first + step : last + step], index[first - step : last - step]
        known = (middle >= 0) & (up >= 0) & (down >= 0)
        differs = ((up != middle) | (down != middle)) & known
        shares.append(differs.sum() / max(1, known.sum()))
    if min(shares) == 0.0:
        return np.nan, np.nan
    line = linregress(np.log(STEPS), np.log(shares))
    return float(line.slope), float(line.stderr)
