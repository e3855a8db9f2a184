"""Some realizations of a finished dataset: what was asked for, and the numbers that came out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import h5netcdf
import numpy as np
from numpy.typing import NDArray

from vibrosweep.errors import DataError, ParameterError
from vibrosweep.scene import LAWS, PARAMETERS, STAGGERED
from vibrosweep.store.provenance import provenance
from vibrosweep.sweep.engine import Observation
from vibrosweep.sweep.run import record_observation
from vibrosweep.variables import PER_PARTICLE, SWEEP, TRUST

__all__ = ["VARIABLES", "Sample", "Scene", "read_sample"]

Array = NDArray[np.float64]

VARIABLES: Final = {**SWEEP, **PER_PARTICLE, **TRUST}


@dataclass(frozen=True)
class Scene:
    """One realization as the reference takes it.

    Attributes
    ----------
    parameters
        Every parameter of `vibrosweep.scene.PARAMETERS`.
    launch_times
        Exact, s; a staggered particle j is launched at j / (particles frequency).
    transient, duration
        Window of the measures, s.
    windowed
        Whether landings before the window are possible; if not, every landing up to the end counts.
    launch_rounding
        Error in s with which a launch is compared with the edges of the window.
    rebound
        ``"rest"`` or ``"reflect"``.
    """

    parameters: Mapping[str, float]
    launch_times: tuple[Fraction, ...]
    transient: float
    duration: float
    windowed: bool
    launch_rounding: float
    rebound: str


@dataclass(frozen=True)
class Sample:
    """Realizations drawn from a dataset.

    Attributes
    ----------
    total
        Number of realizations in the dataset.
    rows
        Indices of those drawn, in increasing order.
    parameters
        Every parameter of `vibrosweep.scene.PARAMETERS`, each of shape (row,).
    observation
        What was launched, watched and measured.
    own
        Whether this version and git revision computed the dataset.
    stored
        The dataset's measured variables, each of shape (row, ...).
    """

    total: int
    rows: NDArray[np.int64]
    parameters: Mapping[str, Array]
    observation: Observation
    own: bool
    stored: Mapping[str, NDArray[Any]]

    def scene(self, row: int) -> Scene:
        """Return the scene of one of the rows."""
        observation, rounding = self.observation, 0.0
        parameters = {name: float(values[row]) for name, values in self.parameters.items()}
        if isinstance(observation.launch, str):
            period = 1 / Fraction(parameters["frequency"])
            steps = range(observation.particles)
            rounding = 2.0**-51 * (observation.duration + float(period))
            launch = tuple(j * period / observation.particles for j in steps)
        else:
            launch = tuple(Fraction(time) for time in observation.launch)
        return Scene(
            parameters=parameters,
            launch_times=launch,
            transient=observation.transient,
            duration=observation.duration,
            windowed=observation.window is not None,
            launch_rounding=rounding,
            rebound=observation.rebound,
        )


def read_sample(path: Path, size: int, seed: int) -> Sample:
    """Draw realizations without replacement; all where there are no more than `size`.

    Raises
    ------
    ParameterError
        The size or the seed is not a number that can be used.
    DataError
        There is no such file, or it is not a result that can be read.
    """
    for name, value, low in (("sample", size, 1), ("seed", seed, 0)):
        if value < low:
            raise ParameterError(f"{name} = {value!r}: must be a whole number, at least {low}")
    try:
        with h5netcdf.File(path, "r", phony_dims="access") as file:
            sample = _drawn(file, size, seed)
    except FileNotFoundError as error:
        raise DataError(f"{path}: there is no such result file; check the path") from error
    except Exception as error:  # what a damaged file makes the library raise has no common base
        raise DataError(
            f"{path}: is not a result of vibrosweep, or is damaged; check the path, or compute it "
            f"again with vibrosweep run"
        ) from error
    _require_sound(path, sample)
    return sample


def _drawn(file: Any, size: int, seed: int) -> Sample:
    total = file.dimensions["realization"].size
    rows = np.arange(total)
    chosen: Any = slice(None)
    if size < total:
        chosen = rows = np.sort(np.random.default_rng(seed).choice(total, size, replace=False))
    here = provenance(threads=1)
    names = [n for n in VARIABLES if n in file.variables]
    return Sample(
        total=total,
        rows=rows,
        parameters={name: _parameter(file.variables[name], chosen, rows) for name in PARAMETERS},
        observation=_observation(file),
        own=all(file.attrs.get(name) == here.get(name) for name in ("source", "git_revision")),
        stored={name: file.variables[name][chosen] for name in names},
    )


def _parameter(variable: Any, chosen: Any, rows: NDArray[np.int64]) -> Array:
    """Values of a parameter at the rows, sampled or fixed."""
    values = variable[chosen] if variable.dimensions else np.full(rows.size, variable[()])
    return np.asarray(values, dtype=np.float64)


def _observation(file: Any) -> Observation:
    launch: str | tuple[float, ...] = STAGGERED
    if file.attrs["launch"] != STAGGERED:
        launch = tuple(file.variables["launch_time"][...].tolist())
    watched = record_observation(
        particles=int(file.attrs["particles"]),
        launch=launch,
        duration=float(file.variables["duration"][()]),
        rebound=str(file.attrs["rebound"]),
        impact_budget=int(file.attrs["impact_budget"]),
    )
    return replace(
        watched,
        transient=float(file.variables["transient"][()]),
        tolerance=float(file.attrs.get("tolerance", math.inf)),
    )


def _require_sound(path: Path, sample: Sample) -> None:
    """Refuse what no sweep can have written, and no kernel should be given."""
    observation = sample.observation
    bad = [n for n, v in sample.parameters.items() if not np.all(PARAMETERS[n].accepts(v))]
    times = () if isinstance(observation.launch, str) else observation.launch
    if not all(map(math.isfinite, (observation.transient, observation.duration, *times))):
        bad.append("transient, duration or launch_time")
    if observation.particles < 1 or (times and len(times) != observation.particles):
        bad.append("particles")
    if observation.rebound not in LAWS:
        bad.append("rebound")
    shapes = {"realization": sample.rows.size, "particle": observation.particles}
    for name, values in sample.stored.items():
        if values.shape != tuple(shapes[d] for d in VARIABLES[name].dims):
            bad.append(name)
    if bad:
        raise DataError(
            f"{path}: {', '.join(bad)}: is not what vibrosweep run writes; compute it again"
        )
