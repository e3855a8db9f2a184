"""`vibrosweep doctor` on healthy and on broken installations."""

import os
import subprocess
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import numba
import pytest
from llvmlite import binding

from vibrosweep import doctor as checks
from vibrosweep import simulate
from vibrosweep.cli import main
from vibrosweep.doctor import Finding, machine
from vibrosweep.doctor.machine import kernels, warm_up
from vibrosweep.errors import OutputError
from vibrosweep.kernels import _jit
from vibrosweep.kernels._cache import Variants
from vibrosweep.model.parameters import LAWS
from vibrosweep.runs.driver import available_threads

SUBJECTS = {
    "vibrosweep",
    "python",
    "libraries",
    "optional libraries",
    "HDF5",
    "processors",
    "compiler",
    "vector registers",
    "kernel cache",
    "memory",
    "disk",
}


def doctor(directory, **environment):
    """Run the command in a fresh process."""
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            "from vibrosweep.cli import main; raise SystemExit(main())",
            "doctor",
        ],
        capture_output=True,
        text=True,
        check=False,
        cwd=directory,
        env={**os.environ, "PYTHONPATH": str(Path(_jit.__file__).parents[2]), **environment},
    )
    assert done.stderr == ""
    return done.returncode, done.stdout


def test_all_is_well(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines.pop() == "all is well"
    assert {line[:20].rstrip() for line in lines} == SUBJECTS
    assert list(tmp_path.iterdir()) == []


def test_switches_that_spoil_the_machine_code_are_named(tmp_path):
    code, text = doctor(tmp_path, NUMBA_CPU_NAME="generic", NUMBA_CACHE_DIR=str(tmp_path / "cache"))
    if not numba.config.DISABLE_JIT and "x86" in os.uname().machine:
        assert code == 1
        assert "vector registers    64 bits, no fused multiply-add" in text
        assert "WRONG: results are correct, but slow" in text
        assert "unset NUMBA_CPU_NAME" in text
    assert "kernel cache        0 compiled variants" in text
    assert "vibrosweep warmup" in text


@pytest.mark.skipif(
    not binding.get_host_cpu_features().get("avx2") or bool(numba.config.DISABLE_JIT),
    reason="needs a choice of widths",
)
def test_a_width_of_vectors_that_the_user_sets(tmp_path):
    cache = str(tmp_path / "cache")
    code, text = doctor(tmp_path, VIBROSWEEP_VECTOR_BITS="128", NUMBA_CACHE_DIR=cache)
    assert code == 0
    assert "vector registers    128 bits, fused multiply-add by instruction" in text
    assert "128 bits requested, which VIBROSWEEP_VECTOR_BITS changes" in text


def test_a_process_without_the_compiler(tmp_path):
    code, text = doctor(tmp_path, NUMBA_DISABLE_JIT="1")
    assert code == 1
    assert text.count("unset NUMBA_DISABLE_JIT") == 1
    assert text.endswith("1 problem, marked WRONG above\n")


def test_two_hdf5_libraries_that_do_not_get_along():
    found = checks.hdf5_libraries(None, "import os; print('1.0'); os.abort()")
    assert "ended with code -6" in found.trouble
    assert "python -m pip install" in found.trouble
    found = checks.hdf5_libraries(None, "raise OSError('unable to lock file')")
    assert "HDF5_USE_FILE_LOCKING=FALSE" in found.trouble
    found = checks.hdf5_libraries(None, "import time; time.sleep(60)", 0.2)
    assert "no answer within 0.2 s" in found.trouble


def test_libraries_that_are_missing_or_too_old(monkeypatch, tmp_path):
    stated = ["numpy>=1.26", "numba>=99", "vibrosweep-none>=1", "absent>=1; extra == 'verify'"]
    installed = tmp_path / "vibrosweep-99.dist-info"
    installed.mkdir()
    lines = ["Metadata-Version: 2.1", "Name: vibrosweep", "Version: 99", "Provides-Extra: verify"]
    lines += [f"Requires-Dist: {needed}" for needed in stated]
    (installed / "METADATA").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(tmp_path)
    (trouble,) = [found.trouble for found in checks.versions() if found.trouble]
    assert trouble.startswith("needed: numba>=99, vibrosweep-none>=1; install with")
    assert "absent" not in trouble


def test_a_limit_on_the_time_of_processors(tmp_path):
    assert machine.processors(tmp_path).trouble == ""
    (tmp_path / "cpu.max").write_text("max 100000\n")
    assert machine.processors(tmp_path).trouble == ""
    (tmp_path / "cpu.max").write_text(f"{100_000 * available_threads()} 200000\n")
    half = available_threads() / 2
    told = f"the container limits CPU time to {half:g} processors: give --threads"
    assert f"{told} {max(1, round(half))}, " in machine.processors(tmp_path).trouble


def test_a_limit_on_the_memory(tmp_path):
    assert machine.memory(tmp_path).trouble == ""
    (tmp_path / "memory.max").write_text(f"{1 << 30}\n")
    (tmp_path / "memory.current").write_text(f"{900 << 20}\n")
    found = machine.memory(tmp_path)
    assert "of which this container may take 0.121 GiB" in found.state
    assert "lower --chunk" in found.trouble


def test_a_full_or_unwritable_disk_is_reported(monkeypatch, tmp_path):
    assert machine.disk(tmp_path).trouble == ""
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=1 << 20))
    assert "free some space" in machine.disk(tmp_path).trouble
    if Path("/proc/self").exists():
        assert "nothing can be written here" in machine.disk(Path("/proc/self")).trouble


