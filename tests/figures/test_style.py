"""Axes, and the data that figures take."""

from __future__ import annotations

import subprocess
import sys

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from PIL import Image

from tests.cases import each_of
from vibrosweep import open_record, open_sweep
from vibrosweep.analysis import separations_against_chance
from vibrosweep.cli import main
from vibrosweep.errors import OutputError
from vibrosweep.explorer.points import _column, _numbers
from vibrosweep.figures import style
from vibrosweep.figures.data import conditions, fixed, format_units, label, quantity, varies
from vibrosweep.figures.registry import FIGURES, available, left_out, missing, save_all
from vibrosweep.figures.style import for_file
from vibrosweep.model.measures import OF_REALIZATIONS
from vibrosweep.model.measures import VARIABLES as ALL


@each_of(
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
    assert conditions(dataset) == r"$A$ = 1 m s$^{-1}$, drive noise $\sigma_A$ = 0.01 to 0.05"
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


@each_of("name", sorted(OF_REALIZATIONS))
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
    "plane_of_heights",
    "plane_of_regimes",
    "plane_of_exponents",
    "plane_of_slots",
]
PLANES = {name for name in FIGURES if "plane" in name}


def test_the_set_is_complete_and_in_order():
    assert [entry.file_stem for entry in FIGURES.values()] == STEMS
    assert all(entry.name == name for name, entry in FIGURES.items())


@pytest.fixture(scope="module")
def whole(sweep):
    """A sweep with every measure that a figure shows."""
    size, particles = sweep.sizes["realization"], sweep.sizes["particle"]
    random = np.random.default_rng(3)
    numbers = {
        "regime": (("realization", "particle"), random.integers(1, 5, (size, particles))),
        "lyapunov_max": ("realization", random.normal(size=size)),
        "slot_count": ("realization", random.integers(0, 4, size)),
    }
    measured = {n: (*one, ALL[n].attributes) for n, one in numbers.items()}
    return sweep.assign(measured)


def test_with_all_measures_everything_is_available(whole, twenty):
    assert available(whole, twenty) == list(FIGURES)
    assert missing(whole, twenty) == {}
    assert left_out(whole, twenty) == ""


def test_the_commonest_regime_of_the_particles_is_drawn(whole):
    axes = for_file(FIGURES["plane_of_regimes"].draw, whole).axes[0]
    dots = [c for c in axes.collections if len(c.get_offsets())]
    counts = [np.bincount(one, minlength=6).argmax() for one in whole["regime"].values]
    assert sorted(len(c.get_offsets()) for c in dots) == sorted(np.unique_counts(counts)[1])


def test_what_is_left_out_is_one_line(sweep):
    line = left_out(sweep, None)
    assert "\n" not in line
    assert line.startswith("left out: height_time, height_time_all, return_map need the record")
    assert "plane_of_slots needs the variable slot_count: set " in line


def test_without_a_record_its_section_is_asked_for(sweep):
    assert available(sweep, None) == [
        "height_against_restitution",
        "separation_distribution",
        "separation_over_chance",
        "parameter_plane",
        "plane_of_heights",
    ]
    assert missing(sweep, None)["return_map"] == (
        "the record of every landing: add a [record] section to the sweep file"
    )


def test_without_a_sweep_one_is_asked_for(twenty):
    assert available(None, twenty) == ["height_time", "height_time_all", "return_map"]
    assert "a [sample] section" in missing(None, twenty)["parameter_plane"]


def test_a_fixed_parameter_is_missing_not_an_error(twenty, make_sweep):
    sweep = make_sweep(10, 2, amplitude=1.2)
    lacking = missing(sweep, twenty)
    assert set(lacking) == PLANES
    for name in "parameter_plane", "plane_of_heights":
        assert lacking[name] == (
            "realizations that differ in amplitude: sample it, for example "
            "amplitude = [low, high], in the [sample] section of the sweep file"
        )
    fixed = make_sweep(1, 2)
    lacking = missing(fixed, twenty)
    over_chance = lacking.pop("separation_over_chance")
    assert over_chance.endswith("in which no particle rests or is locked, as chance assumes")
    assert set(lacking) == {"height_against_restitution", *PLANES}


def test_separations_against_chance_need_measures_of_each_particle(sweep):
    without = sweep.drop_vars("particle_impact_count")
    assert "separation_over_chance" not in available(without, None)
    assert missing(without, None)["separation_over_chance"] == (
        "the variable particle_impact_count: "
        "set per_particle = true in the [measure] section of the sweep file"
    )
    legend = for_file(FIGURES["separation_over_chance"].draw, sweep).axes[0].get_legend()
    known = int(separations_against_chance(sweep)["dt_min_over_chance"].notnull().sum())
    every = sweep.sizes["realization"]
    assert 0 < known < every
    assert legend.get_texts()[0].get_text() == f"this sweep: {known} of {every} realizations"


@pytest.fixture(scope="module")
def few(whole):
    """A sweep of which few figures are drawn, with lines, strips and dots among them."""
    return whole.drop_vars(["dt_min", "regime", "lyapunov_max", "slot_count"])


@pytest.fixture(scope="module")
def written(few, twenty, tmp_path_factory):
    """The files of the figures, in a directory that was not there before."""
    return save_all(few, twenty, tmp_path_factory.mktemp("some") / "new" / "figures")


def test_every_file_opens(written, few, twenty):
    stems = [FIGURES[name].file_stem for name in available(few, twenty)]
    assert len(stems) == 5
    assert [path.name for path in written] == [f"{s}.{k}" for s in stems for k in ("png", "pdf")]
    for path in written:
        if path.suffix == ".png":
            with Image.open(path) as picture:
                picture.load()
                assert picture.format == "PNG"
                assert picture.width >= 3.5 * 200
        else:
            assert path.read_bytes().startswith(b"%PDF")


def test_the_same_data_give_the_same_files(written, few, twenty, tmp_path):
    again = {path.name: path.read_bytes() for path in save_all(few, twenty, tmp_path)}
    assert again == {path.name: path.read_bytes() for path in written}


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
