"""Linear regression of bounces, and laws of restitution compatible with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from scipy.optimize import minimize_scalar
from scipy.special import chdtrc

from vibrosweep.arrays import Array, Flags, Indices
from vibrosweep.lab.variables import with_error, with_units
from vibrosweep.model.restitution_laws import (
    CONSTANT,
    LEAST_VISCOELASTIC,
    PLASTIC,
    VISCOELASTIC,
    restitution_at,
)

# -----------------------------------------------------------------------------
# Linear regression of bounces: search for the frequency, tests of residuals and of the signal.

TWO_PI: Final = 2.0 * np.pi
FEWEST: Final = 10  # bounces that an estimate needs
# Longest time (s) and largest number of bounces of the frequency scan; its step is a quarter of the
# width of the minimum.
SCAN_SECONDS: Final = 10.0
SCAN_BOUNCES: Final = 1000
SUBHARMONICS: Final = (2, 3, 4, 5)
MINIMA: Final = 5  # number of frequencies of the scan that are tried
# Standard errors by which a restitution may exceed its range
UNPHYSICAL: Final = 3.0
# Threshold of Vuong's test in standard deviations: with independent data that favour neither model,
# one recording in 370 would be decided.
DECIDED: Final = 3.0
# p-value of chi-square below which noise does not explain the residuals
IMPROBABLE: Final = 1e-3
LEAST_FREE: Final = 1e-3  # lower bound on 1 minus the leverage of an equation
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


def find_frequencies(speeds: Speeds, between: tuple[float, float], most: int = 1) -> list[float]:
    """Find frequencies (Hz) at which the map fits the bounces, the best one first.

    By ordinary least squares: a scan with the earliest bounces finds the `most` lowest minima, and
    longer and longer stretches refine them.
    """
    speeds = speeds.take(np.argsort(speeds.time))
    since = speeds.time - speeds.time[0]
    early = speeds.take(np.flatnonzero(since <= SCAN_SECONDS)[:SCAN_BOUNCES])
    span = max(float(np.ptp(early.time)), 1e-9)
    steps = int((between[1] - between[0]) * 4.0 * span) + 2
    trial = np.linspace(*between, steps)
    parts = np.array_split(trial, steps // 256 + 1)
    misfit = np.concatenate([_misfits(part, early) for part in parts])
    beside = np.pad(misfit, 1, constant_values=np.inf)
    lowest = np.flatnonzero((misfit <= beside[:-2]) & (misfit <= beside[2:]))
    lowest = lowest[np.argsort(misfit[lowest])][:most]
    width = float(trial[1] - trial[0])
    return [_refined(speeds, float(f), width, span) for f in trial[lowest]]


def _refined(speeds: Speeds, best: float, width: float, reach: float) -> float:
    """Refine a minimum of known `width` (Hz), found in the first bounces, up to `reach` (s)."""
    since = speeds.time - speeds.time[0]
    while True:  # doubling the length halves the width of the minimum
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
    """Return the known frequency (Hz), or the best of `find_frequencies` and submultiples of it.

    On orbits that visit few phases, a simple multiple of the frequency may fit better by ordinary
    least squares, which assigns all errors to the departure.
    """
    if known is not None:
        return [known]
    found = find_frequencies(speeds, between, MINIMA)
    parts = [found[0] / k for k in SUBHARMONICS if found[0] / k > between[0]]
    near = [find_frequencies(speeds, (f - NEAR, f + NEAR))[0] for f in parts]
    return found + [f for f in near if np.abs(np.array(found) - f).min() > NEAR]


def is_unphysical(values: Array, covariance: Array) -> bool:
    """Return whether the restitution, the first value, is significantly below 0 or above 1."""
    error = float(np.sqrt(covariance[0, 0]))
    return bool(max(-values[0], values[0] - 1.0) > UNPHYSICAL * error)


def fits_better(distance: Array, other: Array, penalty: float = 0.0) -> bool:
    """Return whether the first of two models fits significantly better (Vuong's test).

    The mean difference of the squared distances is tested against its scatter (Vuong 1989,
    Econometrica 57, 307), so that a few outliers decide nothing.  `penalty` is added to the
    chi-square of the other model, for its additional parameters.
    """
    gain = other - distance
    scatter = float(np.sqrt(np.sum((gain - gain.mean()) ** 2)))
    return bool(gain.sum() + penalty > DECIDED * scatter)


def is_improbable(misfit: float, freedom: int) -> bool:
    """Return whether a reduced chi-square is too large to be due to noise."""
    return freedom > 0 and bool(chdtrc(freedom, misfit * freedom) < IMPROBABLE)


def widen(covariance: Array, misfit: float, freedom: int, influences: Array) -> Array:
    """Scale the covariance of parameters by the reduced chi-square of their fit.

    It is multiplied by a misfit above 1; if noise hardly explains the misfit, the `influences`, a
    `robust_covariance`, are added.
    """
    wider = covariance * max(1.0, misfit)
    return wider + influences if is_improbable(misfit, freedom) else wider


def robust_covariance(residual: Array, slopes: Array, inverse: Array) -> Array:
    """Estimate the covariance of parameters from residuals of any distribution.

    This is White's estimator with the correction HC3 (MacKinnon and White 1985, J. Econometrics 29,
    305): the error of each equation is estimated by its residual from a fit to the others.
    Residuals and slopes are whitened; `inverse` is the inverse of the normal equations.
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
    """Signal-to-noise ratio in the weakest direction of the design matrix.

    All bounces of a locked orbit are equal up to timing errors, so that however many there are, two
    of the three parameters remain undetermined.  `kick` holds S and C (m s-1); the
    variances are those of the speed of arrival and of the time of each bounce.
    """
    amplitude = max(float(np.hypot(*kick)), 1e-300)
    design = _design(speeds, frequency) * [1.0, amplitude, amplitude]
    weakest = float(np.linalg.eigvalsh(design.T @ design / speeds.time.size)[0])
    turning = TWO_PI * frequency * amplitude
    return weakest / float(speed_variance.mean() + turning**2 * time_variance.mean())


