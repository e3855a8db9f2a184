"""Laws of restitution that bounces allow: the dependence of e on the speed of impact.

All laws are fitted to the same bounces.  Two are compared by Vuong's test, with Schwarz's
correction for an additional parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr

from vibrosweep.arrays import Array
from vibrosweep.lab.regression import is_nearer
from vibrosweep.lab.variables import with_error, with_units
from vibrosweep.model.restitution_laws import (
    CONSTANT,
    LEAST_VISCOELASTIC,
    PLASTIC,
    VISCOELASTIC,
    restitution_at,
)

FITTED: Final = (CONSTANT, PLASTIC, VISCOELASTIC)
# Quantiles of the speeds of impact at which fits of the speed of yielding start
STARTS: Final = (0.15, 0.5, 0.85)
STEP: Final = 1e-5  # step of finite differences: relative for speeds, absolute for the restitution
# Limit of the squared distance of a bounce, about three standard errors, so that no single bounce
# decides
FAR: Final = 10.0
FARTHEST: Final = 30.0  # largest size of the logarithm of a speed in m s-1
LEAST_SPEED: Final = 1e-9  # m s-1


class Law(NamedTuple):
    """A law of restitution with its speed in m s-1.

    The speed of yielding of a plastic law is a parameter of a fit, with the first value `speed`,
    unless it is `fixed`.
    """

    name: str = CONSTANT
    speed: float = np.nan
    fixed: bool = False

    @property
    def parameters(self) -> int:
        """Number of parameters beside the restitution: 1 with a free speed of yielding, else 0."""
        return int(self.name == PLASTIC and not self.fixed)

    def rebound_speed(self, v: Array, e: float, logarithm: float) -> tuple[Array, Array | float]:
        """Return the speed after an impact at the speed v, and its derivative by v.

        `logarithm` is that of the speed of yielding, if this is a parameter.
        """
        if self.name == CONSTANT:
            return e * v, e
        v = np.maximum(v, LEAST_SPEED)
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
    """A law that was fitted to bounces."""

    law: Law
    # values, covariance: restitution, S, C, f if it was free, S and C of other harmonics, and the
    # speed of yielding (m s-1) if it was a parameter
    values: Array
    covariance: Array
    # misfit, freedom, bounces: chi-square per degree of freedom, number of degrees of freedom, and
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
    """Fit a law to bounces at these speeds of impact, from several first speeds of yielding."""
    places = STARTS if name == PLASTIC else (0.5,)
    return nearest_fit([fit(Law(name, float(np.quantile(speeds, place)))) for place in places])


def nearest_fit(fits: Sequence[FittedLaw]) -> FittedLaw:
    """Return the fit that is nearest to the bounces."""
    return min(fits, key=lambda fit: float(fit.distance.sum()))


def failed_fit(law: Law, bounces: int) -> FittedLaw:
    """Return the result for a law whose fit to that many bounces did not converge."""
    law, nan = law._replace(speed=np.nan), np.full((1, 1), np.nan)
    return FittedLaw(law, nan[0], nan, np.nan, 0, 0, np.full(bounces, np.inf))


def with_speed(law: Law, values: Array, covariance: Array) -> tuple[Array, Array]:
    """Replace the logarithm of the speed of yielding, the last value, by that speed."""
    if not law.parameters:
        return values, covariance
    scale = np.ones(values.size)
    scale[-1] = np.exp(values[-1])
    return np.append(values[:-1], scale[-1]), covariance * np.outer(scale, scale)


def laws_left(fits: Sequence[FittedLaw]) -> list[str]:
    """Names of the laws that the bounces do not rule out, the best one first."""

    def criterion(fit: FittedLaw) -> float:
        return float(fit.distance.sum() + fit.law.parameters * np.log(fit.distance.size))

    fitted = [fit for fit in fits if np.isfinite(fit.distance).all()]
    if not fitted:
        return []
    nearest, *others = sorted(fitted, key=criterion)
    kept = [nearest.law.name]
    for other in others:
        more = other.law.parameters - nearest.law.parameters
        price = more * float(np.log(other.distance.size))
        if not is_nearer(nearest.distance, other.distance, price):
            kept.append(other.law.name)
    # a fit that failed rules out nothing
    return kept + [fit.law.name for fit in fits if not np.isfinite(fit.distance).all()]


def preferred_law(fits: Sequence[FittedLaw]) -> FittedLaw | None:
    """Return the fit with the best law if bounces rule out a constant restitution, else None."""
    name = law_among(laws_left(fits))
    return None if name == CONSTANT else next(fit for fit in fits if fit.law.name == name)


def law_among(left: Sequence[str]) -> str:
    """Return the law of the parameters: constant or, if that is ruled out, the best one left.

    `left` names the laws that the bounces do not rule out, the best one first.
    """
    return CONSTANT if not left or CONSTANT in left else left[0]


def law_of(found: xr.Dataset) -> tuple[str, float]:
    """Return the law of the parameters of a result of `estimate`, and its speed (m s-1).

    The speed is NaN if the restitution is constant.
    """
    name = law_among(_laws_left(found))
    return name, np.nan if name == CONSTANT else float(found["law_speed"].sel(law=name))


def law_variables(fits: Sequence[FittedLaw], scale: float = 1.0) -> dict[str, Any]:
    """Variables of a dataset with the dim law; `scale` multiplies speeds."""
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


def _laws_left(found: xr.Dataset) -> list[str]:
    """Read the laws that the bounces do not rule out from the attribute of a result."""
    names = str(found.attrs["restitution_law"])
    return names.split(" or ") if names else []


def law_text(found: xr.Dataset) -> str:
    """State which laws of restitution a result of `estimate` allows; empty if it names none."""
    left, undecided = _laws_left(found), ""
    if not left:
        return ""
    law = law_among(left)
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
