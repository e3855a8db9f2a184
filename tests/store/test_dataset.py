"""A result is a plain netCDF-4 file: every reader finds the same data, types, axes and words."""

import tomllib
from pathlib import Path

import h5py
import netCDF4
import numpy as np
import pytest
import xarray as xr

from vibrosweep import open_record, open_sweep
from vibrosweep._version import __version__
from vibrosweep.errors import RunError
from vibrosweep.model.measures import RECORD, VARIABLES
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.store.writing import CHUNK_VALUES, creating

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
