"""Closed forms of a base of finite mass."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import brentq

from one_slot import is_clear, pattern, pattern_orbit
from vibrosweep import theory
from vibrosweep.errors import ParameterError
from vibrosweep.theory import sprung as coupled_theory
from vibrosweep.theory.sprung import (
    CoupledBase,
    find_cycle,
    monodromy,
    spectral_radius,
    staggered,
)

# Closed forms of a base of finite mass, against matrix exponentials and independent results.

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


# Periodic orbits on a base of finite mass, against motion followed from impact to impact.

SOFT = CoupledBase(0.9, 0.6, 0.01, 0.37, 0.05)


def reversing(base, k, particles=2):
    """Guess and find the orbit of particles in one slot whose order reverses."""
    ranks = np.arange(particles)
    return pattern_orbit(base, k, [ranks, ranks[::-1]])


def state_at_the_end(cycle):
    """Joint state just after the last impact: deviation, its velocity, heights and speeds."""
    base, end = cycle.base, cycle.time[-1]
    d, velocity = cycle.deviation[-1]
    recoil = base.mass_ratio * base.exchange * cycle.approach[-1]
    state = [d, velocity - recoil]
    for i in range(cycle.particle.max() + 1):
        j = np.flatnonzero(cycle.particle == i)[-1]
        s = end - cycle.time[j]
        height = base.drive(cycle.time[j])[0] + cycle.deviation[j, 0]
        state += [height + (cycle.speed[j] - s) * s, cycle.speed[j] - 2.0 * s]
    return np.array(state)


def fly(base, state, t):
    moved = state.copy()
    moved[:2] = coupled_theory.mount_propagator(base.natural, base.damping, t) @ state[:2]
    moved[2::2] += (state[3::2] - t) * t
    moved[3::2] -= 2.0 * t
    return moved


def followed(cycle, state):
    """State after one cycle; each impact in turn is found as a root."""
    base, now = cycle.base, cycle.time[-1] - cycle.periods
    for particle, at in zip(cycle.particle, cycle.time, strict=True):
        y = 2 + 2 * particle

        def clearance(t, state=state, now=now, y=y):
            moved = fly(base, state, t - now)
            return moved[y] - moved[0] - base.drive(t)[0]

        t = brentq(clearance, at - 1e-3, at + 1e-3, xtol=1e-15, rtol=1e-15)
        state, now = fly(base, state, t - now), t
        approach = base.drive(t)[1] + state[1] - state[y + 1]
        assert approach > 0.0
        state[y + 1] += base.exchange * approach
        state[1] -= base.mass_ratio * base.exchange * approach
    return fly(base, state, cycle.time[-1] - now)


CYCLES = {
    "two slots": lambda: staggered(SOFT, 2, [0, 1]),
    "over-damped": lambda: staggered(
        SOFT._replace(acceleration=1.1, mass_ratio=0.05, damping=1.5), 3, [0, 1]
    ),
    "three in one slot": lambda: reversing(SOFT._replace(mass_ratio=0.002), 1, 3),
    "resonant": lambda: staggered(SOFT._replace(natural=1.0), 1, [0]),
}


@pytest.mark.parametrize("name", CYCLES)
def test_a_cycle_repeats_and_its_tangent_map_is_that_of_the_motion(name):
    cycle = CYCLES[name]()
    state = state_at_the_end(cycle)
    assert is_clear(cycle)
    assert followed(cycle, state) == pytest.approx(state, abs=1e-11)
    step = 1e-6
    columns = [
        (followed(cycle, state + step * unit) - followed(cycle, state - step * unit)) / (2.0 * step)
        for unit in np.eye(state.size)
    ]
    # central differences are off by the square of the step and by roundings over the step
    assert monodromy(cycle) == pytest.approx(np.stack(columns, axis=1), rel=1e-6, abs=1e-7)


@pytest.mark.parametrize("name", CYCLES)
def test_volumes_contract_at_every_impact(name):
    """An impact multiplies relative height and velocity by -e; in between the mount dissipates.

    An impact leaves the motion of the centre of mass unchanged, whatever the masses.
    """
    cycle = CYCLES[name]()
    e, _, _, natural, damping = cycle.base
    lost = np.exp(-2.0 * damping * (2.0 * np.pi * natural) * cycle.periods)
    shrunk = e ** (2.0 * cycle.time.size) * lost
    assert np.linalg.det(monodromy(cycle)) == pytest.approx(shrunk, rel=1e-11)


@pytest.mark.parametrize(
    ("natural", "radius"), [(0.21, 0.948), (0.37, 0.947), (0.77, 0.953), (1.60, 1.070)]
)
def test_spectral_radii_known_from_an_independent_computation(natural, radius):
    cycle = staggered(SOFT._replace(natural=natural), 2, [0, 1])
    assert spectral_radius(cycle) == pytest.approx(radius, abs=5e-4)


@pytest.mark.parametrize(("k", "separation"), [(1, 0.00234), (2, 0.00400)])
def test_separations_known_from_simulated_orbits(k, separation):
    cycle = reversing(SOFT._replace(mass_ratio=0.001), k)
    assert np.diff(cycle.time)[[0, 2]] == pytest.approx(separation, abs=5e-6)
    assert spectral_radius(cycle) < 1.0


def test_the_separation_of_first_order_is_off_in_proportion_to_the_mass_ratio():
    off = []
    for mass_ratio in (1e-4, 2e-4, 4e-4):
        apart = np.diff(reversing(SOFT._replace(mass_ratio=mass_ratio), 2).time)[0]
        off.append(apart / coupled_theory.reversing_separation(2, 0.9, 0.6, mass_ratio) - 1.0)
    assert abs(off[0]) < 1e-3
    assert np.divide(off[1:], off[:-1]) == pytest.approx(2.0, rel=0.01)


@pytest.mark.parametrize(("k", "slots"), [(2, [0, 1]), (2, [1]), (4, [0, 2])])
def test_evenly_spaced_slots_have_a_closed_form(k, slots):
    base = CoupledBase(0.9, 0.9, 0.005, 0.37, 0.3)
    exact = staggered(base, k, slots)
    found = find_cycle(base, k, exact.time + 1e-3, exact.particle, k)
    for name in ("time", "speed", "approach", "deviation"):
        assert getattr(found, name) == pytest.approx(getattr(exact, name), abs=1e-11), name


def test_no_cycle_is_found_where_there_is_none():
    with pytest.raises(ParameterError, match="no particle can be locked to k = 2"):
        staggered(SOFT._replace(acceleration=0.3), 2, [0])
    with pytest.raises(ParameterError, match="found no orbit"):
        find_cycle(SOFT, 2, [0.4, 0.8], [0, 1], 2)
    for slots in ([0, 2], [1, 1], [-1], []):
        with pytest.raises(ParameterError, match="different numbers from 0 to 1"):
            staggered(SOFT, 2, slots)


def test_an_orbit_through_the_base_is_not_clear():
    # the other branch of landing phases: the particle leaves a base that is about to rise fast
    base = CoupledBase(0.2, 9.0, 0.0, 0.37, 0.05)
    phase = coupled_theory.landing_phase(9.0, 1, 0.2, 0.0, 0.37, 0.05)
    assert not is_clear(find_cycle(base, 1, [0.5 - phase], [0], 1))


@pytest.mark.parametrize("spacing", [0.0, -1.0, np.nan, np.inf, "x"])
def test_recoils_are_a_positive_time_apart(spacing):
    with pytest.raises(ParameterError, match=r"^spacing = "):
        coupled_theory.recoil_deviation(0.37, 0.05, spacing)
