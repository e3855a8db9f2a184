"""Checks of disk, memory, and the available processors."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path
from typing import Final

from vibrosweep.doctor import Finding
from vibrosweep.runs.chunks import TRAJECTORIES_PER_BATCH
from vibrosweep.runs.driver import available_threads
from vibrosweep.runs.plan import BYTES_PER_TRAJECTORY
from vibrosweep.system import available_memory, physical_memory

GROUP: Final = Path("/sys/fs/cgroup")
# Bytes; about the result of a sweep of a million realizations
LITTLE_DISK: Final = 1 << 28
# Bytes; the libraries alone take a third of this
LITTLE_MEMORY: Final = (1 << 29) + BYTES_PER_TRAJECTORY * TRAJECTORIES_PER_BATCH


def processors(group: Path = GROUP) -> Finding:
    """Check the processors, and the limit of a control group (a container) on CPU time."""
    usable, words = available_threads(), _group_limit(group, "cpu.max")
    limited = len(words) == 2 and words[0] != "max"
    quota = int(words[0]) / int(words[1]) if limited else usable
    state = f"{usable} of {os.cpu_count()} may be used; vibrosweep run takes {usable} threads"
    if quota > usable - 0.5:
        return Finding("processors", state)
    advice = f"give --threads {max(1, round(quota))}, or raise the limit of the container"
    return Finding(
        "processors", state, f"the container grants the time of only {quota:g}: {advice}"
    )


def _group_limit(group: Path, name: str) -> list[str]:
    """Read a limit of a control group, in words; none without a control group."""
    try:
        return (group / name).read_text(encoding="ascii").split()
    except OSError:
        return []


def memory(group: Path = GROUP) -> Finding:
    """Check the memory, and the limit of a control group (a container) on it."""
    available = available_memory()
    state = f"{available / 2**30:.3g} GiB of {physical_memory() / 2**30:.3g} GiB are available"
    limit = _group_limit(group, "memory.max")
    if limit and limit[0] != "max":
        used = _group_limit(group, "memory.current")
        available = min(available, int(limit[0]) - int(used[0] if used else 0))
        state += f", of which this container may take {max(0, available) / 2**30:.3g} GiB"
    if available >= LITTLE_MEMORY:
        return Finding("memory", state)
    advice = "close other programs, or lower --chunk when running"
    return Finding("memory", state, f"less than {LITTLE_MEMORY / 2**30:.2g} GiB: {advice}")


def disk(directory: Path) -> Finding:
    """Check the disk to which results are written."""
    free = shutil.disk_usage(directory).free
    state = f"{free / 2**30:.3g} GiB free in {directory}"
    try:
        with tempfile.TemporaryFile(dir=directory) as file:
            file.write(b"\0" * 4096)
            file.flush()
    except OSError as error:
        advice = "choose another directory for results with -o"
        return Finding("disk", state, f"nothing can be written here ({error.strerror}): {advice}")
    if free < LITTLE_DISK:
        advice = "free some space, or choose another place for results with -o"
        return Finding("disk", state, f"less than {LITTLE_DISK / 2**20:.0f} MiB: {advice}")
    return Finding("disk", state)
