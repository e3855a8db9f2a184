"""Linear regression of bounces: scan for the frequency, tests of residuals and of the signal."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import chdtrc

from vibrosweep.arrays import Array

TWO_PI: Final = 2.0 * np.pi
FEWEST: Final = 10  # bounces
# Seconds of the recording on which the frequency is first scanned; the step is a quarter of the
# width of the minimum there.
SCAN_SECONDS: Final = 10.0
SCAN_BOUNCES: Final = 1000
SUBHARMONICS: Final = (2, 3, 4, 5)
# Standard errors by which a restitution may lie outside its range
UNPHYSICAL: Final = 3.0
# Standard deviations by which the mean difference of squared distances must differ from zero: with
# independent data that favour neither model, one recording in 370 would be decided.
DECIDED: Final = 3.0
# Probability of a larger chi-square, below which noise does not explain the residuals
IMPROBABLE: Final = 1e-3
LEAST_FREE: Final = 1e-3  # least share of an equation that the fitted parameters leave free
NEAR: Final = 0.05  # Hz, many times the error of a submultiple of a frequency


class Speeds(NamedTuple):
    """Bounces, each array of shape (bounce,)."""

    # arrive, leave: speeds before and after it, m s-1
    arrive: Array
    leave: Array
    time: Array  # s


def find_frequency(speeds: Speeds, between: tuple[float, float]) -> float:
    """Frequency in Hz at which the bounces obey the map best, by ordinary least squares.

    It is found by a scan of some bounces and refined on all of them.
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
    while True:  # twice as many seconds halve the width of the minimum
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


def with_subharmonics(speeds: Speeds, between: tuple[float, float]) -> list[float]:
    """Frequency (Hz) of `find_frequency`, and its submultiples down to a fifth in the range.

    On orbits that visit few phases a multiple of the frequency may describe the bounces better by
    ordinary least squares, which assigns all errors to the departure.
    """
    best = find_frequency(speeds, between)
    parts = [best / k for k in SUBHARMONICS if best / k > between[0]]
    return [best, *(find_frequency(speeds, (f - NEAR, f + NEAR)) for f in parts)]


def is_unphysical(values: Array, covariance: Array) -> bool:
    """Return whether a restitution, the first value, is outside 0 to 1 by more than its error."""
    error = float(np.sqrt(covariance[0, 0]))
    return bool(max(-values[0], values[0] - 1.0) > UNPHYSICAL * error)


def is_nearer(first: Array, other: Array, price: float = 0.0) -> bool:
    """Return whether data are nearer to one model than to another, by their squared distances.

    The mean difference is tested against its scatter (Vuong 1989, Econometrica 57, 307), so that a
    few odd data decide nothing; `price` is what the other model has to pay for more parameters.
    """
    gain = other - first
    scatter = float(np.sqrt(np.sum((gain - gain.mean()) ** 2)))
    return bool(gain.sum() + price > DECIDED * scatter)


def is_improbable(misfit: float, freedom: int) -> bool:
    """Return whether a chi-square per degree of freedom is too large to be due to noise."""
    return freedom > 0 and bool(chdtrc(freedom, misfit * freedom) < IMPROBABLE)


def widen(covariance: Array, misfit: float, freedom: int, influences: Array) -> Array:
    """Covariance of parameters by a fit with this chi-square per degree of freedom.

    A misfit above 1 multiplies it; if noise is an improbable explanation, the `influences` of
    `spread_of_influences` are added.
    """
    wider = covariance * max(1.0, misfit)
    return wider + influences if is_improbable(misfit, freedom) else wider


def spread_of_influences(residual: Array, slopes: Array, inverse: Array) -> Array:
    """Covariance of parameters from the scatter of residuals of any distribution.

    It is that of White with the correction HC3 (MacKinnon and White 1985, J. Econometrics 29, 305):
    the uncertainty of each equation is its residual from a fit to the others.  Residuals and slopes
    are whitened; `inverse` is the inverse of the normal equations.
    """
    leverage = np.einsum("ij,jk,ik->i", slopes, inverse, slopes)
    left = residual / np.maximum(1.0 - leverage, LEAST_FREE)
    influence = slopes @ inverse * left[:, np.newaxis]
    return np.asarray(influence.T @ influence)


def _misfits(frequency: Array, arrive: Array, leave: Array, time: Array) -> Array:
    """Residual sum of squares of the best e, S and C at each frequency."""
    angle = TWO_PI * frequency[:, np.newaxis] * time
    design = np.stack([np.broadcast_to(arrive, angle.shape), np.sin(angle), np.cos(angle)], axis=-1)
    normal = np.einsum("fni,fnj->fij", design, design)
    right = np.einsum("fni,n->fi", design, leave)
    # a small ridge, because at some frequencies the columns are equal
    normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, np.newaxis, np.newaxis] * np.eye(3)
    found = np.linalg.solve(normal, right[..., np.newaxis])[..., 0]
    return np.asarray(leave @ leave - np.einsum("fi,fi->f", right, found))


def weakest_signal(
    arrive: Array, angle: Array, amplitude: float, blurs: tuple[float, float]
) -> float:
    """Signal in the direction of the design matrix that varies least, in units of its noise.

    All bounces of a locked orbit are equal apart from errors of the instants: any number of them
    leaves two of the three parameters undetermined.  Speeds of arrival (m s-1) and phases (rad) of
    bounces have the variances `blurs`.
    """
    amplitude = max(amplitude, 1e-300)
    design = np.stack([arrive, amplitude * np.sin(angle), amplitude * np.cos(angle)], axis=1)
    weakest = float(np.linalg.eigvalsh(design.T @ design / angle.size)[0])
    return weakest / (blurs[0] + amplitude**2 * blurs[1])
