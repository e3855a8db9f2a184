"""Check of the error bounds stored in a dataset against the proved errors.

A bound is sound if no landing of the kernel is farther than that from the proved one.  An altered
bound could still be sound, so it must also equal the one that the kernel computes now.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.engine.landings import record_landings
from vibrosweep.engine.measure import measure_all
from vibrosweep.engine.workers import Workers
from vibrosweep.model.measures import MEASURE_OF, VARIABLES
from vibrosweep.model.parameters import SPRUNG
from vibrosweep.proof.reference.motion import EPS
from vibrosweep.proof.reference.results import Trajectory
from vibrosweep.proof.sample import Sample
from vibrosweep.proof.tolerances import Bounds

# Variables of the bounds, in the order of the fields of `Bounds`
BOUNDS: Final = tuple(f"{field}_error" for field in Bounds._fields)

# Keys of `vibrosweep.proof.judges.JUDGES` that compare stored numbers with recomputed ones
RECOMPUTED: Final = ("recomputed", "uncertain", "exponent_error", "exponent_sum_error")


def measure_bounds(sample: Sample, workers: Workers) -> dict[str, NDArray[Any]]:
    """Recompute the count and, unless coupled, the error bounds of all landings, for all rows."""
    bounded = sample.scene.base != SPRUNG
    everything = sample.scene.with_measures(transient=-math.inf, trust=bounded)
    return measure_all(sample.parameters, everything, workers)


def measure_again(sample: Sample, workers: Workers) -> dict[str, NDArray[Any]]:
    """Recompute, for all rows, the stored variables that are judged by recomputed values."""
    names = {name for name in sample.stored if VARIABLES[name].judged in RECOMPUTED}
    if not names:
        return {}
    scene = sample.scene.with_measures(**{MEASURE_OF[name]: True for name in names})
    found = measure_all(sample.parameters, scene, workers)
    return {name: found[name] for name in names}


class Errors(NamedTuple):
    """Proved errors of the kernel's landings of one particle; infinite if their number differs."""

    # landing_time, rebound_velocity: shape (impact,), s and m s-1; the largest rounding error of
    # the recorded number is subtracted
    landing_time: Array
    rebound_velocity: Array


def landing_errors(
    sample: Sample, row: int, trajectories: Sequence[Trajectory], workers: Workers
) -> list[Errors]:
    """Proved errors of the kernel's landings of each particle of a row."""
    parameters = {name: values[row : row + 1] for name, values in sample.parameters.items()}
    everything = sample.scene.with_measures(transient=-math.inf)
    found = record_landings(parameters, everything, workers)
    return [
        _errors(
            {name: values[0, particle] for name, values in found.items()},
            trajectory,
            1.0 / float(parameters["frequency"][0]),
        )
        for particle, trajectory in enumerate(trajectories)
    ]


def _errors(recorded: Mapping[str, NDArray[Any]], trajectory: Trajectory, period: float) -> Errors:
    count = int(recorded["impact_count"])
    if count != len(trajectory.impacts):
        lost = np.full(1, np.inf)
        return Errors(lost, lost)
    time, speed = recorded["landing_time"][:count], recorded["rebound_velocity"][:count]
    landing = [
        _distance(impact.landing_time, t, 4.0 * EPS * (abs(t) + 2.0 * period))
        for impact, t in zip(trajectory.impacts, time.tolist(), strict=True)
    ]
    rebound = [
        _distance(impact.rebound_velocity, v, 4.0 * EPS * v)
        for impact, v in zip(trajectory.impacts, speed.tolist(), strict=True)
        if impact.rebound_velocity is not None
    ]
    return Errors(np.array(landing), np.array(rebound))


def _distance(proved: Any, recorded: float, rounding: float) -> float:
    if not math.isfinite(recorded):
        return math.inf
    return max(0.0, float((proved - recorded).abs_lower()) - rounding)


def untrusted(
    until: float, times: Array, errors: Errors, duration: float, tolerance: float, bound: float
) -> tuple[str, float]:
    """Return what is wrong with a stored `trusted_until`, or "", and the largest error up to it."""
    if bound <= tolerance and until != duration:
        return f"while all landings up to {duration!r} are known to the tolerance", math.nan
    if math.isnan(until):
        return "", math.nan
    if len(times) != len(errors.landing_time):
        return "while other landings are proved", math.inf
    count = len(times)
    if until != duration:
        near = np.abs(times - until) <= tolerance + 4.0 * EPS * duration
        if not np.any(near):
            return "which is neither the time of a landing nor the end", math.nan
        count = int(np.argmax(near)) + 1
    error = float(np.max(errors.landing_time[:count], initial=0.0))
    return (f"proved error of a landing up to it {error:.3g}" if error > tolerance else ""), error
