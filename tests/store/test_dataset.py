"""Datasets in files."""

import pickle
import signal
import tempfile
import tomllib
from pathlib import Path

import h5netcdf
import h5py
import netCDF4
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import vibrosweep as vs
from vibrosweep import open_record, open_sweep
from vibrosweep._version import __version__
from vibrosweep.commands.describe import describe
from vibrosweep.errors import DataError, ExistingOutputError, OutputError, ParameterError, RunError
from vibrosweep.model.measures import RECORD, VARIABLES
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.proof.sampling import read_sample
from vibrosweep.store import arranged as rows
from vibrosweep.store import fresh
from vibrosweep.store import writing as module
from vibrosweep.store.arranged import boxes, flat, read_rows, row_count, row_dims
from vibrosweep.store.disk import Disk, FileState, state_of
from vibrosweep.store.reading import SWEEP, load_dataset
from vibrosweep.store.writing import CHUNK_VALUES, creating

# A result is a plain netCDF-4 file: every reader finds the same data, types, axes and words.

ASKED = Measures(separation=True, per_particle=True, trust=True, regimes=True)
MEASURED = {variable.name: variable for variable in ASKED.variables}
EVERYTHING = """
[scene]
particles = 3
duration = 6.0
[sample]
realizations = 10
restitution = [0.8, 0.98]
frequency = [0.8, 2.0]
[measure]
separation = true
per_particle = true
trust = true
regimes = true
[record]
restitution = 0.9
frequency = 1.0
"""


@pytest.fixture
def full(compute):
    return compute(EVERYTHING)


@pytest.mark.parametrize("group", [None, "record"])
def test_both_engines_read_the_same(full, group):
    one = xr.load_dataset(full, group=group, engine="h5netcdf")
    other = xr.load_dataset(full, group=group, engine="netcdf4")
    assert one.identical(other)
    assert xr.load_dataset(full, group=group).identical(one)


def test_the_public_functions_open_the_same(full):
    with open_sweep(full) as sweep, open_record(full) as record:
        assert sweep.identical(xr.load_dataset(full))
        names = {"record_realization": "realization", "record_particle": "particle"}
        raw = xr.load_dataset(full, group="record").rename(names | {"record_impact": "impact"})
        assert record.identical(raw)


def test_a_result_opens_as_a_tree(full):
    """The sweep and its record have different numbers of realizations."""
    with xr.open_datatree(full) as tree:
        assert tree.sizes["realization"] == 10
        assert tree["record"].sizes["record_realization"] == 1
        assert tree["record"].sizes["record_particle"] == 3


def test_every_variable_is_as_registered(full):
    sweep, record = xr.load_dataset(full), open_record(full).load()
    assert {n for n, v in sweep.data_vars.items() if v.dims} == {*MEASURED}
    assert {n for n, v in record.data_vars.items() if v.dims} == set(RECORD)
    for dataset, registry in ((sweep, MEASURED), (record, RECORD)):
        for name, variable in registry.items():
            found = dataset[name]
            assert found.dims == variable.dims
            assert found.dtype == variable.dtype
            assert found.attrs["long_name"] == variable.long_name
            if variable.flags:
                assert "units" not in found.attrs
                values, words = found.attrs["flag_values"], found.attrs["flag_meanings"].split()
                assert np.asarray(values).dtype == variable.dtype
                assert list(zip(np.atleast_1d(values), words, strict=True)) == list(variable.flags)
                assert set(np.unique(found)) <= set(values)
            else:
                assert found.attrs["units"] == variable.units


