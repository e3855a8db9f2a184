"""Recordings of virtual experiments, with their true landings."""

import numpy as np
import pytest

from vibrosweep.lab.experiment import LABORATORY, Experiment
from vibrosweep.lab.impacts import find_impacts
from vibrosweep.lab.trials import perform_trials

# irregular orbits, which visit many phases; at 20 Hz those of Table 1 are locked
IRREGULAR = {**LABORATORY, "amplitude": 0.12, "restitution": 0.85}
LOCKED = {**LABORATORY, "phase": np.pi}


@pytest.fixture(scope="session")
def trial():
    """Make one short recording of a virtual experiment."""

    def make(scene=IRREGULAR, particles=3, length=10.0, transient=20.0, **others):
        window = {"transient": transient, "duration": transient + length}
        return perform_trials(
            Experiment(**scene, particles=particles, repeats=1, **window, **others)
        )[0]

    return make


@pytest.fixture(scope="session")
def irregular(trial):
    return trial()


@pytest.fixture(scope="session")
def found(irregular):
    return find_impacts(irregular.tracks, frequency=20.0)


@pytest.fixture(scope="session")
def locked(trial):
    return trial(scene=LOCKED, particles=1)
