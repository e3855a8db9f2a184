"""One impact against proved balls, and the two decisions that follow it."""

import math

import numpy as np
import pytest

from proved_pieces import step
from vibrosweep.kernels.bases import after_rest, lift_off, rebound
from vibrosweep.kernels.impact import impact, land

STATES = 3_000  # checks/map_error.py draws millions
HALF_ULP = 2.0**-53
SINE_ERROR = 2.4e-16  # see test_sine.py


@pytest.fixture(scope="module")
def impacts(constants_of):
    """Random states, their images by the kernel, and proved balls."""
    rng = np.random.default_rng(11)
    e = rng.choice([0.0, 1.0, 0.9], STATES)
    e[::2] = rng.uniform(0.0, 1.0, STATES // 2)
    a = rng.choice([0.0, 1.0], STATES) * 10.0 ** rng.uniform(-6.0, 2.0, STATES)
    x = rng.uniform(-0.5, 0.5, STATES)
    x[::5] = rng.choice([-0.5, -0.25, 0.0, 0.25, 0.5], x[::5].size)
    u = 10.0 ** rng.uniform(-9.0, 6.0, STATES)
    u[::7] = rng.integers(0, 9, u[::7].size) / 4.0
    rows = []
    for state in np.stack([e, a, x, u], axis=1).tolist():
        fixed = constants_of("rest", *state[:2])
        hit = impact(fixed, 0.0, *state[2:])
        w = rebound(fixed, hit.x, hit.v)
        rows.append((state, (hit.x, hit.n, w), step(*state, bits=128)))
    return rows


def test_a_landing_is_reduced_and_rounded_once(impacts):
    for (_, _, _, u), (phase, count, _), (exact_phase, exact_count, _) in impacts:
        assert -0.5 <= phase <= 0.5
        assert count in (math.floor(u) - 1, math.floor(u), math.ceil(u), math.ceil(u) + 1)
        # x and u - round(u) are exact, their sum is below 1; -1/2 and 1/2 are one instant
        off = (exact_phase - phase) + (exact_count - int(count))
        assert float(abs(off).abs_upper()) <= HALF_ULP / 2.0


def test_a_rebound_is_rounded_as_its_terms_are(impacts):
    for (e, a, _, u), (phase, _, w), (_, _, exact) in impacts:
        # roundings of the landing, the sine, the product and the sum
        sine, slope = abs(math.sin(2 * math.pi * phase)), 2 * math.pi * HALF_ULP / 2.0
        allowed = a * (SINE_ERROR + HALF_ULP * sine + slope) + HALF_ULP * abs(w)
        assert float(abs(exact - w).abs_upper()) <= allowed * (1.0 + 1e-9) + 1e-300
        assert abs(w - e * u) <= a * (1.0 + 2.0**-50) + HALF_ULP * (abs(w) + e * u) * 2.0


def test_reflect_turns_a_particle_back(impacts, constants_of):
    for (e, a, _, u), (phase, _, w), _ in impacts[:2000]:
        assert rebound(constants_of("reflect", e, a), phase, u) == abs(w)


def test_the_determinant_of_an_impact_is_the_restitution(impacts, constants_of):
    h = 2.0**-18
    for (e, a, x, u), _, _ in impacts:
        if u > 100.0 or a > 10.0:
            continue
        fixed = constants_of("rest", e, a)

        def image(dx, du, fixed=fixed, x=x, u=u):
            # the phase may leave the reduced interval by h, which the map allows
            hit = impact(fixed, 0.0, x + dx, u + du)
            return hit.x + hit.n, rebound(fixed, hit.x, hit.v)

        right, left, up, down = image(h, 0.0), image(-h, 0.0), image(0.0, h), image(0.0, -h)
        by_x = [(p - q) / (2 * h) for p, q in zip(right, left, strict=True)]
        by_u = [(p - q) / (2 * h) for p, q in zip(up, down, strict=True)]
        determinant = by_x[0] * by_u[1] - by_x[1] * by_u[0]
        # central differences leave (2 pi)^3 a h^2 / 6 in each slope, which cancel in the
        # determinant of the exact map; rounding of values up to e u + a leaves their ulp over h
        assert determinant == pytest.approx(e, rel=0, abs=1e-15 * (u + 10 * a + 1) / h)


@pytest.fixture
def resting(constants_of):
    """A scene with a threshold of rest of 0.1, which the kick passes at a phase of 0.05."""
    fixed = constants_of("rest", 0.9, 0.1 / math.sin(0.1 * math.pi), 0.1)
    assert after_rest(fixed) == (pytest.approx(0.05), 0.1)
    return fixed


@pytest.mark.parametrize("x", [-0.5, -0.2, 0.0, 0.1])
def test_a_particle_above_the_threshold_leaves_at_once(x, resting):
    w = float(np.nextafter(0.1, 1.0))
    assert lift_off(resting, 7.0, x, w) == (7.0, x, w, True)


def test_a_rest_ends_at_the_next_rise_of_the_kick(resting):
    rise, _ = after_rest(resting)
    behind = float(np.nextafter(rise, 1.0))
    for x, later in ((-0.5, 0), (-0.2, 0), (rise, 0), (behind, 1), (0.5, 1)):
        for w in (0.1, -3.0):  # w = r rests
            assert lift_off(resting, 7.0, x, w) == (7.0 + later, rise, 0.1, False)


def test_without_excitation_a_rest_never_ends(constants_of):
    still = constants_of("rest", 0.9, 0.0, 0.1)
    assert lift_off(still, 7.0, -0.2, 0.0) == (math.inf, 0.0, 0.0, False)


def test_whole_periods_do_not_change_a_landing():
    for u in (0.3, 0.75, 0.015625):
        for whole in (1.0, 1e6, 2.0**40):
            later = whole + u
            kept = later - whole  # u as rounded in a double of that size
            assert land(0.2, later) == (land(0.2, kept)[0], land(0.2, kept)[1] + whole)
