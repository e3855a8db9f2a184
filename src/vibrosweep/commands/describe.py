"""Short description of a result file, without loading it into memory."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from vibrosweep.model.forcing import FORCINGS, INPUTS
from vibrosweep.model.measures import RESERVED, Status
from vibrosweep.model.parameters import HIGH_BOUNCE
from vibrosweep.model.restitution_laws import CONSTANT
from vibrosweep.model.shapes import SINE_NAME
from vibrosweep.runs.result import SETTLING, summary_of, unsettled
from vibrosweep.store.arranged import read_rows, row_count, slices
from vibrosweep.store.disk import FileState, state_of
from vibrosweep.store.parts import Manifest, Parts, read_manifest, run_directory
from vibrosweep.store.reading import (
    SWEEP,
    ResultKind,
    kind_of,
    load_dataset,
    no_result,
    result_file,
    using,
)

# Largest number of incomplete realizations that are listed
LISTED: Final = 20
PROVENANCE: Final = ("source", "created", "git_revision", "libraries", "python", "cpu", "threads")


def describe(path: Path) -> Iterator[str]:
    """Describe a result file, or an unfinished run if the file does not exist yet, line by line.

    Raises a DataError if there is no such file or it is not a readable result, and a RunError if
    the manifest of an unfinished run is damaged.
    """
    if _unfinished_only(path):
        yield from _unfinished(path)
        return
    with result_file(path) as file:
        kind, lines = kind_of(path, file.attrs), []
        if kind is SWEEP:
            lines = [*_head(file), *summary_of(file).lines(), *_unsettled(file)]
    yield from lines if kind is SWEEP else _other(path, kind)
    if state_of(path) is FileState.MISSING:
        yield "no seal: another program wrote this file, so that damage to it would go unnoticed"


def _unfinished_only(path: Path) -> bool:
    """Whether there is no result yet, but a run of it that is not finished."""
    # Path.exists would raise an error for a name that is too long
    return not os.path.exists(path) and os.path.exists(run_directory(path))  # noqa: PTH110


def facts(path: Path) -> dict[str, Any]:
    """Return what a result file holds, or an unfinished run, as numbers and texts by name.

    Raises errors as `describe` does.
    """
    if _unfinished_only(path):
        manifest, finished = _manifest(path)
        counts = {"chunks": manifest.chunks, "chunks_finished": finished}
        return {"file": path, "finished": False, **counts, "identity": manifest.identity}
    with result_file(path) as file:
        kind = kind_of(path, file.attrs)
        variables: dict[str, dict[str, Any]] = {
            name: {"dimensions": one.dimensions, **_words(one.attrs)}
            for name, one in file.variables.items()
        }
        found = {
            "file": path,
            "finished": True,
            "kind": kind.name,
            "command": kind.command,
            "dimensions": {name: one.size for name, one in file.dimensions.items()},
            "attributes": {name: file.attrs[name] for name in file.attrs},
            "variables": variables,
        }
        if kind is SWEEP:
            for name in (*INPUTS, "transient", "duration"):
                if name in file.variables:
                    low, high = _ends(file.variables[name])
                    variables[name] |= {"min": low, "max": high}
            found["summary"] = summary_of(file).facts()
    return found


def _words(attributes: Mapping[str, Any]) -> dict[str, str]:
    return {name: str(attributes[name]) for name in ("units", "long_name") if name in attributes}


def _other(path: Path, kind: ResultKind) -> Iterator[str]:
    """Describe a result that is not a sweep."""
    dataset = load_dataset(path)
    yield str(dataset.attrs.get("title", path.name))
    yield f"result of {kind.command}"
    yield f"dimensions: {', '.join(f'{name} {size}' for name, size in dataset.sizes.items())}"
    with using(path):
        lines = list(kind.lines(dataset))
    yield from lines
    yield from _provenance(dataset.attrs)


def _unfinished(path: Path) -> Iterator[str]:
    """Describe an unfinished run."""
    manifest, finished = _manifest(path)
    directory = run_directory(path)
    yield f"{path}: is not finished: {finished} of {manifest.chunks} chunks are in {directory}"
    for key, value in manifest.identity.items():
        yield f"{key:32}{value}"


def _manifest(path: Path) -> tuple[Manifest, int]:
    """Return the manifest of an unfinished run, and the number of its finished chunks."""
    directory = run_directory(path)
    manifest = read_manifest(directory)
    if manifest is None:
        raise no_result(path)
    return manifest, len(Parts(directory, manifest).finished())


def _head(file: Any) -> Iterator[str]:
    yield str(file.attrs["title"])
    sizes = ", ".join(f"{name} {d.size}" for name, d in file.dimensions.items())
    yield f"dimensions: {sizes}"
    defaults = str(file.attrs.get("defaults", "")).split()
    for name in (*INPUTS, "transient", "duration"):
        if name == "transient":
            yield f"{'base':32}{file.attrs.get('base', HIGH_BOUNCE)}"
            yield f"{'rebound':32}{file.attrs['rebound']}"
            yield f"{'waveform':32}{file.attrs.get('waveform', SINE_NAME)}"
            yield f"{'restitution_law':32}{file.attrs.get('restitution_law', CONSTANT)}"
        if name in file.variables:
            remark = " (default)" if name in defaults else ""
            if f"{name}_periods" in file.attrs:
                remark = f" ({file.attrs[f'{name}_periods']:g} forcing periods)"
            yield f"{name:32}{_spread(file.variables[name])}{remark}"
    for name, variable in file.variables.items():  # labels and observables of the user
        if name not in RESERVED and name not in INPUTS:
            words = f"{variable.attrs.get('long_name', '')} ({', '.join(variable.dimensions)})"
            yield f"{name:32}{words.strip()}"
    if "record" in file.groups:
        record = file.groups["record"]
        count = record.variables["impact_count"][...]
        form = ", one after the other" if count.ndim == 1 else ""
        yield f"{'record of every landing':32}{count.sum()} landings{form}, in the group 'record'"
        if "notes" in record.attrs:
            yield f"{'':32}{record.attrs['notes']}"
    if file.attrs.get("notes"):
        yield f"{'notes':32}{file.attrs['notes']}"
    yield from _provenance(file.attrs)


def _spread(variable: Any) -> str:
    """Return the value of a coordinate, or its smallest and largest value, with the unit."""
    units = variable.attrs.get("units", "1")
    unit = "" if units == "1" else f" {units}"
    low, high = _ends(variable)
    return f"{low:g} ... {high:g}{unit}" if variable.dimensions else f"{low:g}{unit}"


def _ends(variable: Any) -> tuple[float, float]:
    """Return the smallest and the largest value of a coordinate."""
    if not variable.dimensions:
        return float(variable[()]), float(variable[()])
    ends = [(v.min(), v.max()) for v in (variable[rows] for rows in slices(variable.shape[0]))]
    return float(min(low for low, _ in ends)), float(max(high for _, high in ends))


def _provenance(attributes: Mapping[str, Any]) -> Iterator[str]:
    for name in PROVENANCE:
        if name in attributes:
            yield f"{name:32}{attributes[name]}"


def _unsettled(file: Any) -> Iterator[str]:
    """List the realizations that did not complete."""
    names = [name for name in SETTLING if name in file.variables]
    varied = [name for name in INPUTS if name in file.variables and file.variables[name].dimensions]
    forcing = str(file.attrs.get("forcing", "amplitude"))
    sampled = [name for name in varied if name not in FORCINGS or name == forcing]
    lines: list[str] = []
    total = mendable = 0
    for rows in slices(row_count(file)):
        codes = {name: read_rows(file, name, rows) for name in names}
        places = np.flatnonzero(unsettled(codes))
        total += places.size
        mendable += int(np.count_nonzero(codes["status"][places] <= Status.BUDGET_EXCEEDED))
        for place in places[: LISTED - len(lines)].tolist():
            status = Status(int(codes["status"][place]))
            # other measures are added from the cycle, but these need every landing
            meaning = status.meaning if status else "separations or error bounds undetermined"
            at = slice(rows.start + place, rows.start + place + 1)
            values = (f"{name} {read_rows(file, name, at)[0]:g}" for name in sampled)
            lines.append(f"  {rows.start + place:<10}{', '.join((meaning, *values))}")
    if total:
        some = "" if mendable == total else f" for {mendable} of them"
        retry = f"vibrosweep run --retry-failed --impact-budget N{some}"
        advice = retry if mendable else "a larger impact budget helps none of them"
        yield f"realizations that did not complete: {total}; {advice}"
        yield from lines
    if total > len(lines):
        yield f"  ... and {total - len(lines)} more"
