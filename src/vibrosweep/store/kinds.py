"""Every kind of result that this package writes, and who can say what of it.

An attribute of the file names its kind.  What summarises and draws a kind stands in layers above
this one: it is named here and loaded when it is used.
"""

from __future__ import annotations

import os
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

__all__ = ["KIND", "KINDS", "SWEEP", "Kind", "kind_of", "load_dataset", "read_kind"]

# Attribute of a file that names its kind.
KIND: Final = "result"
_PROVES: Final = "the reference proves landings of single trajectories from their launch, and"


@dataclass(frozen=True)
class Kind:
    """One kind of result.

    Attributes
    ----------
    name
        As the attribute of the file says it.
    command
        What makes it.
    summary
        ``module:function`` from its dataset to lines of text; empty where the file is read piece
        by piece instead.
    drawing
        ``module:function`` from its dataset to a figure; empty where there is none.
    stem
        Name of the file of its figure, without the ending.
    undrawn
        Why its dataset alone gives no figure, and what does.
    unverified
        Why ``vibrosweep verify`` cannot judge it; empty where it can.
    """

    name: str
    command: str
    summary: str = ""
    drawing: str = ""
    stem: str = ""
    undrawn: str = ""
    unverified: str = ""

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
            "vibrosweep.analysis.windows:summary",
            "vibrosweep.figures.stability_windows:stability_windows",
            "stability_windows",
            unverified=f"{_PROVES} this holds ends of intervals of amplitude",
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
    """Return the kind of a file from its attributes; without any it may be a foreign file.

    Raises
    ------
    DataError
        It is of a kind that only another version of this package knows.
    """
    name = str(attributes.get(KIND, SWEEP.name))
    if name not in KINDS:
        raise DataError(
            f"{path}: is a result of the kind {name!r}, which this version of vibrosweep does not "
            f"know; use the version that wrote it"
        )
    return KINDS[name]


def read_kind(path: Path) -> Kind:
    """Return the kind of a result file.

    Raises
    ------
    DataError
        There is no such file, or it is not a result that can be read.
    """
    with reading(path), h5netcdf.File(path, "r", phony_dims="access") as file:
        return kind_of(path, file.attrs)


def load_dataset(path: Path) -> xr.Dataset:
    """Read a result into memory that is no sweep.

    Raises
    ------
    DataError
        There is no such file, or it is not a result that can be read.
    """
    import xarray as xr

    with reading(path):
        return xr.load_dataset(path, engine="h5netcdf")


def _named(path: str) -> Any:
    module, _, name = path.partition(":")
    return getattr(import_module(module), name)
