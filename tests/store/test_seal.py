"""Seals of result files, and the trial of files that have none."""

import shutil

import h5py
import netCDF4
import numpy as np
import pytest
import xarray as xr

from vibrosweep.cli import main
from vibrosweep.errors import DataError
from vibrosweep.store import trial
from vibrosweep.store.disk import FileState, append_seal, state_of
from vibrosweep.store.reading import reading
from vibrosweep.store.trial import require_readable


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """The result of a small sweep, with a record and compressed variables."""
    directory = tmp_path_factory.mktemp("sealed")
    text = (
        'title = "x"\n[sample]\nrealizations = 3\namplitude = [0.5, 2.0]\n[record]\namplitude = 1.0'
    )
    (directory / "s.toml").write_text(text)
    assert main(["run", str(directory / "s.toml"), "-o", str(directory / "s.h5")]) == 0
    return directory / "s.h5"


@pytest.fixture
def copy(sound, tmp_path):
    return shutil.copy(sound, tmp_path / "copy.h5")


def test_every_byte_counts(copy):
    assert state_of(copy) is FileState.INTACT
    whole = copy.read_bytes()
    end = len(whole) - 89
    rng = np.random.default_rng(1)
    for place in [0, end - 1, *rng.integers(end, size=200).tolist()]:
        copy.write_bytes(whole[:place] + bytes([whole[place] ^ 4]) + whole[place + 1 :])
        assert state_of(copy) is FileState.BROKEN, place
    copy.write_bytes(whole)
    assert state_of(copy) is FileState.INTACT
    for length in (0, 1, 88, end, len(whole) - 1):
        copy.write_bytes(whole[:length])
        assert state_of(copy) is FileState.MISSING


def test_other_readers_do_not_mind(copy):
    with h5py.File(copy) as file:
        landings = file["impact_count"][...]
    assert landings.min() > 0
    for engine in ("h5netcdf", "netcdf4", None):
        assert np.array_equal(xr.load_dataset(copy, engine=engine)["impact_count"], landings)
    with netCDF4.Dataset(copy) as file:
        assert np.array_equal(file["impact_count"][:], landings)
    assert state_of(copy) is FileState.INTACT


@pytest.mark.parametrize("command", ["info", "figures", "verify"])
def test_damage_is_refused_before_hdf5_sees_it(copy, capsys, monkeypatch, tmp_path, command):
    whole = bytearray(copy.read_bytes())
    whole[len(whole) // 2] ^= 1
    copy.write_bytes(whole)
    monkeypatch.chdir(tmp_path)
    assert main([command, str(copy)]) == 2
    assert "its contents are not those that it was sealed with" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["copy.h5"]


def test_a_result_that_another_program_wrote_is_read_and_said_to_have_no_seal(
    sound, tmp_path, capsys
):
    other = tmp_path / "other.h5"
    xr.load_dataset(sound).isel(realization=slice(2)).to_netcdf(other, engine="h5netcdf")
    assert main(["info", str(sound)]) == 0
    assert "no seal" not in capsys.readouterr().out
    assert main(["info", str(other)]) == 0
    assert "no seal" in capsys.readouterr().out


def test_a_seal_can_be_put_on_anything(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"")
    with path.open("r+b") as file:
        append_seal(file)
    assert state_of(path) is FileState.INTACT


def test_files_that_hdf5_cannot_read(sound, tmp_path, monkeypatch):
    require_readable(sound)
    cut = tmp_path / "cut.h5"
    cut.write_bytes(sound.read_bytes()[:5000])
    with pytest.raises(ValueError, match="truncated file"):
        require_readable(cut)
    with pytest.raises(DataError, match="not a result"), reading(cut):
        pass
    fake = tmp_path / "fake.py"
    monkeypatch.setattr(trial, "__file__", str(fake))
    fake.write_text("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)")
    with pytest.raises(ValueError, match=r"HDF5 crashes on it \(signal 11\)"):
        require_readable(cut)
    fake.write_text("import time; time.sleep(60)")
    monkeypatch.setattr(trial, "PATIENCE", 0.3)
    with pytest.raises(ValueError, match="finish reading"):
        require_readable(cut)  # the fake reader would end without an error after a minute
