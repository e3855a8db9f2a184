"""How wide basins are, and how they interlace: intervals, entropies, the uncertainty exponent."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.model.status import Regime

BOX: Final = 5  # launches along each side of a box
CONFIDENCE: Final = 0.95
STEPS: Final = (1, 2, 4, 8, 16)  # of the axis, to launches that are compared
FEWEST: Final = 64  # values of an axis along which they are
EVEN: Final = 1e-6  # relative difference of the steps of an axis


def basin_measures(
    index: NDArray[np.int64], regime: NDArray[Any], count: NDArray[np.int64], speeds: Array
) -> dict[str, Any]:
    """Variables that tell how wide basins are and how they interlace.

    `index` of launches, shape (launch_velocity, launch_time), is into regimes and counts of shape
    (attractor,).  Unsettled launches have reached no attractor: they are left out of the entropies
    and of the exponent.  Basin entropy: Daza et al. (2016), Scientific Reports 6, 31416; the
    uncertainty exponent: McDonald et al. (1985), Physica D 17, 125.
    """
    from scipy.stats import binomtest

    settled = regime != Regime.UNSETTLED
    total = int(count.sum())
    ends = [
        binomtest(int(one), total).proportion_ci(CONFIDENCE, method="wilson") if known else None
        for one, known in zip(count, settled, strict=True)
    ]
    found: dict[str, Any] = {}
    for side in ("low", "high"):
        values = np.array([np.nan if one is None else getattr(one, side) for one in ends])
        words = f"{side} end of the Wilson 95 % interval of the fraction of launches"
        told = {"units": "1", "long_name": words, "comment": "NaN of unsettled launches"}
        found[f"fraction_{side}"] = ("attractor", values, told)
    whole, border = _entropies(np.where(settled[index], index, -1))
    exponent, error = _exponent(np.where(settled[index], index, -1), speeds)
    scalars = {
        "unsettled_fraction": (count[~settled].sum() / total, "fraction of unsettled launches"),
        "basin_entropy": (
            whole,
            f"mean entropy in boxes of {BOX} x {BOX} launches, nats",
        ),
        "boundary_entropy": (border, "the same over boxes with several basins"),
        "uncertainty_exponent": (
            exponent,
            "slope of the logarithm of the share of launches with a neighbour of another basin",
        ),
        "uncertainty_exponent_error": (error, "standard error of the slope"),
    }
    for name, (value, words) in scalars.items():
        found[name] = ((), float(value), {"units": "1", "long_name": words})
    return found


def _entropies(index: NDArray[np.int64]) -> tuple[float, float]:
    """Basin entropy and boundary entropy, from whole boxes; NaN without any."""
    rows, columns = (size // BOX * BOX for size in index.shape)
    cut = index[:rows, :columns].reshape(rows // BOX, BOX, columns // BOX, BOX)
    boxes = cut.transpose(0, 2, 1, 3).reshape(-1, BOX * BOX)
    kinds = [np.unique(box[box >= 0], return_counts=True)[1] for box in boxes]
    own = np.array([-np.sum(k / k.sum() * np.log(k / k.sum())) for k in kinds if k.size])
    mixed = own[[k.size > 1 for k in kinds if k.size]]
    return (float(v.mean()) if v.size else np.nan for v in (own, mixed))  # type: ignore[return-value]


def _exponent(index: NDArray[np.int64], speeds: Array) -> tuple[float, float]:
    """Uncertainty exponent along the speed of launch, with its standard error.

    The share of launches one of whose two neighbours, some steps up and down, is of another basin
    grows with the distance to that power.  NaN along few or uneven speeds, or without a boundary.
    """
    from scipy.stats import linregress

    steps = np.diff(speeds)
    if speeds.size < FEWEST or np.ptp(steps) > EVEN * steps.mean():
        return np.nan, np.nan
    # the same launches at every distance, so that a straight boundary has exactly the exponent 1
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
