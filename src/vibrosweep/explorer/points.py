"""A result as points of a plane, with the scene behind each point, and curves over it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import vibrosweep as vs
from vibrosweep.abilities import refusal
from vibrosweep.arrays import Array
from vibrosweep.errors import DataError, ParameterError, SpecError
from vibrosweep.model.forcing import FORCINGS, INPUTS, inputs_of
from vibrosweep.model.measures import Regime, known
from vibrosweep.model.parameters import (
    HIGH_BOUNCE,
    LAWS,
    MASSES,
    NOISE,
    SPRUNG,
    STAGGERED,
    Periods,
    Time,
    amount,
)
from vibrosweep.model.restitution_laws import law_in
from vibrosweep.model.shapes import SINE
from vibrosweep.scene.scene import Launch, Scene, stored
from vibrosweep.scene.sweep import batch
from vibrosweep.store.reading import SWEEP, load_dataset, read_kind

SYMBOLS: Final[Mapping[str, str]] = {
    "restitution": "e",
    "amplitude": "A",
    "base_velocity": "V₀",
    "base_displacement": "B",
    "base_acceleration": "Γ",
    "frequency": "f",
    "phase": "φ",
    "gravity": "g",
    "launch_velocity": "v₀",
    "contact_time": "τc",
    "restitution_speed": "vᵣ",
    "mass_ratio": "μ",
    "particle_mass": "m",
    "base_mass": "M",
    "mount_frequency": "f₀",
    "mount_damping": "ζ",
}
_RAISED: Final = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def units_text(units: str) -> str:
    """Units with raised exponents: 'm s-1' becomes 'm s⁻¹'; empty if there is no unit."""
    if units in ("", "1"):
        return ""
    return re.sub(r"(?<=[A-Za-z])-?\d+", lambda found: found[0].translate(_RAISED), units)


def legible(text: object) -> str:
    """Text in which invalid bytes are escaped, since a page cannot hold them."""
    return str(text).encode(errors="backslashreplace").decode()


def label(name: str, words: str, units: str) -> str:
    """Words, symbol and units of a quantity."""
    unit = units_text(units)
    symbol = SYMBOLS.get(name, "")
    return legible(f"{words}{symbol and f' {symbol}'}{unit and f' ({unit})'}")


def input_label(name: str) -> str:
    """Label of a physical parameter: 'launch velocity v₀ (m s⁻¹)'."""
    return label(name, name.replace("_", " "), INPUTS[name].units)


def meanings(attributes: Mapping[Any, Any]) -> dict[int, str]:
    """Meanings of the codes of a variable, from its attributes."""
    codes = np.atleast_1d(attributes["flag_values"]).tolist()
    words = legible(attributes["flag_meanings"]).split()
    return {int(c): word.replace("_", " ") for c, word in zip(codes, words, strict=True)}


# Most forcing periods drawn at first, and fewest from which regimes and exponents are computed
MOST_PERIODS: Final = 100.0
OBSERVED_PERIODS: Final = 2000.0


@dataclass(frozen=True)
class Spread:
    """Launches at equal intervals."""

    first: float = 0.0  # launch of the first particle, forcing periods
    width: float = 1.0  # forcing periods over which they are spread; 1 is ``launch = "staggered"``


@dataclass(frozen=True)
class Choice:
    """A scene to simulate, and further selections of the visitor."""

    # In the choice that all points of a result share, without the inputs in which they differ
    scene: Scene
    # Beginning and end of the window of the result, over which separations are taken; None for all
    # of the drawn motion
    window: tuple[Time, Time] | None = None
    spread: Spread | None = Spread()  # None where the scene lists its launches
    # Parameters of a mount, which sliders keep while the base has no mount
    mount: Mapping[str, float] = field(default_factory=dict)

    @property
    def inputs(self) -> dict[str, float]:
        """Values of all sliders by the names of `vibrosweep.model.forcing.INPUTS`."""
        return {**self.mount, **self.scene.inputs}

    @property
    def launch_time(self) -> tuple[float, ...]:
        """Launch time of each particle, s."""
        scene, spread = self.scene, self.spread or Spread()
        if not isinstance(scene.launch, str):
            return scene.launch
        frequency = scene.inputs["frequency"]
        staggered = np.arange(scene.particles) / (scene.particles * frequency)
        return tuple((staggered * spread.width + spread.first / frequency).tolist())

    @property
    def periods(self) -> float:
        """End of the drawn motion, in forcing periods."""
        number, end = amount(self.scene.duration), self.scene.duration
        return number if isinstance(end, Periods) else number * self.scene.inputs["frequency"]

    def shortened(self, most: float = MOST_PERIODS) -> Choice:
        """Return the same choice, drawn for at most that many forcing periods."""
        return self.lasting(most) if self.periods > most else self

    def lasting(self, periods: float) -> Choice:
        """Return the same choice, drawn for another number of forcing periods."""
        return self._changed(duration=Periods(periods))

    def with_inputs(self, **values: float) -> Choice:
        """Return the same choice with other values of parameters."""
        unused = {**self.inputs, **values}
        names = [name for name in inputs_of(unused, self.scene.base) if name in unused]
        used = {name: unused.pop(name) for name in names}
        return replace(self._changed(inputs=used, given=frozenset(used)), mount=unused)

    def over(self, base: str) -> Choice:
        """Return the choice over another base, with the law of rebound that every base has."""
        if base == self.scene.base:
            return self
        return self._changed(base=base, rebound=LAWS[0]).with_inputs()

    def with_particles(self, particles: int) -> Choice:
        """Return the choice with another number of particles; listed launches become staggered."""
        if particles == self.scene.particles:
            return self
        return self.launched(self.spread or Spread(), particles)

    def launched(self, spread: Spread, particles: int | None = None) -> Choice:
        """Return the choice with launches at equal intervals."""
        number = particles or self.scene.particles
        return replace(self._changed(particles=number, launch=STAGGERED), spread=spread)

    def _changed(self, **fields: Any) -> Choice:
        return replace(self, scene=replace(self.scene, **fields))

    def keywords(self) -> dict[str, Any]:
        """Keywords of `vibrosweep.simulate`."""
        return {**self.scene.inputs, **self.sweep_keywords()}

    def sweep_keywords(self) -> dict[str, Any]:
        """Keywords of `vibrosweep.sweep` for the same particles, without physical parameters."""
        # staggered launches are exact phases of the forcing; in seconds they would be rounded
        scene, staggered = self.scene, self.spread == Spread()
        return {
            "particles": scene.particles,
            "launch": STAGGERED if staggered else list(self.launch_time),
            **_timed("duration", scene.duration),
            "base": scene.base,
            "rebound": scene.rebound,
            **({} if scene.waveform == SINE else {"waveform": scene.waveform.value}),
        }

    def simulate(self) -> xr.Dataset:
        """Every landing, as `vibrosweep.simulate` returns it."""
        return vs.simulate(**self.keywords())

    def observe(self) -> xr.Dataset:
        """Measures over the window of the result, as `vibrosweep.sweep` returns them."""
        begin, end = self.window or (0.0, self.scene.duration)
        until_end = replace(self, scene=replace(self.scene, duration=end))
        coupled = {"joint": True} if self.scene.base == SPRUNG else {}
        return until_end._sweep(separation=True, **_timed("transient", begin), **coupled)

    def settle(self) -> xr.Dataset:
        """Regimes and exponents after `OBSERVED_PERIODS`, as `vibrosweep.sweep` returns them."""
        longer = self.lasting(max(OBSERVED_PERIODS, self.periods))
        return longer._sweep(regimes=True, lyapunov=True)

    def _sweep(self, **measured: Any) -> xr.Dataset:
        return vs.sweep(progress=False, **self.keywords(), **measured)


def _timed(name: str, time: Time) -> dict[str, float]:
    """Return the keyword of a time, in s or in forcing periods."""
    return {f"{name}_periods" if isinstance(time, Periods) else name: amount(time)}


# Variables that colour the plane at first, if they were measured
COLOURS: Final = ("dt_min", "rebound_height_max")
SEPARATIONS: Final = ("dt_min", "dt_min_same_index", "gap_min")
WINDOW_ENDS: Final = ("lower", "upper", "lower, undetermined beyond", "upper, undetermined beyond")
LAUNCHED: Final = "launched_at"
# Dims that only one kind of result has
DIMS: Final = {
    "window": "windows",
    "sample": "bifurcation",
    "attractor": "basins",
    "branch": "branches",
    "curve": "boundaries",
    "orbit": "orbits",
}
OF_LAUNCH: Final = "time of launch (s)"


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
    # Warning about realizations that are re-simulated; empty if none is needed
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


def points_of(dataset: xr.Dataset) -> Points:
    """Points of a dataset in memory; its dims tell of what kind it is."""
    kind = next((name for dim, name in DIMS.items() if dim in dataset.dims), SWEEP.name)
    several = [name for name, v in dataset.data_vars.items() if "particle" in v.dims]
    shown = dataset.drop_vars(several) if kind == SWEEP.name else dataset
    return of_result(shown, Path(dataset.encoding.get("source", "result.h5")), kind)


def of_result(dataset: xr.Dataset, path: Path, kind: str) -> Points:
    """Points of a dataset; raises a DataError for a kind of result without points."""
    makers = {
        SWEEP.name: _of_sweep,
        "windows": _of_windows,
        "bifurcation": _of_bifurcation,
        "basins": _of_basins,
        "orbits": _of_orbits,
        "branches": _of_branches,
    }
    if kind not in makers:
        raise DataError(
            f"{path}: is a result of the kind {kind!r}, which has no plane of realizations; give "
            f"a result of vibrosweep run, windows, bifurcation, basins, orbits or branches"
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
    """Make a point for each impact of continued orbits and of new launches."""
    name = str(diagram.attrs["observable"])
    along = next(str(dim) for dim in diagram[name].dims if dim in FORCINGS)
    measured = ("regime", "lyapunov_largest", "cycle_impacts", "cycle_periods")
    forcings = [n for n in FORCINGS if n in diagram.variables]
    of_launches = {f"launched_{one}": one for one in (name, *measured)}
    ways = {str(one): diagram.sel(direction=one, drop=True) for one in diagram["direction"].values}
    ways["new launches"] = diagram[[*of_launches]].rename(of_launches | {"launch": "particle"})
    parts: list[dict[str, Column]] = []
    for code, one in enumerate(ways.values()):
        values = one[name].transpose(along, "particle", "sample")
        at = row, particle, _ = np.nonzero(np.isfinite(values.values))
        parts.append(
            {n: _column(n, diagram[n], row) for n in forcings}
            | {name: _column(name, values, at)}
            | {"direction": _named("direction of the scan", [*ways], np.full(row.size, code))}
            | {n: _column(n, _numbers(n, one).transpose(along, ...), at[:2]) for n in measured}
            | {"particle": Column("number of the particle", particle.astype(np.float64))}
        )
    columns = {
        n: replace(column, values=np.concatenate([part[n].values for part in parts]))
        for n, column in parts[0].items()
    }
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
        LAUNCHED: Column(OF_LAUNCH, basins["launch_time"].values[column]),
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


def _of_orbits(orbits: xr.Dataset) -> dict[str, Any]:
    """Make a point for each orbit."""
    names = (str(orbits.attrs.get("forcing", "amplitude")), "restitution")
    varied = [name for name in names if name in orbits.variables and orbits[name].ndim]
    across = [*varied, "impact_phase"][0]
    return _of_closed(orbits, orbits["cycle_impacts"], (across, "rebound_velocity"))


def _of_branches(branches: xr.Dataset) -> dict[str, Any]:
    """Make a point for each orbit of each branch."""
    along = str(branches.attrs["along"])
    return _of_closed(branches, branches[along], (along, "rebound_velocity"))


def _of_closed(found: xr.Dataset, each: xr.DataArray, axes: tuple[str, ...]) -> dict[str, Any]:
    """Make a point for each closed orbit, at its first impact; `each` has the dims of the orbits.

    A particle is launched on its orbit: with the phase and the velocity after that impact.
    """
    spread = {}
    for name in map(str, found.variables):
        one = found[name].isel(impact=0, missing_dims="ignore")
        if one.ndim and {*one.dims} <= {*each.dims}:
            spread[name] = one.broadcast_like(each).transpose(*each.dims)
    known = np.isfinite(spread["rebound_velocity"].values)
    columns = {
        name: replace(_column(name, one), values=np.asarray(one.values[known], np.float64))
        for name, one in spread.items()
    }
    forcing = str(found.attrs.get("forcing", "amplitude"))
    varied = tuple(n for n in _given_names(found, forcing) if n in columns)
    shared = _shared(found, forcing)
    given = {
        n: columns[n].values if n in columns else shared.inputs[n] for n in ("frequency", "phase")
    }
    turns = columns["impact_phase"].values - given["phase"] / (2.0 * np.pi)
    columns[LAUNCHED] = Column(OF_LAUNCH, np.mod(turns, 1.0) / given["frequency"])
    columns["launch_velocity"] = Column(
        input_label("launch_velocity"), columns["rebound_velocity"].values
    )
    return {
        "columns": columns,
        "varied": (*varied, "launch_velocity"),
        "base_choice": shared,
        "axes": axes,
        "colour": "stable",
        "remark": "A particle is launched on its orbit; from one that is not stable it departs.",
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


BOUNDARIES: Final = "boundaries"
DASHES: Final = {"saddle node": "solid", "period doubling": "dashed", "corner": "solid"}
# Events at which rounding decides whether the orbit is admissible
TIES: Final = ("grazing", "rest", "grazing at landing")


def with_borders(points: Points, path: Path) -> Points:
    """Return the points with the curves from a file of boundaries.

    Raises a DataError if the file holds something else, or curves of another scene.
    """
    kind = read_kind(path)
    if kind.name != BOUNDARIES:
        raise DataError(f"{path}: is a result of {kind.command}; give one of vibrosweep boundaries")
    found = load_dataset(path)
    scene = points.base_choice.scene
    differs = "but that of the result is"
    for name, expected in (
        ("base", scene.base),
        ("rebound", scene.rebound),
        ("waveform", scene.waveform.text),
        ("restitution_law", scene.restitution_law),
    ):
        if found.attrs[name] != expected:
            raise DataError(f"{path}: its {name} is {found.attrs[name]!r}, {differs} {expected!r}")
    for name in ("frequency", "gravity"):
        values = points.columns[name].values if name in points.columns else scene.inputs[name]
        if np.any(np.asarray(values) != float(found[name])):
            raise DataError(
                f"{path}: its {name} is {float(found[name]):g}, but the result has another"
            )
    borders = tuple(_border(found.isel(curve=i)) for i in range(found.sizes["curve"]))
    return replace(points, borders=borders)


def _border(curve: xr.Dataset) -> Border:
    meaning = meanings(curve["bifurcation"].attrs)[int(curve["bifurcation"])]
    admissible = (curve["admissible"].values == 1) | (meaning in TIES)
    names = ("restitution", str(curve.attrs["forcing"]))
    values = {name: np.where(admissible, curve[name].values, np.nan) for name in names}
    p, q = int(curve["cycle_impacts"]), int(curve["cycle_periods"])
    name = f"{p} in {q} period{'s' if q > 1 else ''}: {meaning}"
    return Border(name, DASHES.get(meaning, "dotdash"), values)
