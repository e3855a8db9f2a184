"""A file appears when it is complete, or not at all."""

import errno
import os
import signal
import stat

import h5py
import numpy as np
import pytest

from vibrosweep.errors import OutputError, TakenOutputError
from vibrosweep.model.measures import VARIABLES
from vibrosweep.store import disk
from vibrosweep.store.disk import check_output, replacing, undisturbed
from vibrosweep.store.writing import creating


def fill(path, values):
    with creating(path) as file:
        file.dimensions({"realization": values.size})
        file.variable(VARIABLES["dt_min"])
        for start in range(0, values.size, 1000):
            file.write("dt_min", start, values[start : start + 1000])


def test_a_file_appears_at_its_end(tmp_path):
    path = tmp_path / "out.h5"
    with creating(path) as file:
        file.dimensions({"realization": 1})
        assert not path.exists()
        assert [p.suffix for p in tmp_path.iterdir()] == [".partial"]
    assert list(tmp_path.iterdir()) == [path]
    assert h5py.is_hdf5(path)


def test_leftovers_of_a_killed_command_are_cleared_by_the_next_of_the_same_output(tmp_path):
    path, left = tmp_path / "out.h5", tmp_path / ".out.h5.0123abcd.partial"
    left.touch()
    other = tmp_path / ".other.h5.0123abcd.partial"
    other.touch()
    with replacing(path), replacing(path):  # the second finds the first one at work
        assert not left.exists()
        assert len(list(tmp_path.glob(".out.h5.*.partial"))) == 2
    assert {one.name for one in tmp_path.iterdir()} == {path.name, other.name}


@pytest.mark.parametrize(
    "error", [ValueError("x"), OSError("x"), KeyboardInterrupt(), SystemExit()]
)
def test_nothing_is_left_of_a_block_that_fails(tmp_path, error):
    path = tmp_path / "out.h5"

    def fail():
        with creating(path) as file:
            file.dimensions({"realization": 5})
            file.variable(VARIABLES["dt_min"])
            raise error

    with pytest.raises(type(error)) as caught:
        fail()
    assert caught.value is error
    assert list(tmp_path.iterdir()) == []


def test_the_old_file_survives_a_failure(tmp_path):
    path = tmp_path / "out.h5"
    path.write_bytes(b"old")
    with pytest.raises(ZeroDivisionError), creating(path):
        raise ZeroDivisionError
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("room", [0, 1, 3000, 20_000, 79_000])
def test_a_full_disk_is_named_and_leaves_nothing(tmp_path, room, limited):
    path = tmp_path / "out.h5"
    path.write_bytes(b"old")
    with limited(room), pytest.raises(OutputError, match=r"out\.h5.*[Ff]ile too large.*ulimit -f"):
        fill(path, np.random.default_rng(1).random(10_000))
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_ends_a_run_early(tmp_path, limited):
    pieces = []

    def run():
        with creating(tmp_path / "out.h5") as file:
            file.dimensions({"realization": 10**7})
            file.variable(VARIABLES["dt_min"])
            for start in range(0, 10**7, 10**5):
                file.write("dt_min", start, np.ones(10**5))
                pieces.append(start)

    with limited(2_000_000), pytest.raises(OutputError):
        run()
    assert len(pieces) <= 2


def test_any_buffer_is_written(tmp_path):
    with replacing(tmp_path / "out") as disk:
        disk.write(np.arange(4.0))
        disk.write(b"")
    assert (tmp_path / "out").read_bytes() == np.arange(4.0).tobytes()


def test_a_result_has_the_permissions_of_a_new_file(tmp_path):
    (tmp_path / "plain").touch()
    fill(tmp_path / "out.h5", np.ones(3))
    modes = {stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()}
    assert len(modes) == 1


def test_a_symbolic_link_stays_a_link(tmp_path):
    (tmp_path / "far").mkdir()
    link = tmp_path / "out.h5"
    link.symlink_to(tmp_path / "far" / "real.h5")
    check_output(link, force=False)
    fill(link, np.ones(3))
    assert link.is_symlink()
    assert h5py.is_hdf5(tmp_path / "far" / "real.h5")


def test_a_name_as_long_as_the_system_allows(tmp_path):
    name = "ü" * 126 + ".h5"
    check_output(tmp_path / name, force=False)
    fill(tmp_path / name, np.ones(3))
    assert [p.name for p in tmp_path.iterdir()] == [name]


def test_signals_wait_for_the_end_of_a_write(tmp_path):
    seen = []

    def write():
        with undisturbed():
            signal.raise_signal(signal.SIGINT)
            seen.append("written")

    with pytest.raises(KeyboardInterrupt):
        write()
    assert seen == ["written"]
    with pytest.raises(KeyboardInterrupt):  # as before
        signal.raise_signal(signal.SIGINT)


def test_check_output(tmp_path):
    old = tmp_path / "old.h5"
    old.touch()
    loop = tmp_path / "loop.h5"
    loop.symlink_to(loop)
    pipe = tmp_path / "pipe.h5"
    os.mkfifo(pipe)
    for path, force, words in [
        (old, False, r"exists and is kept.*output=.*force=True"),
        (tmp_path, False, "is a directory"),
        (tmp_path, True, "is a directory"),
        (pipe, True, "not a regular file"),
        (loop, False, "cannot be written"),
        (tmp_path / "no" / "out.h5", False, "no is not a directory; create it"),
        (old / "out.h5", False, "is not a directory"),
        (tmp_path / ("x" * 300), False, "cannot be written.*too long"),
    ]:
        with pytest.raises(OutputError, match=words) as caught:
            check_output(path, force=force)
        assert str(caught.value).startswith(f"{path}: ")
    check_output(old, force=True)
    with pytest.raises(OutputError, match="is an input"):
        check_output(old, force=True, inputs=(None, tmp_path / "none", old))
    assert {p.name for p in tmp_path.iterdir()} == {"old.h5", "loop.h5", "pipe.h5"}


def test_a_directory_that_takes_no_file(tmp_path, monkeypatch):
    def refuse(**options):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    with pytest.raises(OutputError, match=r"cannot write in .*Permission denied.*output="):
        check_output(tmp_path / "out.h5", force=False)


def test_a_result_under_another_name_is_flushed_before_the_caller_is_told(tmp_path, monkeypatch):
    """The caller then removes the parts of the run; the result must be durable before that."""
    flushed = []
    monkeypatch.setattr(
        disk, "flush_directory", lambda path: flushed.extend(sorted(p.name for p in path.iterdir()))
    )
    (tmp_path / "out.h5").write_bytes(b"other")
    with pytest.raises(TakenOutputError), replacing(tmp_path / "out.h5", force=False) as new:
        new.write(b"new")
    assert flushed == ["out-1.h5", "out.h5"]
