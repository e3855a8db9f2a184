"""Whole commands against their floors; run with ``pytest benchmarks/test_commands.py -s``."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import h5py
import pytest

from vibrosweep.engine.trajectories import statistics
from vibrosweep.engine.workers import Workers
from vibrosweep.model.parameters import dimensionless, launches
from vibrosweep.runs import driver as run
from vibrosweep.runs.chunks import batch_size
from vibrosweep.spec.design import open_design
from vibrosweep.spec.sweep import read_spec

SWEEPS = Path(__file__).parents[1] / "sweeps"
VIBROSWEEP = [sys.executable, "-c", "import sys; from vibrosweep.cli import main; sys.exit(main())"]
IMPORTS = [sys.executable, "-c", "import numba, h5py, h5netcdf"]
COMPILES = [
    sys.executable,
    "-c",
    "import numba, numpy; numba.njit(lambda v: numpy.median(v) + numpy.sort(v)[0])(numpy.ones(9))",
]
THREADS = 2


def seconds(command, **options):
    began = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, **options)
    return time.perf_counter() - began


def test_warm_start_against_importing_numba_and_hdf5(race, tmp_path):
    command = [*VIBROSWEEP, "run", str(SWEEPS / "paper.toml"), "-o", str(tmp_path / "p.h5")]
    ratio = race(lambda: seconds([*command, "--force"]), lambda: seconds(IMPORTS))
    # 0.56 on a quiet machine: a third of the rest is numba's, which prepares its types before it
    # loads a kernel, and another one declaring forty variables, in the libraries
    assert ratio >= 0.5


def test_help_against_starting_python(race):
    race(lambda: seconds([*VIBROSWEEP, "--help"]), lambda: seconds([sys.executable, "-c", ""]))
    assert min(seconds([*VIBROSWEEP, "--help"]) for _ in range(3)) <= 0.3


def test_cold_start_against_compiling_something_else(race, tmp_path):
    """First use ever, every kernel is compiled; numba itself sets the scale."""
    command = [*VIBROSWEEP, "run", str(SWEEPS / "paper.toml"), "-o", str(tmp_path / "p.h5")]
    took = []

    def cold():
        with tempfile.TemporaryDirectory(dir=tmp_path) as cache:
            environment = {**os.environ, "NUMBA_CACHE_DIR": cache}
            took.append(seconds([*command, "--force"], env=environment))

    race(cold, lambda: seconds(COMPILES), rounds=3, warm_up=False)
    assert min(took) <= 15.0


@pytest.fixture(scope="module")
def million():
    return read_spec(SWEEPS / "million.toml")


def batches(spec):
    """The sweep as the kernel takes it, cut as `vibrosweep run` cuts it."""
    design = open_design(spec)
    size = batch_size(spec)
    for start in range(0, design.realizations, size):
        stop = min(start + size, design.realizations)
        parameters = run.parameters_of(spec, design.take(start, stop), stop - start)
        yield (
            dimensionless(parameters, spec.duration, spec.measures.transient),
            launches(spec.launch, spec.particles, parameters["frequency"]),
        )


def plain_write(path, arrays):
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file.create_dataset(name, data=values)


def test_million_realizations_against_their_floors(race, million, tmp_path):
    """The whole command against importing, iterating and writing alone, one after the other."""
    output = tmp_path / "million.h5"
    command = [*VIBROSWEEP, "run", str(SWEEPS / "million.toml"), "-o", str(output), "--force"]
    command += ["--threads", str(THREADS)]
    seconds(command)
    memory = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20
    with h5py.File(output) as file:
        arrays = {n: d[...] for n, d in file.items() if d.shape == (million.realizations,)}
    observation, parts = run.observation_of(million), list(batches(million))
    with Workers(THREADS) as workers:

        def floors():
            seconds(IMPORTS)
            for problem, launch in parts:
                statistics(problem, launch, observation, workers)
            plain_write(tmp_path / "plain.h5", arrays)

        ratio = race(lambda: seconds(command), floors, rounds=3, warm_up=False)
    assert ratio >= 0.5
    assert memory < 1.5
