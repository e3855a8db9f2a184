"""The numerics under stress: extreme scenes of every kind, and checks that must hold for each.

    python checks/stress.py [--cases 200] [--seed 1] [--only NAME] [--write]

Every case is computed by the whole engine (statistics, recurrence, separations, error bounds,
record) and checked: numbers finite or documented as absent, landings in order and before the end,
impacts in the strip |v' - e v| <= A, speeds below max(v0, A / (1 - e)), or the bound of the moving
base, the budget respected, each single step within rounding of ball arithmetic, on the moving base
each landing the first root, and the landings within their bounds of the proved reference (of a
base of finite mass, within the estimate of `vibrosweep.proof.claims`).  Only a `ParameterError`
may be raised.
"""

from __future__ import annotations

import argparse
import faulthandler
import time
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from accuracy import options_of, provenance, show, table
from stress_checks import Case, Findings, examine
from stress_exact import EXACT
from trust_check import KINDS
from vibrosweep.engine.workers import Workers
from vibrosweep.model.parameters import LAWS, MOUNT, SPRUNG

RESTITUTION = (0.0, 1e-12, 0.5, 1.0 - 1e-12, 1.0)
KICK = (0.0, 1e-300, 1e-18, 1e-12, 1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9)
CONTACT = (1e-18, 1e-15, 1e-12, 1e-9, 1e-6, 1e-3, 0.1, 1.0, 2.0)  # periods
FREQUENCY = (1e-6, 1e-3, 1.0, 1e3, 1e6)
GRAVITY = (1e-3, 1.0, 9.81, 1e3)
FLIGHT = (0.0, 1e-300, 1e-17, 1e-12, 1e-6, 1.0, 1e3, 1e6, 1e9, 1e12, 1e15)
START = (0.0, -0.25, -1e6, 1e6, -1e9, 1e9, 2.0**50, -(2.0**50))  # periods
ACCELERATION = (1e-12, 1.0 - 2.0**-53, 1.0, 1.0 + 2.0**-52, 1.0 + 1e-12, 1.0 + 1e-6, 1e3)
MASS_RATIO = (0.0, 1e-12, 1e-3, 1.0, 1e3)
MOUNT_FREQUENCY = (1e-3, 0.37, 1.0 - 2.0**-53, 1.0, 7.3, 1e3)  # of the forcing
DAMPING = (0.0, 1e-12, 0.05, 1.0 - 2.0**-53, 1.0, 1.0 + 2.0**-52, 1e3)
HANGS = 600  # s, after which a case counts as hanging

Family = Callable[[np.random.Generator, str], Case]


def case(
    rng: np.random.Generator,
    law: str,
    *,
    restitution: float | None = None,
    kick: float | None = None,
    acceleration: float | None = None,
    frequency: float | None = None,
    gravity: float | None = None,
    phase: float | None = None,
    flight: float | None = None,
    contact: float | None = None,
    contact_seconds: float | None = None,
    starts: tuple[float, ...] | None = None,
    periods: float | None = None,
    transient: float = 0.0,
    budget: int = 4000,
) -> Case:
    """A case from dimensionless numbers; those not given are drawn from moderate ranges."""

    def drawn(value: float | None, low: float, high: float) -> float:
        return rng.uniform(low, high) if value is None else value

    f = 10.0 ** rng.uniform(-1.0, 1.0) if frequency is None else frequency
    g = drawn(gravity, 1.0, 20.0)
    if starts is None:
        starts = tuple(rng.uniform(0.0, 1.0, rng.integers(1, 5)).tolist())
    length = drawn(periods, 1.0, 30.0)
    tau = (10.0 ** drawn(None, -6.0, -1.0) if contact is None else contact) / f
    e = drawn(restitution, 0.0, 1.0)
    if acceleration is not None:  # of the moving base, in units of gravity
        kick = acceleration * (1.0 + e) / np.pi
    scene = {
        "restitution": e,
        "amplitude": (10.0 ** drawn(None, -3.0, 0.5) if kick is None else kick) * g / (2.0 * f),
        "frequency": f,
        "phase": drawn(phase, -7.0, 7.0),
        "gravity": g,
        "launch_velocity": drawn(flight, 0.0, 3.0) * g / (2.0 * f),
        "contact_time": tau if contact_seconds is None else contact_seconds,
    }
    origin = min(starts)
    begin = 0.0 if origin == 0.0 and transient == 0.0 else (origin + transient) / f
    launch = tuple(start / f for start in starts)
    return Case(scene, launch, (origin + length) / f, law, begin, budget)


