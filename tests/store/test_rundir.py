"""A run directory: one process at a time holds it, and never a dead one."""

import fcntl
import os
import signal
import subprocess
import sys

import pytest

from vibrosweep.errors import OutputError, RunError
from vibrosweep.store.parts import (
    Manifest,
    abandon,
    holding,
    replaces,
    run_directory,
    write_manifest,
)

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
