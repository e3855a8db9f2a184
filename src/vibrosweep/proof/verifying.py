"""Verify a finished dataset: draw realizations, prove them, judge every number.

Each variable of the registry has a judge (`JUDGES`), and so has the record.  A variable is compared
with its proved value where the realization is proved (`Case` holds what is stored, proved and
recomputed).  Otherwise a variable that follows from others is at least compared with those.

An error bound is sound if no landing of the kernel is farther than that from the proved one.  An
altered bound could still be sound, so it must also equal the one that the kernel computes now.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain, repeat
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.engine.landings import record_landings
from vibrosweep.engine.measure import measure_all
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import DataError, ParameterError, count
from vibrosweep.model.measures import (
    MEASURE_OF,
    MEASURES,
    RESOLUTION,
    UNDETERMINED,
    VARIABLES,
    Regime,
    Status,
)
from vibrosweep.model.observables import Observable, observables_of
from vibrosweep.model.parameters import SPRUNG
from vibrosweep.model.restitution_laws import fastest_in_range
from vibrosweep.proof.claims import (
    MAX_COUPLED,
    RECURS,
    EnteredCycle,
    ErrorBounds,
    Estimate,
    Orbit,
    Representative,
    largest_exponent,
    numbered,
    prove,
)
from vibrosweep.proof.measures import (
    ProvedMeasures,
    ProvedObservable,
    prove_measures,
    prove_observable,
)
from vibrosweep.proof.reference.arithmetic import Proved, UndecidableError, arb, exact
from vibrosweep.proof.reference.motion import EPS, ProvedImpact, Trajectory
from vibrosweep.proof.reference.sprung import TooManyLandingsError
from vibrosweep.proof.reference.trajectories import trajectory
from vibrosweep.proof.report import Judgement, Outcome, ProofState, Report, judge
from vibrosweep.proof.sampling import ExactRealization, Expected, Sample, read_sample
from vibrosweep.store.disk import path_of
from vibrosweep.store.reading import read_kind
from vibrosweep.waiting import Advance, silent

# Variables of the bounds, in the order of the fields of `ErrorBounds`
BOUNDS: Final = tuple(f"{field}_error" for field in ErrorBounds._fields)

# Keys of `vibrosweep.proof.verifying.JUDGES` that compare stored numbers with recomputed ones
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


# An aperiodic orbit has at least this many landings in the window, and an exponent that exceeds
# zero by this many standard errors.
LANDINGS: Final = 64
CERTAIN: Final = 3.0


class ProvedExponent(NamedTuple):
    """Proved Lyapunov exponent of a particle."""

    value: Proved
    claim: float | None  # largest error that the dataset allows; None where none is known
    # Error that must be stored with it, to within the claim: the standard error of a mean along the
    # orbit, 0 if the exponent is minus infinity; None where undefined
    error: Proved = None
    bounded: bool = False  # True if the stored error is a bound on the rounding error instead


@dataclass(frozen=True)
class Case:
    """One realization to be judged."""

    stored: Mapping[str, Any]  # its variables: numbers, or arrays over the particles
    # Bounds and other variables as this version computes them; empty if another version computed
    # the file
    again: Mapping[str, Any]
    realization: ExactRealization
    bounds: ErrorBounds  # bounds on the errors of its landings
    trajectories: Sequence[Trajectory]  # proved; empty where there is no proof
    # Proved errors of the kernel's landings of each particle, where the file bounds them
    errors: Sequence[Errors]
    tolerance: float  # error of a landing time in s up to which it is trusted
    # Estimate of the errors of its landings, if its particles are coupled and it is proved
    estimate: Estimate | None = None

    @cached_property
    def measures(self) -> ProvedMeasures:
        """Proved measures."""
        return prove_measures(self.realization, self.trajectories)

    @cached_property
    def claims(self) -> Mapping[str, float | None]:
        """Largest errors that the dataset allows for the measures."""
        return (self.estimate or self.bounds).claims(self.realization, self.measures)

    def observable(self, observable: Observable) -> ProvedObservable:
        """Proved value of an observable, and the largest errors that the dataset allows."""
        errors = partial((self.estimate or self.bounds).landing_errors, self.realization)
        status: Any = self.measures.values["particle_status"]
        found = prove_observable(observable, self.realization, self.trajectories, status, errors)
        if self.claims["impact_count"] is None:
            return found._replace(claims=[None] * len(found.claims))
        return found

    @property
    def deviation(self) -> tuple[float, float] | None:
        """Largest error in s of the kernel's landings, and its estimate; None if one is missing."""
        if self.estimate is None or not self.errors:
            return None
        largest = max(float(np.max(e.landing_time, initial=0.0)) for e in self.errors)
        return largest, self.estimate.time

    @cached_property
    def orbits(self) -> Sequence[Orbit]:
        """Proved states of each particle."""
        return [
            Orbit(self.realization, self.bounds, trajectory, particle)
            for particle, trajectory in enumerate(self.trajectories)
        ]

    @cached_property
    def cycles(self) -> Sequence[EnteredCycle | None]:
        """Cycle of each particle: from rest to rest, or as at least half of the variables state."""
        if self.realization.deviates is not None:  # random motion never repeats
            return [None] * len(self.orbits)
        signs = [
            np.array([RECURS[n](v) for v in self.stored[n]]) for n in RECURS if n in self.stored
        ]
        found = []
        for particle, orbit in enumerate(self.orbits):
            cycle = orbit.from_rest_to_rest()
            if cycle is None and 2 * sum(one[particle] for one in signs) >= len(signs):
                stated = max(0, int(self.stored["cycle_impacts"][particle]))
                cycle = orbit.recurrence(float(self.stored["recurrent_from"][particle]), stated)
            found.append(cycle)
        return found

    @cached_property
    def _states(self) -> Sequence[Representative | None]:
        pairs = zip(self.orbits, self.cycles, strict=True)
        return [None if cycle is None else orbit.representative(cycle) for orbit, cycle in pairs]

    @cached_property
    def orbit_numbers(self) -> Sequence[int | None]:
        """Number of the orbit of each particle, -1 if it has no cycle; None if undecided."""
        return numbered(self.cycles, self._states)

    @cached_property
    def slots(self) -> Sequence[int | None]:
        """Slot of each particle, -1 if it has no cycle; None where this cannot be decided."""
        return [
            -1 if cycle is None else None if state is None else state.whole % cycle.periods
            for cycle, state in zip(self.cycles, self._states, strict=True)
        ]

    @cached_property
    def exponents(self) -> Mapping[str, Sequence[ProvedExponent]]:
        """Exponents of each particle, by the variable that holds them."""
        largest, total = zip(*map(self._exponents, range(len(self.orbits))), strict=True)
        return {"lyapunov_largest": largest, "lyapunov_sum": total}

    def _exponents(self, particle: int) -> tuple[ProvedExponent, ProvedExponent]:
        """Largest exponent of a particle, and the sum of both."""
        orbit, cycle = self.orbits[particle], self.cycles[particle]
        impacts, first = self._window(particle)
        unclaimed = self.claims["impact_count"] is None and cycle is None
        if orbit.trajectory.at_rest or (cycle is not None and cycle.rests):
            return (ProvedExponent(-math.inf, 0.0, 0.0),) * 2
        rounding = self._stated("lyapunov_sum_error", particle)
        if cycle is not None:
            last = len(orbit.speeds) - 1
            total, change = orbit.contraction(last - cycle.impacts, last)
            found = largest_exponent(orbit.map, orbit.last_state(), cycle.impacts, cycle.periods)
            stated = self._stated("lyapunov_largest_error", particle)
            claim = None if found is None else stated
            return ProvedExponent(found, claim, bounded=True), _sum(total, rounding, change)
        if unclaimed:
            return (ProvedExponent(None, None),) * 2
        if first == len(impacts) or any(i.rested for i in impacts[first:]):
            return (ProvedExponent(None, 0.0),) * 2  # undefined
        if self.realization.deviates is not None:
            return (ProvedExponent(None, None),) * 2
        mean = orbit.growth(first, len(impacts))
        total, change = orbit.contraction(first, len(impacts))
        largest = ProvedExponent(mean.value, mean.claim, mean.standard_error)
        return largest, _sum(total, rounding, change)

    def aperiodic(self, particle: int) -> bool | None:
        """Decide whether a particle that does not recur is aperiodic; None if uncertain."""
        impacts, first = self._window(particle)
        if len(impacts) - first < LANDINGS or any(i.rested for i in impacts[first:]):
            return False
        mean = self.orbits[particle].growth(first, len(impacts))
        if mean.claim is None or mean.standard_error is None:
            return None
        above = mean.value - CERTAIN * mean.standard_error
        return above > 0.0 if abs(above) > (1.0 + CERTAIN) * mean.claim else None

    def _window(self, particle: int) -> tuple[Sequence[ProvedImpact], int]:
        """Impacts of a particle, and the number of the first one in the window."""
        impacts = self.orbits[particle].trajectory.impacts
        if not self.realization.scene.windowed:
            return impacts, 0
        begin = exact(self.realization.transient)
        return impacts, sum(1 for i in impacts if i.landing_time < begin)

    def _stated(self, name: str, particle: int) -> float | None:
        """Return an error that the dataset states; None where it states none."""
        error = float(self.stored[name][particle])
        return error if math.isfinite(error) else None


