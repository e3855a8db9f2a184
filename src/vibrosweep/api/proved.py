"""Windows with proofs, which need an optional library."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vibrosweep.analysis.windows import find_windows

if TYPE_CHECKING:
    import xarray as xr

    from vibrosweep.scene.sweep import Sweep

__all__ = ["windows_found"]


def windows_found(spec: Sweep, threads: int) -> xr.Dataset:
    """Find the windows of a sweep, and prove them if the sweep asks for it."""
    if not (spec.windows or {}).get("prove"):
        return find_windows(spec, threads)
    from vibrosweep.proof import prove_windows

    return prove_windows(find_windows(spec, threads), spec.scene)
