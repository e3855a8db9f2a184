"""Chunks of a sweep, which are computed independently, and its identity, which resumes a run.

Chunks are reproducible bit for bit.  A run is resumed only if its identity, everything on which its
results depend, is unchanged.  Every field of the sweep is part of the identity, unless `EXEMPT`
lists it with the reason why it cannot change a number.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.engine.measure import measure_all
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import RunError, TableError, VibrosweepError
from vibrosweep.mistakes import toml
from vibrosweep.model.forcing import only_parameters
from vibrosweep.model.observables import Measures, Observable
from vibrosweep.model.parameters import Periods, in_periods, unit_of
from vibrosweep.model.restitution_laws import OUTSIDE
from vibrosweep.model.shapes import Waveform
from vibrosweep.scene.design import (
    Design,
    GivenTable,
    GridAxis,
    Range,
    Realizations,
    chosen,
    open_design,
)
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import Sweep, short_axis
from vibrosweep.store.parts import Columns, Parts
from vibrosweep.store.writing import version

Tick = Callable[[int], object]

# Statistics of this many trajectories take 22 MB, and the fixed cost per batch is negligible
TRAJECTORIES_PER_BATCH: Final = 1 << 19
# This many totals of an observable take 64 MB
TOTALS_PER_BATCH: Final = 1 << 23
# A piece is what one thread computes at a time: trajectories whose forcing periods add up to some
# 20 ms of work, but not so few that preparing them, a millisecond or two, takes longer
PERIODS_PER_PIECE: Final = 1 << 21
LEAST_PER_PIECE, MOST_PER_PIECE = 1 << 14, 1 << 17  # trajectories
PIECES_PER_THREAD: Final = 4  # at least, or threads would end at different times


@dataclass(frozen=True)
class Job:
    """Data from which a process on any machine computes a chunk; can be pickled."""

    spec: Sweep
    parts: Parts  # files of the finished chunks, and the manifest of the run
    rows: tuple[int, ...] = ()  # indices of the realizations to compute; all if empty

    def open(self) -> Realizations:
        """Open the design of the realizations to compute."""
        design = open_design(self.spec)
        return chosen(design, self.rows) if self.rows else design


class Runner(Protocol):
    """Computes chunks in any order: in this process or on other machines."""

    def __call__(self, job: Job, chunks: Sequence[int], tick: Tick, /) -> Mapping[int, str]:
        """Compute chunks and write their parts; return a reason for each failed chunk, by number.

        `tick` is called with the number of realizations computed since its last call.  An error
        that concerns all chunks, such as a full disk, is raised as a VibrosweepError.
        """


def in_process(threads: int) -> Runner:
    """Return a runner that computes chunks in this process, one after the other."""

    def run(job: Job, chunks: Sequence[int], tick: Tick) -> dict[int, str]:
        failed = {}
        for index in chunks:
            try:
                compute_chunk(job, index, threads, tick)
            except VibrosweepError:
                raise
            except Exception as error:  # a failing chunk must not stop the others
                failed[index] = f"{type(error).__name__}: {error}"
        return failed

    return run


class Stream:
    """Rows that arrive in pieces of any length and are taken, in order, in other lengths."""

    def __init__(self, pieces: Iterable[Mapping[str, NDArray[Any]]]) -> None:
        self._pieces = iter(pieces)
        self._rest: Mapping[str, NDArray[Any]] = {}

    def take(self, rows: int) -> Columns:
        """Take the next `rows` rows, or all that are left; empty at the end."""
        taken: list[Columns] = []
        while rows and (piece := self._rest or next(self._pieces, {})):
            size = min(rows, len(piece["status"]))
            taken.append({name: values[:size] for name, values in piece.items()})
            left = size < len(piece["status"])
            self._rest = {name: values[size:] for name, values in piece.items()} if left else {}
            rows -= size
        if len(taken) < 2:
            return taken[0] if taken else {}
        return {name: np.concatenate([piece[name] for piece in taken]) for name in taken[0]}

    def blocks(self, rows: int) -> Iterator[Columns]:
        """Yield all rows, so many at a time."""
        while columns := self.take(rows):
            yield columns


def compute_chunk(job: Job, index: int, threads: int, tick: Tick | None = None) -> int:
    """Compute a chunk and write its part; return the number of its realizations.

    Repeated or simultaneous calls are safe: they write the same bits under the same name, whatever
    the number of threads.  Raises a VibrosweepError if the part cannot be written or if the sweep
    or the version is not that of the run.  If the computation fails twice, raises its error.
    """
    design = _design(job)
    start, stop = job.parts.manifest.bounds(index)
    with Workers(threads) as workers:

        def pieces() -> Iterator[Columns]:
            for piece in compute_rows(job.spec, design, start, stop, workers):
                if tick is not None:
                    tick(piece["status"].size)
                yield piece

        columns = Stream(pieces()).take(stop - start)
    job.parts.write(index, columns)
    return stop - start


_opened: tuple[Job, Realizations] | None = None


def _design(job: Job) -> Realizations:
    """Open the design of a job; keep it for the next chunk of the same job."""
    global _opened  # opening a table or a Latin hypercube may take a second
    opened = _opened
    if opened is None or opened[0] != job:
        began, now = job.parts.manifest.identity, identity(job.spec)
        changes = differences({key: began.get(key, "") for key in now}, now)
        if changes:
            raise RunError(
                f"{job.parts.directory}: this process would compute another sweep than the run "
                f"began with: {'; '.join(changes)}; use the same versions and tables everywhere"
            )
        _opened = opened = (job, job.open())
    return opened[1]


def no_rows(spec: Sweep, design: Realizations) -> Columns:
    """Return the columns of a sweep without rows, which show their types and shapes."""
    sizes = {"realization": 0, **spec.sizes}
    columns = {name: np.empty(0) for name in spec.scene.varying(design.sampled)}
    for variable in spec.scene.measures.variables:
        columns[variable.name] = np.empty([sizes[d] for d in variable.dims], variable.dtype)
    return columns


def bytes_per_realization(spec: Sweep, design: Realizations) -> int:
    """Return the bytes of the results of a realization in memory and in parts."""
    columns = no_rows(spec, design).values()
    return sum(values.itemsize * math.prod(values.shape[1:]) for values in columns)


def compute_rows(
    spec: Sweep, design: Realizations, start: int, stop: int, workers: Workers
) -> Iterator[Columns]:
    """Compute the realizations start, ..., stop - 1 of a sweep, on all threads.

    While the caller uses the columns that it is given, the next ones are computed.

    Yields
    ------
    dict
        Columns as in `no_rows`: parameters that vary and measured variables, each of shape
        (realization, ...).
    """
    size, apart = rows_at_once(spec, design, stop - start, workers.threads)
    starts = range(start, stop, size)
    drawn = (design.take(first, min(first + size, stop)) for first in starts)
    sizes = (min(size, stop - first) for first in starts)
    if apart:
        yield from workers.in_order(
            lambda worker, one: compute_batch(spec, *one, worker), zip(drawn, sizes, strict=True)
        )
        return
    for sampled, rows in zip(drawn, sizes, strict=True):
        # not bound to a name, so that its memory is free before the next batch is computed
        yield compute_batch(spec, sampled, rows, workers)


def compute_batch(
    spec: Sweep, sampled: Mapping[str, Array], size: int, workers: Workers
) -> Columns:
    """Compute realizations of a sweep, whose sampled parameters are given, at once."""
    quantities = spec.scene.timed(sampled, size)
    parameters = only_parameters(quantities)
    try:
        measured = measure_all(parameters, spec.scene, workers)
    except VibrosweepError:
        raise
    except Exception:  # try once more: the failure may have been temporary
        measured = measure_all(parameters, spec.scene, workers)
    return {**{n: quantities[n] for n in spec.scene.varying(sampled)}, **measured}


def rows_at_once(spec: Sweep, design: Realizations, rows: int, threads: int) -> tuple[int, bool]:
    """Return how many of a number of realizations to compute at once, and whether on one thread.

    Many realizations are cut into pieces, each of which one thread draws, computes and converts on
    its own, so that no thread waits for another.  A few, or ones of very many particles, are
    computed on all threads together.
    """
    particles, most = spec.scene.particles, batch_size(spec)
    at_once = PERIODS_PER_PIECE / max(periods_of(spec, design), 1.0)
    piece = min(MOST_PER_PIECE, max(LEAST_PER_PIECE, int(at_once))) // particles
    piece = min(piece, most, rows // (PIECES_PER_THREAD * threads))
    if piece >= max(1, min(LEAST_PER_PIECE // particles, most)):
        return piece, True
    batch = PIECES_PER_THREAD * threads * max(LEAST_PER_PIECE, int(at_once))
    return max(1, min(batch // particles, most, rows)), False


def periods_of(spec: Sweep, design: Realizations) -> float:
    """Return the duration of the first realization in forcing periods."""
    fixed = np.array([spec.scene.inputs.get("frequency", 1.0)])
    frequency = design.take(0, 1).get("frequency", fixed)
    return float(in_periods(spec.scene.duration, frequency)[0])


def batch_size(spec: Sweep) -> int:
    """Return the largest number of realizations that are computed together."""
    widest = max((observable.width for observable in spec.scene.measures.observables), default=1)
    return max(1, min(TRAJECTORIES_PER_BATCH, TOTALS_PER_BATCH // widest) // spec.scene.particles)


# Fields that are not part of the identity, each with the reason
EXEMPT: Final[Mapping[str, str]] = {
    "text": "wording and comments; the values of the text are in the other fields",
    "source": "path of the sweep file",
    "stated": "names of keys; the values of all are in the scene",
    "windows": "keys of `vibrosweep windows`, which a sweep does not use",
    "scene.given": "names of the stated parameters; the values of all are in the inputs",
    "scene.skip": "cycles that are added exactly instead of simulated give the same bits",
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
    elif isinstance(value, GridAxis):
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
