"""Laws of restitution over bases that move: multipliers of locked orbits, slopes and bounds."""

import numpy as np
import pytest

from vibrosweep.kernels.bases import (
    constants,
    contraction,
    density,
    fixed_attracts,
    fixed_holds,
    fixed_residual,
    jacobian,
)
from vibrosweep.kernels.impact import base_of, impact
from vibrosweep.kernels.restitution import arrival_to_repeat, ratio, slope
from vibrosweep.model.parameters import dimensionless

FALLING = ("plastic", "viscoelastic")
STEP = 1e-4


def realization(parameters, name, e, speed, gamma, r=1e-9):
    kick = gamma / np.pi * (1.0 + e)
    given = {"restitution": e, "restitution_speed": speed, "amplitude": kick, "contact_time": r}
    batch = parameters(gravity=2.0, frequency=1.0, **given)
    return constants(base_of("moving", "rest", restitution=name), dimensionless(batch, 1.0), 0)


def differences(fixed, x, y):
    """Derivative of an impact, by differences of the fourth order."""

    def image(dx, dy):
        hit = impact(fixed, 0.0, x + dx, y + dy)
        return np.array([hit.n + hit.x, hit.u])

    return np.column_stack(
        [
            (8.0 * (image(*d) - image(*-d)) - (image(*2 * d) - image(*-2 * d))) / (12.0 * STEP)
            for d in STEP * np.eye(2)
        ]
    )


def test_multipliers_of_a_locked_orbit_with_plastic_restitution(parameters):
    fixed = realization(parameters, "plastic", 0.9, 0.5, 0.6)
    law = (fixed.base.restitution, fixed.e, fixed.scale)
    c, x = arrival_to_repeat(*law, 1.0), 0.3476165567904094
    assert c == pytest.approx(1.156174619245715, rel=1e-15)
    assert abs(fixed_residual(fixed, x, 1.0, 1.0)[0]) < 1e-15
    assert fixed_holds(fixed, x, 1.0)
    assert fixed_attracts(fixed, x, 1.0)
    y = ratio(*law, c) * c
    hit = impact(fixed, 0.0, x, y)
    assert (hit.n, hit.x, hit.u) == pytest.approx((1.0, x, y), rel=1e-14)
    xx, xu, ux, uu, _ = jacobian(fixed, hit.flight)
    assert xx + uu == pytest.approx(0.47506128917, abs=2e-12)
    assert xx * uu - xu * ux == pytest.approx(0.399502561982, abs=1e-12)
    estimate = differences(fixed, x, y)
    np.testing.assert_allclose([[xx, xu], [ux, uu]], estimate, atol=1e-10)
    assert np.trace(estimate) == pytest.approx(xx + uu, abs=1e-10)
    assert np.linalg.det(estimate) == pytest.approx(xx * uu - xu * ux, abs=1e-10)


@pytest.mark.parametrize("name", FALLING)
def test_the_jacobian_is_the_derivative_and_the_determinant_a_product(parameters, name):
    fixed = realization(parameters, name, 0.8, 0.4, 1.6)
    law = (fixed.base.restitution, fixed.e, fixed.scale)
    for x, y in ((0.1, 0.9), (-0.3, 0.6), (0.31, 1.3), (0.05, 0.2)):
        hit = impact(fixed, 0.0, x, y)
        xx, xu, ux, uu, _ = jacobian(fixed, hit.flight)
        np.testing.assert_allclose([[xx, xu], [ux, uu]], differences(fixed, x, y), atol=1e-7)
        # q y / z; `contraction` omits factors whose product over a cycle is 1
        determinant = slope(*law, hit.v) * y / hit.v
        assert xx * uu - xu * ux == pytest.approx(determinant, rel=1e-12)
        seen = contraction(fixed, hit.v) * density(fixed, y) / density(fixed, hit.u)
        assert seen == pytest.approx(determinant, rel=1e-12)


@pytest.mark.parametrize("name", FALLING)
def test_locked_orbits_attract_between_their_closed_forms(parameters, name):
    """0 < -G < 2 (1 + q e) / ((1 + q) (1 + e)), with q and e at the speed of the impact."""
    law = None
    for share in (1.0 - 1e-9, 1.0 + 1e-9):
        fixed = realization(parameters, name, 0.8, 0.4, 1.0)
        law = (fixed.base.restitution, fixed.e, fixed.scale)
        c = arrival_to_repeat(*law, 1.0)
        q, e = slope(*law, c), ratio(*law, c)
        steepest = 2.0 * (1.0 + q * e) / ((1.0 + q) * (1.0 + e))
        gamma = np.hypot(np.pi * (c - 1.0), steepest) * share
        fixed = realization(parameters, name, 0.8, 0.4, gamma)
        x = 0.5 - np.arcsin(np.pi * (c - 1.0) / gamma) / (2.0 * np.pi)
        assert fixed_holds(fixed, x, 1.0)
        assert bool(fixed_attracts(fixed, x, 1.0)) == (share < 1.0)
