"""The set of figures: name, needed variables, drawing function and file of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vibrosweep.figures import data, records, style, sweeps
from vibrosweep.figures.data import Requirements
from vibrosweep.model.parameters import NOISE
from vibrosweep.store.arranged import flat
from vibrosweep.store.disk import make_directory, replacing

if TYPE_CHECKING:
    import xarray as xr

# Without dates and versions, two drawings of the same data are the same bytes
FORMATS: Final[Mapping[str, Mapping[str, None]]] = {
    "png": {"Software": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
DOTS_PER_INCH: Final = 200
QUARTERS: Final = 4  # parts of the range of a noise

_SOURCES: Final = {
    "record": "the record of every landing: add a [record] section to the sweep file",
    "sweep": "the measures of a sweep: open the result of a sweep file with a [sample] section",
}


@dataclass(frozen=True)
class FigureEntry:
    """One figure of the set."""

    name: str  # in messages
    source: Literal["record", "sweep"]  # dataset from which it is drawn
    needs: Requirements  # requirements on that dataset
    draw: Callable[[xr.Dataset], Axes]
    number: int = 0  # of the figure in the study, 0 if it is in none

    @property
    def file_stem(self) -> str:
        """Name of its files without the ending."""
        return f"fig{self.number}_{self.name}" if self.number else self.name

    def lacking(self, dataset: xr.Dataset | None) -> str | None:
        """Return what the figure needs in order to be drawn; None if it can be."""
        return _SOURCES[self.source] if dataset is None else self.needs.lacking(flat(dataset))


def _height_time_one(record: xr.Dataset) -> Axes:
    return records.height_time(record, [0], records.readable_until(record))


def _height_time_all(record: xr.Dataset) -> Axes:
    return records.height_time(record, None, records.readable_until(record))


@style.styled
def _separation_distribution(sweep: xr.Dataset) -> Axes:
    from vibrosweep.analysis.separations import separation_distribution

    sweep = flat(sweep)
    parts = _by_noise(sweep) or {"": sweep}
    found = [separation_distribution(part) for part in parts.values()]
    names = [
        _counted(name, int(one["known"]), part.sizes["realization"])
        for (name, part), one in zip(parts.items(), found, strict=True)
    ]
    axes = sweeps.separation_distributions(found, names, sweep["contact_time"].values)
    style.head(axes, data.conditions(sweep))
    return axes


def _counted(name: str, known: int, many: int) -> str:
    """Name of a curve with the number of its realizations, if it is the only one or lacks some."""
    number = f"{many} realization{'s' if many > 1 else ''}"
    if known < many:
        number = f"{known} of {number}"
    elif name:
        return name
    return f"{name}: {number}" if name else number


def _by_noise(sweep: xr.Dataset) -> dict[str, xr.Dataset]:
    """Split a sweep at quarters of its range of noise; no parts unless exactly one kind varies."""
    kinds = [name for name in NOISE if name in sweep.variables and data.varies(sweep, name)]
    if len(kinds) != 1:
        return {}
    name, strength = kinds[0], data.quantity(sweep, kinds[0])
    ends = np.linspace(strength.min(), strength.max(), QUARTERS + 1)
    place = np.searchsorted(ends[1:-1], strength, "right")
    found: dict[str, xr.Dataset] = {}
    for k, high in enumerate(ends[1:]):
        rows = np.flatnonzero(place == k)
        if rows.size:
            before = "" if found else f"{data.symbol(name).strip()} "
            after = data.format_units(NOISE[name].units) if k == QUARTERS - 1 else ""
            found[f"{before}to {high:.3g}{after}"] = sweep.isel(realization=rows)
    return found


@style.styled
def _separation_over_chance(sweep: xr.Dataset) -> Axes:
    from vibrosweep.analysis.separations import separations_against_chance

    axes = sweeps.separations_over_chance([separations_against_chance(sweep)], ["this sweep"])
    style.head(axes, data.conditions(sweep), columns=1)
    return axes


def _regimes(sweep: xr.Dataset) -> Axes:
    """Draw the commonest regime of the particles of each realization."""
    sweep = flat(sweep)
    regime = sweep["regime"].transpose("realization", ...)
    codes = np.atleast_1d(regime.attrs["flag_values"])
    each = regime.values.reshape(regime.sizes["realization"], -1)
    commonest = codes[np.argmax([(each == code).sum(axis=1) for code in codes], axis=0)]
    named = regime.attrs | {"long_name": "commonest regime of the particles"}
    sweep = sweep.assign(regime=("realization", commonest, named))
    return sweeps.parameter_plane(sweep, "regime")


def _plane(
    name: str, variable: str, draw: Callable[[xr.Dataset], Axes] | None = None
) -> FigureEntry:
    """A variable over the plane of restitution and forcing, where it was measured."""
    needed = (*sweeps.AXES, variable)
    needs = data.Requirements(needed, varied=sweeps.PLANE_NEEDS.varied)
    return FigureEntry(name, "sweep", needs, draw or partial(_draw_plane, variable))


def _draw_plane(variable: str, sweep: xr.Dataset) -> Axes:
    return sweeps.parameter_plane(sweep, variable)


FIGURES: Final[Mapping[str, FigureEntry]] = {
    entry.name: entry
    for entry in (
        FigureEntry("height_time", "record", records.HEIGHT_NEEDS, _height_time_one, number=1),
        FigureEntry("height_time_all", "record", records.HEIGHT_NEEDS, _height_time_all, number=2),
        FigureEntry(
            "height_against_restitution",
            "sweep",
            sweeps.RESTITUTION_NEEDS,
            sweeps.height_against_restitution,
            number=3,
        ),
        FigureEntry("return_map", "record", records.RETURN_NEEDS, records.return_map, number=4),
        FigureEntry(
            "separation_distribution", "sweep", sweeps.SEPARATION_NEEDS, _separation_distribution
        ),
        FigureEntry(
            "separation_over_chance", "sweep", sweeps.CHANCE_NEEDS, _separation_over_chance
        ),
        _plane("parameter_plane", "dt_min"),
        _plane("plane_of_heights", "rebound_height_max"),
        _plane("plane_of_regimes", "regime", _regimes),
        _plane("plane_of_exponents", "lyapunov_max"),
        _plane("plane_of_slots", "slot_count"),
    )
}


def available(sweep: xr.Dataset | None, record: xr.Dataset | None) -> list[str]:
    """Return the names of the figures that can be drawn, in the order of the set.

    Parameters
    ----------
    sweep
        Result of a sweep, if there is one.
    record
        Record of every landing, if there is one.

    Returns
    -------
    list of str
        The names.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.figures import available
    >>> available(None, vs.simulate())
    ['height_time', 'height_time_all', 'return_map']
    """
    lacking = missing(sweep, record)
    return [name for name in FIGURES if name not in lacking]


def missing(sweep: xr.Dataset | None, record: xr.Dataset | None) -> dict[str, str]:
    """Return the figures that cannot be drawn, each with what it needs."""
    sources = {"sweep": sweep, "record": record}
    reasons = {name: entry.lacking(sources[entry.source]) for name, entry in FIGURES.items()}
    return {name: reason for name, reason in reasons.items() if reason is not None}


def left_out(sweep: xr.Dataset | None, record: xr.Dataset | None) -> str:
    """Say in a line which figures cannot be drawn, and what they need; empty if all can be."""
    needs: dict[str, list[str]] = {}
    for name, reason in missing(sweep, record).items():
        needs.setdefault(reason, []).append(name)
    some = [
        f"{', '.join(names)} need{'s' if len(names) == 1 else ''} {reason}"
        for reason, names in needs.items()
    ]
    return f"left out: {'; '.join(some)}" if some else ""


def save_all(
    sweep: xr.Dataset | None, record: xr.Dataset | None, directory: str | Path
) -> list[Path]:
    """Write every available figure as PNG and PDF; the same data give the same files.

    Parameters
    ----------
    sweep
        Result of a sweep, if there is one.
    record
        Record of every landing, if there is one.
    directory
        Directory for the files; made if it does not exist.  Existing files are replaced.

    Returns
    -------
    list of pathlib.Path
        The files written.

    Raises
    ------
    OutputError
        The directory or a file cannot be written.

    Examples
    --------
    >>> import tempfile, vibrosweep as vs
    >>> from vibrosweep.figures import save_all
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     len(save_all(None, vs.simulate(), folder))
    6
    """
    sources = {"sweep": sweep, "record": record}
    written = []
    for entry in FIGURES.values():
        dataset = sources[entry.source]
        if dataset is None or entry.lacking(dataset) is not None:
            continue
        written += save_formats(style.for_file(entry.draw, dataset), directory, entry.file_stem)
    return written


def save_formats(figure: Figure, directory: str | Path, stem: str) -> list[Path]:
    """Write one figure in every format into a directory, which is made if it does not exist.

    Raises an OutputError if the directory or a file cannot be written.
    """
    make_directory(Path(directory))
    return [save(figure, Path(directory) / f"{stem}.{kind}") for kind in FORMATS]


def save(figure: Figure, path: Path, *, force: bool = True) -> Path:
    """Write a figure in the format of the path's ending, one of `FORMATS`; return the path.

    The file appears when it is complete.  Raises an OutputError if it cannot be written, or exists
    and `force` is false.
    """
    kind = path.suffix[1:]
    with replacing(path, force=force) as disk, mpl.rc_context(style.RC):
        figure.savefig(disk, format=kind, dpi=DOTS_PER_INCH, metadata=dict(FORMATS[kind]))
    return path
