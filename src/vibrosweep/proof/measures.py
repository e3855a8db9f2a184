"""Every measured variable of a realization, by its definition, from proved trajectories.

Plain code in ball arithmetic, independent of the kernels: its results are proved.  The statistics
of landings and flights come first, then the measures of the registry, then observables.

The function of an observable is evaluated twice for each landing, on the proved numbers and on
balls around them as wide as the errors that a dataset allows; both round as doubles do, operation
by operation. The second ball then holds every number that the kernel can have found, and its
distance from the first is claimed.  A function that uses more than arithmetic, or that compares a
ball with a number inside it, is evaluated in doubles instead: at the midpoints of the proved
numbers, and with each of them changed by its error.  The sum of the resulting changes is an
*estimate* of the error.
"""

from __future__ import annotations

import operator
from collections import OrderedDict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from itertools import groupby, pairwise
from operator import attrgetter
from sys import float_info
from typing import Any, Final, NamedTuple

import numpy as np

from vibrosweep.model.measures import Status
from vibrosweep.model.observables import UNIT, Landing, Observable
from vibrosweep.proof.reference.arithmetic import GUARD_BITS, Proved, arb, ctx, exact
from vibrosweep.proof.reference.motion import EPS, ProvedFlight, ProvedImpact, Trajectory
from vibrosweep.proof.sampling import ExactRealization


class Stay(NamedTuple):
    """A landing in the window, or an earlier one whose stay reaches into it."""

    particle: int
    number: int
    time: arb
    stay_end: arb
    impact: ProvedImpact


class ProvedFlights(NamedTuple):
    """Numbers of landings and rests, and the rebounds and flights that follow."""

    landings: int
    rests: int
    speeds: list[arb]
    flights: list[ProvedFlight]


def landings_of(realization: ExactRealization, trajectories: Sequence[Trajectory]) -> list[Stay]:
    """All landings in the order of time."""
    contact = arb(realization.parameters["contact_time"])
    landings = [
        Stay(
            particle=particle,
            number=number,
            time=impact.landing_time,
            stay_end=arb.pos_inf()
            if impact.liftoff_time is None
            else impact.liftoff_time.max(impact.landing_time + contact),
            impact=impact,
        )
        for particle, trajectory in enumerate(trajectories)
        for number, impact in enumerate(trajectory.impacts)
    ]
    return sorted(landings, key=lambda landing: landing.time.mid())


def flights_of(landings: Iterable[Stay]) -> ProvedFlights:
    """Collect the rebounds and flights that follow landings."""
    impacts = [landing.impact for landing in landings]
    speeds = [i.rebound_velocity for i in impacts if i.rebound_velocity is not None]
    flights = [i.flight for i in impacts if i.flight is not None]
    return ProvedFlights(len(impacts), sum(i.rested for i in impacts), speeds, flights)


def statistics(flights: ProvedFlights, frequency: arb) -> dict[str, Proved]:
    """Measures of flights, the same for a realization and for one particle."""
    heights, number = [flight.height for flight in flights.flights], len(flights.flights)
    mean_height = mean_time = None
    if number > 0:
        mean_height = sum(heights, arb(0)) / number
        mean_time = sum((f.duration for f in flights.flights), arb(0)) / number / frequency
    return {
        "impact_count": flights.landings,
        "rest_count": flights.rests,
        "rebound_height_mean": mean_height,
        "rebound_height_max": largest(heights),
        "flight_time_mean": mean_time,
    }


def largest(balls: Iterable[arb]) -> arb | None:
    """Largest of some balls; None if there are none."""
    listed = list(balls)
    return reduce(arb.max, listed) if listed else None


def size_of(proved: Proved | list[Proved]) -> float:
    """Largest absolute value; 0 where none is defined."""
    values = proved if isinstance(proved, list) else [proved]
    return max((abs(float(value)) for value in values if value is not None), default=0.0)


class LandingErrors(NamedTuple):
    """Largest errors of the numbers of a `vibrosweep.model.observables.Landing`, in its units."""

    phase: float
    flight_time: float
    arrival: float
    rebound: float


# Frequency of each order parameter, in units of the forcing frequency.
HARMONICS: Final = {
    "order_1": Fraction(1),
    "order_2": Fraction(2),
    "order_3": Fraction(3),
    "order_half": Fraction(1, 2),
    "order_third": Fraction(1, 3),
}
MOST_GAPS: Final = 4096