def _sum(total: arb | float, rounding: float | None, change: float) -> ProvedExponent:
    """Sum of both exponents; `rounding` is its stated error bound, None where none is stated."""
    claim = None if rounding is None or not math.isfinite(change) else rounding + change
    return ProvedExponent(total, claim, 0.0, bounded=isinstance(total, arb))


Judgements: TypeAlias = Iterator[Judgement]
FOUND_NOW: Final = "but {!r} is found now"


class Judge(NamedTuple):
    """Comparisons of one variable."""

    # Judges the variable of a given name where the realization is proved
    by_proof: Callable[[Case, str], Judgements]
    # The same where it is not proved; None where nothing is known
    otherwise: Callable[[Case, str], Judgements] | None = None


def judge_row(case: Case, name: str) -> Judgements:
    """Judge a variable of a realization by its proved value, or else by what others imply."""
    how = JUDGES[VARIABLES[name].judged]
    if case.trajectories:
        yield from how.by_proof(case, name)
    elif how.otherwise is not None:
        yield from how.otherwise(case, name)


def judge_observable(observable: Observable, values: Any, found: ProvedObservable) -> Judgements:
    """Judge the values of an observable in a realization by those of proved landings."""
    stored = np.atleast_1d(values).tolist()
    each = observable.particles == "each"
    for k, (value, claim) in enumerate(zip(found.values, found.claims, strict=True)):
        yield judge(observable.name, k if each else None, stored[k], value, claim)


