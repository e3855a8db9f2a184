"""Wall times: the fastest of as many runs as fit a small budget."""

from __future__ import annotations

import time
from collections.abc import Callable

BUDGET = 1.0  # s for the repetitions of one point
MOST = 40


def once(run: Callable[[], object]) -> float:
    began = time.perf_counter()
    run()
    return time.perf_counter() - began


def fastest(run: Callable[[], object]) -> float:
    """Seconds of the fastest run; one that is longer than the budget is not repeated."""
    best = spent = once(run)
    for _ in range(MOST - 1):
        if spent >= BUDGET:
            break
        seconds = once(run)
        best, spent = min(best, seconds), spent + seconds
    return best
