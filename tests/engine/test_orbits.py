"""Orbits that repeat, and landings that are skipped because of them."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibrosweep import simulate
from vibrosweep.engine.landings import all_parameters
from vibrosweep.engine.measure import NO_ORBIT, measure
from vibrosweep.engine.workers import Workers
from vibrosweep.model.measures import MEASURES, Regime, Status
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.scene.scene import Scene

# Orbits and slots that particles share, against the times at which they land.

LATE = 12_000.0


def late_landings(found, particle):
    times = found["landing_time"][0, particle]
    return times[times > LATE - 30.0]


@pytest.mark.parametrize(("e", "amplitude"), [(0.98, 3.4), (0.9, 1.2), (0.8, 2.9)])
def test_particles_share_orbit_and_slot_if_and_only_if_they_land_together_for_ever(
    e, amplitude, parameters, observe, record, workers
):
    inputs = parameters(restitution=e, amplitude=amplitude)
    scene = observe(duration=LATE, lyapunov=True, separation=False)
    found = measure(inputs, scene, workers)
    landings = record(inputs, scene)
    orbit, slot = found["orbit"][0], found["slot"][0]
    assert (orbit != NO_ORBIT).all()
    pairs = set(zip(orbit.tolist(), slot.tolist(), strict=True))
    assert found["slot_count"].item() == len(pairs) > 1
    assert found["orbit_count"].item() == len({o for o, _ in pairs})
    for i in range(20):
        for j in range(i):
            own, other = late_landings(landings, i), late_landings(landings, j)
            together = own.size == other.size and np.allclose(own, other, rtol=0, atol=1e-8)
            assert together == (orbit[i] == orbit[j] and slot[i] == slot[j]), (i, j)


def test_all_variables_are_measured_with_their_shapes(parameters, observe, workers):
    inputs = parameters(amplitude=np.linspace(0.0, 3.5, 6))
    found = measure(inputs, observe(lyapunov=True, separation=False), workers)
    sizes = {"realization": 6, "particle": 20}
    for variable in (*MEASURES["regimes"].variables, *MEASURES["lyapunov"].variables):
        name = variable.name
        assert found[name].shape == tuple(sizes[d] for d in variable.dims), name
        assert found[name].dtype == variable.dtype, name


def test_the_result_does_not_depend_on_how_the_batch_is_cut(parameters, observe, workers):
    inputs = parameters(amplitude=np.linspace(0.5, 3.5, 200), restitution=0.95)
    scene = observe(lyapunov=True, separation=False, duration=60.0)
    whole = measure(inputs, scene, workers)
    half = measure({n: v[100:] for n, v in inputs.items()}, scene, workers)
    for name in (variable.name for variable in MEASURES["lyapunov"].variables):
        assert np.array_equal(whole[name][100:], half[name], equal_nan=True), name


def test_an_orbit_without_landings_in_the_window_has_no_exponent(parameters, observe, workers):
    found = measure(parameters(launch_velocity=60.0), observe(lyapunov=True), workers)
    assert np.isnan(found["lyapunov_largest"]).all()
    assert np.isnan(found["lyapunov_max"]).all()
    assert found["aperiodic_count"].item() == 0
    assert found["unsettled_count"].item() == 20


def test_one_particle_without_landings_leaves_the_exponents_of_the_others(
    parameters, observe, workers
):
    inputs = parameters(amplitude=1.2)
    found = measure(inputs, observe(launch=(0.0, 11.9), lyapunov=True), workers)
    assert np.isnan(found["lyapunov_largest"]).tolist() == [[False, True]]
    assert found["lyapunov_max"].item() == found["lyapunov_largest"][0, 0]


REPEATS = (Regime.RESTING, Regime.LOCKED)
OF_EACH = [
    variable.name
    for key in ("regimes", "lyapunov")
    for variable in MEASURES[key].variables
    if "particle" in variable.dims
]
KINDS = (("high-bounce", "rest"), ("high-bounce", "reflect"), ("moving", "rest"))


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_all_that_is_said_of_an_orbit_agrees_with_itself_and_with_a_longer_run(data):
    base, rebound = data.draw(st.sampled_from(KINDS))
    duration = data.draw(st.sampled_from([3.0, 12.0, 60.0, 300.0, 1000.0]))
    transient = data.draw(st.sampled_from([0.0, 0.3])) * duration
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    inputs = all_parameters(
        {
            "restitution": rng.uniform(0.0, 1.0, 12) ** 0.5,
            "amplitude": rng.uniform(0.0, 4.0, 12),
            "frequency": rng.choice([0.7, 1.0, 3.0], 12),
            "contact_time": 10.0 ** rng.uniform(-5.0, -2.0, 12),
        }
    )
    asked = Scene(
        particles=4,
        launch="staggered",
        duration=duration,
        rebound=rebound,
        measures=Measures(
            transient=transient,
            per_particle=True,
            regimes=True,
            lyapunov=data.draw(st.booleans()),
            impact_budget=10**6,
        ),
        base=base,
    )
    with Workers(1) as one:
        found = measure(inputs, asked, one)
        longer = measure(inputs, replace(asked, duration=3.0 * duration), one)
    repeats = np.isin(found["regime"], REPEATS)
    for name in ("cycle_impacts", "cycle_periods"):
        assert np.array_equal(found[name] > 0, repeats), name
    assert np.array_equal(found["cycle_rests"] > 0, found["regime"] == Regime.RESTING)
    assert np.array_equal(found["cycle_uncertain"] >= 0, repeats)
    assert np.array_equal(~np.isnan(found["recurrent_from"]), repeats)
    assert np.all(found["recurrent_from"][repeats] <= duration)
    assert np.array_equal(found["regime"] == Regime.AT_REST, found["particle_at_rest"] == 1)
    for regime in Regime:
        counted = np.count_nonzero(found["regime"] == regime, axis=1)
        assert np.array_equal(found[f"{regime.meaning}_count"], counted)
    if asked.measures.lyapunov:
        for name in ("orbit", "slot"):
            assert np.array_equal(found[name] >= 0, repeats), name
        aperiodic = found["regime"] == Regime.APERIODIC
        assert np.all(found["lyapunov_largest"][aperiodic] > 0.0)
        assert np.all(found["lyapunov_largest_error"][found["cycle_uncertain"] == 1] == np.inf)
    for name in ("regime", "cycle_impacts", "cycle_periods", "cycle_rests", "recurrent_from"):
        assert np.array_equal(longer[name][repeats], found[name][repeats]), name
    at_rest = found["regime"] == Regime.AT_REST
    assert np.all(longer["regime"][at_rest] == Regime.AT_REST)


@settings(max_examples=60)
@given(
    kind=st.sampled_from(KINDS),
    duration=st.sampled_from([3.0, 12.0, 60.0, 300.0]),
    share=st.sampled_from([0.0, 0.1, 0.9]),
    exponents=st.booleans(),
    seed=st.integers(0, 2**32),
)
def test_an_orbit_that_is_lifted_from_two_rests_is_resting(
    kind, duration, share, exponents, seed, parameters, observe, record, workers
):
    rng = np.random.default_rng(seed)
    inputs = parameters(
        restitution=rng.choice([0.0, 0.3, 0.6, 0.9], 12) * rng.uniform(0.9, 1.0, 12),
        amplitude=rng.uniform(1.0, 9.0, 12),
        frequency=rng.choice([0.7, 1.0, 3.0], 12),
        contact_time=10.0 ** rng.uniform(-5.0, -2.0, 12),
    )
    asked = observe((0.0, 0.37), duration=duration, separation=False, base=kind[0], rebound=kind[1])
    begin = share * duration
    found = measure(
        inputs, asked.with_measures(transient=begin, regimes=True, lyapunov=exponents), workers
    )
    kept = record(inputs, asked)
    for place in np.ndindex(12, 2):
        landings = kept["impact_count"][place]
        rests = np.flatnonzero(kept["rested"][place][:landings])
        lifted = kept["liftoff_time"][place][rests]
        one = {name: found[name][place] for name in OF_EACH if name in found}
        if np.isnan(lifted).any():
            assert one["regime"] == Regime.AT_REST
            continue
        assert (one["regime"] == Regime.RESTING) == (rests.size > 1)
        if rests.size > 1:
            cycle, apart = rests[1] - rests[0], lifted[1] - lifted[0]
            assert (one["cycle_rests"], one["cycle_impacts"]) == (1, cycle)
            assert one["cycle_periods"] == pytest.approx(apart * inputs["frequency"][place[0]])
            assert one["recurrent_from"] == pytest.approx(lifted[0], rel=1e-12)
        seen = np.count_nonzero(kept["landing_time"][place][rests] >= begin)
        if exponents and (rests.size > 1 or (seen > 0 and one["regime"] != Regime.LOCKED)):
            # -inf for a cycle; nothing is known after one rest without a cycle
            value = -np.inf if rests.size > 1 else np.nan
            error = np.inf if one["cycle_uncertain"] == 1 else 0.0 if rests.size > 1 else np.nan
            for name in ("largest", "sum"):
                np.testing.assert_equal(one[f"lyapunov_{name}"], value)
                np.testing.assert_equal(one[f"lyapunov_{name}_error"], error)


def test_two_rests_close_a_cycle_however_long_it_is(parameters, observe, workers):
    inputs = parameters(restitution=0.5, amplitude=5.0)
    asked = observe((0.0,), duration=20_000.0, separation=False, lyapunov=True, rebound="reflect")
    found = measure(inputs, asked, workers)
    # it rests after impacts 6354, 14428 and 22502
    assert found["particle_rest_count"].item() == 3
    assert found["regime"].item() == Regime.RESTING
    assert found["cycle_impacts"].item() == 22502 - 14428 == 14428 - 6354
    assert found["lyapunov_largest"].item() == -np.inf
    once = measure(inputs, replace(asked, duration=9000.0), workers)
    assert once["particle_rest_count"].item() == 1
    assert once["regime"].item() == Regime.UNSETTLED
    assert np.isnan(once["lyapunov_largest"].item())
    before = measure(
        inputs, replace(asked.with_measures(transient=5000.0), duration=9000.0), workers
    )
    assert before["particle_rest_count"].item() == 0
    assert before["lyapunov_largest"].item() > 0.0


def test_exponents_do_not_change_regimes(parameters, observe, workers):
    rng = np.random.default_rng(8)
    inputs = parameters(
        restitution=rng.uniform(0.5, 0.98, 100), amplitude=rng.uniform(0.5, 9.0, 100)
    )
    for rebound in ("rest", "reflect"):
        asked = observe(duration=200.0, rebound=rebound, separation=False, launch=(0.0, 0.4))
        plain = measure(inputs, asked.with_measures(regimes=True), workers)
        exponents = measure(inputs, asked.with_measures(lyapunov=True), workers)
        for name in (variable.name for variable in MEASURES["regimes"].variables):
            assert np.array_equal(plain[name], exponents[name], equal_nan=True), name


def test_orbits_that_still_settle_are_not_called_aperiodic(parameters, observe, workers):
    # locked orbits at e = 0.95 take 150 / 0.05 = 3000 periods to return bit for bit
    settling = parameters(restitution=0.95, amplitude=np.linspace(1.0, 2.0, 20))
    # far beyond the cascade
    chaotic = parameters(restitution=0.5, amplitude=np.linspace(11.0, 13.0, 20), contact_time=1e-12)
    asked = observe(launch=(0.41,), duration=600.0, regimes=True, separation=False)
    asked = replace(asked, rebound="reflect")
    found = measure(settling, asked, workers)["regime"]
    assert np.mean(found == Regime.UNSETTLED) > 0.5
    assert not np.any(found == Regime.APERIODIC)
    found = measure(chaotic, asked, workers)["regime"]
    assert np.mean(found == Regime.APERIODIC) > 0.8


# Orbits that repeat bit for bit: their regimes, cycles, and where the recurrence begins.


def observed(duration, *, launch="staggered", particles=8, rebound="rest", **keys):
    measures = Measures(**{"per_particle": True, "regimes": True, **keys})
    return Scene(particles, launch, duration, rebound, measures)


def scene(**given):
    size = max((np.size(v) for v in given.values()), default=1)
    return {n: np.full(size, given.get(n, p.default), float) for n, p in PARAMETERS.items()}


def run(parameters, observation):
    with Workers(2) as workers:
        return measure(parameters, observation, workers)


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
