"""Fast, accurate parameter sweeps of the bouncing ball (vibro-impact).

``simulate`` gives every landing of a small scene, ``run`` computes a sweep file and ``open_sweep``
opens its result; all three return an `xarray.Dataset`.  Importing this package loads neither numba
nor xarray: they are loaded when first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from vibrosweep._version import __version__

if TYPE_CHECKING:
    from vibrosweep.api import open_record, open_sweep, run, simulate

__all__ = ["__version__", "open_record", "open_sweep", "run", "simulate"]


def __getattr__(name: str) -> Any:
    if name in __all__:
        return getattr(import_module("vibrosweep.api"), name)
    raise AttributeError(f"module 'vibrosweep' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
