"""Sobol' indices of heights, flight times and separations with respect to all parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.records import variable
from vibrosweep.arrays import Array
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import DataError, ParameterError
from vibrosweep.mistakes import RANGE
from vibrosweep.model.forcing import INPUTS, completed, forcing_of, inputs_of, only_parameters
from vibrosweep.model.measures import (
    MEASURE_OF,
    OF_REALIZATIONS,
    UNDETERMINED,
    VARIABLES,
    known,
)
from vibrosweep.model.mount import require_mount
from vibrosweep.model.status import Status
from vibrosweep.runs.notes import observation_of_orbits
from vibrosweep.scene.design import Range
from vibrosweep.scene.realizations import open_design
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import Sweep

OUTPUTS: Final = ("rebound_height_max", "rebound_height_mean", "flight_time_mean", "dt_min")
RESAMPLES: Final = 400
BATCH: Final = 4096


def sobol_indices(
    ranges: Mapping[str, tuple[float, float]],
    scene: Scene,
    workers: Workers,
    *,
    fixed: Mapping[str, float] | None = None,
    outputs: Sequence[str] = OUTPUTS,
    base: int = 1024,
    seed: int = 0,
    confidence: float = 0.95,
) -> xr.Dataset:
    """First-order and total Sobol' indices of measured variables, with confidence intervals.

    Each parameter is uniform in its range, independent of the others; the forcing may vary as any
    one of `vibrosweep.model.forcing.FORCINGS`.  The scheme is that of Saltelli (2010) as
    `scipy.stats.sobol_indices`; it takes (parameters + 2) base realizations, `base` a power
    of 2.  Intervals are percentiles of a bootstrap over the base sample.  The scene must
    measure the outputs, variables with one number per realization.  Other parameters are `fixed`,
    by default at Table 1; a base of finite mass needs those of its mount.

    Dims (output, parameter): ``first_order`` and ``total_order``, each with ``_low`` and ``_high``;
    dim ``output``: ``mean`` and ``standard_deviation`` over the sample.  Raises a ParameterError
    where a range, an output or the base is not allowed, or there are two forcings, and a DataError
    where a realization did not complete, or an output is undetermined or undefined in some, or the
    same in all.
    """
    from scipy.stats import qmc

    _require_ranges(ranges, base)
    _require_asked(outputs, confidence)
    require_mount(scene.base, {*ranges, *(fixed or {})})
    low, high = np.array(list(ranges.values()), dtype=np.float64).T
    points = qmc.Sobol(2 * low.size, seed=np.random.default_rng(seed)).random(base)
    a, b = (low + (high - low) * half for half in np.split(points, 2, axis=1))
    mixed = [np.where(np.arange(low.size) == k, b, a) for k in range(low.size)]
    every = dict(zip(ranges, np.concatenate([a, b, *mixed]).T, strict=True))
    found = _measured(every, fixed or {}, scene, workers, outputs)
    parts = found.reshape(len(outputs), 2 + low.size, base)
    first, total = _indices(parts)
    random = np.random.default_rng(seed + 1)
    resampled = np.array(
        [_indices(parts[:, :, random.integers(base, size=base)]) for _ in range(RESAMPLES)]
    )
    tail = (1.0 - confidence) / 2.0
    ends = np.quantile(resampled, [tail, 1.0 - tail], axis=0)
    return _index_dataset(first, total, ends, parts, tuple(outputs), tuple(ranges))


def sobol_of_spec(
    spec: Sweep, outputs: Sequence[str] | None, confidence: float, threads: int
) -> xr.Dataset:
    """Sobol' indices over the ranges of a sweep, as `sobol_indices`.

    Its number of realizations is the size of the base sample.  The outputs are measured; by default
    they are `OUTPUTS`, those of pairs only where there are particles for one.  Raises a SpecError
    where no parameter has a range.
    """
    ranges = {n: (s.low, s.high) for n, s in spec.design.sampled.items() if isinstance(s, Range)}
    if not ranges:
        raise spec.refusal(
            (
                "Sobol' indices need parameters that vary over ranges, as restitution = ",
                RANGE,
            )
        )
    if outputs is None:
        outputs = [
            n for n in OUTPUTS if spec.scene.particles > 1 or MEASURE_OF.get(n) != "separation"
        ]
    asks = {MEASURE_OF[name]: True for name in outputs if name in MEASURE_OF}
    with Workers(threads) as workers:
        found = sobol_indices(
            ranges,
            spec.scene.measuring(**asks),
            workers,
            fixed=spec.scene.inputs,
            outputs=outputs,
            base=spec.design.realizations or 1,
            seed=spec.design.seed,
            confidence=confidence,
        )
    recognised = asks.keys() & {"regimes", "lyapunov"}
    note = observation_of_orbits(spec, open_design(spec)) if recognised else ""
    return found.assign_attrs(title=spec.title, sweep_file=spec.text, notes=note)


def _require_asked(outputs: Sequence[str], confidence: float) -> None:
    if isinstance(outputs, str) or not len(outputs):
        raise ParameterError(
            f"outputs = {outputs!r}: must be a list of one or more measured variables"
        )
    for name in outputs:
        variable = VARIABLES.get(name)
        if variable is None:
            continue
        if name not in OF_REALIZATIONS:
            raise ParameterError(
                f"outputs: {name} has a number for each {variable.dims[-1]}; choose variables with "
                f"one for each realization"
            )
        if len([code for code, _ in variable.flags if code != UNDETERMINED]) > 2:
            raise ParameterError(
                f"outputs: {name} is a code, whose numbers have no mean; choose variables that "
                f"count or measure"
            )
    if not (isinstance(confidence, float) and 0.0 < confidence < 1.0):
        raise ParameterError(f"confidence = {confidence!r}: must be a number above 0 and below 1")


def _require_ranges(ranges: Mapping[str, tuple[float, float]], base: int) -> None:
    for name, (low, high) in ranges.items():
        if name not in INPUTS:
            raise ParameterError(f"{name}: must be one of {', '.join(INPUTS)}")
        if not (np.all(INPUTS[name].accepts([low, high])) and low < high):
            raise ParameterError(
                f"{name} = [{low!r}, {high!r}]: must be a range of numbers that are "
                f"{INPUTS[name].allowed}"
            )
    forcing_of(ranges)
    if not ranges:
        raise ParameterError("ranges: must name at least one parameter that varies")
    if base < 2 or base & (base - 1):
        raise ParameterError(f"base = {base}: must be a power of 2, at least 2")


def _measured(
    points: Mapping[str, Array],
    fixed: Mapping[str, float],
    scene: Scene,
    workers: Workers,
    outputs: Sequence[str],
) -> Array:
    """Outputs at the points, shape (output, point)."""
    found, statuses, count = [], [], len(next(iter(points.values())))
    for start in range(0, count, BATCH):
        given = {name: np.ascontiguousarray(v[start : start + BATCH]) for name, v in points.items()}
        size = len(next(iter(given.values())))
        others = {n: np.full(size, v) for n, v in fixed.items()}
        every = _every_parameter(others | given, scene.base)
        measured = measure(every, scene, workers)
        _require_outputs(measured, outputs)
        numbers = [np.where(known(n, measured), measured[n], np.nan) for n in outputs]
        found.append(np.array(numbers, dtype=np.float64))
        statuses.append(measured["status"])
    values, status = np.concatenate(found, axis=1), np.concatenate(statuses)
    if np.any(status):
        worst = Status(int(status.max()))
        raise DataError(
            f"sobol_indices: {np.count_nonzero(status)} of {count} realizations did not complete: "
            f"{worst.sentence}"
        )
    for name, row in zip(outputs, values, strict=True):
        undefined = int(np.count_nonzero(~np.isfinite(row)))
        if undefined:
            raise DataError(
                f"sobol_indices: {name} is undefined in {undefined} of {row.size} realizations: "
                f"lengthen the duration, raise measure.impact_budget, or take ranges in which all "
                f"particles land"
            )
        if np.ptp(row) == 0.0:
            raise DataError(f"sobol_indices: {name} is the same in all realizations")
    return values


def _every_parameter(given: dict[str, Array], base: str) -> dict[str, Array]:
    """Complete the given parameters, those that vary, to all that the engine needs."""
    size = len(next(iter(given.values())))
    return only_parameters(
        completed(
            {
                name: given[name] if name in given else np.full(size, INPUTS[name].default)
                for name in inputs_of(given, base)
            }
        )
    )


def _require_outputs(measured: Mapping[str, NDArray[Any]], outputs: Sequence[str]) -> None:
    absent = [name for name in outputs if name not in measured]
    if absent:
        key = MEASURE_OF.get(absent[0])
        remedy = f"set {key} = true" if key else "it is not a measured variable"
        raise DataError(f"sobol_indices needs the variable {absent[0]}: {remedy}")


def _indices(parts: Array) -> tuple[Array, Array]:
    """First-order and total indices, each of shape (output, parameter)."""
    from scipy.stats import sobol_indices as scipy_indices

    functions: dict[Literal["f_A", "f_B", "f_AB"], Array] = {
        "f_A": parts[:, 0],
        "f_B": parts[:, 1],
        "f_AB": np.moveaxis(parts[:, 2:], 1, 0),
    }
    found = scipy_indices(func=functions, n=parts.shape[2])
    shape = (parts.shape[0], parts.shape[1] - 2)  # scipy drops the axis of a single output
    return found.first_order.reshape(shape), found.total_order.reshape(shape)


def _index_dataset(
    first: Array,
    total: Array,
    ends: Array,
    parts: Array,
    outputs: tuple[str, ...],
    names: tuple[str, ...],
) -> xr.Dataset:
    dims = ("output", "parameter")
    sample = parts[:, :2].reshape(len(outputs), -1)
    variables = {}
    for i, (name, values) in enumerate((("first_order", first), ("total_order", total))):
        words = f"{name.replace('_', '-')} Sobol' index"
        variables[name] = variable(dims, values, words)
        for end, side in ((0, "low"), (1, "high")):
            variables[f"{name}_{side}"] = variable(dims, ends[end, i], f"{side} end, {words}")
    return xr.Dataset(
        {
            **variables,
            "mean": variable(("output",), sample.mean(axis=1), "mean, in the output's own unit"),
            "standard_deviation": variable(
                ("output",), sample.std(axis=1), "standard deviation, in the output's own unit"
            ),
        },
        coords={"output": list(outputs), "parameter": list(names)},
    )