@dataclass(frozen=True)
class ProvedMeasures:
    """Proved measures of a realization, and distances that show if rounding can change them."""

    # By the names of `vibrosweep.model.measures`; a variable of each particle has a list of values
    values: dict[str, Proved | list[Proved]]
    fastest: arb | None  # largest rebound speed in the window, m s-1; None if there are no flights
    flights: Sequence[ProvedFlight]  # those that follow landings in the window
    landed: Sequence[ProvedFlight]  # those that end with landings in the window
    longest: int  # largest number of flights of one particle
    # Smallest distance of a landing from the beginning of the window in s; None where no landing
    # can be before it
    edge: arb | None
    # Time from a launch to the nearer edge of the window, the largest of all launches, s; negative
    # if every launch is outside the window
    launch_depth: Fraction
    # Shortest time between landings of different particles, also before the window; particles that
    # land as one are left out.  None if there are no two such landings
    apart: arb | None
    # Smallest distance of a landing from the beginning of the last period of the window, s; None
    # if there are no landings
    last_period: arb | None
    # Longest time for which two particles are on the base at once; if that never happens, minus the
    # shortest time between two stays.  None if there are no two stays.
    overlap: arb | None


def prove_measures(
    realization: ExactRealization, trajectories: Sequence[Trajectory]
) -> ProvedMeasures:
    """Measure a realization from the proved trajectories of all its particles."""
    with ctx.workprec(GUARD_BITS + max(t.precision_bits for t in trajectories)):
        return _proved(realization, trajectories)


def _proved(realization: ExactRealization, trajectories: Sequence[Trajectory]) -> ProvedMeasures:
    windowed = realization.scene.windowed
    begin = exact(realization.transient) if windowed else arb.neg_inf()
    frequency = arb(realization.parameters["frequency"])
    landings = landings_of(realization, trajectories)
    seen = [x for x in landings if x.time >= begin]
    by_particle = [flights_of(x for x in seen if x.particle == p) for p in range(len(trajectories))]
    total = flights_of(seen)
    status = [
        _status(t, flights, realization)
        for t, flights in zip(trajectories, by_particle, strict=True)
    ]
    opens, closes = Fraction(realization.transient), Fraction(realization.duration)
    overlap = _overlap(landings, begin)
    shared = int(overlap is not None and bool(overlap.mid() >= 0))
    values: dict[str, Proved | list[Proved]] = dict(statistics(total, frequency))
    each = [statistics(flights, frequency) for flights in by_particle]
    values |= {f"particle_{name}": [own[name] for own in each] for name in values}
    pairs = [pair for t in trajectories for pair in t.landed()]
    landed = [(flight, i.arrival) for flight, i in pairs if i.landing_time >= begin]
    unit = arb(realization.parameters["gravity"]) / (2 * frequency)
    fastest = largest(arrival for _, arrival in landed)
    values["impact_speed_max"] = None if fastest is None else fastest * unit
    launches = zip(realization.launch_times, trajectories, strict=True)
    launched = [t.launch for time, t in launches if opens <= time <= closes]
    values["flight_height_max"] = largest(f.height for f in (*launched, *total.flights))
    values["at_rest_count"] = sum(t.at_rest for t in trajectories)
    values["dt_min"] = _closest(seen)
    values["dt_min_same_index"] = _closest_same_index(seen)
    values["base_shared"], values["collision_free"] = shared, 1 - shared
    values["status"] = max(status)
    values["particle_at_rest"] = [int(t.at_rest) for t in trajectories]
    values["particle_status"] = list(status)
    late = begin.max(exact(realization.duration) - 1 / frequency)
    values |= _ordering(trajectories, landings, begin, late)
    return ProvedMeasures(
        values=values,
        landed=[flight for flight, _ in landed],
        fastest=largest(abs(speed) for speed in total.speeds),
        flights=total.flights,
        longest=max(len(flights.speeds) for flights in by_particle),
        edge=_least([abs(x.time - begin) for x in landings]) if windowed else None,
        launch_depth=max(min(t - opens, closes - t) for t in realization.launch_times),
        apart=_least(
            [
                b.time - a.time
                for a, b in _others(landings)
                if not _one_motion(a, b, trajectories, realization.coupled)
            ]
        ),
        last_period=_least([abs(x.time - late) for x in landings]),
        overlap=overlap,
    )


def _status(
    trajectory: Trajectory, flights: ProvedFlights, realization: ExactRealization
) -> Status:
    """Status that a computation in doubles must report."""
    if trajectory.status != Status.COMPLETED:
        return trajectory.status
    rate = 2 * arb(realization.parameters["frequency"]) / arb(realization.parameters["gravity"])
    squares = sum((speed * speed for speed in flights.speeds), arb(0))
    overflows = squares * rate * rate > arb(float_info.max)
    return Status.NON_FINITE if overflows else Status.COMPLETED


