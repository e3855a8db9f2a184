"""Errors of the laws of restitution in the kernels: proved bounds, and samples.

    python checks/law_error.py [--numbers 20000] [--seed 1] [--write]

All terms but one difference in the slope are positive.  An error is therefore counted in half ulps
(2^-53) relative to its term, weighted by the share of the term in a sum, over parts of y that cover
all speeds.  Between points |de/dv| v is at most e, since E rises.  The coefficients of P are
decimal numbers, up to half an ulp off as doubles.  Logarithm and exponential are within the bounds
that `elementary_error` proves.  It is also proved that the slope falls with the speed, so that its
end values enclose it over a range of speeds.
"""

from __future__ import annotations

import math
import time
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from flint import arb, ctx, fmpq, fmpq_poly

from accuracy import options_of, provenance, show, table
from rounded import HALF_ULP, upper
from vibrosweep.kernels import arithmetic, restitution
from vibrosweep.kernels._jit import _fma_exact
from vibrosweep.kernels.arithmetic import KICK_ERROR
from vibrosweep.kernels.restitution import ratio, scale_of, slope
from vibrosweep.model.restitution_laws import LEAST_VISCOELASTIC, PADE, numbers_of, text_of
from vibrosweep.proof.reference.arithmetic import Jet
from vibrosweep.proof.reference.laws import Laws, _root_at, _slope_at, _terms

BITS = 128
PARTS = 16  # of each factor of two of y
OF_GUESS = 2**10  # parts of each factor of two of t
LEAST, MOST = -100, 103  # powers of two between which y lies: t is from 1e-300 to 2^1024
LEAST_START = -28  # of y_0, from e = 1 - 2^-53 on
SECOND = 1.0 + 1e-9  # factor that covers products of errors


class Counted(NamedTuple):
    """All values of a positive quantity on a part, and its relative error in half ulps."""

    exact: arb
    error: float


def number(value: float) -> Counted:
    """An integer, or a decimal number as a double."""
    return Counted(arb(value), 0.0 if value == int(value) else 1.0)


def counted_fma(a: Counted, b: Counted, c: Counted) -> Counted:
    product = a.exact * b.exact
    total = product + c.exact
    both = a.error + b.error
    weighted = upper(product / total) * both + upper(c.exact / total) * c.error
    return Counted(total, min(weighted, max(both, c.error)) + 1.0)


def counted_product(a: Counted, b: Counted) -> Counted:
    return Counted(a.exact * b.exact, a.error + b.error + 1.0)


def counted_quotient(a: Counted, b: Counted) -> Counted:
    return Counted(a.exact / b.exact, a.error + b.error + 1.0)


def counted_root(a: Counted) -> Counted:
    return Counted(a.exact.sqrt(), 0.5 * a.error + 1.0)


COUNTED: Any = (number, counted_fma, counted_product, counted_quotient, counted_root)
FLOATS: Any = (float, _fma_exact, float.__mul__, float.__truediv__, math.sqrt)


def quotients(y: Any, arithmetic: Any) -> tuple[Any, Any, Any]:
    """P, and y T' / T of its numerator and its denominator T (derivatives of ln T by ln y)."""
    number, fma, times, over, _ = arithmetic
    n1, d2, d3, d4 = map(number, PADE)
    one, square, line = number(1.0), times(y, y), times(n1, y)
    top = fma(n1, y, one)
    bottom = fma(one, top, times(square, fma(y, fma(y, d4, d3), d2)))
    twice, thrice, four = (times(number(f), d) for f, d in ((2.0, d2), (3.0, d3), (4.0, d4)))
    moved = fma(one, line, times(square, fma(y, fma(y, four, thrice), twice)))
    return over(top, bottom), over(line, top), over(moved, bottom)


def step(left: Any, e: Any, y: Any, arithmetic: Any) -> Any:
    """The next y of the iteration for P(y) = e, where `left` is 1 - e."""
    number, fma, times, over, root = arithmetic
    n1, d2, d3, d4 = map(number, PADE)
    below = times(e, fma(y, fma(y, d4, d3), d2))
    return root(over(times(left, fma(n1, y, number(1.0))), below))