def test_sampled_parameters_are_coordinates_and_fixed_ones_variables(full):
    sweep, record = xr.load_dataset(full), xr.load_dataset(full, group="record")
    for name, parameter in PARAMETERS.items():
        sampled = name in ("restitution", "frequency")
        assert sweep[name].dims == (("realization",) if sampled else ())
        assert (name in sweep.coords) is sampled
        assert record[name].dims == ()
        assert name not in record.coords
        for dataset in (sweep, record):
            assert dataset[name].dtype == np.float64
            assert dataset[name].attrs.get("units", "1") == parameter.units
            assert dataset[name].attrs["long_name"] == parameter.long_name
    assert sweep["gravity"] == PARAMETERS["gravity"].default
    assert {"duration", "transient"} <= set(sweep.data_vars)
    # staggered launches follow the frequency; where it is sampled there is no common launch time
    assert "launch_time" not in sweep.coords
    np.testing.assert_allclose(record["launch_time"], [0.0, 1 / 3, 2 / 3])


def test_every_axis_has_its_dimension_scale(full):
    def check(name, item):
        if not isinstance(item, h5py.Dataset) or item.is_scale:
            return
        wanted, prefix = (RECORD, "record_") if "record/" in name else (MEASURED, "")
        for axis, dimension in enumerate(item.dims):
            assert len(dimension) == 1, name
            if name.split("/")[-1] in wanted:
                dims = wanted[name.split("/")[-1]].dims
                assert dimension[0].name.split("/")[-1] == prefix + dims[axis]

    with h5py.File(full) as file:
        file.visititems(check)
        assert file["restitution"].dims[0][0] == file["realization"]
        assert file["record/landing_time"].dims[2][0] == file["record/record_impact"]


def test_plain_readers_read_what_is_compressed(full):
    expected = xr.load_dataset(full)
    with h5py.File(full) as plain, netCDF4.Dataset(full) as classic:
        assert plain["impact_count"].compression == "gzip"
        assert plain["dt_min"].compression is None
        for name in expected.data_vars:
            np.testing.assert_array_equal(plain[name][...], expected[name])
            classic[name].set_auto_mask(False)
            np.testing.assert_array_equal(classic[name][...], expected[name])


def test_provenance(paper):
    text = (Path(__file__).parents[2] / "sweeps" / "paper.toml").read_text(encoding="utf-8")
    attributes = xr.load_dataset(paper).attrs
    assert attributes["sweep_file"] == text
    assert attributes["title"] == tomllib.loads(text)["title"]
    assert attributes["seed"] == 1
    assert attributes["design"] == "uniform"
    assert attributes["rebound"] == "rest"
    assert attributes["launch"] == "staggered"
    assert attributes["Conventions"].startswith("CF-1.")
    assert attributes["source"] == f"vibrosweep {__version__}"
    assert attributes["threads"] >= 1
    assert attributes["cpu"]
    for library in ("numpy", "numba", "h5py", "h5netcdf"):
        assert f"{library} " in attributes["libraries"]


def test_coordinates_are_named_for_other_readers(paper):
    with netCDF4.Dataset(paper) as file:
        assert {"restitution", "amplitude"} <= set(file["dt_min"].coordinates.split())
        assert file["dt_min"].dimensions == ("realization",)


def test_text_that_hdf5_cannot_hold_is_kept_nearly(compute):
    seed = 2**63 - 1
    path = compute(f"[sample]\nseed = {seed}\nrealizations = 2\nrestitution = [0.1, 0.2] # ☃")
    attributes = xr.load_dataset(path).attrs
    assert attributes["seed"] == seed
    assert "☃" in attributes["sweep_file"]
    with creating(path) as file:
        file.attributes({"title": "a\0b"})
    with h5py.File(path) as plain:
        assert plain.attrs["title"] == "a\N{REPLACEMENT CHARACTER}b"


def test_a_long_sweep_file_is_kept_whole(compute):
    launches = ", ".join(f"{k / 1024}" for k in range(10_000))
    path = compute(f"[scene]\nduration = 0.5\nlaunch = [{launches}]")
    for engine in ("h5netcdf", "netcdf4"):
        result = xr.load_dataset(path, engine=engine)
        assert tomllib.loads(result.attrs["sweep_file"])["scene"]["launch"] == list(
            np.arange(10_000) / 1024
        )
        assert result.attrs["launch"] == "listed"
        np.testing.assert_array_equal(result["launch_time"], np.arange(10_000) / 1024)


