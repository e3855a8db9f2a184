"""Trajectories that are one are followed once, and each is as if it had been followed alone."""

import dataclasses

import numpy as np
import pytest

from vibrosweep.scene import PARAMETERS, dimensionless, launches
from vibrosweep.status import Status
from vibrosweep.sweep import following
from vibrosweep.sweep.engine import measure
from vibrosweep.sweep.observation import Observation
from vibrosweep.sweep.sharing import find_equal, find_shared

# two orbits, the later ones of each whole periods behind at frequencies 1, 2 and 4
APART = (0.0, 0.125, 1.0, 7.0, 3.125, 1.0, 80.125)


def observed(launch=APART, **options):
    defaults = {
        "duration": 300.0,
        "rebound": "rest",
        "transient": 0.0,
        "separation": False,
        "per_particle": True,
        "regimes": True,
        "trust": False,
        "tolerance": 1e-9,
        "impact_budget": 100_000,
    }
    return Observation(particles=len(launch), launch=launch, **{**defaults, **options})


def drawn(size, seed=1, **given):
    rng = np.random.default_rng(seed)
    values = {
        "restitution": rng.uniform(0.3, 0.95, size),
        "amplitude": rng.uniform(0.2, 3.5, size),
        "phase": rng.uniform(-3.0, 3.0, size),
    } | given
    return {
        name: np.broadcast_to(np.asarray(values.get(name, p.default), float), size).copy()
        for name, p in PARAMETERS.items()
    }


def at_frequencies(parameters, factors):
    """The same a, r and u0, exactly, at powers of two times the frequency."""
    scaled = {name: np.tile(values, len(factors)) for name, values in parameters.items()}
    factor = np.repeat(factors, parameters["frequency"].size)
    scaled["frequency"] *= factor
    for name in ("amplitude", "launch_velocity", "contact_time"):
        scaled[name] /= factor
    return scaled


def alone(parameters, observation, workers):
    """Every particle of every realization measured by itself."""
    size = parameters["frequency"].size
    found = [
        [
            measure(
                {name: values[i : i + 1] for name, values in parameters.items()},
                dataclasses.replace(observation, launch=(time,), particles=1),
                workers,
            )
            for time in observation.launch
        ]
        for i in range(size)
    ]
    return {
        name: np.array([[one[name][0, 0] for one in row] for row in found])
        for name, values in found[0][0].items()
        if values.ndim == 2
    }


def share(parameters, observation):
    problem = dimensionless(parameters, observation.duration, observation.transient)
    launch = launches(observation.launch, observation.particles, parameters["frequency"])
    return find_shared(problem, launch, observation.window, 0.0)


def assert_as_alone(parameters, observation, workers, monkeypatch):
    followed = []
    original = following.find_shared

    def watched(*given):
        followed.append(original(*given))
        return followed[-1]

    monkeypatch.setattr(following, "find_shared", watched)
    found = measure(parameters, observation, workers)
    assert len(followed) == 1
    assert followed[0].first.size < found["particle_impact_count"].size
    for name, values in alone(parameters, observation, workers).items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    return found


@pytest.mark.parametrize("rebound", ["rest", "reflect"])
@pytest.mark.parametrize("regimes", [True, False])
def test_particles_launched_whole_periods_apart(rebound, regimes, workers, monkeypatch):
    observation = observed(rebound=rebound, regimes=regimes)
    found = assert_as_alone(drawn(25), observation, workers, monkeypatch)
    if regimes:
        assert np.mean(found["cycle_impacts"] > 0) > 0.1
        assert np.any(found["cycle_rests"] > 0)


@pytest.mark.parametrize("regimes", [True, False])
def test_a_sweep_over_frequency_at_one_dimensionless_problem(regimes, workers, monkeypatch):
    parameters = at_frequencies(drawn(8, seed=2), [1.0, 2.0, 4.0, 0.25])
    observation = observed((0.0, 0.125, 4.0), regimes=regimes)
    assert_as_alone(parameters, observation, workers, monkeypatch)


def test_a_sweep_over_phase_with_launches_that_make_up_for_it(workers, monkeypatch):
    # half a turn of phase is half a period of launch time: two of three launches are shared
    parameters = drawn(6, seed=3, phase=0.0, amplitude=1.0, restitution=0.8)
    parameters["phase"][3:] = np.pi
    observation = observed((0.5, 1.0, 1.25))
    assert_as_alone(parameters, observation, workers, monkeypatch)


