"""Running statistics against the full record, and results that no division of the work changes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibrosweep.engine import measure as engine
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels._jit import _fma_exact
from vibrosweep.kernels.advance import LOOK_AFTER
from vibrosweep.model.measures import Status

LAWS = ["rest", "reflect"]
TIMES = (0.0, 0.31, -4.75, 2.0, 30.0)


def in_window(found, transient):
    """Return which recorded landings lie in the window; shape (realization, particle, impact)."""
    with np.errstate(invalid="ignore"):
        return found["landing_time"] >= transient


def check_counts(measured, found, inside):
    """Counts are equal, per particle and per realization."""
    rested = (found["rested"] == 1) & inside
    # a particle counts as at rest for good even if that began before the window
    finished = ((found["rested"] == 1) & np.isnan(found["liftoff_time"])).any(axis=-1)
    for name, particles in (
        ("impact_count", inside.sum(axis=-1)),
        ("rest_count", rested.sum(axis=-1)),
    ):
        assert np.array_equal(measured[f"particle_{name}"], particles)
        assert np.array_equal(measured[name], particles.sum(axis=-1))
    assert np.array_equal(measured["particle_at_rest"], finished)
    assert np.array_equal(measured["at_rest_count"], finished.sum(axis=-1))
    assert np.array_equal(measured["particle_status"], found["status"])
    assert np.array_equal(measured["status"], found["status"].max(axis=-1))


def check_means(measured, found, inside, inputs):
    """Means and maxima are those of the recorded speeds, to the rounding of their units."""
    g = inputs["gravity"][:, np.newaxis, np.newaxis]
    speed = np.where(inside, found["rebound_velocity"], np.nan)
    height, flight = speed**2 / (2.0 * g), 2.0 * speed / g
    for prefix, axis in (("particle_", -1), ("", (-2, -1))):
        some = (~np.isnan(speed)).any(axis=axis)
        assert some.any()
        for name, values, function, rel in (
            ("rebound_height_mean", height, np.nanmean, 1e-13),
            ("rebound_height_max", height, np.nanmax, 2e-15),
            ("flight_time_mean", flight, np.nanmean, 1e-13),
        ):
            found_values = measured[prefix + name]
            assert np.array_equal(np.isnan(found_values), ~some)
            # where there is none, any number will do
            filled = np.where(some.reshape(some.shape + (1,) * (3 - some.ndim)), values, 0.0)
            expected = function(filled, axis=axis)
            assert np.all(
                np.abs(found_values - expected)[some] <= rel * np.abs(expected[some]) + 1e-300
            )


@pytest.mark.parametrize("rebound", LAWS)
@pytest.mark.parametrize("transient", [0.0, 3.3])
def test_statistics_are_those_of_the_record(
    rebound, transient, random_scenes, observe, record, workers
):
    inputs = random_scenes(seed=21, size=60)
    scene = observe(
        TIMES, duration=9.0, transient=transient, rebound=rebound, impact_budget=5000, skip=False
    )
    measured, found = measure(inputs, scene, workers), record(inputs, scene)
    inside = in_window(found, transient)
    assert inside.any(axis=-1).sum() < (~np.isnan(found["landing_time"])).any(axis=-1).sum()
    check_counts(measured, found, inside)
    check_means(measured, found, inside, inputs)


@pytest.mark.parametrize("rebound", LAWS)
def test_statistics_are_those_of_the_record_bit_for_bit(
    rebound, random_scenes, observe, record, workers
):
    # gravity 2 and frequency 1: recorded speeds are the flight times that the kernel sums
    inputs = random_scenes(seed=22, size=25, gravity=2.0, frequency=1.0)
    scene = observe((0.0, 0.4), duration=15.0, rebound=rebound, impact_budget=400, skip=False)
    measured, found = measure(inputs, scene, workers), record(inputs, scene)
    for i in range(25):
        for p in range(2):
            speed = found["rebound_velocity"][i, p]
            speed = speed[~np.isnan(speed)]
            if speed.size == 0:
                assert np.isnan(measured["particle_flight_time_mean"][i, p])
                continue
            total = squares = 0.0
            for first in range(0, speed.size, LOOK_AFTER):  # sums of sums
                new = new_squares = 0.0
                for u in speed[first : first + LOOK_AFTER].tolist():
                    new += u
                    new_squares = _fma_exact(u, u, new_squares)
                total, squares = total + new, squares + new_squares
            assert measured["particle_flight_time_mean"][i, p] == total / speed.size
            assert measured["particle_rebound_height_mean"][i, p] == 0.25 * (squares / speed.size)
            assert measured["particle_rebound_height_max"][i, p] == 0.25 * speed.max() ** 2


@pytest.mark.parametrize(
    ("launch", "transient", "counted"),
    [
        ((0.0,), 0.0, True),
        ((-0.5,), 0.0, False),
        ((-0.5, 0.0), 0.0, True),
        ((1.0, 2.0), 2.0, True),
        ((1.0, 1.5), 2.0, False),
        ((13.0,), 0.0, False),
        ("staggered", 0.0, True),
        ("staggered", 0.75, True),
        ("staggered", 0.8, False),
    ],
)
def test_a_launch_counts_for_the_highest_flight_in_its_window(
    launch, transient, counted, parameters, observe, workers
):
    # a launch far higher than all flights that follow
    inputs = parameters(launch_velocity=20.0, restitution=0.1, amplitude=0.1)
    scene = observe(launch, particles=4, transient=transient)
    measured = measure(inputs, scene, workers)
    throw = 20.0**2 / (2.0 * 9.81)
    if counted:
        assert measured["flight_height_max"] == [throw]
    else:
        assert measured["flight_height_max"] != [throw]
        assert np.array_equal(
            measured["flight_height_max"], measured["rebound_height_max"], equal_nan=True
        )


def test_without_landings_there_is_nothing_to_average(parameters, observe, workers):
    measured = measure(parameters(), observe((11.9,), trust=True), workers)
    assert measured["impact_count"] == measured["rest_count"] == measured["at_rest_count"] == 0
    for name in ("rebound_height_mean", "rebound_height_max", "flight_time_mean", "dt_min"):
        assert np.isnan(measured[name])
    assert measured["flight_height_max"] == 5.0**2 / (2.0 * 9.81)
    assert measured["base_shared"] == 0
    assert measured["status"] == Status.COMPLETED


def test_a_particle_at_rest_before_the_window_is_counted_at_rest(parameters, observe, workers):
    inputs = parameters(amplitude=0.0, restitution=0.5)
    measured = measure(inputs, observe((0.0, 0.1), transient=5.0), workers)
    assert measured["impact_count"] == 0
    assert measured["at_rest_count"] == 2
    assert measured["base_shared"] == 1  # both lie there when the window begins


def test_a_spent_budget_is_reported_and_separations_are_not(parameters, observe, workers):
    inputs = parameters(
        restitution=[1.0 - 1e-12, 0.5],
        amplitude=0.0,
        launch_velocity=[2e-6, 5.0],
        contact_time=1e-9,
    )
    measured = measure(inputs, observe((0.0, 0.1), impact_budget=1000), workers)
    assert measured["status"].tolist() == [Status.BUDGET_EXCEEDED, Status.COMPLETED]
    assert measured["impact_count"][0] == 2 * -(-1000 // LOOK_AFTER) * LOOK_AFTER
    assert measured["base_shared"].tolist() == [-1, 1]
    assert measured["collision_free"].tolist() == [-1, 0]
    assert np.isnan(measured["dt_min"]).tolist() == [True, False]
    assert np.isnan(measured["dt_min_same_index"]).tolist() == [True, False]


@pytest.mark.parametrize("particles", [1, 20])
@pytest.mark.parametrize("everything", [False, True])
def test_measures_are_those_asked_for_with_the_types_registered(
    particles, everything, parameters, observe, workers
):
    scene = observe(
        particles=particles,
        separation=everything,
        per_particle=everything,
        regimes=everything,
        trust=everything,
    )
    measured = measure(parameters(amplitude=[0.0, 1.2, 3.0]), scene, workers)
    expected = {v.name: v for v in scene.measures.variables}
    assert set(measured) == set(expected)
    for name, values in measured.items():
        assert values.dtype == expected[name].dtype, name
        assert values.shape == (3, particles)[: len(expected[name].dims)], name


def same_bits(one, other):
    assert set(one) == set(other)
    for name, values in one.items():
        assert values.dtype == other[name].dtype
        assert values.tobytes() == other[name].tobytes(), name


@pytest.mark.parametrize("rebound", LAWS)
@pytest.mark.parametrize("transient", [0.0, 4.0])
def test_threads_and_tasks_do_not_change_a_bit(
    rebound, transient, random_scenes, observe, monkeypatch
):
    inputs = random_scenes(seed=23, size=70)
    scene = observe(
        particles=7,
        transient=transient,
        rebound=rebound,
        impact_budget=4000,
        regimes=True,
        trust=True,
        tolerance=1e-9,
    )
    results = []
    for threads, size in ((1, 8192), (2, 8192), (2, 1), (3, 17), (3, 130)):
        monkeypatch.setattr(engine, "TRAJECTORIES_PER_TASK", size)
        with Workers(threads) as workers:
            results.append(measure(inputs, scene, workers))
    for other in results[1:]:
        same_bits(results[0], other)


@settings(max_examples=25)
@given(data=st.data(), rebound=st.sampled_from(LAWS), one_frequency=st.booleans())
def test_batches_do_not_change_a_bit(data, rebound, one_frequency, random_scenes, observe, workers):
    size = 40
    inputs = random_scenes(seed=24, size=size, **({"frequency": 1.3} if one_frequency else {}))
    launch = (0.0, 0.2, -1.1, 0.2)
    scene = observe(launch, rebound=rebound, duration=6.0, impact_budget=1000)
    if data.draw(st.booleans(), label="transient"):
        scene = scene.with_measures(transient=2.5)
    whole = measure(inputs, scene, workers)
    cuts = data.draw(st.lists(st.integers(1, size - 1), unique=True).map(sorted), label="cuts")
    parts = [
        measure({name: values[a:b] for name, values in inputs.items()}, scene, workers)
        for a, b in zip([0, *cuts], [*cuts, size], strict=True)
    ]
    same_bits(whole, {name: np.concatenate([part[name] for part in parts]) for name in whole})


def test_neighbours_in_a_block_do_not_change_a_trajectory(random_scenes, observe, workers):
    inputs = random_scenes(seed=25, size=300, frequency=2.0)
    scene = observe((0.1,), separation=False, impact_budget=3000)
    forward = measure(inputs, scene, workers)
    backward = measure(
        {name: np.ascontiguousarray(values[::-1]) for name, values in inputs.items()},
        scene,
        workers,
    )
    same_bits(forward, {name: values[::-1] for name, values in backward.items()})


def test_a_hundred_thousand_particles(parameters, observe, record, workers):
    inputs = parameters(amplitude=0.0, restitution=0.5)
    scene = observe(particles=100_000, duration=2.0, per_particle=False)
    measured, found = measure(inputs, scene, workers), record(inputs, scene)
    who, _ = np.nonzero(~np.isnan(found["landing_time"][0]))
    times = found["landing_time"][0][~np.isnan(found["landing_time"][0])]
    order = np.argsort(times, kind="stable")
    apart, other = np.diff(times[order]), np.diff(who[order]) != 0
    assert measured["impact_count"] == times.size > 150_000
    assert measured["dt_min"] == pytest.approx(apart[other].min(), rel=0, abs=1e-15)
    assert measured["dt_min_same_index"] == pytest.approx(1e-5, rel=1e-10)
    assert measured["base_shared"] == 1


def test_an_error_in_a_task_reaches_the_caller(workers):
    def fail(first, last):
        raise RuntimeError("task")

    with pytest.raises(RuntimeError, match="task"):
        workers.run(fail, 10, 2)


@pytest.mark.parametrize(("total", "size"), [(0, 5), (1, 5), (5, 5), (17, 4), (3, 1)])
def test_tasks_cover_everything_once(total, size, workers):
    seen = []
    workers.run(lambda first, last: seen.append((first, last)), total, size)
    covered = [n for first, last in sorted(seen) for n in range(first, last)]
    assert covered == list(range(total))
    assert all(last - first <= size for first, last in seen)
