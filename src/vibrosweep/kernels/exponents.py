"""Multipliers and Lyapunov exponents of a cycle, with bounds on their errors.

The multipliers are the eigenvalues of the product of the Jacobians of the impacts of the cycle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibrosweep.kernels import elementary, growth
from vibrosweep.kernels._jit import jit
from vibrosweep.kernels.bases import Constants, contraction, jacobian, reverses
from vibrosweep.kernels.bases.error_bounds import (
    StateError,
    jacobian_error,
    landing_added,
    rebound_error,
)
from vibrosweep.kernels.impact import impact
from vibrosweep.kernels.rounding import HALF_ULP, ROUNDING
from vibrosweep.kernels.tangent import carry, stretch
from vibrosweep.kernels.trust import Enclosure, extent, landing_error, spread_of, turn_box, upright


class State(NamedTuple):
    """A state at lift-off."""

    whole: float  # whole periods and phase
    phase: float
    flight: float  # speed, as the duration of the flight that follows


class Exponent(NamedTuple):
    """An exponent per impact."""

    value: float
    error: float


class CycleExponents(NamedTuple):
    """Exponents of a cycle without rests: the largest, and the sum of both."""

    multiplier: complex  # the leading one
    largest: Exponent
    total: Exponent


TINY = 2.0**-500


@jit
def leading_eigenvalue(trace: float, determinant: float) -> complex:
    """Eigenvalue of largest modulus of a 2 x 2 matrix."""
    discriminant = trace * trace - 4.0 * determinant
    root = math.sqrt(abs(discriminant))
    if discriminant < 0.0:
        return complex(0.5 * trace, 0.5 * root)
    return complex(0.5 * (trace + math.copysign(root, trace)), 0.0)


@jit
def _eigenvalue_error(
    trace: float, determinant: float, trace_error: float, determinant_error: float
) -> float:
    """Error of the modulus of the leading eigenvalue."""
    discriminant = trace * trace - 4.0 * determinant
    change = 2.0 * abs(trace) * trace_error + trace_error * trace_error + 4.0 * determinant_error
    if discriminant < -change:  # the modulus is the root of the determinant
        return determinant_error / math.sqrt(determinant)
    root = math.sqrt(abs(discriminant))
    # at a double eigenvalue an error enters by its square root
    return 0.5 * (trace_error + min(change / max(root, TINY), math.sqrt(change)))


EXACT = StateError(0.0, 0.0)


@jit
def _widened(box: Enclosure, added: float, norm: float = 1.0) -> Enclosure:
    """Lengthen both sides of a box by `added`, and divide them by a norm."""
    return Enclosure(box.c, box.s, (box.along + added) / norm, (box.across + added) / norm)


@jit
def _state_error(fixed: Constants, state: State, impacts: int) -> StateError:
    """Bound the distance of a state on a cycle of rounded impacts from the exact cycle.

    To first order, roundings during one cycle add up to b at its end, and a distance d becomes
    M d + b.  The distance that repeats is d = (1 - M)^-1 b.
    """
    n, x, u = state
    box = upright(EXACT)
    m00, m01, m10, m11 = 1.0, 0.0, 0.0, 1.0
    for _ in range(impacts):
        hit = impact(fixed, n, x, u)
        derivative = jacobian(fixed, hit.flight)
        m00, m10 = carry(m00, m10, derivative)
        m01, m11 = carry(m01, m11, derivative)
        added = landing_added(fixed, hit.flight, EXACT)
        rounding = added.phase + rebound_error(fixed, hit.flight, added, added.phase, EXACT)
        box = _widened(turn_box(box, derivative), rounding)
        n, x, u = hit.n_off, hit.x_off, hit.u
    dx, du = extent(box)
    determinant = abs((1.0 - m00) * (1.0 - m11) - m01 * m10)
    # entries are rounded themselves
    slack = impacts * ROUNDING * (1.0 + abs(m00) + abs(m11) + abs(m01 * m10))
    if not determinant > slack:
        return StateError(np.inf, np.inf)
    determinant -= slack
    return StateError(
        (abs(1.0 - m11) * dx + abs(m01) * du) / determinant,
        (abs(m10) * dx + abs(1.0 - m00) * du) / determinant,
    )


@jit
def cycle_exponents(fixed: Constants, state: State, impacts: int) -> CycleExponents:
    """Return the exponents of a cycle without rests through a state."""
    n, x, u = state
    m00, m01, m10, m11 = 1.0, 0.0, 0.0, 1.0  # product over exp(scale): its largest row sum is 1
    c, d, area, slack = 1.0, 0.0, 0.0, 0.0
    scale, turned = 0.0, 1.0
    alike, shrunk, exponent = 0, contraction(fixed, u), 0.0  # impacts that contract by `shrunk`
    # boxes of the errors of the state and of both columns
    box = upright(_state_error(fixed, state, impacts))
    box_0, box_1 = upright(EXACT), upright(EXACT)
    for _ in range(impacts):
        hit = impact(fixed, n, x, u)
        derivative = jacobian(fixed, hit.flight)
        factor = contraction(fixed, hit.v)
        if factor != shrunk:
            exponent += alike * growth.logarithm(shrunk)
            alike, shrunk = 0, factor
        alike += 1
        turned *= reverses(fixed, hit.x, hit.v)
        n, x, u = hit.n_off, hit.x_off, hit.u
        off = landing_error(box, derivative)
        changed = jacobian_error(fixed, hit.flight, off, spread_of(box))
        by_phase, by_speed, by_landing = changed
        box = turn_box(box, derivative)
        box_0, box_1 = turn_box(box_0, derivative), turn_box(box_1, derivative)
        rounding = ROUNDING * derivative.size
        added_0, added_1 = rounding * (abs(m00) + abs(m10)), rounding * (abs(m01) + abs(m11))
        added_0, added_1 = added_0 + by_phase * abs(m00), added_1 + by_phase * abs(m01)
        added_0, added_1 = added_0 + by_speed * abs(m10), added_1 + by_speed * abs(m11)
        m00, m10 = carry(m00, m10, derivative)
        m01, m11 = carry(m01, m11, derivative)
        added_0, added_1 = added_0 + by_landing * abs(m00), added_1 + by_landing * abs(m01)
        norm = max(abs(m00) + abs(m01), abs(m10) + abs(m11))
        scale += growth.logarithm(norm)
        m00, m01, m10, m11 = m00 / norm, m01 / norm, m10 / norm, m11 / norm
        box_0, box_1 = _widened(box_0, added_0, norm), _widened(box_1, added_1, norm)
        c, d, along, across, error = stretch(c, d, derivative)
        area += growth.logarithm(along * across)
        slack += error + HALF_ULP * (abs(area) + 2.0)  # of the sum, and of the logarithm
    exponent += alike * growth.logarithm(shrunk) - 2.0 * scale
    determinant = turned * elementary.exp(exponent)
    value = leading_eigenvalue(m00 + m11, determinant)
    modulus = abs(value)
    trace_error = extent(box_0).phase + extent(box_1).speed
    determinant_error = 0.0
    if determinant != 0.0:
        determinant_error = (impacts * ROUNDING + 4.0 * HALF_ULP * abs(exponent)) * abs(determinant)
    error = _eigenvalue_error(m00 + m11, determinant, trace_error, determinant_error)
    largest = (growth.logarithm(modulus) + scale) / impacts
    relative = error / modulus if modulus > 0.0 else 0.0
    relative += HALF_ULP * impacts * (abs(scale) + 2.0)  # of the sum of logarithms
    if not relative < np.inf:  # at a multiplier of 1 the error of the state is not bounded
        relative = np.inf
    return CycleExponents(
        value * elementary.exp(scale),
        Exponent(largest, relative / impacts),
        Exponent(area / impacts, slack / impacts),
    )
