"""Figures draw on given axes, or on axes of their own, which a notebook shows."""

import os
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot
from matplotlib.axes import Axes

from vibrosweep import figures
from vibrosweep.errors import ParameterError
from vibrosweep.figures import data
from vibrosweep.figures.style import axes_on, for_file, panels_on

INDICES = xr.Dataset(
    {
        f"{order}{end}": (("output", "parameter"), np.full((2, 1), 0.5))
        for order in ("first_order", "total_order")
        for end in ("", "_low", "_high")
    },
    {"output": ["dt_min", "impact_count"], "parameter": ["restitution"]},
)


@pytest.fixture
def drawings(sweep, twenty):
    """Names of functions that draw on one pair of axes, with the dataset of each."""
    return {
        "height_time": twenty,
        "return_map": twenty,
        "parameter_plane": sweep,
        "height_against_restitution": sweep,
    }


def test_given_axes_are_drawn_on_and_returned(drawings):
    before = pyplot.get_fignums()
    figure, panels = pyplot.subplots(2, 2)
    for (name, dataset), axes in zip(drawings.items(), panels.ravel(), strict=True):
        assert getattr(figures, name)(dataset, ax=axes) is axes
        assert axes.has_data()
    assert pyplot.get_fignums() == [*before, figure.number]
    figure.canvas.draw()
    left, right = pyplot.subplots(1, 2)[1]
    assert list(figures.sobol_bars(INDICES, ax=[left, right])) == [left, right]
    assert left.yaxis_inverted()
    assert right.yaxis_inverted()
    assert [text.get_text() for text in left.get_yticklabels()] == ["restitution $e$"]
    assert not any(text.get_visible() for text in right.get_yticklabels())  # the same, beside them


def test_legends_and_labels_have_room_on_the_axes_of_a_user(drawings):
    for layout in (None, "constrained"):
        figure, every = pyplot.subplots(2, 2, figsize=(11.0, 9.0), layout=layout)
        for (name, dataset), axes in zip(drawings.items(), every.ravel(), strict=True):
            getattr(figures, name)(dataset, ax=axes)
        figure.canvas.draw()
        for axes in every.ravel():
            assert axes.get_legend().get_window_extent().y0 >= axes.get_window_extent().y1 - 1.0
        around = [axes.get_tightbbox() for axes in every.ravel()]
        assert [one.count_overlaps(around) for one in around] == [1] * 4  # with itself
        assert all(one.x0 >= 0.0 and one.x1 <= figure.bbox.x1 for one in around)


def test_axes_that_a_user_placed_stay_and_have_the_legend_inside(twenty):
    adjusted = pyplot.figure()
    adjusted.subplots_adjust(left=0.2)
    for axes in (pyplot.figure().add_axes((0.1, 0.1, 0.8, 0.8)), adjusted.subplots()):
        placed = axes.get_position(original=True).bounds
        figures.return_map(twenty, ax=axes)
        legend, around = axes.get_legend().get_window_extent(), axes.get_window_extent()
        assert axes.get_position(original=True).bounds == placed
        assert legend.y1 <= around.y1
        assert legend.x1 <= around.x1


def test_without_axes_pyplot_manages_the_figure(drawings):
    for name, dataset in drawings.items():
        axes = getattr(figures, name)(dataset)
        assert isinstance(axes, Axes)
        assert pyplot.gcf() is axes.figure
    assert figures.sobol_bars(INDICES).shape == (2,)


def test_a_figure_for_a_file_is_unknown_to_pyplot(drawings):
    for name, dataset in drawings.items():
        assert for_file(getattr(figures, name), dataset).axes
    assert len(for_file(figures.sobol_bars, INDICES).axes) == 2
    assert not pyplot.get_fignums()
    with pytest.raises(ZeroDivisionError):
        for_file(lambda: 1 / 0)
    axes_on(None, 1.0, 1.0)
    assert pyplot.get_fignums()


def test_files_are_written_without_pyplot(twenty, tmp_path):
    code = (
        "import sys, xarray; from vibrosweep.figures import save_all\n"
        f"written = save_all(None, xarray.load_dataset({str(tmp_path / 'r.nc')!r}), "
        f"{str(tmp_path / 'drawn')!r})\n"
        "print(len(written), 'matplotlib.pyplot' in sys.modules)"
    )
    returns = twenty.drop_vars("liftoff_time")  # one figure can be drawn of it
    returns.to_netcdf(tmp_path / "r.nc", engine="h5netcdf")
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.split() == ["2", "False"]


def test_the_interactive_mode_of_a_notebook_outlasts_the_style(tmp_path):
    backend = "import matplotlib\nfrom matplotlib.backends.backend_agg import *\n"
    (tmp_path / "of_notebooks.py").write_text(backend + "matplotlib.interactive(True)\n")
    code = (
        "import matplotlib; from vibrosweep.figures import style\n"
        "style.styled(lambda ax=None: style.axes_on(ax, 2.0, 2.0))()\n"
        "print(matplotlib.is_interactive())"
    )
    paths = os.pathsep.join([str(tmp_path), *sys.path])
    chosen = {"MPLBACKEND": "module://of_notebooks", "PYTHONPATH": paths}
    out = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, **chosen},
    )
    assert out.stdout.strip() == "True"


def test_wrong_axes_and_too_few_are_refused(sweep):
    with pytest.raises(ParameterError, match=r"^ax = 3: "):
        figures.parameter_plane(sweep, ax=3)
    with pytest.raises(ParameterError, match="2 axes"):
        figures.sobol_bars(INDICES, ax=pyplot.subplots()[1])


def test_panels_are_in_their_order():
    first, second, third = panels_on(None, 6.0, 4.0, [[0, 0], [1, 2]])
    first.figure.canvas.draw()
    assert first.get_position().y0 > second.get_position().y1
    assert second.get_position().x1 < third.get_position().x0


def test_the_acceleration_of_a_base_is_labelled_once_in_units_of_gravity():
    assert data.label(xr.Dataset(), "base_acceleration") == r"base acceleration $\Gamma$ (g)"