@pytest.mark.parametrize("rebound", ["rest", "reflect"])
def test_windows_that_begin_at_the_same_time_after_the_launch(rebound, workers, monkeypatch):
    # three particles at once are one trajectory, a later one is watched from another age
    parameters = drawn(12, seed=4)
    observation = observed((0.5, 0.5, 0.5, 1.5), transient=20.3, rebound=rebound)
    assert_as_alone(parameters, observation, workers, monkeypatch)


def test_windows_that_begin_at_other_times_are_not_shared():
    parameters = drawn(3, seed=5)
    assert share(parameters, observed((0.0, 1.0), transient=20.3)) is None
    assert share(parameters, observed((0.0, 1.0), transient=0.0)) is not None


@pytest.mark.parametrize("budget", [1, 5, 47, 300, 700])
def test_a_budget_ends_each_where_it_would_have_alone(budget, workers, monkeypatch):
    observation = observed(duration=2000.0, impact_budget=budget)
    found = assert_as_alone(drawn(20, seed=6), observation, workers, monkeypatch)
    assert np.any(found["particle_status"] == Status.BUDGET_EXCEEDED)
    if budget == 700:
        assert np.any(found["particle_status"] == Status.COMPLETED)


def test_a_grid_of_different_problems_shares_nothing():
    e, amplitude = np.meshgrid([0.5, 0.7, 0.9], [0.5, 1.0, 2.0])
    parameters = drawn(9, restitution=e.ravel(), amplitude=amplitude.ravel(), phase=0.0)
    observation = observed((0.0, 0.25, 0.5))
    assert share(parameters, observation) is None
    problem = dimensionless(parameters, 10.0, 0.0)
    assert find_equal(problem, launches((0.0, 0.25), 2, parameters["frequency"])) is None


def test_each_follows_the_one_that_is_watched_for_the_next_shorter_time():
    parameters = at_frequencies(drawn(3, seed=7), [1.0, 2.0])
    shared = share(parameters, observed())
    periods = shared.periods
    # at both frequencies the orbit of phase 0; those at 1/8 s are at other phases
    assert shared.first.size == 3 * 3
    reached = []
    for one in shared.first:
        length = -np.inf
        while one >= 0:
            assert periods[one] >= length
            length = periods[one]
            reached.append(one)
            one = shared.after[one]
    assert sorted(reached) == list(range(6 * len(APART)))


def test_the_same_bits_for_any_threads_and_any_part(workers):
    from vibrosweep.sweep.workers import Workers

    parameters = at_frequencies(drawn(30, seed=8), [1.0, 2.0, 4.0])
    observation = observed(regimes=False)
    whole = measure(parameters, observation, workers)
    with Workers(1) as one:
        for name, values in measure(parameters, observation, one).items():
            assert values.tobytes() == whole[name].tobytes(), name
        for part in (slice(0, 7), slice(25, 64)):
            some = {name: values[part] for name, values in parameters.items()}
            for name, values in measure(some, observation, one).items():
                assert values.tobytes() == whole[name][part].tobytes(), name


@pytest.mark.parametrize("rebound", ["rest", "reflect"])
def test_separations_of_one_scene_that_is_watched_for_different_times(
    rebound, workers, monkeypatch
):
    factors = [4.0, 1.0, 2.0, 16.0]
    parameters = at_frequencies(drawn(40, seed=9, phase=0.0), factors)
    observation = dataclasses.replace(
        observed((0.0,) * 4, duration=150.0, rebound=rebound, separation=True),
        launch="staggered",
        impact_budget=10_000_000,
    )
    scenes = []
    original = following.separate

    def watched(first, last, *rest):
        scenes.append(last - first)
        original(first, last, *rest)

    monkeypatch.setattr(following, "separate", watched)
    found = measure(parameters, observation, workers)
    assert sum(scenes) == 40
    followed = measure(parameters, dataclasses.replace(observation, skip=False), workers)
    for name in ("dt_min", "dt_min_same_index", "base_shared", "collision_free"):
        np.testing.assert_array_equal(found[name], followed[name], err_msg=name)
    # the orbits do go on after the earliest end, some with smaller gaps
    gaps = (found["dt_min"] * parameters["frequency"]).reshape(4, 40)
    assert np.any(gaps[3] < gaps[1])
    assert np.all(gaps[3] <= gaps[1])
