"""Shared by all tests: threads, sets of parameters, and random scenes over wide ranges."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

# compiling a kernel takes seconds: no single example may be held to a time
settings.register_profile("compiled", deadline=None)
settings.load_profile("compiled")


@pytest.fixture(scope="session")
def workers():
    from vibrosweep.engine.workers import Workers

    with Workers(2) as pool:
        yield pool


@pytest.fixture(scope="session")
def parameters():
    """Complete parameters by the defaults, as arrays of one length."""
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
    """An observation of 12 s that measures separations and each particle, unless said otherwise."""
    from vibrosweep.runs.driver import record_observation

    def make(launch="staggered", particles=20, **changes):
        if not isinstance(launch, str):
            launch = tuple(float(time) for time in launch)
            particles = len(launch)
        plain = record_observation(particles, launch, 12.0, "rest", 10**6)
        keys = {"transient": 0.0, "separation": True, "per_particle": True}
        keys |= {name: changes.pop(name) for name in vars(plain.measures) if name in changes}
        return replace(plain.measuring(**keys), **changes)

    return make


@pytest.fixture(scope="session")
def record(workers):
    """Every landing of what is observed, whatever its window."""
    from vibrosweep.engine.landings import record_landings

    def landings(scene, observation):
        return record_landings(scene, observation.measuring(transient=-np.inf), workers)

    return landings


@pytest.fixture
def compute(tmp_path):
    """Compute the text of a sweep file; gives the path of the result."""
    from vibrosweep.api import run

    def result(text, **options):
        count = len(list(tmp_path.glob("*.toml")))
        spec = tmp_path / f"sweep{count}.toml"
        spec.write_text(f'title = "A sweep of a test"\n{text}', encoding="utf-8")
        run(spec, spec.with_suffix(".h5"), **options).close()
        return spec.with_suffix(".h5")

    return result


@pytest.fixture(scope="session")
def paper(tmp_path_factory):
    """The result of sweeps/paper.toml."""
    from vibrosweep.api import run

    path = tmp_path_factory.mktemp("paper") / "paper.h5"
    run(Path(__file__).parents[1] / "sweeps" / "paper.toml", path).close()
    return path