def one(name: str, values: tuple[float, ...]) -> Family:
    """Cases in which one number is extreme."""
    return lambda rng, law: case(rng, law, **{name: float(rng.choice(values))})


def corners(rng: np.random.Generator, law: str) -> Case:
    """All numbers extreme at once."""
    return case(
        rng,
        law,
        restitution=float(rng.choice(RESTITUTION)),
        kick=float(rng.choice(KICK)),
        frequency=float(rng.choice(FREQUENCY)),
        gravity=float(rng.choice(GRAVITY)),
        phase=float(rng.choice([0.0, np.pi / 2, -1e9, 1e9, 5e-324])),
        flight=float(rng.choice(FLIGHT)),
        contact=float(rng.choice(CONTACT)),
        starts=tuple(rng.choice(START[:4], rng.integers(1, 5)).tolist()),
        periods=float(rng.choice([1e-9, 1.0, 50.0, 1e6])),
    )


def doubles(rng: np.random.Generator, law: str) -> Case:
    """Any doubles from 10^-30 to 10^30, the range of their exponents drawn first."""
    most = float(rng.choice([3.0, 10.0, 30.0]))

    def any_double() -> float:
        return float(10.0 ** rng.uniform(-most, most))

    scene = {
        "restitution": float(rng.choice([*RESTITUTION, rng.uniform()])),
        "amplitude": float(rng.choice([0.0, any_double()])),
        "frequency": min(any_double(), 1e9),
        "phase": float(rng.choice([-1.0, 1.0])) * 10.0 ** rng.uniform(-300.0, 9.0),
        "gravity": any_double(),
        "launch_velocity": float(rng.choice([0.0, any_double()])),
        "contact_time": any_double(),
    }
    duration = float(rng.choice([10.0 / scene["frequency"], any_double()]))
    launch = tuple(float(rng.choice([0.0, duration * rng.uniform(-2.0, 1.0)])) for _ in range(2))
    return Case(scene, launch, duration, law, float(rng.choice([0.0, duration / 2.0])))


def starts(rng: np.random.Generator, law: str) -> Case:
    """Launch times negative, equal, or huge; a window that begins late."""
    first = float(rng.choice(START))
    spread = rng.choice([0.0, 1e-9, 0.25, 1.0, 3.0])
    times = first + spread * np.arange(int(rng.integers(1, 5)))
    return case(rng, law, starts=tuple(times.tolist()), transient=float(rng.choice([0.0, 5.0])))


def late(rng: np.random.Generator, law: str) -> Case:
    """A short window 10^9 periods after time zero."""
    first = 1e9 + rng.uniform(0.0, 1.0)
    return case(rng, law, starts=(first, first + 0.25), transient=float(rng.choice([0.0, 3.0])))


def long(rng: np.random.Generator, law: str) -> Case:
    """10^9 periods, of which the last ten are measured: the budget or a recurrence ends it."""
    budget = int(rng.choice([1000, 100_000]))
    return case(rng, law, starts=(0.0, 0.5), periods=1e9, transient=1e9 - 10.0, budget=budget)


def crowded(rng: np.random.Generator, law: str) -> Case:
    """Almost endless chattering: flights shrink to contact times of 10^-18 periods."""
    number = int(rng.choice([2, 20, 200]))
    return case(
        rng,
        law,
        restitution=1.0 - 10.0 ** rng.uniform(-4.0, -0.3),
        kick=float(rng.choice([0.0, 1e-300, 1e-6, 1e-3, 0.1])),
        flight=10.0 ** rng.uniform(-6.0, 1.0),
        contact=10.0 ** rng.uniform(-18.0, -9.0),
        starts=tuple(rng.choice([0.0, 0.25, 1e-17, 1e-9, 0.3], number).tolist()),
        periods=12.0,
        budget=20_000,
    )


