"""A result as points of a plane, with the realization behind each point."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

import vibrosweep as vs
from vibrosweep.abilities import refusal
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError, ParameterError, SpecError
from vibrosweep.explore.choice import Choice, Spread
from vibrosweep.explore.labels import input_label, label, legible, meanings
from vibrosweep.model.forcing import FORCINGS, INPUTS, inputs_of
from vibrosweep.model.measures import known
from vibrosweep.model.mount import MASSES
from vibrosweep.model.parameters import HIGH_BOUNCE, NOISE, STAGGERED
from vibrosweep.model.restitution_laws import law_in
from vibrosweep.model.status import Regime
from vibrosweep.model.times import Periods, Time
from vibrosweep.scene.scene import Launch, Scene, stored
from vibrosweep.scene.sweep import batch
from vibrosweep.store.kinds import SWEEP, load_dataset, read_kind

if TYPE_CHECKING:
    import xarray as xr

# Variables that colour the plane at first, if they were measured
COLOURS: Final = ("dt_min", "rebound_height_max")
SEPARATIONS: Final = ("dt_min", "dt_min_same_index", "gap_min")
WINDOW_ENDS: Final = ("lower", "upper", "lower, undetermined beyond", "upper, undetermined beyond")
LAUNCHED: Final = "launched_at"
LONGEST_LABEL: Final = 45  # characters that fit beside a plane


@dataclass(frozen=True)
class Column:
    """A quantity of every point."""

    label: str  # words, symbol and units
    values: Array  # shape (point,)
    # Value -> meaning where the values are codes; empty for numbers
    codes: Mapping[int, str] = field(default_factory=dict)
    # True where zero is a special case, not a small number, as for separations
    zero_apart: bool = False


class Border(NamedTuple):
    """A curve over a plane; NaN where its orbit is not admissible."""

    name: str
    dash: str
    values: Mapping[str, Array]  # restitution and forcing


@dataclass(frozen=True)
class Points:
    """Points of a plane."""

    path: Path  # file of the result
    kind: str  # name of the kind of result
    title: str
    columns: Mapping[str, Column]  # name -> possible axis or colour; all of one length
    # Names of the columns that are physical parameters of the realization of a point
    varied: tuple[str, ...]
    base_choice: Choice  # the realization of all points, without the varied parameters
    # axes, colour: names of the columns that are shown at first
    axes: tuple[str, str]
    colour: str
    # Warning about realizations that are simulated again; empty if none is needed
    remark: str = ""
    borders: tuple[Border, ...] = ()  # curves that are drawn over a plane of their parameters

    @property
    def heading(self) -> str:
        """Title, and name of the file."""
        return legible(f"{self.title} ({self.path.name})")

    @property
    def count(self) -> int:
        """Number of points."""
        return next(iter(self.columns.values())).values.size

    def choice(self, index: int) -> Choice:
        """Return the realization of a point."""
        values = {name: float(self.columns[name].values[index]) for name in self.varied}
        chosen = self.base_choice.with_inputs(**values)
        if LAUNCHED in self.columns:
            time = float(self.columns[LAUNCHED].values[index])
            return replace(
                chosen, scene=replace(chosen.scene, particles=1, launch=(time,)), spread=None
            )
        return chosen

    def taken(self, rows: NDArray[np.int64]) -> Points:
        """Return some of the points."""
        columns = {
            name: replace(column, values=column.values[rows])
            for name, column in self.columns.items()
        }
        return replace(self, columns=columns)


def open_points(path: Path) -> Points:
    """Read a result; raises a DataError if it cannot be read or has no points of a plane."""
    kind = read_kind(path)
    if kind is SWEEP:
        with vs.open_sweep(path) as dataset:
            # variables of single particles are large, and are computed again after a click
            several = [name for name, v in dataset.data_vars.items() if "particle" in v.dims]
            return of_result(dataset.drop_vars(several).load(), path, kind.name)
    return of_result(load_dataset(path), path, kind.name)


def of_result(dataset: xr.Dataset, path: Path, kind: str) -> Points:
    """Points of a dataset; raises a DataError for a kind of result without points."""
    makers = {
        SWEEP.name: _of_sweep,
        "windows": _of_windows,
        "bifurcation": _of_bifurcation,
        "basins": _of_basins,
    }
    if kind not in makers:
        raise DataError(
            f"{path}: is a result of the kind {kind!r}, which has no plane of realizations; give "
            f"a result of vibrosweep run, windows, bifurcation or basins"
        )
    base = str(dataset.attrs.get("base", HIGH_BOUNCE))
    law = law_in(dataset.attrs)
    noise = [name for name in NOISE if name in dataset.variables]
    if wrong := refusal(base, analysis="explore", restitution=law, noise=noise):
        raise DataError(f"{path}: {wrong}")
    try:
        found = makers[kind](dataset)
    except ParameterError as error:
        raise DataError(f"{path}: {error}; vibrosweep writes no such result") from error
    title = legible(dataset.attrs.get("title", path))
    points = Points(path=path, kind=kind, title=title, **found)
    if not points.count:
        raise DataError(f"{path}: holds no points that could be shown")
    _require_sound(points)
    return points


def _require_sound(points: Points) -> None:
    """Raise a DataError for realizations that cannot be simulated, and that no command writes."""
    chosen = points.base_choice
    values: dict[str, Any] = {name: points.columns[name].values for name in points.varied}
    values |= chosen.scene.inputs
    bad = [name for name in inputs_of(values, chosen.scene.base) if name not in values]
    try:
        batch({**values, **chosen.sweep_keywords()})
    except SpecError as error:
        bad += [str(mistake.key).rpartition(".")[2] for mistake in error.mistakes]
    if bad:
        raise DataError(
            f"{points.path}: {', '.join(bad)}: is not what vibrosweep writes; compute it again"
        )


def _of_sweep(dataset: xr.Dataset) -> dict[str, Any]:
    """Make a point for each realization."""
    sweep = vs.analysis.flat(dataset)
    along = {str(n): v for n, v in sweep.variables.items() if v.dims == ("realization",)}
    numbers = {n: v for n, v in along.items() if v.dtype.kind in "iufb" and n != "realization"}
    inputs = [name for name in INPUTS if name in numbers]
    columns = {name: _column(name, numbers[name]) for name in inputs}
    columns |= {n: _column(n, _numbers(n, sweep)) for n in numbers if n not in columns}
    index = np.arange(sweep.sizes["realization"], dtype=np.float64)
    columns["number"] = Column("number of the realization", index)
    given = str(sweep.attrs.get("forcing", "amplitude"))
    varied = tuple(n for n in inputs if n in _given_names(sweep, given))
    first = [n for n in varied if n == "restitution" or n in FORCINGS]
    axes = [*first, *(n for n in varied if n not in first), *COLOURS, "number"]
    axes = [name for name in dict.fromkeys(axes) if name in columns]
    colour = next(name for name in (*COLOURS, "impact_count") if name in columns)
    return {
        "columns": columns,
        "varied": varied,
        "base_choice": _shared(sweep, given),
        "axes": (axes[0], axes[1]),
        "colour": colour,
    }


def _of_windows(windows: xr.Dataset) -> dict[str, Any]:
    """Make a point for each end of a window that is not an end of the scan."""
    from vibrosweep.analysis.windows import ENDS, UNDETERMINED_ABOVE, UNDETERMINED_BELOW

    forcing = str(windows.attrs["forcing"])
    symbol = FORCINGS[forcing].symbol
    lower, upper = (windows[f"{symbol}_{end}"] for end in ("min", "max"))
    dims = ("condition", "direction", "restitution", "window")
    ends = np.stack([one.transpose(*dims).values for one in (lower, upper)])
    end, condition, direction, row, window = np.nonzero(np.isfinite(ends))
    at = (end, condition, direction, row, window)
    codes = windows[ENDS.name].transpose(*dims).values[at[1:]]
    unsure = (codes & np.array([UNDETERMINED_BELOW, UNDETERMINED_ABOVE])[end]) > 0
    columns = {
        "restitution": _column("restitution", windows["restitution"], row),
        forcing: Column(input_label(forcing), ends[at]),
        "condition": _named("condition", windows["condition"].values, condition),
        "end": _named("end of the window", WINDOW_ENDS, end + 2 * unsure),
        "direction": _named("direction of the scan", windows["direction"].values, direction),
    }
    return {
        "columns": columns,
        "varied": ("restitution", forcing),
        "base_choice": _shared(windows, forcing),
        "axes": ("restitution", forcing),
        "colour": "condition",
    }


def _of_bifurcation(diagram: xr.Dataset) -> dict[str, Any]:
    """Make a point for each impact."""
    name = str(diagram.attrs["observable"])
    along = next(str(dim) for dim in diagram[name].dims if dim in FORCINGS)
    values = diagram[name].transpose("direction", along, "particle", "sample")
    direction, row, particle, sample = np.nonzero(np.isfinite(values.values))
    orbit = (direction, row, particle)
    forcings = [n for n in FORCINGS if n in diagram.variables]
    columns = {n: _column(n, diagram[n], row) for n in forcings} | {
        name: _column(name, values, (direction, row, particle, sample)),
        "direction": _named("direction of the scan", diagram["direction"].values, direction),
    }
    for measured in ("regime", "lyapunov_largest", "cycle_impacts", "cycle_periods"):
        one = _numbers(measured, diagram).transpose("direction", along, "particle")
        columns[measured] = _column(measured, one, orbit)
    columns["particle"] = Column("number of the particle", particle.astype(np.float64))
    return {
        "columns": columns,
        "varied": (along,),
        "base_choice": _shared(diagram, along),
        "axes": (along, name),
        "colour": "direction",
        "remark": "Here particles are launched at each point, while the diagram continues their "
        "orbits from one point of the forcing to the next: the attractors may differ.",
    }


def _of_basins(basins: xr.Dataset) -> dict[str, Any]:
    """Make a point for each launch."""
    from vibrosweep.analysis.basins import UNSETTLED, name_of

    if "along" in basins.attrs:
        raise DataError(
            f"basins along {basins.attrs['along']} have no page: compute them at one value of it"
        )
    found = basins["basin"].transpose("launch_velocity", "launch_time")
    row, column = (index.ravel() for index in np.indices(found.shape))
    names = [name_of(basins.isel(attractor=i)) for i in range(basins.sizes["attractor"])]
    reached = {i: f"{i + 1}: {name}" for i, name in enumerate(names)}
    if (found == UNSETTLED).any():
        reached[UNSETTLED] = Regime.UNSETTLED.meaning
    columns = {
        LAUNCHED: Column("time of launch (s)", basins["launch_time"].values[column]),
        "launch_velocity": _column("launch_velocity", basins["launch_velocity"], row),
        "basin": Column("attractor", found.values[row, column].astype(np.float64), reached),
        "slot": _column("slot", _numbers("slot", basins).transpose(*found.dims), (row, column)),
    }
    forcing = str(basins.attrs.get("forcing", "amplitude"))
    return {
        "columns": columns,
        "varied": ("launch_velocity",),
        "base_choice": _shared(basins, forcing),
        "axes": (LAUNCHED, "launch_velocity"),
        "colour": "basin",
    }


def _numbers(name: str, dataset: xr.Dataset) -> xr.DataArray:
    """Take a variable; undefined numbers become NaN, while codes have a code for undefined."""
    found = dataset[name]
    return found if "flag_values" in found.attrs else found.where(known(name, dataset))


def _column(name: str, variable: Any, index: Any = slice(None)) -> Column:
    """Take a variable with its attributes, at some indices."""
    attributes = variable.attrs
    words = str(attributes.get("long_name", name.replace("_", " ")))
    if name in INPUTS:
        return Column(input_label(name), np.asarray(variable.values[index], np.float64))
    codes = meanings(attributes) if "flag_values" in attributes else {}
    if len(words) > LONGEST_LABEL:
        words = name.replace("_", " ")
    units = str(attributes.get("units", ""))
    values = np.asarray(variable.values[index], dtype=np.float64)
    return Column(label(name, words, units), values, codes, name in SEPARATIONS)


def _named(words: str, names: Iterable[Any], index: NDArray[Any]) -> Column:
    return Column(words, index.astype(np.float64), {i: legible(n) for i, n in enumerate(names)})


def _given_names(dataset: xr.Dataset, forcing: str) -> tuple[str, ...]:
    """Names of the parameters that define a realization, without those that follow from them."""
    masses = [name for name in MASSES if name in dataset.variables]
    base = str(dataset.attrs["base"])
    return tuple(n for n in inputs_of({forcing, *masses}, base) if n in dataset.variables)


def _shared(dataset: xr.Dataset, forcing: str) -> Choice:
    """Return the choice that all points share, without the parameters in which they differ."""
    given = _given_names(dataset, forcing)
    inputs = {name: float(dataset[name]) for name in given if not dataset[name].ndim}
    listed = dataset.attrs.get("launch", STAGGERED)
    launch: Launch = STAGGERED
    if not isinstance(listed, str):
        launch = tuple(np.ravel(listed).astype(np.float64).tolist())
    elif listed != STAGGERED:
        launch = tuple(dataset["launch_time"].values.tolist())
    begin, end = (_time(dataset, name) for name in ("transient", "duration"))
    scene = Scene(
        particles=int(dataset.attrs["particles"]),
        launch=launch,
        duration=end,
        rebound=str(dataset.attrs["rebound"]),
        base=str(dataset.attrs["base"]),
        waveform=stored(dataset.attrs),
        inputs=inputs,
        given=frozenset(inputs),
    )
    return Choice(scene, (begin, end), Spread() if launch == STAGGERED else None)


def _time(dataset: xr.Dataset, name: str) -> Time:
    """Return a time of the observation in the unit in which it was given."""
    if f"{name}_periods" in dataset.attrs:
        return Periods(float(dataset.attrs[f"{name}_periods"]))
    return float(dataset[name].max()) if name in dataset else 0.0
