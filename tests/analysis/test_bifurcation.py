"""Bifurcation diagrams, and continued orbits over a moving base."""

import dataclasses
import math

import numpy as np
import pytest
import xarray as xr

import vibrosweep as vs
from tests.cases import each_of
from tests.scans import basins, bifurcation, find_windows
from vibrosweep import simulate, sobol, sweep, theory
from vibrosweep.analysis import conditions
from vibrosweep.analysis.basins import capacity
from vibrosweep.analysis.bifurcation import OBSERVABLES, summary
from vibrosweep.analysis.common import launch_states, reached, settle_from
from vibrosweep.analysis.conditions import NAMED
from vibrosweep.analysis.records import base_motion
from vibrosweep.engine import landings
from vibrosweep.engine import measure as engine
from vibrosweep.engine.landings import all_parameters, record_landings
from vibrosweep.engine.measure import measure
from vibrosweep.errors import ParameterError, SpecError
from vibrosweep.lab.compare import predict, scene_of
from vibrosweep.model.measures import Regime
from vibrosweep.model.shapes import SINE
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import keyword_spec

# Bifurcation diagrams against closed forms and the landings that `simulate` records.

# launched close to the locked orbit at the end of its window
LOCKED = keyword_spec({"duration": 20_000.0, "launch": [0.47], "launch_velocity": 4.905}).scene


def test_the_locked_orbit_doubles_its_period_and_is_lost_on_the_way_down():
    edge = float(theory.amplitude_max(1, 0.9))
    amplitude = np.array([0.4, 0.6, 1.5, 2.5, 0.995 * edge, 1.005 * edge])
    found = bifurcation(LOCKED, amplitude, samples=12)
    down = found.sel(direction="down").isel(particle=0)
    assert down["cycle_impacts"].values[1:].tolist() == [1, 1, 1, 1, 2]
    assert down["rebound_velocity"].values[1:5] == pytest.approx(4.905, rel=1e-12)
    assert np.ptp(down["rebound_velocity"].values[5]) > 0.1
    speeds = down["rebound_velocity"].values[5]
    assert np.allclose(speeds[2:], speeds[:-2], rtol=1e-9)
    # below A_min = 0.4905 the orbit is gone, and the one that remains rests
    assert down["cycle_rests"].values[0] > 0
    assert down["lyapunov_largest"].values[0] == -np.inf
    exponent = 0.5 * np.log(0.9)
    assert down["lyapunov_largest"].values[2:4] == pytest.approx(exponent, abs=1e-12)


def test_the_way_up_keeps_to_the_orbit_that_rests():
    found = bifurcation(LOCKED, np.linspace(0.3, 2.0, 12), samples=4)
    regimes = found["cycle_rests"].isel(particle=0)
    assert (regimes.sel(direction="up") > 0).all()
    assert (regimes.sel(direction="down").values[2:] == 0).all()


def observed(record, name):
    """An observable of the impacts of one particle, from its recorded landings."""
    one = record.isel(realization=0, particle=0)
    landing, left, speed = (
        one[key].values for key in ("landing_time", "liftoff_time", "rebound_velocity")
    )
    base = base_motion(record.isel(realization=0), "test")
    values = {
        "rebound_velocity": speed,
        "rebound_height": base.height(left) + np.maximum(speed, 0.0) ** 2 / (2.0 * 9.81),
        "flight_time": np.append(landing[1:] - left[:-1], np.nan),
        "impact_phase": landing - np.rint(landing),
    }
    return values[name]


