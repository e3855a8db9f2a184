"""The moving base as a scalar loop: the kernel's search for a landing, with the library's sine."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from methods.compiled import MARGIN
from methods.scenes import Point, Scene, table
from methods.timing import timed
from moving_loops import scalar_moving
from vibrosweep.engine.workers import TRAJECTORIES_PER_TASK, Workers
from vibrosweep.model.parameters import PARAMETERS, Dimensionless, Launches, dimensionless, launches

SCALAR = "scalar loop"


def _given(rows: np.ndarray, duration: float) -> tuple[Dimensionless, Launches]:
    """Rows of `table`, each a realization with one particle."""
    arrays = dict(zip(PARAMETERS, np.ascontiguousarray(rows.T), strict=False))
    start = [launches((t,), 1, arrays["frequency"][:1]) for t in rows[:, -1].tolist()]
    return dimensionless(arrays, duration), Launches(
        np.concatenate([each.whole for each in start]),
        np.concatenate([each.phase for each in start]),
    )


def _room(trajectories: int) -> tuple[np.ndarray, ...]:
    counts = (np.zeros(trajectories, np.int64) for _ in range(2))
    return (*counts, np.zeros(trajectories), np.zeros(trajectories))


def count_moving_landings(rows: np.ndarray, duration: float, reflect: None) -> np.ndarray:
    """Landings of the trajectories of a table; all times are in periods, which last 1 s here."""
    out = _room(len(rows))
    scalar_moving(0, len(rows), *_given(rows, duration), duration, None, out)
    return out[0]


def scalar(scene: Scene, sizes: list[int], threads: int) -> Iterator[Point]:
    """The kernel's search, one flight after the other."""
    sample = table(scene.cases)
    times = np.full((len(sample), max(sizes)), np.nan)
    end = scene.duration + MARGIN
    scalar_moving(0, len(sample), *_given(sample, end), end, times, _room(len(sample)))
    problem, start = _given(scene.table, scene.duration)
    out = _room(scene.lanes)
    task = min(TRAJECTORIES_PER_TASK, -(-scene.lanes // (4 * threads)))
    with Workers(threads) as workers:

        def run() -> None:
            workers.run(
                lambda a, b: scalar_moving(a, b, problem, start, scene.duration, None, out),
                scene.lanes,
                task,
            )

        run()
        _, seconds = timed(run, threads)
    impacts = int(out[0].sum())
    run_of = (threads, scene.lanes, impacts, seconds, list(times))
    yield Point(scene.key, SCALAR, "streaming", *run_of)