FAMILIES: dict[str, Family] = {
    "restitution 0 ... 1": one("restitution", RESTITUTION),
    "kick 0, 1e-300 ... 1e9": one("kick", KICK),
    "contact time 1e-18 ... 2 periods": one("contact", CONTACT),
    "contact time 1e-12 ... 1 s": one("contact_seconds", (1e-12, 1e-9, 1e-6, 1e-3, 1.0)),
    "frequency 1e-6 ... 1e6 Hz": one("frequency", FREQUENCY),
    "gravity 1e-3 ... 1e3": one("gravity", GRAVITY),
    "launch flight 0 ... 1e15 periods": one("flight", FLIGHT),
    "phase 0 ... 1e9 rad": one("phase", (0.0, 5e-324, np.pi, -1e9, 1e9)),
    "launch times negative, equal, huge": starts,
    "all of these at once": corners,
    "doubles 1e-30 ... 1e30": doubles,
    "window after 1e9 periods": late,
    "1e9 periods": long,
    "endless chatter, 2 to 200 particles": crowded,
}


def accelerations(rng: np.random.Generator, law: str) -> Case:
    """A base that just lifts a resting particle, or just does not, hardly moves, or throws."""
    gamma = float(rng.choice(ACCELERATION))
    return case(rng, law, acceleration=gamma, restitution=float(rng.choice([0.0, 0.5, 0.9, 1.0])))


def as_the_base(rng: np.random.Generator, law: str) -> Case:
    """Launched at rest, slower than the base, as fast as it to a rounding, or a little faster."""
    drawn = case(rng, law, acceleration=10.0 ** rng.uniform(-2.0, 1.0), flight=0.0)
    p = drawn.scene
    turns = p["frequency"] * drawn.launch[0] + p["phase"] / (2.0 * np.pi)
    velocity = p["amplitude"] / (1.0 + p["restitution"]) * np.sin(2.0 * np.pi * turns)
    factor = float(rng.choice([0.0, 0.5, 1.0, 1.0 + 1e-15, 1.0 + 1e-9, 1.001]))
    return replace(drawn, scene=p | {"launch_velocity": max(0.0, factor * velocity)})


def short_and_long_contact(rng: np.random.Generator, law: str) -> Case:
    """Contact times of 1e-30 s, and of many periods, over a base that lifts."""
    seconds = float(rng.choice([1e-30, 1e-20, 10.0, 1e30]))
    return case(
        rng, law, acceleration=rng.uniform(0.5, 5.0), contact_seconds=seconds, budget=20_000
    )


MOVING_FAMILIES: dict[str, Family] = {
    "acceleration 1e-12, 1 and next to it, 1e3": accelerations,
    "launched at rest, slower, as fast as the base": as_the_base,
    "contact time 1e-30 ... 1e30 s": short_and_long_contact,
}


ENDLESS = ("1e9 periods", "endless chatter, 2 to 200 particles")


def families_of(base: str) -> Mapping[str, Family]:
    """Families of scenes that are tried on a base."""
    if base == SPRUNG:  # every landing is followed, however many
        return {name: one for name, one in FAMILIES.items() if name not in ENDLESS}
    return FAMILIES | MOVING_FAMILIES if base == "moving" else FAMILIES


def with_mount(rng: np.random.Generator, drawn: Case) -> Case:
    """The case on a base of finite mass: heavy, as light as a particle, or lighter; any mount."""
    allowed = MOUNT["mount_frequency"]
    natural = drawn.scene["frequency"] * rng.choice(MOUNT_FREQUENCY)
    mount = {
        "mass_ratio": float(rng.choice([*MASS_RATIO, 10.0 ** rng.uniform(-4.0, 0.0)])),
        "mount_frequency": float(np.clip(natural, allowed.low, allowed.high)),
        "mount_damping": float(rng.choice([*DAMPING, rng.uniform(0.0, 2.0)])),
    }
    return replace(drawn, scene=drawn.scene | mount)


