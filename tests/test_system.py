"""Differences between operating systems, with the features of others imitated or removed."""

import errno
import os
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from vibrosweep import system

fcntl = pytest.importorskip("fcntl")


@pytest.fixture
def windows(monkeypatch):
    """File locks as on Windows: they lock bytes and are refused with another error."""

    def locking(descriptor, mode, count):
        assert (mode, count, os.lseek(descriptor, 0, os.SEEK_CUR)) == (2, 1, system.LOCKED_BYTE)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise PermissionError(errno.EACCES, "Permission denied") from error

    monkeypatch.setattr(system, "fcntl", None)
    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(LK_NBLCK=2, locking=locking))


@pytest.fixture
def elsewhere(monkeypatch):
    """A system without /proc and sysconf."""

    def absent(path, **options):
        raise FileNotFoundError(path)

    monkeypatch.setattr(Path, "read_text", absent)
    monkeypatch.delattr(os, "sysconf")


def opened(path):
    return path.open("a+", encoding="utf-8")


def holds_one_at_a_time(path):
    """A second lock is refused, or waits; closing the file releases the first one."""
    done = []
    with opened(path) as first, opened(path) as second:
        first.write("what a lock file says")
        first.flush()
        assert system.locked(first.fileno(), wait=False)
        assert not system.locked(second.fileno(), wait=False)
        assert os.read(second.fileno(), 8) == b"what a l"
        waiting = threading.Thread(
            target=lambda: done.append(system.locked(second.fileno(), wait=True))
        )
        waiting.start()
        time.sleep(0.1)
        assert done == []
        first.close()
        waiting.join()
        assert done == [True]


def test_one_process_has_a_lock(tmp_path):
    holds_one_at_a_time(tmp_path / "lock")


@pytest.mark.usefixtures("windows")
def test_one_process_has_a_lock_on_windows(tmp_path):
    holds_one_at_a_time(tmp_path / "lock")


def test_memory_of_this_machine():
    assert system.physical_memory() > system.available_memory() > 0
    assert system.physical_memory() > system.resident_memory() > 1 << 20


@pytest.mark.usefixtures("elsewhere")
def test_memory_where_only_psutil_tells_it(monkeypatch):
    memory = SimpleNamespace(total=3 << 30, available=2 << 30)
    own = SimpleNamespace(memory_info=lambda: SimpleNamespace(rss=1 << 30))
    told = SimpleNamespace(virtual_memory=lambda: memory, Process=lambda: own)
    monkeypatch.setitem(sys.modules, "psutil", told)
    assert system.physical_memory() == 3 << 30
    assert system.available_memory() == 2 << 30
    assert system.resident_memory() == 1 << 30
