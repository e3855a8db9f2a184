"""The error of one map step, and of a locked orbit after many, against ball arithmetic.

    python checks/map_error.py [--states 1000000] [--seed 1] [--write]

One step: x' = x + u and w = e u + a sin(2 pi x') at random states.  Two errors of w are told
apart: against the exact w at the phase that the kernel computed, which is the arithmetic alone,
and against the exact w at the exact phase, which the rounding of the phase moves by up to
2 pi a 2^-54.

Locked orbits: the map is iterated from the double nearest to the fixed point, and from a little
beside it, and the phase is compared with the closed form sin(2 pi x) = (1 - e) k / a at the exact
doubles e and a.  The same map with a running time and a library sine is iterated for comparison.
"""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np
from flint import arb, ctx
from numba import njit

from accuracy import bare_problem, options_of, provenance, table, write_section
from vibrosweep.kernels.bases import constants, fly, rebound
from vibrosweep.kernels.impact import base_of, land

BASE = base_of("high-bounce", "rest")
BITS = 192
BESIDE = 1e-4  # turns
TURN_HALF_ULP = 2.0**-54  # largest rounding of a landing phase
SINE_ERROR = 3.5 * 2.0**-53


@njit(error_model="numpy")
def step(fixed, x, u):
    """Phase, whole periods and w after one impact."""
    flight, v = fly(fixed, x, u)
    phase, passed = land(x, flight)
    return phase, passed, rebound(fixed, phase, v)


@njit(error_model="numpy")
def _step_all(base, problem, x, u):
    found = np.empty((x.size, 3))
    for i in range(x.size):
        found[i, 0], found[i, 1], found[i, 2] = step(constants(base, problem, i), x[i], u[i])
    return found


def step_all(x, u, e, a):
    """Phase, whole periods and w after one impact of each state."""
    return _step_all(BASE, bare_problem(e, a), x, u)


@njit(error_model="numpy")
def visited(base, problem, x, impacts):
    """States before each impact of orbits that start with flight 1; negative w are reflected."""
    found = np.empty((x.size, impacts, 2))
    for i in range(x.size):
        phase, flight = x[i], 1.0
        for k in range(impacts):
            found[i, k, 0], found[i, k, 1] = phase, flight
            phase, _, flight = step(constants(base, problem, i), phase, flight)
            flight = abs(flight)
    return found


