"""Checks of the stress suite, which must hold for any scene."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from flint import arb, ctx
from numba import njit

from accuracy import ULP, arrays_of, batch_of, orbit
from coupled_errors import compare as compare_coupled
from first_roots import LARGEST_ERROR, Flights, judge
from trust_check import compare, kernel_jobs
from vibrosweep.engine.landings import record_landings
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels import bases
from vibrosweep.kernels.advance import LOOK_AFTER
from vibrosweep.kernels.impact import impact, launch, launch_speed
from vibrosweep.model.measures import Status
from vibrosweep.model.parameters import MOUNT, SPRUNG
from vibrosweep.scene.scene import Scene

BITS = 256
CAPACITY = 24  # landings of the first particle that are compared with the proved reference
TINY = 1e-300  # below, doubles lose digits
COUPLED_LANDINGS = 40  # up to which the landings of coupled particles are proved


@dataclass
class Case:
    """One realization of some particles, its observation, and the mount of a sprung base."""

    scene: dict[str, float]
    launch: tuple[float, ...]
    duration: float
    law: str
    transient: float = 0.0
    budget: int = 4000
    base: str = "high-bounce"

    @property
    def single(self) -> dict[str, float]:
        """The first particle alone, as one scene."""
        return self.scene | {"launch_time": self.launch[0], "duration": self.duration}


@dataclass
class Findings:
    """Result of a case: errors in units of the last place, and faults in words."""

    cases: int = 1
    failures: int = 0  # of cases, where several are summed
    landings: int = 0
    refused: int = 0
    ended: set[str] = field(default_factory=set)
    phase_ulp: float = 0.0  # error of one step, ulp of a turn
    flight_ulp: float = 0.0  # error of one step, ulp of the larger of its terms
    forced_share: float = 0.0  # error of a landing on the moving base over what rounding forces
    bound_share: float = 0.0  # error over bound
    compared: int = 0
    seconds: float = 0.0
    faults: list[str] = field(default_factory=list)


def examine(case: Case, workers: Workers, proved: bool = True) -> Findings:
    """Compute a case in all ways, and run the checks."""
    found = Findings()
    began = time.perf_counter()
    plain = Scene(len(case.launch), case.launch, case.duration, case.law, base=case.base).recorded(
        case.budget
    )
    coupled = case.base == SPRUNG
    alone = {"joint": True} if coupled else {"regimes": True, "trust": True}
    watched = plain.with_measures(
        transient=case.transient, separation=True, per_particle=True,
        tolerance=1e-9 / case.scene["frequency"], **alone,
    )  # fmt: skip
    parameters = arrays_of(case.scene)
    if coupled:
        parameters |= {name: np.array([case.scene[name]]) for name in MOUNT}
    try:
        measured = measure(parameters, watched, workers)
        record = record_landings(parameters, plain, workers)
    except ParameterError:
        found.refused = 1
        return found
    except Exception as error:  # any other exception is a fault that this suite looks for
        found.faults.append(f"{type(error).__name__}: {error}")
        return found
    found.seconds = time.perf_counter() - began
    found.landings = int(record["impact_count"].sum())
    found.ended = {Status(s).name for s in record["status"].ravel()}
    found.faults += check_measures(case, measured, record)
    for p in range(len(case.launch)):
        found.faults += check_record(case, {n: v[0, p] for n, v in record.items()})
    if coupled and proved and found.ended == {"COMPLETED"}:
        check_coupled(case, found)
    elif not coupled and proved and found.ended != {"NON_FINITE"}:
        (check_landings if case.base == "moving" else check_steps)(case, found)
        check_bounds(case, found)
    return found


def rounding(case: Case) -> float:
    """Rounding of a recorded time in s: of a sum of count and phase, and of a quotient."""
    largest = max(abs(case.duration), *(abs(t) for t in case.launch))
    return 2.0 * float(np.spacing(largest)) + 2.0 * ULP / case.scene["frequency"]


def check_record(case: Case, record: dict[str, np.ndarray]) -> Iterator[str]:
    """Faults of the landings of one particle."""
    count, status = int(record["impact_count"]), int(record["status"])
    if count > case.budget + LOOK_AFTER:
        yield f"{count} landings exceed the budget of {case.budget}"
    if status == Status.NON_FINITE:
        return
    landing, liftoff = record["landing_time"][:count], record["liftoff_time"][:count]
    speed, rested = record["rebound_velocity"][:count], record["rested"][:count]
    forever = count > 0 and bool(rested[-1]) and np.isnan(speed[-1])
    leaving = count - 1 if forever else count
    if not np.isfinite(landing).all() or not np.isfinite(speed[:leaving]).all():
        yield "a value is not finite"
        return
    if status == Status.COMPLETED and not np.isnan(record["landing_time"][count:]).all():
        yield "there are landings past the last one"
    slack = rounding(case)
    if np.any(landing > case.duration + slack) or np.any(np.diff(landing) < -slack):
        yield "landings are not in order, or past the end"
    moved = liftoff[:leaving] - landing[:leaving]
    if np.any(moved < -slack) or np.any(moved[rested[:leaving] == 0] != 0.0):
        yield "a lift-off is not where its landing is"
    if case.base != SPRUNG:
        check = check_absolute_speeds if case.base == "moving" else check_speeds
        yield from check(case, speed[:leaving])


def check_speeds(case: Case, speed: np.ndarray) -> Iterator[str]:
    """Every impact lies in the strip, and no speed beyond its bound."""
    e, kick, first = (case.scene[n] for n in ("restitution", "amplitude", "launch_velocity"))
    arrival = np.concatenate([[first], speed[:-1]])[: speed.size]
    scale = np.maximum(np.maximum(speed, e * arrival), kick) + TINY
    if np.any(np.abs(speed - e * arrival) > kick + 16.0 * ULP * scale):
        yield "an impact outside the strip |v' - e v| <= A"
    if e < 1.0:
        largest = max(first, kick / (1.0 - e)) if kick > 0.0 else first
        if np.any(speed > largest * (1.0 + 32.0 * ULP) + TINY):
            yield "a speed beyond max(v0, A / (1 - e))"


def check_absolute_speeds(case: Case, speed: np.ndarray) -> Iterator[str]:
    """No speed falls below that of the base, or goes beyond its bound."""
    e, first = case.scene["restitution"], case.scene["launch_velocity"]
    fastest = case.scene["amplitude"] / (1.0 + e)
    if np.any(speed < -fastest * (1.0 + 32.0 * ULP) - TINY):
        yield "a particle leaves into the base"
    if e < 1.0:
        largest = max(first, (1.0 + 3.0 * e) * fastest / (1.0 - e))
        if np.any(speed > largest * (1.0 + 32.0 * ULP) + TINY):
            yield "a speed beyond max(v0, (1 + 3 e) V0 / (1 - e))"


def check_measures(
    case: Case, measured: dict[str, np.ndarray], record: dict[str, np.ndarray]
) -> Iterator[str]:
    """Faults of the measures of a sweep: counts, and numbers that are neither finite nor absent."""
    status = int(measured["status"][0])
    if status not in list(Status):
        yield f"status {status} has no meaning"
        return
    if status != Status.COMPLETED:
        return
    if record["status"].any():  # unlike a record, a recurrence is counted to the end
        return
    times, slack = record["landing_time"][0], rounding(case)
    most = int((times >= case.transient - slack).sum())
    least = int((times > case.transient + slack).sum())
    count = int(measured["impact_count"][0])
    if not least <= count <= most:
        yield f"{count} landings counted, {least} to {most} recorded"
    flies = count > resting_for_good(case, measured, record)
    for name in ("rebound_height_mean", "rebound_height_max", "flight_time_mean"):
        value = float(measured[name][0])
        if np.isnan(value) == flies or np.isinf(value):
            yield f"{name} = {value} with flights: {flies}"
    for name in ("dt_min", "dt_min_same_index"):
        value = float(measured[name][0])
        if value < 0.0 or np.isinf(value):
            yield f"{name} = {value}"


def resting_for_good(
    case: Case, measured: dict[str, np.ndarray], record: dict[str, np.ndarray]
) -> int:
    """Landings in the window that no flight follows."""
    if case.base == SPRUNG:  # such a particle may ride the base at the end without a lift-off
        last = ~np.isfinite(record["liftoff_time"][0])
        return int((last & (record["landing_time"][0] >= case.transient)).sum())
    if case.scene["amplitude"] > 0.0:
        batch = batch_of([case.single], case.law, case.base)
        if bases.lifts(batch.base, batch.problem)[0]:
            return 0
    return int(measured["rest_count"][0])


def check_coupled(case: Case, found: Findings) -> None:
    """All landings of a short realization against proved ones."""
    if found.landings > COUPLED_LANDINGS or case.duration <= 0.0:
        return
    state, landings, _, share = compare_coupled(
        case.scene, case.launch, case.duration, COUPLED_LANDINGS
    )
    if state == "compared":
        found.compared += landings
        found.bound_share = share
    if state == "different" or share > 1.0:
        found.faults.append(f"coupled landings: {state}, {share:.3g} of what is claimed")


def check_steps(case: Case, found: Findings) -> None:
    """Error of each single step of the first particle, from the kernel's own state before it."""
    batch = batch_of([case.single], case.law)
    problem = batch.problem
    landings, inside = orbit(batch, 0, CAPACITY)
    n, x = launch(batch.launches, 0, 0, problem.phase[0])
    n -= problem.end_count[0]
    u, e, a = problem.launch_flight[0], problem.restitution[0], problem.kick[0]
    with ctx.workprec(BITS):
        for count, phase, flight, rested in landings[:inside].tolist():
            if max(abs(count), abs(n), u) > 2.0**52:
                return  # such counts are not exact
            flown = arb(u)
            apart = (arb(x) + flown) - (arb(count) - arb(n)) - arb(phase)
            found.phase_ulp = max(found.phase_ulp, float(apart.abs_upper()) / ULP)
            w = arb(e) * flown + arb(a) * (2 * arb(phase)).sin_pi()
            if not rested:
                larger = max(e * u, a * abs(np.sin(2.0 * np.pi * phase)), flight)
                error = float((abs(w) - arb(flight)).abs_upper())
                found.flight_ulp = max(found.flight_ulp, error / np.spacing(larger))
            if np.isinf(flight):
                return
            n, x, u = count, phase, flight
            if rested:
                x = problem.liftoff_phase[0]
                n += 1.0 if phase > x else 0.0


