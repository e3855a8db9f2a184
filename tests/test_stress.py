"""The quick part of the stress suite; checks/stress.py is the whole of it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("flint")

from map_error import LOCKED, box_states, locked_row, orbit_states, step_all, step_errors
from sine_error import check_scheme, families, prove, sample, worst_of
from stress import FAMILIES
from stress_checks import Case, examine
from stress_exact import EXACT
from tests.cases import each_of
from trust_check import compare, draw, kernel_jobs
from vibrosweep import theory
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels.arithmetic import HALF_ULP, SINE_ERROR
from vibrosweep.model.measures import Status
from vibrosweep.model.parameters import LAWS

LAW = st.sampled_from(LAWS)


def exactly(*values, low, high):
    """Draw one of some special numbers, or any in a range."""
    return st.sampled_from(values) | st.floats(low, high)


@pytest.fixture(scope="module")
def alone():
    with Workers(1) as workers:
        yield workers


@st.composite
def cases(draw):
    """Scenes of one to three particles with any numbers in wide ranges."""
    frequency = draw(exactly(1e-6, 1.0, 1e6, low=1e-6, high=1e6))
    gravity = draw(exactly(1e-3, 2.0, 1e3, low=1e-3, high=1e3))
    speed = gravity / (2.0 * frequency)
    kick = draw(exactly(0.0, 1e-300, 1.0, low=0.0, high=1e9))
    contact = draw(exactly(1e-18, 1e-4, 0.25, 1.0, low=1e-12, high=2.0))
    start = draw(exactly(0.0, -1e9, 1e9, low=-1e6, high=1e6))
    length = draw(exactly(1.0, 12.0, low=1e-9, high=100.0))
    apart = draw(st.lists(exactly(0.0, 0.25, 0.5, 1.0, low=0.0, high=2.0), max_size=2))
    scene = {
        "restitution": draw(exactly(0.0, 1e-12, 0.5, 1.0 - 1e-12, 1.0, low=0.0, high=1.0)),
        "amplitude": draw(st.sampled_from([kick, contact])) * speed,
        "frequency": frequency,
        "phase": draw(exactly(0.0, np.pi / 2.0, np.pi, low=-1e9, high=1e9)),
        "gravity": gravity,
        "launch_velocity": draw(exactly(0.0, 0.25, 0.5, 1.0, low=0.0, high=1e6)) * speed,
        "contact_time": contact / frequency,
    }
    launch = tuple((start + shift) / frequency for shift in [0.0, *apart])
    begin = draw(st.sampled_from([0.0, start / frequency, (start + length / 2.0) / frequency]))
    end = (start + length) / frequency
    return Case(scene, launch, end, draw(LAW), begin, budget=1000)


@settings(max_examples=40)
@given(case=cases())
def test_whatever_hypothesis_finds(alone, case):
    if case.duration > 0.0:
        assert examine(case, alone).faults == []


@each_of("law", LAWS)
@each_of("name", FAMILIES)
def test_extreme_scenes(alone, name, law):
    landings = 0
    for number in range(5):
        case = FAMILIES[name](np.random.default_rng([7, number]), law)
        found = examine(case, alone)
        assert found.faults == []
        assert found.phase_ulp <= 0.5
        assert found.flight_ulp <= 3.0
        landings += found.landings
    assert landings > 0


@each_of("law", LAWS)
@each_of("name", EXACT)
def test_identities(alone, name, law):
    tried, faults = EXACT[name](law, 20, 7, alone)
    assert tried > 0
    assert faults == []


def test_separations_over_a_billion_periods_are_those_of_a_thousand(parameters, observe, workers):
    # two particles that recur: all their separations are known when their joint cycle is
    scene = parameters(
        restitution=0.9, amplitude=1.2, launch_velocity=float(theory.locked_velocity(1))
    )
    x = float(theory.locked_phase(1, 0.9, 1.2))
    short, long = (
        measure(
            scene,
            observe((x, x + 0.25), duration=duration, regimes=True, impact_budget=10_000),
            workers,
        )
        for duration in (1e3, 1e9)
    )
    assert long["status"][0] == Status.COMPLETED
    assert long["impact_count"][0] > 1e9
    assert 0.0 < short["dt_min"][0] < 0.25
    for name in ("dt_min", "dt_min_same_index", "base_shared"):
        assert long[name][0] == short[name][0], name


@pytest.mark.parametrize("law", LAWS)
def test_error_bounds_over_the_whole_range(law):
    rng = np.random.default_rng(7)
    verdicts = [compare(job) for job in kernel_jobs([draw(rng) for _ in range(60)], law, 100)]
    assert [fault for verdict in verdicts for fault in verdict.faults] == []
    assert sum(verdict.compared for verdict in verdicts) > 1200
    seen = [v.bound / v.landing for v in verdicts if v.landing > 0.0]
    assert len(seen) > 40
    assert np.median(seen) < 1000.0


def test_the_bound_of_the_sine_is_proved_and_holds():
    check_scheme()
    proved = prove(parts=16)
    assert proved.relative * HALF_ULP <= SINE_ERROR
    found = worst_of([sample(phases) for phases in families(20_000, 7).values()])
    assert found.absolute <= proved.absolute
    assert found.ulp <= proved.ulp


@pytest.mark.parametrize("states", [orbit_states, box_states])
def test_one_step(states):
    given = states(5000, np.random.default_rng(7))
    found = step_all(*given)
    errors = step_errors(given, found)
    assert np.abs(errors.phase).max() <= 2.0**-54
    larger = np.maximum(given[2] * given[1], given[3] * np.abs(np.sin(2 * np.pi * found[:, 0])))
    assert np.all(np.abs(errors.own) <= 3.0 * np.spacing(larger))


@each_of("orbit", LOCKED)
def test_locked_orbits_stay(orbit):
    _, excess = locked_row(*orbit, 100_000)
    assert excess <= 1e-15
