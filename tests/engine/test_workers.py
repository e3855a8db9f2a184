"""Threads, and the line that says what is compiled."""

import gc
import io
import sys
import threading
import time
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep import waiting
from vibrosweep.engine import workers
from vibrosweep.engine.workers import LARGEST_PIECE, SMALLEST_PIECE, Notice, Workers

# Ranges of work handed to threads.


@given(
    threads=st.integers(1, 4),
    total=st.integers(1, 40_000),
    periods=st.floats(0.0, exclude_min=True),
)
def test_a_stream_hands_out_every_range_once(threads, total, periods):
    calls = []

    def begin():
        own = []
        calls.append(own)
        return lambda first, last: own.append((first, last))

    with Workers(threads) as workers:
        workers.stream(begin, total, periods)
    assert 1 <= len(calls) <= threads
    assert all(own[-1] == (total, total) for own in calls)
    ranges = sorted(one for own in calls for one in own[:-1])
    assert [first for first, _ in ranges] == [0, *(last for _, last in ranges[:-1])]
    assert ranges[-1][1] == total
    assert all(0 < last - first <= LARGEST_PIECE for first, last in ranges)


def test_even_a_little_work_is_shared_among_all_threads():
    # a thread that took both ranges would wait for the other one for ever
    together = threading.Barrier(2, timeout=20.0)

    def begin():
        return lambda first, last: together.wait() if first < last else None

    with Workers(2) as workers:
        workers.stream(begin, 10, 1.0)


def test_few_long_trajectories_are_cut_into_more_ranges_than_many_short_ones():
    def ranges(total, periods):
        starts = []
        with Workers(2) as workers:
            workers.stream(lambda: lambda first, last: starts.append(first), total, periods)
        return len(starts) - 2  # each thread ends with an empty range

    assert ranges(4000, 12.0) == 2
    assert ranges(4000, 1000.0) >= 8


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_results_come_in_order_while_the_next_ones_are_computed(threads):
    taken, released = [], threading.Event()

    def items():
        for k in range(20):
            taken.append(k)
            yield k

    def compute(worker, k):
        assert worker.threads == 1
        if k == 0:
            assert threads == 1 or released.wait(20.0)
        elif k == 1:
            released.set()
        return k * k

    with Workers(threads) as workers:
        for k, found in enumerate(workers.in_order(compute, items())):
            assert found == k * k
            assert len(taken) <= k + 2 * threads  # memory is bounded
    assert len(taken) == 20


def test_work_on_one_thread_ends_with_its_workers():
    """After an interruption no range is begun that nobody waits for."""
    ranges, workers = [], Workers(2)

    def task(first, last):
        ranges.append(first)
        workers.__exit__(KeyboardInterrupt, None, None)

    Workers(1, workers).run(task, 10, 1)
    assert ranges == [0]


def test_threads_take_no_more_work_after_a_failure():
    begun, failed, taken = threading.Event(), threading.Event(), []

    def begin():
        def task(first, last):
            if first == 0:
                assert begun.wait(20.0)
                raise RuntimeError("the first range fails")
            begun.set()
            assert failed.wait(20.0)
            taken.append(first)

        return task

    before = set(threading.enumerate())
    workers = Workers(2)
    with pytest.raises(RuntimeError, match="the first range"):
        workers.stream(begin, 100 * SMALLEST_PIECE, 1e9)
    workers.__exit__(RuntimeError, None, None)  # as on leaving a context with this error
    failed.set()
    for thread in set(threading.enumerate()) - before:
        thread.join()
    assert len(taken) == 1  # the range that the other thread had begun, of a hundred


# The notice of a compilation: on terminals only, and only if it takes long.


class Terminal(io.StringIO):
    def isatty(self):
        return True


def event(function, module="vibrosweep.kernels.advance"):
    named = SimpleNamespace(__name__=function, __module__=module)
    return SimpleNamespace(data={"dispatcher": SimpleNamespace(py_func=named)})


@pytest.fixture
def told(monkeypatch):
    """Announce a kernel and a function inside it to a notice; return the text of the stream."""
    monkeypatch.delenv("TQDM_DISABLE", raising=False)
    monkeypatch.delitem(sys.modules, "ipykernel", raising=False)

    def tell(stream, seconds, module="vibrosweep.kernels.advance"):
        monkeypatch.setattr(sys, "stderr", stream)
        notice = Notice(0.02)
        notice.on_start(event("advance", module))
        notice.on_start(event("fly", module))
        notice.on_end(event("fly", module))
        time.sleep(seconds)
        notice.on_end(event("advance", module))
        return stream.getvalue()

    return tell


def test_a_long_compilation_is_announced_and_the_line_is_removed(told):
    lines = told(Terminal(), 0.2).split("\r")
    assert lines[1].startswith("vibrosweep: compiling advance (first use only")
    assert lines[-2].strip() == lines[-1] == ""
    assert len(lines[-2]) == len(lines[-3])


def test_the_time_of_compiling_is_that_of_whole_kernels_of_this_package():
    """Pieces within a kernel are not counted twice, nor what others compile."""
    notice = Notice()
    for module, taken in (("vibrosweep.kernels.advance", 0.1), ("scipy.stats", 0.0)):
        before = notice.seconds
        notice.on_start(event("advance", module))
        notice.on_start(event("fly", module))
        time.sleep(0.1)
        notice.on_end(event("fly", module))
        notice.on_end(event("advance", module))
        assert (notice.seconds - before >= 0.1) == (taken > 0.0)
        assert taken > 0.0 or notice.seconds == before


def test_loading_is_announced_and_the_line_is_removed(monkeypatch):
    stream = Terminal()
    monkeypatch.delenv("TQDM_DISABLE", raising=False)
    monkeypatch.setattr(sys, "stderr", stream)
    with waiting.WaitingLine("loading", 0.02):
        time.sleep(0.2)
    first, *_, last = stream.getvalue().split("\r")[1:]
    assert first == "vibrosweep: loading: 0 s"
    assert last == ""


def test_files_other_modules_and_fast_compilations_get_no_notice(told, monkeypatch):
    assert told(io.StringIO(), 0.1) == ""
    assert told(Terminal(), 0.1, "elsewhere.module") == ""
    assert told(Terminal(), 0.0) == ""
    monkeypatch.setenv("TQDM_DISABLE", "1")
    assert told(Terminal(), 0.1) == ""


@pytest.mark.parametrize("often", [700, 10**6, 0])
def test_the_garbage_collector_runs_less_often_during_compilation(often):
    before = gc.get_threshold()
    gc.set_threshold(often, 10, 10)
    try:
        notice = Notice()
        notice.on_start(event("advance"))
        notice.on_start(event("fly"))
        notice.on_end(event("fly"))
        meanwhile = gc.get_threshold()
        notice.on_end(event("advance"))
        after = gc.get_threshold()
    finally:
        gc.set_threshold(*before)
    assert meanwhile == (max(often, workers.COLLECT_AFTER) if often else 0, 10, 10)
    assert after == (often, 10, 10)
