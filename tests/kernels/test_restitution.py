"""Laws of restitution over all bases."""

from itertools import pairwise

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

import vibrosweep as vs
from tests.cases import each_of
from tests.scenes import STILL_MOVING
from vibrosweep.kernels.bases import (
    constants,
    contraction,
    density,
    fixed_attracts,
    fixed_holds,
    fixed_residual,
    jacobian,
    rebound_error,
)
from vibrosweep.kernels.bases.sprung import mount, recoil, recoil_share
from vibrosweep.kernels.impact import base_of, impact
from vibrosweep.kernels.restitution import (
    arrival_to_repeat,
    lost_speed,
    ratio,
    ratio_error,
    restitution_of,
    scale_of,
    slope,
    slope_range,
)
from vibrosweep.kernels.settle import EXACT
from vibrosweep.kernels.waveforms import Sine
from vibrosweep.model.parameters import dimensionless, mounts
from vibrosweep.model.restitution_laws import PADE, points_of, restitution_at, text_of
from vibrosweep.proof.reference.laws import Laws

# Laws of restitution: values, slopes and their errors against ball arithmetic and a contact.

POWER, POINTS = "power(0.3)", "points([[0.2, 0.8], [0.4, 0.75], [0.7, 0.7], [1.0, 0.7]])"
FALLING = ("plastic", "viscoelastic", POWER, POINTS)
STEPPED = (*FALLING[:1], POWER, POINTS)  # whose slopes jump
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
        assert abs(slope(*law, v) - derivative) <= 32.0 * HALF_ULP or name in STEPPED


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
    assert ratio(*law, 0.0) == slope(*law, 0.0) == (0.8 if name in STEPPED else 1.0)
    assert lost_speed(*law, 2.0, 1.0) == pytest.approx(2.0 * (1.0 - ratio(*law, 2.0)))
    assert np.isnan(ratio(*law, np.nan)) or name in STEPPED


@given(v=SPEEDS, e=RESTITUTIONS, speed=SPEEDS)
def test_the_power_of_a_quarter_is_the_plastic_law(v, e, speed):
    power, plastic = numbers("power(0.25)", e, speed), numbers("plastic", e, speed)
    error = ratio_error(*power, v) + ratio_error(*plastic, v)
    assert ratio(*power, v) == pytest.approx(ratio(*plastic, v), rel=error)
    assert ratio(*numbers("power(0)", e, speed), v) == e


@st.composite
def tables(draw):
    """Points between which neither e(v) rises nor E(v) falls."""
    speeds = sorted(draw(st.lists(st.floats(0.01, 10.0), min_size=2, max_size=16, unique=True)))
    assume(min(np.diff(speeds)) > 1e-9)
    ratios = [draw(st.floats(0.3, 1.0))]
    for low, high in pairwise(speeds):  # -de/dv is below e / v
        least = ratios[-1] * high / (2.0 * high - low)
        ratios.append(draw(st.floats(0.0, 0.99)) * (least - ratios[-1]) + ratios[-1])
    return list(zip(speeds, ratios, strict=True))


@given(points=tables(), v=st.floats(1e-9, 20.0), width=st.floats(0.0, 2.0), speed=SPEEDS)
def test_points_are_met_and_joined_by_lines(points, v, width, speed):
    name = text_of("points", points_of(points))
    law, unit = numbers(name, 0.5, speed), points[-1][0] / speed
    with ctx.workprec(200):
        exact = exactly(name, 0.5, speed)
        for at in (v / unit, *(known / unit for known, _ in points)):
            kept = exact.share(arb(at))
            assert abs(ratio(*law, at) / kept - 1) <= ratio_error(*law, at)
            low, high = slope_range(*law, at, at * (1.0 + width))
            for share in (0.0, 0.4, 1.0):  # at a point a ball holds both slopes, to 30 bits
                assert (
                    low - 1e-8 <= exact.slope(arb(at) * (1.0 + share * arb(width))) <= high + 1e-8
                )
        plain = np.interp(v, *np.array(points).T)
        assert float(exact.share(arb(v) / unit)) == pytest.approx(plain, rel=1e-12)
        assert restitution_at(v, 0.5, name) == plain
        c = arrival_to_repeat(*law, v / unit)
        kept = exact.kept(arb(c))
        assert abs(c + kept - 2 * arb(v / unit)) <= 64.0 * HALF_ULP * c


