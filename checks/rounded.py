"""Rounding errors of an evaluation by affine arithmetic: one noise symbol for each rounding.

An error that two operations inherit from the same rounding is counted with its sign, which bounds
by absolute values cannot do.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from flint import arb, arb_series, ctx

HALF_ULP = 2.0**-53


def upper(ball: arb) -> float:
    """A double not below the ball's largest absolute value."""
    return math.nextafter(float(ball.abs_upper()), math.inf)


def half_ulp(largest: float) -> float:
    """Largest rounding error of a result up to that size."""
    return math.ldexp(1.0, math.frexp(largest)[1] - 54)


_names = itertools.count()


@dataclass
class Rounded:
    """Exact values of a quantity on a part, and its rounding error: noises, and a remainder."""

    exact: arb
    noises: dict[int, arb]
    rest: float

    def error(self) -> float:
        return sum(map(upper, self.noises.values())) + self.rest


def constant(value: float) -> Rounded:
    return Rounded(arb(value), {}, 0.0)


def rounded_fma(a: Rounded, b: Rounded, c: Rounded) -> Rounded:
    """A b + c, rounded once: the rounding is a new noise."""
    noises: dict[int, arb] = {}
    for term, factor in ((a, b.exact), (b, a.exact), (c, arb(1))):
        for name, noise in term.noises.items():
            noises[name] = noises.get(name, arb(0)) + noise * factor
    rest = upper(a.exact) * b.rest + upper(b.exact) * a.rest + a.error() * b.error() + c.rest
    result = Rounded(a.exact * b.exact + c.exact, noises, rest)
    noises[next(_names)] = arb(half_ulp(upper(result.exact) + result.error()))
    return result


def rounded_quotient(a: Rounded, b: Rounded) -> Rounded:
    """A / b, rounded once."""
    exact = a.exact / b.exact
    noises = {name: noise / b.exact for name, noise in a.noises.items()}
    for name, noise in b.noises.items():
        noises[name] = noises.get(name, arb(0)) - noise * exact / b.exact
    least = float(b.exact.abs_lower()) - b.error()
    relative = b.error() / least
    second = relative * (a.error() + upper(exact) * b.error())
    rest = (a.rest + upper(exact) * b.rest + second) / least
    result = Rounded(exact, noises, rest)
    noises[next(_names)] = arb(half_ulp(upper(exact) + result.error()))
    return result


def rounded_root(a: Rounded) -> Rounded:
    """Square root, rounded once, of a number that is exact."""
    if a.error() > 0.0:
        raise ValueError("the root of an inexact number is not bounded here")
    exact = a.exact.sqrt()
    return Rounded(exact, {next(_names): arb(half_ulp(upper(exact)))}, 0.0)


def exact_fma(a: Any, b: Any, c: Any) -> Any:
    """A b + c without rounding, of series or balls."""
    return a * b + c


Series = Callable[[arb_series], Any]


def distance(computed: Series, true: Series, middle: float, half_width: float, terms: int) -> float:
    """Largest distance of two functions on one part, by Taylor polynomials about its middle."""
    ctx.cap = terms + 1

    def difference(centre: arb) -> list[arb]:
        argument = arb_series([centre, 1], prec=terms + 1)
        apart = computed(argument) - true(argument)
        return [apart[k] for k in range(terms + 1)]

    near, remainder = difference(arb(middle)), difference(arb(middle, half_width))[terms]
    powers = [half_width**k for k in range(terms + 1)]
    return sum(upper(near[k]) * powers[k] for k in range(terms)) + upper(remainder) * powers[terms]
