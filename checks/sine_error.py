"""The error of the kernels' sine: a proved bound, and the largest error among many phases.

    python checks/sine_error.py [--phases 10000000] [--seed 1] [--write]

The bound counts every rounding of the evaluation as a separate noise (`rounded`), over a fine
partition of the folded phase.
"""

from __future__ import annotations

import math
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import NamedTuple

import numpy as np
from flint import arb, ctx
from numba import njit

from accuracy import options_of, provenance, show, table
from rounded import HALF_ULP, Rounded, constant, distance, exact_fma, rounded_fma, upper
from vibrosweep.kernels import arithmetic
from vibrosweep.kernels._jit import _fma_exact
from vibrosweep.kernels.arithmetic import sin_turns

BITS = 192
TERMS = 12  # of the Taylor polynomial that bounds the approximation on one part
PARTS = 256  # of each factor of two of the phase
SMALLEST = -30  # below 2**SMALLEST turns one estimate covers all
HIGHER = (
    arithmetic.C1,
    arithmetic.C2,
    arithmetic.C3,
    arithmetic.C4,
    arithmetic.C5,
    arithmetic.C6,
    arithmetic.C7,
    arithmetic.C8,
)


def scheme(y, constant, fma):
    """The arithmetic of `sin_turns` on a folded phase, with any kind of number."""
    _, c1, c2, c3, c4, c5, c6, c7, c8 = [None, *map(constant, HIGHER)]
    zero = constant(0.0)
    z = fma(y, y, zero)
    z2 = fma(z, z, zero)
    even, odd = fma(z2, c8, c6), fma(z2, c7, c5)
    even, odd = fma(z2, even, c4), fma(z2, odd, c3)
    even, odd = fma(z2, even, c2), fma(z2, odd, c1)
    even = fma(z2, even, constant(arithmetic.C0_LOW))
    return fma(y, constant(arithmetic.C0_HIGH), fma(y, fma(z, odd, even), zero))


def check_scheme() -> None:
    """Check that the arithmetic that is bounded is that of the kernel, bit for bit."""
    for y in np.random.default_rng(0).uniform(-0.25, 0.25, 2000).tolist():
        if scheme(y, float, _fma_exact) != sin_turns(y):
            raise SystemExit(f"the arithmetic that is proved is not that of sin_turns({y!r})")


def approximation(middle: float, half_width: float) -> float:
    """Largest distance of the polynomial, in exact arithmetic, from the sine on one part."""
    return distance(
        lambda y: scheme(y, arb, exact_fma),
        lambda y: (2 * arb.pi() * y).sin(),
        middle,
        half_width,
        TERMS,
    )


class Bound(NamedTuple):
    """Bounds on one part: absolute, in ulp of the sine, and relative in half ulp."""

    absolute: float
    ulp: float
    relative: float


def bound_part(low: float, high: float) -> Bound:
    middle, half_width = (low + high) / 2, (high - low) / 2
    computed = scheme(Rounded(arb(middle, half_width), {}, 0.0), constant, rounded_fma)
    error = computed.error() + approximation(middle, half_width)
    smallest = float((2 * arb(low)).sin_pi().abs_lower())
    return Bound(error, error / math.ulp(smallest), error / smallest / HALF_ULP)


def bound_small() -> float:
    """Relative bound in half ulp for 0 < y < 2**SMALLEST, where all but 2 pi y is tiny.

    With y divided out: the polynomial's higher part and its rounding, the approximation by its
    Taylor terms, and the rounding of the product and of the sum.
    """
    z = arb(0, 4.0**SMALLEST)
    z_form = Rounded(z, {}, HALF_ULP * 4.0**SMALLEST)
    higher = rounded_fma(z_form, Rounded(arb(arithmetic.C1), {}, 1e-9), constant(arithmetic.C0_LOW))
    two_pi = 2 * arb.pi()
    missing = upper(arb(arithmetic.C0_HIGH) + arb(arithmetic.C0_LOW) - two_pi)
    missing += upper((arb(arithmetic.C1) + two_pi**3 / 6) * z) + 100.0 * 16.0**SMALLEST
    small = upper(higher.exact) + higher.error()
    product = HALF_ULP * small + higher.error()
    total = missing + product + HALF_ULP * (arithmetic.C0_HIGH + small + product)
    return total / float(two_pi.abs_lower()) / HALF_ULP


def prove(parts: int = PARTS) -> Bound:
    """Bounds over all phases whose result is a normal double."""
    with ctx.workprec(BITS):
        bounds = [
            bound_part(math.ldexp(1 + k / parts, b), math.ldexp(1 + (k + 1) / parts, b))
            for b in range(SMALLEST, -2)
            for k in range(parts)
        ]
        small = bound_small()
    return Bound(
        max(part.absolute for part in bounds),
        max(small, *(part.ulp for part in bounds)),
        max(small, *(part.relative for part in bounds)),
    )


