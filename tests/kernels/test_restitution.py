"""Laws of restitution: values, slopes and their errors against ball arithmetic and a contact."""

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from vibrosweep.kernels.bases import constants, contraction, fixed_attracts, jacobian, rebound_error
from vibrosweep.kernels.impact import base_of, impact
from vibrosweep.kernels.restitution import (
    lost_speed,
    ratio,
    ratio_error,
    restitution_of,
    scale_of,
    slope,
    slope_range,
)
from vibrosweep.kernels.settle import EXACT
from vibrosweep.model.parameters import dimensionless
from vibrosweep.model.restitution_laws import PADE
from vibrosweep.proof.reference.laws import Laws

FALLING = ("plastic", "viscoelastic")
HALF_ULP = 2.0**-53
SPEEDS = st.floats(1e-9, 1e9)
RESTITUTIONS = st.one_of(st.floats(0.46, 1.0), st.sampled_from([0.46, 1.0 - HALF_ULP, 1.0]))


def exactly(name, e, speed):
    return Laws(restitution=name).impact(arb(e), arb(speed))


def numbers(name, e, speed):
    law = restitution_of(name)
    return law, e, scale_of(law, e, speed)


def test_values_of_the_viscoelastic_law():
    law = numbers("viscoelastic", 0.8, 1.0)
    found = [ratio(*law, v) for v in (0.01, 0.1, 1.0, 10.0, 100.0)]
    expected = [0.9128211014984023, 0.8666193534358562, 0.8, 0.7089391881188506, 0.5937733048132544]
    assert found == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("b", "e", "above"),
    [(0.1, 0.892859, 5e-5), (0.2, 0.800965, 3e-4), (0.4, 0.654113, 1.2e-3), (0.8, 0.459740, 4e-3)],
)
def test_the_viscoelastic_law_is_near_a_contact_that_ends_when_its_force_is_zero(b, e, above):
    """x'' = -(x^1.5 + b x^0.5 x'), x' = 1 at first: P(b^0.5) slightly exceeds the final speed."""

    def force(_, state):
        x, v = max(state[0], 0.0), state[1]
        return x**1.5 + b * np.sqrt(x) * v

    def ends(t, state):  # the force over sqrt(x), which passes zero once
        return state[0] + b * state[1] if t > 0.0 else 1.0

    ends.terminal = True
    found = solve_ivp(
        lambda t, s: (s[1], -force(t, s)),
        (0.0, 20.0),
        (0.0, 1.0),
        "DOP853",
        events=ends,
        rtol=1e-11,
        atol=1e-12,
    )
    left = -found.y_events[0][0][1]
    assert left == pytest.approx(e, abs=2e-6)
    y, (n1, d2, d3, d4) = np.sqrt(b), PADE
    top = 1.0 + n1 * y
    pade = top / (top + y * y * (d2 + y * (d3 + y * d4)))
    assert pade - left == pytest.approx(above, rel=0.2)


@given(name=st.sampled_from(FALLING), e=RESTITUTIONS, speed=SPEEDS, v=SPEEDS)
def test_ratio_and_slope_are_within_their_bounds(name, e, speed, v):
    law = numbers(name, e, speed)
    with ctx.workprec(200):
        exact = exactly(name, e, speed)
        kept, derivative = exact.kept(arb(v)) / v, exact.slope(arb(v))
        assert abs(ratio(*law, v) / kept - 1) <= ratio_error(*law, v)
        low, high = slope_range(*law, v, v)
        assert low <= derivative <= high
        # a component of a Jacobian may be off by 16 half ulps of its terms, whose sum is at least 2
        assert abs(slope(*law, v) - derivative) <= 32.0 * HALF_ULP or name == "plastic"


@given(
    name=st.sampled_from(FALLING), e=RESTITUTIONS, v=st.floats(1e-3, 1e3), width=st.floats(0.0, 2.0)
)
def test_slopes_over_a_range_of_speeds_are_enclosed(name, e, v, width):
    law, high = numbers(name, e, 1.0), v * (1.0 + width)
    least, most = slope_range(*law, v, high)
    with ctx.workprec(120):
        for share in (0.0, 0.3, 0.7, 1.0):
            inside = arb(v) + share * (arb(high) - v)
            assert least <= exactly(name, e, 1.0).slope(inside) <= most
        whole = exactly(name, e, 1.0).slope(arb(v).union(arb(high)))
        assert whole.lower() <= least + 1e-12
        assert whole.upper() >= most - 1e-12