@each_of("name", OBSERVABLES)
@each_of(
    "scene",
    [
        # ten impacts in each period, one of them followed by a rest
        keyword_spec({"duration": 1500.0, "launch": [0.0]}).scene,
        keyword_spec(
            {
                "duration": 1500.0,
                "launch": [0.0],
                "base": "moving",
                "restitution": 0.3,
                "amplitude": 3.0,
            }
        ).scene,
        keyword_spec(
            {
                "duration": 1500.0,
                "launch": [0.1],
                "base": "moving",
                "restitution": 0.9,
                "amplitude": 1.2,
            }
        ).scene,
    ],
)
def test_observables_are_those_of_the_landings(name, scene):
    # one amplitude: both directions launch as the scene says and settle on one orbit
    amplitude = float(scene.parameters({})["amplitude"][0])
    found = bifurcation(scene, [amplitude], observable=name, samples=20)
    record = simulate(
        launch_time=list(scene.launch),
        duration=1600.0,
        base=scene.base,
        restitution=scene.inputs["restitution"],
        amplitude=amplitude,
    )
    late = record["landing_time"].values[0, 0] > 1550.0
    expected = observed(record, name)[late]
    cycle = int(found["cycle_impacts"][0, 0, 0])
    assert 0 < cycle <= 10
    values = found[name].sel(direction="up").values.ravel()
    np.testing.assert_allclose(
        np.sort(values[:cycle]), np.sort(expected[:cycle]), rtol=1e-9, atol=1e-9
    )


def test_a_function_is_an_observable_and_a_particle_at_rest_has_none():
    found = bifurcation(
        keyword_spec({"duration": 50.0}).scene,
        [0.0, 1e-5],
        observable=lambda x, v, g: 0.5 * v * v,
        samples=3,
    )
    assert np.isnan(found["observable"]).all()
    assert (found["lyapunov_largest"] == -np.inf).all()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"observable": "height"}, "observable = 'height':"),
        ({"observable": 3}, "observable = 3:"),
        ({"samples": 0}, "samples = 0:"),
    ],
)
def test_mistakes_are_named(given, words):
    with pytest.raises(ParameterError, match=words):
        vs.bifurcation(amplitude=[1.0], **given)


@pytest.mark.parametrize(("axis", "value"), [("amplitude", [-1.0]), ("amplitude", [2.0, 2.0])])
def test_axes_that_cannot_be_followed_are_named(axis, value):
    with pytest.raises(SpecError) as caught:
        vs.bifurcation(**{axis: value})
    assert [mistake.key for mistake in caught.value.mistakes] == [f"sample.{axis}"]


def test_more_samples_than_fit_into_memory_are_refused_with_a_remedy_that_exists():
    with pytest.raises(ParameterError, match=r"samples each need .* GiB.*fewer of them"):
        bifurcation(
            keyword_spec({"duration": 2000.0}).scene, np.linspace(0.1, 4.0, 1000), samples=10**12
        )


def test_the_base_acceleration_lies_along_the_amplitude():
    found = bifurcation(
        keyword_spec({"duration_periods": 20.0}).scene,
        [0.0, 1.2],
        samples=2,
    )
    assert found["base_acceleration"].dims == ("amplitude",)
    expected = 2.0 * np.pi * found["amplitude"] / (1.9 * 9.81)
    np.testing.assert_allclose(found["base_acceleration"], expected, rtol=1e-15)
    assert found.attrs["forcing"] == "amplitude"
    assert found.attrs["base"] == "high-bounce"


def test_launches_find_an_attractor_to_which_no_orbit_is_followed():
    """Mode 2 at 60 Hz is stable in a window that orbits pass by, both upwards and downwards."""
    born = 2.0 * np.pi * 0.15 / 1.85
    lost = np.hypot(born, 2.0 * (1.0 + 0.85**2) / 1.85**2)
    values = np.array([0.4, 0.99 * born, 0.6, 0.8, 1.0, 1.01 * lost, 2.0, 3.0])
    found = vs.bifurcation(
        restitution=0.85, frequency=60.0, base="moving", base_acceleration=values.tolist(),
        launch_velocity=0.2, launches=64, samples=2,
    )  # fmt: skip
    followed, mode = (
        (found[f"{of}cycle_impacts"] == 1) & (found[f"{of}cycle_periods"] == 2)
        for of in ("", "launched_")
    )
    assert not followed.any()
    inside = (values > born) & (values < lost)
    np.testing.assert_array_equal(mode.any("launch"), inside)
    assert int(mode.sel(base_acceleration=0.8).sum()) > 15
    speeds = found.launched_rebound_velocity.where(mode).values
    flight = vs.theory.locked_velocity(2, frequency=60.0)
    np.testing.assert_allclose(speeds[np.isfinite(speeds)], flight, rtol=1e-9)
    assert (found.attractors.values[inside] > 1).all()
    kept = np.isfinite(found.launched_rebound_velocity).sum("sample")
    expected = np.where(found.launched_regime == vs.Regime.APERIODIC, 8, 2)
    assert set(kept.values[kept.values != expected]) <= {0}  # at permanent rest
    aperiodic = (found.launched_regime == vs.Regime.APERIODIC).any("launch")
    assert aperiodic.values.tolist() == [False] * 6 + [True] * 2
    assert (float(found.chaos_low), float(found.chaos_high)) == (values[5], values[6])
    assert list(summary(found))[-1].endswith(f"above {values[5]:.6g}, at most at {values[6]:.6g}")


