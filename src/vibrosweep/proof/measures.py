"""Every measured variable of a realization, by its definition, from proved trajectories.

Plain code in ball arithmetic, independent of the kernels: its results are proved.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import reduce
from itertools import groupby, pairwise
from operator import attrgetter
from sys import float_info
from typing import Final

from vibrosweep.model.status import Status
from vibrosweep.proof.reference._flint import arb, ctx, exact
from vibrosweep.proof.reference.decisions import GUARD_BITS
from vibrosweep.proof.reference.results import Flight, Trajectory
from vibrosweep.proof.sample import Realization
from vibrosweep.proof.statistics import (
    Flights,
    Landing,
    Proved,
    flights_of,
    landings_of,
    largest,
    statistics,
)

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
    flights: Sequence[Flight]  # those that follow landings in the window
    landed: Sequence[Flight]  # those that end with landings in the window
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


def prove_measures(realization: Realization, trajectories: Sequence[Trajectory]) -> ProvedMeasures:
    """Measure a realization from the proved trajectories of all its particles."""
    with ctx.workprec(GUARD_BITS + max(t.precision_bits for t in trajectories)):
        return _proved(realization, trajectories)


def _proved(realization: Realization, trajectories: Sequence[Trajectory]) -> ProvedMeasures:
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


def _status(trajectory: Trajectory, flights: Flights, realization: Realization) -> Status:
    """Status that a computation in doubles must report."""
    if trajectory.status != Status.COMPLETED:
        return trajectory.status
    rate = 2 * arb(realization.parameters["frequency"]) / arb(realization.parameters["gravity"])
    squares = sum((speed * speed for speed in flights.speeds), arb(0))
    overflows = squares * rate * rate > arb(float_info.max)
    return Status.NON_FINITE if overflows else Status.COMPLETED


def _closest(landings: Sequence[Landing]) -> arb | None:
    """Smallest time between landings of different particles; landings are in the order of time.

    The two are neighbours in time, since a landing in between would be closer to one of them.
    """
    return _least([abs(b.time - a.time) for a, b in _others(landings)])


def _others(landings: Sequence[Landing]) -> Iterator[tuple[Landing, Landing]]:
    """Yield neighbouring landings of different particles."""
    return ((a, b) for a, b in pairwise(landings) if a.particle != b.particle)


def _one_motion(a: Landing, b: Landing, trajectories: Sequence[Trajectory], coupled: bool) -> bool:
    """Return whether two particles land as one, in doubles too.

    They were launched together, or rested together.  Coupled particles land as one only the first
    time after that, because the kernels take their impacts one after the other.
    """
    if a.time.mid() != b.time.mid():
        return False
    return not coupled or all(
        x.number == 0 or trajectories[x.particle].impacts[x.number - 1].rested for x in (a, b)
    )


def _closest_same_index(landings: Sequence[Landing]) -> arb | None:
    by_number = groupby(sorted(landings, key=attrgetter("number")), attrgetter("number"))
    gaps = [_closest(list(group)) for _, group in by_number]
    return _least([gap for gap in gaps if gap is not None])


def _overlap(landings: Sequence[Landing], begin: arb) -> arb | None:
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
    trajectories: Sequence[Trajectory], landings: Sequence[Landing], begin: arb, late: arb
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


def _out_of_turn(landings: Sequence[Landing], begin: arb) -> int:
    """Count landings from `begin` on by a particle other than the one that landed longest ago."""
    turns: OrderedDict[int, None] = OrderedDict()  # particles; the first landed longest ago
    found = 0
    for landing in landings:
        landed = landing.particle in turns
        found += landed and next(iter(turns)) != landing.particle and bool(landing.time >= begin)
        turns[landing.particle] = None
        turns.move_to_end(landing.particle)
    return found
