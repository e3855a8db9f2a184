"""The study's fixed-step scheme against the exact map."""

import math

import numpy as np
import pytest

from study.rk4 import rk4
from vibrosweep import simulate
from vibrosweep.errors import ParameterError

SCENE = {
    "restitution": 0.9,
    "amplitude": 1.2,
    "frequency": 1.0,
    "phase": 0.0,
    "gravity": 9.81,
    "launch_velocity": 4.9,
    "contact_time": 1e-4,
    "launch_time": 0.42,
    "duration": 12.0,
}
LOCKED = SCENE
# a contact time that the larger steps resolve too
RESTING = SCENE | {"restitution": 0.4, "contact_time": 0.05, "launch_velocity": 3.0}
STEPS = 10.0 ** -np.arange(3.0, 6.01, 0.5)


def landings(scene, rebound="rest"):
    """Exact landing times, and whether the particle rested after each."""
    exact = simulate(rebound=rebound, **scene).isel(realization=0, particle=0)
    found = np.isfinite(exact["landing_time"].values)
    return exact["landing_time"].values[found], exact["rested"].values[found] == 1


def errors(scene, rebound):
    """Largest error of the landing times, for each step."""
    landing, rested = landings(scene, rebound)
    landing = landing[:-1]  # the last may be seen only after the end
    rows = [rk4(step=step, rebound=rebound, **scene).landing_time[0] for step in STEPS]
    return rested, np.array([np.max(np.abs(row[: len(landing)] - landing)) for row in rows])


@pytest.mark.parametrize(
    ("scene", "rebound", "rests"),
    [(LOCKED, "rest", False), (RESTING, "rest", True), (RESTING, "reflect", True)],
)
def test_first_order_in_the_step(scene, rebound, rests):
    rested, error = errors(scene, rebound)
    assert rested.size > 8
    assert rested.any() == rests
    order = np.polyfit(np.log(STEPS), np.log(error), 1)[0]
    assert 0.8 < order < 1.2


@pytest.mark.parametrize("step", [1e-3, 0.2])
@pytest.mark.parametrize("scene", [LOCKED, RESTING])
def test_landings_located_in_the_step_are_exact_for_any_step(scene, step):
    """Up to rounding; steps are shorter than half a period, in which the kick rises and falls."""
    landing, _ = landings(scene)
    found = rk4(step=step, contact="interpolated", **scene)
    assert found.impact_count[0] == len(landing)
    np.testing.assert_allclose(found.landing_time[0, : len(landing)], landing, rtol=0, atol=1e-10)


def test_landing_is_seen_at_the_next_step():
    flight = 2 * 4.9 / 9.81
    for step in (0.1, 0.03, 1e-3):
        seen = rk4(step=step, **SCENE).landing_time[0, 0]
        assert seen == 0.42 + math.ceil(flight / step) * step


def test_unforced_particle_comes_to_rest_only_for_steps_below_the_contact_time():
    scene = SCENE | {"amplitude": 0.0, "restitution": 0.5}
    assert rk4(step=1e-4, **scene).impact_count[0] > 10_000
    result = rk4(step=1e-5, **scene)
    count = int(result.impact_count[0])
    assert np.all(np.isfinite(result.landing_time[0, :count]))
    assert np.all(np.isnan(result.landing_time[0, count:]))
    assert result.landing_time[0, count - 1] == pytest.approx(0.42 + 2 * 4.9 / 9.81 / 0.5, abs=2e-3)


def test_threads_and_batches_change_nothing():
    launch_time = np.linspace(0.0, 1.0, 7)
    scene = SCENE | {"launch_time": launch_time}
    together = rk4(step=1e-3, threads=3, **scene)
    for i, t in enumerate(launch_time):
        alone = rk4(step=1e-3, **(SCENE | {"launch_time": t}))
        np.testing.assert_array_equal(alone.landing_time[0], together.landing_time[i])
        assert alone.impact_count[0] == together.impact_count[i]


def test_landings_past_the_capacity_are_counted():
    full, short = rk4(step=1e-3, **SCENE), rk4(step=1e-3, capacity=3, **SCENE)
    assert short.landing_time.shape == (1, 3)
    assert short.impact_count[0] == full.impact_count[0] > 3
    np.testing.assert_array_equal(short.landing_time[0], full.landing_time[0, :3])


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("restitution", [0.5, 1.5]),
        ("launch_time", math.nan),
        ("launch_velocity", [[1.0]]),
        ("duration", math.inf),
        ("step", 0.0),
        ("step", 1e-300),
        ("rebound", "bounce"),
        ("contact", "guessed"),
        ("capacity", 0),
        ("threads", 0),
    ],
)
def test_bad_arguments_are_named(key, value):
    with pytest.raises(ParameterError, match=f"^{key}"):
        rk4(**({"step": 1e-3} | SCENE | {key: value}))
