"""The kernels as plain Python, and the machine code on disk."""

import json
import os
import pickle
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import vibrosweep
from vibrosweep.engine.measure import measure
from vibrosweep.kernels._jit import _fma_exact, generic, implements
from vibrosweep.model.parameters import NOISE

PACKAGE = Path(vibrosweep.__file__).parent


def python(script, *arguments, source=PACKAGE.parent, **environment):
    """Run a script in a fresh interpreter; return what it prints."""
    # sources are edited within a second, which stale bytecode would hide
    inherited = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_")}
    fresh = {"PYTHONPATH": str(source), "PYTHONDONTWRITEBYTECODE": "1"}
    run = subprocess.run(
        [sys.executable, "-c", script, *map(str, arguments)],
        env=inherited | fresh | environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


AS_PYTHON = """
import pickle, sys, warnings
from pathlib import Path
import numba
assert numba.config.DISABLE_JIT
warnings.simplefilter("error")
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.engine.landings import record_landings
given, found = map(Path, sys.argv[1:])
results = []
with Workers(1) as workers:
    for scene, observation in pickle.loads(given.read_bytes()):
        endless = observation.with_measures(transient=-float("inf"))
        results.append((measure(scene, observation, workers),
                        record_landings(scene, endless, workers)))
found.write_bytes(pickle.dumps(results))
"""


@pytest.mark.parametrize(
    ("base", "rebound", "noise"),
    [
        ("high-bounce", "reflect", ()),
        ("moving", "rest", ()),
        pytest.param("sprung", "rest", (), marks=pytest.mark.weekly),
        ("high-bounce", "rest", tuple(NOISE)),
    ],
)
def test_plain_python_gives_the_bits_of_the_machine_code(
    base, rebound, noise, tmp_path, parameters, random_scenes, observe, record, workers
):
    # products are fused where the source says so and nowhere else, and nothing divides by zero,
    # at which plain Python would raise an error
    rng, size = np.random.default_rng(6), 4
    scene = random_scenes(seed=70, size=size, contact_time=0.02, launch_velocity=2.0)
    thrown = 10.0 ** rng.uniform(-1.0, 1.0, size) * (1.0 + scene["restitution"])
    scene["amplitude"] = thrown * scene["gravity"] / (2.0 * np.pi * scene["frequency"])
    scene["amplitude"][3], scene["launch_velocity"][2] = 0.0, 0.0
    late = parameters(restitution=0.3, amplitude=3.857, launch_velocity=4.905)
    measures = {"regimes": True, "lyapunov": True, "trust": True, "tolerance": 1e-9}
    measures |= {"ordering": True}
    if noise:  # no orbit recurs, and plain Python draws numbers slowly
        scene = {name: values[:3] for name, values in scene.items()}
        measures = {"separation": True, "ordering": True}
        for given in (scene, late):
            given |= {name: np.full(given["phase"].size, 0.2) for name in noise}
            given["noise_stream"] = np.arange(given["phase"].size)
    if base == "sprung":
        measures = {"ordering": True, "joint": True}
        for given in (scene, late):
            given["mass_ratio"] = rng.choice([0.0, 0.01, 0.2], given["phase"].size)
            given["mount_frequency"] = 10.0 ** rng.uniform(-1.0, 0.5, given["phase"].size)
            given["mount_damping"] = rng.choice([0.0, 0.1, 1.0, 3.0], given["phase"].size)
    cases = [
        (scene, observe(launch, duration=3.0, transient=begin, impact_budget=60, **measures))
        for launch, begin in (((0.0, -1.7), 0.0), ((0.1, 0.2), 1.3))
    ]
    # orbits that recur; the second launch is the first, a period later
    lasting = 9.0 if base == "sprung" or noise else 350.0
    cases.append((late, observe((0.3, 1.3), duration=lasting)))
    cases = [(given, replace(seen, base=base, rebound=rebound)) for given, seen in cases]
    given, found = tmp_path / "given", tmp_path / "found"
    given.write_bytes(pickle.dumps(cases))
    python(AS_PYTHON, given, found, NUMBA_DISABLE_JIT="1")
    plain = pickle.loads(found.read_bytes())
    for (scene, observation), results in zip(cases, plain, strict=True):
        compiled = measure(scene, observation, workers), record(scene, observation)
        assert np.sum(compiled[0]["impact_count"]) > 10
        for one, other in zip(compiled, results, strict=True):
            for name, values in one.items():
                # numbers, not bytes: NaN may differ in its sign
                assert np.array_equal(values, other[name], equal_nan=values.dtype.kind == "f"), name


@pytest.mark.parametrize(
    ("a", "b", "c"),
    [
        (1.0 + 2.0**-52, 1.0 - 2.0**-52, -1.0),
        (0.1, 10.0, -1.0),
        (np.nan, 1.0, 1.0),
        (np.inf, 0.0, 1.0),
        (5e-324, 0.5, 5e-324),
    ],
)
def test_fma_rounds_once(a, b, c):
    from numba import njit

    from vibrosweep.kernels._jit import fma

    compiled = njit(lambda x, y, z: fma(x, y, z))(a, b, c)
    exact = _fma_exact(a, b, c)
    assert exact == compiled or (np.isnan(exact) and np.isnan(compiled))


class Doubling(NamedTuple):
    """A law."""


def test_a_formula_is_named_in_tracebacks_and_profiles():
    @generic
    def growth(law, e):
        """How much e grows."""

    formula = implements(growth, Doubling)(lambda law, e: 2.0 * e)
    assert formula.__name__ == formula.__code__.co_name == "growth_doubling"
    assert growth(Doubling(), 1.5) == 3.0


PROBE = """
from vibrosweep.kernels._jit import kernel
from vibrosweep.kernels.arithmetic import sin_turns
from vibrosweep.model.measures import Status

BUDGET_EXCEEDED = int(Status.BUDGET_EXCEEDED)

@kernel
def probe(x):
    return sin_turns(x) + BUDGET_EXCEEDED

@kernel
def field(problem):
    return problem.kick[0]
"""

USE = """
import json
import numpy as np
from vibrosweep.kernels import _jit, probe
from vibrosweep.model.parameters import Dimensionless
value = probe.probe(0.25)
field = probe.field(Dimensionless(**{n: np.array([1.0 if n == "kick" else 0.0])
                                     for n in Dimensionless._fields}))
hits = [sum(k.dispatcher.stats.cache_hits.values()) for k in (probe.probe, probe.field)]
print(json.dumps([value, field, hits, str(_jit.cache_directory)]))
"""


@pytest.fixture
def package(tmp_path):
    """A copy of the package with two small kernels, which inline what the real ones do."""
    target = tmp_path / "vibrosweep"
    shutil.copytree(PACKAGE, target, ignore=shutil.ignore_patterns("__pycache__"))
    (target / "kernels" / "probe.py").write_text(PROBE)
    return target


def use(package):
    value, field, hits, directory = json.loads(python(USE, source=package.parent))
    assert Path(directory).is_relative_to(package)
    return value, field, hits


def edit(path, old, new):
    text = path.read_text()
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))


