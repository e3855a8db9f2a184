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

general.in_tests()

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


def pytest_configure(config):
    compilations = Compilations()
    config.pluginmanager.register(compilations)
    register("numba:compile", compilations)


@pytest.fixture(scope="session")
def workers():
    from vibrosweep.engine.workers import Workers

    with Workers(2) as pool:
        yield pool


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
    """Record of every landing on a moving base, followed in plain Python from the equations."""

    def flight(x, y, alpha):
        """Duration of the flight from phase x with the relative speed y, to the first landing."""
        turn = 2.0 * np.pi
        gamma = np.pi * alpha
        # after a lift-off the clearance grows until the base falls slower than gravity again
        s = 0.0 if y > 0.0 else 1.0 - 2.0 * x
        for _ in range(200):
            ahead = alpha / 2.0 * (np.sin(turn * x) - np.sin(turn * (x + s)))
            slope = (y - 2.0 * s) / 2.0 + ahead
            fall = np.cos(turn * (x + s)) - np.cos(turn * x) + turn * s * np.sin(turn * x)
            clearance = s * (y - s) / 2.0 + alpha / (4.0 * np.pi) * fall
            # the clearance lies above a parabola that is positive up to this step
            step = (slope + np.sqrt(max(slope**2 + 2.0 * (1.0 + gamma) * clearance, 0.0))) / (
                1.0 + gamma
            )
            s += step
            if abs(step) < 1e-15 * (1.0 + s):
                break
        return s, 2.0 * s - y + alpha * (np.sin(turn * (x + s)) - np.sin(turn * x))

    def particle(p, launch, duration):
        f, g, e = p["frequency"], p["gravity"], p["restitution"]
        unit, alpha = g / (2.0 * f), 2.0 * f * p["amplitude"] / g / (1.0 + e)
        gamma, shift = np.pi * alpha, p["phase"] / (2.0 * np.pi)
        lift = np.arccos(-1.0 / gamma) / (2.0 * np.pi) if gamma > 1.0 else 0.5
        n, x = divmod(f * launch + shift + 0.5, 1.0)
        x, rows = x - 0.5, []
        y = p["launch_velocity"] / unit - alpha * np.sin(2.0 * np.pi * x)
        while True:
            presses = gamma <= 1.0 or abs(x) <= lift
            at_once = y < 0.0 or (y == 0.0 and presses and x != lift)
            s, z = (0.0, -y) if at_once else flight(x, y, alpha)
            whole, x = divmod(x + s + 0.5, 1.0)
            n, x, y = n + whole, x - 0.5, e * z
            time = (n + x - shift) / f
            if time > duration:
                return rows
            up, rested = time, 0
            if y <= f * p["contact_time"] and (gamma <= 1.0 or abs(x) <= lift):
                rested, x, y = 1, lift, 0.0
                up = (n + x - shift) / f if gamma > 1.0 else np.nan
            speed = (y + alpha * np.sin(2.0 * np.pi * x)) * unit
            rows.append((time, up, speed if np.isfinite(up) else np.nan, rested))
            if np.isnan(up):
                return rows

    def make(launch_time=(0.0,), duration=12.0, **changed):
        import xarray as xr

        from vibrosweep.model.parameters import PARAMETERS

        p = {name: one.default for name, one in PARAMETERS.items()} | changed
        launches = np.atleast_1d(np.asarray(launch_time, dtype=np.float64))
        rows = [particle(p, float(launch), duration) for launch in launches]
        table = np.full((4, 1, launches.size, max(1, *map(len, rows), 1)), np.nan)
        for i, one in enumerate(rows):
            if one:
                table[:, 0, i, : len(one)] = np.array(one).T
        dims = ("realization", "particle", "impact")
        names = ("landing_time", "liftoff_time", "rebound_velocity")
        return xr.Dataset(
            {
                **{name: (dims, values) for name, values in zip(names, table[:3], strict=True)},
                "rested": (dims, np.nan_to_num(table[3]).astype(np.int8)),
                "impact_count": (dims[:2], np.isfinite(table[0]).sum(axis=-1)),
                "status": (dims[:2], np.zeros((1, launches.size), np.int8)),
            },
            coords={
                **{name: ((), value) for name, value in p.items()},
                "launch_time": ((dims[1],), launches),
                "duration": ((), duration),
            },
            attrs={"rebound": "rest", "base": "moving"},
        )

    return make


@pytest.fixture
def limited():
    """Make the system refuse to write files beyond so many bytes, as a full disk does."""
    resource = pytest.importorskip("resource")

    @contextmanager
    def limit(size):
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    return limit
