"""Provenance of a dataset: versions, processor, source revision."""

from __future__ import annotations

import platform
from collections.abc import Callable
from datetime import UTC, datetime
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Final

from vibrosweep._version import __version__

__all__ = ["provenance"]

CONVENTIONS: Final = "CF-1.11"
version: Callable[[str], str] = cache(metadata.version)  # uncached, it reads files at each call
LIBRARIES: Final = ("numpy", "numba", "llvmlite", "h5py", "h5netcdf")


def provenance(threads: int) -> dict[str, str | int]:
    """Return attributes that state the program, libraries, machine and time of a computation."""
    attributes: dict[str, str | int] = {
        "Conventions": CONVENTIONS,
        "source": f"vibrosweep {__version__}",
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "libraries": " ".join(f"{name} {version(name)}" for name in LIBRARIES),
        "python": platform.python_version(),
        "cpu": _processor(),
        "threads": threads,
    }
    revision = _revision()
    if revision:
        attributes["git_revision"] = revision
    return attributes


def _processor() -> str:
    """Return the model name of the processor as the system reports it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.machine()


def _revision() -> str:
    """Return the git revision of the source tree; empty for an installed package."""
    git = Path(__file__).parents[3] / ".git"
    try:
        head = (git / "HEAD").read_text(encoding="utf-8").strip()
        if not head.startswith("ref: "):
            return head
        reference = git / head.removeprefix("ref: ")
        return reference.read_text(encoding="utf-8").strip()
    except OSError:
        return ""