def test_machine_code_is_kept_on_disk_and_never_stale(package):
    assert use(package) == (2.0, 1.0, [0, 0])
    assert use(package) == (2.0, 1.0, [1, 1])
    # a constant that a kernel inlines from another module
    edit(package / "kernels" / "sine.py", "C0_HIGH = 6.28", "C0_HIGH = 7.28")
    value, _, hits = use(package)
    assert value == pytest.approx(2.25, abs=1e-12)
    assert hits == [0, 0]
    # a status that a kernel holds as a constant, and the order of the arrays in its argument
    code = "BUDGET_EXCEEDED = (\n        {},"
    edit(package / "model" / "status.py", code.format(1), code.format(5))
    parameters = package / "model" / "parameters.py"
    edit(parameters, "    kick: Array  # a", "    kick_was: Array  # a")
    edit(parameters, "    end_phase: Array", "    kick: Array\n    end_phase: Array")
    value, field, hits = use(package)
    assert value == pytest.approx(6.25, abs=1e-12)
    assert field == 1.0
    assert hits == [0, 0]


def test_kernels_compute_although_no_machine_code_can_be_written(package, tmp_path):
    environment = {"HOME": str(tmp_path / "nowhere"), "NUMBA_CACHE_DIR": "/dev/null/none"}
    script = USE.replace("print(", "assert _jit.cache_directory is None\nprint(")
    script = script.replace("sum(k.dispatcher.stats.cache_hits.values())", "0")
    value, *_ = json.loads(python(script, source=package.parent, **environment))
    assert value == 2.0


def test_every_kernel_is_read_from_disk_when_nothing_changed(parameters, observe, workers):
    scene, observation = parameters(), observe(particles=3)
    measure(scene, observation, workers)  # compiles what is not compiled yet
    script = """
import sys
import numpy as np
from vibrosweep.kernels.advance import advance
from vibrosweep.kernels.separation import separate
from vibrosweep.kernels.statistics import combine
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.engine.landings import all_parameters
from vibrosweep.scene.scene import Scene
observation = Scene(3, "staggered", 12.0, "rest").recorded(10**6)
observation = observation.with_measures(transient=0.0, separation=True)
with Workers(1) as workers:
    measure(all_parameters({}), observation, workers)
for kernel in (advance, combine, separate):
    assert sum(kernel.dispatcher.stats.cache_hits.values()) == 1, kernel
    assert not kernel.dispatcher.stats.cache_misses, kernel
# modules that only a compiler needs take longer to import than all others
assert not {"scipy.linalg", "numba.np.arrayobj", "numba.np.linalg"} & sys.modules.keys()
"""
    cache = {k: v for k, v in os.environ.items() if k == "NUMBA_CACHE_DIR"}
    python(script, **cache)
