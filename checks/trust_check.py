"""The error bounds of `kernels.trust` against the proved reference, on random trajectories.

    python checks/trust_check.py [--trajectories 10000] [--seed 1] [--write]

The phases and counts of the kernel are compared, not its times in s: a double of seconds is too
coarse late in a run.  The bound of each landing is found from many tolerances.
"""

from __future__ import annotations

import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context

import numpy as np

from accuracy import batch_of, options_of, orbit, provenance, show, table
from vibrosweep.kernels.trust import empty_trust, trust
from vibrosweep.model.measures import Status
from vibrosweep.model.parameters import Dimensionless, Launches
from vibrosweep.proof.reference.arithmetic import UndecidableError, arb, ctx
from vibrosweep.proof.reference.motion import Trajectory
from vibrosweep.proof.reference.trajectories import trajectory

KINDS = (("high-bounce", "rest"), ("high-bounce", "reflect"), ("moving", "rest"))
CAPACITY = 2000  # landings of one trajectory that are compared
BUDGET = 200_000
TURN = 2.0 * np.pi  # rad
TOLERANCES = np.append(10.0 ** np.arange(-16.0, -0.9, 0.5), np.inf)
SPECIAL_RESTITUTION = (0.0, 1e-12, 0.5, 0.9, 1.0 - 1e-12, 1.0)


def draw(rng: np.random.Generator) -> dict[str, float]:
    """A scene from the whole range of parameters, with special values among them."""
    frequency, gravity = 10.0 ** rng.uniform(-2.0, 2.0), 10.0 ** rng.uniform(-1.0, 2.0)
    speed = gravity / (2.0 * frequency)
    restitution = rng.choice(
        [rng.uniform(), 1.0 - 10.0 ** rng.uniform(-6.0, 0.0), rng.choice(SPECIAL_RESTITUTION)],
        p=[0.6, 0.2, 0.2],
    )
    kick = 0.0 if rng.uniform() < 0.02 else 10.0 ** rng.uniform(-3.0, 1.0)
    contact = 10.0 ** rng.uniform(-9.0, -1.0)
    if rng.uniform() < 0.03:  # a kick that barely lifts a resting particle
        kick = contact * (1.0 + rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-16.0, 0.0))
    flights = [0.0, rng.uniform(0.0, 3.0), rng.uniform(0.0, 40.0)]
    flight = float(rng.choice(flights, p=[0.1, 0.7, 0.2]))
    starts = [0.0, rng.uniform(-1.0, 1.0), rng.uniform(-1e3, 0.0), rng.uniform(-1e9, 1e9)]
    periods = float(rng.choice(starts, p=[0.1, 0.5, 0.2, 0.2]))
    horizon = rng.uniform(1.0, 50.0)
    return {
        "restitution": float(restitution),
        "amplitude": kick * speed,
        "frequency": frequency,
        "phase": float(rng.choice([0.0, rng.uniform(-7.0, 7.0), rng.uniform(-1e9, 1e9)])),
        "gravity": gravity,
        "launch_velocity": flight * speed,
        "contact_time": contact / frequency,
        "launch_time": periods / frequency,
        "duration": (periods + horizon) / frequency,
    }


def draw_moving(rng: np.random.Generator) -> dict[str, float]:
    """A scene for the moving base: Gamma from 0.01 to 10, some launched as fast as the base."""
    scene = draw(rng)
    e, frequency = scene["restitution"], scene["frequency"]
    speed = scene["gravity"] / (2.0 * frequency)
    gamma = 10.0 ** rng.uniform(-2.0, 1.0)
    if rng.uniform() < 0.03:  # a base that hardly lifts a resting particle
        gamma = 1.0 + rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-16.0, -1.0)
    periods = scene["launch_time"] * frequency
    largest = gamma / np.pi * speed
    launch_velocity = scene["launch_velocity"]
    if rng.uniform() < 0.1:
        launch_velocity = largest * max(0.0, np.sin(TURN * periods + scene["phase"]))
    return scene | {
        "amplitude": (1.0 + e) * largest,
        "launch_velocity": launch_velocity,
        "contact_time": 10.0 ** rng.uniform(-6.0, -3.0) / frequency,
        "duration": (periods + rng.uniform(5.0, 60.0)) / frequency,
    }


