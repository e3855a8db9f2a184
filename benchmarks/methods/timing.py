"""Wall times: the fastest of as many runs as fit a small budget, or medians of runs in turn."""

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


def timed(run: Callable[[], T]) -> tuple[T, float]:
    """Return the result of a run, and the seconds of the fastest one.

    A run that is longer than the budget is not repeated.
    """
    result, best = _once(run)
    spent = best
    for _ in range(MOST - 1):
        if spent >= BUDGET:
            break
        result, seconds = _once(run)
        best, spent = min(best, seconds), spent + seconds
    return result, best


def medians(*runs: Callable[[], object], rounds: int = 9) -> list[float]:
    """Median seconds of runs that are timed in turn, after one run of each that is not."""
    for run in runs:
        run()
    seconds = [[_settled(run) for run in runs] for _ in range(rounds)]
    return [statistics.median(column) for column in zip(*seconds, strict=True)]


def _settled(run: Callable[[], object]) -> float:
    """Seconds of a run that begins on an idle machine."""
    time.sleep(SETTLE)
    return _once(run)[1]


def _once(run: Callable[[], T]) -> tuple[T, float]:
    began = time.perf_counter()
    result = run()
    return result, time.perf_counter() - began