def test_kernels_without_a_place_for_machine_code(tmp_path):
    assert "set NUMBA_CACHE_DIR" in machine.kernel_cache(None).trouble
    assert "set NUMBA_CACHE_DIR" in machine.kernel_cache(None, (tmp_path,)).trouble


def test_kernels_that_can_only_be_read(tmp_path, monkeypatch):
    monkeypatch.setattr("vibrosweep.kernels._cache.variants", lambda directory: Variants(3, 0, 0))
    found = machine.kernel_cache(None, (tmp_path,))
    assert (
        f"3 compiled variants of these sources for this processor, 0.0 MiB in {tmp_path}, "
        "which can only be read; a run compiles" in found.state
    )
    assert found.trouble == ""


def test_a_damaged_cache(tmp_path):
    (tmp_path / "k.nbi").write_bytes(b"damaged")
    trouble = machine.kernel_cache(tmp_path).trouble
    assert "damaged or missing files: 1" in trouble
    assert f"delete {tmp_path}" in trouble


@pytest.mark.parametrize(
    ("features", "bits"),
    [
        ("+fma,+avx,+avx2,+avx512f", 512),
        ("-avx512f,+avx2,+fma", 256),
        ("+neon,+v8a", 128),
        ("+avx,+sse2", 64),
        ("", 64),
    ],
)
def test_vector_registers_of_processors(monkeypatch, features, bits):
    monkeypatch.setattr(machine, "target", lambda: ("triple", "processor", features))
    found = machine.vector_registers()
    assert found.state.startswith(f"{bits} bits")
    assert ("this processor has no fused multiply-add" in found.trouble) == (bits == 64)


def test_a_finding_as_text():
    assert list(Finding("disk", "full").lines()) == ["disk                full"]
    wrong = list(Finding("disk", "full", "free some space").lines())
    assert wrong[1] == f"{'':20}WRONG: free some space"


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_the_compiler_is_tried(monkeypatch, tmp_path):
    found = machine.compiler(tmp_path)
    assert (found.trouble, list(tmp_path.iterdir())) == ("", [])
    assert found.state.endswith("compiled a kernel, stored it, and loaded it again")
    genuine = machine.kernel
    for kernel, words in (
        (lambda function, place: _jit.Deferred(function), "stored machine code is not"),
        (lambda function, place: genuine(lambda x: x, place), "a quarter of 1 is computed as"),
        (lambda function, place: _jit.Deferred(None), "a kernel cannot be compiled: "),
    ):
        monkeypatch.setattr(machine, "kernel", kernel)
        assert machine.compiler(tmp_path).trouble.startswith(words)
        assert "were tried" in machine.compiler(tmp_path).trouble


