"""Comparison of an existing output file with the sweep that is to be written there."""

from __future__ import annotations

import json
from pathlib import Path

from vibrosweep.errors import DataError, OutputError, RunError
from vibrosweep.runs.identity import differences, identity
from vibrosweep.runs.result import identity_in
from vibrosweep.scene.sweep import Sweep
from vibrosweep.store.kinds import SWEEP, kind_of
from vibrosweep.store.parts import read_manifest
from vibrosweep.store.reading import result_file
from vibrosweep.store.rundir import abandon, holding, run_directory


def is_of(spec: Sweep, path: Path) -> bool:
    """Return whether a file is the finished result of exactly this sweep and version."""
    return _changes(spec, path) == []


def kept_text(output: Path) -> str:
    """Return the text of the sweep file in an output or its unfinished run; "" if there is none."""
    directory = run_directory(output)
    manifest = read_manifest(directory) if directory.exists() else None
    if manifest is not None:
        return manifest.text
    try:
        with result_file(output) as file:
            return str(file.attrs.get("sweep_file", ""))
    except DataError:
        return ""


def cleared(spec: Sweep, output: Path) -> bool:
    """Remove the parts that a killed run left beside the finished result of this sweep.

    Returns True if there were any.  An unfinished run of another sweep is kept, and so is a retry.
    """
    if not run_directory(output).exists():
        return False
    try:
        with holding(output) as directory:
            manifest = read_manifest(directory)
            if manifest is not None and differences(manifest.identity, identity(spec)):
                return False
            abandon(directory)
    except (OutputError, RunError):  # nothing can be written here, or another run is at work
        return False
    return True


def origin(spec: Sweep, path: Path) -> str:
    """Describe an existing file and how it differs from the result of this sweep."""
    changes = _changes(spec, path)
    if changes is None:
        return "it is not the result of a sweep, or it is damaged"
    if isinstance(changes, str):
        return changes
    if not changes:
        return "it is the finished result of exactly this sweep"
    return "it is the result of another sweep or version:\n  " + "\n  ".join(changes) + "\n"


def _changes(spec: Sweep, path: Path) -> list[str] | str | None:
    """Return the differences from a file's sweep, or a sentence on its kind; None if foreign."""
    try:
        with result_file(path) as file:
            kind, text = kind_of(path, file.attrs), file.attrs.get("sweep_file")
            before = json.loads(identity_in(file)) if kind is SWEEP else {}
    except DataError:
        return None
    if kind is SWEEP:
        return differences(before, identity(spec))
    same = "this very" if text == spec.text else "another"
    return f"it is a result of {kind.command} from {same} sweep file"