def check_schemes() -> None:
    """Check that the arithmetic that is bounded is that of the kernels, bit for bit."""
    draw = np.random.default_rng(0)
    for y in (10.0 ** draw.uniform(-6.0, 3.0, 500)).tolist():
        share, rise, fall = quotients(y, FLOATS)
        if restitution.pade(y) != (share, share * _fma_exact(0.1, rise - fall, 1.0)):
            raise SystemExit("the arithmetic of P that is proved is not that of the kernels")
    for e in draw.uniform(LEAST_VISCOELASTIC, 1.0, 50).tolist():
        y = 0.0
        for _ in range(restitution.STEPS):
            y = step(1.0 - e, e, y, FLOATS)
        if restitution.root_at(e) != y:
            raise SystemExit("the arithmetic of y_0 that is proved is not that of the kernels")


def balls(first: int, last: int) -> list[arb]:
    """Balls that cover [0, 2**last]: parts of each factor of two, and one below 2**first."""
    ends = [arb(0), *(arb(2) ** (arb(k) / PARTS) for k in range(first * PARTS, last * PARTS + 1))]
    return [low.union(high) for low, high in pairwise(ends)]


def guess(t: float) -> float:
    """The first guess of t^(-1/4), from its bits."""
    bits = int(np.float64(t).view(np.int64)) >> 2
    return float(np.int64(int(restitution.QUARTER_BITS) - bits).view(np.float64))


def left_out(most: float) -> float:
    """Relative truncation error of the series of t^(-1/4), for |h| up to `most`.

    The cubic times (1 - h)^(1/4) has the derivative -13/4 Q3 h^3 (1 - h)^(-3/4).
    """
    return 13.0 / 16.0 * restitution.Q3 * most**4 * (1.0 - most) ** -0.75 * SECOND


def fourth_root_bound() -> float:
    """Bound of `inverse_fourth_root`.

    A factor of 16 of t halves the guess exactly, so that t from 1 to 16 suffices.  With
    h = 1 - root^4 t, the next root is t^(-1/4) up to the truncation of the series and roundings:
    of the last sum; of h, three in the fourth power and its own; and of terms that h makes small.
    """
    worst = 0.0
    for k in range(4 * OF_GUESS):
        exponent, part = divmod(k, OF_GUESS)
        low, high = (math.ldexp(1.0 + (part + i) / OF_GUESS, exponent) for i in (0, 1))
        found = arb(guess(low)).union(arb(guess(math.nextafter(high, 0.0))))
        worst = max(worst, upper(1 - found**4 * arb(low).union(arb(high))))
    first = left_out(worst) + 8.0 * HALF_ULP
    h = upper(arb(1, first) ** 4 - 1)
    return (1.0 + 0.75 * (1.0 + 4.0 * h) + 6.0 * h + left_out(h) / HALF_ULP) * SECOND


def start_bound() -> float:
    """Bound of the error of y_0: from the last step, and the remainder of earlier ones."""
    worst = 0.0
    for y in balls(LEAST_START, 0)[1:]:
        one = Counted(arb(1), 1.0)  # 1 - e, which is rounded for e below 1/2
        rounded = step(one, one._replace(error=0.0), Counted(y, 0.0), COUNTED).error
        top, higher, by_top, by_higher = _terms(y)
        contracts = upper(1 + y * (by_top / top - by_higher / higher) / 2)
        worst = max(worst, (rounded + contracts**restitution.STEPS / HALF_ULP) / (1.0 - contracts))
    return worst * SECOND


