"""Linear regression of bounces: a scan for the frequency, and whether they determine parameters."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import chdtrc

from vibrosweep.arrays import Array

TURN: Final = 2.0 * np.pi
FEWEST: Final = 10  # bounces
# The frequency is first scanned on so many seconds of the recording, in steps of a quarter of the
# width that the minimum then has.
SCAN_SECONDS: Final = 10.0
SCAN_BOUNCES: Final = 1000
SUBHARMONICS: Final = (2, 3, 4, 5)
# Standard errors by which restitution may lie outside its range
UNPHYSICAL: Final = 3.0
# Probability of a chi-square that is as large, below which more than noise is in the residuals
IMPROBABLE: Final = 1e-3
LEAST_FREE: Final = 1e-3  # share of an equation that parameters leave, of one that determines them
NEAR: Final = 0.05  # Hz, many times the error of a part of a frequency that was found


def find_frequency(speeds: tuple[Array, Array, Array], between: tuple[float, float]) -> float:
    """Frequency in Hz at which the bounces obey the map best, by ordinary least squares.

    A scan of a stretch of the bounces, then a refinement on all of them.  The speeds of arrival and
    departure and the times are those of `Bounces.speeds`.
    """
    arrive, leave, time = speeds
    order = np.argsort(time)
    arrive, leave, time = arrive[order], leave[order], time[order]
    early = np.flatnonzero(time <= time[0] + SCAN_SECONDS)[:SCAN_BOUNCES]
    span = max(float(np.ptp(time[early])), 1e-9)
    steps = int((between[1] - between[0]) * 4.0 * span) + 2
    trial = np.linspace(*between, steps)
    misfit = np.concatenate(
        [
            _misfits(part, arrive[early], leave[early], time[early])
            for part in np.array_split(trial, steps // 256 + 1)
        ]
    )
    best, width = float(trial[np.argmin(misfit)]), float(trial[1] - trial[0])
    reach = span
    while True:  # a stretch twice as long halves the width of the minimum around the one found
        chosen = time <= time[0] + reach
        data = (arrive[chosen], leave[chosen], time[chosen])
        best = float(
            minimize_scalar(
                lambda f, data=data: float(_misfits(np.array([f]), *data)[0]),
                bounds=(best - width, best + width),
                method="bounded",
                options={"xatol": 1e-4 * width},
            ).x
        )
        if reach > time[-1] - time[0]:
            return best
        reach, width = 2.0 * reach, width / 2.0


def with_subharmonics(
    speeds: tuple[Array, Array, Array], between: tuple[float, float]
) -> list[float]:
    """Frequency in Hz as of `find_frequency`, and its parts down to a fifth in the range.

    On orbits that visit few phases a multiple of the frequency may describe the bounces better by
    ordinary least squares, which takes all errors for those of the departure.
    """
    best = find_frequency(speeds, between)
    parts = [best / k for k in SUBHARMONICS if best / k > between[0]]
    return [best, *(find_frequency(speeds, (f - NEAR, f + NEAR)) for f in parts)]


def outside(restitution: float, error: float) -> bool:
    """Whether a restitution lies outside its range, 0 to 1, by more than errors explain."""
    return max(-restitution, restitution - 1.0) > UNPHYSICAL * error


def is_improbable(misfit: float, freedom: int) -> bool:
    """Whether noise alone hardly makes a chi-square per degree of freedom so large."""
    return freedom > 0 and bool(chdtrc(freedom, misfit * freedom) < IMPROBABLE)


def spread_of_influences(residual: Array, slopes: Array, inverse: Array) -> Array:
    """Covariance of parameters as residuals show it, whatever their distribution.

    That of White with the correction HC3 (MacKinnon and White 1985, J. Econometrics 29, 305), which
    takes each equation for as uncertain as the others say that it is.  Residuals and slopes are
    whitened; `inverse` is the inverse of the normal equations.
    """
    leverage = np.einsum("ij,jk,ik->i", slopes, inverse, slopes)
    left = residual / np.maximum(1.0 - leverage, LEAST_FREE)
    influence = slopes @ inverse * left[:, np.newaxis]
    return np.asarray(influence.T @ influence)


def _misfits(frequency: Array, arrive: Array, leave: Array, time: Array) -> Array:
    """Sum of squares left by the best e, S and C at each frequency."""
    angle = TURN * frequency[:, np.newaxis] * time
    design = np.stack([np.broadcast_to(arrive, angle.shape), np.sin(angle), np.cos(angle)], axis=-1)
    normal = np.einsum("fni,fnj->fij", design, design)
    right = np.einsum("fni,n->fi", design, leave)
    # a small ridge: at some frequencies the columns are the same
    normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, np.newaxis, np.newaxis] * np.eye(3)
    found = np.linalg.solve(normal, right[..., np.newaxis])[..., 0]
    return np.asarray(leave @ leave - np.einsum("fi,fi->f", right, found))


def weakest_signal(
    arrive: Array, angle: Array, amplitude: float, blurs: tuple[float, float]
) -> float:
    """Signal in the direction of the design matrix that varies least, in units of its noise.

    All bounces of a locked orbit are the same but for the errors of the instants: however many are
    measured, two of the three parameters remain undetermined.  Speeds of arrival (m s-1) and phases
    (rad) of bounces have the variances `blurs`.
    """
    amplitude = max(amplitude, 1e-300)
    design = np.stack([arrive, amplitude * np.sin(angle), amplitude * np.cos(angle)], axis=1)
    weakest = float(np.linalg.eigvalsh(design.T @ design / angle.size)[0])
    return weakest / (blurs[0] + amplitude**2 * blurs[1])