def _closest(landings: Sequence[Stay]) -> arb | None:
    """Smallest time between landings of different particles; landings are in the order of time.

    The two are neighbours in time, since a landing in between would be closer to one of them.
    """
    return _least([abs(b.time - a.time) for a, b in _others(landings)])


def _others(landings: Sequence[Stay]) -> Iterator[tuple[Stay, Stay]]:
    """Yield neighbouring landings of different particles."""
    return ((a, b) for a, b in pairwise(landings) if a.particle != b.particle)


def _one_motion(a: Stay, b: Stay, trajectories: Sequence[Trajectory], coupled: bool) -> bool:
    """Return whether two particles land as one, in doubles too.

    They were launched together, or rested together.  Coupled particles land as one only the first
    time after that, because the kernels take their impacts one after the other.
    """
    if a.time.mid() != b.time.mid():
        return False
    return not coupled or all(
        x.number == 0 or trajectories[x.particle].impacts[x.number - 1].rested for x in (a, b)
    )


def _closest_same_index(landings: Sequence[Stay]) -> arb | None:
    by_number = groupby(sorted(landings, key=attrgetter("number")), attrgetter("number"))
    gaps = [_closest(list(group)) for _, group in by_number]
    return _least([gap for gap in gaps if gap is not None])


def _overlap(landings: Sequence[Stay], begin: arb) -> arb | None:
    """Longest overlap of two stays inside the window, as `ProvedMeasures` says.

    A stay overlaps longest with the earlier stay, of another particle, that ends last; so only
    the latest end for each particle is kept, and only for the two particles where it is latest.
    """
    longest: dict[int, arb] = {}
    overlap = None
    for landing in landings:
        if landing.stay_end < begin:
            continue
        start = landing.time.max(begin)
        for particle, end in longest.items():
            if particle != landing.particle:
                common = end.min(landing.stay_end) - start
                overlap = common if overlap is None else overlap.max(common)
        before = longest.get(landing.particle, landing.stay_end)
        longest[landing.particle] = before.max(landing.stay_end)
        if len(longest) > 2:
            del longest[min(longest, key=lambda particle: longest[particle].mid())]
    return overlap


def _least(balls: Sequence[arb]) -> arb | None:
    return reduce(arb.min, balls) if balls else None


def _ordering(
    trajectories: Sequence[Trajectory], landings: Sequence[Stay], begin: arb, late: arb
) -> dict[str, Proved | list[Proved]]:
    """Measures of the order of landings, by their definitions; the last period begins at `late`."""
    gaps = [b.time - a.time for a, b in _others(landings) if b.time >= late]
    gaps = sorted(gaps, key=arb.mid) if len(gaps) <= MOST_GAPS else []
    half = len(gaps) // 2
    found: dict[str, Proved | list[Proved]] = {
        "gap_median": (gaps[~half] + gaps[half]) / 2 if gaps else None,
        "gap_min": gaps[0] if gaps else None,
        "order_changes": _out_of_turn(landings, begin),
    }
    last = [t.impacts[-1] for t in trajectories if t.impacts]
    for name, harmonic in HARMONICS.items():
        half_turns = [2 * exact(harmonic) * (impact.count + impact.phase) for impact in last]
        even = sum((turn.cos_pi() for turn in half_turns), arb(0))
        odd = sum((turn.sin_pi() for turn in half_turns), arb(0))
        square = (even * even + odd * odd).max(arb(0))
        found[name] = square.sqrt() / len(last) if last else None
    return found


def _out_of_turn(landings: Sequence[Stay], begin: arb) -> int:
    """Count landings from `begin` on by a particle other than the one that landed longest ago."""
    turns: OrderedDict[int, None] = OrderedDict()  # particles; the first landed longest ago
    found = 0
    for landing in landings:
        landed = landing.particle in turns
        found += landed and next(iter(turns)) != landing.particle and bool(landing.time >= begin)
        turns[landing.particle] = None
        turns.move_to_end(landing.particle)
    return found


SMALLEST: Final = 2.0**-1074
EXTREME: Final[Mapping[str, Callable[[arb, arb], arb]]] = {"max": arb.max, "min": arb.min}


# Errors of a landing, by the flight that ends with it
Errors = Callable[[ProvedFlight], LandingErrors]
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
    realization: ExactRealization,
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
    realization: ExactRealization, trajectory: Trajectory, errors: Errors
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