def share_and_slope_bounds() -> tuple[float, float]:
    """Bounds of P for an exact y, relative, and of q for the y of the kernels, absolute."""
    of_share = of_slope = 0.0
    of_root, of_log = (e / HALF_ULP for e in (restitution.ROOT_ERROR, restitution.LOG_ERROR))
    for y in balls(LEAST, MOST):
        share, rise, fall = quotients(Counted(y, 0.0), COUNTED)
        of_share = max(of_share, share.error)
        between = upper(rise.exact - fall.exact)
        errors = upper(rise.exact) * rise.error + upper(fall.exact) * fall.error + between
        # the factor 1 + (rise - fall) / 10 is from 0.7 to 1, and 0.1 is half an ulp off
        exactly = upper(share.exact) * (share.error + 2.0 + 0.1 * (errors + between))
        by_log = _slope_at(Jet(y, [y])).d[0]
        off = of_root + of_log * upper(y.max(arb("1e-30")).log())
        of_slope = max(of_slope, exactly + upper(by_log) * off)
    return of_share * SECOND, of_slope * SECOND


def slope_falls() -> bool:
    """Prove that q falls with the speed: its derivative is a quotient of polynomials of y > 0.

    With numerator T and denominator B = T + H of P, q = M / (10 B^2), where
    M = 10 T B + y (T' H - T H').
    """
    n1, d2, d3, d4 = (fmpq(round(c * 10**6), 10**6) for c in PADE)
    top, higher = fmpq_poly([1, n1]), fmpq_poly([0, 0, d2, d3, d4])
    bottom, by_top, by_higher = top + higher, top.derivative(), higher.derivative()
    m = 10 * top * bottom + fmpq_poly([0, 1]) * (by_top * higher - top * by_higher)
    falls = m.derivative() * bottom - 2 * m * (by_top + by_higher)
    return all(c < 0 for c in falls.coeffs()[1:]) and falls[0] == 0


def prove() -> dict[str, float]:
    """Bounds in half ulps, by the names of `STATED`."""
    log, exp = (arithmetic.ERRORS[name] / HALF_ULP for name in ("log", "exp"))
    kick, scale = KICK_ERROR / HALF_ULP, STATED["y_0^10 / v_r"]
    speed = restitution.SPEED_ERROR / HALF_ULP
    with ctx.workprec(BITS):
        root, start, (share, slope) = fourth_root_bound(), start_bound(), share_and_slope_bounds()
    return {
        "t^(-1/4)": root,
        # the root of v / v_y, with a product and a quotient; products with e, and with 3/4
        "e(v), plastic": 0.25 * (2.0 + kick) + root + 2.0,
        # v / v_0 to a power of at most 1, two products and 1 - p; logarithm and its product
        "e(v) and q(v), power": speed + exp + 3.0,
        "the same, for 1 of ln (e(v) / e)": log + 1.0,
        # a line of numbers rounded once, at most e and twice e, one sum, and the next line within
        # the error of the speed and that of the point
        "e(v), points": ((1.0 + speed) + 2.0 + 1.0 + (speed + 1.0)) * SECOND,
        "q(v) / e(v), points": (2.0 * (1.0 + speed) + 2.0 + 1.0) * SECOND,
        "y_0": start,
        # nine roundings of the powers, one of the quotient
        "y_0^10 / v_r": 10.0 * STATED["y_0"] + 9.0 + 1.0 + kick,
        "y, at ln y = 0": 0.1 * (scale + 1.0) + exp,
        "y, for 1 of ln y": log + 1.0 + 0.5,  # 0.1 is half an ulp off
        "P(y)": share,
        "q(v)": slope,
    }


STATED = {
    "t^(-1/4)": 2.0,
    "e(v), plastic": restitution.PLASTIC_ERROR / HALF_ULP,
    "e(v) and q(v), power": restitution.POWER_ERROR / HALF_ULP,
    "the same, for 1 of ln (e(v) / e)": restitution.POWER_LOG_ERROR / HALF_ULP,
    "e(v), points": restitution.POINTS_ERROR / HALF_ULP,
    "q(v) / e(v), points": restitution.POINTS_ERROR / HALF_ULP,
    "y_0": 8.0,
    "y_0^10 / v_r": restitution.SCALE_ERROR / HALF_ULP,
    "y, at ln y = 0": restitution.ROOT_ERROR / HALF_ULP,
    "y, for 1 of ln y": restitution.LOG_ERROR / HALF_ULP,
    "P(y)": restitution.PADE_ERROR / HALF_ULP,
    "q(v)": 32.0,  # as `slope_range` widens it
}


