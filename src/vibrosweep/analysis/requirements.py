"""Check that a dataset holds what an analysis needs, with a remedy if it does not."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from vibrosweep.errors import DataError
from vibrosweep.model.variables import LYAPUNOV, PER_PARTICLE, RECORD, REGIMES, SWEEP, TRUST

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["remedy", "require"]

MEASURED: Final = {**SWEEP, **PER_PARTICLE, **REGIMES, **TRUST, **LYAPUNOV}


def require(dataset: xr.Dataset, analysis: str, *names: str) -> None:
    """Make sure that a dataset holds the variables or coordinates that an analysis needs.

    Parameters
    ----------
    dataset
        Result of a sweep, or record of every landing.
    analysis
        What the user asked for, as the message names it.
    names
        Variables or coordinates, all of which must be there.

    Raises
    ------
    DataError
        Names every missing variable and, for each, the key of the sweep file that gives it.
    """
    absent = [name for name in names if name not in dataset.variables]
    if absent:
        wanted = "; ".join(f"{name} ({remedy(name)})" for name in absent)
        noun = "variables" if len(absent) > 1 else "variable"
        raise DataError(f"{analysis} needs {noun} that the dataset lacks: {wanted}")


def remedy(name: str) -> str:
    """Say what supplies a variable that a dataset lacks."""
    if name in MEASURED and MEASURED[name].key:
        table, key = MEASURED[name].key.split(".")
        return f"set {key} = true in the [{table}] section of the sweep file"
    if name == "launch_time" or name in RECORD.keys() - SWEEP.keys():
        return "use the result of simulate(), or add a [record] section to the sweep file"
    return "the dataset is not the complete result of a sweep; run the sweep again"