def gather(total: Findings, found: Findings) -> None:
    for name in ("cases", "failures", "landings", "refused", "compared"):
        setattr(total, name, getattr(total, name) + getattr(found, name))
    for name in ("phase_ulp", "flight_ulp", "forced_share", "bound_share", "seconds"):
        setattr(total, name, max(getattr(total, name), getattr(found, name)))
    total.ended |= found.ended
    total.faults += found.faults


def run_family(
    family: Family, base: str, law: str, cases: int, seed: int, workers: Workers
) -> Findings:
    """Findings summed over the cases of one family."""
    total = Findings(cases=0)
    for number in range(cases):
        rng = np.random.default_rng([seed, number])
        drawn = replace(family(rng, law), base=base)
        if base == SPRUNG:
            drawn = with_mount(rng, drawn)
        faulthandler.dump_traceback_later(HANGS, exit=True)
        found = examine(drawn, workers)
        faulthandler.cancel_dump_traceback_later()
        if found.faults:
            found.failures = 1
            print(base, law, number, drawn, found.faults, flush=True)
        gather(total, found)
    return total


def cells(total: Findings) -> list[object]:
    """Cells of a row; a quantity of 0 is not measured over this base, and shown as -."""

    def shown(largest: float) -> str:
        return f"{largest:.2f}" if largest > 0.0 else "-"

    return [
        total.cases,
        total.refused,
        f"{total.landings:,}",
        shown(total.phase_ulp),
        shown(total.flight_ulp),
        shown(total.forced_share),
        f"{total.compared:,}",
        shown(total.bound_share),
        total.failures,
    ]


HEAD = (
    "base, law",
    "cases",
    "refused",
    "landings",
    "phase, ulp of a turn",
    "flight, ulp",
    "landing / forced",
    "compared",
    "error / bound",
    "failures",
)


def bounded(options: argparse.Namespace, workers: Workers) -> dict[str, Findings]:
    """Try every family on every base under its laws; sums over the families."""
    sums = {}
    for base, law in (*KINDS, (SPRUNG, LAWS[0])):
        sums[f"{base}, {law}"] = Findings(cases=0)
        for name, family in families_of(base).items():
            if options.only in f"{base} {name}":
                found = run_family(family, base, law, options.cases, options.seed, workers)
                ended = ", ".join(sorted(status.lower() for status in found.ended))
                print(
                    name,
                    base,
                    law,
                    *cells(found),
                    ended,
                    f"{found.seconds:.2f} s",
                    sep=" | ",
                    flush=True,
                )
                gather(sums[f"{base}, {law}"], found)
    return sums


def exact(options: argparse.Namespace, workers: Workers) -> tuple[int, int]:
    """Number of checks of exact identities, and how many failed."""
    checks = failures = 0
    for name, check in EXACT.items():
        for law in LAWS:
            if options.only in name:
                tried, faults = check(law, options.cases, options.seed, workers)
                for fault in faults[:5]:
                    print(law, name, fault, flush=True)
                print(name, law, tried, len(faults), sep=" | ", flush=True)
                checks, failures = checks + tried, failures + len(faults)
    return checks, failures


def main() -> None:
    options = options_of(
        __doc__,
        cases=(200, "of each family and law"),
        seed=1,
        only=("", "bases and families whose name contains this"),
    )
    began = time.perf_counter()
    with Workers(1) as workers:
        sums = bounded(options, workers)
        checks, failures = exact(options, workers)
    text = (
        f"{table(HEAD, [(kind, *cells(found)) for kind, found in sums.items()])}\n\n"
        f"Of {checks:,} checks of exact identities {failures} failed.\n\n"
        f"{provenance(time.perf_counter() - began, options.seed)}"
    )
    show(options, "stress", text)
    raise SystemExit(1 if failures or any(found.failures for found in sums.values()) else 0)


if __name__ == "__main__":
    main()