# -----------------------------------------------------------------------------
# Laws of restitution compatible with the bounces: the dependence of e on the impact speed.
#
# All laws are fitted to the same bounces.  Two are compared by Vuong's test, with Schwarz's
# correction for an additional parameter.

FITTED: Final = (CONSTANT, PLASTIC, VISCOELASTIC)
# Quantiles of the impact speeds at which fits of the yield speed start
STARTS: Final = (0.15, 0.5, 0.85)
STEP: Final = 1e-5  # step of finite differences: relative for speeds, absolute for the restitution
# Upper limit of the squared distance of a bounce, about three standard errors, so that no single
# bounce decides
FAR: Final = 10.0
FARTHEST: Final = 30.0  # largest absolute value of the logarithm of a speed in m s-1
LEAST_SPEED: Final = 1e-9  # m s-1


class Law(NamedTuple):
    """A law of restitution with its speed in m s-1.

    The yield speed of a plastic law is a fit parameter with the initial value `speed`,
    unless it is `fixed`.
    """

    name: str = CONSTANT
    speed: float = np.nan
    fixed: bool = False

    @property
    def parameters(self) -> int:
        """Number of parameters besides the restitution: 1 with a free yield speed, else 0."""
        return int(self.name == PLASTIC and not self.fixed)

    def rebound_speed(self, v: Array, e: float, logarithm: float) -> tuple[Array, Array | float]:
        """Return the speed after an impact at speed v, and its derivative by v.

        `logarithm` is that of the yield speed, if this is a parameter.
        """
        if self.name == CONSTANT:
            return e * v, e
        v = np.clip(v, LEAST_SPEED, 1.0 / LEAST_SPEED)  # in trial steps
        up, down = (self._speed(v * (1.0 + s), e, logarithm) for s in (STEP, -STEP))
        return self._speed(v, e, logarithm), (up - down) / (2.0 * STEP * v)

    def derivatives(self, v: Array, e: float, logarithm: float) -> list[Array]:
        """Derivatives of the speed after an impact by each parameter, the restitution first."""
        if self.name == CONSTANT:
            return [v]
        steps = [(STEP, 0.0), (0.0, STEP)][: 1 + self.parameters]
        pairs = [
            [self.rebound_speed(v, e + s * x, logarithm + s * y)[0] for s in (1, -1)]
            for x, y in steps
        ]
        return [(up - down) / (2.0 * STEP) for up, down in pairs]

    def _speed(self, v: Array, e: float, logarithm: float) -> Array:
        speed = float(np.exp(np.clip(logarithm, -FARTHEST, FARTHEST)))
        speed = speed if self.parameters else self.speed
        least = LEAST_VISCOELASTIC if self.name == VISCOELASTIC else 0.0
        return v * restitution_at(v, min(max(e, least), 1.0), self.name, speed)


class FittedLaw(NamedTuple):
    """A law of restitution fitted to bounces."""

    law: Law
    # values, covariance: restitution, S, C, f if it was free, S and C of other harmonics, and the
    # yield speed (m s-1) if it was a parameter
    values: Array
    covariance: Array
    # misfit, freedom, bounces: reduced chi-square, number of degrees of freedom, and
    # number of bounces used
    misfit: float
    freedom: int
    bounces: int
    # Squared distance of each bounce in standard errors, at most `FAR`; infinite if the fit failed
    distance: Array

    @property
    def speed(self) -> float:
        """Speed of the law in m s-1; NaN for a constant restitution."""
        return float(self.values[-1]) if self.law.parameters else self.law.speed

    @property
    def errors(self) -> tuple[float, float]:
        """Standard errors of the restitution and of the speed, NaN if the speed was not fitted."""
        error = np.sqrt(np.diag(self.covariance))
        return float(error[0]), float(error[-1]) if self.law.parameters else np.nan