def judge_record(
    record: Sample,
    claims: Callable[[float], Mapping[str, float]],
    trajectories: Sequence[Trajectory],
) -> list[Judgement]:
    """Judge every number of a record; `claims` gives the largest errors of a number by its size."""
    judged = []
    for particle, orbit in enumerate(trajectories):
        stored = {name: values[0, particle].tolist() for name, values in record.stored.items()}
        counts = {"impact_count": len(orbit.impacts), "status": int(orbit.status)}
        for name, proved in counts.items():
            judged.append(judge(f"record/{name}", particle, stored[name], proved, 0.0))
        # the record must end after the last landing
        impacts = chain(orbit.impacts, repeat(None))
        for n, impact in zip(range(len(stored["rested"])), impacts, strict=False):
            for name, proved in _recorded(impact).items():
                number = float(stored[name][n])
                claim = claims(number)[name]
                found = judge(f"record/{name}", particle, number, proved, claim)
                if found.complaint:
                    found = replace(found, complaint=f"of landing {n + 1} {found.complaint}")
                if impact is not None or found.complaint:
                    judged.append(found)
    return judged


def _recorded(impact: ProvedImpact | None) -> dict[str, Any]:
    """Return the numbers that a record must hold of a landing; None stands for NaN."""
    names = ("landing_time", "liftoff_time", "rebound_velocity")
    balls = {name: getattr(impact, name, None) for name in names}
    return balls | {"rested": int(impact is not None and impact.rested)}


def _follows(value: Callable[[Case, str], float | None]) -> Callable[[Case, str], Judgements]:
    """Judge a variable by the value that others imply, None where they imply nothing."""

    def follows(case: Case, name: str) -> Judgements:
        made = value(case, name) if case.stored["status"] == Status.COMPLETED else None
        if made is not None:
            stored = float(case.stored[name])
            yield _same(name, None, stored, made, "while others in the file make it {!r}")

    return follows


