"""The kinds of result files, and the functions that summarise and draw each.

An attribute of the file names its kind.  The functions belong to layers above this one, so they are
given by name here and imported when they are called.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import h5netcdf

from vibrosweep.errors import DataError
from vibrosweep.store.reading import reading

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

# Attribute of a file that names its kind.
KIND: Final = "result"
_PROVES: Final = "the reference proves landings of single trajectories from their launch, and"


@dataclass(frozen=True)
class Kind:
    """One kind of result."""

    name: str  # value of the attribute in the file
    command: str  # command that makes it
    # ``module:function`` from the dataset to lines of text; empty if the file is read piece by
    # piece instead
    summary: str = ""
    drawing: str = ""  # ``module:function`` from the dataset to a figure; empty if there is none
    stem: str = ""  # file name of the figure, without its extension
    undrawn: str = ""  # why the dataset alone does not give a figure, and what does
    unverified: str = ""  # why ``vibrosweep verify`` cannot check it; empty if it can

    def lines(self, dataset: xr.Dataset) -> Iterable[str]:
        """Summarise a dataset of this kind."""
        return _named(self.summary)(dataset)  # type: ignore[no-any-return]

    def draw(self, dataset: xr.Dataset) -> Figure:
        """Draw a dataset of this kind."""
        return _named(self.drawing)(dataset)  # type: ignore[no-any-return]


SWEEP: Final = Kind("sweep", "vibrosweep run")
KINDS: Final[Mapping[str, Kind]] = {
    kind.name: kind
    for kind in (
        SWEEP,
        Kind(
            "windows",
            "vibrosweep windows",
            "vibrosweep.analysis.window_codes:summary",
            "vibrosweep.figures.window_bands:stability_windows",
            "stability_windows",
            unverified=f"{_PROVES} this holds ends of intervals of the forcing",
        ),
        Kind(
            "bifurcation",
            "vibrosweep bifurcation",
            "vibrosweep.analysis.bifurcation:summary",
            "vibrosweep.figures.bifurcation:bifurcation_diagram",
            "bifurcation_diagram",
            unverified=f"{_PROVES} this holds orbits that go on from amplitude to amplitude",
        ),
        Kind(
            "basins",
            "vibrosweep basins",
            "vibrosweep.analysis.basins:summary",
            "vibrosweep.figures.basins:basins_of_attraction",
            "basins_of_attraction",
            unverified=f"{_PROVES} this holds the attractors that launches lead to",
        ),
        Kind(
            "impacts",
            "vibrosweep lab impacts",
            "vibrosweep.lab.lines:impact_lines",
            undrawn="the figure shows the tracks themselves: vibrosweep lab impacts TRACKS "
            "--figures DIR",
            unverified="it holds measurements of a camera, which nothing can prove",
        ),
        Kind(
            "comparison",
            "vibrosweep lab compare",
            "vibrosweep.lab.lines:table_lines",
            "vibrosweep.figures.laboratory:errors_by_case",
            "lab_table4",
            unverified="it holds measurements of a camera, which nothing can prove",
        ),
    )
}


def kind_of(path: str | os.PathLike[str], attributes: Mapping[str, Any]) -> Kind:
    """Return the kind of a file from its attributes; other programs' files have none.

    Raises a DataError where only another version of this package knows the kind.
    """
    name = str(attributes.get(KIND, SWEEP.name))
    if name not in KINDS:
        raise DataError(
            f"{path}: is a result of the kind {name!r}, which this version of vibrosweep does not "
            f"know; use the version that wrote it"
        )
    return KINDS[name]


def read_kind(path: Path) -> Kind:
    """Return the kind of a result file; a DataError where it cannot be read or is no result."""
    with reading(path), h5netcdf.File(path, "r", phony_dims="access") as file:
        return kind_of(path, file.attrs)


def load_dataset(path: Path) -> xr.Dataset:
    """Read a result other than a sweep into memory; errors as of `read_kind`."""
    import xarray as xr

    with reading(path), warnings.catch_warnings():
        # of attributes that do not fit, which another program may have written
        warnings.simplefilter("ignore", xr.SerializationWarning)
        return xr.load_dataset(path, engine="h5netcdf")


def _named(path: str) -> Any:
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)