def fit_law(name: str, speeds: Array, fit: Callable[[Law], FittedLaw]) -> FittedLaw:
    """Fit a law to bounces at given impact speeds, from several initial yield speeds."""
    places = STARTS if name == PLASTIC else (0.5,)
    return best_fit([fit(Law(name, float(np.quantile(speeds, place)))) for place in places])


def best_fit(fits: Sequence[FittedLaw]) -> FittedLaw:
    """Return the fit with the smallest chi-square."""
    return min(fits, key=lambda fit: float(fit.distance.sum()))


def failed_fit(law: Law, bounces: int) -> FittedLaw:
    """Return the result for a law whose fit did not converge."""
    law, nan = law._replace(speed=np.nan), np.full((1, 1), np.nan)
    return FittedLaw(law, nan[0], nan, np.nan, 0, 0, np.full(bounces, np.inf))


def with_speed(law: Law, values: Array, covariance: Array) -> tuple[Array, Array]:
    """Replace the logarithm of the yield speed, the last value, by the speed itself."""
    if not law.parameters:
        return values, covariance
    scale = np.ones(values.size)
    scale[-1] = np.exp(values[-1])
    return np.append(values[:-1], scale[-1]), covariance * np.outer(scale, scale)


def possible_laws(fits: Sequence[FittedLaw]) -> list[str]:
    """Names of the laws that the bounces do not rule out, the best one first."""

    def criterion(fit: FittedLaw) -> float:
        return float(fit.distance.sum() + fit.law.parameters * np.log(fit.distance.size))

    fitted = [fit for fit in fits if np.isfinite(fit.distance).all()]
    if not fitted:
        return []
    best, *others = sorted(fitted, key=criterion)
    possible = [best.law.name]
    for other in others:
        more = other.law.parameters - best.law.parameters
        penalty = more * float(np.log(other.distance.size))
        if not fits_better(best.distance, other.distance, penalty):
            possible.append(other.law.name)
    # a fit that failed rules out nothing
    return possible + [fit.law.name for fit in fits if not np.isfinite(fit.distance).all()]


def preferred_law(fits: Sequence[FittedLaw]) -> FittedLaw | None:
    """Return the fit with the best law if bounces rule out a constant restitution, else None."""
    name = law_to_use(possible_laws(fits))
    return None if name == CONSTANT else next(fit for fit in fits if fit.law.name == name)


def law_to_use(left: Sequence[str]) -> str:
    """Return the law to use: constant or, if that is ruled out, the best of the others.

    `left` names the laws that the bounces do not rule out, the best one first.
    """
    return CONSTANT if not left or CONSTANT in left else left[0]


def law_of(found: xr.Dataset) -> tuple[str, float]:
    """Return the law of the parameters of a result of `estimate`, and its speed (m s-1).

    The speed is NaN if the restitution is constant.
    """
    name = law_to_use(_possible_laws(found))
    return name, np.nan if name == CONSTANT else float(found["law_speed"].sel(law=name))


def law_variables(fits: Sequence[FittedLaw], scale: float = 1.0) -> dict[str, Any]:
    """Variables with the dimension law; `scale` multiplies speeds."""
    speeds = [[scale * v for v in (fit.speed, fit.errors[1])] for fit in fits]
    columns = {
        "law_restitution": ([float(fit.values[0]) for fit in fits], "1", "restitution of the law"),
        "law_restitution_error": ([fit.errors[0] for fit in fits], "1", "its standard error"),
        "law_speed": ([v for v, _ in speeds], "m s-1", "restitution_speed of the law"),
        "law_speed_error": ([error for _, error in speeds], "m s-1", "its standard error"),
        "law_distance": (
            [float(fit.distance.mean()) for fit in fits],
            "1",
            "mean squared distance of the bounces in standard errors",
        ),
    }
    return {"law": [fit.law.name for fit in fits], **with_units("law", columns)}


def _possible_laws(found: xr.Dataset) -> list[str]:
    """Read the laws that the bounces do not rule out from the attribute of a result."""
    names = str(found.attrs["restitution_law"])
    return names.split(" or ") if names else []


def law_text(found: xr.Dataset) -> str:
    """State which laws of restitution a result of `estimate` allows; empty if it names none."""
    left, undecided = _possible_laws(found), ""
    if not left:
        return ""
    law = law_to_use(left)
    *others, last = left
    if others:
        either = f"{', '.join(others)} or {last}"
        undecided = f"the bounces do not decide whether the law of restitution is {either}"
    if law == CONSTANT:
        ruled_out = " and ".join(name for name in FITTED if name != CONSTANT)
        return undecided or f"the restitution is constant: the bounces rule out {ruled_out} laws"
    fit = found.sel(law=law)
    e, speed = (
        with_error(float(fit[name]), float(fit[f"{name}_error"]))
        for name in ("law_restitution", "law_speed")
    )
    text = f'restitution_law = "{law}", restitution {e}, restitution_speed {speed} m/s'
    if undecided:
        return f"{undecided}; the parameters are those of the best: {text}"
    return f"the restitution depends on speed: {text}"
