"""A sweep from its spec to its file, chunk by chunk: memory does not grow with its length."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.errors import ParameterError
from vibrosweep.scene import PARAMETERS, Parameter
from vibrosweep.store.dataset import Group, creating
from vibrosweep.store.provenance import provenance
from vibrosweep.sweep.design import Design, open_design
from vibrosweep.sweep.engine import Observation, Workers, measure
from vibrosweep.sweep.landings import launch_times, record_landings
from vibrosweep.sweep.progress import Advance, silent
from vibrosweep.sweep.spec import RecordSpec, SweepSpec
from vibrosweep.sweep.summary import Summary
from vibrosweep.variables import LYAPUNOV, PER_PARTICLE, RECORD, REGIMES, SWEEP, TRUST

__all__ = ["TRAJECTORIES_PER_CHUNK", "available_threads", "record_observation", "run_sweep"]

Array = NDArray[np.float64]

# Statistics of so many trajectories take 15 MB, which the last-level cache of a workstation holds.
TRAJECTORIES_PER_CHUNK: Final = 1 << 18
# Measured at 10^7 trajectories in a chunk, with all measures.
BYTES_PER_TRAJECTORY: Final = 320
LAUNCH_TIME: Final = {"units": "s", "long_name": "time of launch"}
DURATION: Final = {"units": "s", "long_name": "end of the observation"}
TRANSIENT: Final = {"units": "s", "long_name": "beginning of the window that measures cover"}


def available_threads() -> int:
    """Number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_sweep(
    spec: SweepSpec,
    output: Path,
    *,
    threads: int,
    chunk: int | None = None,
    advance: Advance = silent,
) -> Summary:
    """Compute a sweep and write it to `output`, which appears when it is complete.

    Parameters
    ----------
    spec
        What to compute.
    output
        Path of the file; an existing one is replaced.
    threads
        Number of threads; the result does not depend on it.
    chunk
        Realizations computed at a time; the result does not depend on it.
    advance
        Called after each chunk with the number of realizations done and that of all.

    Raises
    ------
    OutputError, TableError, ParameterError
        The file cannot be written, a table cannot be used, or parameters are too extreme.
    """
    design = open_design(spec)
    observation = observation_of(spec)
    size = min(chunk or max(1, TRAJECTORIES_PER_CHUNK // spec.particles), design.realizations)
    _require_memory(size, spec.particles)
    summary = Summary()
    with Workers(threads) as workers, creating(output) as file:
        _declare(file, spec, design, threads)
        for start in range(0, design.realizations, size):
            stop = min(start + size, design.realizations)
            sampled = design.take(start, stop)
            measured = measure(parameters_of(spec, sampled, stop - start), observation, workers)
            for name, values in (*sampled.items(), *measured.items()):
                file.write(name, start, values)
            summary.add(measured)
            advance(stop, design.realizations)
        if spec.record is not None:
            _write_record(file.group("record"), spec.record, spec.impact_budget, workers)
    return summary


def _require_memory(realizations: int, particles: int) -> None:
    needed = BYTES_PER_TRAJECTORY * realizations * particles
    available = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    if needed > available / 2:
        raise ParameterError(
            f"a chunk of {realizations} realizations of {particles} particles needs about "
            f"{needed / 2**30:.3g} GiB of this machine's {available / 2**30:.3g} GiB: lower "
            f"--chunk where it was given, or take fewer particles"
        )


def observation_of(spec: SweepSpec) -> Observation:
    names = Observation.__dataclass_fields__.keys() - {"skip"}
    return Observation(**{name: getattr(spec, name) for name in names})


def record_observation(
    particles: int,
    launch: str | tuple[float, ...],
    duration: float,
    rebound: str,
    impact_budget: int,
) -> Observation:
    """The observation of a scene whose every landing is kept."""
    return Observation(
        particles=particles,
        launch=launch,
        duration=duration,
        rebound=rebound,
        transient=-math.inf,
        separation=False,
        per_particle=False,
        regimes=False,
        trust=False,
        tolerance=math.inf,
        impact_budget=impact_budget,
        skip=False,  # every landing is wanted
    )


def parameters_of(spec: SweepSpec, sampled: Mapping[str, Array], size: int) -> dict[str, Array]:
    """Every parameter of realizations of a sweep, each of shape (realization,)."""
    return {
        name: sampled[name] if name in sampled else np.full(size, spec.fixed[name])
        for name in PARAMETERS
    }


def coordinate_attributes(parameter: Parameter) -> dict[str, str]:
    """CF attributes of a physical parameter."""
    return {
        "units": parameter.units,
        "long_name": parameter.long_name,
        "symbol": parameter.symbol,
    }


def _declare(file: Group, spec: SweepSpec, design: Design, threads: int) -> None:
    """Declare what the file will hold."""
    file.dimensions({"realization": design.realizations, "particle": spec.particles})
    for name, parameter in PARAMETERS.items():
        attributes = coordinate_attributes(parameter)
        if name in design.sampled:
            file.coordinate(name, ("realization",), attributes)
        else:
            file.coordinate(name, (), attributes, np.array(spec.fixed[name]))
    _declare_times(file, spec.launch, spec.particles, spec.fixed.get("frequency"), spec.duration)
    file.coordinate("transient", (), TRANSIENT, np.array(spec.transient))
    for registry in (SWEEP, PER_PARTICLE, REGIMES, TRUST, LYAPUNOV):
        for variable in registry.values():
            asked = variable.key.removeprefix("measure.")
            if not asked or getattr(spec, asked):
                file.variable(variable)
    file.attributes(
        {
            "title": spec.title,
            "rebound": spec.rebound,
            "particles": spec.particles,
            "design": spec.design,
            "seed": spec.seed,
            "impact_budget": spec.impact_budget,
            **({"tolerance": spec.tolerance} if spec.trust else {}),
            "sweep_file": spec.text,
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


def _write_record(file: Group, record: RecordSpec, budget: int, workers: Workers) -> None:
    """Every landing of the recorded scene, as its own group."""
    scene = asdict(record)
    parameters = {name: np.array([value]) for name, value in scene.pop("parameters").items()}
    found = record_landings(parameters, record_observation(**scene, impact_budget=budget), workers)
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
