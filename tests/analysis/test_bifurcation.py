"""Bifurcation diagrams against closed forms and the landings that `simulate` records."""

import numpy as np
import pytest

import vibrosweep as vs
from tests.scans import bifurcation
from vibrosweep import simulate, theory
from vibrosweep.analysis.bifurcation import OBSERVABLES, summary
from vibrosweep.analysis.records import base_motion
from vibrosweep.errors import ParameterError, SpecError
from vibrosweep.scene.sweep import keyword_spec

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


@pytest.mark.parametrize("name", OBSERVABLES)
@pytest.mark.parametrize(
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
    ids=["high-bounce", "moving with rests", "moving"],
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
        keyword_spec({"duration_periods": 20.0, "base_acceleration": 7.0}).scene,
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
    aperiodic = (found.launched_regime == vs.Regime.APERIODIC).any("launch")
    assert aperiodic.values.tolist() == [False] * 6 + [True] * 2
    assert (float(found.chaos_low), float(found.chaos_high)) == (values[5], values[6])
    assert list(summary(found))[-1].endswith(f"above {values[5]:.6g}, at most at {values[6]:.6g}")


def test_where_no_exponent_is_positive_none_is_placed():
    calm = bifurcation(LOCKED, np.array([0.6, 1.2]), samples=1)
    assert np.isnan(calm.chaos_high)
    assert np.isnan(calm.chaos_low)
    assert list(summary(calm))[-1].endswith("none was found")
