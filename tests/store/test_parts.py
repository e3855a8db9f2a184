"""Parts of a run, directories and disks."""

import errno
import fcntl
import json
import os
import signal
import stat
import subprocess
import sys

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep.errors import OutputError, RunError, TakenOutputError
from vibrosweep.model.measures import VARIABLES
from vibrosweep.store import disk
from vibrosweep.store.disk import check_output, replacing, undisturbed
from vibrosweep.store.parts import (
    MANIFEST,
    Manifest,
    Parts,
    abandon,
    holding,
    kinds,
    read_manifest,
    replaces,
    run_directory,
    write_manifest,
)
from vibrosweep.store.writing import creating

# Parts and manifest of a run: whole or absent, and never used when damaged.

COLUMNS = {"a": np.arange(4.0), "b": np.arange(8, dtype=np.int8).reshape(4, 2)}


def manifest(**changes):
    plain = {"identity": {"k": "1"}, "realizations": 10, "chunk": 4, "columns": kinds(COLUMNS)}
    return Manifest(**(plain | changes))


@pytest.fixture
def parts(tmp_path):
    return Parts(tmp_path, manifest())


def test_a_part_is_read_as_it_was_written(parts):
    parts.write(1, COLUMNS)
    ((index, path),) = parts.finished().items()
    assert index == 1
    found = parts.read(1, path)
    assert found.keys() == COLUMNS.keys()
    for name, values in COLUMNS.items():
        assert found[name].dtype == values.dtype
        np.testing.assert_array_equal(found[name], values)
    assert [p.name for p in parts.directory.iterdir()] == [path.name]


def test_the_same_columns_make_the_same_file(parts):
    parts.write(0, COLUMNS)
    ((_, path),) = parts.finished().items()
    before = path.read_bytes()
    parts.write(0, COLUMNS)
    assert parts.finished() == {0: path}
    assert path.read_bytes() == before


def test_every_flipped_bit_is_noticed(parts):
    parts.write(0, COLUMNS)
    path = parts.finished()[0]
    data = path.read_bytes()
    for place in range(len(data)):
        path.write_bytes(data[:place] + bytes([data[place] ^ (1 << place % 8)]) + data[place + 1 :])
        assert parts.read(0, path) is None
    for length in range(0, len(data), 7):
        path.write_bytes(data[:length])
        assert parts.read(0, path) is None
    path.unlink()
    assert parts.read(0, path) is None


def test_a_part_of_another_run_or_chunk_is_not_taken(parts):
    parts.write(0, COLUMNS)
    path = parts.finished()[0]
    assert Parts(parts.directory, manifest(identity={})).read(0, path) is None
    moved = path.rename(path.with_name(path.name.replace("chunk-0000000000", "chunk-0000000001")))
    assert parts.read(1, moved) is None


@pytest.mark.parametrize(
    "columns",
    [
        {"a": COLUMNS["a"]},
        COLUMNS | {"c": COLUMNS["a"]},
        COLUMNS | {"a": COLUMNS["a"].astype(np.float32)},
        COLUMNS | {"b": COLUMNS["b"][:, :1]},
        {name: values[:3] for name, values in COLUMNS.items()},
    ],
    ids=["missing", "more", "type", "shape", "rows"],
)
def test_other_columns_than_those_declared_are_neither_written_nor_taken(parts, columns):
    with pytest.raises(RunError, match=r"chunk 0 .* columns"):
        parts.write(0, columns)
    assert parts.finished() == {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Parts, "_fits", lambda *arguments: True)
        parts.write(0, columns)
    assert parts.read(0, parts.finished()[0]) is None


def test_files_that_are_no_parts_are_not_counted(parts):
    for name in ("lock", MANIFEST, ".chunk-0000000000.0123abcd.partial", "chunk-1-ab.part"):
        (parts.directory / name).touch()
    assert parts.finished() == {}


def test_a_part_that_cannot_be_written(tmp_path):
    with pytest.raises(OutputError, match=r"gone was removed"):
        Parts(tmp_path / "gone", manifest()).write(0, COLUMNS)


def test_a_manifest_is_read_as_it_was_written(tmp_path):
    assert read_manifest(tmp_path) is None
    assert read_manifest(tmp_path / "none") is None
    write_manifest(tmp_path, manifest(replaces=True))
    assert read_manifest(tmp_path) == manifest(replaces=True)


