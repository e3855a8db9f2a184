"""Parts and manifest of a run: whole or absent, and never used when damaged."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep.errors import OutputError, RunError
from vibrosweep.store.parts import MANIFEST, Manifest, Parts, kinds, read_manifest, write_manifest

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
