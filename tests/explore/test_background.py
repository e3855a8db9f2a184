"""What is computed while the page goes on."""

import threading

import pytest

import vibrosweep as vs
from vibrosweep.errors import ParameterError
from vibrosweep.explore.background import Background


@pytest.fixture
def background():
    return Background()


def test_work_is_done_in_turn_in_another_thread(background):
    done, gate = [], threading.Event()
    first = background.call(lambda: (gate.wait(10.0), done.append(1), threading.get_ident()))
    second = background.call(lambda: done.append(2))
    assert background.busy
    gate.set()
    second.result(10.0)
    assert first.result()[2] != threading.get_ident()
    assert done == [1, 2]
    assert not background.busy


def test_a_mistake_is_handed_on_and_ends_nothing(background):
    with pytest.raises(ZeroDivisionError):
        background.call(lambda: 1 / 0).result(10.0)
    assert background.call(lambda: 3).result(10.0) == 3


def test_kernels_are_prepared_once_for_each_base(background, points):
    choice = points.choice(4)
    prepared = background.prepare(choice)
    assert prepared.result(100.0).identical(choice.simulate())
    assert background.prepare(choice.with_inputs(amplitude=2.0)) is prepared
    assert background.prepare(choice.over("moving")) is not prepared


def test_more_than_gravity_needs_other_kernels_over_a_moving_base(points):
    choice = points.choice(4).over("moving")
    variants = {
        gamma: choice.with_inputs(amplitude=(1.0 + choice.inputs["restitution"]) * gamma * 1.5613)
        for gamma in (0.9, 0.99, 1.01, 2.0)
    }
    assert [variants[gamma].variant[2] for gamma in variants] == [False, False, True, True]
    record = vs.simulate(**variants[1.01].keywords())
    assert float(record.base_acceleration) == pytest.approx(1.01, rel=1e-4)


def test_what_cannot_be_computed_is_tried_again(background, points):
    choice = points.choice(4)
    failed = background.prepare(choice.with_inputs(gravity=-1.0))
    assert isinstance(failed.exception(10.0), ParameterError)
    assert background.prepare(choice).result(100.0).identical(choice.simulate())
