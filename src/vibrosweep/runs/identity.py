"""The identity of a sweep, which resumes a run: everything on which its results depend.

A run is resumed only if its identity is unchanged.  Every field of the sweep is part of the
identity, unless `EXEMPT` lists it with the reason why it cannot change a number.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from vibrosweep.errors import TableError
from vibrosweep.mistakes import toml
from vibrosweep.model.observables import Observable
from vibrosweep.model.outside_laws import OUTSIDE
from vibrosweep.model.scene_measures import Measures
from vibrosweep.model.shapes import Waveform
from vibrosweep.model.times import Periods, unit_of
from vibrosweep.scene.design import Axis, Design, GivenTable, Range
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import Sweep, short_axis
from vibrosweep.store.provenance import version

# Fields that are not part of the identity, each with the reason
EXEMPT: Final[Mapping[str, str]] = {
    "text": "wording and comments; the values of the text are in the other fields",
    "source": "path of the sweep file",
    "windows": "keys of `vibrosweep windows`, which a sweep does not use",
    "scene.given": "names of the stated parameters; the values of all are in the inputs",
    "scene.skip": "cycles that are counted instead of followed give the same bits",
    "design.table": "path of the table, replaced by a digest of its contents",
    "record.given": "as for the scene",
    "record.skip": "as for the scene",
    "record.measures": "every landing, up to the impact budget of the sweep",
}
# numba and llvmlite compile the kernels, numpy and scipy draw designs
LIBRARIES: Final = ("numpy", "scipy", "numba", "llvmlite")
# Subpackages that could affect the drawing, computing or storing of a sweep
SUBPACKAGES: Final = ("model", "theory", "kernels", "engine", "scene", "store", "runs")
# Fields whose keys in the sweep file have other names
KEYS: Final[Mapping[str, str]] = {
    "scene.inputs": "",
    "scene.measures": "measure",
    "design": "sample",
    "design.name": "sample.design",
    "design.sampled": "",
    "record.inputs": "record",
    "ragged": "record.ragged",
    "scene.waveform.name": "scene.waveform",
    "scene.waveform.tones": "scene.waveform.harmonics",
    "record.waveform.name": "record.waveform",
    "record.waveform.tones": "record.waveform.harmonics",
}
LONGEST: Final = 200


def identity(spec: Sweep) -> dict[str, str]:
    """Return the identity of a sweep: values of the sweep file, its table, and the programs.

    It does not depend on comments, on the order of keys, or on whether defaults are written out.
    Raises a TableError if the table cannot be read.
    """
    found = {key: _short(value) for key, value in _entries("", "", spec)}
    if spec.design.table is not None:
        found["contents of the table"] = _digest(spec.design.table)
    if spec.design.source:
        found["code of the design"] = _short(spec.design.source)
    laws = {getattr(scene, "restitution_law", "") for scene in (spec.scene, spec.record)}
    for law in sorted(laws & {*OUTSIDE}):
        found[f"code of the law {law}"] = OUTSIDE[law].code
    found["programs"] = programs()
    return found | {library: version(library) for library in LIBRARIES}


def differences(before: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Describe each difference between two identities in one line."""
    keys = dict.fromkeys([*before, *now])
    return [
        f"{key}: was {before.get(key, 'not given')}, is {now.get(key, 'not given')}"
        for key in keys
        if before.get(key) != now.get(key)
    ]


def _entries(path: str, key: str, value: Any) -> Iterator[tuple[str, object]]:
    """Yield key and value of every field below a path, as a sweep file gives them."""
    members: Mapping[str, Any] = {}
    if isinstance(value, Sweep | Scene | Design | Measures | Observable | Waveform):
        # a field that is not compared, such as a function, has a digest in another field
        members = {f.name: getattr(value, f.name) for f in fields(value) if f.compare}
    elif isinstance(value, Mapping):
        members = value
    elif isinstance(value, tuple) and any(isinstance(item, Observable) for item in value):
        members = {observable.name: observable for observable in value}
    elif isinstance(value, Range):
        yield key, value.ends
    elif isinstance(value, Axis):
        yield key, short_axis(list(value.values))
    elif isinstance(value, Periods):
        yield key, f"{value.number} {unit_of(value)}"
    elif isinstance(value, str | int | float | tuple):
        if value not in ((), ""):
            yield key, value
    elif value is not None:
        raise TypeError(f"{key}: the identity of a sweep cannot hold {value!r}")
    for name, member in members.items():
        inner = f"{path}.{name}" if path else name
        if inner not in EXEMPT:
            yield from _entries(inner, KEYS.get(inner, f"{key}.{name}" if key else name), member)


def _short(value: object) -> str:
    """Write a value as a sweep file does; shorten a long one and add a digest."""
    text = value if isinstance(value, str) else toml(value)
    if len(text) <= LONGEST:
        return text
    return f"{text[:60]}... (digest {hashlib.blake2b(text.encode(), digest_size=8).hexdigest()})"


def _digest(table: Path | GivenTable) -> str:
    if isinstance(table, GivenTable):
        return f"digest {table.digest}"
    try:
        return f"digest {hashlib.blake2b(table.read_bytes(), digest_size=8).hexdigest()}"
    except OSError as error:
        raise TableError(f"{table}: cannot be read: {error.strerror}") from error


def sources() -> list[Path]:
    """Return the source files that could affect a sweep."""
    package = Path(__file__).parents[1]
    inside = (path for name in SUBPACKAGES for path in (package / name).rglob("*.py"))
    return sorted([*package.glob("*.py"), *inside])


@lru_cache(maxsize=1)
def programs() -> str:
    """Return a digest of the source files that could affect a sweep."""
    digest = hashlib.blake2b(digest_size=8)
    for path in sources():
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
