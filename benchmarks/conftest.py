"""Races: every figure is a ratio to a reference that is timed in the same run."""

from __future__ import annotations

import resource
import statistics
import time

import pytest


def processor_seconds():
    """Time of all threads of this process and of the processes that it has waited for."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def timed(run, settle):
    """Wall and processor time of a run in s, which begins after a pause of `settle` s."""
    time.sleep(settle)
    wall, processor = time.perf_counter(), processor_seconds()
    run()
    return time.perf_counter() - wall, processor_seconds() - processor


@pytest.fixture
def race(benchmark, record_property):
    """Time a subject and a reference in turn; return how many times as fast the subject is.

    The ratio is the median over pairs of runs, so that a disturbance of the machine that lasts
    longer than a pair affects both.  If one of them leaves threads behind that wait in a busy loop,
    `settle` must be long enough for these to fall asleep.  `regressions.py` compares the ratio with
    the one stored under the test's name.
    """

    def run(
        subject,
        reference,
        *,
        work_subject=1.0,
        work_reference=1.0,
        rounds=9,
        warm_up=True,
        settle=0.0,
    ):
        if warm_up:
            subject()
            reference()
        references, subjects = [], []
        benchmark.pedantic(
            lambda: subjects.append(timed(subject, settle)),
            setup=lambda: references.append(timed(reference, settle)),
            rounds=rounds,
            iterations=1,
        )
        work = work_subject / work_reference
        pairs = list(zip(references, subjects, strict=True))
        ratio = work * statistics.median(r[0] / s[0] for r, s in pairs)
        subject_ns, reference_ns = (
            1e9 * statistics.median(wall for wall, _ in times) / units
            for times, units in ((subjects, work_subject), (references, work_reference))
        )
        processor_ratio = work * statistics.median(r[1] / s[1] for r, s in pairs)
        record_property("processor_ratio", processor_ratio)
        benchmark.extra_info.update(
            ratio=ratio,
            processor_ratio=processor_ratio,
            subject_ns=subject_ns,
            reference_ns=reference_ns,
        )
        print(
            f"\n{benchmark.name}: {ratio:.3g} times the speed of the reference "
            f"({subject_ns:.3g} against {reference_ns:.3g} ns per unit of work)"
        )
        return ratio

    return run
