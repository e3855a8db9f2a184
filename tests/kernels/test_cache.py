"""The disk cache of machine code: several processes, damaged files."""

import fcntl
import struct
import tempfile
import threading
from pathlib import Path

import numba
import numpy as np
import pytest

from vibrosweep.kernels import _cache, _jit, _numba
from vibrosweep.kernels._cache import CheckedFiles, Variants, variants

pytestmark = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="needs machine code")


CONSTANT = 1.2345678901234567


def law(x, reflect):
    return -x if reflect is not None else x


def scaled(x):
    return CONSTANT * x


@pytest.fixture
def kernel(tmp_path, monkeypatch):
    """Make kernels of one function, each as a fresh process would have it."""
    monkeypatch.setattr(_jit, "cache_directory", tmp_path)
    monkeypatch.setattr(_jit, "read_only_caches", ())
    return lambda function=law: _jit.kernel(function)


def hits(kernel):
    return sum(kernel.dispatcher.stats.cache_hits.values())


def test_variants_are_kept_and_counted(kernel, tmp_path):
    assert variants(tmp_path) == Variants(0, 0, 0)
    first = kernel()
    assert (first(2.0, None), first(2.0, 1)) == (2.0, -2.0)
    assert variants(tmp_path) == Variants(2, 0, 0)
    again = kernel()
    assert (again(2.0, 1), again(2.0, None)) == (-2.0, 2.0)
    assert hits(again) == 2


def test_one_process_writes_at_a_time(kernel, tmp_path):
    """While another process holds the cache, a kernel waits, and then sees what that one wrote."""
    one, other = kernel(), kernel()
    one(1.0, None)
    results = []
    (path,), (index,) = tmp_path.rglob(".lock"), tmp_path.rglob("*.nbi")
    before = index.read_bytes()
    with path.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        waiting = threading.Thread(target=lambda: results.append(other(1.0, 1)))
        waiting.start()
        waiting.join(timeout=1.0)
        assert waiting.is_alive()
        assert index.read_bytes() == before
    waiting.join()
    assert results == [-1.0]
    assert variants(tmp_path) == Variants(2, 0, 0)


def flipped(data, place, bit=0):
    """Return the bytes with one bit changed."""
    return data[:place] + bytes([data[place] ^ 1 << bit]) + data[place + 1 :]


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", ["nothing", "text", "shorter", "longer", *range(6)])
def test_a_damaged_file_is_compiled_again_and_replaced(kernel, tmp_path, ending, damage):
    kernel()(2.0, 1)
    (file,) = tmp_path.rglob(f"*.{ending}")
    data = file.read_bytes()
    if isinstance(damage, int):
        place, bit = np.random.default_rng(damage).integers([len(data), 8]).tolist()
        changed = flipped(data, place, bit)
    else:
        words = {"nothing": b"", "text": b"\x80\x04no pickle", "shorter": data[:-1]}
        changed = words.get(damage, data + b"\0")
    file.write_bytes(changed)
    assert variants(tmp_path) == Variants(0, 0, 1)
    again = kernel()
    assert (again(2.0, 1), hits(again)) == (-2.0, 0)
    assert variants(tmp_path) == Variants(1, 0, 0)
    assert file.read_bytes() != changed
    mended = kernel()
    assert (mended(2.0, 1), hits(mended)) == (-2.0, 1)


def test_a_changed_bit_of_a_constant_does_not_change_the_result(kernel, tmp_path):
    """A loader without checksums would accept machine code with another constant."""
    kernel(scaled)(1.0)
    (file,) = tmp_path.rglob("*.nbc")
    data = file.read_bytes()
    place = data.index(struct.pack("<d", CONSTANT))
    file.write_bytes(flipped(data, place + 5))
    assert kernel(scaled)(1.0) == CONSTANT


def test_machine_code_of_another_variant_under_the_same_name(kernel, tmp_path):
    """A process that is killed between writing the two files of a variant may leave this."""
    first = kernel()
    assert (first(2.0, None), first(2.0, 1)) == (2.0, -2.0)
    one, other = tmp_path.rglob("*.nbc")
    one.write_bytes(other.read_bytes())
    assert variants(tmp_path) == Variants(1, 0, 1)
    again = kernel()
    assert (again(2.0, None), again(2.0, 1), hits(again)) == (2.0, -2.0, 1)


def test_a_missing_file_counts_as_damaged(kernel, tmp_path):
    kernel()(2.0, 1)
    next(tmp_path.rglob("*.nbc")).unlink()
    assert variants(tmp_path) == Variants(0, 0, 1)


def test_machine_code_of_another_processor(kernel, tmp_path, monkeypatch):
    kernel()(2.0, 1)
    monkeypatch.setattr(_cache, "target", lambda: ("another", "processor", ""))
    assert variants(tmp_path) == Variants(0, 1, 0)


def test_machine_code_with_vectors_of_another_width(kernel, tmp_path, monkeypatch):
    kernel()(2.0, 1)
    monkeypatch.setattr(_numba, "SET_BITS", 64)
    assert variants(tmp_path) == Variants(0, 1, 0)
    again = kernel()
    assert (again(2.0, 1), hits(again)) == (-2.0, 0)
    assert variants(tmp_path) == Variants(1, 1, 0)


def test_a_kernel_computes_although_the_disk_is_full(kernel, tmp_path, monkeypatch):
    def full(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(CheckedFiles, "_open_for_write", full)
    assert kernel()(2.0, 1) == -2.0
    assert variants(tmp_path) == Variants(0, 0, 0)


def test_machine_code_that_can_only_be_read_is_read(kernel, tmp_path, monkeypatch):
    """An administrator compiled it; what is missing there is kept in the user's own directory."""
    kernel()(2.0, 1)
    own, write = tmp_path / "own", CheckedFiles._open_for_write

    def only_own(files, path):
        if not Path(path).is_relative_to(own):
            raise OSError(30, "Read-only file system")
        return write(files, path)

    monkeypatch.setattr(CheckedFiles, "_open_for_write", only_own)
    monkeypatch.setattr(_jit, "read_only_caches", (tmp_path,))
    for directory, found in ((None, 1), (own, 1), (own, 2)):
        monkeypatch.setattr(_jit, "cache_directory", directory)
        again = kernel()
        assert (again(2.0, 1), again(2.0, None), hits(again)) == (-2.0, 2.0, found)
    assert variants(own) == Variants(1, 0, 0)


def test_where_machine_code_is_kept_and_where_it_is_read(tmp_path, monkeypatch):
    """A directory that cannot be written is read; a user without a home has no other."""
    compiled = tmp_path / "compiled" / "vibrosweep-kernels" / _jit.sources_digest()
    compiled.mkdir(parents=True)
    monkeypatch.setattr(_cache, "__file__", str(tmp_path / "package" / "_cache.py"))
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "__pycache__").symlink_to(tmp_path / "compiled")
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    beside = tmp_path / "package" / "__pycache__" / "vibrosweep-kernels" / compiled.name
    assert _cache.find_caches(compiled.name) == (beside, ())

    real = tempfile.TemporaryFile

    def read_only(**place):
        if place["dir"] == beside:
            raise OSError(30, "Read-only file system")
        return real(**place)

    monkeypatch.setattr(tempfile, "TemporaryFile", read_only)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    own = tmp_path / "home" / ".cache" / "vibrosweep-kernels" / compiled.name
    assert _cache.find_caches(compiled.name) == (own, (beside,))

    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", homeless)
    assert _cache.find_caches(compiled.name) == (None, (beside,))
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "compiled"))
    assert _cache.find_caches(compiled.name) == (compiled, ())
