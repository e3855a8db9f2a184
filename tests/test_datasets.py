"""Datasets as users of xarray handle them: every function gives the result of the plain dataset."""

import inspect
from contextlib import suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot

import vibrosweep as vs
from tests.cases import each_of
from tests.scenes import KINDS_OF_NOISE, TWO_TONES
from tests.test_package import ABSURD
from vibrosweep import analysis, figures
from vibrosweep.errors import DataError, VibrosweepError
from vibrosweep.model.measures import UNDETERMINED
from vibrosweep.store.arranged import arranged

LAUNCHES = {"launch_time": [0.0, 0.125, 0.3]}


def _record():
    return vs.simulate(restitution=[0.8, 0.9, 0.85], amplitude=[1.2, 2.0, 4.0], **LAUNCHES)


def _sweep(**scene):
    asked = {"restitution": (0.8, 0.95), "amplitude": (1.0, 9.0), "realizations": 40, "seed": 2}
    return vs.sweep(
        **asked | scene, particles=3, duration=60.0, separation=True, per_particle=True,
        regimes=True,
    )  # fmt: skip


def _grid():
    axes = {"restitution": [0.8, 0.9, 0.95], "amplitude": [1.0, 2.0, 4.0, 7.0]}
    return _sweep(**axes, realizations=None, seed=None, design="grid")


MAKERS = {
    "record": _record,
    "sweep": _sweep,
    "grid": _grid,
    "windows": lambda: vs.windows(restitution=[0.8, 0.9], amplitude=[0.1, 1.0, 2.0, 4.0]),
    "basins": lambda: vs.basins(launch_velocity=[3.0, 4.0, 5.0], particles=20, duration=2000.0),
    "shares": lambda: vs.basins(amplitude=[0.6, 1.2], launch_velocity=[3.0, 5.0], duration=2000.0),
    "diagram": lambda: vs.bifurcation(amplitude=[0.6, 0.7, 0.8], samples=4, duration_periods=2000),
    "orbits": lambda: vs.orbits(amplitude=1.2, impacts=2, periods=2),
    "plane": lambda: vs.orbits(amplitude=[1.2, 1.3], restitution=[0.8, 0.9], impacts=2, periods=2),
    "branches": lambda: vs.branches(restitution=0.9, amplitude=[2.4525, 3.4335]),
    "boundaries": lambda: vs.boundaries(restitution=[0.8, 0.9], amplitude=[0.5, 4.0]),
    "indices": lambda: vs.sobol(restitution=(0.8, 0.98), amplitude=(0.2, 3.5), realizations=64),
}


@cache
def made(kind):
    """Return a dataset of a kind, computed once."""
    return MAKERS[kind]().load()


def _judged(sweep):
    low = analysis.Condition("low", lambda ds: ds["dt_min"] < 0.01, ("dt_min",))
    return low.judge(analysis.flat(sweep))


OF_RECORDS = {
    "landing_phases": analysis.landing_phases,
    "landing_separations": analysis.landing_separations,
    "order_against_chance": analysis.order_against_chance,
    "positions": lambda record: vs.positions(record, [0.5, 1.0, 7.0]),
    "return_map": analysis.return_map,
}
OF_SWEEPS = {
    "compare_separations": lambda sweep: analysis.compare_separations([sweep, sweep]),
    "flat": analysis.flat,
    "judge": _judged,
    "separation_against": lambda sweep: analysis.separation_against(sweep, "restitution", bins=2),
    "separation_distribution": analysis.separation_distribution,
    "separations": vs.separations,
    "separations_against_chance": analysis.separations_against_chance,
    "share_against": lambda sweep: analysis.share_against(sweep, "restitution", of="locked"),
    "simulate": vs.simulate,
}
OF_OTHERS = {"capacity": (analysis.capacity, "basins")}
DRAWN = {
    "basin_shares": ("shares",),
    "basins_of_attraction": ("basins",),
    "bifurcation_diagram": ("diagram",),
    "height_against_restitution": ("sweep", "grid"),
    "height_time": ("record",),
    "orbit_boundaries": ("boundaries",),
    "orbit_branches": ("branches",),
    "parameter_plane": ("sweep", "grid"),
    "periodic_orbits": ("orbits", "plane"),
    "return_map": ("record",),
    "sobol_bars": ("indices",),
    "stability_windows": ("windows",),
}
# These draw the results of analyses
DERIVED = {
    "separation_distributions",
    "separations_over_chance",
    "share_curves",
}
# No analysis of results: for a writer of analyses, and for records without padding
APART = {"require", "flat", "Condition"}


def _drawer(name):
    def draw(dataset):
        panels = np.ravel(np.asarray(getattr(figures, name)(dataset), dtype=object))
        figure = panels[0].get_figure(root=True)
        figure.canvas.draw()
        picture = np.asarray(figure.canvas.buffer_rgba()).copy()
        pyplot.close(figure)
        return picture

    return draw


