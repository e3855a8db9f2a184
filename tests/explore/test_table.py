"""Chosen points as a design: computed again they give the same bits."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.path import Path as Polygon

import vibrosweep as vs
from vibrosweep.explorer.words import TABLE, in_polygon, in_rectangle, table


def test_a_table_is_a_design_that_gives_the_same_numbers(points, results, tmp_path):
    rows = np.array([3, 4, 17, 29])
    path = tmp_path / TABLE
    path.write_text(table(points, rows), encoding="utf-8")
    again = vs.sweep(
        design=str(path), separation=True, progress=False, **points.base_choice.sweep_keywords()
    )
    chosen = results["high-bounce"].isel(realization=rows)
    for name in ("restitution", "amplitude", "impact_count", "dt_min", "rebound_height_max"):
        assert again[name].values.tobytes() == chosen[name].values.tobytes()


def test_points_of_one_realization_make_one_row(points):
    assert table(points, np.array([5, 5, 5])).count("\n") == 2


corners = st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=3, max_size=8)


@given(corners)
@settings(max_examples=50)
def test_points_in_a_polygon_are_those_that_matplotlib_finds(places):
    x, y = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.1, 1.1, 13), (0.11, 0.52, 0.93)))
    x = x + 1e-3 * np.sqrt(2.0)  # off the corners
    across, up = np.array(places).T
    found = in_polygon(x, y, across, up)
    # matplotlib uses the even-odd rule, too
    closed = Polygon([*places, places[0]])
    near = closed.contains_points(np.column_stack([x, y]), radius=1e-9)
    far = closed.contains_points(np.column_stack([x, y]), radius=-1e-9)
    sure = near == far
    inside = np.isin(np.arange(x.size), found)
    assert np.array_equal(inside[sure], near[sure])


def test_points_in_a_rectangle():
    x, y = np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 5.0])
    assert in_rectangle(x, y, 0.5, 2.5, 0.0, 2.0).tolist() == [1]
