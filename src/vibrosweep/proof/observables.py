"""Observables with a number for each landing: their values from proved landings, and claims.

The user's function is evaluated twice for each landing, on the proved numbers and on balls around
them as wide as the errors that a dataset allows; both round as doubles do, operation by operation.
The second ball then holds every number that the kernel can have found, and its distance from the
first is claimed.  A function that uses more than arithmetic, or that compares a ball with a number
inside it, is evaluated in doubles instead: at the midpoints of the proved numbers, and with each of
them changed by its error.  The sum of the resulting changes is an *estimate* of the error.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import reduce
from typing import Any, Final, NamedTuple

import numpy as np

from vibrosweep.model.landing import Landing
from vibrosweep.model.observables import UNIT, Observable
from vibrosweep.model.status import Status
from vibrosweep.proof.reference._flint import arb, ctx, exact
from vibrosweep.proof.reference.decisions import GUARD_BITS
from vibrosweep.proof.reference.motion import EPS
from vibrosweep.proof.reference.results import Flight, Trajectory
from vibrosweep.proof.sample import Realization
from vibrosweep.proof.statistics import LandingErrors, Proved

SMALLEST: Final = 2.0**-1074
EXTREME: Final[Mapping[str, Callable[[arb, arb], arb]]] = {"max": arb.max, "min": arb.min}


# Errors of a landing, by the flight that ends with it
Errors = Callable[[Flight], LandingErrors]
# The numbers of a landing that a function takes, in the order of `Landing`
Numbers = tuple[arb, arb, arb, arb]
Function = Callable[[Landing], Any]


class OpenError(ArithmeticError):
    """A comparison of balls that overlap."""


class Rounded:
    """Ball that holds every result in doubles, for all numbers in the balls of the operands."""

    __array_ufunc__ = None
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, ball: arb) -> None:
        self.ball = ball

    def _of(self, other: object, function: Callable[[arb, arb], arb]) -> Any:
        ball = _ball(other)
        return NotImplemented if ball is None else _rounded(function(self.ball, ball), 1)

    def __add__(self, other: object) -> Any:
        return self._of(other, operator.add)

    def __sub__(self, other: object) -> Any:
        return self._of(other, operator.sub)

    def __rsub__(self, other: object) -> Any:
        return self._of(other, lambda a, b: b - a)

    def __mul__(self, other: object) -> Any:
        return self._of(other, operator.mul)

    def __truediv__(self, other: object) -> Any:
        return self._of(other, operator.truediv)

    def __rtruediv__(self, other: object) -> Any:
        return self._of(other, lambda a, b: b / a)

    __radd__, __rmul__ = __add__, __mul__

    def __pow__(self, power: object) -> Any:
        if not isinstance(power, int):
            return NotImplemented
        return _rounded(self.ball**power, 2 + 2 * abs(power))

    def __neg__(self) -> Rounded:
        return Rounded(-self.ball)

    def __abs__(self) -> Rounded:
        return Rounded(abs(self.ball))

    def _above(self, other: object, least: bool) -> bool:
        """Return whether this exceeds another number, or with `least` is not below it."""
        ball = _ball(other)
        if ball is None:
            raise TypeError
        if self.ball > ball or (least and self.ball >= ball):
            return True
        if self.ball < ball or (not least and self.ball <= ball):
            return False
        raise OpenError

    def __gt__(self, other: object) -> bool:
        return self._above(other, least=False)

    def __ge__(self, other: object) -> bool:
        return self._above(other, least=True)

    def __lt__(self, other: object) -> bool:
        return not self._above(other, least=True)

    def __le__(self, other: object) -> bool:
        return not self._above(other, least=False)

    def __eq__(self, other: object) -> bool:
        return self._above(other, least=True) and not self._above(other, least=False)

    def __bool__(self) -> bool:
        return self != 0


def _ball(number: object) -> arb | None:
    """Ball of an operand; None if it is not a number."""
    if isinstance(number, Rounded):
        return number.ball
    if isinstance(number, bool | int | float | np.integer | np.bool_):
        return arb(float(number))
    return None


def _rounded(ball: arb, times: int) -> Rounded:
    """Widen a ball by a number of rounding errors."""
    return Rounded(ball + arb(0, (abs(ball) * (times * 2.0 * EPS)).upper() + SMALLEST))


class Total(NamedTuple):
    """Proved value for one landing, or total over several."""

    value: arb
    error: float  # largest error that is allowed


class ProvedObservable(NamedTuple):
    """Proved value of an observable, or one for each particle."""

    values: list[Proved]
    claims: list[float | None]  # largest errors that are allowed; None where nothing is known
    estimated: bool  # True where the errors are estimated by changes of the function


def prove_observable(
    observable: Observable,
    realization: Realization,
    trajectories: Sequence[Trajectory],
    status: Sequence[int],
    errors: Errors,
) -> ProvedObservable:
    """Value of an observable by its definition; `status` has a code for each particle."""
    with ctx.workprec(GUARD_BITS + max(one.precision_bits for one in trajectories)):
        seen = [list(_landings(realization, one, errors)) for one in trajectories]
        estimated = False
        try:
            each = [[_by_balls(observable.function, *one) for one in listed] for listed in seen]
        except Exception:  # the function was written for doubles, and may raise anything for balls
            estimated = True
            try:
                each = [
                    [_by_changes(observable.function, *one) for one in listed] for listed in seen
                ]
            except Exception:
                return _unknown(observable, len(seen))
        if not all(one.value.is_finite() for listed in each for one in listed):
            return _unknown(observable, len(seen))
        totals = [
            None if code == Status.NON_FINITE else _combined(observable.landings, listed)
            for listed, code in zip(each, status, strict=True)
        ]
        if observable.particles != "each":
            totals = [_combined(observable.particles, totals)]
        p = realization.parameters
        scale = observable.scale(arb(p["frequency"]), arb(p["gravity"]))
        powers = sum(abs(int(power or 1)) for _, power in UNIT.findall(observable.units))
        rounding = (4 + 6 * powers) * EPS
        values: list[Proved] = [None if one is None else one.value * scale for one in totals]
        wide = (0 if one is None else abs(one.value) * rounding + one.error for one in totals)
        claims: list[float | None] = [float((error * scale).abs_upper()) for error in wide]
        return ProvedObservable(values, claims, estimated)


def _unknown(observable: Observable, particles: int) -> ProvedObservable:
    """Return undefined values, about which nothing is claimed."""
    number = particles if observable.particles == "each" else 1
    return ProvedObservable([None] * number, [None] * number, True)


def _landings(
    realization: Realization, trajectory: Trajectory, errors: Errors
) -> Iterator[tuple[Numbers, bool, LandingErrors]]:
    """Yield numbers, rest and errors of each landing in the window."""
    for flight, impact in trajectory.landed():
        if not realization.scene.windowed or impact.landing_time >= exact(realization.transient):
            stays = realization.coupled and impact.rested
            rebound = arb(0) if stays or impact.flight is None else impact.flight.speed
            numbers = impact.phase, flight.duration, impact.arrival, rebound
            yield numbers, impact.rested, errors(flight)


def _by_balls(function: Function, exactly: Numbers, rested: bool, errors: LandingErrors) -> Total:
    """Evaluate the function on the proved numbers of a landing, and on balls around them."""
    widely = [
        ball + arb(0, error + 4.0 * EPS * float(abs(ball).upper()))
        for ball, error in zip(exactly, errors, strict=True)
    ]
    near, wide = (
        _number(function(Landing._make([*map(Rounded, balls), rested])))
        for balls in (exactly, widely)
    )
    if not abs(widely[0]) <= 0.5:  # the kernel's phase may have wrapped around
        turn = 1 if widely[0] > 0 else -1
        other = map(Rounded, (widely[0] - turn, *widely[1:]))
        wide = wide.union(_number(function(Landing._make([*other, rested]))))
    return Total(near, float((wide - near).abs_upper()))


def _number(result: object) -> arb:
    ball = _ball(result)
    if ball is None:
        raise TypeError
    return ball


def _by_changes(function: Function, exactly: Numbers, rested: bool, errors: LandingErrors) -> Total:
    """Evaluate the function in doubles, at a landing's numbers and with each of them changed."""
    middle = [np.float64(x) for x in exactly]

    def at(place: int, change: float) -> float:
        numbers = list(middle)
        numbers[place] += change
        if abs(numbers[0]) > 0.5:
            numbers[0] -= np.sign(numbers[0])
        return float(function(Landing._make([*numbers, rested])))

    with np.errstate(all="ignore"):
        found = at(0, 0.0)
        change = 16.0 * EPS * abs(found)
        for place, error in enumerate(errors):
            error = error + 4.0 * EPS * abs(float(middle[place]))
            change += max(abs(at(place, sign * error) - found) for sign in (-1.0, 1.0))
    return Total(arb(found), change)


def _combined(how: str, totals: Sequence[Total | None]) -> Total | None:
    """Combine totals; None if the result is undefined, as is the maximum of none."""
    known = [one for one in totals if one is not None]
    if how in EXTREME:
        if not known:
            return None
        value = reduce(EXTREME[how], (one.value for one in known))
        return Total(value, max(one.error for one in known))
    if len(known) < len(totals):
        return None
    size = sum((abs(one.value) for one in known), arb(0))
    rounding = float(((len(known) + 10) * EPS * size).abs_upper())
    value = sum((one.value for one in known), arb(0))
    return Total(value, sum(one.error for one in known) + rounding)
