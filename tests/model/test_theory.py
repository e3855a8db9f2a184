"""Closed forms against published values, the map's Jacobian and exact rational arithmetic."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from vibrosweep import theory

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


@pytest.mark.parametrize("e", [0.5, 0.25])
@pytest.mark.parametrize("n", [1, 2, 3, 7, 30, 100])
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


@pytest.mark.parametrize("e", [0.0, 0.3, 0.9, 0.999, 1 - 1e-9, 1 - 1e-12])
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