def test_a_record_without_landings(compute):
    path = compute("[scene]\nparticles = 2\nduration = 0.1\n[record]")
    for engine in ("h5netcdf", "netcdf4"):
        record = xr.load_dataset(path, group="record", engine=engine)
        sizes = {name.removeprefix("record_"): size for name, size in record.sizes.items()}
        assert sizes == {"realization": 1, "particle": 2, "impact": 0}
        assert (record["impact_count"] == 0).all()


def test_pieces_of_any_length_fill_a_variable(tmp_path):
    values = np.arange(3 * CHUNK_VALUES, dtype=np.int64)
    with creating(tmp_path / "out.h5") as file:
        file.dimensions({"realization": values.size})
        file.variable(VARIABLES["impact_count"])
        for start in range(0, values.size, 4999):
            file.write("impact_count", start, values[start : start + 4999])
    with h5py.File(tmp_path / "out.h5") as plain:
        np.testing.assert_array_equal(plain["impact_count"][...], values)


@pytest.mark.parametrize("rows", [0, 3])
def test_a_file_in_which_values_are_missing_never_appears(tmp_path, rows):
    """HDF5 would give zeros for them."""

    def write(group):
        with creating(tmp_path / "out.h5") as file:
            inner = file.group("record") if group else file
            inner.dimensions({"realization": 4})
            for name in ("impact_count", "dt_min"):
                inner.variable(VARIABLES[name])
            inner.write("impact_count", 0, np.arange(4))
            inner.write("dt_min", 0, np.ones(rows))

    for group in (False, True):
        with pytest.raises(RunError, match=r"out\.h5: dt_min: rows are missing"):
            write(group)
    assert list(tmp_path.iterdir()) == []


# Results other than those of sweeps: complete under their name, or not there at all.

KIND = vs.register_kind(vs.ResultKind("saved", "the tests of saving"))


@pytest.fixture
def found():
    """A dataset with every type of value that a result has."""
    return xr.Dataset(
        {
            "gain": ("x", [0.5, np.nan]),
            "name": ("x", ["a", "bé"]),
            "word": ("x", np.array(["u", "vw"], object)),
            "flag": ("x", [True, False]),
            "count": (("x", "y"), np.arange(6).reshape(2, 3)),
            "none": ("z", np.zeros(0)),
        },
        {"x": [1, 2], "label": ("x", ["q", "r"])},
        {"title": "é", "number": 3, "list": ["a", "b"]},
    )


def test_a_saved_dataset_is_read_as_it_was(found, tmp_path):
    path = vs.save_result(found, tmp_path / "out.h5", KIND)
    found.to_netcdf(tmp_path / "plain.h5", engine="h5netcdf")
    expected = xr.load_dataset(tmp_path / "plain.h5", engine="h5netcdf")
    expected.attrs["result"] = "saved"
    xr.testing.assert_identical(load_dataset(path), expected)
    assert state_of(path) is FileState.INTACT


def test_only_the_directory_of_the_output_is_needed(found, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "nowhere"))
    vs.save_result(found, tmp_path / "out.h5", KIND)
    assert [path.name for path in tmp_path.iterdir()] == ["out.h5"]


@pytest.mark.parametrize("room", [0, 100, 4096, 9000])
def test_a_full_disk_is_named_and_leaves_nothing(found, tmp_path, limited, room):
    """HDF5 ends the process when it closes a file that it could not write."""
    with limited(room), pytest.raises(OutputError, match=r"out\.h5: writing failed.*ulimit -f"):
        vs.save_result(found, tmp_path / "out.h5", KIND)
    assert list(tmp_path.iterdir()) == []