def realization(parameters, name, rebound="rest", **given):
    batch = parameters(gravity=2.0, frequency=1.0, contact_time=1e-4, **given)
    return constants(
        base_of("high-bounce", rebound, restitution=name), dimensionless(batch, 1.0), 0
    )


@each_of("rebound", ["rest", "reflect"])
@each_of("name", FALLING)
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


# Laws of restitution over bases that move: multipliers of locked orbits, slopes and bounds.

STEP = 1e-4


def realization_restitution_moving(parameters, name, e, speed, gamma, r=1e-9):
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
    fixed = realization_restitution_moving(parameters, "plastic", 0.9, 0.5, 0.6)
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
    fixed = realization_restitution_moving(parameters, name, 0.8, 0.4, 1.6)
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
        fixed = realization_restitution_moving(parameters, name, 0.8, 0.4, 1.0)
        law = (fixed.base.restitution, fixed.e, fixed.scale)
        c = arrival_to_repeat(*law, 1.0)
        q, e = slope(*law, c), ratio(*law, c)
        steepest = 2.0 * (1.0 + q * e) / ((1.0 + q) * (1.0 + e))
        gamma = np.hypot(np.pi * (c - 1.0), steepest) * share
        fixed = realization_restitution_moving(parameters, name, 0.8, 0.4, gamma)
        x = 0.5 - np.arcsin(np.pi * (c - 1.0) / gamma) / (2.0 * np.pi)
        assert fixed_holds(fixed, x, 1.0)
        assert bool(fixed_attracts(fixed, x, 1.0)) == (share < 1.0)


# Laws of restitution over a base of finite mass: massless particles, recoil and its slope.


def test_without_mass_particles_move_as_over_the_moving_base():
    scene = {"restitution": 0.8, "amplitude": 1.4, "launch_time": [0.0, 0.3], "duration": 6.0}
    scene |= {"restitution_law": "plastic", "restitution_speed": 1.0}
    moving = vs.simulate(base="moving", **scene)
    mount = {"base": "sprung", "mass_ratio": 0.0, "mount_frequency": 0.4}
    sprung = vs.simulate(**scene, **mount, **STILL_MOVING)
    assert np.array_equal(sprung.impact_count, moving.impact_count)
    for key in ("landing_time", "rebound_velocity"):
        np.testing.assert_allclose(sprung[key], moving[key], rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("name", FALLING)
def test_momentum_is_conserved_and_the_slope_is_the_derivative(parameters, name):
    given = {"restitution": 0.8, "restitution_speed": 1.0, "mass_ratio": 0.2}
    batch = parameters(mount_frequency=0.4, mount_damping=0.1, gravity=2.0, **given)
    known = mounts(batch, restitution_of(name), Sine())
    fixed = mount(dimensionless(batch, 1.0), known, 0)
    for c in (0.3, 2.0, 7.0):
        lost = recoil(fixed, 0, c, False)
        # the base loses the momentum that the particle gains: 0.2 times c + E(c) less the recoil
        gained = c + ratio(fixed.law, fixed.e, fixed.scale, c) * c - lost
        assert lost == pytest.approx(0.2 * gained, rel=1e-14)
        change = recoil(fixed, 0, c + 1e-5, False) - recoil(fixed, 0, c - 1e-5, False)
        q = slope(fixed.law, fixed.e, fixed.scale, c)
        assert recoil_share(fixed, 0, q, False) == pytest.approx(change / 2e-5, rel=1e-8)
