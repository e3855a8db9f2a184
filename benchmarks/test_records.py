"""Records of every landing, compared with streaming and with writing as much memory."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit

from test_commands import iterations
from vibrosweep.api.sweeps import as_sweep
from vibrosweep.engine.landings import Form, record_landings
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels.memory import LANES
from vibrosweep.scene.design import open_design

SIZE = 200
SWEEP = {
    "restitution": (0.80, 0.98),
    "realizations": SIZE,
    "particles": 20,
    "duration": 250.0,
}
FORCINGS: dict[str, dict[str, Any]] = {
    "map": {"amplitude": (0.2, 3.5)},
    "moving": {"base": "moving", "base_acceleration": (0.2, 2.0)},
}


@njit(nogil=True)
def scatter(first, count, times, offs, speeds, rested):
    """Write a number for each landing into every array, in the order in which lanes land."""
    for block in range(0, count.size, LANES):
        end = min(block + LANES, count.size)
        for n in range(count[block:end].max()):
            for t in range(block, end):
                if n < count[t]:
                    k = first[t] + n
                    times[k] = offs[k] = speeds[k] = n
                    rested[k] = 0


@pytest.mark.parametrize("base", FORCINGS)
def test_a_ragged_record_against_streaming_and_writing(race, base):
    """Race a record against three streaming runs and the writing of its numbers."""
    sweep = as_sweep({**SWEEP, **FORCINGS[base]}, {})
    scene = sweep.scene.recorded()
    parameters = scene.parameters(open_design(sweep).take(0, SIZE), SIZE)
    with Workers(1) as workers:
        stream = iterations(sweep, workers)

        def record():
            return record_landings(parameters, scene, workers, Form(ragged=True))

        count = record()["impact_count"].ravel()
        first = np.cumsum(count) - count

        def write():
            numbers = (np.empty(count.sum()) for _ in range(3))
            scatter(first, count, *numbers, np.empty(count.sum(), np.int8))

        def floors():
            for _ in range(3):
                stream()
            write()

        landings = float(count.sum())
        race(record, floors, work_subject=landings, work_reference=landings)
