"""Axes, and the data that figures take."""

from __future__ import annotations

import os
import subprocess
import sys

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot
from matplotlib.axes import Axes
from PIL import Image

from vibrosweep import figures, open_record, open_sweep
from vibrosweep.analysis import separations_against_chance
from vibrosweep.cli import main
from vibrosweep.errors import OutputError, ParameterError
from vibrosweep.explorer.points import _column, _numbers
from vibrosweep.figures import style
from vibrosweep.figures.data import conditions, fixed, format_units, label, quantity, varies
from vibrosweep.figures.registry import FIGURES, available, missing, save_all
from vibrosweep.figures.style import axes_on, for_file, panels_on
from vibrosweep.model.measures import OF_REALIZATIONS

# Figures draw on given axes, or on axes of their own, which a notebook shows.

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
    for axes in left, right:
        assert axes.yaxis_inverted()
        assert [text.get_text() for text in axes.get_yticklabels()] == ["restitution $e$"]


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
    twenty.to_netcdf(tmp_path / "r.nc", engine="h5netcdf")
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.split() == ["6", "False"]


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


@pytest.mark.parametrize(
    ("units", "drawn"),
    [("m s-1", " (m s$^{-1}$)"), ("m s-2", " (m s$^{-2}$)"), ("Hz", " (Hz)"), ("1", ""), ("", "")],
)
def test_exponents_of_units_are_raised(units, drawn):
    assert format_units(units) == drawn


def test_labels_come_from_the_dataset_and_long_ones_are_wrapped():
    words = "smallest time between two landings of different particles"
    dataset = xr.Dataset({"dt_min": ((), 1.0, {"long_name": words, "units": "s"}), "other": 2.0})
    drawn = label(dataset, "dt_min")
    assert drawn.endswith(r"$\Delta t_{\mathrm{min}}$ (s)")
    assert drawn.startswith("smallest time between two\nlandings")
    assert label(dataset, "other") == "other"


def test_a_parameter_given_per_realization_is_fixed_where_all_agree():
    dataset = xr.Dataset(
        coords={
            "amplitude": ("realization", [1.0, 1.0]),
            "restitution": ("realization", [0.8, 0.9]),
            "frequency": 2.0,
        },
        attrs={"rebound": "reflect"},
    )
    assert fixed(dataset, "amplitude") == 1.0
    assert varies(dataset, "restitution")
    assert conditions(dataset) == "$A$ = 1 m s$^{-1}$, $f$ = 2 Hz, reflect law"


def test_a_parameter_that_varies_and_is_no_axis_has_its_range():
    coords = {
        "restitution": ("realization", [0.8, 0.9]),
        "drive_noise": ("realization", [0.05, 0.01]),
    }
    dataset = xr.Dataset(coords=coords | {"amplitude": 1.0, "frequency": [1.0, 2.0]})
    assert conditions(dataset) == r"$A$ = 1 m s$^{-1}$, $\sigma_A$ = 0.01 to 0.05"
    frequency = {"frequency": ("realization", [1.0, 2.0])}
    assert "$f$ = 1 to 2 Hz" in conditions(dataset.drop_vars("frequency").assign_coords(frequency))


def test_the_base_is_named_once_and_the_forcing_as_it_was_given():
    shared = {"amplitude": 1.0, "base_acceleration": 3.0, "frequency": 2.0}
    dataset = xr.Dataset(coords=shared, attrs={"base": "moving", "forcing": "base_acceleration"})
    assert conditions(dataset) == r"$\Gamma$ = 3 g, $f$ = 2 Hz, moving base"
    dataset.attrs["forcing"] = "base_velocity"  # not in this dataset
    assert conditions(dataset) == "$A$ = 1 m s$^{-1}$, $f$ = 2 Hz, moving base"


