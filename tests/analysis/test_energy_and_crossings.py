"""The balance of Eq. 26 as an identity, and crossings against sampled heights."""

import numpy as np
import pytest

from vibrosweep import simulate, theory
from vibrosweep.analysis.energy import energy_balance
from vibrosweep.analysis.equal_heights import crossings
from vibrosweep.analysis.records import flights
from vibrosweep.errors import DataError


def test_the_balance_is_its_two_parts():
    rng = np.random.default_rng(3)
    record = simulate(
        restitution=rng.uniform(0.3, 0.98, 30),
        amplitude=rng.uniform(0.2, 3.5, 30),
        frequency=rng.uniform(0.5, 3.0, 30),
        phase=rng.uniform(-3.0, 3.0, 30),
        launch_time=[0.0, 0.3, 0.7],
        duration=20.0,
    )
    found = energy_balance(record)
    assert int(found["rests"].sum()) > 100
    np.testing.assert_allclose(
        found["balance"], found["end_effect"] + found["rest_effect"], atol=1e-11
    )


@pytest.mark.parametrize(("mode", "amplitude"), [(1, 0.7), (1, 2.9), (2, 1.2), (3, 3.0)])
def test_a_locked_orbit_is_in_balance(mode, amplitude):
    phase = float(theory.locked_phase(mode, 0.9, amplitude))
    speed = float(theory.locked_velocity(mode))
    record = simulate(amplitude=amplitude, launch_velocity=speed, launch_time=phase, duration=200.0)
    found = energy_balance(record, impacts=1)
    assert int(found["balanced_impacts"][0, 0]) == 1
    np.testing.assert_allclose(found["mean_kick"], 0.1 * speed, rtol=1e-9)
    assert abs(float(found["balance"][0, 0])) < 1e-9
    assert abs(float(found["energy_balance"][0, 0])) < 1e-8


def test_a_doubled_orbit_is_in_balance_over_two_impacts_only():
    # right above A_max(1) = 3.00677 the orbit has two impacts in two periods
    record = simulate(amplitude=3.05, launch_velocity=4.905, launch_time=0.4737, duration=2000.0)
    both, one = energy_balance(record, impacts=2), energy_balance(record, impacts=1)
    assert abs(float(both["balance"][0, 0])) < 1e-10
    assert abs(float(one["balance"][0, 0])) > 0.1


def test_the_balance_needs_its_variables():
    record = simulate(duration=3.0).drop_vars("rested")
    with pytest.raises(DataError, match=r"energy_balance needs variable.*rested.*\[record\]"):
        energy_balance(record)


def heights(each, particle, at, gravity):
    """Height of a particle at some instants; 0 on the base."""
    y = np.zeros_like(at)
    for own in np.flatnonzero(each.particle == particle):
        x = at - each.start[own]
        inside = (x >= 0) & (at <= each.end[own])
        y[inside] = (x * (each.velocity[own] - 0.5 * gravity * x))[inside]
    return y


def test_crossings_are_all_found_and_at_one_height():
    record = simulate(launch_time=[0.0, 0.13, 0.4], duration=6.0, gravity=8.0)
    found, each = crossings(record), flights(record, 0, "test")
    pairs = np.stack([found["first"], found["second"]])
    for i, j in ((0, 1), (0, 2), (1, 2)):
        own = np.all(np.sort(pairs, axis=0) == np.array([[i], [j]]), axis=0)
        time = found["time"].values[own]
        for particle in (i, j):
            y = heights(each, particle, time, 8.0)
            np.testing.assert_allclose(y, found["height"].values[own], atol=1e-12)
        # a dense sampling sees the same number of changes of sign while both are in the air
        at = np.linspace(0.0, 6.0, 600_001)
        a, b = (heights(each, particle, at, 8.0) for particle in (i, j))
        sign = np.sign(a - b)
        airborne = (a[1:] > 0) & (b[1:] > 0) & (a[:-1] > 0) & (b[:-1] > 0)
        assert np.count_nonzero((sign[1:] * sign[:-1] < 0) & airborne) == time.size
    assert found.sizes["crossing"] > 20
    assert np.all(np.diff(found["time"]) >= 0)
    assert int(found["pairs"]) == int(found["pairs_crossing"]) == 3


def test_equal_flights_cross_half_way():
    # thrown upwards s apart with one speed v they meet at t = s / 2 + v / g after the first
    record = simulate(amplitude=0.0, launch_time=[0.0, 0.2], duration=1.1, gravity=10.0)
    found = crossings(record)
    np.testing.assert_allclose(found["time"].values[:1], [0.1 + 0.5])
    assert (int(found["first"][0]), int(found["second"][0])) == (0, 1)


def test_particles_that_fly_together_do_not_cross():
    found = crossings(simulate(launch_time=[0.0, 0.0], duration=5.0))
    assert found.sizes["crossing"] == 0
    assert int(found["flights_alike"]) == int(found["flight_overlaps"]) > 3
    assert int(found["pairs_crossing"]) == 0


def test_a_particle_at_rest_for_good_flies_no_more():
    record = simulate(amplitude=0.0, restitution=0.2, launch_time=[0.0, 0.5], duration=50.0)
    each = flights(record, 0, "test")
    assert np.all(each.end[each.particle == 0] < 2.0)
    assert np.all(each.end > each.start)


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
def test_each_impact_has_the_restitution_of_its_law(base):
    """Kick and loss of each impact explain its rebound: the balance is the sum of its parts."""
    record = simulate(
        base=base, amplitude=1.2, restitution=0.9, restitution_law="plastic",
        restitution_speed=1.0, duration=20.0, launch_time=[0.1, 0.4],
    )  # fmt: skip
    found = energy_balance(record)
    parts = found.end_effect + found.flight_effect + found.rest_effect
    assert abs(found.balance - parts).max() < 1e-13
    other = energy_balance(
        record.drop_vars("restitution_speed").assign_attrs(restitution_law="constant")
    )
    assert abs(other.balance - parts).max() > 0.01
