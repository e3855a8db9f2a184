"""After warming up, runs and `verify` compile no kernel, and all machine code is on disk."""

from collections import Counter

import numba
import pytest

from vibrosweep import simulate
from vibrosweep.cli import main
from vibrosweep.doctor import machine
from vibrosweep.doctor.machine import kernels, warm_up
from vibrosweep.errors import OutputError
from vibrosweep.kernels import _jit
from vibrosweep.model.parameters import LAWS

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="needs machine code")

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


@pytest.mark.usefixtures("laws")
def test_all_machine_code_is_on_disk_afterwards():
    warm_up()
    done = warm_up()
    assert done.made + done.kept == signatures().total()
    assert done.directory == _jit.cache_directory


def test_warming_up_without_a_cache_directory_is_refused(monkeypatch):
    monkeypatch.setattr(machine, "cache_directory", None)
    with pytest.raises(OutputError, match="NUMBA_CACHE_DIR"):
        warm_up()
