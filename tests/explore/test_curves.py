"""Closed forms of window ends, drawn over planes of any axes."""

from dataclasses import replace

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.explorer.pictures import window_ends
from vibrosweep.explorer.points import Column


def drawn(points, axes, **columns):
    more = {name: Column(name, np.asarray(values, float)) for name, values in columns.items()}
    return window_ends(replace(points, columns={**points.columns, **more}), axes)


def test_ends_of_windows_over_restitution_and_amplitude(points):
    ends, reason = drawn(points, ("restitution", "amplitude"))
    assert reason == ""
    assert {(end.mode, end.is_upper) for end in ends} >= {(1, False), (1, True)}
    for end in ends:
        closed = vs.theory.amplitude_max if end.is_upper else vs.theory.amplitude_min
        assert np.array_equal(end.y, closed(end.mode, end.x))


def test_axes_may_be_exchanged(points):
    along, _ = drawn(points, ("restitution", "amplitude"))
    across, _ = drawn(points, ("amplitude", "restitution"))
    for one, other in zip(along, across, strict=True):
        assert np.array_equal(one.x, other.y)
        assert np.array_equal(one.y, other.x)


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
def test_ends_against_base_acceleration_are_those_of_the_base(points, base):
    moved = replace(points, base_choice=points.base_choice.over(base))
    gamma = np.linspace(0.01, 2.0, points.count)
    ends, _ = drawn(moved, ("restitution", "base_acceleration"), base_acceleration=gamma)
    assert any(end.is_upper for end in ends)
    for end in ends:
        least = np.pi * end.mode * (1.0 - end.x) / (1.0 + end.x)
        steepest = 2.0 * (1.0 + end.x**2) / (1.0 + end.x) ** 2 if base == "moving" else 1.0
        expected = np.hypot(least, steepest) if end.is_upper else least
        assert np.allclose(end.y, expected, rtol=1e-12, atol=0.0)


def test_the_reason_is_given_where_no_ends_are_drawn(points):
    assert "an axis is the forcing" in drawn(points, ("restitution", "dt_min"))[1]
    frequency = np.linspace(1.0, 2.0, points.count)
    ends, reason = drawn(points, ("restitution", "amplitude"), frequency=frequency)
    assert not ends
    assert "depend on frequency, which differs" in reason
    coupled = replace(points, base_choice=points.base_choice.over("sprung"))
    assert "particles do not act on" in drawn(coupled, ("restitution", "amplitude"))[1]
