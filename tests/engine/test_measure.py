"""Running statistics of a batch."""

from dataclasses import replace

import numba
import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

import vibrosweep as vs
from tests.cases import each_of
from vibrosweep.commands.describe import describe
from vibrosweep.engine import measure as engine
from vibrosweep.engine.measure import impact_speeds, measure, measure_all
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels._jit import _fma_exact
from vibrosweep.kernels.advance import LOOK_AFTER
from vibrosweep.kernels.statistics import IMPACT_SPEED, KINDS, Statistics, compiled
from vibrosweep.model.measures import Status
from vibrosweep.model.observables import Landing, Observable
from vibrosweep.model.restitution_laws import fastest_in_range, range_of

# Running statistics against the full record, and results that no division of the work changes.

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


@each_of(
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


@each_of(("total", "size"), [(0, 5), (1, 5), (5, 5), (17, 4), (3, 1)])
def test_tasks_cover_everything_once(total, size, workers):
    seen = []
    workers.run(lambda first, last: seen.append((first, last)), total, size)
    covered = [n for first, last in sorted(seen) for n in range(first, last)]
    assert covered == list(range(total))
    assert all(last - first <= size for first, last in seen)


# Greatest speed of impact, and whether the law of restitution holds there.

LIMITED = {"restitution_law": "viscoelastic", "restitution": 0.8, "restitution_speed": 0.01}


def test_the_restitution_at_the_fastest_impact_of_the_range_is_the_least():
    e = np.array([0.46, 0.6, 0.8, 0.99])
    fastest = fastest_in_range("viscoelastic", e, np.full(4, 0.2))
    assert fastest[0] == pytest.approx(0.2, rel=1e-14)
    assert vs.theory.restitution_at(fastest, e, "viscoelastic", 0.2) == pytest.approx(0.46)
    unlimited = fastest_in_range("viscoelastic", np.ones(1), np.ones(1))
    assert np.isinf(unlimited)
    assert np.isinf(fastest_in_range("plastic", e, e)).all()


def test_results_without_landings_state_the_range_of_the_law():
    inputs = {"restitution": 0.8, "restitution_speed": 0.01}
    limit = fastest_in_range("viscoelastic", np.array([0.8]), np.array([0.01])).item()
    assert f"up to {limit:.4g} m s-1" in range_of("viscoelastic", inputs)
    assert "e(v) is at least 0.46;" in range_of("viscoelastic", {})
    assert range_of("plastic", inputs) == ""
    found = vs.windows({**LIMITED, "amplitude": [0.4, 0.5], "conditions": ["locked(1)"]})
    assert found.restitution_law_range == range_of("viscoelastic", inputs)


def test_impacts_outside_the_range_are_always_flagged():
    """On a base that does not kick, the first impact is the fastest: it has the launch speed."""
    limit = fastest_in_range("viscoelastic", np.array([0.8]), np.array([0.01])).item()
    speeds = [0.1 * limit, 0.999 * limit, 1.001 * limit]
    found = vs.sweep(**LIMITED, amplitude=0.0, launch_velocity=speeds, duration=20.0)
    assert found.impact_speed_max.values.ravel() == pytest.approx(speeds, rel=1e-14)
    assert found.law_in_range.values.ravel().tolist() == [1, 1, 0]
    every = vs.simulate(**LIMITED, amplitude=0.0, launch_velocity=speeds, duration=20.0)
    assert every.law_in_range.values.tolist() == [1, 1, 0]
    assert f"up to {limit:.4g} m s-1" in every.restitution_law_range


def test_incomplete_realizations_are_undetermined_unless_they_left_the_range():
    totals = np.zeros((len(KINDS) + 1, 4))
    totals[0], totals[-1] = [3, 3, 0, 3], [1.0, 9.0, -np.inf, 9.0]
    spent, lost = Status.BUDGET_EXCEEDED, Status.NON_FINITE
    status = np.array([spent, spent, Status.COMPLETED, lost], np.int8)
    found = Statistics((*KINDS, IMPACT_SPEED), totals, np.zeros(4, np.int64), status)
    given = {"gravity": 2.0, "frequency": 0.5, "restitution": 0.46, "restitution_speed": 4.0}
    arrays = {name: np.full(4, value) for name, value in given.items()}
    measured = impact_speeds(found, arrays, "viscoelastic")
    assert measured["law_in_range"].tolist() == [-1, 0, 1, -1]
    assert np.array_equal(measured["impact_speed_max"], [2.0, 18.0, np.nan, np.nan], equal_nan=True)


# Absurd parameters get a status, and harm no other realization.

TABLE = """restitution,amplitude,frequency
0.9,0.0,1.0
0.9,1e30,1e9
0.8,0.0,1.0
0.9,1.0,1e9
"""
ROWS = """
[scene]
particles = 2
duration = 1e7
launch = [0.0, 0.25]
[sample]
design = "table.csv"
[measure]
transient = 0.5
separation = true
per_particle = true
regimes = true
trust = true
"""


@pytest.mark.parametrize("chunk", [1, 2, None])
def test_absurd_rows_are_refused_and_harm_no_other(compute, tmp_path, chunk):
    (tmp_path / "table.csv").write_text(TABLE)
    mixed = xr.load_dataset(compute(ROWS, chunk=chunk))
    assert mixed["status"].values.tolist() == [0, 3, 0, 3]
    refused = mixed.isel(realization=[1, 3])
    measured = (n for n, v in refused.data_vars.items() if "realization" in v.dims)
    for name, variable in ((n, refused[n]) for n in measured):
        if name in ("status", "particle_status"):
            assert (variable == 3).all()
        elif variable.dtype.kind == "f":
            assert np.isnan(variable).all(), name
        else:
            assert (variable == -1).all(), name
            assert -1 in variable.attrs.get("flag_values", [-1])
    (tmp_path / "table.csv").write_text("restitution,amplitude,frequency\n0.9,0,1\n0.8,0,1\n")
    alone = xr.load_dataset(compute(ROWS))
    xr.testing.assert_identical(mixed.isel(realization=[0, 2]).drop_attrs(), alone.drop_attrs())


def test_a_retry_is_offered_for_those_that_a_larger_budget_may_complete(compute, tmp_path):
    (tmp_path / "table.csv").write_text(TABLE)
    lines = list(describe(compute(f"{ROWS}impact_budget = 3")))
    retry = "vibrosweep run --retry-failed --impact-budget N for 2 of them"
    assert f"realizations that did not complete: 4; {retry}" in lines


def test_refused_rows_are_listed_and_not_verified(compute, tmp_path):
    pytest.importorskip("flint")
    from vibrosweep.proof.verifying import verify

    (tmp_path / "table.csv").write_text(TABLE)
    path = compute(ROWS)
    lines = list(describe(path))
    assert (
        "realizations that did not complete: 2; a larger impact budget helps none of them" in lines
    )
    assert lines[-2].split()[:2] == ["1", "refused,"]
    assert lines[-2].endswith("restitution 0.9, amplitude 1e+30, frequency 1e+09")
    report = verify(path)
    assert report.passed
    assert [o.state.name for o in report.outcomes] == ["COMPARED", "NOT_COMPLETED"] * 2


# Observables in the streaming kernel, compared with the record of every landing.

QUANTITIES = ("count", "phase", "flight_time", "impact_speed", "rebound", "rests")
LANDING = Landing(0.1, 1.0, 1.0, 0.9, False)
DURATION, TRANSIENT = 40.0, 7.3


def everything(totals, landing):
    """Sum each quantity; the phase is squared, so that signs do not cancel."""
    totals[0] += 1.0
    totals[1] += landing.phase * landing.phase
    totals[2] += landing.flight_time
    totals[3] += landing.impact_speed
    totals[4] += landing.rebound
    totals[5] += 1.0 if landing.rests else 0.0


def beyond(totals, landing):
    totals[1] += 1.0


def of_no_type(totals, landing):
    totals[0] += landing.colour


def without_limits(text, **outside):
    """A function g compiled by the user, without checks of indices."""
    names = dict(outside)
    exec(text, names)
    return numba.njit(names["g"])


ALL = Observable(
    "everything", everything, "sums", along="quantity", values=range(6), particles="each"
)


@pytest.fixture(scope="module")
def scenes(parameters):
    """Scenes of which some lock, some rest and some rest for good; none is chaotic for long."""
    rng = np.random.default_rng(5)
    return parameters(
        restitution=rng.uniform(0.3, 0.95, 12),
        amplitude=np.concatenate([rng.uniform(0.2, 2.0, 10), [0.0, 4.0]]),
        phase=rng.uniform(-3.0, 3.0, 12),
        frequency=rng.uniform(0.8, 1.5, 12),
    )


def sums_of(inputs, scene, found, base):
    """The same sums from a record, in its order; landings before the transient are left out."""
    f, g = (inputs[name][:, np.newaxis, np.newaxis] for name in ("frequency", "gravity"))
    e, a = (inputs[name][:, np.newaxis, np.newaxis] for name in ("restitution", "amplitude"))
    turn, shift, unit = 2.0 * np.pi, inputs["phase"][:, np.newaxis, np.newaxis], g / (2.0 * f)
    down, up, rested = found["landing_time"], found["liftoff_time"], found["rested"] == 1
    alpha = a / (1.0 + e) if base == "moving" else 0.0 * a

    def platform(time):
        return alpha * np.sin(turn * f * time + shift)

    particles = scene.particles
    launch = np.arange(particles)[np.newaxis, :, np.newaxis] / (particles * f)
    before = np.concatenate([launch, up[..., :-1]], axis=-1)
    rise = np.concatenate(
        [np.broadcast_to(inputs["launch_velocity"][:, np.newaxis, np.newaxis], launch.shape),
         found["rebound_velocity"][..., :-1]],
        axis=-1,
    )  # fmt: skip
    phase = f * down + shift / turn
    seen = np.isfinite(down) & (down >= scene.measures.transient)
    arrival = g * (down - before) - rise + platform(down)
    rebound = np.nan_to_num(found["rebound_velocity"] - platform(up))
    each = [
        np.ones_like(down),
        (phase - np.round(phase)) ** 2,
        f * (down - before),
        arrival / unit,
        rebound / unit,
        rested,
    ]
    return np.stack([np.where(seen, q, 0.0).sum(axis=-1) for q in each], axis=-1)


@pytest.mark.parametrize(("base", "transient"), [("high-bounce", TRANSIENT), ("moving", 0.0)])
def test_every_landing_in_the_window_is_seen(base, transient, scenes, observe, record, workers):
    scene = observe(
        particles=5, transient=transient, observables=(ALL,), base=base, duration=DURATION
    )
    found = measure(scenes, scene, workers)
    expected = sums_of(scenes, scene, record(scenes, scene), base)
    np.testing.assert_array_equal(found["everything"][..., 0], found["particle_impact_count"])
    np.testing.assert_array_equal(found["everything"][..., 5], found["particle_rest_count"])
    np.testing.assert_allclose(found["everything"], expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
def test_other_measures_and_threads_change_no_bit(base, scenes, observe):
    """In 400 periods most orbits repeat; other measures count cycles, observables follow them."""
    plain = observe(particles=5, duration=400.0, base=base, regimes=True)
    asked = plain.with_measures(observables=(ALL,))
    with Workers(1) as one, Workers(3) as three:
        without = measure(scenes, plain, one)
        found, again = measure(scenes, asked, one), measure(scenes, asked, three)
    assert found.keys() == without.keys() | {"everything"}
    for name, values in found.items():
        assert values.tobytes() == again[name].tobytes()
        assert name not in without or values.tobytes() == without[name].tobytes()
    np.testing.assert_array_equal(found["everything"][..., 0], found["particle_impact_count"])
    assert (found["locked_count"] + found["resting_count"] > 0).any()


def test_units_and_sums_over_particles(scenes, observe, workers):
    whole = replace(ALL, name="arrivals", units="m s-1", particles="sum")
    found = measure(scenes, observe(particles=5, observables=(ALL, whole)), workers)
    unit = scenes["gravity"] / (2.0 * scenes["frequency"])
    expected = unit[:, np.newaxis] * found["everything"].sum(axis=1)
    np.testing.assert_allclose(found["arrivals"], expected, rtol=1e-13)


def test_realizations_that_cannot_be_computed_are_nan(parameters, observe, workers):
    inputs = parameters(amplitude=[1.0, 1e300], restitution=0.9)
    found = measure_all(inputs, observe(particles=2, observables=(ALL,)), workers)
    assert found["status"].tolist() == [0, 3]
    assert np.isfinite(found["everything"][0]).all()
    assert np.isnan(found["everything"][1]).all()


def test_mistakes_in_a_function(scenes, observe, workers):
    one = Observable("seen", beyond, "one index too far")
    with pytest.raises(ParameterError, match="'seen': its function raised IndexError: index"):
        measure(scenes, observe(particles=2, observables=(one,)), workers)
    one = Observable("seen", of_no_type, "no such quantity")
    with pytest.raises(ParameterError, match=r"^[^:]*'seen': its function: numba cannot .*colour"):
        measure(scenes, observe(particles=2, observables=(one,)), workers)


def test_division_by_zero_is_an_error_as_in_python():
    def divided(totals, landing):
        totals[0] += 1 // int(landing.rests)

    with pytest.raises(ZeroDivisionError):
        compiled(Observable("seen", divided, "without remainder"))(np.zeros(1), LANDING)


def test_functions_that_it_calls_are_compiled_with_it():
    """A number that they use may have changed since, and bad indices must raise an error."""
    helper = without_limits("def g(totals, k): totals[k] += K", K=1.0)
    room = np.zeros(4)
    helper(room, 0)

    def calling(k):
        def function(totals, landing):
            helper(totals, k)

        return function

    helper.py_func.__globals__["K"] = 2.0
    first, beyond = (compiled(Observable("seen", calling(k), "one number")) for k in (0, 1))
    first(room[:1], LANDING)
    assert room.tolist() == [3.0, 0.0, 0.0, 0.0]
    with pytest.raises(IndexError):
        beyond(room[:1], LANDING)


def test_functions_that_it_calls_may_be_plain_python_and_recursive():
    def factorial(n):
        return 1 if n < 2 else n * factorial(n - 1)

    def function(totals, landing):
        totals[0] += factorial(5)

    totals = np.zeros(1)
    compiled(Observable("seen", function, "a number"))(totals, LANDING)
    assert totals.tolist() == [120.0]