def test_where_no_exponent_is_positive_none_is_placed():
    calm = bifurcation(LOCKED, np.array([0.6, 1.2]), samples=1)
    assert np.isnan(calm.chaos_high)
    assert np.isnan(calm.chaos_low)
    assert list(summary(calm))[-1].endswith("none was found")


# Analyses that keep no landings skip what is known already, and find the same.

SCAN = np.linspace(0.3, 3.5, 9)
IMPACTS = xr.Dataset(
    {
        "flight_time": (("particle", "impact"), np.ones((3, 2))),
        "liftoff_time": (("particle", "impact"), np.arange(3.0)[:, np.newaxis] / [3.0, 3.0]),
        "impact_speed": (("particle", "impact"), np.full((3, 2), 5.0)),
    },
    attrs={"end": 60.0, "base_motion": "level"},
)
ANALYSES = {
    **{
        f"windows of {name}": lambda workers, name=name: find_windows(
            keyword_spec({"particles": 3, "duration": 300.0}).scene,
            [0.85, 0.9],
            SCAN,
            [name],
            tolerance=1e-3,
        )
        for name in NAMED
    },
    "sweep": lambda workers: sweep(amplitude=SCAN, separation=True, particles=20, duration=300.0),
    "sensitivity": lambda workers: sobol(amplitude=(0.3, 3.5), particles=5, realizations=64),
    "lab compare": lambda workers: predict(
        IMPACTS,
        all_parameters({"amplitude": SCAN}),
        [SINE] * SCAN.size,
        scene_of(IMPACTS, "rest", SINE, "constant"),
        workers,
    ),
}


@pytest.fixture
def asked(monkeypatch):
    """Observations that the engine and a recorder of landings are called with."""
    seen = []
    function = engine.statistics

    def watched(*arguments, **others):
        seen.extend(a for a in arguments if hasattr(a, "skip"))
        return function(*arguments, **others)

    for module in (engine, landings, conditions):
        monkeypatch.setattr(module, "statistics", watched)
    return seen


@each_of("name", ANALYSES)
def test_an_analysis_that_keeps_no_landing_skips_what_is_known(name, asked, workers):
    asked.clear()
    ANALYSES[name](workers)
    assert asked
    assert all(one.skip for one in asked)


def test_a_record_follows_every_landing(asked, workers):
    observation = Scene(2, "staggered", 12.0, "rest").recorded(1000)
    record_landings(all_parameters({}), observation, workers)
    assert asked
    assert not any(one.skip for one in asked)


@each_of("name", NAMED)
def test_skips_do_not_change_a_window(name):
    scene = keyword_spec({"particles": 3, "duration": 300.0}).scene
    skipped, followed = (
        find_windows(dataclasses.replace(scene, skip=skip), [0.85, 0.9], SCAN, [name])
        for skip in (True, False)
    )
    assert followed.identical(skipped)


def test_skips_do_not_change_a_count(workers):
    random = np.random.default_rng(3)
    ranges = {"restitution": (0.8, 0.98), "amplitude": (0.2, 3.5)}
    parameters = all_parameters({n: random.uniform(*ends, 24) for n, ends in ranges.items()})
    observation = Scene(6, "staggered", 3000.0, "rest").recorded(10_000_000)
    assert observation.measures.transient == -math.inf
    skipped, followed = (
        engine.measure(parameters, dataclasses.replace(observation, skip=skip), workers)
        for skip in (True, False)
    )
    assert np.array_equal(skipped["impact_count"], followed["impact_count"])
    assert np.array_equal(skipped["rebound_height_max"], followed["rebound_height_max"])


