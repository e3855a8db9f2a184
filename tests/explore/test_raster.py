"""Points gathered in pixels, compared with plain loops."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibrosweep.explorer.pictures import View, evenly, nearest, raster, spread_out

VIEW = View((0.2, 0.9), (0.1, 0.7), 5, 4)


def pixels(x, y):
    """Point numbers in each pixel of the view."""
    found = {}
    for i, (a, b) in enumerate(zip(x, y, strict=True)):
        column = int(np.floor((a - 0.2) / 0.7 * 5))
        row = int(np.floor((b - 0.1) / 0.6 * 4))
        if 0 <= column < 5 and 0 <= row < 4:
            found.setdefault((row, column), []).append(i)
    return found


@pytest.fixture
def scattered():
    rng = np.random.default_rng(3)
    return rng.random(60), rng.random(60), rng.random(60)


def test_a_pixel_holds_the_mean_of_its_finite_numbers(scattered):
    x, y, values = scattered
    values[::7] = np.nan
    values[3] = -np.inf
    found = raster(x, y, values, VIEW)
    assert (found.x, found.y) == (VIEW.x, VIEW.y)
    there = pixels(x, y)
    for place, value in np.ndenumerate(found.values):
        inside = values[there.get(place, [])]
        known = inside[np.isfinite(inside)]
        if known.size:
            assert value == pytest.approx(known.mean(), rel=1e-14)
        else:
            assert np.isneginf(value) if np.isneginf(inside).any() else np.isnan(value)


def test_a_pixel_holds_its_commonest_code(scattered):
    x, y, values = scattered
    codes = np.round(2.0 * values)
    found = raster(x, y, codes, VIEW, np.arange(3.0))
    there = pixels(x, y)
    for place, value in np.ndenumerate(found.values):
        inside = codes[there.get(place, [])].tolist()
        if inside:
            assert inside.count(value) == max(map(inside.count, inside))
        else:
            assert np.isnan(value)


def test_each_point_of_a_grid_has_a_cell():
    x, y = (axis.ravel() for axis in np.meshgrid([0.0, 1.0, 2.0], [5.0, 7.0], indexing="ij"))
    found = raster(x, y, np.arange(6.0), VIEW)
    assert (found.x, found.y) == ((-0.5, 2.5), (4.0, 8.0))
    assert found.values.tolist() == [[0.0, 2.0, 4.0], [1.0, 3.0, 5.0]]


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1), st.floats(-1, 1))
@settings(max_examples=50)
def test_none_is_nearer_than_the_nearest(places, at):
    x, y = np.array(places).T
    found = nearest(x, y, (at, 0.5), (0.1, 2.0))
    far = np.hypot((x - at) / 0.1, (y - 0.5) / 2.0)
    assert far[found] <= far.min() * (1.0 + 1e-12)


def test_a_sample_spreads_from_coarse_to_fine(scattered):
    x, y, _ = scattered
    order = list(spread_out(x, y))
    assert sorted(order) == sorted(set(order))
    middle = np.argmin(np.hypot((x - x.min()) / np.ptp(x) - 0.5, (y - y.min()) / np.ptp(y) - 0.5))
    assert order[0] == middle
    # the first five points are one for the plane and one for each quarter of it
    quarters = {(x[i] > np.median(x), y[i] > np.median(y)) for i in order[1:5]}
    assert len(quarters) == 4


def test_a_sample_of_many_points_is_even():
    assert evenly(7, 100).tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert evenly(1000, 4).tolist() == [0, 333, 666, 999]