def sample(size: int, seed: int) -> dict[str, float]:
    """Largest errors among random arguments, in half ulps."""
    draw = np.random.default_rng(seed)
    worst = dict.fromkeys(STATED, 0.0)
    speeds, powers = draw.uniform(LEAST_VISCOELASTIC, 1.0, size), draw.uniform(-9.0, 9.0, size)
    law, plastic = (restitution.RESTITUTION_OF[name] for name in ("viscoelastic", "plastic"))

    def note(name: str, error: arb) -> None:
        worst[name] = max(worst[name], upper(error) / HALF_ULP)

    for e, power in zip(speeds.tolist(), powers.tolist(), strict=True):
        v = 10.0**power
        note("t^(-1/4)", restitution.inverse_fourth_root(v) * arb(v).root(4) - 1)
        kept = Laws(restitution="plastic").impact(arb(e), arb(0.3)).share(arb(v))
        note("e(v), plastic", ratio(plastic, e, scale_of(plastic, e, 0.3), v) / kept - 1)
        p, e_low = draw.uniform(), e * draw.uniform(0.65, 1.0)
        of_power = text_of("power", p)
        found = restitution.restitution_of(of_power)
        kept = Laws(restitution=of_power).impact(arb(e), arb(0.3)).share(arb(v))
        off = upper(ratio(found, e, scale_of(found, e, 0.3), v) / kept - 1)
        by_log = restitution.POWER_LOG_ERROR * upper((kept / e).log())
        note("e(v) and q(v), power", arb(max(off - by_log, 0.0)))
        points = text_of("points", ((0.1 * draw.uniform(), e), (draw.uniform(0.3, 1.0), e_low)))
        found, speed = restitution.restitution_of(points), numbers_of(points)[-1][0]
        exact, scale = (
            Laws(restitution=points).impact(arb(e), arb(speed)),
            scale_of(found, e, speed),
        )
        t = draw.uniform(0.0, 1.2)
        note("e(v), points", ratio(found, e, scale, t) / exact.share(arb(t)) - 1)
        off = slope(found, e, scale, t) - exact.slope(arb(t))
        note("q(v) / e(v), points", off / exact.share(arb(t)))
        start = _root_at(arb(e))
        note("y_0", restitution.root_at(e) / start - 1)
        scale = scale_of(law, e, 0.3)
        note("y_0^10 / v_r", scale * arb(0.3) / start**10 - 1)
        y = 10.0 ** (0.1 * power)
        top, higher, _, _ = _terms(arb(y))
        note("P(y)", restitution.pade(y)[0] * (top + higher) / top - 1)
        exact = Laws(restitution="viscoelastic").impact(arb(e), arb(0.3)).slope(arb(v))
        note("q(v)", slope(law, e, scale, v) - exact)
    return worst


def main() -> None:
    options = options_of(__doc__, numbers=20_000, seed=1)
    began = time.perf_counter()
    check_schemes()
    proved = prove()
    with ctx.workprec(BITS):
        found = sample(options.numbers, options.seed)
    numbers = ((STATED[name], proved[name], found[name]) for name in STATED)
    rows = [
        [name, f"{stated:g}", f"{bound:.3f}", f"{largest:.3f}" if largest > 0.0 else ""]
        for name, (stated, bound, largest) in zip(STATED, numbers, strict=True)
    ]
    head = ("number", "stated, half ulps", "proved", f"largest of {options.numbers:,}")
    text = f"{table(head, rows)}\n\n{provenance(time.perf_counter() - began, options.seed)}"
    show(options, "laws", text)
    within = all(found[name] <= proved[name] <= STATED[name] for name in STATED)
    raise SystemExit(0 if within and slope_falls() else 1)


if __name__ == "__main__":
    main()