@dataclass
class Job:
    """One trajectory of the kernel, with its bounds, for the comparison in another process."""

    scene: dict[str, float]
    base: str
    law: str
    landings: np.ndarray  # shape (landing, 4); counts include the whole turns of the phase
    finite: bool  # no decision was uncertain
    cut: bool  # there are more landings than were kept
    bound: float
    flight_bound: float
    prefixes: list[tuple[float, int]]  # tolerance, landings trusted to it


@dataclass
class Verdict:
    """Largest errors, their bounds, and faults."""

    compared: int = 0
    landing: float = np.nan
    flight: float = np.nan
    bound: float = np.nan
    flight_bound: float = np.nan
    faults: list[str] = field(default_factory=list)


def kernel_jobs(
    scenes: list[dict[str, float]],
    law: str,
    capacity: int = CAPACITY,
    budget: int = BUDGET,
    base: str = "high-bounce",
) -> list[Job]:
    """Orbits of all scenes, up to a capacity, and their bounds."""
    batch = batch_of(scenes, law, base)
    problem, start = batch.problem, batch.launches
    size, asked = len(scenes), TOLERANCES.size
    repeated = batch._replace(
        problem=Dimensionless._make([*(np.repeat(v, asked) for v in problem[:-1]), None]),
        launches=Launches._make(np.repeat(values, asked, axis=0) for values in start),
    )
    out = empty_trust(size * asked)
    trust(0, size * asked, repeated, np.tile(TOLERANCES, size), budget, out)
    until = out.until.reshape(size, asked)
    jobs = []
    for i, scene in enumerate(scenes):
        found, inside = orbit(batch, i, capacity)
        found = found[:inside]
        times = (found[:, 0] + problem.end_count[i]) + (found[:, 1] - problem.phase[i])
        prefixes = [
            (tolerance, trusted(times, last))
            for tolerance, last in zip(TOLERANCES, until[i], strict=True)
        ]
        found[:, 0] += problem.end_count[i] + np.rint(scene["phase"] / TURN - problem.phase[i])
        last = i * asked + asked - 1
        finite = bool(np.isfinite(out.landing_error[last]))
        jobs.append(
            Job(
                scene,
                base,
                law,
                found,
                finite,
                inside == capacity,
                float(out.landing_error[last]),
                float(out.flight_error[last]),
                prefixes,
            )
        )
    return jobs


def trusted(times: np.ndarray, until: float) -> int:
    """Landings up to the one at `until`; infinite means all of them, NaN none."""
    if np.isnan(until):
        return 0
    return min(int(np.searchsorted(times, until, side="left")) + 1, times.size)


def upper(ball_error: arb) -> float:
    return float(ball_error.abs_upper())


def truth_of(job: Job, complete: bool) -> tuple[Trajectory, int]:
    """The proved trajectory, and the number of its landings that the kernel claims to know.

    The decision after the last of them may be a tie, at which the reference ends too.
    """
    known = job.prefixes[-1][1]
    limit = known + 1 if complete else known
    kind = {"base": job.base, "rebound": job.law}
    try:
        return trajectory(**job.scene, **kind, max_impacts=limit, digits=22), known
    except UndecidableError as error:
        if complete or error.impact < known or known == 1:
            raise
    known -= 1
    return trajectory(**job.scene, **kind, max_impacts=known, digits=22), known