def test_a_signal_waits_until_hdf5_has_written(found, tmp_path, monkeypatch):
    """HDF5 loses the exception of a handler that is called while it writes."""
    write = Disk.write

    def interrupted(disk, data):
        signal.raise_signal(signal.SIGINT)
        return write(disk, data)

    monkeypatch.setattr(Disk, "write", interrupted)
    with pytest.raises(KeyboardInterrupt):
        vs.save_result(found, tmp_path / "out.h5", KIND)
    assert list(tmp_path.iterdir()) == []


def test_an_existing_file_is_kept(found, tmp_path):
    path = tmp_path / "out.h5"
    path.write_bytes(b"old")
    with pytest.raises(
        ExistingOutputError, match=r"exists and was not replaced.*path=.*force=True"
    ):
        vs.save_result(found, path, KIND)
    assert path.read_bytes() == b"old"
    vs.save_result(found, path, KIND, force=True)
    assert [one.name for one in tmp_path.iterdir()] == ["out.h5"]


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"dataset": "x"}, "dataset = str: must be an xarray.Dataset"),
        ({"dataset": None}, "dataset = NoneType"),
        ({"kind": "saved"}, "kind = 'saved': must be a ResultKind"),
        ({"kind": vs.ResultKind("unknown", "nobody")}, "that register_kind has registered"),
        ({"path": 3}, "path = 3: must be the path of a file"),
        ({"path": ""}, "path = '': must be the path of a file"),
        ({"path": "a\0b"}, "must be the path of a file"),
        ({"path": "/"}, "/: is a directory; give the name of a file with path="),
    ],
)
def test_wrong_arguments(found, tmp_path, values, words):
    arguments = {"dataset": found, "path": tmp_path / "out.h5", "kind": SWEEP} | values
    with pytest.raises((ParameterError, OutputError)) as caught:
        vs.save_result(*arguments.values())
    assert words in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_what_netcdf_cannot_hold(found, tmp_path):
    for wrong in (found.assign(part=("x", [object(), 1])), found.assign_attrs(part={})):
        with pytest.raises(DataError, match=r"out\.h5: netCDF cannot hold this dataset"):
            vs.save_result(wrong, tmp_path / "out.h5", KIND)
    assert list(tmp_path.iterdir()) == []


# Realizations along one dimension, or along the axes of a grid.

GRID = {
    "restitution": [0.5, 0.8, 0.9],
    "base_acceleration": [0.5, 2.0],
    "frequency": [17.0, 10.0, 30.0, 12.0],
    "duration_periods": 20,
    "particles": 2,
    "per_particle": True,
}
SIZES = st.lists(st.integers(1, 5), min_size=1, max_size=4)


@given(SIZES, st.data())
def test_boxes_hold_a_range_of_elements_in_order(sizes, data):
    array = np.arange(np.prod(sizes)).reshape(sizes)
    start, stop = sorted(data.draw(st.integers(0, array.size)) for _ in range(2))
    cut = [array[box].ravel() for box in boxes(sizes, start, stop)]
    assert np.concatenate([np.empty(0, int), *cut]).tolist() == list(range(start, stop))
    assert len(cut) <= 2 * len(sizes) - 1


@pytest.fixture(scope="module")
def path_rows(tmp_path_factory):
    path = tmp_path_factory.mktemp("grid") / "grid.h5"
    vs.run(GRID, path, chunk=5).close()
    return path


def test_a_grid_has_its_axes_as_dimensions(path_rows):
    with xr.open_dataset(path_rows) as found:
        assert found.impact_count.dims == ("restitution", "base_acceleration", "frequency")
        assert found.particle_status.dims[-1] == "particle"
        for name in ("restitution", "base_acceleration", "frequency"):
            assert found.indexes[name].tolist() == GRID[name]
        # a quantity that follows from some of the axes lies along those
        assert found.duration.dims == ("frequency",)
        assert np.array_equal(found.duration, 20 / found.frequency)
        assert found.amplitude.dims == found.impact_count.dims
        one = found.sel(restitution=0.8, base_acceleration=2.0, frequency=30.0)
        alone = vs.sweep(**{**GRID, "restitution": 0.8, "base_acceleration": 2.0, "frequency": 30})
        for name in alone.data_vars:
            same = alone[name].isel(realization=0, missing_dims="ignore").values
            assert np.array_equal(one[name].values, same, equal_nan=True), name
        assert one.amplitude == alone.amplitude