def _same(name: str, particle: int | None, stored: float, other: float, words: str) -> Judgement:
    """Judge a number by another that it must equal; `words` describe the other."""
    if stored == other or (math.isnan(stored) and math.isnan(other)):
        return Judgement(name, particle, 0.0, 0.0)
    complaint = f"is {stored!r}, {words.format(other)}"
    return Judgement(name, particle, abs(stored - other), 0.0, None, complaint)


def _of_particles(
    case: Case, name: str, proved: Iterable[tuple[Proved, float | None]]
) -> Judgements:
    """Judge the numbers of all particles by proved values and claims."""
    for particle, (value, claim) in enumerate(proved):
        yield judge(name, particle, float(case.stored[name][particle]), value, claim)


def _measure(case: Case, name: str) -> Judgements:
    """Judge a measure of flights, landings or separations."""
    proved = case.measures.values[name]
    claim = None if _is_unresolved(case, name) else case.claims[name]
    if isinstance(proved, list):
        yield from _of_particles(case, name, ((value, claim) for value in proved))
    else:
        yield judge(name, None, float(case.stored[name]), proved, claim)


def _is_unresolved(case: Case, name: str) -> bool:
    """Return whether the kernel found landings too close together to put them in order."""
    key = MEASURE_OF.get(name)
    if key not in ("separation", "ordering"):
        return False
    names = [v.name for v in MEASURES[key].variables if v.name in case.stored]
    return all(case.stored[n] == UNDETERMINED or math.isnan(case.stored[n]) for n in names)


def _regime(case: Case, name: str) -> Judgements:
    return _of_particles(case, name, ((regime, 0.0) for regime in _regimes(case)))


def _regimes(case: Case) -> list[int]:
    """Regime of each particle: the proved one, or else the stored one."""
    if not case.trajectories:
        return [int(code) for code in case.stored["regime"]]
    found: list[int] = []
    for particle, (orbit, cycle) in enumerate(zip(case.orbits, case.cycles, strict=True)):
        if orbit.trajectory.at_rest:
            found.append(Regime.AT_REST)
        elif case.realization.deviates is not None:
            found.append(UNDETERMINED)
        elif cycle is not None:
            found.append(Regime.RESTING if cycle.rests else Regime.LOCKED)
        else:
            said = case.stored["regime"][particle] == Regime.APERIODIC
            proved = case.aperiodic(particle)
            aperiodic = said if proved is None else proved
            found.append(Regime.APERIODIC if aperiodic else Regime.UNSETTLED)
    return [int(regime) for regime in found]


def _number_in(case: Case, name: str) -> float:
    """Count the particles in the regime that the variable is named after."""
    return _regimes(case).count(Regime[name.removesuffix("_count").upper()])


def _cycle(case: Case, name: str) -> Judgements:
    field = name.removeprefix("cycle_")
    return _of_particles(
        case, name, ((0 if c is None else getattr(c, field), 0.0) for c in case.cycles)
    )


def _uncertain(case: Case, name: str) -> Judgements:
    """Judge a code that depends on rounding by the code that this version computes."""
    for particle, stored in enumerate(case.stored[name].tolist()):
        if case.trajectories and case.cycles[particle] is None:
            yield judge(name, particle, float(stored), UNDETERMINED, 0.0)
        elif name in case.again:
            yield _same(name, particle, stored, int(case.again[name][particle]), FOUND_NOW)


def _recomputed(case: Case, name: str) -> Judgements:
    """Judge a variable without a proof by the value that this version computes."""
    if name in case.again:
        yield _same(name, None, float(case.stored[name]), float(case.again[name]), FOUND_NOW)


def _recurrent_from(case: Case, name: str) -> Judgements:
    pairs = zip(case.orbits, case.cycles, strict=True)
    proved = ((None if c is None else o.times[c.since], o.time_error) for o, c in pairs)
    return _of_particles(case, name, proved)


def _exponent(case: Case, name: str) -> Judgements:
    return _of_particles(case, name, ((one.value, one.claim) for one in case.exponents[name]))


def _exponent_error(case: Case, name: str) -> Judgements:
    """Judge a standard error, or the bound on a rounding error."""
    for particle, one in enumerate(case.exponents[name.removesuffix("_error")]):
        stored = float(case.stored[name][particle])
        if case.stored["cycle_uncertain"][particle] == 1:
            yield judge(name, particle, stored, math.inf, 0.0)
        elif one.bounded:
            yield _rounding_bound(case, name, particle, one.value)
        else:
            yield judge(name, particle, stored, one.error, one.claim)


