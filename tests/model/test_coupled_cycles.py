"""Periodic orbits on a base of finite mass, against motion followed from impact to impact."""

import numpy as np
import pytest
from scipy.optimize import brentq

from one_slot import is_clear, pattern_orbit
from vibrosweep.errors import ParameterError
from vibrosweep.model import coupled_theory
from vibrosweep.model.coupled_theory import (
    CoupledBase,
    find_cycle,
    monodromy,
    spectral_radius,
    staggered,
)

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
