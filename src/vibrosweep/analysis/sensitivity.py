"""Sobol' indices of heights, flight times and separations with respect to all parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, Literal

import numpy as np
import xarray as xr

from vibrosweep.abilities import refusal
from vibrosweep.analysis.common import remarks_on, require_ability
from vibrosweep.analysis.datasets import table, variable
from vibrosweep.arrays import Array
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import DataError, ParameterError
from vibrosweep.mistakes import RANGE
from vibrosweep.model.measures import (
    MEASURE_OF,
    OF_REALIZATIONS,
    UNDETERMINED,
    VARIABLES,
    Status,
    known,
)
from vibrosweep.runs.result import observation_of_orbits
from vibrosweep.scene.design import Range, open_design
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import Sweep

OUTPUTS: Final = ("rebound_height_max", "rebound_height_mean", "flight_time_mean", "dt_min")
RESAMPLES: Final = 400
BATCH: Final = 4096


def sobol_indices(
    sweep: Sweep, outputs: Sequence[str] | None, confidence: float, threads: int
) -> xr.Dataset:
    """First-order and total Sobol' indices of measured variables over the ranges of a sweep.

    Each parameter is uniform in its range, independent of the others.  The scheme is that of
    Saltelli (2010), computed by `scipy.stats.sobol_indices`; the number of realizations, a power
    of 2, is the size of the base sample, and (parameters + 2) times as many are computed.
    Intervals are percentiles of a bootstrap over the base sample.  Outputs are variables with one
    number per realization; by default they are `OUTPUTS`, without the separation if there is only
    one particle.

    Dims (output, parameter): ``first_order`` and ``total_order``, each with ``_low`` and ``_high``;
    dim ``output``: ``mean`` and ``standard_deviation`` over the sample.  Raises a SpecError if no
    parameter has a range, a ParameterError if an output or the number of realizations is not
    allowed, and a DataError if a realization did not complete, or if an output is undetermined or
    undefined in some realization, or the same in all.
    """
    from scipy.stats import qmc

    ranges = {n: s.ends for n, s in sweep.design.sampled.items() if isinstance(s, Range)}
    if not ranges:
        raise sweep.refusal(
            ("Sobol' indices need parameters that vary over ranges, as restitution = ", RANGE)
        )
    require_ability("sobol", sweep.scene, ranges)
    scene, base, seed = sweep.scene, sweep.design.realizations or 1, sweep.design.seed
    if outputs is None:
        outputs = [n for n in OUTPUTS if scene.particles > 1 or MEASURE_OF.get(n) != "separation"]
    _require_outputs(outputs, scene.base, confidence)
    if base < 2 or base & (base - 1):
        raise ParameterError(f"realizations = {base}: must be a power of 2, at least 2")
    needed = {MEASURE_OF[name]: True for name in outputs if name in MEASURE_OF}
    low, high = np.array(list(ranges.values())).T
    points = qmc.Sobol(2 * low.size, seed=np.random.default_rng(seed)).random(base)
    a, b = (low + (high - low) * half for half in np.split(points, 2, axis=1))
    mixed = [np.where(np.arange(low.size) == k, b, a) for k in range(low.size)]
    sampled = dict(zip(ranges, np.concatenate([a, b, *mixed]).T, strict=True))
    with Workers(threads) as workers:
        found = _measured(sampled, scene.with_measures(**needed), workers, outputs)
    parts = found.reshape(len(outputs), 2 + low.size, base)
    random = np.random.default_rng(seed + 1)
    resampled = np.array(
        [_indices(parts[:, :, random.integers(base, size=base)]) for _ in range(RESAMPLES)]
    )
    tail = (1.0 - confidence) / 2.0
    ends = np.quantile(resampled, [tail, 1.0 - tail], axis=0)
    indices = _index_dataset(_indices(parts), ends, parts, outputs, [*ranges])
    recognised = needed.keys() & {"regimes", "lyapunov"}
    note = observation_of_orbits(sweep, open_design(sweep)) if recognised else ""
    return indices.assign_attrs(
        title=sweep.title, sweep_file=sweep.text, notes=remarks_on(sweep, note)
    )


def _require_outputs(outputs: Sequence[str], base: str, confidence: float) -> None:
    if isinstance(outputs, str) or not len(outputs):
        raise ParameterError(
            f"outputs = {outputs!r}: must be a list of one or more measured variables"
        )
    for name in outputs:
        variable = VARIABLES.get(name)
        if variable is None:
            raise ParameterError(f"outputs: {name} is not a measured variable")
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
        wrong = refusal(base, measure=MEASURE_OF[name]) if name in MEASURE_OF else ""
        if wrong:
            raise ParameterError(f"outputs: {name}: {wrong}")
    if not (isinstance(confidence, float) and 0.0 < confidence < 1.0):
        raise ParameterError(f"confidence = {confidence!r}: must be a number above 0 and below 1")


def _measured(
    points: Mapping[str, Array], scene: Scene, workers: Workers, outputs: Sequence[str]
) -> Array:
    """Outputs at the points, shape (output, point)."""
    found, statuses, count = [], [], len(next(iter(points.values())))
    for start in range(0, count, BATCH):
        given = {name: np.ascontiguousarray(v[start : start + BATCH]) for name, v in points.items()}
        measured = measure(scene.parameters(given), scene, workers)
        numbers = [np.where(known(n, measured), measured[n], np.nan) for n in outputs]
        found.append(np.array(numbers, dtype=np.float64))
        statuses.append(measured["status"])
    values, status = np.concatenate(found, axis=1), np.concatenate(statuses)
    if np.any(status):
        worst = Status(int(status.max()))
        raise DataError(
            f"sobol: {np.count_nonzero(status)} of {count} realizations did not complete: "
            f"{worst.sentence}"
        )
    for name, row in zip(outputs, values, strict=True):
        undefined = int(np.count_nonzero(~np.isfinite(row)))
        if undefined:
            raise DataError(
                f"sobol: {name} is undefined in {undefined} of {row.size} realizations: "
                f"lengthen the duration, raise measure.impact_budget, or take ranges in which all "
                f"particles land"
            )
        if np.ptp(row) == 0.0:
            raise DataError(f"sobol: {name} is the same in all realizations")
    return values


def _indices(parts: Array) -> Array:
    """First-order and total indices, shape (2, output, parameter)."""
    from scipy.stats import sobol_indices as scipy_indices

    functions: dict[Literal["f_A", "f_B", "f_AB"], Array] = {
        "f_A": parts[:, 0],
        "f_B": parts[:, 1],
        "f_AB": np.moveaxis(parts[:, 2:], 1, 0),
    }
    found = scipy_indices(func=functions, n=parts.shape[2])
    shape = (2, parts.shape[0], parts.shape[1] - 2)  # scipy drops the axis of a single output
    return np.reshape([found.first_order, found.total_order], shape)


def _index_dataset(
    indices: Array, ends: Array, parts: Array, outputs: Sequence[str], names: Sequence[str]
) -> xr.Dataset:
    dims = ("output", "parameter")
    sample = parts[:, :2].reshape(len(outputs), -1)
    variables = {}
    for i, name in enumerate(("first_order", "total_order")):
        words = f"{name.replace('_', '-')} Sobol' index"
        variables[name] = variable(dims, indices[i], words)
        for end, side in ((0, "low"), (1, "high")):
            variables[f"{name}_{side}"] = variable(dims, ends[end, i], f"{side} end, {words}")
    of_outputs = table(
        "output",
        mean=(sample.mean(axis=1), "mean, in the unit of the output"),
        standard_deviation=(sample.std(axis=1), "standard deviation, in the unit of the output"),
    )
    return xr.Dataset({**variables, **of_outputs}, {"output": [*outputs], "parameter": [*names]})