@njit(error_model="numpy")
def sines(phases):
    out = np.empty_like(phases)
    for i in range(phases.size):
        out[i] = sin_turns(phases[i])
    return out


def families(total: int, seed: int) -> dict[str, np.ndarray]:
    """Phases of every kind, among them consecutive doubles next to the folds at 1/4 and 1/2."""
    rng = np.random.default_rng(seed)
    part = total // 10
    steps = np.arange(part)
    near_zero = 10.0 ** rng.uniform(-290.0, -1.0, part)
    distance = 10.0 ** rng.uniform(-16.0, -1.0, part)
    signs = rng.choice([-1.0, 1.0], part)
    return {
        "uniform": rng.uniform(-0.5, 0.5, total - 6 * part),
        "at 0, log-uniform distance": signs * near_zero,
        "at 1/4, log-uniform distance": signs * (0.25 + rng.choice([-1.0, 1.0], part) * distance),
        "at 1/2, log-uniform distance": signs * (0.5 - distance),
        "the doubles below 1/4": signs * (0.25 - steps * 2.0**-55),
        "the doubles above 1/4": signs * (0.25 + steps * 2.0**-54),
        "the doubles below 1/2": signs * (0.5 - steps * 2.0**-54),
    }


def true_errors(phases: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Error of each sine, and the true sine rounded."""
    errors, truth = np.empty_like(phases), np.empty_like(phases)
    with ctx.workprec(128):
        for i, (x, s) in enumerate(zip(phases.tolist(), sines(phases).tolist(), strict=True)):
            exact = (2 * arb(x)).sin_pi()
            truth[i] = exact
            errors[i] = exact - s
    return errors, truth


class Worst(NamedTuple):
    """Largest errors of some phases, absolute and in ulp, where they occur, and sum of squares."""

    size: int
    absolute: float
    absolute_at: float
    ulp: float
    ulp_at: float
    squares: float


def sample(phases: np.ndarray) -> Worst:
    errors, truth = true_errors(phases)
    absolute = np.abs(errors)
    in_ulp = absolute / np.spacing(np.abs(truth))
    first, second = int(absolute.argmax()), int(in_ulp.argmax())
    squares = float(np.sum(errors * errors))
    at = float(phases[first]), float(phases[second])
    return Worst(phases.size, absolute[first], at[0], in_ulp[second], at[1], squares)


def worst_of(parts: list[Worst]) -> Worst:
    absolute, in_ulp = max(parts, key=lambda p: p.absolute), max(parts, key=lambda p: p.ulp)
    size, squares = sum(p.size for p in parts), sum(p.squares for p in parts)
    found = absolute.absolute, absolute.absolute_at, in_ulp.ulp, in_ulp.ulp_at
    return Worst(size, *found, squares)


def row(name: str, w: Worst) -> list[str]:
    rms = math.sqrt(w.squares / w.size)
    return [name, f"{w.size:,}", f"{w.absolute:.3e}", f"{w.absolute_at!r}", f"{w.ulp:.3f}",
            f"{w.ulp_at!r}", f"{rms:.2e}"]  # fmt: skip


HEAD = ("phases", "number", "largest error", "at", "largest, ulp", "at", "root mean square")


def main() -> None:
    options = options_of(__doc__, phases=10_000_000, seed=1, processes=2)
    began = time.perf_counter()
    check_scheme()
    proved = prove()
    rows, found = [], []
    with ProcessPoolExecutor(options.processes, get_context("spawn")) as pool:
        for name, phases in families(options.phases, options.seed).items():
            parts = list(pool.map(sample, np.array_split(phases, 1 + phases.size // 100_000)))
            found += parts
            rows.append(row(name, worst_of(parts)))
    total = worst_of(found)
    print(table(HEAD, [*rows, row("all", total)]), "\n")
    text = (
        f"Proved for every phase: error at most {proved.absolute:.3e}, or {proved.ulp:.3f} ulp of "
        f"the sine, or {proved.relative:.3f} half ulp relative to it "
        f"(phases from $2^{{-960}}$ turns on; 0 is exact). "
        f"Largest of {total.size:,} phases: {total.absolute:.3e}, and {total.ulp:.3f} ulp.\n\n"
        f"{provenance(time.perf_counter() - began, options.seed)}"
    )
    show(options, "sine", text)
    within = total.absolute <= proved.absolute and total.ulp <= proved.ulp
    raise SystemExit(0 if within else 1)


if __name__ == "__main__":
    main()
