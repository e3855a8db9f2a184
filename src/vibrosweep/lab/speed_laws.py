"""Laws of restitution that bounces allow: how e depends on the speed of impact.

Every law is fitted to the same bounces.  Two are compared by the test of Vuong, with Schwarz's
correction for an additional parameter.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr

from vibrosweep.arrays import Array
from vibrosweep.lab.regression import is_nearer
from vibrosweep.lab.variables import with_units
from vibrosweep.model.restitution_laws import (
    CONSTANT,
    LEAST_VISCOELASTIC,
    PLASTIC,
    VISCOELASTIC,
    restitution_at,
)

FITTED: Final = (CONSTANT, PLASTIC, VISCOELASTIC)
# Places, in the distribution of speeds, at which the yielding of a plastic law is first sought
PLACES: Final = (0.15, 0.5, 0.85)
STEP: Final = 1e-5  # of speeds, relative, and of the restitution, in finite differences
# Largest squared distance that counts, about three standard errors: one bounce must not decide
FAR: Final = 10.0
FARTHEST: Final = 30.0  # logarithm of a speed in m s-1 up to which a fit may stray
LEAST_SPEED: Final = 1e-9  # m s-1


class Law(NamedTuple):
    """A law of restitution, and its speed in m s-1.

    The speed is where a fit begins if it is a parameter, as of a plastic law unless it is `fixed`.
    """

    name: str = CONSTANT
    speed: float = np.nan
    fixed: bool = False

    @property
    def parameters(self) -> int:
        """Number of parameters beside the restitution: the logarithm of the speed of yielding."""
        return int(self.name == PLASTIC and not self.fixed)

    def rebound_speed(self, v: Array, e: float, logarithm: float) -> tuple[Array, Array | float]:
        """Speed after an impact at the speed v, and its derivative by v."""
        if self.name == CONSTANT:
            return e * v, e
        v = np.maximum(v, LEAST_SPEED)
        up, down = (self._speed(v * (1.0 + s), e, logarithm) for s in (STEP, -STEP))
        return self._speed(v, e, logarithm), (up - down) / (2.0 * STEP * v)

    def derivatives(self, v: Array, e: float, logarithm: float) -> list[Array]:
        """Derivatives of the speed after an impact by the restitution and the other parameter."""
        if self.name == CONSTANT:
            return [v]
        moves = [(STEP, 0.0), (0.0, STEP)][: 1 + self.parameters]
        pairs = [
            [self.rebound_speed(v, e + s * x, logarithm + s * y)[0] for s in (1, -1)]
            for x, y in moves
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
    # speed of yielding (m s-1) if the law has one
    values: Array
    covariance: Array
    # misfit, freedom, bounces: chi-square per degree of freedom, the number of these, and that of
    # the bounces used
    misfit: float
    freedom: int
    bounces: int
    distance: Array  # squared distance of each bounce in standard errors; infinite without a fit

    @property
    def speed(self) -> float:
        """Speed of the law in m s-1; NaN for a constant restitution."""
        return float(self.values[-1]) if self.law.parameters else self.law.speed

    @property
    def errors(self) -> tuple[float, float]:
        """Standard errors of the restitution and of the speed, NaN if that is no parameter."""
        error = np.sqrt(np.diag(self.covariance))
        return float(error[0]), float(error[-1]) if self.law.parameters else np.nan


def starting_laws(name: str, speeds: Array) -> list[Law]:
    """Laws of a name from which fits to bounces at these speeds begin."""
    places = PLACES if name == PLASTIC else (0.5,)
    return [Law(name, float(np.quantile(speeds, place))) for place in places]


def nearest_fit(fits: Sequence[FittedLaw]) -> FittedLaw:
    """Return the fit that is nearest to the bounces."""
    return min(fits, key=lambda one: float(one.distance.sum()))


def failed_fit(law: Law, bounces: int) -> FittedLaw:
    """Return the result for a law that no parameters bring near that many bounces."""
    law, none = law._replace(speed=np.nan), np.full((1, 1), np.nan)
    return FittedLaw(law, none[0], none, np.nan, 0, 0, np.full(bounces, np.inf))


def with_speed(law: Law, values: Array, covariance: Array) -> tuple[Array, Array]:
    """Values and covariance with the speed of yielding in place of its logarithm, the last one."""
    if not law.parameters:
        return values, covariance
    scale = np.ones(values.size)
    scale[-1] = np.exp(values[-1])
    return np.append(values[:-1], scale[-1]), covariance * np.outer(scale, scale)


def laws_left(fits: Sequence[FittedLaw]) -> list[str]:
    """Names of the laws that the bounces do not rule out, the best one first."""

    def size(one: FittedLaw) -> float:
        return float(one.distance.sum() + one.law.parameters * np.log(one.distance.size))

    fitted = [one for one in fits if np.isfinite(one.distance).all()]
    if not fitted:
        return []
    first, *others = sorted(fitted, key=size)
    kept = [first.law.name]
    for other in others:
        more = other.law.parameters - first.law.parameters
        price = more * float(np.log(other.distance.size))
        if not is_nearer(first.distance, other.distance, price):
            kept.append(other.law.name)
    # where no fit is found nothing is ruled out
    return kept + [one.law.name for one in fits if not np.isfinite(one.distance).all()]


def preferred_law(fits: Sequence[FittedLaw]) -> FittedLaw | None:
    """Return the best law where bounces rule out a constant restitution, else None."""
    name = law_among(laws_left(fits))
    return None if name == CONSTANT else next(one for one in fits if one.law.name == name)


def law_among(left: Sequence[str]) -> str:
    """Return the law of the parameters among those that the bounces leave, the best one first.

    It is the constant one unless they rule that out.
    """
    return CONSTANT if not left or CONSTANT in left else left[0]


def law_of(found: xr.Dataset) -> tuple[str, float]:
    """Law of the parameters in a result of `estimate` or `find_impacts`, and its speed (m s-1).

    The speed is NaN where the restitution is constant.
    """
    name = law_among(_laws_left(found))
    return name, np.nan if name == CONSTANT else float(found["law_speed"].sel(law=name))


def law_variables(fits: Sequence[FittedLaw], scale: float = 1.0) -> dict[str, Any]:
    """Variables of the dim law, for a dataset; `scale` multiplies speeds."""
    speeds = [[scale * v for v in (one.speed, one.errors[1])] for one in fits]
    columns = {
        "law_restitution": ([float(f.values[0]) for f in fits], "1", "restitution of the law"),
        "law_restitution_error": ([one.errors[0] for one in fits], "1", "its standard error"),
        "law_speed": ([v for v, _ in speeds], "m s-1", "restitution_speed of the law"),
        "law_speed_error": ([error for _, error in speeds], "m s-1", "its standard error"),
        "law_distance": (
            [float(one.distance.mean()) for one in fits],
            "1",
            "mean squared distance of the bounces in standard errors",
        ),
    }
    return {"law": [one.law.name for one in fits], **with_units("law", columns)}


def _laws_left(found: xr.Dataset) -> list[str]:
    """Return the laws that the bounces leave, from the attribute of a result."""
    named = str(found.attrs["restitution_law"])
    return named.split(" or ") if named else []


def law_text(found: xr.Dataset) -> str:
    """Say what bounces tell of the law of restitution; `found` is a result of `estimate`."""
    left, open_ = _laws_left(found), ""
    if not left:
        return ""
    law = law_among(left)
    *others, last = left
    if others:
        either = f"{', '.join(others)} or {last}"
        open_ = f"the bounces do not decide whether the law of restitution is {either}"
    if law == CONSTANT:
        ruled_out = " and ".join(name for name in FITTED if name != CONSTANT)
        return open_ or f"the restitution is constant: the bounces rule out {ruled_out} laws"
    one = found.sel(law=law)
    e, speed = (
        f"{float(one[name]):.4g} ± {float(one[name + '_error']):.2g}"
        if np.isfinite(one[name + "_error"])
        else f"{float(one[name]):.4g}"
        for name in ("law_restitution", "law_speed")
    )
    text = f'restitution_law = "{law}", restitution {e}, restitution_speed {speed} m/s'
    if open_:
        return f"{open_}; the parameters are those of the best: {text}"
    return f"the restitution depends on speed: {text}"
