"""Adjustment of instants together with the parameters of bounces on a base of constant level.

The adjustment is the smallest weighted change of the instants with which every bounce obeys the
map, under one of the laws of restitution.
"""

from __future__ import annotations

from functools import partial
from typing import Final, NamedTuple

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.lab.bounces import Bounces, solve, whiten
from vibrosweep.lab.regression import TWO_PI, spread_of_influences, widen
from vibrosweep.lab.speed_laws import (
    FAR,
    FITTED,
    FittedLaw,
    Law,
    failed_fit,
    fit_law,
    nearest_fit,
    with_speed,
)
from vibrosweep.model.restitution_laws import CONSTANT, PLASTIC

# Most iterations of the adjustment, and the step in standard errors at which it has converged
ROUNDS: Final = 50
CLOSE: Final = 1e-6
# The same for the plastic law, whose kink may keep the steps from becoming smaller
ROUGH: Final = 1e-2
BETWEEN: Final = (0.05, 0.999)  # range of the restitution in a law that depends on speed
LONGEST: Final = 0.3  # longest step of the logarithm of a speed


class Adjustment(NamedTuple):
    """Result of the adjustment."""

    # values, covariance: e, S, C, f if it is free, and the logarithm of a speed of yielding
    values: Array
    covariance: Array
    chi_square: float
    distance: Array  # squared distance of each bounce in standard errors
    # Covariance from the scatter of the residuals, added where noise does not explain them
    influences: Array

    def with_law(self, law: Law) -> FittedLaw:
        """Return the fit of the law with which instants and parameters were adjusted."""
        number = self.distance.size
        freedom = number - self.values.size
        misfit = self.chi_square / freedom
        covariance = widen(self.covariance, misfit, freedom, self.influences)
        values, covariance = with_speed(law, self.values, covariance)
        distance = np.minimum(self.distance, FAR)
        return FittedLaw(law, values, covariance, misfit, freedom, number, distance)


def adjust(
    bounces: Bounces,
    start: Array,
    frequency: float,
    free: bool,
    law: Law = Law(),  # noqa: B008
) -> Adjustment:
    """Adjust instants and parameters together, starting from e, S and C at a frequency in Hz.

    The frequency is a parameter if `free`.  Raises a LinAlgError if the iteration does not
    converge, or if a parameter has no effect.
    """
    values = np.append(start, frequency) if free else start
    if law.parameters:
        values = np.append(values, np.log(law.speed))
    errors, instant = bounces.errors, bounces.instant.copy()
    half, close = bounces.gravity / 2.0, ROUGH if law.name == PLASTIC else CLOSE
    for _ in range(ROUNDS):
        e, s, c = values[:3]
        f = values[3] if free else frequency
        arrive, leave, time = bounces.speeds(instant)
        sine, cosine = np.sin(TWO_PI * f * time), np.cos(TWO_PI * f * time)
        turning = TWO_PI * (s * cosine - c * sine)
        by_e, *others = law.derivatives(arrive, e, values[-1])
        columns = [by_e, sine, cosine] + ([time * turning] if free else []) + others
        design = -np.stack(columns, axis=1)
        ends = np.full(time.size, half)
        after, q = law.rebound_speed(arrive, e, values[-1])
        slopes = bounces.jacobian(q * ends, -(1.0 + q) * ends - f * turning, ends)
        closure = leave - after - s * sine - c * cosine
        closure = closure + slopes @ (bounces.instant - instant)
        spread = slopes @ errors @ slopes.T
        weighted = solve(spread, np.column_stack([design, closure]))
        normal = design.T @ weighted[:, :-1]
        if not np.all(np.diag(normal) > 0.0):
            raise np.linalg.LinAlgError("no bounce depends on a parameter")
        scale = 1.0 / np.sqrt(np.diag(normal))
        inverse = scale[:, np.newaxis] * np.linalg.pinv(normal * np.outer(scale, scale)) * scale
        step = -inverse @ (design.T @ weighted[:, -1])
        forces = weighted[:, -1] + weighted[:, :-1] @ step
        instant = bounces.instant - errors @ (slopes.T @ forces)
        if law.parameters:
            step[-1] = np.clip(step[-1], -LONGEST, LONGEST)
        values = values + step
        if law.name != CONSTANT:
            values[0] = np.clip(values[0], *BETWEEN)
        if np.all(np.abs(step) <= close * np.sqrt(np.diag(inverse))):
            break
    else:
        raise np.linalg.LinAlgError("the adjustment does not converge")
    white = whiten(spread, np.column_stack([design, spread @ forces]))
    influences = spread_of_influences(white[:, -1], white[:, :-1], inverse)
    chi_square = float(forces @ (spread @ forces))
    return Adjustment(values, inverse, chi_square, white[:, -1] ** 2, influences)


def fit_laws(bounces: Bounces, start: Array, frequency: float | None) -> list[FittedLaw]:
    """Fit the laws of `FITTED`, starting from the parameters of a constant restitution.

    If `frequency` (Hz) is None, it is one of these parameters.
    """
    speeds = np.maximum(bounces.speeds()[0], 1e-6)

    def fitted(name: str, values: Array) -> FittedLaw:
        return fit_law(name, speeds, partial(_fit, bounces, values, frequency))

    fits = [fitted(name, start) for name in FITTED]
    nearest = nearest_fit(fits)
    if np.isnan(nearest.misfit):
        return fits
    # a law whose fit failed may converge from these parameters
    return [fitted(fit.law.name, nearest.values) if np.isnan(fit.misfit) else fit for fit in fits]


def _fit(bounces: Bounces, values: Array, frequency: float | None, law: Law) -> FittedLaw:
    try:
        # at a fixed speed first, because the parameters of a constant restitution may be far off
        for tried in dict.fromkeys((law._replace(fixed=True), law)):
            rate = float(values[3]) if frequency is None else frequency
            found = adjust(bounces, values[:3], rate, frequency is None, tried)
            values = found.values
    except np.linalg.LinAlgError:
        return failed_fit(law, bounces.middle.size)
    return found.with_law(law)