# Windows, continuation and basins over a moving base.

MODES = (1, 2, 3)


def gamma_of(amplitude, e):
    return 2.0 * np.pi * amplitude / ((1.0 + e) * 9.81)


def test_locked_windows_end_where_the_closed_forms_say():
    e = np.array([0.0, 0.0205, 0.05, 0.1, 0.2, 0.35, 0.5, 0.65, 0.8, 0.9, 0.95, 0.99])
    names = [f"locked({k})" for k in MODES]
    found = find_windows(
        keyword_spec({"duration": 2000.0, "base": "moving"}).scene,
        e,
        np.linspace(0.02, 16.0, 40),
        names,
        threads=1,
    )
    assert (found["window_count"] == 1).all()
    for k, name in zip(MODES, names, strict=True):
        one = found.sel(condition=name, direction="launch").isel(window=0)
        ends = (end(k, e, base="moving") for end in (theory.amplitude_min, theory.amplitude_max))
        for lower, end in zip(("A_min", "A_max"), ends, strict=True):
            assert one[lower].values == pytest.approx(end, rel=1e-8)


@pytest.mark.parametrize("e", [1e-4, 0.005, 0.015])
def test_a_window_begins_where_the_flight_first_clears_the_base(e):
    name, scan = ["locked(1)"], np.linspace(3.0, 8.0, 30)
    one = find_windows(
        keyword_spec({"duration": 2000.0, "base": "moving"}).scene, [e], scan, name, threads=1
    ).squeeze()
    gamma = gamma_of(float(one["A_min"]), e)
    lowest = np.pi * (1.0 - e) / (1.0 + e)
    s = np.linspace(1e-5, 0.9, 100_001)
    clearance = []
    for side in (-1e-5, 1e-5):
        x = 0.5 - np.arcsin(lowest / (gamma * (1.0 + side))) / (2.0 * np.pi)
        base = np.cos(2.0 * np.pi * (x + s)) - np.cos(2.0 * np.pi * x)
        sunk = gamma * (1.0 + side) / (4.0 * np.pi**2) * base
        clearance.append((s * (1.0 - s) / 2.0 + sunk).min())
    assert clearance[0] < 0.0 < clearance[1]
    assert gamma > 1.0001 * lowest
    upper = theory.amplitude_max(1, e, base="moving")
    assert float(one["A_max"]) == pytest.approx(upper, rel=1e-8)


def test_a_continued_orbit_stays_locked_down_to_the_end_of_its_window():
    middle = float(theory.locked_phase(1, 0.8, 1.3))
    scene = keyword_spec(
        {
            "base": "moving",
            "restitution": 0.8,
            "duration": 3000.0,
            "launch_velocity": 4.905,
            "launch": [middle],
        }
    ).scene
    axis = np.linspace(0.7, 1.3, 25)
    found = find_windows(scene, [0.8], axis, ["ordered"], continuation=True, tolerance=1e-5)
    down = found.sel(direction="down").squeeze()
    lower = float(theory.amplitude_min(1, 0.8))
    assert float(down["A_min"]) == pytest.approx(lower, rel=1e-4)
    diagram = bifurcation(scene, axis[axis > lower], samples=3).sel(direction="down")
    np.testing.assert_allclose(diagram["rebound_velocity"], 4.905, rtol=1e-9)
    np.testing.assert_allclose(diagram["lyapunov_largest"][3:], np.log(0.8), atol=1e-3)


