"""The result of a sweep: its declarations, and its rows in blocks of one size."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.engine.landings import Form, launch_times, record_landings
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import RunError
from vibrosweep.kernels._jit import sources_digest
from vibrosweep.model.forcing import ACCELERATION, INPUTS, sources
from vibrosweep.model.measures import OPTIONS, RECORD
from vibrosweep.model.parameters import STREAM, Parameter
from vibrosweep.model.ragged_arrays import IN_FILE, Column, ragged_columns, wasted
from vibrosweep.model.restitution_laws import range_of
from vibrosweep.model.times import Periods
from vibrosweep.runs.chunks import Stream, batch_size, no_rows
from vibrosweep.runs.identity import identity
from vibrosweep.runs.notes import notes, silent_defaults
from vibrosweep.runs.summary import Summary
from vibrosweep.scene.realizations import Realizations
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import Sweep
from vibrosweep.store.arranged import REALIZATION
from vibrosweep.store.dataset import Group, creating
from vibrosweep.store.kinds import KIND, SWEEP
from vibrosweep.store.parts import kinds
from vibrosweep.store.provenance import provenance
from vibrosweep.store.rundir import run_directory
from vibrosweep.store.writer import Writer

Columns = Mapping[str, NDArray[Any]]

LAUNCH_TIME: Final = {"units": "s", "long_name": "time of launch"}
IDENTITY: Final = "identity"  # group and attribute that hold the identity of the sweep
KERNELS: Final = "kernels"  # attribute that holds a digest of the kernels
TIMES: Final[Mapping[str, Mapping[str, str]]] = {
    "duration": {"units": "s", "long_name": "end of the observation"},
    "transient": {"units": OPTIONS["transient"].units, "long_name": OPTIONS["transient"].meaning},
}


def coordinate_attributes(parameter: Parameter) -> dict[str, str]:
    """Return the CF attributes of a physical parameter.

    The acceleration of the base, whose name states g, has no units: CF has none for g, and xarray
    would write "1" beside the name on axes.
    """
    attributes = {"long_name": parameter.long_name, "symbol": parameter.symbol}
    if parameter.name == ACCELERATION:
        return attributes
    return {"units": parameter.units, **attributes}


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
) -> Summary:
    """Write the file of a sweep, whose rows arrive in order and in pieces of any length.

    Parameters
    ----------
    output, force
        Arguments of `vibrosweep.store.dataset.creating`; the run directory of the output holds the
        unfinished file.
    spec, design
        The sweep.
    pieces
        Its rows.
    workers
        Threads that compute the record of every landing, if the sweep has one.
    """
    summary = Summary(notes=notes(spec, design))

    def summarized() -> Iterator[Columns]:
        for columns in pieces:
            yield columns
            summary.add(columns)

    with creating(output, run_directory(output), force=force) as file:
        declare(file, spec, design, workers.threads)
        file.group(IDENTITY).attributes({IDENTITY: json.dumps(identity(spec))})
        write_rows(file, kinds(no_rows(spec, design)), summarized(), batch_size(spec))
        if spec.record is not None:
            note = write_record(file.group(IN_FILE), spec, workers)
            summary.notes = {**summary.notes, **({IN_FILE: note} if note else {})}
    return summary


def declare(file: Writer, spec: Sweep, design: Realizations, threads: int) -> None:
    """Declare dimensions, variables and attributes; the axes of a grid are its dimensions."""
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
            "notes": "; ".join(f"{about}: {text}" for about, text in notes(spec, design).items()),
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
    others = {**TIMES, STREAM: {"units": "1", "long_name": "stream of random numbers"}}
    return others[name] if name in others else coordinate_attributes(INPUTS[name])


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


def write_record(file: Group, spec: Sweep, workers: Workers) -> str:
    """Write every landing of the recorded scene; return a remark if much of it is padding."""
    record, form = spec.record, Form(bool(spec.ragged))
    assert record is not None
    found = record_landings(record.parameters({}), record, workers, form)
    variables: dict[str, Column] = {n: (v.dims, found[n], {}) for n, v in RECORD.items()}
    if form.ragged:
        variables = ragged_columns(found, RECORD, record.particles, f"{IN_FILE}_")
    sizes = {REALIZATION: 1, "particle": record.particles}
    for dims, values, _ in variables.values():
        sizes |= zip(dims, values.shape, strict=True)
    file.dimensions(sizes)
    quantities = record.timed({})
    # xarray would take a scalar of this name for the axis of the sweep
    axes = [name for name in quantities if name in INPUTS and file.has_outer(name)]
    for name in quantities:
        if name in axes:
            file.coordinate(name, (REALIZATION,), attributes_of(name), quantities[name])
        elif name in INPUTS:
            file.fixed(name, attributes_of(name), quantities[name][0])
    _declare_launches(file, record.launch, record.particles, record.inputs["frequency"])
    file.fixed("duration", TIMES["duration"], quantities["duration"][0])
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
