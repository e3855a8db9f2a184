"""What a result file holds, in a few lines, without loading it into memory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import h5netcdf

from vibrosweep.errors import DataError
from vibrosweep.scene import PARAMETERS
from vibrosweep.sweep.summary import Summary
from vibrosweep.variables import SWEEP

__all__ = ["describe"]

ROWS_AT_A_TIME: Final = 1 << 18
PROVENANCE: Final = ("source", "created", "git_revision", "libraries", "python", "cpu", "threads")


def describe(path: Path) -> Iterator[str]:
    """Describe a result file.

    Yields
    ------
    str
        Lines of text.

    Raises
    ------
    DataError
        There is no such file, or it is not a result that can be read.
    """
    if not path.is_file():
        raise DataError(f"{path}: there is no such result file; check the path")
    try:
        with h5netcdf.File(path, "r") as file:
            lines = [*_head(file), *_measures(file)]
    except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:
        raise DataError(
            f"{path}: is not a result of vibrosweep, or is damaged; compute it again with "
            f"vibrosweep run"
        ) from error
    yield from lines


def _head(file: Any) -> Iterator[str]:
    yield str(file.attrs["title"])
    sizes = ", ".join(f"{name} {d.size}" for name, d in file.dimensions.items())
    yield f"dimensions: {sizes}"
    for name in PARAMETERS:
        variable = file.variables[name]
        units = variable.attrs["units"]
        if variable.dimensions:
            values = variable[...]
            spread = f"{values.min():g} ... {values.max():g}"
        else:
            spread = f"{variable[()]:g}"
        yield f"{name:28}{spread} {'' if units == '1' else units}".rstrip()
    yield f"{'rebound':28}{file.attrs['rebound']}"
    for name in ("transient", "duration"):
        yield f"{name:28}{file.variables[name][()]:g} s"
    if "record" in file.groups:
        landings = file.groups["record"].variables["impact_count"][...].sum()
        yield f"{'record of every landing':28}{landings} landings, in the group 'record'"
    for name in PROVENANCE:
        if name in file.attrs:
            yield f"{name:28}{file.attrs[name]}"


def _measures(file: Any) -> Iterator[str]:
    summary = Summary()
    names = [name for name in SWEEP if name in file.variables]
    realizations = file.dimensions["realization"].size
    for start in range(0, realizations, ROWS_AT_A_TIME):
        stop = min(start + ROWS_AT_A_TIME, realizations)
        summary.add({name: file.variables[name][start:stop] for name in names})
    yield from summary.lines()