@pytest.mark.parametrize("changed", [{}, {"restitution": 0.3, "amplitude": 3.0}])
def test_an_orbit_goes_on_from_its_own_state(changed, workers):
    scene = keyword_spec(
        {"base": "moving", "duration": 2000.0, "particles": 4, "phase": 0.3, **changed}
    ).scene
    parameters = scene.parameters({})
    first = settle_from(scene, parameters, launch_states(scene, parameters), workers)
    again = settle_from(scene, parameters, reached(first, 4), workers)
    assert np.all((first.impacts > 0) | (first.regime == Regime.AT_REST))
    assert (first.impacts > 0).sum() > 2
    for name in ("regime", "impacts", "periods", "rests"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    np.testing.assert_allclose(first.flight, again.flight, atol=1e-9)
    # the launches are those of a sweep
    measured = measure(parameters, scene.only(regimes=True), workers)
    np.testing.assert_array_equal(measured["regime"].ravel(), first.regime)
    np.testing.assert_array_equal(measured["cycle_impacts"].ravel(), first.impacts)


SCENE = keyword_spec(
    {"base": "moving", "amplitude": 1.4, "restitution": 0.9, "phase": 0.7, "duration": 1500.0}
).scene
TIMES = np.linspace(0.0, 1.0, 12, endpoint=False)


@pytest.fixture(scope="module")
def plane():
    return basins(SCENE, np.concatenate([TIMES, TIMES + 1.0]), np.linspace(0.5, 14.0, 10))


def test_every_launch_is_on_the_attractor_that_a_record_shows(plane):
    found = plane.isel(launch_time=slice(0, 12))
    seen = set()
    for i, j in ((0, 0), (3, 5), (6, 2), (9, 7), (8, 11)):
        one = found.isel(launch_velocity=i, launch_time=j)
        attractor = found.isel(attractor=int(one["basin"]))
        seen.add(int(attractor["regime"]))
        if int(attractor["regime"]) != Regime.LOCKED:
            continue
        record = simulate(
            base="moving",
            amplitude=1.4,
            restitution=0.9,
            phase=0.7,
            launch_time=float(one["launch_time"]),
            launch_velocity=float(one["launch_velocity"]),
            duration=1500.0,
        )
        count = int(attractor["cycle_impacts"])
        speed = record["rebound_velocity"].values[0, 0]
        last = speed[np.isfinite(speed)][-count:]
        assert np.abs(last - float(attractor["rebound_velocity"])).min() < 1e-8
        assert not record["rested"].values[0, 0, -count:].any()
    assert Regime.LOCKED in seen


def test_locked_attractors_are_those_of_the_theory(plane):
    for i in range(plane.sizes["attractor"]):
        one = plane.isel(attractor=i)
        if int(one["regime"]) == Regime.LOCKED and int(one["cycle_impacts"]) == 1:
            mode = int(one["cycle_periods"])
            speed, phase = theory.locked_velocity(mode), theory.locked_phase(mode, 0.9, 1.4)
            assert float(one["rebound_velocity"]) == pytest.approx(float(speed), rel=1e-9)
            assert float(one["impact_phase"]) == pytest.approx(float(phase), abs=1e-9)
            leading = np.abs(theory.multipliers(mode, 0.9, 1.4, base="moving")).max()
            assert float(one["lyapunov_largest"]) == pytest.approx(np.log(leading), abs=1e-9)
    locked = plane["regime"].values == Regime.LOCKED
    slots = plane["cycle_periods"].values[locked].sum()
    assert int(capacity(plane)["capacity_without_rests"]) == slots > 0


def test_states_are_relative_to_the_base_as_it_moves():
    """Also under harmonics: the states of continued scans and basins depend on the waveform."""
    shape = {"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}
    scene = keyword_spec({"base": "moving", "waveform": shape, "particles": 3}).scene
    parameters = scene.parameters({"amplitude": np.array([1.2, 2.0])})
    states = launch_states(scene, parameters)
    phase, speed = np.moveaxis(states, -1, 0)
    kick = 2.0 * parameters["amplitude"] / parameters["gravity"]
    base = kick / (1.0 + parameters["restitution"])
    launched = 2.0 * parameters["launch_velocity"] / parameters["gravity"]
    w = scene.waveform.velocity(phase)
    assert speed == pytest.approx(launched[:, np.newaxis] - base[:, np.newaxis] * w, abs=1e-14)