def orbit_states(states: int, rng: np.random.Generator) -> list[np.ndarray]:
    """States of orbits of sweeps/paper.toml: $e$ 0.80-0.98, $A$ 0.2-3.5 m/s, 1 Hz, 9.81 m/s²."""
    impacts = 50
    size = -(-states // impacts)
    e, a = rng.uniform(0.80, 0.98, size), rng.uniform(0.2, 3.5, size) * 2.0 / 9.81
    found = visited(BASE, bare_problem(e, a), rng.uniform(-0.5, 0.5, size), impacts)
    found = found.reshape(-1, 2)[:states]
    parameters = [np.repeat(v, impacts)[:states] for v in (e, a)]
    return [np.ascontiguousarray(found[:, 0]), np.ascontiguousarray(found[:, 1]), *parameters]


def box_states(states: int, rng: np.random.Generator) -> list[np.ndarray]:
    """States with all digits from wide ranges: $e$ 0-1, $a$ 0.01-10, $u$ 0.001-100 periods."""
    odd = 1.0 - 1e-7 * math.pi  # fills the last digits, which a generator leaves zero
    x, e = rng.uniform(-0.5, 0.5, states) * odd, rng.uniform(0.0, 1.0, states) * odd
    return [x, 10.0 ** rng.uniform(-3.0, 2.0, states), e, 10.0 ** rng.uniform(-2.0, 1.0, states)]


class StepErrors(NamedTuple):
    """Errors of one step: of the phase, of w at the computed phase, of w; and w itself."""

    phase: np.ndarray
    own: np.ndarray
    full: np.ndarray
    w: np.ndarray


def step_errors(given: list[np.ndarray], found: np.ndarray) -> StepErrors:
    errors = StepErrors(*(np.empty(found.shape[0]) for _ in range(4)))
    with ctx.workprec(BITS):
        for i, (x, u, e, a) in enumerate(zip(*(v.tolist() for v in given), strict=True)):
            phase, periods, w = found[i].tolist()
            flown, kick = arb(u), arb(a)
            exact, kept = arb(x) + flown, arb(e) * flown
            truth = kept + kick * (2 * exact).sin_pi()
            errors.phase[i] = exact - periods - phase
            errors.own[i] = kept + kick * (2 * arb(phase)).sin_pi() - w
            errors.full[i] = truth - w
            errors.w[i] = truth
    return errors


def share(name: str, where: str, errors: np.ndarray, unit: np.ndarray | float) -> list[str]:
    """A row: how many errors are within 1 and 2 units, and the largest."""
    quotient = np.abs(errors) / unit
    within = [f"{100.0 * np.mean(quotient <= limit):.3f} %" for limit in (1.0, 2.0)]
    return [name, where, f"{quotient.size:,}", *within, f"{quotient.max():.3g}"]


def step_rows(given: list[np.ndarray]) -> list[list[str]]:
    x, u, e, a = given
    found = step_all(x, u, e, a)
    errors = step_errors(given, found)
    phase, w = found[:, 0], np.abs(errors.w)
    larger = np.maximum(e * u, a * np.abs(np.sin(2.0 * np.pi * phase)))
    whole = w >= 0.5 * larger
    # cases in which the phase was rounded less finely than its own ulp
    coarse = np.abs(x + (u - np.rint(u))) > 0.5
    safe = ~coarse | (np.abs(phase) >= 0.125)
    ulp_x, ulp_w, ulp_larger = np.spacing(np.abs(phase)), np.spacing(w), np.spacing(larger)
    moved = 2.0 * np.pi * a * np.abs(np.cos(2.0 * np.pi * phase)) * TURN_HALF_ULP
    both = "$w$ not below half its larger term"
    return [
        share("$x'$, ulp of $x'$", "all", errors.phase, ulp_x),
        share("$x'$, ulp of $x'$", "unless \\|x + u\\| wraps to \\|x'\\| < 1/8",
              errors.phase[safe], ulp_x[safe]),
        share("$x'$, ulp of a turn ($2^{-53}$)", "all", errors.phase, 2.0**-53),
        share("$w$ at the computed $x'$, ulp of $w$", "all", errors.own, ulp_w),
        share("$w$ at the computed $x'$, ulp of $w$", both, errors.own[whole], ulp_w[whole]),
        share("$w$ at the computed $x'$, ulp of its larger term", "all", errors.own, ulp_larger),
        share("$w$ at the exact $x'$, ulp of $w$", "all", errors.full, ulp_w),
        share("$w$ at the exact $x'$, ulp of $w$", both, errors.full[whole], ulp_w[whole]),
        share("$w$ at the exact $x'$, ulp of its larger term plus the effect of $2^{-54}$ "
              "turns of phase", "all", errors.full, ulp_larger + moved),
    ]  # fmt: skip


@njit(error_model="numpy")
def iterate(base, problem, x, u, impacts):
    """The kernel's map; returns phase and flight after so many impacts."""
    fixed = constants(base, problem, 0)
    for _ in range(impacts):
        x, _, u = step(fixed, x, u)
    return x, u


@njit(error_model="numpy")
def iterate_naive(x, u, e, a, impacts):
    """Iterate the map with a running time and omega t inside the library's sine."""
    t = x
    for _ in range(impacts):
        t = t + u
        u = e * u + a * math.sin(2.0 * math.pi * t)
    return t, u


class Locked(NamedTuple):
    """A locked orbit: parameters, and its fixed point as a ball."""

    k: int
    e: float
    a: float
    x: arb


def locked(k: int, e: float, a: float) -> Locked:
    ratio = (1 - arb(e)) * k / arb(a)
    return Locked(k, e, a, arb("0.5") - ratio.asin() / (2 * arb.pi()))


def forced(orbit: Locked) -> float:
    """Error forced by the conditioning: the largest phase error from roundings of each step.

    Errors of the phase (2^-54 turns), and of w (the sine's, a product's and a sum's rounding) enter
    at each impact, and the Jacobian carries them on; this is their sum with the worst signs.
    """
    need = (1.0 - orbit.e) * orbit.k
    slope = -2.0 * math.pi * math.sqrt((orbit.a - need) * (orbit.a + need))
    matrix = np.array([[1.0, 1.0], [slope, orbit.e + slope]])
    into_w = (SINE_ERROR + 2.0**-53) * need + 2.0**-53 * orbit.k
    entering = np.array([[TURN_HALF_ULP, 0.0], [slope * TURN_HALF_ULP, into_w]])
    total, carried = 0.0, entering
    for _ in range(1_000_000):
        total += float(np.abs(carried[0]).sum())
        carried = matrix @ carried
        if np.abs(carried).max() < 1e-30:
            break
    return total


def distance(phase: float, orbit: Locked) -> float:
    """Distance of phases modulo one turn."""
    apart = orbit.x - arb(phase)
    return abs(float(apart - (apart + arb("0.5")).mid().floor()))


LOCKED = (
    # k, e, a: Table 1, its second mode, near both ends of windows, weak and strong contraction
    (1, 0.9, 2.0 * 1.2 / 9.81),
    (2, 0.9, 2.0 * 1.2 / 9.81),
    (1, 0.9, 0.1001),
    (1, 0.9, 0.61),
    (1, 0.5, 0.6),
    (3, 0.98, 0.4),
    (1, 0.999, 0.3),
    (10, 0.9, 1.1),
)


def locked_row(k: int, e: float, a: float, impacts: int) -> tuple[list[str], float]:
    with ctx.workprec(BITS):
        orbit = locked(k, e, a)
        start, flight = float(orbit.x), float(k)
        problem = bare_problem(np.array([e]), np.array([a]))
        ends = (
            iterate(BASE, problem, start, flight, impacts)[0],
            iterate(BASE, problem, start + BESIDE, flight, impacts)[0],
            iterate_naive(start, flight, e, a, impacts)[0],
        )
        error, beside, naive = (distance(end, orbit) for end in ends)
        limit = forced(orbit)
    excess = max(error, beside) - limit
    numbers = (error, beside, limit, max(0.0, excess), naive)
    cells = [k, e, f"{a:.6g}", f"{start:.10f}", f"{impacts:.0e}", *(f"{v:.2e}" for v in numbers)]
    return cells, excess


UNBOUNDED = (
    "$x'$, ulp of $x'$",
    "$w$ at the computed $x'$, ulp of $w$",
    "$w$ at the exact $x'$, ulp of $w$",
)
STEP_HEAD = ("quantity and unit", "states", "number", "within 1", "within 2", "largest")
LOCKED_HEAD = ("$k$", "$e$", "$a$", "phase, turns", "impacts", "error, turns", "started nearby",
               "forced", "excess", "naive form")  # fmt: skip
SHORT = (0, 1, 2, 4, 5, 6, 7, 9)  # columns of the report


def main() -> None:
    options = options_of(__doc__, states=(1_000_000, "of each kind"), impacts=1_000_000, seed=1)
    show = write_section if options.write else (lambda name, text: print(text, "\n"))
    began, rng = time.perf_counter(), np.random.default_rng(options.seed)
    largest = {}
    for draw in (orbit_states, box_states):
        rows = step_rows(draw(options.states, rng))
        print(table(STEP_HEAD, rows), "\n")
        for name, states, *_, error in rows:
            if states == "all" and name not in UNBOUNDED:
                largest.setdefault(name, []).append(error)
    ranges = (draw.__doc__.partition(": ")[2].rstrip(".") for draw in (orbit_states, box_states))
    text = table(("largest error of", *ranges), [(name, *v) for name, v in largest.items()])
    show("step", f"{text}\n\n{provenance(time.perf_counter() - began, options.seed)}")
    began = time.perf_counter()
    rows = [locked_row(*case, options.impacts) for case in LOCKED]
    rows.append(locked_row(*LOCKED[-1], 100 * options.impacts))  # 10^9 periods
    print(table(LOCKED_HEAD, [row for row, _ in rows]), "\n")
    excess = max(excess for _, excess in rows)
    short = [[row[k] for k in SHORT] for row in (LOCKED_HEAD, rows[0][0], rows[-1][0])]
    text = f"{table(short[0], short[1:])}\n\n{provenance(time.perf_counter() - began, None)}"
    show("locked", text)
    raise SystemExit(1 if excess > 1e-15 else 0)


if __name__ == "__main__":
    main()
