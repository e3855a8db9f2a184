"""Whole commands against their floors; run with ``pytest benchmarks/test_commands.py -s``."""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from vibrosweep.scene import dimensionless, launches
from vibrosweep.sweep import run
from vibrosweep.sweep.design import open_design
from vibrosweep.sweep.following import statistics as trajectory_statistics
from vibrosweep.sweep.spec import read_spec
from vibrosweep.sweep.workers import Workers

SWEEPS = Path(__file__).parents[1] / "sweeps"
VIBROSWEEP = [sys.executable, "-c", "import sys; from vibrosweep.cli import main; sys.exit(main())"]
IMPORTS = [sys.executable, "-c", "import numba, h5py, h5netcdf"]
THREADS = 2


def seconds(command, **options):
    began = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, **options)
    return time.perf_counter() - began


def median(function, rounds):
    return statistics.median(function() for _ in range(rounds))


def test_warm_start_against_importing_numba_and_hdf5(race, tmp_path):
    command = [*VIBROSWEEP, "run", str(SWEEPS / "paper.toml"), "-o", str(tmp_path / "p.h5")]
    ratio = race(lambda: seconds([*command, "--force"]), lambda: seconds(IMPORTS))
    assert ratio >= 0.5


def test_help_answers_at_once():
    took = median(lambda: seconds([*VIBROSWEEP, "--help"]), 5)
    print(f"\n--help: {took:.3f} s")
    assert took <= 0.3


def test_cold_start(tmp_path):
    """First use ever: every kernel is compiled."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    command = [*VIBROSWEEP, "run", str(SWEEPS / "paper.toml"), "-o", str(tmp_path / "p.h5")]
    took = seconds(command, env=environment)
    print(f"\ncold start: {took:.1f} s")
    assert took <= 20.0


@pytest.fixture(scope="module")
def million():
    return read_spec(SWEEPS / "million.toml")


def kernel_alone(spec):
    """The trajectories of the sweep through the streaming kernel, and nothing else."""
    design, observation = open_design(spec), run.observation_of(spec)
    size = run.TRAJECTORIES_PER_CHUNK // spec.particles
    total = 0.0
    with Workers(THREADS) as workers:
        for start in range(0, design.realizations, size):
            stop = min(start + size, design.realizations)
            parameters = run.parameters_of(spec, design.take(start, stop), stop - start)
            problem = dimensionless(parameters, spec.duration, spec.transient)
            launch = launches(spec.launch, spec.particles, parameters["frequency"])
            began = time.perf_counter()
            trajectory_statistics(problem, launch, observation, workers)
            total += time.perf_counter() - began
    return total


def plain_write(path, arrays):
    began = time.perf_counter()
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file.create_dataset(name, data=values)
    return time.perf_counter() - began


def test_million_realizations_against_their_floors(million, tmp_path):
    output = tmp_path / "million.h5"
    command = [*VIBROSWEEP, "run", str(SWEEPS / "million.toml"), "-o", str(output), "--force"]
    command += ["--threads", str(THREADS)]
    whole = median(lambda: seconds(command), 3)
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
    with h5py.File(output) as file:
        arrays = {n: d[...] for n, d in file.items() if d.shape == (million.realizations,)}
        impacts = int(np.sum(arrays["impact_count"]))
    floors = {
        "imports": median(lambda: seconds(IMPORTS), 3),
        "kernel": median(lambda: kernel_alone(million), 3),
        "write": median(lambda: plain_write(tmp_path / "plain.h5", arrays), 3),
    }
    ratio = whole / sum(floors.values())
    parts = ", ".join(f"{name} {value:.2f} s" for name, value in floors.items())
    print(
        f"\nmillion.toml: {impacts} impacts in {whole:.2f} s, {ratio:.2f} times the sum of its "
        f"floors ({parts}); kernel {1e9 * floors['kernel'] / impacts:.2f} ns per impact; "
        f"{memory:.2f} GiB"
    )
    assert ratio <= 2.0
    assert memory < 1.5