CASES = [
    *((name, function, "record") for name, function in OF_RECORDS.items()),
    *((name, f, kind) for name, f in OF_SWEEPS.items() for kind in ("sweep", "grid")),
    *((name, *case) for name, case in OF_OTHERS.items()),
    *((f"figure {name}", _drawer(name), kind) for name, kinds in DRAWN.items() for kind in kinds),
]
NAMED = [f"{name} of {kind}" for name, _, kind in CASES]


def same(one, other):
    if isinstance(one, xr.Dataset):
        xr.testing.assert_equal(one, other)
    else:
        np.testing.assert_array_equal(one, other)


def transposed(dataset):
    return dataset.transpose(*reversed(list(dataset.dims)))


def masked(dataset):
    """The dataset behind a mask that hides nothing, but turns integers and scalars into arrays."""
    dim = next(iter(dataset["restitution"].dims or dataset.dims))
    return dataset.where(xr.DataArray(np.ones(dataset.sizes[dim], np.bool_), dims=dim))


@cache
def saved_again(kind, change):
    """A dataset of a kind that was changed and saved, computed once."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "again.nc"
        change(made(kind)).to_netcdf(path, engine="h5netcdf")
        return xr.load_dataset(path, engine="h5netcdf")


def test_every_public_function_is_tried():
    assert {*OF_RECORDS, *OF_SWEEPS, *OF_OTHERS} >= {*analysis.__all__} - APART
    takers = {
        name
        for name in figures.__all__
        if callable(getattr(figures, name))
        and "ax" in inspect.signature(getattr(figures, name)).parameters
    }
    assert takers == {*DRAWN} | DERIVED


@pytest.mark.parametrize(("name", "function", "kind"), CASES, ids=NAMED)
def test_transposed_or_masked_and_saved_again(name, function, kind):
    known = function(made(kind))
    same(function(saved_again(kind, transposed)), known)
    if kind not in ("branches", "boundaries", "indices"):
        same(function(saved_again(kind, masked)), known)


# What a function needs besides its dataset
NEEDED = {
    vs.positions: ("record", {"times": [0.5]}),
    analysis.landing_phases: ("record", {}),
    analysis.landing_separations: ("record", {}),
    analysis.order_against_chance: ("record", {}),
    analysis.return_map: ("record", {}),
    analysis.separation_against: ("sweep", {"parameter": "restitution"}),
    analysis.separation_distribution: ("sweep", {}),
    analysis.share_against: ("sweep", {"parameter": "restitution", "of": "locked"}),
    vs.separations: ("sweep", {}),
    figures.bifurcation_diagram: ("diagram", {}),
    figures.height_time: ("record", {}),
    figures.orbit_boundaries: ("boundaries", {}),
    figures.parameter_plane: ("sweep", {}),
    figures.periodic_orbits: ("orbits", {}),
}


@each_of("function", NEEDED)
def test_absurd_values_of_one_argument(function):
    kind, needed = NEEDED[function]
    for name in list(inspect.signature(function).parameters)[1:]:
        for value in ABSURD[1:]:  # all but None, the default of many
            with suppress(VibrosweepError):
                function(made(kind), **{**needed, name: value})
            pyplot.close("all")


@each_of("kind", MAKERS)
def test_a_plain_dataset_stays_as_it_is(kind):
    xr.testing.assert_identical(arranged(made(kind)), made(kind))


@each_of(("name", "function"), OF_RECORDS.items())
def test_one_realization_of_a_record_by_its_number(name, function):
    record = made("record")
    for i in range(3):
        known = function(record.isel(realization=[i]))
        same(function(record.isel(realization=i)), known)


@each_of(("name", "function"), OF_RECORDS.items())
def test_realizations_of_a_record_in_another_order_and_masked(name, function):
    record, order = made("record"), [2, 0, 1]
    known, shuffled = function(record), function(record.isel(realization=order))
    masked = function(record.where(record.restitution < 0.88))
    if "realization" not in known.dims:  # of the realization at position 0
        same(shuffled, function(record.isel(realization=[2])))
        same(masked, known)
        return
    if "dt_min_surrogate_share" in known:  # the random shifts are those of a position
        known, shuffled, masked = (
            found.drop_vars("dt_min_surrogate_share") for found in (known, shuffled, masked)
        )
    if "cycle" in known.dims:  # as many as the longest separation has
        masked = masked.pad(cycle=(0, known.sizes["cycle"] - masked.sizes["cycle"]))
    same(shuffled, known.isel(realization=order))
    same(masked.isel(realization=[0, 2]), known.isel(realization=[0, 2]))
    hidden = masked.isel(realization=1)
    for variable in hidden.data_vars.values():
        if "base_height" not in variable.name and variable.dtype.kind == "f":
            assert variable.isnull().all(), variable.name
        elif variable.dtype.kind == "i":
            assert (variable <= 0).all(), variable.name


@each_of("name", [name for name in OF_SWEEPS if name != "flat"])
def test_masked_realizations_are_left_out(name):
    sweep, function = made("sweep"), OF_SWEEPS[name]
    shown = np.flatnonzero(sweep.amplitude < 6.0)
    masked = function(sweep.where(sweep.amplitude < 6.0))
    known = function(sweep.isel(realization=shown))
    if name == "judge":
        same(masked[shown], known)
        assert (np.delete(masked, shown) == UNDETERMINED).all()
        return
    if masked.sizes.get("realization", 0) == 40:
        assert masked["mode" if "mode" in masked else "dt_min"].size == 40
        masked = masked.isel(realization=shown)
    same(masked, known)


@pytest.mark.parametrize("name", ["separations", "separation_against", "parameter_plane"])
def test_a_masked_grid_is_that_of_the_points_that_are_shown(name):
    grid = made("grid")
    function = OF_SWEEPS.get(name) or figures.parameter_plane
    masked, chosen = grid.where(grid.amplitude < 6.0), grid.sel(amplitude=[1.0, 2.0, 4.0])
    if name == "parameter_plane":
        axes = function(masked)
        drawn = [
            np.ma.masked_invalid(c.get_array())
            for c in axes.collections
            if c.get_array() is not None
        ]
        # separations of 0, the cells behind the mask, and positive separations
        assert [int(one.count()) for one in drawn] == [5, 3, 4]
        pyplot.close(axes.figure)
    else:
        same(function(masked), function(chosen))


def test_realizations_in_another_order():
    sweep, order = made("sweep"), np.random.default_rng(1).permutation(40)
    for name in ("separations", "separation_against"):
        known, found = OF_SWEEPS[name](sweep), OF_SWEEPS[name](sweep.isel(realization=order))
        xr.testing.assert_allclose(found, known, rtol=1e-13)
    chance = analysis.separations_against_chance
    same(chance(sweep.isel(realization=order)), chance(sweep).isel(realization=order))


def joined(*parts):
    return xr.concat(
        parts, "realization", data_vars="all", coords="different", compat="equals", join="override"
    )


def test_sweeps_of_one_scene_are_combined():
    sweep = made("sweep")
    both = joined(sweep.isel(realization=slice(0, 15)), sweep.isel(realization=slice(15, 40)))
    for function in OF_SWEEPS.values():
        same(function(both), function(sweep))


NOISY = dict.fromkeys(KINDS_OF_NOISE, 0.1)
OTHERS = {
    "base": ({}, {"base": "moving"}),
    "seed": (NOISY, {**NOISY, "noise_seed": 4}),
    "law": ({}, {"rebound": "reflect"}),
    "waveform": ({}, {"waveform": TWO_TONES}),
}


@pytest.mark.parametrize(("first", "second"), OTHERS.values(), ids=OTHERS)
def test_sweeps_of_different_scenes_are_not_followed(first, second):
    asked = {"amplitude": (1.0, 4.0), "realizations": 5, "duration": 40.0}
    both = joined(vs.sweep(**asked, **first), vs.sweep(**asked, **second))
    with pytest.raises(DataError, match=r"as after xarray.concat|cannot be combined"):
        vs.simulate(both)


@pytest.mark.parametrize("base", [{"base": "moving"}, {"waveform": TWO_TONES, "base": "moving"}])
@pytest.mark.parametrize("name", ["positions", "return_map"])
def test_records_of_different_bases_are_not_analysed(name, base):
    scene = {"amplitude": 2.0, **LAUNCHES}
    records = [vs.simulate(**scene), vs.simulate(**scene, **base)]
    for parts in (records, records[::-1]):
        both = joined(*aligned(parts))
        with pytest.raises(DataError, match="combined"):
            OF_RECORDS[name](both.isel(realization=[1]))


def aligned(parts):
    longest = max(one.sizes["impact"] for one in parts)
    return [one.pad(impact=(0, longest - one.sizes["impact"])) for one in parts]


@pytest.mark.parametrize("name", ["positions", "return_map"])
def test_records_without_some_landings_are_not_taken_for_whole(name):
    record = made("record")
    for part in (slice(3, None), slice(0, 5), [1, 0, *range(2, record.sizes["impact"])]):
        with pytest.raises(DataError, match=r"every landing|left out"):
            OF_RECORDS[name](record.isel(impact=part))


def test_attributes_that_contradict_are_refused():
    sweep = made("sweep")
    for change in (
        {"waveform": "parabolic"},
        {"restitution_law": "plastic"},
        {"duration_periods": 3.0},
    ):
        with pytest.raises(DataError, match=next(iter(change)).removesuffix("_periods")):
            vs.separations(sweep.assign_attrs(change))
    sweep = sweep.copy()
    del sweep.attrs["base"]  # as combine_attrs = "drop_conflicts" does
    with pytest.raises(DataError, match="base"):
        figures.parameter_plane(sweep)


def test_a_ragged_record_with_rearranged_landings_is_refused():
    ragged = vs.simulate(restitution=[0.8, 0.9], **LAUNCHES, ragged=True)
    for part in ({"trajectory": [1, 0, 2, 3, 4, 5]}, {"realization": 0}, {"landing": slice(0, 9)}):
        with pytest.raises(DataError, match="whole records"):
            vs.rectangle(ragged.isel(part))
