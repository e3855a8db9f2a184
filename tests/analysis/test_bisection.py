"""Edges of codes that are known exactly: every one is bracketed, in either direction."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep.analysis.windows import find_edges, windows_of_row

AXIS = np.linspace(0.0, 1.0, 21)


def between(*ends):
    """Code 1 between the first and the second end, the third and the fourth, and so on."""

    def evaluate(rows, at, states):
        return np.searchsorted(np.array(ends), at, side="right") % 2, states

    return evaluate


@given(st.lists(st.floats(0.01, 0.99), min_size=1, max_size=6, unique=True), st.booleans())
def test_every_edge_between_points_of_different_code_is_bracketed(ends, upward):
    ends = sorted(ends)
    codes, edges = find_edges(between(*ends), 1, AXIS, 1e-10, upward=upward)
    assert codes[0].tolist() == between(*ends)(None, AXIS, None)[0].tolist()
    assert edges.low.size == np.count_nonzero(np.diff(codes[0]))
    for low, high in zip(edges.low, edges.high, strict=True):
        assert 0.0 < high - low <= 1e-10 * high
        assert sum(low < end <= high for end in ends) % 2 == 1
    windows = windows_of_row(codes, edges, 0, {1})
    assert len(windows) == np.count_nonzero(np.diff(np.concatenate([[0], codes[0]])) > 0)


def test_all_windows_of_a_row_are_kept_and_an_end_of_the_scan_is_no_edge():
    codes, edges = find_edges(between(0.21, 0.43, 0.77), 1, AXIS, 1e-12)
    first, second = windows_of_row(codes, edges, 0, {1})
    assert first[:2] == pytest.approx((0.21, 0.43), rel=1e-11)
    assert max(first[2:4]) < 1e-12
    assert (first.below, first.above, second.below, second.above) == (0, 0, 0, None)
    assert second[0] == pytest.approx(0.77, rel=1e-11)
    assert np.isnan(second[1])
    assert np.isnan(second[3])
    outside = windows_of_row(codes, edges, 0, {0})
    assert [w[0] for w in outside] == pytest.approx([np.nan, 0.43], rel=1e-11, nan_ok=True)
    assert np.isnan(outside[0][2])
    (whole,) = windows_of_row(codes, edges, 0, {0, 1})
    assert np.isnan(whole[:4]).all()
    assert whole[4:] == (None, None)


def test_a_middle_code_narrower_than_the_scan_is_found():
    def evaluate(rows, at, states):
        return np.where(at < 0.5123, 0, np.where(at < 0.5124, 2, 1)), states

    codes, edges = find_edges(evaluate, 1, AXIS, 1e-9)
    assert 2 not in codes
    (window,) = windows_of_row(codes, edges, 0, {2})
    assert window[:2] == pytest.approx((0.5123, 0.5124), rel=1e-9)


def test_rows_are_bisected_together():
    calls = []

    def evaluate(rows, at, states):
        calls.append(at.size)
        return (at > 0.1 + 0.08 * rows).astype(np.int64), states

    _, edges = find_edges(evaluate, 10, AXIS, 1e-9)
    assert edges.row.tolist() == list(range(10))
    assert edges.low == pytest.approx(0.1 + 0.08 * np.arange(10), rel=1e-8)
    assert calls[0] == 210
    assert len(calls) < 40


@pytest.mark.parametrize(("upward", "end"), [(True, 0.7), (False, 0.3)])
def test_a_scan_that_goes_on_from_its_states_sees_hysteresis(upward, end):
    # a switch that turns on above 0.7, off below 0.3, and stays as it is between
    def evaluate(rows, at, states):
        on = np.where(at > 0.7, 1.0, np.where(at < 0.3, 0.0, states[:, 0]))
        return on.astype(np.int64), on[:, np.newaxis]

    start = np.array([[0.0 if upward else 1.0]])
    codes, edges = find_edges(evaluate, 1, AXIS, 1e-9, start=start, upward=upward)
    (window,) = windows_of_row(codes, edges, 0, {1})
    assert window[0] == pytest.approx(end, rel=1e-8)