@njit(error_model="numpy", nogil=True)
def flights_of(batch, capacity):
    """Phase and relative speed at the beginning of the first particle's flights; alpha."""
    problem = batch.problem
    fixed = bases.constants(batch.base, problem, 0)
    found, k = np.empty((capacity, 2)), 0
    n, x = launch(batch.launches, 0, 0, problem.phase[0])
    n -= problem.end_count[0]
    u = launch_speed(fixed, problem, 0, x)
    while k < capacity and n <= problem.end_phase[0] - x:
        if u > 0.0 or x == fixed.x_lift:  # else it lands at once
            found[k, 0], found[k, 1] = x, u
            k += 1
        hit = impact(fixed, n, x, u)
        if u <= 0.0 and not hit.u > 0.0 and hit.leaves:
            break
        n, x, u = hit.n_off, hit.x_off, hit.u
    return found[:k], fixed.alpha


MOST_GAMMA, LONGEST = 100.0, 50.0  # up to which the certain search is fast
SLOWEST = 1e-100  # squares of smaller speeds lose digits
# A base above 1 g by less throws a resting particle no higher than the search's own rounding.
NEAREST = 1e-11


def check_landings(case: Case, found: Findings) -> None:
    """Landings of the first particle on the moving base against the search that misses none."""
    states, alpha = flights_of(batch_of([case.single], case.law, case.base), CAPACITY)
    speeds = states[:, 1]
    thrown = (speeds == 0.0) & (np.pi * alpha > 1.0 + NEAREST)
    states = states[(speeds + alpha < LONGEST) & ((speeds > SLOWEST) | thrown)]
    if states.size == 0 or np.pi * alpha > MOST_GAMMA:
        return
    x, y = np.ascontiguousarray(states.T)
    verdicts = judge(Flights(np.full(x.size, alpha), x, y), threads=1)
    if verdicts.missed.any():
        found.faults.append("a landing is not the first root")
    for errors in (verdicts.error, verdicts.speed_error):
        worst = float(np.max(errors, initial=0.0, where=~np.isnan(errors)))
        found.forced_share = max(found.forced_share, worst)
    if found.forced_share > LARGEST_ERROR:
        found.faults.append(f"a landing errs by {found.forced_share:.3g} times what is forced")


def check_bounds(case: Case, found: Findings) -> None:
    """The first particle's error bounds against the proved reference."""
    job = kernel_jobs([case.single], case.law, CAPACITY, case.budget, case.base)[0]
    verdict = compare(job)
    found.compared += verdict.compared
    found.faults += [f"bound: {fault}" for fault in verdict.faults]
    for error, bound in (
        (verdict.landing, verdict.bound),
        (verdict.flight, verdict.flight_bound),
    ):
        if error > 0.0 and bound > 0.0:
            found.bound_share = max(found.bound_share, error / bound)