def test_machine_code_that_this_numba_cannot_keep(monkeypatch):
    monkeypatch.setattr(machine, "HAS_CACHE", False)
    assert machine.kernel_cache(None) == Finding(
        "kernel cache", "none, as the compiler lacks a part"
    )
    monkeypatch.setattr(machine, "HAS_CACHE", False)
    with pytest.raises(OutputError, match="vibrosweep doctor says why"):
        machine.warm_up()


# After warming up, runs and `verify` compile no kernel, and all machine code is on disk.

NEEDS_CODE = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="needs machine code")
SWEEPS = [
    "[scene]\nlaunch = [0.0, 0.3]\n[sample]\nrealizations = 3\nfrequency = [1.0, 2.0]",
    "[scene]\nparticles = 3\nrebound = 'reflect'\n[measure]\nseparation = true\nregimes = true\n"
    "per_particle = true\ntrust = true\n[record]\nduration = 3.0",
    "[sample]\ndesign = 'grid'\namplitude = [0.5, 1.0]\n[measure]\ntransient = 2.0\ntrust = true",
    "[scene]\nlaunch = [-1.0, 0.3]\n[sample]\ndesign = 'latin'\nrealizations = 2\ngravity = [9, 10]"
    "\n[measure]\nseparation = true\n[record]\ngravity = 9.81\nrebound = 'reflect'",
    "[sample]\ndesign = 'table.csv'\n[measure]\nregimes = true\ntransient = 1.0",
    "[scene]\nlaunch = [0.0, 1.0]\nduration = 300.0\n[sample]\ndesign = 'table.csv'",
    "[scene]\nparticles = 3\nbase = 'moving'\n[measure]\nseparation = true\nlyapunov = true\n"
    "trust = true\n[record]\nduration = 3.0",
    "[scene]\nparticles = 2\nbase = 'moving'\nbase_acceleration = 2.0\n[measure]\ntransient = 2.0",
    "[scene]\nparticles = 2\nbase = 'sprung'\nmass_ratio = 0.01\nmount_frequency = 0.5\n"
    "duration = 4.0\n[measure]\njoint = true\nseparation = true\n[record]\nduration = 3.0",
]


# kernels of `windows` alone, and one that no command calls
COLD = {"conditions", "end_errors", "orbits_hold", "draw"}


def signatures():
    counts = Counter()
    for kernel in kernels():
        counts[kernel.__name__] += len(kernel.dispatcher.signatures)
    return counts


@pytest.fixture(params=[("rest",), pytest.param(LAWS, marks=pytest.mark.weekly)], ids=str)
def laws(request, monkeypatch):
    monkeypatch.setattr(machine, "LAWS", request.param)
    return request.param


@NEEDS_CODE
def test_no_command_compiles_after_warming_up(laws, compute, tmp_path, capsys):
    assert main(["warmup"]) == 0
    assert "found on disk, in " in capsys.readouterr().out
    warm = signatures()
    assert len(warm) > 20
    assert {name for name, count in warm.items() if not count} <= COLD
    (tmp_path / "table.csv").write_text("restitution,amplitude\n0.9,1.2\n0.8,1.1\n")
    simulate(restitution=0.8, launch_time=[0.0, 0.1], duration=2.0)
    simulate(amplitude=[0.8, 1.0], duration=2.0, rebound=laws[-1])
    for text in SWEEPS:
        result = compute(text.replace("reflect", laws[-1]))
        assert main(["verify", str(result), "--sample", "1"]) == 0
    assert signatures() == warm


@NEEDS_CODE
@pytest.mark.usefixtures("laws")
def test_all_machine_code_is_on_disk_afterwards():
    warm_up()
    done = warm_up()
    assert done.made + done.kept == signatures().total()
    assert done.directory == _jit.cache_directory


@NEEDS_CODE
def test_warming_up_without_a_cache_directory_is_refused(monkeypatch):
    monkeypatch.setattr(machine, "cache_directory", None)
    with pytest.raises(OutputError, match="NUMBA_CACHE_DIR"):
        warm_up()