def test_chunks_cover_all():
    assert [manifest().bounds(i) for i in range(manifest().chunks)] == [(0, 4), (4, 8), (8, 10)]
    assert manifest(chunk=10).chunks == 1
    assert len({manifest().key, manifest(chunk=5).key, manifest(identity={}).key}) == 3


def test_a_damaged_manifest_is_reported(tmp_path):
    write_manifest(tmp_path, manifest())
    path = tmp_path / MANIFEST
    data = json.loads(path.read_text())
    for damage in (
        b"",
        b"[]",
        b"\xff",
        b"[" * 100_000,
        json.dumps({**data, "run": {**data["run"], "chunk": 5}}).encode(),
        json.dumps({**data, "run": {**data["run"], "more": 5}}).encode(),
        json.dumps({"run": data["run"]}).encode(),
    ):
        path.write_bytes(damage)
        with pytest.raises(RunError, match=r"manifest\.json: is damaged.*force=True"):
            read_manifest(tmp_path)


@given(st.integers(0), st.integers(0, 255))
def test_any_changed_byte_of_the_manifest_is_harmless_or_reported(tmp_path_factory, place, value):
    directory = tmp_path_factory.getbasetemp()
    write_manifest(directory, manifest())
    data = bytearray((directory / MANIFEST).read_bytes())
    data[place % len(data)] = value
    (directory / MANIFEST).write_bytes(data)
    try:
        assert read_manifest(directory) == manifest()
    except RunError:
        pass
    finally:
        (directory / MANIFEST).unlink()


# A run directory: one process at a time holds it, and never a dead one.

HOLD = """
import sys, time
from pathlib import Path
from vibrosweep.store.parts import holding
with holding(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def output(tmp_path):
    return tmp_path / "out.h5"


def test_a_second_run_is_refused(output):
    with holding(output) as directory:
        assert directory == run_directory(output) == output.with_name("out.h5.parts")
        with (
            pytest.raises(RunError, match=rf"another run \(process {os.getpid()} on .*output="),
            holding(output),
        ):
            pass
    assert not directory.exists()
    with holding(output):
        pass


def test_a_dead_process_holds_nothing(output):
    words = [sys.executable, "-c", HOLD, output]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout.readline() == "held\n"
        with pytest.raises(RunError, match=f"process {process.pid} on"), holding(output):
            pass
        process.send_signal(signal.SIGKILL)
        process.wait()
    with holding(output):
        pass


def test_a_directory_with_a_manifest_is_kept(output):
    assert not replaces(output)
    with holding(output) as directory:
        write_manifest(directory, Manifest({}, 1, 1, {}, replaces=True))
        (directory / ".chunk.0123abcd.partial").touch()
    assert replaces(output)
    with holding(output):  # what a killed write left is removed
        assert {p.name for p in directory.iterdir()} == {"lock", "manifest.json"}
        abandon(directory)
    assert not directory.exists()


def test_a_lock_on_a_removed_file_does_not_count(output, monkeypatch):
    """Another run ends between opening the lock file and locking it."""
    locked = []

    def lock(*arguments):
        if not locked:
            (run_directory(output) / "lock").unlink()
        locked.append(arguments)
        original(*arguments)

    original = fcntl.flock
    monkeypatch.setattr("fcntl.flock", lock)
    with holding(output) as directory:
        assert (directory / "lock").exists()
    assert len(locked) == 2


def test_a_file_system_without_locks(output, monkeypatch):
    def refuse(*arguments):
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr("fcntl.flock", refuse)
    with (
        pytest.raises(RunError, match=r"has no locks \(Function not implemented\).*output="),
        holding(output),
    ):
        pass


def test_a_place_that_takes_no_directory(tmp_path):
    taken = tmp_path / "out.h5.parts"
    taken.touch()
    with pytest.raises(OutputError, match=r"out\.h5: writing failed"), holding(tmp_path / "out.h5"):
        pass
    with pytest.raises(OutputError, match="was removed"), holding(tmp_path / "none" / "out.h5"):
        pass
    long = tmp_path / ("x" * 252 + ".h5")
    with pytest.raises(OutputError, match="too long"), holding(long):
        pass
    assert [p.name for p in tmp_path.iterdir()] == ["out.h5.parts"]


# A file appears when it is complete, or not at all.


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
        (old, False, r"exists and was not replaced.*output=.*force=True"),
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