def test_a_quantity_lies_only_along_axes_from_which_it_follows():
    found = vs.sweep(restitution=[0.5, 0.9], amplitude=[1.0, 2.0, 3.0], phase=[0.0, 1.0])
    assert found.base_acceleration.dims == ("restitution", "amplitude")
    same = vs.sweep(restitution=[0.5, 0.9], amplitude=[1.0, 2.0, 3.0])
    assert np.array_equal(found.base_acceleration, same.base_acceleration)


def test_random_designs_keep_the_dimension_of_realizations():
    found = vs.sweep(restitution=(0.5, 0.9), realizations=3)
    assert found.impact_count.dims == ("realization",)
    assert flat(found) is found


def test_flat_numbers_realizations_as_the_design_does(path_rows):
    with xr.open_dataset(path_rows) as found:
        stacked = flat(found)
        axes = (GRID[n] for n in ("restitution", "base_acceleration", "frequency"))
        mesh = np.meshgrid(*axes, indexing="ij")
        for name, values in zip(
            ("restitution", "base_acceleration", "frequency"), mesh, strict=True
        ):
            assert stacked[name].dims == ("realization",)
            assert stacked[name].values.tolist() == values.ravel().tolist()
        assert np.array_equal(stacked.impact_count, found.impact_count.values.ravel())
        plane = flat(found.isel(frequency=1))
        assert plane.sizes["realization"] == 6
        assert plane.frequency.item() == 10.0


@pytest.mark.parametrize("block", [7, rows.ROWS_AT_A_TIME])
def test_rows_are_those_of_the_stacked_dataset(path_rows, monkeypatch, block):
    monkeypatch.setattr(rows, "ROWS_AT_A_TIME", block)
    rng = np.random.default_rng(3)
    with h5netcdf.File(path_rows, "r") as file, xr.open_dataset(path_rows) as found:
        assert row_dims(file) == found.impact_count.dims
        assert row_count(file) == 24
        stacked = flat(found.load())
        for name in ("status", "particle_status", "duration", "amplitude", "restitution"):
            whole = stacked[name].values
            for start, stop in np.sort(rng.integers(0, 25, (20, 2)), axis=1).tolist():
                assert np.array_equal(read_rows(file, name, slice(start, stop)), whole[start:stop])
            chosen = np.sort(rng.choice(24, 5, replace=False))
            assert np.array_equal(read_rows(file, name, chosen), whole[chosen])


def test_a_grid_of_an_earlier_version_is_read_as_before(path_rows, tmp_path):
    """In such a file realizations and sampled parameters lie along one dimension."""
    earlier = tmp_path / "earlier.h5"
    with xr.open_dataset(path_rows) as found:
        flat(found).to_netcdf(earlier, engine="h5netcdf")
    before, now = (read_sample(p, 5, 1)[0] for p in (earlier, path_rows))
    assert before.rows.tolist() == now.rows.tolist()
    for name, values in now.stored.items():
        assert np.array_equal(before.stored[name], values, equal_nan=True), name
    for name, values in now.coordinates.items():
        assert np.array_equal(before.coordinates[name], values), name
    measured = [[line for line in describe(p) if "impact" in line] for p in (earlier, path_rows)]
    assert measured[0] == measured[1]
    with vs.open_sweep(earlier) as opened:
        assert opened.sizes["realization"] == 24


