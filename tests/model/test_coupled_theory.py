"""Closed forms of a base of finite mass, against matrix exponentials and independent results."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from one_slot import pattern
from vibrosweep import theory
from vibrosweep.model import coupled_theory
from vibrosweep.model.coupled_theory import CoupledBase

TWO_PI = 2.0 * np.pi
NATURAL = st.floats(0.05, 3.0)
DAMPING = st.floats(0.0, 3.0)
REVERSING = [[0, 1], [1, 0]]
OF_THREE = [[1, 0], [0, 1], [1, 0]]


def base(e=0.9, gamma=0.6, mass_ratio=0.01):
    return CoupledBase(e, gamma, mass_ratio, 0.37, 0.05)


def gaps(rank, k, mass_ratio=0.001):
    """Separations of two particles in the repeated landings of a pattern, e = 0.9, Gamma = 0.6."""
    times = pattern(base(mass_ratio=mass_ratio), k, rank)
    return times[:, 1] - times[:, 0]


@given(natural=NATURAL, damping=DAMPING | st.just(1.0), periods=st.floats(0.0, 3.0))
def test_the_free_base_moves_as_the_matrix_exponential_says(natural, damping, periods):
    w0 = TWO_PI * natural
    exact = expm(periods * np.array([[0.0, 1.0], [-w0 * w0, -2.0 * damping * w0]]))
    found = coupled_theory.mount_propagator(natural, damping, periods)
    scale = np.array([[1.0, 1.0 / w0], [w0, 1.0]])  # of position and velocity
    rounding = 1e-14 * (1.0 + w0 * periods * (1.0 + damping)) ** 2
    assert np.all(np.abs(found - exact) <= rounding * scale)


@given(natural=NATURAL, damping=st.floats(1e-3, 3.0), spacing=st.integers(1, 4))
def test_a_base_hit_regularly_repeats_and_damping_bounds_its_velocity(natural, damping, spacing):
    before = coupled_theory.recoil_deviation(natural, damping, spacing)
    phi = coupled_theory.mount_propagator(natural, damping, spacing)
    after = before - np.array([0.0, 1.0])
    rounding = 1e-13 * (1.0 + np.abs(before).max())
    assert phi @ after == pytest.approx(before, abs=rounding)
    assert before[1] <= 0.5 + rounding


@given(natural=NATURAL, mass_ratio=st.floats(0.0, 0.5), e=st.floats(0.1, 0.95))
def test_without_damping_locking_begins_at_one_plus_mu_times_the_acceleration(
    natural, mass_ratio, e
):
    for k in (1, 2, 3):
        if abs(np.sin(np.pi * natural * k)) < 1e-3:  # recoils add up without limit
            continue
        least = coupled_theory.locked_acceleration_min(k, e, mass_ratio, natural, 0.0)
        alone = np.pi * k * (1.0 - e) / (1.0 + e)
        assert least == pytest.approx(alone * (1.0 + mass_ratio), rel=1e-9)


def test_a_base_of_infinite_mass_locks_as_the_moving_base_does():
    e, gamma, k = 0.9, 0.6, np.array([1, 2, 3])
    amplitude = (1.0 + e) * gamma * 9.81 / TWO_PI
    phase = coupled_theory.landing_phase(gamma, k, e, 0.0, 0.37, 0.05)
    assert phase == pytest.approx(theory.locked_phase(k, e, amplitude), rel=1e-14)
    assert np.isnan(coupled_theory.landing_phase(0.3, 2, e, 0.0, 0.37, 0.05))


def test_separations_known_from_an_independent_computation():
    for k, first_order in ((1, 0.00235), (2, 0.00398)):
        apart = coupled_theory.reversing_separation(k, 0.9, 0.6, 0.001)
        assert apart == pytest.approx(first_order, abs=5e-6)
        assert np.abs(gaps(REVERSING, k)) == pytest.approx(float(apart), rel=1e-12)


def test_a_pattern_of_three_coexists():
    assert gaps(OF_THREE, 1) == pytest.approx([-0.00138, 0.00766, -0.00455], abs=5e-5)
    assert gaps(OF_THREE, 2).sum() > 0.0


def test_an_order_that_never_changes_is_no_pattern():
    for k in (1, 2, 3):
        assert pattern(base(), k, [[0, 1]]) is None
        assert pattern(base(), k, [[0, 1], [0, 1], [0, 1], [1, 0]]) is None


@given(particles=st.integers(2, 9), e=st.floats(0.3, 0.98), share=st.floats(0.05, 0.95))
def test_a_bunch_that_reverses_is_equally_spaced(particles, e, share):
    k, least, most = 2, np.pi * 2 * (1.0 - e) / (1.0 + e), 2.0 * (1.0 + e * e) / (1.0 + e) ** 2
    gamma = np.hypot(least, share * most)
    ranks = np.arange(particles)
    times = pattern(base(e, gamma), k, [ranks, ranks[::-1]])
    spacing = coupled_theory.reversing_separation(k, e, gamma, 0.01)
    assert np.diff(times[0]) == pytest.approx(np.full(particles - 1, spacing), rel=1e-9)
    assert times[1] == pytest.approx(-times[0], rel=1e-9, abs=1e-12 * spacing)


def test_where_one_particle_is_not_locked_there_is_no_bunch():
    for gamma in (0.3, 1.2):  # below the window of k = 2, and above it
        assert pattern(base(gamma=gamma), 2, REVERSING) is None
        assert np.isnan(coupled_theory.reversing_separation(2, 0.9, gamma, 0.01))
