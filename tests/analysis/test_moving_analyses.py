"""Windows, continuation and basins over a moving base."""

import numpy as np
import pytest

from tests.scans import basins, bifurcation, find_windows
from vibrosweep import simulate, theory
from vibrosweep.analysis.basins import capacity
from vibrosweep.analysis.common import launch_states, reached, settle_from
from vibrosweep.engine.measure import measure
from vibrosweep.model.measures import Regime
from vibrosweep.scene.sweep import keyword_spec

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


def test_a_launch_one_period_later_is_one_slot_further(plane):
    now, later = plane.isel(launch_time=slice(0, 12)), plane.isel(launch_time=slice(12, 24))
    recurs = now["slot"].values >= 0
    assert recurs.mean() > 0.3
    np.testing.assert_array_equal(now["basin"], later["basin"])
    periods = plane["cycle_periods"].values[now["basin"].values]
    shifted = np.mod(now["slot"].values + 1, np.maximum(periods, 1))
    np.testing.assert_array_equal(later["slot"].values[recurs], shifted[recurs])


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