def test_without_a_repository_there_is_no_revision(monkeypatch, tmp_path):
    monkeypatch.setattr(module, "__file__", str(tmp_path / "a" / "b" / "c" / "d.py"))
    assert "git_revision" not in module.provenance(1)


def test_the_revision_is_that_of_the_branch(monkeypatch, tmp_path):
    git = tmp_path / ".git"
    (git / "refs" / "heads").mkdir(parents=True)
    monkeypatch.setattr(module, "__file__", str(tmp_path / "src" / "package" / "store" / "d.py"))
    (git / "HEAD").write_text("ref: refs/heads/main\n")
    assert "git_revision" not in module.provenance(1)  # its refs are packed
    (git / "refs" / "heads" / "main").write_text("12ab\n")
    assert module.provenance(1)["git_revision"] == "12ab"
    (git / "HEAD").write_text("34cd\n")  # no branch
    assert module.provenance(1)["git_revision"] == "34cd"


def test_a_system_without_cpuinfo_still_names_a_processor(monkeypatch):
    def read(path, **options):
        if path == Path("/proc/cpuinfo"):
            raise FileNotFoundError
        return original(path, **options)

    original = Path.read_text
    monkeypatch.setattr("pathlib.Path.read_text", read)
    assert module.provenance(3)["cpu"]


# A file that was just written is opened without reading its structure, yet as xarray opens it.

FRESH = {
    "range": {"restitution": (0.8, 0.9), "realizations": 7, "seed": 1, "particles": 2},
    "grid": {"restitution": [0.8, 0.9], "amplitude": [1.0, 2.0, 3.0], "per_particle": True},
}


@pytest.fixture(params=FRESH.values(), ids=FRESH)
def path_fresh(request, tmp_path):
    path = tmp_path / "out.h5"
    vs.run({**request.param, "duration": 3.0}, path).close()
    return path


def test_it_equals_what_xarray_opens(path_fresh):
    found = fresh.opened(path_fresh)
    with found, xr.open_dataset(path_fresh, engine="h5netcdf") as known:
        xr.testing.assert_identical(found, known)
        assert found.variables.keys() == known.variables.keys()  # in an order of xarray's choice
        assert found.indexes.keys() == known.indexes.keys()
        assert found.encoding["source"] == known.encoding["source"]
        for name, one in found.variables.items():
            assert one.dtype == known[name].dtype, name


def test_values_are_read_when_needed_and_stay_when_the_file_goes(path_fresh):
    with fresh.opened(path_fresh) as found, xr.load_dataset(path_fresh, engine="h5netcdf") as known:
        assert "..." in repr(found)
        path_fresh.unlink()
        for name, one in known.items():
            for dim in one.dims:
                cut = {dim: slice(None, None, -1)}
                xr.testing.assert_identical(found[name].isel(cut), known[name].isel(cut))
                some = {dim: np.array([-1, 0, 0])}
                xr.testing.assert_identical(found[name].isel(some), known[name].isel(some))


def test_it_can_be_sent_to_another_process(path_fresh):
    with fresh.opened(path_fresh) as found:
        again = pickle.loads(pickle.dumps(found))
        xr.testing.assert_identical(again, found)
        again.close()


def test_a_file_with_texts_is_read(tmp_path):
    table = {"restitution": [0.8, 0.9], "amplitude": [1.0, 2.0], "name": ["a", "b"]}
    with vs.run({"design": table, "duration": 3.0}, tmp_path / "out.h5") as found:
        assert fresh.opened(tmp_path / "out.h5") is None
        assert found["name"].values.tolist() == ["a", "b"]


def test_a_file_that_changed_is_read(path_fresh):
    held = path_fresh.read_bytes()
    path_fresh.write_bytes(held)
    assert fresh.opened(path_fresh) is None
    with vs.open_sweep(path_fresh) as found:
        assert found["status"].size
    path_fresh.write_bytes(held[:-200])
    assert fresh.opened(path_fresh) is None
