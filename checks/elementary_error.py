"""Errors of the kernels' logarithm, exponential and arcsine: proved bounds, and samples.

    python checks/elementary_error.py [--numbers 200000] [--seed 1] [--write]

Bounds are relative to the result, in half ulps (2^-53), and count every rounding (`rounded`).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from flint import arb, ctx

from accuracy import options_of, provenance, show, table
from rounded import (
    HALF_ULP,
    Rounded,
    constant,
    distance,
    exact_fma,
    rounded_fma,
    rounded_quotient,
    rounded_root,
    upper,
)
from vibrosweep.kernels import arithmetic
from vibrosweep.kernels._jit import _fma_exact
from vibrosweep.model import parameters as turns

BITS = 192
TERMS = 12
PARTS = 32  # of each factor of two
SMALLEST = -30  # below 2**SMALLEST the first term and its rounding are the error
SMALL = (0.0, 2.0**SMALLEST)  # middle and half width of that part
LOG = [getattr(arithmetic, f"L{i}") for i in range(7)]
EXP = [getattr(arithmetic, f"E{i}") for i in range(10)]
Number = Any
Arithmetic = tuple[Callable[..., Any], Callable[..., Any], Callable[..., Any]]
FLOATS: Arithmetic = (float, _fma_exact, lambda a, b: a / b)
ROUNDED: Arithmetic = (constant, rounded_fma, rounded_quotient)
EXACT: Arithmetic = (arb, exact_fma, lambda a, b: a / b)


def horner(z: Number, coefficients: list[float], arithmetic: Arithmetic) -> Number:
    number, fma, _ = arithmetic
    found = number(coefficients[-1])
    for c in coefficients[-2::-1]:
        found = fma(z, found, number(c))
    return found


def log_head(f: Number, low: Number, arithmetic: Arithmetic) -> Number:
    """Logarithm of 1 + f plus the low part of k ln 2: all of `log` but its last operation."""
    number, fma, quotient = arithmetic
    zero, one = number(0.0), number(1.0)
    s = quotient(f, fma(one, number(2.0), f))
    z = fma(s, s, zero)
    half_square = fma(fma(f, number(0.5), zero), f, zero)
    tail = fma(s, fma(z, horner(z, LOG, arithmetic), half_square), low)
    return fma(number(-1.0), fma(number(-1.0), tail, half_square), f)


def exp_head(r: Number, arithmetic: Arithmetic) -> Number:
    """exp(r) - 1."""
    number, fma, _ = arithmetic
    zero = number(0.0)
    square = fma(r, r, zero)
    cube = fma(square, r, zero)
    higher = horner(r, EXP, arithmetic)
    return fma(number(1.0), fma(cube, higher, fma(square, number(0.5), zero)), r)


def arcsin_head(x: Number, z: Number, arithmetic: Arithmetic) -> Number:
    """Arcsine in turns of x, up to 1/2, without fused operations."""
    number, fma, _ = arithmetic
    zero, one = number(0.0), number(1.0)

    def sum_of_product(a: Number, b: Number, c: Number) -> Number:
        return fma(one, fma(a, b, zero), c)

    higher = number(turns.ARCSINE_HIGHER[0])
    for c in turns.ARCSINE_HIGHER[1:]:
        higher = sum_of_product(higher, z, number(c))
    tail = fma(x, sum_of_product(z, higher, number(turns.ARCSINE_FIRST_LOW)), zero)
    return sum_of_product(x, number(turns.ARCSINE_FIRST), tail)


def check_schemes() -> None:
    """Check that the arithmetic that is bounded is that of the kernels, bit for bit."""
    draw = np.random.default_rng(0).uniform
    pairs = [
        *(
            (log_head(f, 0.0, FLOATS), arithmetic.log_near_one(f, 0.0))
            for f in draw(-0.29, 0.41, 500)
        ),
        *((exp_head(r, FLOATS), arithmetic.exp_near_zero(r)) for r in draw(-0.34, 0.34, 500)),
        *((arcsin_head(x, x * x, FLOATS), turns.arcsin_turns(x)) for x in draw(0.0, 0.5, 500)),
    ]
    if any(mine != kernel for mine, kernel in pairs):
        raise SystemExit("the arithmetic that is proved is not that of the kernels")


def octaves(high: float) -> Iterator[tuple[float, float]]:
    """Middles and half widths of parts that cover [2**SMALLEST, high] and its mirror image."""
    for b in range(SMALLEST, math.ceil(math.log2(high))):
        for k in range(PARTS):
            low = math.ldexp(1 + k / PARTS, b)
            if low < high:
                half = math.ldexp(0.5 / PARTS, b)
                yield from ((low + half, half), (-low - half, half))


def relative(error: float, smallest: float) -> float:
    return error / smallest / HALF_ULP


def ball(middle: float, half: float) -> Rounded:
    return Rounded(arb(middle, half), {}, 0.0)


def log_bound() -> float:
    """Bound of `log` over all positive numbers.

    Near 1 (f below 2**SMALLEST) the square of f, a relative 2**(SMALLEST - 1), and its roundings
    are added to the rounding of the last sum.
    """
    worst = 1.0 + 2.0**SMALLEST * 8.0
    exponents = [(-1, -1), (1, 1), (2, 2), (-2, -2), (3, 1100), (-1100, -3)]
    for middle, half in [SMALL, *octaves(0.4143)]:
        if middle - half < -0.2929:
            continue
        missed = distance(
            lambda f: log_head(f, arb(0.0), EXACT), lambda f: (1 + f).log(), middle, half, TERMS
        )
        f = ball(middle, half)
        if middle != 0.0:
            error = log_head(f, constant(0.0), ROUNDED).error() + missed
            worst = max(worst, relative(error, float((1 + f.exact).log().abs_lower())))
        for first, last in exponents:
            k = arb((first + last) / 2, (last - first) / 2)
            low = rounded_fma(Rounded(k, {}, 0.0), constant(arithmetic.LN2_LOW), constant(0.0))
            wrong = k * (arb(arithmetic.LN2_HIGH) + arb(arithmetic.LN2_LOW) - arb(2).log())
            before = log_head(f, low, ROUNDED).error() + missed + upper(wrong)
            least = float((k * arb(2).log() + (1 + f.exact).log()).abs_lower())
            worst = max(worst, 1.0 + relative(before, least) * (1.0 + HALF_ULP))
    return worst


def reduction_error() -> float:
    """Largest error of the argument of `exp` after the multiple of ln 2 is taken away."""
    wrong = arb(arithmetic.LN2_HIGH) + arb(arithmetic.LN2_LOW) - arb(2).log()
    return 2.0**-55 + 1100.0 * upper(wrong)


def exp_bounds() -> tuple[float, float]:
    """Bounds of `exp`, where its result is a normal number, and of `expm1`."""
    of_exp = of_expm1 = 1.0 + 2.0**SMALLEST * 8.0
    for middle, half in [SMALL, *octaves(0.34662)]:
        missed = distance(lambda r: exp_head(r, EXACT), lambda r: r.exp() - 1, middle, half, TERMS)
        exact = arb(middle, half)
        plain = exp_head(Rounded(exact, {}, 0.0), ROUNDED).error() + missed
        moved = Rounded(exact, {-1: arb(reduction_error())}, 0.0)
        reduced = exp_head(moved, ROUNDED).error() + missed
        near = exact.exp()
        of_exp = max(of_exp, 1.0 + relative(reduced, float(near.abs_lower())))
        if middle != 0.0:
            of_expm1 = max(of_expm1, relative(plain, float((near - 1).abs_lower())))
        for k in (*range(-60, 0), *range(1, 61)):
            power = arb(2) ** k
            error = upper(power) * (reduced + (HALF_ULP if k > 52 else 0.0))
            error += HALF_ULP if k < -52 else 0.0
            least = float((power * near - 1).abs_lower())
            of_expm1 = max(of_expm1, 1.0 + relative(error, least))
    return of_exp, of_expm1


def arcsin_bound() -> float:
    """Bound of `arcsin_turns`; near 0 as for `log`, near 1 only the last rounding counts."""
    worst = 1.0 + 2.0**SMALLEST * 8.0 + relative(upper(_first_of_arcsin()), 0.159)

    def missed(middle: float, half: float) -> float:
        return distance(
            lambda x: arcsin_head(x, x * x, EXACT),
            lambda x: x.asin() / (2 * arb.pi()),
            middle,
            half,
            TERMS,
        )

    for middle, half in octaves(0.5):
        if middle < 0.0:
            continue
        x = ball(middle, half)
        error = arcsin_head(x, rounded_fma(x, x, constant(0.0)), ROUNDED).error()
        error += missed(middle, half)
        worst = max(worst, relative(error, float(x.exact.asin().abs_lower()) / (2.0 * math.pi)))
        z = Rounded(x.exact * x.exact, {}, 0.0)  # x is the root of an exact number here
        near = arcsin_head(rounded_root(z), z, ROUNDED)
        before = 2.0 * (near.error() + missed(middle, half))
        least = float((arb(1) / 4 - 2 * near.exact).abs_lower())
        worst = max(worst, 1.0 + relative(before, least))
    return worst


def _first_of_arcsin() -> arb:
    return arb(turns.ARCSINE_FIRST) + arb(turns.ARCSINE_FIRST_LOW) - 1 / (2 * arb.pi())


def prove() -> dict[str, float]:
    """Bounds in half ulps."""
    with ctx.workprec(BITS):
        of_exp, of_expm1 = exp_bounds()
        return {
            "log": log_bound(),
            "exp": of_exp,
            "expm1": of_expm1,
            "arcsin_turns": arcsin_bound(),
        }


def families(size: int, seed: int) -> dict[str, np.ndarray]:
    """Arguments of each function."""
    draw = np.random.default_rng(seed)
    sign = draw.choice([-1.0, 1.0], size)
    near = 10.0 ** draw.uniform(-16.0, -1.0, size)
    uniform = draw.uniform(-1.0, 1.0, size)
    return {
        "log": np.concatenate([1 + sign * near, np.exp(700 * uniform), draw.uniform(0.5, 2, size)]),
        "exp": np.concatenate([uniform, 700.0 * uniform]),
        "expm1": np.concatenate([sign * near, uniform, 60.0 * uniform]),
        "arcsin_turns": np.concatenate([np.abs(uniform), 1.0 - near, near]),
    }


FUNCTIONS = {
    "log": arithmetic.log,
    "exp": arithmetic.exp,
    "expm1": arithmetic.expm1,
    "arcsin_turns": turns.arcsin_turns,
}
STATED = {**arithmetic.ERRORS, "arcsin_turns": turns.ARCSINE_ERROR}
TRUE: dict[str, Callable[[arb], arb]] = {
    "log": lambda x: x.log(),
    "exp": lambda x: x.exp(),
    "expm1": lambda x: x.expm1(),
    "arcsin_turns": lambda x: x.asin() / (2 * arb.pi()),
}


def sample(name: str, arguments: np.ndarray) -> float:
    """Largest relative error in half ulps."""
    function, worst = FUNCTIONS[name], 0.0
    with ctx.workprec(160):
        for x in arguments.tolist():
            exact = TRUE[name](arb(x))
            if exact != 0:
                worst = max(worst, upper((arb(function(x)) - exact) / exact) / HALF_ULP)
    return worst


def main() -> None:
    options = options_of(__doc__, numbers=200_000, seed=1)
    began = time.perf_counter()
    check_schemes()
    proved, rows, within = prove(), [], True
    for name, arguments in families(options.numbers, options.seed).items():
        found, stated = sample(name, arguments), STATED[name] / HALF_ULP
        rows.append([f"`{name}`", f"{stated:g}", f"{proved[name]:.3f}", f"{found:.3f}"])
        within = within and found <= proved[name] <= stated
    head = ("function", "stated, half ulps", "proved", f"largest of {options.numbers:,} or more")
    text = f"{table(head, rows)}\n\n{provenance(time.perf_counter() - began, options.seed)}"
    show(options, "elementary", text)
    raise SystemExit(0 if within else 1)


if __name__ == "__main__":
    main()
