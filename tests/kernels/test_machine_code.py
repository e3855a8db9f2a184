"""Machine code: compiled, kept on disk, vectorised, and the same bits as plain Python."""

import builtins
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numba
import numpy as np
import pytest
from llvmlite import binding
from numba.core.compiler import DefaultPassBuilder
from numba.core.registry import cpu_target
from packaging.requirements import Requirement

import vibrosweep
import vibrosweep as vs
from numba_names import HOME, command_without, complaints, from_numba
from numba_names import PACKAGE as PACKAGE_NUMBA
from tests.cases import each_of
from tests.general import as_the_engine_chooses, everything_plain
from tests.scenes import KINDS_OF_NOISE
from vibrosweep.engine import coupled
from vibrosweep.engine import measure as measure_unwritten
from vibrosweep.engine.measure import measure
from vibrosweep.errors import RunError, VibrosweepError
from vibrosweep.kernels import _numba, _pieces
from vibrosweep.kernels._jit import _fma_exact, generic, implements
from vibrosweep.kernels.coupled.joint_orbits import empty_joint
from vibrosweep.kernels.coupled.realizations import empty_per_realization
from vibrosweep.kernels.fixed import empty_fixed
from vibrosweep.kernels.impact import KIND_OF
from vibrosweep.kernels.memory import require_written
from vibrosweep.kernels.record import empty_record
from vibrosweep.kernels.separation import empty_separations
from vibrosweep.kernels.settle import empty_orbits, empty_shortest
from vibrosweep.kernels.statistics import KINDS, empty_statistics, empty_sums
from vibrosweep.kernels.trust import empty_trust

# The kernels as plain Python, and the machine code on disk.

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


WITHOUT_COMPILER = """
import numba
import vibrosweep as vs
assert numba.config.DISABLE_JIT
print(vs.simulate(duration=5.0).landing_time.values.tolist())
"""


def test_all_runs_with_the_compiler_switched_off():
    found = python(WITHOUT_COMPILER, NUMBA_DISABLE_JIT="1")
    assert found.strip() == str(vs.simulate(duration=5.0).landing_time.values.tolist())