def _orbit_or_slot(case: Case, name: str) -> Judgements:
    codes = case.orbit_numbers if name == "orbit" else case.slots
    return _of_particles(case, name, ((c, None if c is None else 0.0) for c in codes))


def _most_unstable(case: Case, name: str) -> float:
    return float(np.fmax.reduce(case.stored["lyapunov_largest"]))


def _uncertain_cycles(case: Case, name: str) -> float:
    return int(np.count_nonzero(case.stored["cycle_uncertain"] == 1))


def _resolved(case: Case, name: str) -> float:
    gap = float(case.stored["dt_min"]) * case.realization.parameters["frequency"]
    return UNDETERMINED if math.isnan(gap) else int(gap > RESOLUTION)


def _in_range(case: Case, name: str) -> float:
    p, law = case.realization.parameters, case.realization.laws.restitution
    speed, e = p.get("restitution_speed"), np.asarray(p["restitution"])
    most = fastest_in_range(law, e, None if speed is None else np.asarray(speed))
    return int(not case.stored["impact_speed_max"] > most)


def _orbits(case: Case, name: str) -> float:
    return len(set(case.stored["orbit"].tolist()) - {-1})


def _slots(case: Case, name: str) -> float:
    pairs = zip(case.stored["orbit"].tolist(), case.stored["slot"].tolist(), strict=True)
    return len({pair for pair in pairs if pair[0] >= 0})


def _negation(case: Case, name: str) -> float:
    shared = int(case.stored["base_shared"])
    return shared if shared == UNDETERMINED else 1 - shared


def _total(case: Case, name: str) -> float | None:
    """Sum over the particles of their counts or flags."""
    for each in (f"particle_{name}", f"particle_{name.removesuffix('_count')}"):
        if each in case.stored:
            return float(np.sum(case.stored[each]))
    return None


def _greatest(case: Case, name: str) -> float | None:
    """Largest number of the particles that have one."""
    each = case.stored.get(f"particle_{name}")
    return None if each is None else float(np.fmax.reduce(each))


def _landing_bound(case: Case, name: str) -> Judgements:
    """Judge a bound on the errors of all landings by the proved errors, and by a new bound."""
    stored = float(case.stored[name])
    changed = _changed(case, name, None)
    if not case.trajectories:
        if name in case.again:
            yield Judgement(name, None, math.nan, stored, None, changed)
        return
    worst = max(
        float(np.max(getattr(e, name.removesuffix("_error")), initial=0.0)) for e in case.errors
    )
    disproved = f"is {stored!r}, proved error {worst:.3g}" if not worst <= stored else ""
    yield Judgement(name, None, worst, stored, None, disproved or changed)


def _changed(case: Case, name: str, particle: int | None) -> str:
    """Describe how a bound differs from that of this version; empty if another wrote the file.

    Another processor or numpy may round the phase of lift-off differently, and a bound depends on
    the orbit: its relative change is the change of the orbit in periods, times a curvature.
    """
    if name not in case.again:
        return ""
    stored, bound = (
        float(held[name] if particle is None else held[name][particle])
        for held in (case.stored, case.again)
    )
    frequency = case.realization.parameters["frequency"]
    slack = 1e-9 + 1e3 * float(case.again["landing_time_error"]) * frequency
    same = stored == bound or (math.isnan(stored) and math.isnan(bound))
    if same or abs(stored - bound) <= slack * bound:
        return ""
    return f"is {stored!r}, while the kernel finds {bound!r}"


def _rounding_bound(case: Case, name: str, particle: int, proved: Any) -> Judgement:
    """Judge the bound on the rounding error of an exponent.

    The exponent itself is judged by that bound, so that in a file of this version only a change of
    the bound is a failure.
    """
    stored = float(case.stored[name][particle])
    exponent = float(case.stored[name.removesuffix("_error")][particle])
    known = proved is not None and math.isfinite(exponent)
    error = float((proved - exponent).abs_lower()) if known else math.nan
    if name in case.again:
        return Judgement(name, particle, error, stored, None, _changed(case, name, particle))
    if not known:
        return Judgement(name, particle, math.nan, None)
    complaint = f"is {stored!r}, proved error {error:.3g}" if not error <= stored else ""
    return Judgement(name, particle, error, stored, None, complaint)


