"""The result file of a sweep: what it declares, and its rows in blocks of one size."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.engine.asked import record_observation
from vibrosweep.engine.landings import launch_times, record_landings
from vibrosweep.engine.observation import Observation
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import RunError
from vibrosweep.model.measures import OPTIONS, RECORD
from vibrosweep.model.parameters import PARAMETERS, Parameter
from vibrosweep.runs.identity import identity
from vibrosweep.runs.notes import notes, silent_defaults
from vibrosweep.spec.design import Design
from vibrosweep.spec.sweep import RecordSpec, SweepSpec
from vibrosweep.store.dataset import Group
from vibrosweep.store.kinds import KIND, SWEEP
from vibrosweep.store.parts import kinds
from vibrosweep.store.provenance import provenance

__all__ = [
    "DURATION",
    "IDENTITY",
    "LAUNCH_TIME",
    "TRANSIENT",
    "Rows",
    "coordinate_attributes",
    "declare",
    "recorded",
    "write_record",
]

Array = NDArray[np.float64]
Columns = Mapping[str, NDArray[Any]]

LAUNCH_TIME: Final = {"units": "s", "long_name": "time of launch"}
DURATION: Final = {"units": "s", "long_name": "end of the observation"}
# Attribute that says what the numbers depend on.
IDENTITY: Final = "identity"
TRANSIENT: Final = {
    "units": OPTIONS["transient"].units,
    "long_name": OPTIONS["transient"].meaning,
}


def coordinate_attributes(parameter: Parameter) -> dict[str, str]:
    """CF attributes of a physical parameter."""
    return {
        "units": parameter.units,
        "long_name": parameter.long_name,
        "symbol": parameter.symbol,
    }


class Rows:
    """Takes rows in pieces of any length and writes them in blocks of one length.

    Where HDF5 places what it is given depends on the pieces; so the file does not depend on how a
    sweep was cut.

    Parameters
    ----------
    file
        Where they go.
    kinds
        Kind of each column, as `vibrosweep.store.parts.kinds` gives it.
    block
        Rows that are written at a time.
    """

    def __init__(self, file: Group, kinds: Mapping[str, str], block: int) -> None:
        self._file = file
        self._kinds = dict(kinds)
        self._block = block
        self._written = 0
        self._pieces: list[Columns] = []
        self._waiting = 0

    def add(self, columns: Columns) -> None:
        """Add rows of every column, as many of each.

        Raises
        ------
        RunError
            They are not the declared columns.
        """
        found = kinds(columns)
        if found != self._kinds:
            wrong = sorted({name for name, _ in found.items() ^ self._kinds.items()})
            raise RunError(
                f"what was computed is not what the result declares: {', '.join(wrong)}; "
                f"this is a fault of vibrosweep: please report it"
            )
        first, rows = 0, len(columns["status"])
        while rows - first:
            taken = min(rows - first, self._block - self._waiting)
            self._pieces.append({n: v[first : first + taken] for n, v in columns.items()})
            self._waiting += taken
            first += taken
            if self._waiting == self._block:
                self.flush()

    def flush(self) -> None:
        """Write what waits for its block to be full."""
        if not self._pieces:
            return
        for name in self._kinds:
            pieces = [piece[name] for piece in self._pieces]
            values = pieces[0] if len(pieces) == 1 else np.concatenate(pieces)
            self._file.write(name, self._written, values)
        self._written += self._waiting
        self._pieces, self._waiting = [], 0


def declare(file: Group, spec: SweepSpec, design: Design, threads: int) -> None:
    """Declare what the file will hold."""
    file.dimensions({"realization": design.realizations, "particle": spec.particles})
    for name, parameter in PARAMETERS.items():
        attributes = coordinate_attributes(parameter)
        if name in design.sampled:
            file.coordinate(name, ("realization",), attributes)
        else:
            file.coordinate(name, (), attributes, np.array(spec.fixed[name]))
    for name, label in design.labels.items():
        file.coordinate(
            name, ("realization",), label.attributes, label.values[: design.realizations]
        )
    _declare_times(file, spec.launch, spec.particles, spec.fixed.get("frequency"), spec.duration)
    file.coordinate("transient", (), TRANSIENT, np.array(spec.measures.transient))
    for variable in spec.measures.variables:
        file.variable(variable)
    file.attributes(
        {
            "title": spec.title,
            KIND: SWEEP.name,
            # parameters that the sweep file does not state
            "defaults": " ".join(silent_defaults(spec, design)),
            "notes": "; ".join(f"{about}: {text}" for about, text in notes(spec, design).items()),
            "rebound": spec.rebound,
            "particles": spec.particles,
            "design": spec.design,
            "seed": spec.seed,
            "impact_budget": spec.measures.impact_budget,
            **({"tolerance": spec.measures.tolerance} if spec.measures.trust else {}),
            "sweep_file": spec.text,
            IDENTITY: json.dumps(identity(spec)),
            **provenance(threads),
        }
    )


def _declare_times(
    file: Group,
    launch: str | tuple[float, ...],
    particles: int,
    frequency: float | None,
    duration: float,
) -> None:
    """Launch times and duration; staggered launches follow the frequency, fixed or not."""
    if frequency is not None or not isinstance(launch, str):
        times = launch_times(launch, particles, frequency or 1.0)
        file.coordinate("launch_time", ("particle",), LAUNCH_TIME, times)
    file.attributes({"launch": launch if isinstance(launch, str) else "listed"})
    file.coordinate("duration", (), DURATION, np.array(duration))


def recorded(record: RecordSpec, budget: int) -> tuple[dict[str, Array], Observation]:
    """Parameters of the recorded scene, and how it is watched."""
    scene = asdict(record)
    parameters = {name: np.array([value]) for name, value in scene.pop("parameters").items()}
    return parameters, record_observation(**scene, impact_budget=budget)


def write_record(file: Group, record: RecordSpec, budget: int, workers: Workers) -> None:
    """Write every landing of the recorded scene, as its own group."""
    parameters, observation = recorded(record, budget)
    found = record_landings(parameters, observation, workers)
    sizes = dict(zip(RECORD["landing_time"].dims, found["landing_time"].shape, strict=True))
    file.dimensions(sizes)
    for name, values in parameters.items():
        file.coordinate(name, (), coordinate_attributes(PARAMETERS[name]), values[0])
    _declare_times(
        file, record.launch, record.particles, record.parameters["frequency"], record.duration
    )
    for name, variable in RECORD.items():
        file.variable(variable)
        file.write(name, 0, found[name])
    file.attributes({"rebound": record.rebound})