def test_a_remark_that_fits_no_line_is_broken_after_commas():
    parts = ["$e$ = 0.9", "$A$ = 0.349 m s$^{-1}$", "$f$ = 17 Hz", "moving base"]
    remark = ", ".join(parts)
    for width, lines in ((style.PAGE, 1), (style.COLUMN, 2)):
        with mpl.rc_context(style.RC):
            axes = style.axes_on(None, width, 2.0)
            axes.plot([0.0], [0.0], label="a line")
            style.head(axes, remark)
            axes.figure.draw_without_rendering()
        title = axes.get_legend().get_title()
        assert title.get_text().replace("\n", " ") == remark
        assert title.get_text().count("\n") == lines - 1
        assert title.get_window_extent().x1 < axes.figure.bbox.x1


@pytest.mark.parametrize("name", sorted(OF_REALIZATIONS))
def test_codes_for_no_value_are_left_blank(name):
    variable = OF_REALIZATIONS[name]
    none = np.nan if variable.dtype == "float64" else 0 if variable.cycle else -1
    values = np.array([none, 1.0]).astype(variable.dtype)
    data = {name: ("realization", values, variable.attributes)}
    dataset = xr.Dataset(data | {variable.cycle or name: data[name]})
    drawn, column = quantity(dataset, name), _column(name, _numbers(name, dataset))
    expected = values if variable.flags else [np.nan, 1.0]  # flags are drawn with their names
    np.testing.assert_array_equal(drawn, expected)
    np.testing.assert_array_equal(column.values, expected)
    assert bool(column.codes) == bool(variable.flags)


STEMS = [
    "fig1_height_time",
    "fig2_height_time_all",
    "fig3_height_against_restitution",
    "fig4_return_map",
    "separation_distribution",
    "separation_over_chance",
    "parameter_plane",
]


def test_the_set_is_complete_and_in_order():
    assert [entry.file_stem for entry in FIGURES.values()] == STEMS
    assert all(entry.name == name for name, entry in FIGURES.items())


def test_with_both_datasets_everything_is_available(sweep, twenty):
    assert available(sweep, twenty) == list(FIGURES)
    assert missing(sweep, twenty) == {}


def test_without_a_record_its_section_is_asked_for(sweep):
    assert available(sweep, None) == [
        "height_against_restitution",
        "separation_distribution",
        "separation_over_chance",
        "parameter_plane",
    ]
    assert missing(sweep, None)["return_map"] == (
        "figure return_map needs the record of every landing: "
        "add a [record] section to the sweep file"
    )


def test_without_a_sweep_one_is_asked_for(twenty):
    assert available(None, twenty) == ["height_time", "height_time_all", "return_map"]
    assert "a [sample] section" in missing(None, twenty)["parameter_plane"]


def test_a_fixed_parameter_is_missing_not_an_error(twenty, make_sweep):
    sweep = make_sweep(10, 2, amplitude=1.2)
    assert missing(sweep, twenty) == {
        "parameter_plane": (
            "figure parameter_plane needs realizations that differ in amplitude: sample it, "
            "for example amplitude = [low, high], in the [sample] section of the sweep file"
        )
    }
    fixed = make_sweep(1, 2)
    lacking = missing(fixed, twenty)
    over_chance = lacking.pop("separation_over_chance")
    assert over_chance.endswith("in which no particle rests or is locked, as chance assumes")
    assert set(lacking) == {"height_against_restitution", "parameter_plane"}


def test_separations_against_chance_need_measures_of_each_particle(sweep):
    without = sweep.drop_vars("particle_impact_count")
    assert "separation_over_chance" not in available(without, None)
    assert missing(without, None)["separation_over_chance"] == (
        "figure separation_over_chance needs the variable particle_impact_count: "
        "set per_particle = true in the [measure] section of the sweep file"
    )
    legend = for_file(FIGURES["separation_over_chance"].draw, sweep).axes[0].get_legend()
    known = int(separations_against_chance(sweep)["dt_min_over_chance"].notnull().sum())
    every = sweep.sizes["realization"]
    assert 0 < known < every
    assert legend.get_texts()[0].get_text() == f"this sweep: {known} of {every} realizations"


