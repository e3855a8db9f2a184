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

import vibrosweep as vs
from vibrosweep.api.sweeps import as_sweep
from vibrosweep.engine.measure import batch_of, statistics
from vibrosweep.engine.workers import Workers
from vibrosweep.model.parameters import dimensionless, launches
from vibrosweep.runs.chunks import batch_size
from vibrosweep.scene.design import open_design
from vibrosweep.scene.sweep import read_spec

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
    assert ratio >= 1.0 / 1.6


def test_help_against_starting_python(race):
    race(lambda: seconds([*VIBROSWEEP, "--help"]), lambda: seconds([sys.executable, "-c", ""]))
    assert min(seconds([*VIBROSWEEP, "--help"]) for _ in range(3)) <= 0.3


def test_cold_start_against_compiling_something_else(race, tmp_path):
    """The first use ever compiles every kernel; compiling a small function sets the scale."""
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
        parameters = spec.scene.parameters(design.take(start, stop), stop - start)
        yield (
            dimensionless(parameters, spec.scene.duration, spec.scene.measures.transient),
            launches(spec.scene.launch, spec.scene.particles, parameters["frequency"]),
        )


def iterations(spec, workers):
    """The kernel alone, over all batches."""
    scene, parts = spec.scene, list(batches(spec))

    def iterate():
        for problem, launch in parts:
            statistics(batch_of(problem, launch, scene), scene, workers)

    return iterate


def test_run_against_the_kernel_alone(race, benchmark, tmp_path):
    """Planning, drawing, writing, sealing and opening take at most a quarter more and 60 ms."""
    ranges = {"restitution": (0.80, 0.98), "amplitude": (0.2, 3.5)}
    sweep = ranges | {"realizations": 100_000, "particles": 20, "duration": 12.0}

    def run():
        vs.run(sweep, tmp_path / "out.h5", threads=THREADS, force=True).close()

    with Workers(THREADS) as workers:
        race(run, iterations(as_sweep(sweep, {}), workers))
    whole, kernel = (benchmark.extra_info[name] for name in ("subject_ns", "reference_ns"))
    assert whole <= 1.25 * kernel + 60e6


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
        own = {n: d for n, d in file.items() if isinstance(d, h5py.Dataset)}
        arrays = {n: d[...] for n, d in own.items() if d.shape == (million.design.realizations,)}
    with Workers(THREADS) as workers:
        iterate = iterations(million, workers)

        def floors():
            seconds(IMPORTS)
            iterate()
            plain_write(tmp_path / "plain.h5", arrays)

        ratio = race(lambda: seconds(command), floors, rounds=3, warm_up=False)
    assert ratio >= 0.5
    assert memory < 1.5
