"""Points left out of a picture cover the same pixels as others that are drawn."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from vibrosweep.explorer.pictures import Axis, visible_rows

COUNTS = st.integers(0, 60)
SEEDS = st.integers(0, 2**32 - 1)
X, Y = Axis(1.0, 3.0, 20), Axis(1e-3, 1.0, 10, log=True)


@settings(max_examples=60, deadline=None)
@given(COUNTS, SEEDS)
def test_the_last_of_the_dots_in_a_pixel_is_kept(count, seed):
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(1.0, 3.0, count), 10.0 ** rng.uniform(-3.0, 0.0, count)
    last = {}
    for i in range(count):  # by the definition of a pixel
        last[int((x[i] - 1.0) * 10.0), int((np.log10(y[i]) + 3.0) / 0.3)] = i
    assert visible_rows([x], y, X, Y).tolist() == sorted(last.values())


@settings(max_examples=60, deadline=None)
@given(COUNTS, SEEDS)
def test_the_last_of_the_lines_in_the_same_pixels_is_kept(count, seed):
    rng = np.random.default_rng(seed)
    start, length, up = rng.uniform(-1.0, 5.0, count), rng.uniform(0.0, 3.0, count), np.ones(count)
    shown = visible_rows([start, start + length], up, X, Axis(0.0, 2.0, 10))
    reaches = (start + length > 1.0) & (start < 3.0)
    for i in np.flatnonzero(reaches):
        like = shown[shown >= i]
        near = np.abs(start[like] - start[i]) + np.abs(length[like] - length[i])
        assert near.min() <= 0.3  # three pixels of 0.1: one for each end, one for their difference
    assert set(shown) <= set(np.flatnonzero((start + length > 0.0) & (start < 4.0)))


def test_values_without_a_logarithm_are_left_out():
    gaps = np.array([0.0, 0.1, np.nan, -1.0])
    assert visible_rows([np.full(4, 2.0)], gaps, X, Y).tolist() == [1]