@pytest.fixture(scope="module")
def written(sweep, twenty, tmp_path_factory):
    """The files of all figures, in a directory that was not there before."""
    return save_all(sweep, twenty, tmp_path_factory.mktemp("some") / "new" / "figures")


def test_every_file_opens(written):
    assert [path.name for path in written] == [
        f"{stem}.{kind}" for stem in STEMS for kind in ("png", "pdf")
    ]
    for path in written:
        if path.suffix == ".png":
            with Image.open(path) as picture:
                picture.load()
                assert picture.format == "PNG"
                assert picture.width >= 3.5 * 200
        else:
            assert path.read_bytes().startswith(b"%PDF")


def test_the_same_data_give_the_same_files(written, sweep, twenty, tmp_path):
    again = save_all(sweep, twenty, tmp_path)
    for one, other in zip(written, again, strict=True):
        assert one.read_bytes() == other.read_bytes(), one.name


def test_without_data_nothing_is_written(tmp_path):
    assert save_all(None, None, tmp_path / "new") == []
    assert list(tmp_path.iterdir()) == []


def test_a_directory_that_cannot_be_made_is_named(sweep, tmp_path):
    occupied = tmp_path / "taken"
    occupied.write_text("a file")
    with pytest.raises(OutputError, match=r"taken: .*choose another"):
        save_all(sweep, None, occupied)


def test_available_figures_are_written_and_a_file_that_cannot_be_is_named(sweep, tmp_path):
    (tmp_path / "parameter_plane.png").mkdir()
    with pytest.raises(OutputError, match=r"parameter_plane\.png: .*another place"):
        save_all(sweep, None, tmp_path)
    assert {path.name for path in tmp_path.glob("*.png")} == {
        "fig3_height_against_restitution.png",
        "separation_distribution.png",
        "separation_over_chance.png",
        "parameter_plane.png",
    }


def test_the_callers_style_is_neither_used_nor_changed(sweep):
    with mpl.rc_context({"font.size": 31.0, "axes.labelsize": 31.0}):
        before = dict(mpl.rcParams)
        figure = for_file(FIGURES["parameter_plane"].draw, sweep)
        assert dict(mpl.rcParams) == before
    assert figure.axes[0].xaxis.label.get_size() == 9.0


def test_importing_is_cheap():
    heavy = "matplotlib.pyplot", "numba", "xarray", "h5py"
    code = f"import sys, vibrosweep.figures; print([m for m in {heavy} if m in sys.modules])"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


@pytest.mark.parametrize("scene", ["duration = 0.1", "launch_velocity = 1e30"])
def test_a_result_without_landings_or_with_huge_heights_has_figures(compute, scene):
    sample = '[sample]\ndesign = "grid"\nrestitution = [0.5, 0.9]\n[measure]\nseparation = true\n'
    path = compute(f"[scene]\nparticles = 3\n{scene}\n{sample}[record]\nrestitution = 0.9\n")
    with open_sweep(path) as sweep, open_record(path) as record:
        names = available(sweep, record)
        assert "height_time" in names
        reason = missing(sweep, record)["separation_distribution"]
        assert "dt_min, which is undefined in every realization" in reason
        for name in names:
            one = FIGURES[name]
            figure = for_file(one.draw, record if one.source == "record" else sweep)
            figure.draw_without_rendering()


def test_the_command_reads_the_measures_of_particles_that_figures_need(compute, tmp_path, capsys):
    sample = '[sample]\ndesign = "grid"\nrestitution = [0.8, 0.9]\n'
    path = compute(
        f"[scene]\nparticles = 2\n{sample}[measure]\nseparation = true\nper_particle = true\n"
    )
    assert main(["figures", str(path), "-o", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "separation_distribution.png" in said
    assert "separation_over_chance needs a realization in which no particle rests" in said
