"""Closed forms of the high-bounce and the moving base."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from tests.cases import each_of
from vibrosweep import theory
from vibrosweep.errors import ParameterError

# Closed forms against published values, the map's Jacobian and exact rational arithmetic.

TABLE_1 = {"frequency": 1.0, "gravity": 9.81}
MODES = st.integers(1, 8)
RESTITUTION = st.floats(0.0, 1.0)
FORCING = {"frequency": st.floats(0.1, 50.0), "gravity": st.floats(1.0, 25.0)}


def jacobian(restitution, kick, cosine):
    """Jacobian of (x, u) -> (x', e u + a sin 2 pi x'), x' = x + u, for this cos 2 pi x'."""
    slope = 2.0 * np.pi * kick * cosine
    return np.array([[1.0, 1.0], [slope, restitution + slope]])


@pytest.mark.parametrize(
    ("k", "velocity", "height", "phase", "lowest", "highest", "modulus"),
    [
        (1, 4.905, 1.22625, 0.4329824002, 0.4905, 3.006766892180528, 0.9486832981),
        (2, 9.81, 4.905, 0.3476796901, 0.981, 3.124486820889624, 0.9486832981),
    ],
)
def test_locked_orbits_of_table_1(k, velocity, height, phase, lowest, highest, modulus):
    assert theory.locked_velocity(k) == pytest.approx(velocity, rel=1e-15)
    assert theory.locked_height(k) == pytest.approx(height, rel=1e-15)
    assert theory.locked_phase(k, 0.9, 1.2) == pytest.approx(phase, abs=5.1e-11)
    assert theory.amplitude_min(k, 0.9) == pytest.approx(lowest, rel=3e-16)
    assert theory.amplitude_max(k, 0.9) == pytest.approx(highest, rel=3e-16)
    assert abs(theory.multipliers(k, 0.9, 1.2)) == pytest.approx(modulus, abs=5.1e-11)


@given(k=MODES, e=RESTITUTION, share=st.floats(1e-3, 2.0), **FORCING)
def test_a_locked_orbit_is_a_fixed_point_of_the_map(k, e, share, frequency, gravity):
    forcing = {"frequency": frequency, "gravity": gravity}
    low, high = (f(k, e, **forcing) for f in (theory.amplitude_min, theory.amplitude_max))
    amplitude = low + share * (high - low)
    x = theory.locked_phase(k, e, amplitude, **forcing)
    kick = 2.0 * frequency * amplitude / gravity
    u = 2.0 * frequency * theory.locked_velocity(k, **forcing) / gravity
    assert u == pytest.approx(k, rel=4e-16)
    # sin 2 pi x is known to the rounding of x times its slope
    assert e * u + kick * math.sin(2.0 * math.pi * x) == pytest.approx(
        k, abs=1e-15 * (k + 8.0 * kick)
    )
    assert 0.25 <= x <= 0.5


@given(k=MODES, e=RESTITUTION, **FORCING)
def test_a_locked_orbit_begins_to_exist_at_the_lower_edge(k, e, frequency, gravity):
    assume(e < 1.0 - 1e-9)
    low = theory.amplitude_min(k, e, frequency, gravity)
    below, above = (
        theory.locked_phase(k, e, low * (1.0 + side * 1e-12), frequency, gravity)
        for side in (-1, 1)
    )
    assert np.isnan(below)
    # both branches are born where the sine is 1: sin 2 pi x = 1 - 1e-12
    assert above == pytest.approx(0.25, abs=1e-6)


@given(k=MODES, e=RESTITUTION, **FORCING)
def test_a_locked_orbit_loses_stability_at_the_upper_edge(k, e, frequency, gravity):
    edge = float(theory.amplitude_max(k, e, frequency, gravity))
    kick = 2.0 * frequency * edge / gravity
    need = (1.0 - e) * k
    # at the edge a multiplier is -1: the characteristic polynomial at -1 vanishes, and its slope
    # against the amplitude says how far from the edge a residual is
    a_cosine = -math.sqrt((kick - need) * (kick + need))
    residual = 2.0 * (1.0 + e) + 2.0 * math.pi * a_cosine
    slope = 2.0 * math.pi * kick**2 / abs(a_cosine)
    assert abs(residual) / slope < 1e-12
    for side, stable in ((-1, True), (1, False)):
        a = kick * (1.0 + side * 1e-3)
        cosine = -math.sqrt((a - need) * (a + need)) / a if a > need else math.nan
        if math.isnan(cosine):
            continue
        largest = np.max(np.abs(np.linalg.eigvals(jacobian(e, a, cosine))))
        # an eigenvalue of an undamped orbit inside the window lies on the unit circle
        assert largest <= 1.0 + 1e-9 if stable else largest > 1.0


@given(k=MODES, e=RESTITUTION, share=st.floats(0.0, 3.0))
@example(k=1, e=0.0, share=0.5)
@example(k=3, e=1.0, share=0.0)
def test_multipliers_are_the_eigenvalues_of_the_jacobian(k, e, share):
    low, high = theory.amplitude_min(k, e), theory.amplitude_max(k, e)
    amplitude = float(low + share * (high - low)) * (1.0 + 4e-16)
    kick, need = 2.0 * amplitude / 9.81, (1.0 - e) * k
    assume(kick > need)
    cosine = -math.sqrt((kick - need) * (kick + need)) / kick
    expected = np.linalg.eigvals(jacobian(e, kick, cosine))
    found = theory.multipliers(k, e, amplitude)
    apart = min(np.abs(found - order).max() for order in (expected, expected[::-1]))
    # a double eigenvalue moves by the root of a rounding
    assert apart < 2e-7 * (1.0 + np.abs(expected).max())


@given(k=MODES, e=RESTITUTION, share=st.floats(0.0, 3.0))
@example(k=1, e=1e-12, share=0.5)
@example(k=2, e=1e-300, share=2.0)
def test_product_of_the_multipliers_is_the_restitution(k, e, share):
    low, high = theory.amplitude_min(k, e), theory.amplitude_max(k, e)
    amplitude = low + share * (high - low)
    pair = theory.multipliers(k, e, amplitude)
    assume(not np.isnan(pair).any())  # rounding may put the amplitude below the lower edge
    assert complex(np.prod(pair)) == pytest.approx(e, rel=2e-15, abs=1e-320)


def test_below_the_lower_edge_there_is_no_multiplier():
    assert np.isnan(theory.multipliers(1, 0.9, 0.4)).all()
    assert theory.multipliers([[1], [2]], [0.5, 0.8, 0.9], 3.0).shape == (2, 3, 2)


@given(k=MODES, **FORCING)
def test_the_locked_height_is_that_of_a_throw_at_the_locked_velocity(k, frequency, gravity):
    v = theory.locked_velocity(k, frequency, gravity)
    height = theory.locked_height(k, frequency, gravity)
    assert height == pytest.approx(v**2 / (2.0 * gravity), rel=1e-15)
    assert 2.0 * v / gravity * frequency == pytest.approx(k, rel=1e-15)


@given(e=RESTITUTION, kick=st.floats(0.0, 10.0), u=st.floats(0.0, 100.0))
def test_no_kick_lifts_a_flight_over_the_bound(e, kick, u):
    bound = theory.flight_time_bound(u, kick, e)
    assert bound >= u
    for flight in (u, float(bound)):
        if math.isfinite(flight):
            assert e * flight + kick <= bound * (1.0 + 1e-15)
    assert (bound == math.inf) == (kick > 0.0 and (e == 1.0 or kick / (1.0 - e) == math.inf))


def rest_impact(u0, e, r):
    """The first n >= 1 with e^n u0 <= r, in exact arithmetic."""
    n, flight = 1, Fraction(u0) * Fraction(e)
    while flight > Fraction(r):
        n, flight = n + 1, flight * Fraction(e)
    return n, flight


@given(
    u0=st.floats(0.0, 100.0),
    e=st.sampled_from([0.0, 0.1, 0.25, 0.3, 0.5, 0.7, 0.9]),
    r=st.floats(1e-6, 10.0),
)
def test_unforced_rest_impact_in_exact_arithmetic(u0, e, r):
    n, flight = rest_impact(u0, e, r)
    near = (flight, flight / Fraction(e)) if e else (flight,)
    # e**n is rounded: within some roundings of equality either answer is right
    assume(all(f == r or abs(f / Fraction(r) - 1) > 1e-14 for f in near))
    assert theory.unforced_rest_impact(u0, e, r) == n


@each_of("e", [0.5, 0.25])
@each_of("n", [1, 2, 3, 7, 30, 100])
def test_unforced_rest_impact_decides_exact_ties(e, n):
    r = e**n  # exact
    assert theory.unforced_rest_impact(1.0, e, r) == n
    assert theory.unforced_rest_impact(1.0, e, np.nextafter(r, 1.0)) == n
    assert theory.unforced_rest_impact(1.0, e, np.nextafter(r, 0.0)) == n + 1


def test_an_elastic_particle_without_excitation_never_rests():
    assert theory.unforced_rest_impact(1.0, 1.0, 1e-3) == math.inf
    assert theory.unforced_rest_time(5.0, 1.0, 1e-4) == math.inf
    assert theory.unforced_rest_impact(1e-4, 1.0, 1e-3) == 1
    assert theory.unforced_rest_time(5.0, 1.0, 2.0) == 10.0 / 9.81


@each_of("e", [0.0, 0.3, 0.9, 0.999, 1 - 1e-9, 1 - 1e-12])
def test_unforced_rest_time_is_the_sum_of_the_flights(e):
    first = 10.0 / 9.81
    contact_time = first * max(e**3, 1e-5) * (1.0 + 1e-13)
    n = int(theory.unforced_rest_impact(first, e, contact_time))
    flights = Fraction(first) * sum(Fraction(e) ** j for j in range(n))
    assert n <= 3 or e < 0.99
    assert theory.unforced_rest_time(5.0, e, contact_time) == pytest.approx(
        float(flights), rel=1e-15
    )


def test_unforced_rest_time_tends_to_the_sum_of_all_flights():
    all_flights = 10.0 / 9.81 / (1.0 - 0.9)
    assert theory.unforced_rest_time(5.0, 0.9, 1e-30) == pytest.approx(all_flights, rel=1e-15)


def test_recognition_takes_longer_the_less_energy_is_lost():
    periods = theory.recognition_periods([0.0, 0.5, 0.9, 1.0])
    assert periods[0] == 0.0
    assert periods[1] == pytest.approx(216.4, abs=0.1)
    assert periods[2] == pytest.approx(1423.7, abs=0.1)
    assert periods[3] == math.inf
    assert theory.recognition_periods(0.9, 2) == 2.0 * periods[2]


# Closed forms of the moving base against flights that are followed in plain Python.

MODES_THEORY_MOVING = st.integers(1, 3)
RESTITUTION_THEORY_MOVING = st.floats(0.05, 0.95)
SHARES = st.floats(0.02, 0.98)
GRAVITY = 9.81


def gamma_of(amplitude, e, frequency=1.0, gravity=GRAVITY):
    """Acceleration of the base in g."""
    return 2.0 * math.pi * frequency * amplitude / ((1.0 + e) * gravity)


def amplitude_of(gamma, e):
    return gamma * (1.0 + e) * GRAVITY / (2.0 * math.pi)


def clearance(x, u, alpha, s):
    """Height above the base, s periods after leaving it at phase x with absolute speed u.

    The difference of two cosines is written as a product, which loses no digits for a small s.
    """
    fallen = np.sin(math.pi * s) * np.sin(math.pi * (2.0 * x + s))
    return s * (u - s) / 2.0 - alpha / (2.0 * math.pi) * fallen


def landing(x, u, alpha, after=1e-9, until=40.0, steps=40000):
    """First landing: the first change of sign on a fine grid of times, bisected."""
    s = np.linspace(after, until, steps)
    below = int(np.argmax(clearance(x, u, alpha, s) < 0.0))
    assert below > 0
    low, high = s[below - 1], s[below]
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if clearance(x, u, alpha, middle) > 0.0 else (low, middle)
    return 0.5 * (low + high)


def bounce(x, u, e, alpha, **grid):
    """Phase and absolute speed of lift-off after one flight and one impact."""
    s = landing(x, u, alpha, **grid)
    base = alpha * math.sin(2.0 * math.pi * (x + s))
    return x + s, e * (2.0 * s - u) + (1.0 + e) * base


def orbit(k, e, share):
    """Amplitude within the window of mode k, alpha, and phase of its stable branch."""
    low, high = theory.amplitude_min(k, e), theory.amplitude_max(k, e, base="moving")
    amplitude = float(low + share * (high - low))
    return amplitude, gamma_of(amplitude, e) / math.pi, float(theory.locked_phase(k, e, amplitude))


def derivatives(x, u, e, alpha, step=2e-4):
    """Jacobian of `bounce` by differences of fourth order."""
    near = {"until": 2.0 * u, "steps": 4000}

    def along(dx, du):
        a, b, c, d = (np.array(bounce(x + h * dx, u + h * du, e, alpha, **near)) for h in STENCIL)
        return (8.0 * (b - c) - (a - d)) / (12.0 * step)

    STENCIL = (2.0 * step, step, -step, -2.0 * step)
    return np.stack([along(1.0, 0.0), along(0.0, 1.0)], axis=-1)


@given(k=MODES_THEORY_MOVING, e=RESTITUTION_THEORY_MOVING, share=SHARES)
@example(k=1, e=0.05, share=0.02)
@example(k=3, e=0.95, share=0.98)
def test_a_locked_orbit_is_the_first_landing_and_repeats(k, e, share):
    _, alpha, x = orbit(k, e, share)
    landed, u = bounce(x, float(k), e, alpha)
    assert landed - x == pytest.approx(k, abs=1e-12)
    assert u == pytest.approx(k, abs=1e-11)


@given(k=MODES_THEORY_MOVING, e=RESTITUTION_THEORY_MOVING, share=SHARES)
def test_multipliers_are_those_of_the_flight(k, e, share):
    amplitude, alpha, x = orbit(k, e, share)
    jacobian = derivatives(x, float(k), e, alpha)
    pair = theory.multipliers(k, e, amplitude, base="moving")
    # the slope of the flight is of order 1, and a difference is good to 1e-16 / step
    assert complex(pair.sum()).real == pytest.approx(np.trace(jacobian), abs=1e-7)
    assert complex(pair.prod()).real == pytest.approx(np.linalg.det(jacobian), abs=1e-7)
    assert np.abs(pair).max() < 1.0
    assert math.log(abs(pair.prod())) == pytest.approx(theory.exponent_sum(e, "moving"), rel=1e-9)


@given(
    e=RESTITUTION_THEORY_MOVING,
    x=st.floats(-0.5, 0.5),
    gamma=st.floats(0.0, 0.9),
    y=st.floats(0.5, 4.0),
)
def test_an_impact_contracts_by_the_quotient_of_the_relative_speeds(e, x, gamma, y):
    alpha = gamma / math.pi
    u = y + alpha * math.sin(2.0 * math.pi * x)
    phase, speed = bounce(x, u, e, alpha)
    after = speed - alpha * math.sin(2.0 * math.pi * phase)
    jacobian = derivatives(x, u, e, alpha, step=1e-4)
    assert np.linalg.det(jacobian) == pytest.approx(e * e * y / after, rel=1e-6)


@given(k=MODES_THEORY_MOVING, e=RESTITUTION_THEORY_MOVING)
def test_the_window_in_amplitude_is_that_in_base_acceleration(k, e):
    lowest = math.pi * k * (1.0 - e) / (1.0 + e)
    steepest = 2.0 * (1.0 + e * e) / (1.0 + e) ** 2
    low, high = (end(k, e, base="moving") for end in (theory.amplitude_min, theory.amplitude_max))
    assert gamma_of(low, e) == pytest.approx(lowest, rel=1e-14)
    assert gamma_of(high, e) == pytest.approx(math.hypot(lowest, steepest), rel=1e-14)
    pair = theory.multipliers(k, e, high, base="moving")
    assert np.abs(pair + 1.0).min() < 1e-6 / (1.0 - e)  # the other is -e^2
    for side in (-1.0, 1.0):
        beside = theory.multipliers(k, e, high * (1.0 + side * 1e-6), base="moving")
        assert (np.abs(beside).max() > 1.0) == (side > 0.0)


@pytest.mark.parametrize(
    ("e", "gamma"), [(0.9, 1.016311), (0.7, 1.170731), (0.5, 1.526824), (0.0, 3.724192)]
)
def test_mode_1_is_stable_up_to_the_known_acceleration(e, gamma):
    assert gamma_of(theory.amplitude_max(1, e, base="moving"), e) == pytest.approx(gamma, abs=6e-7)


@each_of("k", [1, 2, 3, 4, 7, 12])
def test_no_closed_form_is_given_where_the_first_flight_meets_the_base_on_its_way(k):
    def meets(e):
        alpha = k * (1.0 - e) / (1.0 + e)
        s = np.linspace(1e-3, 0.999, 200_001) * min(0.5, k)
        return clearance(0.25, float(k), alpha, s).min() < 0.0

    low, high = 1e-5, 0.03
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if meets(middle) else (low, middle)
    known = {1: 0.020458, 2: 0.004833, 3: 0.002127}
    assert high == pytest.approx(known.get(k, high), abs=5e-7)
    assert theory.amplitude_min(k, high * (1.0 + 1e-5), base="moving") > 0.0
    for e in (high * (1.0 - 1e-5), 1e-300):
        with pytest.raises(ParameterError, match=r"restitution = .*mode .*grazes.*no closed form"):
            theory.amplitude_min([1, k, 1], [0.9, e, 0.0], base="moving")
    assert theory.amplitude_min(k, low) == (1.0 - low) * theory.locked_velocity(k)


@given(k=st.integers(1, 40))
def test_without_restitution_the_orbit_begins_with_a_flight_after_a_rest_of_no_time(k):
    gamma = gamma_of(theory.amplitude_min(k, 0.0, base="moving"), 0.0)
    assert theory.liftoff_flight(gamma) == pytest.approx(k, rel=1e-13)
    assert gamma < gamma_of(theory.amplitude_max(k, 0.0, base="moving"), 0.0)


@given(
    k=MODES_THEORY_MOVING, e=RESTITUTION_THEORY_MOVING, share=SHARES, frequency=st.floats(0.1, 50.0)
)
def test_the_apex_is_the_highest_point_of_the_flight(k, e, share, frequency):
    alpha, x = orbit(k, e, share)[1:]
    start = -alpha / (4.0 * math.pi) * math.cos(2.0 * math.pi * x)
    s = np.linspace(0.0, k, 2001)  # includes the middle of the flight
    highest = (start + s * (k - s) / 2.0).max() * GRAVITY / frequency**2  # one unit is g / f^2
    amplitude = amplitude_of(math.pi * alpha, e) / frequency
    found = theory.locked_apex(k, e, amplitude, frequency, GRAVITY)
    assert found == pytest.approx(highest, rel=1e-9)
    assert found > theory.locked_height(k, frequency, GRAVITY)


def test_there_is_no_apex_where_there_is_no_orbit():
    assert np.isnan(theory.locked_apex(1, 0.9, 0.49))


def test_the_first_flight_after_a_rest_is_the_first_landing():
    gamma = np.concatenate([1.0 + np.geomspace(1e-3, 0.3, 50), np.linspace(1.4, 12.0, 50)])
    for one, flight in zip(gamma, theory.liftoff_flight(gamma), strict=True):
        x, alpha = math.acos(-1.0 / one) / (2.0 * math.pi), one / math.pi
        u = alpha * math.sin(2.0 * math.pi * x)
        # at first the height above the base grows as the cube of the time
        found = landing(x, u, alpha, after=1e-2 * flight, until=6.0)
        # near a landing without relative speed the error grows to the cube root of a rounding
        assert flight == pytest.approx(found, rel=1e-7 if one < 1.1 else 1e-8)


def test_the_first_flight_solves_its_equation():
    q = np.linspace(0.5, 60.0, 120)
    q = q[np.abs(np.tan(q / 2.0) - q / 2.0) > 0.1]  # away from landings without relative speed
    needed = (q * q / 2.0 + np.cos(q) - 1.0) / (q - np.sin(q))
    flight = theory.liftoff_flight(np.hypot(1.0, needed))
    assert 2.0 * math.pi * flight == pytest.approx(q, rel=1e-9)
    assert theory.liftoff_flight(math.hypot(1.0, math.pi)) == pytest.approx(1.0, rel=1e-14)
    assert np.isnan(theory.liftoff_flight([0.0, 0.5, 1.0])).all()


def test_the_first_flight_grows_as_the_root_of_what_exceeds_gravity():
    above = np.array([1e-6, 1e-4])
    q = 2.0 * math.pi * theory.liftoff_flight(1.0 + above)
    # h(q) = q / 4 + q^3 / 240 + ..., and Gamma is rounded
    assert q / 4.0 + q**3 / 240.0 == pytest.approx(np.sqrt(above * (2.0 + above)), rel=1e-8)


def test_the_first_flight_ends_without_relative_speed_where_its_half_is_its_tangent():
    half = 4.493409457909064  # the first t > 0 with t = tan t
    gamma = math.hypot(1.0, half)  # h is t there
    # a triple root: a rounding moves it by the cube root of the rounding
    assert math.pi * theory.liftoff_flight(gamma) == pytest.approx(half, rel=1e-4)
    x, alpha = math.acos(-1.0 / gamma) / (2.0 * math.pi), gamma / math.pi
    s = half / math.pi
    u = alpha * math.sin(2.0 * math.pi * x)
    relative = 2.0 * s - u + alpha * math.sin(2.0 * math.pi * (x + s))
    assert clearance(x, u, alpha, s) == pytest.approx(0.0, abs=1e-14)
    assert relative == pytest.approx(0.0, abs=1e-13)


@given(
    e=st.floats(0.0, 0.95),
    x=st.floats(-0.5, 0.5),
    gamma=st.floats(0.01, 20.0),
    y=st.floats(0.01, 1.0),
)
@example(e=0.5, x=-0.25, gamma=20.0, y=0.01)
@example(e=0.0, x=0.24959065967427374, gamma=1.5, y=1.0)
def test_no_landing_lifts_over_the_bound(e, x, gamma, y):
    alpha = gamma / math.pi
    kick = (1.0 + e) * alpha
    bound = float(theory.liftoff_speed_bound(0.0, kick, e, "moving"))
    longest = float(theory.flight_time_bound(0.0, kick, e, "moving"))
    # any absolute speed of lift-off up to the bound, which is y = 1
    slowest = alpha * math.sin(2.0 * math.pi * x)
    u = slowest + y * (bound - slowest)
    assume(u - slowest > 1e-12 * bound)  # it leaves faster than the base by more than rounding
    s = landing(x, u, alpha, after=1e-6 * (bound - slowest), until=1.01 * longest, steps=4000)
    assert s <= longest
    speed = e * (2.0 * s - u) + kick * math.sin(2.0 * math.pi * (x + s))
    assert speed <= bound * (1.0 + 1e-12)


def test_the_bound_of_the_speed_is_reached_by_three_quarters():
    # by a flight from where the base is highest to where it rises fastest: the bound is not idle
    e, alpha = 0.5, 1.0
    bound = float(theory.liftoff_speed_bound(0.0, 1.5, e, "moving"))
    phases = np.linspace(-0.5, 0.5, 201)
    highest = max(bounce(x, bound, e, alpha, until=20.0)[1] for x in phases)
    assert 0.75 * bound < highest <= bound


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
def test_bounds_without_kick_and_without_loss(base):
    for bound in (theory.liftoff_speed_bound, theory.flight_time_bound):
        assert bound(2.0, 0.0, 1.0, base) == 2.0
        assert bound(2.0, 0.1, 1.0, base) == math.inf


@given(e=RESTITUTION_THEORY_MOVING, x=st.floats(-0.5, 0.5), u=st.floats(0.3, 5.0))
def test_a_slow_base_is_met_as_the_high_bounce_map_says(e, x, u):
    """At fixed (x, u) flight and speed differ from those of the map in proportion to Gamma."""
    limit = (math.cos(2.0 * math.pi * (x + u)) - math.cos(2.0 * math.pi * x)) / (2.0 * u)
    for gamma in (1e-3, 1e-4):
        alpha = gamma / math.pi
        s = landing(x, u, alpha, after=0.1, until=6.0, steps=600)
        longer = s - u
        assert longer / gamma == pytest.approx(limit / math.pi**2, abs=2.0 * gamma / u**2)
        # the landing is later by `longer`, and the speed of arrival greater by twice `longer`
        _, speed = bounce(x, u, e, alpha, after=0.1, until=6.0, steps=600)
        mapped = e * u + (1.0 + e) * alpha * math.sin(2.0 * math.pi * (x + u))
        turned = (1.0 + e) * alpha * 2.0 * math.pi * abs(longer)
        assert abs(speed - mapped - 2.0 * e * longer) <= turned + 1e-14


@given(k=st.integers(1, 8), gamma=st.floats(1e-9, 1e-2))
def test_windows_meet_where_locked_orbits_reach_small_accelerations(k, gamma):
    """At the least Gamma of mode k, (1 - e) / (1 + e) = Gamma / (pi k): e -> 1 as Gamma -> 0."""
    quotient = gamma / (math.pi * k)
    e = (1.0 - quotient) / (1.0 + quotient)
    ends = [theory.amplitude_max(k, e, base=base) for base in ("high-bounce", "moving")]
    apart = float(ends[1] / ends[0]) - 1.0
    assert -1e-15 <= apart <= quotient**2 + 1e-15  # s_m = 1 + (Gamma_k / (pi k))^2
    assert theory.exponent_sum(e, "moving") == 2.0 * theory.exponent_sum(e)
    assert theory.recognition_periods(e, k, "moving") == theory.recognition_periods(e, k) / 2.0


def test_an_unknown_base_is_named():
    with pytest.raises(ParameterError, match=r"'shaker'.*high-bounce, moving"):
        theory.multipliers(1, 0.9, 1.2, base="shaker")