@given(name=st.sampled_from(FALLING), e=RESTITUTIONS, v=st.floats(1e-3, 1e3), step=st.floats(0, 1))
def test_the_mean_value_theorem_bounds_what_a_slope_leaves_out(name, e, v, step):
    law, other = numbers(name, e, 1.0), v * (1.0 + step)
    low, high = slope_range(*law, v, other)
    gained = ratio(*law, other) * other - ratio(*law, v) * v
    slack = 64.0 * HALF_ULP * other
    assert low * (other - v) - slack <= gained <= high * (other - v) + slack


def test_the_plastic_law_has_a_kink_where_yielding_begins():
    law = numbers("plastic", 0.8, 0.5)
    assert (slope(*law, 0.5), slope(*law, 0.5 + 1e-9)) == pytest.approx((0.8, 0.6))
    assert slope_range(*law, 0.4, 0.6)[1] - slope_range(*law, 0.4, 0.6)[0] > 0.2
    assert ratio(*law, 0.5 * 16.0) == pytest.approx(0.4, rel=1e-15)


@pytest.mark.parametrize("name", FALLING)
def test_the_slowest_impacts_keep_the_largest_share_of_their_speed(name):
    law = numbers(name, 0.8, 1.0)
    assert ratio(*law, 0.0) == slope(*law, 0.0) == (0.8 if name == "plastic" else 1.0)
    assert lost_speed(*law, 2.0, 1.0) == pytest.approx(2.0 * (1.0 - ratio(*law, 2.0)))
    assert np.isnan(ratio(*law, np.nan)) or name == "plastic"


def realization(parameters, name, rebound="rest", **given):
    batch = parameters(gravity=2.0, frequency=1.0, contact_time=1e-4, **given)
    return constants(
        base_of("high-bounce", rebound, restitution=name), dimensionless(batch, 1.0), 0
    )


@pytest.mark.parametrize("rebound", ["rest", "reflect"])
@pytest.mark.parametrize("name", FALLING)
def test_the_jacobian_is_the_derivative_and_its_determinant_the_slope(parameters, name, rebound):
    given = {"restitution": 0.8, "amplitude": 0.6, "restitution_speed": 0.3}
    fixed = realization(parameters, name, rebound, **given)
    for x, u in ((0.1, 0.7), (-0.4, 0.2), (0.3, 1.4), (0.45, 0.36)):
        hit = impact(fixed, 0.0, x, u)
        if not hit.leaves:
            continue
        (xx, xu, ux, uu, _), h = jacobian(fixed, hit.flight), 1e-6
        ahead, behind = impact(fixed, 0.0, x, u + h), impact(fixed, 0.0, x, u - h)
        assert uu == pytest.approx((ahead.u - behind.u) / (2.0 * h), rel=1e-6, abs=1e-6)
        assert abs(xx * uu - xu * ux) == pytest.approx(contraction(fixed, hit.v), rel=1e-12)
        assert rebound_error(fixed, hit.flight, EXACT, 0.0, EXACT) < 1e-14


@pytest.mark.parametrize("name", FALLING)
def test_locked_orbits_attract_up_to_the_closed_form(parameters, name):
    """-a w'(x) < 2 (1 + q): the multipliers are roots of z^2 - (1 + q + a w'(x)) z + q."""
    given = {"restitution": 0.8, "amplitude": 1.0, "restitution_speed": 0.3}
    law = numbers(name, 0.8, 0.3)
    need, q = lost_speed(*law, 1.0, 1.0), slope(*law, 1.0)
    last = np.hypot(need, (1.0 + q) / np.pi)
    for share, attracts in ((1.0 - 1e-9, True), (1.0 + 1e-9, False)):
        fixed = realization(parameters, name, **(given | {"amplitude": last * share}))
        x = 0.5 - np.arcsin(need / (last * share)) / (2.0 * np.pi)
        assert fixed_attracts(fixed, x, 1.0) is np.bool_(attracts) or (
            bool(fixed_attracts(fixed, x, 1.0)) == attracts
        )


def test_proved_constants():
    from law_error import STATED, check_schemes, prove, sample, slope_falls

    assert slope_falls()
    check_schemes()
    proved = prove()
    with ctx.workprec(128):
        found = sample(200, seed=3)
    assert all(found[name] <= proved[name] <= STATED[name] for name in STATED)
