"""Median times: of as many runs as fit a small budget, or of runs in turn."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")

BUDGET = 1.0  # s for the repetitions of one point
MOST = 40
# s after which the threads of OpenMP, which wait for more work in a busy loop, have gone to sleep:
# until then they take the cores from whatever is timed next
SETTLE = 0.3


def timed(run: Callable[[], T], threads: int = 1) -> tuple[T, float]:
    """Return the result of a run, and the median time of all runs in s.

    For one thread it is processor time, which other programs disturb little; else wall time.
    A run that is longer than the budget is not repeated.
    """
    clock = time.process_time if threads == 1 else time.perf_counter
    result, first = _once(run, clock)
    seconds = [first]
    while sum(seconds) < BUDGET and len(seconds) < MOST:
        result, another = _once(run, clock)
        seconds.append(another)
    return result, statistics.median(seconds)


def medians(*runs: Callable[[], object], rounds: int = 9) -> list[float]:
    """Median seconds of runs that are timed in turn, after an untimed run of each."""
    for run in runs:
        run()
    seconds = [[_settled(run) for run in runs] for _ in range(rounds)]
    return [statistics.median(column) for column in zip(*seconds, strict=True)]


def _settled(run: Callable[[], object]) -> float:
    """Seconds of a run that begins on an idle machine."""
    time.sleep(SETTLE)
    return _once(run, time.perf_counter)[1]


def _once(run: Callable[[], T], clock: Callable[[], float]) -> tuple[T, float]:
    began = clock()
    result = run()
    return result, clock() - began
