"""Orbits that repeat bit for bit: their regimes, cycles, and where the recurrence begins."""

import numpy as np
import pytest

from vibrosweep import simulate, theory
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.model.measures import Regime, Status
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.scene.scene import Scene


def observed(duration, *, launch="staggered", particles=8, rebound="rest", **keys):
    measures = Measures(**{"per_particle": True, "regimes": True, **keys})
    return Scene(particles, launch, duration, rebound, measures)


def scene(**given):
    size = max((np.size(v) for v in given.values()), default=1)
    return {n: np.full(size, given.get(n, p.default), float) for n, p in PARAMETERS.items()}


def run(parameters, observation):
    with Workers(2) as workers:
        return measure(parameters, observation, workers)


def test_a_locked_orbit_has_one_impact_in_each_period():
    found = run(scene(), observed(2000.0, launch=(0.125,), particles=1))
    assert found["regime"].item() == Regime.LOCKED
    assert (found["cycle_impacts"].item(), found["cycle_periods"].item()) == (1, 1)
    assert found["locked_count"].item() == 1


@pytest.mark.parametrize("k", [1, 2])
def test_the_period_doubles_above_the_upper_edge(k):
    edge = float(theory.amplitude_max(k, 0.8))
    amplitude = np.array([0.98 * edge, 1.01 * edge])
    speed = theory.locked_velocity(k).item()
    phase = 2.0 * np.pi * (theory.locked_phase(k, 0.8, amplitude) + 1e-3)
    parameters = scene(restitution=0.8, amplitude=amplitude, launch_velocity=speed, phase=phase)
    found = run(parameters, observed(50_000.0, launch=(0.0,), particles=1))
    assert found["regime"].ravel().tolist() == [Regime.LOCKED] * 2
    assert found["cycle_impacts"].ravel().tolist() == [1, 2]
    assert found["cycle_periods"].ravel().tolist() == [k, 2 * k]


def test_a_particle_without_excitation_is_at_rest():
    found = run(scene(amplitude=0.0), observed(200.0))
    assert np.all(found["regime"] == Regime.AT_REST)
    assert np.all(found["cycle_impacts"] == 0)


def test_the_record_repeats_from_the_recurrence_on():
    observation = observed(1500.0, launch=(0.0, 0.125), particles=2)
    found = run(scene(), observation)
    record = simulate(launch_time=[0.0, 0.125], duration=1500.0)
    for particle in range(2):
        impacts = int(found["cycle_impacts"][0, particle])
        periods = int(found["cycle_periods"][0, particle])
        assert impacts > 0
        times = record.landing_time.values[0, particle, : record.impact_count.values[0, particle]]
        rested = record.rested.values[0, particle, : times.size]
        late = np.flatnonzero(times > found["recurrent_from"][0, particle])[:-impacts]
        # times are doubles near 1500, of spacing 2.3e-13
        np.testing.assert_allclose(times[late + impacts], times[late] + periods, atol=1e-12)
        assert rested[late[:impacts]].sum() == found["cycle_rests"][0, particle]


def test_no_recurrence_is_claimed_before_it_happens():
    found = run(scene(restitution=0.98, amplitude=3.4), observed(12.0))
    assert np.all(found["regime"] == Regime.UNSETTLED)
    assert np.all(np.isnan(found["recurrent_from"]))
    assert found["unsettled_count"].item() == 8


@pytest.mark.parametrize("ratio", [1.05, 1.2, 2.0])
def test_an_orbit_that_makes_no_headway_has_no_cycle(ratio):
    """Flights are too short to change the phase: the state returns at the same instant."""
    tiny = 9.81 * 1e-18
    parameters = scene(
        amplitude=0.5 * ratio * tiny, contact_time=1e-18, launch_velocity=tiny, restitution=0.5
    )
    found = run(parameters, observed(3.0, launch=(0.2, 0.05), particles=2, impact_budget=3000))
    assert np.all(found["status"] == Status.BUDGET_EXCEEDED)
    assert np.all(found["regime"] == Regime.UNSETTLED)
    assert np.all(found["cycle_impacts"] == 0)
