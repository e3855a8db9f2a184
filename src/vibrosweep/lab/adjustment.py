"""Adjustment of instants together with the parameters of bounces on a base of constant level.

It is by the smallest weighted change of the instants for which every bounce obeys the map, under
one of the laws of restitution.
"""

from __future__ import annotations

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
    nearest_fit,
    starting_laws,
    with_speed,
)
from vibrosweep.model.restitution_laws import CONSTANT, PLASTIC

# Most rounds of the adjustment, and the step in standard errors at which it has converged.
ROUNDS: Final = 50
CLOSE: Final = 1e-6
ROUGH: Final = 1e-2  # the same of a law with a kink, on which a step may never be smaller
BETWEEN: Final = (0.05, 0.999)  # restitutions of a law that depends on speed
LONGEST: Final = 0.3  # step of the logarithm of a speed


class Adjustment(NamedTuple):
    """Result of the adjustment: (e, S, C), f if it is free, a speed of yielding; chi-square."""

    values: Array
    covariance: Array
    chi_square: float
    # Squared distance of each bounce, in standard errors
    distance: Array
    influences: Array  # covariance from the scatter of the residuals, added if they are too large


def adjust(
    bounces: Bounces,
    first: Array,
    rate: float,
    free: bool,
    law: Law = Law(),  # noqa: B008
) -> Adjustment:
    """Adjust instants and parameters together, from the `first` e, S and C.

    The logarithm of a speed of yielding is the last parameter.
    """
    values = np.append(first, rate) if free else first
    if law.parameters:
        values = np.append(values, np.log(law.speed))
    errors, instant = bounces.errors, bounces.instant.copy()
    half, close = bounces.gravity / 2.0, ROUGH if law.name == PLASTIC else CLOSE
    for _ in range(ROUNDS):
        e, s, c = values[:3]
        f = values[3] if free else rate
        arrive, leave, time = bounces.speeds(instant)
        sine, cosine = np.sin(TWO_PI * f * time), np.cos(TWO_PI * f * time)
        turning = TWO_PI * (s * cosine - c * sine)
        by_e, *others = law.derivatives(arrive, e, values[-1])
        columns = [by_e, sine, cosine] + ([time * turning] if free else []) + others
        design = -np.stack(columns, axis=1)
        ends = np.full(time.size, half)
        after, q = law.rebound_speed(arrive, e, values[-1])
        slopes = bounces.errors_of(q * ends, -(1.0 + q) * ends - f * turning, ends)
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


def fit_laws(bounces: Bounces, first: Array, rate: float, *, free: bool) -> list[FittedLaw]:
    """Fit the laws of `FITTED`, from `first` parameters of a constant restitution."""
    speeds = np.maximum(bounces.speeds()[0], 1e-6)

    def fitted(name: str, values: Array) -> FittedLaw:
        return nearest_fit(
            [_fit(bounces, values, rate, free, law) for law in starting_laws(name, speeds)]
        )

    found = [fitted(name, first) for name in FITTED]
    near = nearest_fit(found)  # from which another law may converge
    if np.isnan(near.misfit):
        return found
    return [fitted(one.law.name, near.values) if np.isnan(one.misfit) else one for one in found]


def _fit(bounces: Bounces, values: Array, rate: float, free: bool, law: Law) -> FittedLaw:
    try:
        # at a fixed speed first, because a constant restitution may give a bad beginning
        for one_law in dict.fromkeys((law._replace(fixed=True), law)):
            at = float(values[3]) if free else rate
            one = adjust(bounces, values[:3], at, free, one_law)
            values = one.values
    except np.linalg.LinAlgError:
        return failed_fit(law, bounces.middle.size)
    number = bounces.middle.size
    misfit, freedom = one.chi_square / (number - one.values.size), number - one.values.size
    spread = widen(one.covariance, misfit, freedom, one.influences)
    values, spread = with_speed(law, one.values, spread)
    far = np.minimum(one.distance, FAR)
    return FittedLaw(law, values, spread, misfit, freedom, number, far)
