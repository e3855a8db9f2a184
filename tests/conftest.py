"""Shared by all tests: threads, sets of parameters, and random scenes over wide ranges."""

import gc
import os
import signal
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

# Linear-algebra threads of several processes at once would wait for each other in busy loops.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
import pytest
from hypothesis import settings

from tests import general
from tests.compilations import Compilations
from vibrosweep.cli import OBJECTS_BETWEEN_COLLECTIONS
from vibrosweep.kernels._numba import register

# Compiling a kernel takes seconds, so no example has a deadline.  The examples are the same every
# time, so that no change is judged by chance; `--hypothesis-profile=search` looks for new ones.
settings.register_profile("search", deadline=None, max_examples=1000)
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")

# Compiling makes many objects and little garbage; the command line sets the same threshold.
gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)

# Background jobs of a shell ignore SIGINT, and so would the commands that tests start there.
signal.signal(signal.SIGINT, signal.default_int_handler)


# Files that need the same expensive kernels run one after the other in one process: two processes
# would compile them at the same time.
OF_LINES = {"tests/analysis/test_branches.py", "tests/proof/test_windows.py"}


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    from xdist.scheduler import LoadFileScheduling

    class ByKernels(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = super()._split_scope(nodeid)
            return "lines of orbits" if file in OF_LINES else file

    return ByKernels(config, log) if config.getoption("dist") == "loadfile" else None


def pytest_addoption(parser):
    parser.addoption("--compilations", action="store_true", help="list the compiled kernels")
    parser.addoption(
        "--machine-code", action="store_true", help="compile all that the engine would compile"
    )


def pytest_configure(config):
    general.in_tests(machine_code=config.getoption("--machine-code"))
    compilations = Compilations()
    config.pluginmanager.register(compilations)
    register("numba:compile", compilations)


@pytest.fixture(scope="session")
def workers():
    from vibrosweep.engine.workers import Workers

    with Workers(2) as pool:
        yield pool


@pytest.fixture(scope="module")
def plain_pieces():
    """Call pieces of kernels in plain Python, which needs no compiler."""
    general.PIECES.append(__name__)
    yield
    general.PIECES.clear()


@pytest.fixture
def memory(monkeypatch):
    """Let this machine seem to have so many bytes of memory."""

    def has(size):
        pages = {"SC_PHYS_PAGES": size, "SC_PAGE_SIZE": 1}
        monkeypatch.setattr("os.sysconf", pages.__getitem__)

    return has


@pytest.fixture(scope="session")
def parameters():
    """Complete parameters with the defaults, as arrays of one length."""
    from vibrosweep.engine.landings import all_parameters

    def complete(**given):
        arrays = np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, float)) for v in given.values()))
        return all_parameters(dict(zip(given, arrays, strict=True)))

    return complete


@pytest.fixture(scope="session")
def random_scenes(parameters):
    """Draw scenes over wide ranges, with special values among them."""

    def draw(seed, size, **fixed):
        rng = np.random.default_rng(seed)
        restitution = rng.uniform(0.0, 1.0, size)
        restitution[::7], restitution[3::7] = rng.choice([0.0, 1.0, 0.9, 0.98], 2)
        amplitude = 10.0 ** rng.uniform(-3.0, 0.7, size)
        amplitude[5::11] = 0.0
        drawn = {
            "restitution": restitution,
            "amplitude": amplitude,
            "frequency": 10.0 ** rng.uniform(-0.5, 1.0, size),
            "phase": rng.uniform(-20.0, 20.0, size),
            "gravity": rng.uniform(1.0, 25.0, size),
            "launch_velocity": rng.uniform(0.0, 8.0, size),
            "contact_time": 10.0 ** rng.uniform(-5.0, -1.0, size),
        }
        drawn["launch_velocity"][2::13] = 0.0
        return parameters(**(drawn | fixed))

    return draw


@pytest.fixture(scope="session")
def observe():
    """Scenes of 12 s that measure separations and each particle, unless said otherwise."""
    from vibrosweep.scene.scene import Scene

    def make(launch="staggered", particles=20, **changes):
        if not isinstance(launch, str):
            launch = tuple(float(time) for time in launch)
            particles = len(launch)
        plain = Scene(particles, launch, 12.0, "rest").recorded(10**6)
        keys = {"transient": 0.0, "separation": True, "per_particle": True}
        keys |= {name: changes.pop(name) for name in vars(plain.measures) if name in changes}
        return replace(plain.with_measures(**keys), **changes)

    return make


@pytest.fixture(scope="session")
def record(workers):
    """Record every landing of a scene, whatever its window."""
    from vibrosweep.engine.landings import record_landings

    def landings(values, scene):
        return record_landings(values, scene.with_measures(transient=-np.inf), workers)

    return landings


@pytest.fixture
def compute(tmp_path):
    """Compute a sweep from the text of its file; return the path of the result."""
    from vibrosweep.runs.driver import run_sweep
    from vibrosweep.scene.sweep import read_spec

    def result(text, threads=2, **options):
        count = len(list(tmp_path.glob("*.toml")))
        spec = tmp_path / f"sweep{count}.toml"
        spec.write_text(f'title = "A sweep of a test"\n{text}', encoding="utf-8")
        run_sweep(read_spec(spec), spec.with_suffix(".h5"), threads=threads, **options)
        return spec.with_suffix(".h5")

    return result


@pytest.fixture(scope="session")
def paper(tmp_path_factory):
    """The result of sweeps/paper.toml."""
    from vibrosweep import run

    path = tmp_path_factory.mktemp("paper") / "paper.h5"
    run(Path(__file__).parents[1] / "sweeps" / "paper.toml", path).close()
    return path


@pytest.fixture(scope="session")
def moving_record():
    """Record of every landing on a moving base."""
    from vibrosweep import simulate

    def make(launch_time=(0.0,), duration=12.0, **given):
        launches = [*np.atleast_1d(launch_time)]
        return simulate(base="moving", launch_time=launches, duration=duration, **given)

    return make


@pytest.fixture
def limited():
    """Make the system refuse to write files beyond so many bytes, as a full disk does."""
    resource = pytest.importorskip("resource")

    @contextmanager
    def limit(size):
        gc.collect()  # HDF5 ends a process that closes another file, left over, meanwhile
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    return limit
