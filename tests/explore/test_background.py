"""Computations that run while the page stays responsive."""

import threading

import pytest

from vibrosweep.explorer.live import Background


@pytest.fixture
def background():
    made = Background()
    yield made
    made.close()


class Gate:
    """Work that says when it begins, and waits to be let through."""

    def __init__(self):
        self.begun, self.open = threading.Event(), threading.Event()

    def __call__(self):
        self.begun.set()
        assert self.open.wait(10.0)
        return threading.get_ident()


def test_one_task_runs_at_a_time_and_only_the_newest_task_waits(background):
    gate, done = Gate(), []
    first = background.call(gate)
    assert gate.begun.wait(10.0)
    others = [background.call(lambda i=i: done.append(i)) for i in range(5)]
    assert background.busy
    assert done == []
    gate.open.set()
    others[-1].result(10.0)
    assert first.result(10.0) != threading.get_ident()
    assert done == [4]
    assert all(one.cancelled() for one in others[:-1])
    assert not background.busy


def test_two_visitors_do_not_wait_for_each_other(background):
    gate, other = Gate(), Background()
    background.call(gate)
    assert other.call(lambda: 3).result(10.0) == 3
    gate.open.set()
    other.close()


def test_a_waiting_task_is_cancelled_when_its_visitor_leaves(background):
    gate = Gate()
    background.call(gate)
    assert gate.begun.wait(10.0)
    waits = background.call(lambda: 3)
    background.close()
    assert waits.cancelled()
    assert background.busy
    gate.open.set()


def test_an_exception_is_handed_on_and_later_tasks_still_run(background):
    with pytest.raises(ZeroDivisionError):
        background.call(lambda: 1 / 0).result(10.0)
    assert background.call(lambda: 3).result(10.0) == 3
