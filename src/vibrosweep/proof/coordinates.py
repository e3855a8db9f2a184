"""Check of the coordinates of a dataset against its sweep file, and of the arrays of its axes."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np
from numpy.typing import NDArray

from vibrosweep.engine.landings import launch_times
from vibrosweep.errors import SpecError, TableError
from vibrosweep.model.forcing import INPUTS, inputs_of
from vibrosweep.model.parameters import STAGGERED, STREAM
from vibrosweep.model.ragged_arrays import OF_TRAJECTORIES
from vibrosweep.proof.judgement import Judgement
from vibrosweep.runs.result import identity_in
from vibrosweep.scene.realizations import Realizations, chosen, open_design
from vibrosweep.scene.sweep import Sweep, parse_spec
from vibrosweep.store.dataset import NO_VARIABLE

SWEEP_COORDINATES: Final = (*INPUTS, STREAM, "launch_time", "duration", "transient")
RECORD_COORDINATES: Final = (*INPUTS, "launch_time", "duration", *OF_TRAJECTORIES)
# designs drawn by another library, whose versions may differ
DRAWN_BY_SCIPY: Final = ("latin", "sobol")
# Dimensions whose variables only number them, and the mark of a dimension without a variable
NUMBERED: Final = ("realization", "particle", "impact")
MARK: Final = NO_VARIABLE.partition("%")[0]


@dataclass(frozen=True)
class Expected:
    """Coordinates that the sweep file in a dataset specifies."""

    # Coordinates of all realizations: numbers, or arrays over the particles; the names of those of
    # the record begin with ``record/``
    shared: Mapping[str, Any]
    # Sampled parameters of the rows drawn, each of shape (row,)
    sampled: Mapping[str, NDArray[np.float64]]
    unknown: Mapping[str, str]  # reasons why other coordinates are not known, by name


def expected(path: Path, file: Any, rows: NDArray[np.int64]) -> Expected:
    """Return the coordinates of some increasing rows according to the dataset's sweep file.

    A table with a relative path is looked for beside the dataset.
    """
    names = [*SWEEP_COORDINATES, *(f"record/{name}" for name in RECORD_COORDINATES)]
    try:
        spec = parse_spec(str(file.attrs["sweep_file"]), path)
    except (KeyError, SpecError):
        reason = "the dataset holds no sweep file that this version reads"
        return Expected({}, {}, dict.fromkeys(names, reason))
    shared: dict[str, Any] = {}
    if spec.record is not None:
        record = spec.record
        known = {name: values[0] for name, values in record.timed({}).items()}
        frequency = record.inputs["frequency"]
        known["launch_time"] = launch_times(record.launch, record.particles, frequency)
        known["realization_index"] = np.zeros(record.particles)
        known["particle_index"] = np.arange(record.particles)
        shared = {f"record/{name}": value for name, value in known.items()}
    drawn, reason = _drawn(spec, identity_in(file), rows)
    found, varied = spec.scene.timed(drawn, rows.size), spec.scene.varying(drawn)
    shared |= {name: values[0] for name, values in found.items() if name not in varied}
    if spec.scene.launch != STAGGERED or "frequency" in shared:
        frequency = float(shared.get("frequency", 1.0))
        shared["launch_time"] = launch_times(spec.scene.launch, spec.scene.particles, frequency)
    if reason:
        unknown = [name for name in SWEEP_COORDINATES if name not in shared]
        return Expected(shared, {}, dict.fromkeys(unknown, reason))
    return Expected(shared, {name: found[name] for name in varied}, {})


def _drawn(
    spec: Sweep, identity: str, rows: NDArray[np.int64]
) -> tuple[dict[str, NDArray[np.float64]], str]:
    """Sampled parameters of the rows; NaN, and the reason, where they cannot be known."""
    design = _design(spec, identity)
    if isinstance(design, str):
        # a table decides which parameters are sampled
        every = inputs_of(spec.scene.given, spec.scene.base)
        names, reason = tuple(every if spec.design.name == "table" else spec.design.sampled), design
    elif np.any(rows >= design.realizations):
        reason = f"the sweep file asks for {design.realizations} realizations"
        names = design.sampled
    else:
        return chosen(design, rows.tolist()).take(0, rows.size), ""
    return {name: np.full(rows.size, np.nan) for name in names}, reason


def _design(spec: Sweep, identity: str) -> Realizations | str:
    """Open the design again, or return the reason why it cannot be compared."""
    if spec.design.name in DRAWN_BY_SCIPY:
        drawn = json.loads(identity or "{}").get("scipy", version("scipy"))
        if drawn != version("scipy"):
            return f"drawn by scipy {drawn}, this is {version('scipy')}"
    if isinstance(spec.design.table, Path):
        if not spec.design.table.is_file():
            return f"there is no table {spec.design.table}"
        contents = spec.design.table.read_bytes()
        if hashlib.blake2b(contents, digest_size=8).hexdigest() not in identity:
            return f"the table {spec.design.table} is not the one that was used"
    try:
        return open_design(spec)
    except (SpecError, TableError) as error:
        return f"the design cannot be opened again: {error}"


def judge_axes(path: Path) -> Iterator[Judgement]:
    """Judge the axes of a file and of its record: variables, and arrays that must hold zeros.

    A dimension of netCDF-4 without a variable is an HDF5 array that is never written, and so reads
    as zeros.  A program that saves a dataset again may turn it into a variable that numbers
    realizations, particles or impacts.
    """
    with h5py.File(path) as file:
        for place in ("", "record"):
            group = file.get(place or "/")
            # links may lead out of the file, or in circles
            named = [
                n for n in group or () if isinstance(group.get(n, getlink=True), h5py.HardLink)
            ]
            for name in named:
                axis = group[name]
                if isinstance(axis, h5py.Dataset) and axis.ndim == 1:
                    yield from _judged_axis(f"{place}/{name}".lstrip("/"), axis)


def _judged_axis(name: str, axis: h5py.Dataset) -> Iterator[Judgement]:
    mark = axis.attrs.get("NAME", b"")
    mark = mark.decode(errors="replace") if isinstance(mark, bytes) else str(mark)
    variable = not mark.startswith(MARK)
    if (variable and name.rpartition("/")[2] not in NUMBERED) or axis.dtype.kind not in "iuf":
        return
    values = np.asarray(axis[...])
    right = np.arange(values.size) if variable else np.zeros(values.size)
    wrong = np.flatnonzero(values != right)
    if wrong.size:
        at, value = int(wrong[0]), float(values[wrong[0]])
        complaint = f"is {value!r} at {at}, where a file of vibrosweep has {right[at]:g}"
        yield Judgement(name, None, math.inf, 0.0, None, complaint)
    elif variable:
        yield Judgement(name, None, 0.0, 0.0)
