"""Small finished datasets, and copies of them that are changed by hand."""

import shutil
from contextlib import contextmanager
from types import SimpleNamespace

import h5py
import numpy as np
import pytest

from vibrosweep.runs.driver import run_sweep
from vibrosweep.scene.sweep import parse_spec
from vibrosweep.store.disk import append_seal

CLAIMED = """
title = "Everything that can be measured, over a late window"
[scene]
particles = 2
duration = 25.0
[sample]
realizations = 3
seed = 2
restitution = [0.80, 0.98]
amplitude = [0.2, 3.5]
[measure]
transient = 3.0
separation = true
per_particle = true
regimes = true
lyapunov = true
trust = true
ordering = true
impact_speed = true
[record]
restitution = 0.9
amplitude = 1.2
duration = 8.0
"""
LOCKED = """
title = "Orbits that lock, two of them on one cycle and one after another"
[scene]
particles = 3
launch = [0.3, 0.31, 1.3]
launch_velocity = 9.81
duration = 400.0
restitution = 0.5
[sample]
design = "grid"
amplitude = [5.1]
[measure]
regimes = true
lyapunov = true
trust = true
"""
BARE = """
title = "No bounds of errors, the other law, listed launches, several frequencies"
[scene]
particles = 3
launch = [-0.4, 0.1, 1.3]
duration = 6.0
rebound = "reflect"
[sample]
realizations = 5
restitution = [0.0, 0.95]
amplitude = [0.1, 2.0]
frequency = [0.5, 3.0]
phase = [-9.0, 9.0]
[measure]
separation = true
"""


@pytest.fixture(scope="session")
def computed(tmp_path_factory):
    """Compute a sweep; return the path of its file."""

    def compute(text):
        path = tmp_path_factory.mktemp("verify") / "sweep.h5"
        run_sweep(parse_spec(text), path, threads=1)
        return path

    return compute


@pytest.fixture(scope="session")
def claimed(computed):
    return computed(CLAIMED)


@pytest.fixture(scope="session")
def many(computed):
    """The same with so many realizations that each variable can be changed in one of its own."""
    return computed(CLAIMED.replace("realizations = 3", "realizations = 60"))


@pytest.fixture(scope="session")
def locked(computed):
    return computed(LOCKED)


@pytest.fixture(scope="session")
def bare(computed):
    return computed(BARE)


@pytest.fixture
def edited(tmp_path):
    """Copy a file and open the copy for changes; afterwards seal it as a run would.

    A file without a seal would be read in another process first, which takes a second.
    """

    @contextmanager
    def editing(source):
        path = tmp_path / "changed.h5"
        if source != path:
            shutil.copy(source, path)
        with h5py.File(path, "r+") as file:
            yield path, file
        with path.open("r+b") as file:
            append_seal(file)

    return editing


@pytest.fixture
def changed(edited):
    """Copy a file and change one number; return the copy and the place of the change."""

    def change(source, name, new, realization=None, place=0):
        with edited(source) as (path, file):
            if realization is None:  # the one with the smallest error bound
                realization = int(np.argmin(file["landing_time_error"][...]))
            of_grid = np.unravel_index(realization, file["status"].shape)
            where = (*map(int, of_grid), place)[: file[name].ndim]
            file[name][where] = new(file[name][where])
        return SimpleNamespace(path=path, place=f"realization {realization}", where=where)

    return change
