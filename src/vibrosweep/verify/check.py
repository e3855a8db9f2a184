"""Verify a finished dataset: draw realizations, prove them, judge every number."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.errors import DataError, ParameterError
from vibrosweep.reference.ball import Trajectory, UndecidableError, trajectory
from vibrosweep.status import Status
from vibrosweep.store.kinds import read_kind
from vibrosweep.sweep.progress import Advance, silent
from vibrosweep.sweep.workers import Workers
from vibrosweep.variables import UNDETERMINED
from vibrosweep.verify.bounds import BOUNDS, judge_again, judge_bounds, measure_bounds
from vibrosweep.verify.claims import Bounds, claims
from vibrosweep.verify.judgement import Judgement, judge
from vibrosweep.verify.measures import Measures, measures
from vibrosweep.verify.reading import read_sample
from vibrosweep.verify.record import judge_record
from vibrosweep.verify.regimes import REGIME_VARIABLES, judge_regimes
from vibrosweep.verify.report import Outcome, Report, State
from vibrosweep.verify.sample import Sample

__all__ = ["MAX_LANDINGS", "verify"]

# About ten seconds for a realization, and half a gigabyte.
MAX_LANDINGS: Final = 250_000
# Where a dataset claims anything, an orbit has lost fewer digits than a double has.
MAX_BITS: Final = 1 << 12
SEPARATIONS: Final = ("dt_min", "dt_min_same_index", "base_shared", "collision_free")


def verify(
    path: str | os.PathLike[str],
    *,
    sample: int = 20,
    seed: int = 0,
    max_landings: int = MAX_LANDINGS,
    advance: Advance = silent,
) -> Report:
    """Recompute realizations of a dataset with proved errors and compare every number.

    Parameters
    ----------
    path
        Result of a sweep.
    sample
        Number of realizations, drawn without replacement; all where there are no more.
    seed
        Seed of the draw.
    max_landings
        Realizations with more landings, from the launch on, are left out: the reference takes
        about 0.05 ms for each.
    advance
        Called after each realization with the number of those done and that of all.

    Raises
    ------
    ParameterError
        A number is out of its range.
    DataError
        There is no such file, it is not a result that can be read, or of a kind that no
        reference judges.
    MissingFlintError
        python-flint is not installed.
    """
    if max_landings < 1:
        raise ParameterError(f"max_landings = {max_landings!r}: must be at least 1")
    kind = read_kind(Path(path))
    if kind.unverified:
        raise DataError(
            f"{path}: is a result of {kind.command}, which cannot be verified: {kind.unverified}"
        )
    drawn, record = read_sample(Path(path), sample, seed)
    claimed = {*BOUNDS, "trusted_until"} <= drawn.stored.keys()
    outcomes = []
    with Workers(1) as workers:
        again = measure_bounds(drawn, workers)
        for row in range(drawn.rows.size):
            outcomes.append(_checked(drawn, again, row, claimed, max_landings, workers))
            advance(row + 1, drawn.rows.size)
        if record is not None:
            outcomes.append(_checked_record(record, max_landings, workers))
    return Report(str(path), drawn.total, seed, outcomes, claimed)


def _checked(
    sample: Sample,
    again: Mapping[str, NDArray[Any]],
    row: int,
    claimed: bool,
    max_landings: int,
    workers: Workers,
) -> Outcome:
    """Judge one realization as far as it can be."""
    realization = int(sample.rows[row])
    judged = judge_again(sample, again, row) if claimed and sample.own else []
    bounds = _bounds(sample.stored if claimed else again, row)
    proved = _proved(sample, row, bounds, int(again["impact_count"][row]), max_landings)
    if isinstance(proved, State):
        return Outcome(realization, proved, judgements=judged)
    scene = sample.scene(row)
    measured = measures(scene, proved)
    judged += _judge_values(sample, row, measured, claims(bounds, scene, measured))
    if sample.stored.keys() >= {*REGIME_VARIABLES}:
        stored = {name: sample.stored[name][row] for name in REGIME_VARIABLES}
        judged += judge_regimes(stored, scene, bounds, proved)
    if claimed:
        judged += judge_bounds(sample, row, scene, proved, workers)
    return Outcome(realization, State.COMPARED, _landings(proved), judged)


def _checked_record(record: Sample, max_landings: int, workers: Workers) -> Outcome:
    """Judge the record of every landing, whose bounds a dataset does not hold."""
    again = measure_bounds(record, workers)
    bounds = _bounds(again, 0)
    proved = _proved(record, 0, bounds, int(again["impact_count"][0]), max_landings)
    if isinstance(proved, State):
        return Outcome(None, proved)
    judged = judge_record(record, bounds, proved)
    return Outcome(None, State.COMPARED, _landings(proved), judged)


def _bounds(values: Mapping[str, NDArray[Any]], row: int) -> Bounds:
    return Bounds(*(float(values[name][row]) for name in BOUNDS))


def _landings(trajectories: Sequence[Trajectory]) -> int:
    return sum(len(trajectory.impacts) for trajectory in trajectories)


def _proved(
    sample: Sample, row: int, bounds: Bounds, landings: int, max_landings: int
) -> list[Trajectory] | State:
    """Return the proved trajectories of a realization, or why there are none."""
    if not all(map(math.isfinite, bounds)):
        completed = np.all(sample.stored["status"][row] == Status.COMPLETED)
        return State.NO_CLAIM if completed else State.NOT_COMPLETED
    if landings > max_landings:
        return State.TOO_LONG
    scene = sample.scene(row)
    shared: dict[str, Any] = {
        **scene.parameters,
        "duration": scene.duration,
        "rebound": scene.rebound,
        "max_impacts": max_landings,
        "max_bits": MAX_BITS,
    }
    try:
        return [trajectory(launch_time=time, **shared) for time in scene.launch_times]
    except UndecidableError:
        return State.UNDECIDED


def _judge_values(
    sample: Sample, row: int, measured: Measures, claimed: Mapping[str, float | None]
) -> list[Judgement]:
    """Judge every measured variable that the dataset holds."""
    unresolved = SEPARATIONS if _is_unresolved(sample, row) else ()
    judged = []
    for name, values in sample.stored.items():
        if name not in measured.values:  # judged elsewhere
            continue
        claim = None if name in unresolved else claimed[name]
        proved, stored = measured.values[name], values[row]
        if isinstance(proved, list):
            pairs = enumerate(zip(stored.tolist(), proved, strict=True))
            judged += [judge(name, p, float(s), value, claim) for p, (s, value) in pairs]
        else:
            judged.append(judge(name, None, float(stored), proved, claim))
    return judged


def _is_unresolved(sample: Sample, row: int) -> bool:
    """Whether the kernel says that landings crowd too much to be told apart: then it says so."""
    stored = [sample.stored[name][row] for name in SEPARATIONS if name in sample.stored]
    return bool(stored) and all(value == UNDETERMINED or math.isnan(value) for value in stored)