def _trusted_until(case: Case, name: str) -> Judgements:
    end, bound = float(case.realization.duration), float(case.stored["landing_time_error"])
    for particle, until in enumerate(case.stored[name].tolist()):
        times, errors = case.trajectories[particle].landing_time, case.errors[particle]
        problem, error = untrusted(until, times, errors, end, case.tolerance, bound)
        complaint = f"is {until!r}, {problem}" if problem else ""
        yield Judgement(name, particle, error, case.tolerance, None, complaint)


def _followed(value: Callable[[Case, str], float | None]) -> Judge:
    follows = _follows(value)
    return Judge(follows, follows)


JUDGES: Final[dict[str, Judge]] = {
    "measure": Judge(_measure),
    "total": Judge(_measure, _follows(_total)),
    "greatest": Judge(_measure, _follows(_greatest)),
    "negation": Judge(_measure, _follows(_negation)),
    "in_range": _followed(_in_range),
    "resolved": _followed(_resolved),
    "bound": Judge(_landing_bound, _landing_bound),
    "trusted_until": Judge(_trusted_until),
    "regime": Judge(_regime),
    "regime_count": _followed(_number_in),
    "uncertain": Judge(_uncertain, _uncertain),
    "uncertain_count": _followed(_uncertain_cycles),
    "recomputed": Judge(_recomputed, _recomputed),
    "cycle": Judge(_cycle),
    "recurrent_from": Judge(_recurrent_from),
    "exponent": Judge(_exponent),
    "exponent_error": Judge(_exponent_error),
    "exponent_sum": Judge(_exponent),
    "exponent_sum_error": Judge(_exponent_error),
    "exponent_max": _followed(_most_unstable),
    "orbit": Judge(_orbit_or_slot),
    "slot": Judge(_orbit_or_slot),
    "orbit_count": _followed(_orbits),
    "slot_count": _followed(_slots),
}


# About ten seconds for a realization, and half a gigabyte.
MAX_LANDINGS: Final = 250_000
# Enough: an orbit for which a dataset claims anything has lost fewer digits than a double holds
MAX_BITS: Final = 1 << 12


class _ProvedRealization(NamedTuple):
    """Proof of a realization, with an estimate of errors where particles are coupled."""

    state: ProofState
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
    if max_landings is not None:
        max_landings = count("max_landings", max_landings)
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
    if proof.state is not ProofState.COMPARED:
        return Outcome(None, proof.state, judgements=judged)
    claims = (bounds if proof.estimate is None else proof.estimate).record_claims
    judged += judge_record(record, partial(claims, realization), proof.trajectories)
    return Outcome(None, ProofState.COMPARED, _landings(proof.trajectories), judged)


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


def _bounds(values: Mapping[str, NDArray[Any]], row: int) -> ErrorBounds:
    """Bounds on the errors of landings; infinite where none are known."""
    return ErrorBounds(
        *(float(values[name][row]) if name in values else math.inf for name in BOUNDS)
    )


def _landings(trajectories: Sequence[Trajectory]) -> int:
    return sum(len(trajectory.impacts) for trajectory in trajectories)


def _proved(
    sample: Sample, row: int, bounds: ErrorBounds, landings: int, max_landings: int
) -> _ProvedRealization:
    """Return the proof of a realization, or the reason why there is none."""
    realization = sample.realization(row)
    completed = bool(np.all(sample.stored["status"][row] == Status.COMPLETED))
    if not (completed if realization.coupled else all(map(math.isfinite, bounds))):
        return _ProvedRealization(ProofState.NO_CLAIM if completed else ProofState.NOT_COMPLETED)
    if landings > max_landings:
        return _ProvedRealization(ProofState.TOO_LONG)
    try:
        if not realization.coupled:
            return _ProvedRealization(ProofState.COMPARED, _independent(realization, max_landings))
        trajectories, estimate = prove(realization, max_landings)
    except UndecidableError:
        return _ProvedRealization(ProofState.UNDECIDED)
    except TooManyLandingsError:  # landings before the window count, too
        return _ProvedRealization(ProofState.TOO_LONG)
    if estimate is None:
        return _ProvedRealization(ProofState.NO_CLAIM)
    return _ProvedRealization(ProofState.COMPARED, trajectories, estimate)


def _independent(realization: ExactRealization, max_landings: int) -> list[Trajectory]:
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