@pytest.mark.parametrize(
    ("base", "rebound", "noise"),
    [
        ("high-bounce", "reflect", ()),
        ("moving", "rest", ()),
        pytest.param("sprung", "rest", (), marks=pytest.mark.weekly),
        ("high-bounce", "rest", KINDS_OF_NOISE),
    ],
)
def test_plain_python_gives_the_bits_of_the_machine_code(
    base, rebound, noise, parameters, random_scenes, observe, record, workers, monkeypatch
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
        measures = {"separation": True}
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
    lasting = 9.0 if base == "sprung" or noise else 100.0
    cases.append((late, observe((0.3, 1.3), duration=lasting)))
    cases = [(given, replace(seen, base=base, rebound=rebound)) for given, seen in cases]
    compiled = [(measure(*case, workers), record(*case)) for case in cases]
    everything_plain(monkeypatch)
    for case, results in zip(cases, compiled, strict=True):
        assert np.sum(results[0]["impact_count"]) > 10
        for one, other in zip(results, (measure(*case, workers), record(*case)), strict=True):
            for name, values in one.items():
                # numbers, not bytes: NaN may differ in its sign
                assert np.array_equal(values, other[name], equal_nan=values.dtype.kind == "f"), name


@each_of(
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
    edit(package / "kernels" / "arithmetic.py", "C0_HIGH = 6.28", "C0_HIGH = 7.28")
    value, _, hits = use(package)
    assert value == pytest.approx(2.25, abs=1e-12)
    assert hits == [0, 0]
    # a status that a kernel holds as a constant, and the order of the arrays in its argument
    code = "BUDGET_EXCEEDED = (\n        {},"
    edit(package / "model" / "measures.py", code.format(1), code.format(5))
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


# Names of numba that no version promises to keep: without each of them, one after another.

ROOT = Path(__file__).parents[2]
NAMES = sorted(from_numba(HOME))
PUBLIC = {"njit", "types", "intrinsic", "overload"}  # documented for those who extend numba
IN_PIECES = {
    *("CompilerBase", "DefaultPassBuilder", "JITCodeLibrary", "LoweringPass", "NativeLowering"),
    *("make_function", "register_pass"),
}
IN_CACHE = {
    *("CompileResultCacheImpl", "FunctionCache", "IndexDataCacheFile"),
    "UserProvidedCacheLocator",
}
compiles = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")


def test_private_names_are_imported_in_one_file_only():
    others = {name for f in PACKAGE_NUMBA.rglob("*.py") if f != HOME for name in from_numba(f)}
    assert others <= PUBLIC
    assert PUBLIC.isdisjoint(NAMES)
    assert set(NAMES) >= IN_PIECES | IN_CACHE


@pytest.mark.parametrize("name", NAMES)
def test_without_a_name(name, monkeypatch):
    """It is noted with what it costs."""
    genuine = builtins.__import__

    def importing(module, space=None, own=None, fromlist=(), level=0):
        if name in (fromlist or ()) and module.startswith("numba"):
            raise ImportError(f"cannot import name {name!r} from {module!r} (/a/path)")
        return genuine(module, space, own, fromlist, level)

    spec = importlib.util.spec_from_file_location("vibrosweep.kernels._numba_again", HOME)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setattr(builtins, "__import__", importing)
    spec.loader.exec_module(module)
    ((text, cost),) = module.lost.items()
    assert text.startswith(f"cannot import name {name!r} from 'numba")
    assert "path" not in text
    assert cost
    assert (name not in IN_PIECES) == module.HAS_PIECES
    assert (name not in IN_CACHE) == module.HAS_CACHE


@compiles
@pytest.mark.parametrize(
    "name", ["FunctionCache", pytest.param("JITCodeLibrary", marks=pytest.mark.weekly)]
)
def test_doctor_says_in_one_line_what_is_lost(name, tmp_path):
    code, text = command_without(name, "doctor", place=tmp_path)
    assert list(complaints(name, code, text)) == []


def test_everything_is_there():
    """Also the passes that are left out, which are known by their names alone."""
    assert _numba.lost == {}
    flags = {"auto_parallel": SimpleNamespace(enabled=False), "no_rewrites": False}
    state = SimpleNamespace(flags=SimpleNamespace(**flags, enable_ssa=True), func_ir=None)
    passes = DefaultPassBuilder.define_nopython_pipeline(state).passes
    assert {one.__name__ for one, _ in passes} >= _pieces.NEEDLESS


@compiles
def test_the_target_is_the_one_in_the_keys_of_machine_code():
    cpu_target.target_context.refresh()
    assert _numba.target() == cpu_target.target_context.codegen().magic_tuple()


def test_the_oldest_version_tried_is_the_oldest_allowed():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    needed = {one.name: one.specifier for one in map(Requirement, project["dependencies"])}
    assert str(needed["numba"]) == f">={_numba.OLDEST.removesuffix('.0')}"


# Widths of vectors; hot loops become vector code on every kind of processor.


@pytest.mark.parametrize(
    ("processor", "features", "bits"),
    [
        ("sapphirerapids", "+avx2,+avx512f,+fma", 512),
        ("znver4", "+avx512f", 512),
        ("znver3", "+avx2,-avx512f,+fma", None),
        ("skylake-avx512", "+avx512f", None),
        ("cascadelake", "+avx512f", None),
        ("neoverse-n1", "+neon", None),
    ],
)
def test_the_width_by_processor(monkeypatch, processor, features, bits):
    monkeypatch.setattr(_numba, "target", lambda: ("system", processor, features))
    monkeypatch.setattr(_numba, "SET_BITS", None)
    assert _numba.vector_bits() == bits
    monkeypatch.setattr(_numba, "SET_BITS", 256)
    assert _numba.vector_bits() == 256


@pytest.mark.parametrize(("text", "bits"), [("", None), ("128", 128), ("512", 512)])
def test_the_width_from_the_environment(monkeypatch, text, bits):
    monkeypatch.setenv(_numba.VARIABLE, text)
    assert _numba._set_by_environment() == bits


def test_a_width_that_does_not_exist_is_refused(monkeypatch):
    monkeypatch.setenv(_numba.VARIABLE, "1024")
    with pytest.raises(VibrosweepError, match=r"VIBROSWEEP_VECTOR_BITS=1024.*128, 256, 512 bits"):
        _numba._set_by_environment()


STEP = """
import re, sys
from numba import njit, typeof, types
from vibrosweep.kernels._jit import OPTIONS
from vibrosweep.kernels.advance import _step
from vibrosweep.kernels.impact import base_of
from vibrosweep.kernels.cycles import Chosen
from vibrosweep.kernels.statistics import KINDS
chosen = typeof(Chosen(base_of("BASE", "rest"), KINDS))
none = types.none
integer = types.int64
signature = (types.float64[::1], integer, chosen, types.float64, none, none, integer, integer)
# without references there is nothing for numba to remove before loops become vector code
step = njit(signature, _nrt=False, **OPTIONS)(_step.__wrapped__)
"""


def hot_loop(show, base, **environment):
    """Text that a fresh process prints about the kernels' hottest loop, compiled for a base."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_", "VIBROSWEEP_"))}
    done = subprocess.run(
        [sys.executable, "-c", STEP.replace("BASE", base) + show],
        env=inherited | environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


SHOW = r"""
(assembly,) = step.inspect_asm().values()
blocks = re.split(r"^\.LBB\w+:", assembly, flags=re.MULTILINE)
packed = [re.findall(r"vfn?m(?:add|sub)\w+pd.*%([xyz]mm)", block) for block in blocks]
masked = re.findall(r"\tvmaskmovp[ds]\t%[xy]mm.*\)$", assembly, flags=re.MULTILINE)
print(len(masked), *max(packed, key=len))
"""
AVX2 = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma,+bmi,+bmi2,+sse4.2"}


@compiles
@pytest.mark.parametrize(
    ("base", "bits", "register", "feature"),
    [
        pytest.param("high-bounce", 128, "xmm", "avx2", marks=pytest.mark.weekly),
        ("moving", 256, "ymm", "avx2"),
        pytest.param("moving", 512, "zmm", "avx512f", marks=pytest.mark.weekly),
    ],
)
def test_the_hot_loop_uses_registers_of_the_width_that_is_asked_for(base, bits, register, feature):
    """There are no masked stores, which are slow on AMD processors with AVX2."""
    if not binding.get_host_cpu_features().get(feature):
        pytest.skip(f"this processor has no {feature}")
    environment = {"VIBROSWEEP_VECTOR_BITS": str(bits)} | (AVX2 if feature == "avx2" else {})
    masked, *registers = hot_loop(SHOW, base, **environment).split()
    assert len(registers) >= 11
    assert set(registers) == {register}
    assert masked == "0"


# numba's code before any optimisation, compiled for a plain ARMv8
ON_ARM = """
from llvmlite import binding
(text,) = step.inspect_llvm().values()
text = re.sub(r"^target (triple|datalayout).*$", "", text, flags=re.MULTILINE)
assert "x double>" not in text
binding.initialize_all_targets()
binding.initialize_all_asmprinters()
triple = "aarch64-unknown-linux-gnu"
arm = binding.Target.from_triple(triple).create_target_machine(cpu="generic", opt=3)
module = binding.parse_assembly(text)
module.triple, module.data_layout = triple, str(arm.target_data)
options = binding.create_pipeline_tuning_options(speed_level=3)
options.loop_vectorization = True
passes = binding.create_pass_builder(arm, options)
passes.getModulePassManager().run(module, passes)
print(arm.emit_assembly(module))
"""


@compiles
@pytest.mark.weekly
@pytest.mark.parametrize("base", KIND_OF)
def test_the_hot_loop_becomes_vector_code_on_arm(base):
    plain = {"NUMBA_OPT": "0", "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    try:
        assembly = hot_loop(ON_ARM, base, **plain)
    except AssertionError as error:
        if "No available targets" in str(error):
            pytest.skip("this LLVM has no code for ARM")
        raise
    # a packed fused multiply-add for each `fma` of the source, and no call of a library
    packed = [line for line in assembly.splitlines() if "\tfmla\t" in line and ".2d" in line]
    assert len(packed) >= 10
    assert "\tbl\tfma" not in assembly


# Machine code that the engine chooses for a scene, against that of `tests/general.py`.


@pytest.mark.parametrize(
    ("base", "noise"),
    [("moving", {}), pytest.param("high-bounce", {"kick_noise": 0.1}, marks=pytest.mark.weekly)],
)
def test_special_machine_code_gives_the_bits_of_the_general(
    base, noise, parameters, observe, workers, monkeypatch
):
    """Over a base that lifts nobody, without landings before a window and without cycles.

    With one kind of noise alone means add the same numbers in other partial sums.
    """
    inputs = parameters(amplitude=[0.0, 0.4, 1.2, 2.6], restitution=[0.3, 0.6, 0.8, 0.9])
    if noise:
        inputs |= {name: np.full(4, value) for name, value in noise.items()}
        inputs["noise_stream"] = np.arange(4.0)
    scene = replace(observe(particles=3), base=base)
    known = measure(inputs, scene, workers)
    as_the_engine_chooses(monkeypatch)
    found = measure(inputs, scene, workers)
    assert known["impact_count"].min() > 3
    assert found.keys() == known.keys()
    for name, values in known.items():
        if noise and name.endswith("_mean"):
            np.testing.assert_allclose(found[name], values, rtol=2e-15, err_msg=name)
        else:
            assert found[name].tobytes() == values.tobytes(), name


# Results that a kernel forgets are named, whatever their type.

EMPTY = [
    empty_fixed(3),
    empty_joint(3),
    empty_orbits(3),
    empty_per_realization(3),
    empty_record(3, 2),
    empty_separations(3),
    empty_shortest(3),
    empty_statistics(3),
    empty_sums(3, KINDS),
    empty_trust(3),
]


def arrays(results):
    for values in results:
        if isinstance(values, np.ndarray):
            yield values
        elif hasattr(values, "_fields"):
            yield from arrays(values)


@each_of("results", EMPTY)
def test_a_single_unwritten_number_is_reported(results):
    for values in arrays(results):
        if values.dtype.kind in "fc":
            assert np.isnan(values).all()
        with pytest.raises(RunError, match="not completely written"):
            require_written(results)
        first = values.flat[0]
        values[...] = 0
        values.flat[0] = first
        with pytest.raises(RunError, match="not completely written"):
            require_written(results)
        values[...] = np.nan if values.dtype.kind in "fc" else -1
    require_written(results)


def left(kernel, *fields):
    """Return the kernel, made to leave a number of its results unwritten."""

    def leaves(*arguments):
        result, out = kernel(*arguments), arguments[-1]
        for field in fields:
            out = getattr(out, field)
        out[-1] = empty_statistics(1).status[0]
        return result

    return leaves


def test_a_result_that_a_kernel_leaves_unwritten_is_named(monkeypatch):
    scene = {"particles": 3, "restitution": [0.7, 0.8], "duration": 3.0, "design": "grid"}
    monkeypatch.setattr(measure_unwritten, "separate", left(measure_unwritten.separate, "shared"))
    with pytest.raises(RunError, match=r"Separations\.shared"):
        vs.sweep(**scene, separation=True)
    monkeypatch.setattr(measure_unwritten, "combine", left(measure_unwritten.combine, "status"))
    with pytest.raises(RunError, match=r"Statistics\.status"):
        vs.sweep(**scene)


def test_a_variable_that_nothing_computes_is_named(monkeypatch):
    monkeypatch.setattr(coupled, "separations_in_units", lambda *_: {})
    monkeypatch.setattr(measure_unwritten, "separations_in_units", lambda *_: {})
    for base in (
        {"base": "high-bounce"},
        {"base": "sprung", "mass_ratio": 0.1, "mount_frequency": 2.0},
    ):
        with pytest.raises(RunError, match=r"dt_min, .*not computed"):
            vs.sweep(particles=2, realizations=2, duration=2.0, separation=True, **base)
