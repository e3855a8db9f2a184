"""What the numbers of a sweep depend on, key by key: a run continues only with the same of it."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Final

from vibrosweep.errors import TableError
from vibrosweep.kernels._jit import sources_digest
from vibrosweep.sweep.spec import Range, SweepSpec

__all__ = ["differences", "identity"]

# scipy draws two of the designs, and an arcsine of numpy enters every realization
LIBRARIES: Final = ("numpy", "scipy")
# what computes beside the kernels
SOURCES: Final = (
    "asked",
    "chunks",
    "design",
    "engine",
    "following",
    "landings",
    "measuring",
    "observation",
    "orbits",
    "table",
    "workers",
)
LONGEST: Final = 200


def identity(spec: SweepSpec) -> dict[str, str]:
    """Return the identity of a sweep: keys of the sweep file, its table, and the programs.

    The wording of the file plays no part: comments, order, and whether defaults are written out.

    Raises
    ------
    TableError
        The table cannot be read.
    """
    return {key: _short(value) for key, value in _keys(spec)}


def differences(before: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Tell in a line each how two identities differ."""
    keys = dict.fromkeys([*before, *now])
    return [
        f"{key}: was {before.get(key, 'not given')}, is {now.get(key, 'not given')}"
        for key in keys
        if before.get(key) != now.get(key)
    ]


def _keys(spec: SweepSpec) -> Iterator[tuple[str, object]]:
    yield "title", spec.title
    yield from ((name, value) for name, value in spec.fixed.items())
    for name, spread in spec.sampled.items():
        yield name, [spread.low, spread.high] if isinstance(spread, Range) else list(spread.values)
    for name in ("particles", "launch", "duration", "rebound"):
        yield f"scene.{name}", getattr(spec, name)
    for name in ("design", "columns", "realizations", "seed"):
        yield f"sample.{name}", getattr(spec, name)
    if spec.table is not None:
        yield "contents of the table", _digest(spec.table)
    measures = ("transient", "separation", "per_particle", "regimes", "trust", "tolerance")
    for name in (*measures, "impact_budget"):
        yield f"measure.{name}", getattr(spec, name)
    if spec.record is not None:
        scene = asdict(spec.record)
        for name, value in {**scene.pop("parameters"), **scene}.items():
            yield f"record.{name}", value
    yield "kernels", sources_digest()
    yield "engine", _sources()
    for library in LIBRARIES:
        yield library, version(library)


def _short(value: object) -> str:
    """Write a value exactly, or cut and with a digest where it is long."""
    text = value if isinstance(value, str) else repr(value)
    if len(text) <= LONGEST:
        return text
    return f"{text[:60]}... (digest {hashlib.blake2b(text.encode(), digest_size=8).hexdigest()})"


def _digest(table: Path) -> str:
    try:
        return f"digest {hashlib.blake2b(table.read_bytes(), digest_size=8).hexdigest()}"
    except OSError as error:
        raise TableError(f"{table}: cannot be read: {error.strerror}") from error


def _sources() -> str:
    """Digest of the sources that compute beside the kernels."""
    digest = hashlib.blake2b(digest_size=8)
    for name in SOURCES:
        digest.update(Path(__file__).with_name(f"{name}.py").read_bytes())
    return digest.hexdigest()
