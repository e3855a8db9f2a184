"""A file that was just written is opened without reading its structure, yet as xarray opens it."""

import pickle

import numpy as np
import pytest
import xarray as xr

import vibrosweep as vs
from vibrosweep.store import fresh

SWEEPS = {
    "range": {"restitution": (0.8, 0.9), "realizations": 7, "seed": 1, "particles": 2},
    "grid": {"restitution": [0.8, 0.9], "amplitude": [1.0, 2.0, 3.0], "per_particle": True},
}


@pytest.fixture(params=SWEEPS.values(), ids=SWEEPS)
def path(request, tmp_path):
    path = tmp_path / "out.h5"
    vs.run({**request.param, "duration": 3.0}, path).close()
    return path


def test_it_equals_what_xarray_opens(path):
    found = fresh.opened(path)
    with found, xr.open_dataset(path, engine="h5netcdf") as known:
        xr.testing.assert_identical(found, known)
        assert found.variables.keys() == known.variables.keys()  # in an order of xarray's choice
        assert found.indexes.keys() == known.indexes.keys()
        assert found.encoding["source"] == known.encoding["source"]
        for name, one in found.variables.items():
            assert one.dtype == known[name].dtype, name


def test_values_are_read_when_needed_and_stay_when_the_file_goes(path):
    with fresh.opened(path) as found, xr.load_dataset(path, engine="h5netcdf") as known:
        assert "..." in repr(found)
        path.unlink()
        for name, one in known.items():
            for dim in one.dims:
                cut = {dim: slice(None, None, -1)}
                xr.testing.assert_identical(found[name].isel(cut), known[name].isel(cut))
                some = {dim: np.array([-1, 0, 0])}
                xr.testing.assert_identical(found[name].isel(some), known[name].isel(some))


def test_it_can_be_sent_to_another_process(path):
    with fresh.opened(path) as found:
        again = pickle.loads(pickle.dumps(found))
        xr.testing.assert_identical(again, found)
        again.close()


def test_a_file_with_texts_is_read(tmp_path):
    table = {"restitution": [0.8, 0.9], "amplitude": [1.0, 2.0], "name": ["a", "b"]}
    with vs.run({"design": table, "duration": 3.0}, tmp_path / "out.h5") as found:
        assert fresh.opened(tmp_path / "out.h5") is None
        assert found["name"].values.tolist() == ["a", "b"]


def test_a_file_that_changed_is_read(path):
    held = path.read_bytes()
    path.write_bytes(held)
    assert fresh.opened(path) is None
    with vs.open_sweep(path) as found:
        assert found["status"].size
    path.write_bytes(held[:-200])
    assert fresh.opened(path) is None
