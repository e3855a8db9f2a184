"""Linear regression of bounces: search for the frequency, tests of residuals and of the signal."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import chdtrc

from vibrosweep.arrays import Array

TWO_PI: Final = 2.0 * np.pi
FEWEST: Final = 10  # bounces that an estimate needs
# Largest length of the recording, in s, and number of bounces, for which the frequency is scanned;
# the step is a quarter of the width of the minimum.
SCAN_SECONDS: Final = 10.0
SCAN_BOUNCES: Final = 1000
SUBHARMONICS: Final = (2, 3, 4, 5)
# Standard errors by which a restitution may lie outside its range
UNPHYSICAL: Final = 3.0
# Standard deviations by which the mean difference of squared distances must differ from zero: with
# independent data that favour neither model, one recording in 370 would be decided.
DECIDED: Final = 3.0
# Probability of a larger chi-square below which noise does not explain the residuals
IMPROBABLE: Final = 1e-3
LEAST_FREE: Final = 1e-3  # smallest value that is taken for 1 minus the leverage of an equation
NEAR: Final = 0.05  # Hz, many times the error of a submultiple of the frequency


class Speeds(NamedTuple):
    """Speeds and times of bounces, arrays of shape (bounce,)."""

    # arrive, leave: speeds before and after the bounce, m s-1
    arrive: Array
    leave: Array
    time: Array  # s


def find_frequency(speeds: Speeds, between: tuple[float, float]) -> float:
    """Find the frequency (Hz) at which the bounces obey the map best, by ordinary least squares.

    A scan with the earliest bounces finds the minimum, which is refined with more and more of them.
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
    while True:  # twice the length halves the width of the minimum
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
    """Find the frequency (Hz) as `find_frequency` does, and its submultiples down to a fifth.

    On orbits that visit few phases, a multiple of the frequency may be the better fit by ordinary
    least squares, which assigns all errors to the departure.
    """
    best = find_frequency(speeds, between)
    parts = [best / k for k in SUBHARMONICS if best / k > between[0]]
    return [best, *(find_frequency(speeds, (f - NEAR, f + NEAR)) for f in parts)]


def is_unphysical(values: Array, covariance: Array) -> bool:
    """Return whether the restitution, the first value, is significantly below 0 or above 1."""
    error = float(np.sqrt(covariance[0, 0]))
    return bool(max(-values[0], values[0] - 1.0) > UNPHYSICAL * error)


def is_nearer(distance: Array, other: Array, price: float = 0.0) -> bool:
    """Return whether data are significantly nearer to the first of two models.

    The mean difference of the squared distances is tested against its scatter (Vuong 1989,
    Econometrica 57, 307), so that a few odd data decide nothing.  `price` is added to the squared
    distances from the other model, for its additional parameters.
    """
    gain = other - distance
    scatter = float(np.sqrt(np.sum((gain - gain.mean()) ** 2)))
    return bool(gain.sum() + price > DECIDED * scatter)


def is_improbable(misfit: float, freedom: int) -> bool:
    """Return whether a chi-square per degree of freedom is too large to be due to noise."""
    return freedom > 0 and bool(chdtrc(freedom, misfit * freedom) < IMPROBABLE)


def widen(covariance: Array, misfit: float, freedom: int, influences: Array) -> Array:
    """Widen the covariance of parameters by the chi-square per degree of freedom of their fit.

    A misfit above 1 multiplies it; if noise hardly explains the misfit, the `influences`, those of
    `spread_of_influences`, are added.
    """
    wider = covariance * max(1.0, misfit)
    return wider + influences if is_improbable(misfit, freedom) else wider


def spread_of_influences(residual: Array, slopes: Array, inverse: Array) -> Array:
    """Estimate the covariance of parameters from residuals, whatever their distribution.

    It is that of White with the correction HC3 (MacKinnon and White 1985, J. Econometrics 29, 305):
    the error of each equation is estimated by its residual from a fit to the others.  Residuals and
    slopes are whitened; `inverse` is the inverse of the normal equations.
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
    # a small ridge, because the columns are linearly dependent at some frequencies
    normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, np.newaxis, np.newaxis] * np.eye(3)
    found = np.linalg.solve(normal, right[..., np.newaxis])[..., 0]
    return np.asarray(leave @ leave - np.einsum("fi,fi->f", right, found))


def weakest_signal(
    arrive: Array, angle: Array, amplitude: float, speed_variance: float, phase_variance: float
) -> float:
    """Signal in units of the noise, in the direction of the design matrix that varies least.

    All bounces of a locked orbit are equal apart from errors of the instants, so that any number of
    them leaves two of the three parameters undetermined.  The errors of the speeds of arrival (m
    s-1) and of the phases (rad) of bounces have the variances `speed_variance` and
    `phase_variance`.
    """
    amplitude = max(amplitude, 1e-300)
    design = np.stack([arrive, amplitude * np.sin(angle), amplitude * np.cos(angle)], axis=1)
    weakest = float(np.linalg.eigvalsh(design.T @ design / angle.size)[0])
    return weakest / (speed_variance + amplitude**2 * phase_variance)
