"""Landings under phase noise, and equality with the engine without it."""

import os
import subprocess
import sys

import numpy as np
import pytest

from vibrosweep.engine.landings import record_landings
from vibrosweep.kernels.arithmetic import sin_turns
from vibrosweep.kernels.impact import Batch, base_of
from vibrosweep.lab.experiment import LABORATORY
from vibrosweep.lab.trials import phase_walk, wandering_record
from vibrosweep.model.parameters import dimensionless, launches


def landings(parameters, walk, particles=4, duration=5.0, **scene):
    values = {**LABORATORY, **scene}
    given = {name: np.broadcast_to(value, particles) for name, value in values.items()}
    sets = parameters(**given)
    start = launches("staggered", particles, sets["frequency"][:1])
    batch = Batch(base_of("high-bounce", "rest"), dimensionless(sets, duration), start)
    return wandering_record(batch, walk, values["frequency"], values["gravity"])


@pytest.mark.parametrize("amplitude", [0.02, 0.06, 0.12])
def test_without_phase_noise_results_are_bitwise_those_of_the_engine(
    amplitude, parameters, observe, workers
):
    found = landings(parameters, np.zeros(2), amplitude=amplitude)
    observation = observe("staggered", particles=4, duration=5.0, transient=-np.inf)
    scene = parameters(**{**LABORATORY, "amplitude": amplitude})
    engine = record_landings(scene, observation, workers)
    for name, values in found._asdict().items():
        np.testing.assert_array_equal(values, engine[name][0])


def test_impacts_depend_on_the_wandering_phase(parameters):
    """Every bounce obeys the map with the interpolated phase of the walk."""
    jitter, frequency = 0.02, LABORATORY["frequency"]
    walk = phase_walk(np.random.default_rng(3), jitter, 110)
    found = landings(parameters, walk, frequency=frequency)
    arrive = LABORATORY["gravity"] / 2.0 * np.diff(found.landing_time, axis=1)
    time, leave = found.landing_time[:, 1:], found.rebound_velocity[:, 1:]
    bounced = (found.rested[:, 1:] == 0) & (found.rested[:, :-1] == 0) & np.isfinite(leave)
    periods = frequency * time
    phase = periods + np.interp(periods, np.arange(walk.size) - 1.0, walk)
    kick = LABORATORY["amplitude"] * np.sin(2.0 * np.pi * phase)
    expected = LABORATORY["restitution"] * arrive + kick
    assert bounced.sum() > 100
    np.testing.assert_allclose(leave[bounced], expected[bounced], atol=1e-11)


def test_a_resting_particle_leaves_at_the_wandered_phase(parameters):
    walk = phase_walk(np.random.default_rng(4), 0.02, 110)
    found = landings(parameters, walk, amplitude=0.02, contact_time=1e-3)
    lifted = (found.rested == 1) & np.isfinite(found.liftoff_time)
    periods = LABORATORY["frequency"] * found.liftoff_time[lifted]
    phase = periods + np.interp(periods, np.arange(walk.size) - 1.0, walk)
    kick = [0.02 * sin_turns(x) for x in phase - np.rint(phase)]
    assert len(kick) > 20
    np.testing.assert_allclose(kick, LABORATORY["gravity"] * 1e-3 / 2.0, atol=1e-9)
    assert (np.cos(2.0 * np.pi * phase) > 0.0).all()


def test_the_walk_has_the_given_variance():
    steps = np.diff(phase_walk(np.random.default_rng(0), 0.01, 100_000))
    assert steps.std() == pytest.approx(0.01, rel=0.01)
    assert phase_walk(np.random.default_rng(0), 0.01, 5)[0] == 0.0


def test_plain_python_gives_the_same_bits(parameters, tmp_path):
    """Without compilation, for a small case with bounces and rests."""
    walk = phase_walk(np.random.default_rng(5), 0.01, 20)
    found = landings(parameters, walk, particles=2, duration=0.5, amplitude=0.03)
    assert (found.rested == 1).any()
    assert (found.rested == 0).any()
    sets = parameters(**{**LABORATORY, "amplitude": np.full(2, 0.03)})
    np.savez(tmp_path / "given.npz", walk=walk, **sets)
    np.savez(tmp_path / "found.npz", **found._asdict())
    plain = """
import sys
import numpy as np
from vibrosweep.kernels.impact import Batch, base_of
from vibrosweep.lab.trials import wandering_record
from vibrosweep.model.parameters import dimensionless, launches
given = dict(np.load(sys.argv[1] + "/given.npz"))
walk = given.pop("walk")
start = launches("staggered", 2, given["frequency"][:1])
frequency, gravity = float(given["frequency"][0]), float(given["gravity"][0])
batch = Batch(base_of("high-bounce", "rest"), dimensionless(given, 0.5), start)
record = wandering_record(batch, walk, frequency, gravity)
for name, values in np.load(sys.argv[1] + "/found.npz").items():
    np.testing.assert_array_equal(getattr(record, name), values)
"""
    subprocess.run(
        [sys.executable, "-c", plain, str(tmp_path)],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        check=True,
    )
