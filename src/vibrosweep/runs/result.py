"""The result of a sweep: its declarations, its rows in blocks of one size, remarks, a summary."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.engine.landings import CountedLandings, Form, launch_times, record_landings
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import RunError
from vibrosweep.kernels._jit import sources_digest
from vibrosweep.model.forcing import (
    ACCELERATION,
    AMPLITUDE,
    INPUTS,
    completed,
    inputs_of,
    only_parameters,
    sources,
)
from vibrosweep.model.measures import (
    IN_FILE,
    LANDINGS_OF_AN_EXPONENT,
    OF_REALIZATIONS,
    OPTIONS,
    RECORD,
    VARIABLES,
    Column,
    Status,
    Variable,
    known,
    ragged_columns,
    wasted,
)
from vibrosweep.model.orbit_theory import FIXED, recognition_periods
from vibrosweep.model.parameters import HIGH_BOUNCE, MOVING, STREAM, Periods, in_periods
from vibrosweep.model.restitution_laws import CONSTANT, range_of
from vibrosweep.runs.chunks import Stream, batch_size, identity, no_rows
from vibrosweep.scene.design import Realizations
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import Sweep
from vibrosweep.store.arranged import REALIZATION, read_rows, row_count, slices
from vibrosweep.store.parts import kinds, run_directory
from vibrosweep.store.reading import KIND, SWEEP
from vibrosweep.store.writing import Group, Writer, creating, provenance

__all__ = ["identity_in"]

Columns = Mapping[str, NDArray[Any]]

LAUNCH_TIME: Final = {"units": "s", "long_name": "time of launch"}
IDENTITY: Final = "identity"  # group and attribute that hold the identity of the sweep
KERNELS: Final = "kernels"  # attribute that holds a digest of the kernels
TIMES: Final[Mapping[str, Mapping[str, str]]] = {
    "duration": {"units": "s", "long_name": "end of the observation"},
    "transient": {"units": OPTIONS["transient"].units, "long_name": OPTIONS["transient"].meaning},
}


def write_rows(
    file: Writer, declared: Mapping[str, str], pieces: Iterable[Columns], block: int | None = None
) -> None:
    """Write rows, which arrive in pieces of any length, as they come or in blocks of one length.

    The layout of data in an HDF5 file depends on the sizes of the writes.  Blocks of one length
    make it independent of the division into chunks.  Raises a RunError unless each piece has the
    columns that were `declared`, as `vibrosweep.store.parts.kinds` gives them.
    """
    checked, written = _checked(pieces, declared), 0
    for columns in checked if block is None else Stream(checked).blocks(block):
        for name, values in columns.items():
            if file.awaits(name):  # axes of a grid are written when they are declared
                file.write(name, written, values)
        written += len(columns["status"])


def _checked(pieces: Iterable[Columns], declared: Mapping[str, str]) -> Iterator[Columns]:
    for columns in pieces:
        if wrong := sorted({name for name, _ in kinds(columns).items() ^ declared.items()}):
            raise RunError(
                f"these columns are not as the result declares them: {', '.join(wrong)}; "
                f"this is a fault of vibrosweep: please report it"
            )
        yield columns


def write_result(
    output: Path,
    spec: Sweep,
    design: Realizations,
    pieces: Iterable[Columns],
    workers: Workers,
    *,
    force: bool,
    counted: CountedLandings | None = None,
) -> Summary:
    """Write the file of a sweep, whose rows arrive in order and in pieces of any length.

    Parameters
    ----------
    output, force
        Arguments of `vibrosweep.store.writing.creating`; the run directory of the output holds the
        unfinished file.
    spec, design
        The sweep.
    pieces
        Its rows.
    workers
        Threads that compute the record of every landing, if the sweep has one.
    counted
        The landings of the record where they have been counted.
    """
    summary = Summary()

    def summarized() -> Iterator[Columns]:
        for columns in pieces:
            yield columns
            summary.add(columns)

    with creating(output, run_directory(output), force=force) as file:
        summary.notes = declare(file, spec, design, workers.threads)
        file.group(IDENTITY).attributes({IDENTITY: json.dumps(identity(spec))})
        write_rows(file, kinds(no_rows(spec, design)), summarized(), batch_size(spec))
        if spec.record is not None:
            note = write_record(file.group(IN_FILE), spec, workers, counted)
            summary.notes = {**summary.notes, **({IN_FILE: note} if note else {})}
    return summary


def declare(file: Writer, spec: Sweep, design: Realizations, threads: int) -> dict[str, str]:
    """Declare dimensions, variables and attributes; return the `notes` that are among these.

    The axes of a grid are its dimensions.
    """
    remarks = notes(spec, design)
    axes = {name: np.array(values) for name, values in spec.design.axes.items()}
    sizes = {name: values.size for name, values in axes.items()}
    sizes = sizes or {REALIZATION: design.realizations}
    file.dimensions({**sizes, **spec.sizes}, tuple(sizes))
    quantities = spec.scene.timed(design.take(0, 1), 1)
    varied = spec.scene.varying(design.sampled)
    for name in varied:
        dims, values = _along(name, spec, axes)
        file.coordinate(name, dims, attributes_of(name), values)
    for name, label in design.labels.items():
        file.coordinate(name, (REALIZATION,), label.attributes, label.values[: design.realizations])
    frequency = None if "frequency" in varied else float(quantities["frequency"][0])
    _declare_launches(file, spec.scene.launch, spec.scene.particles, frequency)
    for name, places in spec.scene.measures.observable_dims.items():
        file.coordinate(name, (name,), {"long_name": name.replace("_", " ")}, np.array(places))
    for variable in spec.scene.measures.variables:
        file.variable(variable)
    for name in quantities:
        if name not in varied:
            file.fixed(name, attributes_of(name), quantities[name][0])
    file.attributes(
        {
            "title": spec.title,
            KIND: SWEEP.name,
            # parameters that the sweep does not state
            "defaults": " ".join(silent_defaults(spec, design)),
            "notes": "; ".join(f"{about}: {text}" for about, text in remarks.items()),
            **attributes_of_scene(spec.scene, design.sampled),
            "particles": spec.scene.particles,
            "design": spec.design.name,
            "seed": spec.design.seed,
            "impact_budget": spec.scene.measures.impact_budget,
            **({"tolerance": spec.scene.measures.tolerance} if spec.scene.measures.trust else {}),
            **{f"source_of_{o.name}": o.source for o in spec.scene.measures.observables},
            "sweep_file": spec.text,
            KERNELS: sources_digest(),
            **provenance(threads),
        }
    )
    return remarks


def identity_in(file: Any) -> str:
    """Return the identity in an open result file, as JSON; empty if it has none.

    Earlier versions stored it as an attribute of the file.
    """
    group = file.groups.get(IDENTITY)
    return str((file if group is None else group).attrs.get(IDENTITY, ""))


def attributes_of_scene(scene: Scene, varied: Collection[str] = ()) -> dict[str, Any]:
    """Return attributes of a dataset that describe its scene; `varied` names varying inputs."""
    shared = {name: value for name, value in scene.inputs.items() if name not in varied}
    limited = range_of(scene.restitution_law, shared)
    return {
        "base": scene.base,
        "rebound": scene.rebound,
        "waveform": scene.waveform.text,
        "restitution_law": scene.restitution_law,
        **({"restitution_law_range": limited} if limited else {}),
        "forcing": scene.forcing(varied),
        **({"noise_seed": scene.noise_seed} if scene.noise(varied) else {}),
        **{f"{n}_periods": t.number for n, t in scene.times.items() if isinstance(t, Periods)},
    }


def attributes_of(name: str) -> Mapping[str, str]:
    """Return the CF attributes of a physical parameter, a time of the observation, or streams."""
    if name in TIMES:
        return TIMES[name]
    if name == STREAM:
        return {"units": "1", "long_name": "stream of random numbers"}
    one = INPUTS[name]
    return {"units": one.units, "long_name": one.long_name, "symbol": one.symbol}


def _along(
    name: str, spec: Sweep, axes: Mapping[str, Array]
) -> tuple[tuple[str, ...], Array | None]:
    """Return the dimensions of a varying quantity, and its values unless they are written by rows.

    On a grid a quantity lies along the axes from which it is computed.
    """
    if not axes:
        return (REALIZATION,), None
    if name in axes:
        return (name,), axes[name]
    if name == STREAM:
        return tuple(axes), None
    follows = {"frequency"} if name in TIMES else sources(name, spec.scene.forcing(axes))
    dims = tuple(axis for axis in axes if axis in follows)
    if len(dims) == len(axes):
        return dims, None
    mesh = np.meshgrid(*(axes[dim] for dim in dims), indexing="ij")
    first = {axis: np.full(mesh[0].size, values[0]) for axis, values in axes.items()}
    varied = {dim: values.ravel() for dim, values in zip(dims, mesh, strict=True)}
    found = spec.scene.timed(first | varied, mesh[0].size)[name]
    return dims, found.reshape(mesh[0].shape)


def _declare_launches(
    file: Writer, launch: str | tuple[float, ...], particles: int, frequency: float | None
) -> None:
    """Declare launch times, except of staggered launches whose frequency varies."""
    if frequency is not None or not isinstance(launch, str):
        times = launch_times(launch, particles, frequency or 1.0)
        file.coordinate("launch_time", ("particle",), LAUNCH_TIME, times)
    file.attributes({"launch": launch if isinstance(launch, str) else "listed"})


def write_record(
    file: Group, spec: Sweep, workers: Workers, counted: CountedLandings | None = None
) -> str:
    """Write every landing of the recorded scene; return a remark if much of it is padding."""
    record, form = spec.record, Form(bool(spec.ragged))
    assert record is not None
    quantities = record.timed({})
    found = record_landings(only_parameters(quantities), record, workers, form, counted)
    variables: dict[str, Column] = {n: (v.dims, found[n], {}) for n, v in RECORD.items()}
    if form.ragged:
        variables = ragged_columns(found, RECORD, record.particles, f"{IN_FILE}_")
    sizes = {REALIZATION: 1, "particle": record.particles}
    for dims, values, _ in variables.values():
        sizes |= zip(dims, values.shape, strict=True)
    file.dimensions(sizes)
    # xarray would take a scalar of this name for the axis of the sweep
    axes = [name for name in quantities if name in INPUTS and file.has_outer(name)]
    for name in quantities:
        if name in axes:
            file.coordinate(name, (REALIZATION,), attributes_of(name), quantities[name])
        elif name in INPUTS:
            file.fixed(name, attributes_of(name), quantities[name][0])
    _declare_launches(file, record.launch, record.particles, record.inputs["frequency"])
    file.fixed("duration", attributes_of("duration"), quantities["duration"][0])
    for name, (dims, values, attributes) in variables.items():
        if form.ragged:
            file.array(name, dims, attributes, values)
        else:
            file.variable(RECORD[name])
            file.write(name, 0, values)
    note = "" if form.ragged else wasted(found["impact_count"], "ragged = true in [record]")
    file.attributes(
        {
            **attributes_of_scene(record),
            # no variable of a ragged record lies along the dimensions of these coordinates
            **({"coordinates": " ".join([*axes, "launch_time"])} if form.ragged else {}),
            **({"notes": note} if note else {}),
        }
    )
    return note


STRONGEST: Final = 100.0  # acceleration of a shaker in g
LONGEST_LAUNCH: Final = 25.0  # forcing periods of a first flight
NEVER_REPEATS: Final = (
    "random motion never repeats: no cycle is searched for, and regimes are at_rest or undetermined"
)


def notes(spec: Sweep, design: Realizations) -> dict[str, str]:
    """Return the remarks on a sweep, by subject; empty if there are none."""
    found = remarks(spec, design)
    if spec.scene.noise(design.sampled):
        found["noise"] = NEVER_REPEATS if spec.scene.measures.regimes else ""
    elif spec.scene.measures.regimes:
        found |= {
            "observation": observation_of_orbits(spec, design),
            "exponents": _short_window(spec, design),
        }
    return {subject: text for subject, text in found.items() if text}


def remarks(spec: Sweep, design: Realizations, *, launched: bool = True) -> dict[str, str]:
    """Return remarks on the scene of a sweep or an analysis, by subject; those without are empty.

    Not `launched` are the orbits of an analysis that starts no particle.
    """
    fastest = {n: _ends(spec, design, n)[1] for n in ("launch_velocity", "frequency")}
    lowest = _ends(spec, design, "gravity")[0]
    return {
        "defaults": _defaults(spec, design, () if launched else ("launch_velocity",)),
        "base": "" if "base" in spec.stated else still_base(spec.scene.forcing(design.sampled)),
        "forcing": _strong_forcing(spec, design),
        "launch": long_launch(**fastest, gravity=lowest) if launched else "",
    }


def silent_defaults(spec: Sweep, design: Realizations) -> dict[str, float]:
    """Return the parameters that a sweep leaves at their defaults while it states others."""
    stated = {*spec.scene.given, *design.sampled}
    silent = [name for name in inputs_of(stated, spec.scene.base) if stated and name not in stated]
    return {name: INPUTS[name].default for name in silent}


def _defaults(spec: Sweep, design: Realizations, unused: Collection[str]) -> str:
    silent = [
        f"{name} {value:g} {INPUTS[name].units}".removesuffix(" 1")
        for name, value in silent_defaults(spec, design).items()
        if name not in unused
    ]
    if {*spec.scene.given, *design.sampled} and "base" not in spec.stated:
        silent.insert(0, f"base {spec.scene.base}")
    return ", ".join(silent)


def still_base(forcing: str) -> str:
    """Return a remark if the motion of a base is given, but by default none moves; else empty."""
    if forcing == AMPLITUDE:
        return ""
    return (
        f'{forcing} is that of a base that moves, but the default, "{HIGH_BOUNCE}", stays at '
        f'height zero and kicks: base = "{MOVING}" lets it move, base = "{HIGH_BOUNCE}" silences '
        f"this note"
    )


def long_launch(launch_velocity: float, frequency: float, gravity: float) -> str:
    """Return a remark if the first flight lasts longer than launches usually do; else empty."""
    periods = 2.0 * launch_velocity / gravity * frequency
    if periods <= LONGEST_LAUNCH:
        return ""
    return (
        f"the first flight lasts up to {periods:.3g} forcing periods: check launch_velocity "
        f"(m s-1) and frequency (Hz)"
    )


def _strong_forcing(spec: Sweep, design: Realizations) -> str:
    """Return a remark if the base is driven more strongly than by any shaker; else empty."""
    forcing = spec.scene.forcing(design.sampled)
    lowest = {name: _ends(spec, design, name)[0] for name in ("restitution", "gravity")}
    highest = {name: _ends(spec, design, name)[1] for name in (forcing, "frequency")}
    given = {name: np.array([value]) for name, value in (lowest | highest).items()}
    return strong_forcing(float(completed(given, spec.scene.waveform)[ACCELERATION][0]), forcing)


def strong_forcing(acceleration: float, forcing: str) -> str:
    """Return a remark if a base is driven more strongly, in g, than any shaker; else empty."""
    if acceleration <= STRONGEST:
        return ""
    units = "g" if forcing == ACCELERATION else INPUTS[forcing].units
    return (
        f"the base accelerates at up to {acceleration:.4g} g, but shakers reach about "
        f"{STRONGEST:g} g at most: check {forcing} ({units}) and frequency (Hz)"
    )


def observation_of_orbits(spec: Sweep, design: Realizations) -> str:
    """Return a remark if the observation is too short to recognise locked orbits; else empty."""
    restitution, frequency = (_ends(spec, design, n) for n in ("restitution", "frequency"))
    return short_observation(spec.scene, restitution[1], frequency[0])


def short_observation(scene: Scene, restitution: float, frequency: float) -> str:
    """Return a remark if a scene is too short to recognise locked orbits; else empty."""
    if scene.base not in FIXED or scene.restitution_law != CONSTANT:
        return ""  # the time that such orbits take to return is not known
    needed = float(recognition_periods(restitution, base=scene.base))
    periods = float(in_periods(scene.duration, np.array([frequency]))[0])
    if periods >= needed:
        return ""
    takes = f"up to {needed:.0f}" if math.isfinite(needed) else "more than any number of"
    enough = f"{needed / frequency:.4g} s"
    if isinstance(scene.duration, Periods):
        enough = f"{needed:.0f} periods"
    longer = f"; {enough} are enough" if math.isfinite(needed) else ""
    return (
        f"an orbit locked to one period takes {takes} periods to return bit for bit at restitution "
        f"{restitution:g}, but {periods:g} are observed: such orbits may "
        f"be called unsettled{longer}"
    )


def _short_window(spec: Sweep, design: Realizations) -> str:
    """Return a remark if the window is too short for the exponent of an orbit; else empty."""
    frequency = np.array(_ends(spec, design, "frequency")[1:])
    begin, end = (
        in_periods(t, frequency) for t in (spec.scene.measures.transient, spec.scene.duration)
    )
    periods = float((end - begin)[0])
    if periods >= LANDINGS_OF_AN_EXPONENT:
        return ""
    return (
        f"a Lyapunov exponent takes {LANDINGS_OF_AN_EXPONENT} landings, but the window has at most "
        f"{periods:g} periods: with fewer landings motion is called unsettled, never aperiodic"
    )


def _ends(spec: Sweep, design: Realizations, name: str) -> tuple[float, float]:
    """Return the smallest and the largest value of a parameter."""
    spread = spec.design.sampled.get(name)
    if spread is not None:
        return spread.ends
    if name in design.sampled:  # a table
        values = design.take(0, design.realizations)[name]
        return float(values.min()), float(values.max())
    return spec.scene.inputs[name], spec.scene.inputs[name]


# Variables that show whether a larger impact budget would change a result
SETTLING: Final = ("status", *(v.name for v in VARIABLES.values() if v.open_by_budget))


@dataclass
class _Spread:
    """Smallest, mean and largest of the finite values, and the number of infinite ones."""

    count: int = 0
    total: float = 0.0
    low: float = np.inf
    high: float = -np.inf
    infinite: dict[float, int] = field(default_factory=dict)

    def add(self, values: NDArray[Any]) -> None:
        for sign in (-np.inf, np.inf):
            if found := int(np.count_nonzero(values == sign)):
                self.infinite[sign] = self.infinite.get(sign, 0) + found
        finite = values[np.isfinite(values)]
        if finite.size:
            self.count += finite.size
            self.total += float(finite.sum())
            self.low = min(self.low, float(finite.min()))
            self.high = max(self.high, float(finite.max()))

    def facts(self) -> dict[str, float | None]:
        """Return the numbers by name."""
        if not self.count:
            return {"min": None, "mean": None, "max": None, "finite": 0}
        mean = self.total / self.count
        return {"min": self.low, "mean": mean, "max": self.high, "finite": self.count}


@dataclass
class Summary:
    """Ranges, means and counts over the realizations of a sweep; add chunks in their order.

    `kept` counts realizations that an interrupted run had computed, `repaired` damaged parts that
    were computed again; `notes` are remarks on the settings of the sweep, by subject.
    """

    realizations: int = 0
    landings: int = 0
    kept: int = 0
    repaired: int = 0
    notes: Mapping[str, str] = field(default_factory=dict)
    spreads: dict[str, _Spread] = field(default_factory=dict)
    codes: dict[str, dict[int, int]] = field(default_factory=dict)

    def add(self, measured: Mapping[str, NDArray[Any]]) -> None:
        """Add the measured variables of a chunk, each of shape (realization, ...)."""
        self.realizations += measured["impact_count"].size
        counts = measured["impact_count"][known("impact_count", measured)]
        # each is below 2^53, their sum may not fit into 64 bits
        self.landings += (int((counts >> 32).sum()) << 32) + int((counts & 0xFFFFFFFF).sum())
        for name, variable in OF_REALIZATIONS.items():
            if name not in measured:
                continue
            if variable.flags:
                codes, counts = np.unique(measured[name], return_counts=True)
                totals = self.codes.setdefault(name, {})
                for code, count in zip(codes.tolist(), counts.tolist(), strict=True):
                    totals[code] = totals.get(code, 0) + count
            else:
                self.spreads.setdefault(name, _Spread()).add(measured[name][known(name, measured)])

    def lines(self) -> Iterator[str]:
        """Yield the summary as lines of a table."""
        yield f"{'':32}{'min':>12}{'mean':>12}{'max':>12}"
        for name, spread in self.spreads.items():
            yield f"{OF_REALIZATIONS[name].label:32}{self._spread(spread)}"
        for name, counts in self.codes.items():
            yield f"{name:32}{_counted(OF_REALIZATIONS[name], counts)}"
        for subject, text in self.notes.items():
            yield f"{subject:32}{text}"
        for code in sorted(self.codes.get("status", {})):
            if code != Status.COMPLETED:
                yield f"{Status(code).meaning}: {Status(code).sentence}"

    def facts(self) -> dict[str, Any]:
        """Return the summary as numbers and texts by name."""
        return {
            "realizations": self.realizations,
            "landings": self.landings,
            "kept": self.kept,
            "repaired": self.repaired,
            "notes": self.notes,
            "variables": {
                **{name: spread.facts() for name, spread in self.spreads.items()},
                **{
                    name: {dict(OF_REALIZATIONS[name].flags)[code]: n for code, n in counts.items()}
                    for name, counts in self.codes.items()
                },
            },
        }

    def _spread(self, spread: _Spread) -> str:
        """Write smallest, mean and largest finite value, and the number of other realizations."""
        undefined = self.realizations - spread.count - sum(spread.infinite.values())
        others = {f"{value:g}": count for value, count in sorted(spread.infinite.items())}
        words = ", ".join(
            f"{what} in {'every realization' if count == self.realizations else count}"
            for what, count in {**others, "undefined": undefined}.items()
            if count
        )
        if not spread.count:
            return f"{words:>36}"
        mean = spread.total / spread.count
        return f"{spread.low:12.5g}{mean:12.5g}{spread.high:12.5g}{words and '   '}{words}"


def _counted(variable: Variable, counts: Mapping[int, int]) -> str:
    """Write the number and the share of each code, in words."""
    meanings = dict(variable.flags)
    total = sum(counts.values())
    parts = (
        f"{meanings[code]} {count} ({count / total:.1%})" for code, count in sorted(counts.items())
    )
    return ", ".join(parts)


def unsettled(columns: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_]:
    """Mark realizations that did not complete, or lack a measure that a larger budget gives."""
    failed = columns["status"] != Status.COMPLETED
    # a realization whose cycles are added exactly completes, but these measures need
    # every landing
    for name in SETTLING[1:]:
        if name in columns:
            failed = failed | ~known(name, columns)
    return np.asarray(failed)


def summary_of(file: Any) -> Summary:
    """Summarise an open result file, without its notes."""
    summary = Summary()
    names = [name for name in OF_REALIZATIONS if name in file.variables]
    for rows in slices(row_count(file)):
        summary.add({name: read_rows(file, name, rows) for name in names})
    return summary
