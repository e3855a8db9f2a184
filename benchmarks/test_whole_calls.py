"""Whole calls, `sweep` and `run`, against a plain loop and against each other."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import vibrosweep as vs
from loops import scalar_trajectories
from vibrosweep.api.sweeps import as_sweep
from vibrosweep.model.parameters import dimensionless, launches
from vibrosweep.scene.design import open_design

THREADS = 2
REALIZATIONS, PARTICLES = 100_000, 20
SWEEP = {
    "restitution": (0.80, 0.98),
    "amplitude": (0.2, 3.5),
    "realizations": REALIZATIONS,
    "particles": PARTICLES,
    "duration": 12.0,
}


def in_memory():
    vs.sweep(**SWEEP, threads=THREADS)


def into_a_file(path):
    return lambda: vs.run(SWEEP, path, threads=THREADS, force=True).close()


def loop():
    """The loop over drawn realizations that a user would write, on as many threads."""
    spec = as_sweep(SWEEP, {})
    parameters = spec.scene.parameters(open_design(spec).take(0, REALIZATIONS), REALIZATIONS)
    problem = dimensionless(parameters, spec.scene.duration, 0.0)
    launch = launches(spec.scene.launch, PARTICLES, parameters["frequency"])
    total = REALIZATIONS * PARTICLES
    out = [np.empty(total) for _ in range(4)]
    starts = range(0, total, total // 16)

    def task(first):
        last = min(first + total // 16, total)
        scalar_trajectories(first, last, problem, launch, 12.0, *out)

    def run():
        with ThreadPoolExecutor(THREADS) as pool:
            list(pool.map(task, starts))

    return run


@pytest.mark.parametrize("call", ["sweep", "run"])
def test_a_whole_call_against_a_scalar_loop(race, tmp_path, call):
    race(in_memory if call == "sweep" else into_a_file(tmp_path / "out.h5"), loop())


def test_a_sweep_in_memory_against_one_into_a_file(race, tmp_path):
    race(in_memory, into_a_file(tmp_path / "out.h5"))