def compare(job: Job) -> Verdict:
    """Compare one trajectory with the reference, landing by landing."""
    verdict = Verdict()
    complete = job.finite and not job.cut
    if job.prefixes[-1][1] == 0 and not complete:
        return verdict
    try:
        truth, known = truth_of(job, complete)
    except UndecidableError as error:
        if complete or job.prefixes[-1][1] > 1:
            verdict.faults.append(f"undecided: {error.decision}")
        return verdict
    if complete and (len(truth.impacts) != known or truth.status is not Status.COMPLETED):
        verdict.faults.append(f"{known} landings, {len(truth.impacts)} in truth")
        return verdict
    errors, flights = [], []
    frequency, gravity = arb(job.scene["frequency"]), arb(job.scene["gravity"])
    certain = known if complete else known - 1  # what follows the last one may be uncertain
    pairs = zip(truth.impacts[:known], job.landings[:known], strict=True)
    for k, (impact, (n, x, u, rested)) in enumerate(pairs):
        errors.append(upper((impact.phase - float(x)) + (impact.count - int(n))))
        if k < certain and (impact.flight is None) != np.isinf(u):
            verdict.faults.append(f"landing {k}: at rest for good or not")
        elif k < certain and impact.rested != bool(rested):
            verdict.faults.append(f"landing {k}: rest or not")
        elif k < certain and impact.flight is not None:
            with ctx.workprec(128):  # no rounding from the change of units
                speed = 2 * frequency / gravity * impact.rebound_velocity
                flights.append(upper(speed - float(u)))
    judge(job, verdict, np.array(errors), flights)
    return verdict


def judge(job: Job, verdict: Verdict, errors: np.ndarray, flights: list[float]) -> None:
    """Compare errors with bounds."""
    verdict.compared = errors.size
    for tolerance, prefix in job.prefixes:
        worst = errors[:prefix].max(initial=0.0)
        if worst > tolerance:
            verdict.faults.append(f"error {worst:.3g} in what is trusted to {tolerance:.3g}")
    if not job.finite or errors.size == 0:
        return
    verdict.landing, verdict.bound = errors.max(), job.bound
    verdict.flight, verdict.flight_bound = max(flights, default=np.nan), job.flight_bound
    if verdict.landing > job.bound:
        verdict.faults.append(f"landing error {verdict.landing:.3g} beyond {job.bound:.3g}")
    if verdict.flight > job.flight_bound:
        verdict.faults.append(f"flight error {verdict.flight:.3g} beyond {job.flight_bound:.3g}")


def ratios(bounds: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Bound over true error where there is an error at all."""
    seen = np.isfinite(bounds) & (errors > 0.0)
    return bounds[seen] / errors[seen]


def summary(kind: str, jobs: list[Job], verdicts: list[Verdict]) -> list[list[object]]:
    """Rows of the table for one base and law: landings, then speeds after them."""
    rows = []
    for what in ("landing", "flight"):
        bounds = np.array(
            [getattr(v, {"landing": "bound"}.get(what, "flight_bound")) for v in verdicts]
        )
        quotient = ratios(bounds, np.array([getattr(v, what) for v in verdicts]))
        quantiles = np.quantile(quotient, [0.0, 0.5])
        rows.append(
            [
                kind,
                {"flight": "speed"}.get(what, what),
                len(jobs),
                sum(v.compared for v in verdicts),
                sum(not job.finite for job in jobs),
                *(f"{q:.3g}" for q in quantiles),
                sum(bool(v.faults) for v in verdicts),
            ]
        )
    return rows


HEAD = (
    "base, law",
    "error of",
    "trajectories",
    "landings compared",
    "lost before the end",
    "bound over error: smallest",
    "median",
    "violations",
)


def main() -> None:
    options = options_of(__doc__, trajectories=(10_000, "in all"), seed=1, processes=2)
    began = time.perf_counter()
    rows, faults = [], []
    with ProcessPoolExecutor(options.processes, get_context("spawn")) as pool:
        for number, (base, law) in enumerate(KINDS):
            rng = np.random.default_rng([options.seed, number])
            make = draw_moving if base == "moving" else draw
            scenes = [make(rng) for _ in range(options.trajectories // len(KINDS))]
            jobs = kernel_jobs(scenes, law, base=base)
            verdicts = list(pool.map(compare, jobs, chunksize=50))
            rows += summary(f"{base}, {law}", jobs, verdicts)
            faults += [(j, v.faults) for j, v in zip(jobs, verdicts, strict=True) if v.faults]
    for job, found in faults[:20]:
        print(job.base, job.law, job.scene, found)
    text = table(HEAD, rows) + "\n\n" + provenance(time.perf_counter() - began, options.seed)
    show(options, "trust", text)
    raise SystemExit(1 if faults else 0)


if __name__ == "__main__":
    main()
