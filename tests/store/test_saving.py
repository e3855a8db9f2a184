"""Results other than those of sweeps: complete under their name, or not there at all."""

import signal
import tempfile

import numpy as np
import pytest
import xarray as xr

import vibrosweep as vs
from vibrosweep.errors import DataError, ExistingOutputError, OutputError, ParameterError
from vibrosweep.store.disk import Disk, State, state_of
from vibrosweep.store.reading import SWEEP, load_dataset

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
    assert state_of(path) is State.INTACT


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
    with pytest.raises(ExistingOutputError, match=r"exists and is kept.*path=.*force=True"):
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
