"""From camera tracks of real particles to landings, estimates, and a comparison with prediction."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from vibrosweep.lab.compare import compare_tracks
    from vibrosweep.lab.estimation import estimate
    from vibrosweep.lab.impacts import find_impacts
    from vibrosweep.lab.traces import read_trace
    from vibrosweep.lab.track_files import read_tracks

__all__ = ["compare_tracks", "estimate", "find_impacts", "read_trace", "read_tracks"]

# Where each public name stands; numba and xarray are loaded when it is first used.
_HOMES: Final = {
    "compare_tracks": "vibrosweep.lab.compare",
    "estimate": "vibrosweep.lab.estimation",
    "find_impacts": "vibrosweep.lab.impacts",
    "read_trace": "vibrosweep.lab.traces",
    "read_tracks": "vibrosweep.lab.track_files",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'vibrosweep.lab' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
