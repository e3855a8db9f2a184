"""Every figure is a ratio against a reference that is timed in the same run."""

from __future__ import annotations

import statistics
import time

import pytest


@pytest.fixture
def race(benchmark):
    """Time a subject and a reference in turn; return median time of reference over subject."""

    def run(subject, reference, *, work_subject=1.0, work_reference=1.0, rounds=9):
        subject()
        reference()
        reference_seconds = []

        def time_reference():
            began = time.perf_counter()
            reference()
            reference_seconds.append(time.perf_counter() - began)

        benchmark.pedantic(subject, setup=time_reference, rounds=rounds, iterations=1)
        subject_seconds = benchmark.stats.stats.median
        reference_median = statistics.median(reference_seconds)
        ratio = (reference_median / work_reference) / (subject_seconds / work_subject)
        benchmark.extra_info.update(
            ratio=ratio,
            subject_ns=1e9 * subject_seconds / work_subject,
            reference_ns=1e9 * reference_median / work_reference,
        )
        print(
            f"\n{benchmark.name}: {ratio:.3g} times the speed of the reference "
            f"({1e9 * subject_seconds / work_subject:.3g} against "
            f"{1e9 * reference_median / work_reference:.3g} ns per unit of work)"
        )
        return ratio

    return run
