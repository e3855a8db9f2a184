"""Recordings of virtual experiments: what was filmed, and what is true."""

from dataclasses import replace

import numpy as np
import pytest

from vibrosweep.lab.camera import Camera
from vibrosweep.lab.experiment import LABORATORY, Experiment, perform_trials
from vibrosweep.lab.impacts import find_impacts

# orbits that visit many phases; Table 1 at 20 Hz would lock
IRREGULAR = {**LABORATORY, "amplitude": 0.12, "restitution": 0.85}
CAMERA = Camera()
LOCKED = {**LABORATORY, "phase": np.pi}


@pytest.fixture(scope="session")
def trial():
    """One short recording of a virtual experiment."""

    def make(scene=IRREGULAR, particles=3, duration=10.0, camera=CAMERA, seed=0, **changes):
        one = Experiment(
            scene=scene, particles=particles, repeats=1, transient=20.0, duration=duration
        )
        return perform_trials(replace(one, camera=camera, seed=seed, **changes))[0]

    return make


@pytest.fixture(scope="session")
def irregular(trial):
    return trial()


@pytest.fixture(scope="session")
def found(irregular):
    return find_impacts(irregular.tracks)


@pytest.fixture(scope="session")
def locked(trial):
    return trial(scene=LOCKED, particles=1)
