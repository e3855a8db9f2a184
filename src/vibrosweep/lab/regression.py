"""Linear regression of bounces: search for the frequency, tests of residuals and of the signal."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import chdtrc

from vibrosweep.arrays import Array, Flags, Indices

TWO_PI: Final = 2.0 * np.pi
FEWEST: Final = 10  # bounces that an estimate needs
# Most seconds of a recording, and most bounces, with which the frequency is scanned; the step is a
# quarter of the width of the minimum.
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

    def take(self, chosen: Flags | Indices) -> Speeds:
        """Return the chosen bounces."""
        return Speeds._make(values[chosen] for values in self)


def find_frequency(speeds: Speeds, between: tuple[float, float]) -> float:
    """Find the frequency (Hz) at which the bounces obey the map best, by ordinary least squares.

    A scan with the earliest bounces finds the minimum, which is refined with more and more of them.
    """
    speeds = speeds.take(np.argsort(speeds.time))
    since = speeds.time - speeds.time[0]
    early = speeds.take(np.flatnonzero(since <= SCAN_SECONDS)[:SCAN_BOUNCES])
    span = max(float(np.ptp(early.time)), 1e-9)
    steps = int((between[1] - between[0]) * 4.0 * span) + 2
    trial = np.linspace(*between, steps)
    misfit = [_misfits(part, early) for part in np.array_split(trial, steps // 256 + 1)]
    best, width = float(trial[np.argmin(np.concatenate(misfit))]), float(trial[1] - trial[0])
    reach = span
    while True:  # twice the length halves the width of the minimum
        used = speeds.take(since <= reach)
        best = float(
            minimize_scalar(
                lambda f, used=used: float(_misfits(np.array([f]), used)[0]),
                bounds=(best - width, best + width),
                method="bounded",
                options={"xatol": 1e-4 * width},
            ).x
        )
        if reach > since[-1]:
            return best
        reach, width = 2.0 * reach, width / 2.0


def frequencies_to_try(
    speeds: Speeds, known: float | None, between: tuple[float, float]
) -> list[float]:
    """Return the known frequency (Hz), or that of `find_frequency` and its submultiples.

    On orbits that visit few phases, a multiple of the frequency may be the better fit by ordinary
    least squares, which assigns all errors to the departure.
    """
    if known is not None:
        return [known]
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


def _misfits(frequency: Array, speeds: Speeds) -> Array:
    """Residual sum of squares of the best e, S and C at each frequency."""
    design, leave = _design(speeds, frequency), speeds.leave
    normal = np.einsum("fni,fnj->fij", design, design)
    right = np.einsum("fni,n->fi", design, leave)
    # a small ridge, because the columns are linearly dependent at some frequencies
    normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, np.newaxis, np.newaxis] * np.eye(3)
    found = np.linalg.solve(normal, right[..., np.newaxis])[..., 0]
    return np.asarray(leave @ leave - np.einsum("fi,fi->f", right, found))


def _design(speeds: Speeds, frequency: float | Array) -> Array:
    """Columns v, sin 2 pi f t and cos 2 pi f t, shape (bounce, 3), for each frequency."""
    angle = np.multiply.outer(TWO_PI * np.asarray(frequency), speeds.time)
    arrive = np.broadcast_to(speeds.arrive, angle.shape)
    return np.stack([arrive, np.sin(angle), np.cos(angle)], axis=-1)


def ordinary_least_squares(speeds: Speeds, frequency: float) -> Array:
    """Fit e, S and C of v' = e v + S sin 2 pi f t + C cos 2 pi f t by ordinary least squares."""
    return np.asarray(np.linalg.lstsq(_design(speeds, frequency), speeds.leave, rcond=1e-9)[0])


def weakest_signal(
    speeds: Speeds, frequency: float, kick: Array, speed_variance: Array, time_variance: Array
) -> float:
    """Signal in units of the noise, in the direction of the design matrix that varies least.

    All bounces of a locked orbit are equal apart from errors of the instants, so that any number of
    them leaves two of the three parameters undetermined.  `kick` holds S and C (m s-1); the
    variances are those of the speed of arrival and of the time of each bounce.
    """
    amplitude = max(float(np.hypot(*kick)), 1e-300)
    design = _design(speeds, frequency) * [1.0, amplitude, amplitude]
    weakest = float(np.linalg.eigvalsh(design.T @ design / speeds.time.size)[0])
    turning = TWO_PI * frequency * amplitude
    return weakest / float(speed_variance.mean() + turning**2 * time_variance.mean())
