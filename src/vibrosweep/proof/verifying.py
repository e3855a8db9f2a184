"""Verify a finished dataset: draw realizations, prove them, judge every number."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.engine.workers import Workers
from vibrosweep.errors import DataError, ParameterError
from vibrosweep.model.measures import MEASURES, Status
from vibrosweep.model.observables import Observable, observables_of
from vibrosweep.model.parameters import SPRUNG
from vibrosweep.proof.claims import MAX_COUPLED, Bounds, Estimate, prove
from vibrosweep.proof.judges import (
    BOUNDS,
    Case,
    Errors,
    judge_observable,
    judge_record,
    judge_row,
    landing_errors,
    measure_again,
    measure_bounds,
)
from vibrosweep.proof.reference.arithmetic import UndecidableError
from vibrosweep.proof.reference.motion import EPS, Trajectory
from vibrosweep.proof.reference.sprung import TooManyLandingsError
from vibrosweep.proof.reference.trajectories import trajectory
from vibrosweep.proof.report import Judgement, Outcome, Report, State, judge
from vibrosweep.proof.sampling import Expected, Realization, Sample, read_sample
from vibrosweep.runs.progress import Advance, silent
from vibrosweep.store.disk import path_of
from vibrosweep.store.reading import read_kind

# About ten seconds for a realization, and half a gigabyte.
MAX_LANDINGS: Final = 250_000
# Enough: an orbit for which a dataset claims anything has lost fewer digits than a double holds
MAX_BITS: Final = 1 << 12


class _Proof(NamedTuple):
    """Proof of a realization, with an estimate of errors where particles are coupled."""

    state: State
    trajectories: Sequence[Trajectory] = ()
    estimate: Estimate | None = None


def verify(
    path: str | os.PathLike[str],
    *,
    observables: Iterable[Observable] = (),
    sample: int = 20,
    seed: int = 0,
    max_landings: int | None = None,
    advance: Advance = silent,
) -> Report:
    """Recompute realizations of a dataset with proved errors and compare every number.

    Parameters
    ----------
    path
        Result of a sweep, or of `vibrosweep.orbits`.
    observables
        Observables of the result to compare, as they were given to `vibrosweep.run`: the file does
        not hold their functions.  Each must have a function that gives one number for a landing
        (`landings` is set).  It is evaluated in ball arithmetic; if it uses more than arithmetic,
        or branches where rounding may decide, its error is estimated instead, and the report says
        so.
    sample
        Number of realizations, drawn without replacement; all where there are no more.
    seed
        Seed of the draw.
    max_landings
        Realizations with more landings, from the launch on, are left out.  The default is 250,000,
        or 1000 over a sprung base, whose reference takes about 10 ms for each: some ten seconds.
    advance
        Called after each realization with the number of finished realizations and the total.

    Returns
    -------
    Report
        `passed` is True if every number is within the error claimed for it; `lines()` gives the
        text that ``vibrosweep verify`` prints, and `variables()` all comparisons by variable.

    Raises
    ------
    ParameterError
        A number is out of its range, or the function of an observable changes totals.
    DataError
        There is no such file, it is not a result that can be read, no reference judges results of
        its kind, or it was not computed with these observables.
    MissingFlintError
        python-flint is not installed.

    Examples
    --------
    >>> import tempfile, vibrosweep as vs
    >>> def flight_time(landing):
    ...     return landing.flight_time
    >>> longest = vs.Observable("longest", flight_time, "longest flight", "s", landings="max")
    >>> sweep = {"restitution": [0.6, 0.8], "duration": 2.0}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     vs.run(sweep, f"{folder}/out.h5", observables=[longest]).close()
    ...     print(vs.verify(f"{folder}/out.h5", observables=[longest]).passed)
    True
    """
    if max_landings is not None and max_landings < 1:
        raise ParameterError(f"max_landings = {max_landings!r}: must be at least 1")
    source = path_of("path", path)
    kind = read_kind(source)
    if kind.unverified:
        raise DataError(
            f"{path}: is a result of {kind.command}, which cannot be verified: {kind.unverified}"
        )
    given = observables_of(observables)
    if kind.verify is not None:
        if given:
            raise ParameterError(
                f"observables: a result of {kind.command} has none; leave them out"
            )
        report: Report = kind.verify(source, sample=sample, seed=seed, advance=advance)
        return report
    drawn, record, setting, axes = read_sample(source, sample, seed, given)
    coupled = drawn.scene.base == SPRUNG
    if max_landings is None:
        max_landings = MAX_COUPLED if coupled else MAX_LANDINGS
    claimed = {v.name for v in MEASURES["trust"].variables} <= drawn.stored.keys()
    outcomes = []
    with Workers(1) as workers:
        again = measure_bounds(drawn, workers)
        if drawn.current:
            again |= measure_again(drawn, workers)
        for row in range(drawn.rows.size):
            outcomes.append(_checked(drawn, setting, again, row, claimed, max_landings, workers))
            advance(row + 1, drawn.rows.size)
        if record is not None:
            outcomes.append(_checked_record(record, setting, max_landings, workers))
    return Report(
        path=str(path),
        total=drawn.total,
        seed=seed,
        outcomes=outcomes,
        claimed=claimed,
        coupled=coupled,
        coordinates=[*_coordinates(drawn, setting, ""), *axes],
        names=_names(drawn, record),
        unknown={**setting.unknown, **_others(drawn, record)},
        estimated=sorted({name for outcome in outcomes for name in outcome.estimated}),
    )


def _names(sample: Sample, record: Sample | None) -> list[str]:
    """List every variable of the dataset; names of the record begin with ``record/``."""
    names = [*sample.coordinates, *sample.stored, *(one.name for one in sample.observables)]
    if record is not None:
        names += [f"record/{name}" for name in (*record.coordinates, *record.stored)]
    return [*names, *_others(sample, record)]


def _others(sample: Sample, record: Sample | None) -> dict[str, str]:
    recorded = {} if record is None else record.others
    return {**sample.others, **{f"record/{name}": why for name, why in recorded.items()}}


def _checked(
    sample: Sample,
    setting: Expected,
    again: Mapping[str, NDArray[Any]],
    row: int,
    claimed: bool,
    max_landings: int,
    workers: Workers,
) -> Outcome:
    """Judge one realization as far as possible."""
    judged = [
        judge(name, None, float(sample.coordinates[name][row]), float(values[row]), 0.0)
        for name, values in setting.sampled.items()
        if sample.coordinates.get(name, values[0]).shape == values.shape
    ]
    bounds = _bounds(sample.stored if claimed else again, row)
    proof = _proved(sample, row, bounds, int(again["impact_count"][row]), max_landings)
    errors: Sequence[Errors] = ()
    if proof.trajectories and (claimed or (proof.estimate is not None and sample.current)):
        errors = landing_errors(sample, row, proof.trajectories, workers)
    case = Case(
        stored={name: values[row] for name, values in sample.stored.items()},
        again={name: values[row] for name, values in again.items()} if sample.current else {},
        realization=sample.realization(row),
        bounds=bounds,
        trajectories=proof.trajectories,
        errors=errors,
        tolerance=sample.scene.measures.tolerance,
        estimate=proof.estimate,
    )
    for name in sample.stored:
        judged += judge_row(case, name)
    estimated = []
    for one, values in sample.observables.items() if case.trajectories else ():
        found = case.observable(one)
        judged += judge_observable(one, values[row], found)
        estimated += [one.name] if found.estimated else []
    landings = _landings(proof.trajectories)
    place = int(sample.rows[row])
    return Outcome(place, proof.state, landings, judged, case.deviation, estimated)


def _checked_record(
    record: Sample, setting: Expected, max_landings: int, workers: Workers
) -> Outcome:
    """Judge the record of every landing; its error bounds are recomputed."""
    again, realization = measure_bounds(record, workers), record.realization(0)
    bounds = _bounds(again, 0)
    judged = list(_coordinates(record, setting, "record/"))
    proof = _proved(record, 0, bounds, int(again["impact_count"][0]), max_landings)
    if proof.state is not State.COMPARED:
        return Outcome(None, proof.state, judgements=judged)
    claims = (bounds if proof.estimate is None else proof.estimate).record_claims
    judged += judge_record(record, partial(claims, realization), proof.trajectories)
    return Outcome(None, State.COMPARED, _landings(proof.trajectories), judged)


def _coordinates(sample: Sample, setting: Expected, prefix: str) -> Iterator[Judgement]:
    """Judge the coordinates that all realizations share, or the coordinates of the record."""
    for name, values in sample.coordinates.items():
        if not prefix and values.shape != setting.sampled.get(name, values).shape:
            yield Judgement(name, None, math.nan, 0.0, None, "has no value for each realization")
        if prefix + name not in setting.shared:
            continue
        value = np.asarray(setting.shared[prefix + name])
        if value.shape != values.shape:
            complaint = f"has the shape {values.shape}, not {value.shape}"
            yield Judgement(prefix + name, None, math.nan, 0.0, None, complaint)
        elif value.ndim == 0:
            yield judge(prefix + name, None, float(values), float(value), 0.0)
        else:  # a staggered launch is a quotient, which versions may round differently
            for particle, time in enumerate(value.tolist()):
                claim = 4.0 * EPS * abs(time)
                yield judge(prefix + name, particle, float(values[particle]), time, claim)


def _bounds(values: Mapping[str, NDArray[Any]], row: int) -> Bounds:
    """Bounds on the errors of landings; infinite where none are known."""
    return Bounds(*(float(values[name][row]) if name in values else math.inf for name in BOUNDS))


def _landings(trajectories: Sequence[Trajectory]) -> int:
    return sum(len(trajectory.impacts) for trajectory in trajectories)


def _proved(sample: Sample, row: int, bounds: Bounds, landings: int, max_landings: int) -> _Proof:
    """Return the proof of a realization, or the reason why there is none."""
    realization = sample.realization(row)
    completed = bool(np.all(sample.stored["status"][row] == Status.COMPLETED))
    if not (completed if realization.coupled else all(map(math.isfinite, bounds))):
        return _Proof(State.NO_CLAIM if completed else State.NOT_COMPLETED)
    if landings > max_landings:
        return _Proof(State.TOO_LONG)
    try:
        if not realization.coupled:
            return _Proof(State.COMPARED, _independent(realization, max_landings))
        trajectories, estimate = prove(realization, max_landings)
    except UndecidableError:
        return _Proof(State.UNDECIDED)
    except TooManyLandingsError:  # landings before the window count, too
        return _Proof(State.TOO_LONG)
    if estimate is None:
        return _Proof(State.NO_CLAIM)
    return _Proof(State.COMPARED, trajectories, estimate)


def _independent(realization: Realization, max_landings: int) -> list[Trajectory]:
    """Proved trajectories of particles that are independent."""
    shared: dict[str, Any] = {
        **realization.parameters,
        "duration": realization.duration,
        "rebound": realization.laws.rebound,
        "restitution_law": realization.laws.restitution,
        "waveform": realization.laws.waveform,
        "base": realization.scene.base,
        "max_impacts": max_landings,
        "max_bits": MAX_BITS,
    }
    drawn = realization.deviates
    return [
        trajectory(launch_time=t, deviates=None if drawn is None else drawn(p), **shared)
        for p, t in enumerate(realization.launch_times)
    ]
