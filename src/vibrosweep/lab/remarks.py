"""Warnings that landings do not determine parameters, or that no parameters describe them."""

from __future__ import annotations

from typing import Final

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.lab.regression import is_improbable

# Parameters are not determined if the signal in the weakest direction of the design matrix is below
# this multiple of the noise of the instants, or if the standard error of the restitution or the
# relative one of the amplitude exceeds its limit.
SIGNAL: Final = 10.0
WORST_RESTITUTION: Final = 0.1
WORST_AMPLITUDE: Final = 0.25
# Chi-square per degree of freedom above which the law does not describe the bounces
WORST_MISFIT: Final = 10.0


def why_undetermined(signal: float, values: Array, covariance: Array, misfit: float) -> str:
    """Return a warning that says why parameters are not determined; empty if they are."""
    error = np.sqrt(np.diag(covariance))
    if signal < SIGNAL:
        return (
            "the orbit does not determine restitution and amplitude: all bounces happen at nearly "
            "the same phases and speeds, as those of a locked orbit do; change the frequency or "
            "the amplitude, or film the approach to the orbit"
        )
    if not 0.0 <= values[0] <= 1.0:
        return (
            f"the restitution comes out as {values[0]:.4g} ± {error[0]:.2g}, where 0 to 1 is "
            f"possible: the landings do not determine it; check the scale, the frequency, and "
            f"whether the base moves, or film faster or closer"
        )
    if misfit > WORST_MISFIT:
        return (
            f"no restitution and forcing describe the bounces: misfit {misfit:.3g} where noise "
            f"alone makes about 1; check the frequency, and whether the base moves; if its motion "
            f"is no sine, give its trace or the track of a mark on it"
        )
    if error[0] > WORST_RESTITUTION or error[1] > WORST_AMPLITUDE * values[1]:
        return "restitution and amplitude are hardly determined: film for longer, or closer"
    return ""


def misfit_warning(misfit: float, freedom: int) -> str:
    """Return a warning that noise does not explain the residuals; empty if it does."""
    if not is_improbable(misfit, freedom):
        return ""
    return (
        f"the bounces scatter more than the noise of the tracks explains (misfit {misfit:.3g}, "
        f"where about 1 is expected): the errors are widened; look for bounces too low to be seen"
    )
