"""Realizations on a base of finite mass: their proof, and estimates of rounding errors.

No error bounds are proved for coupled particles.  Instead the reference follows a realization
twice: as it is, and with its parameters changed by a relative `CHANGE`, some up and some down, and
with each launch delayed by that fraction of a period more than the one before, since simultaneous
landings would otherwise stay simultaneous.  These changes are 512 times a rounding error.
The largest change of any landing or lift-off, of any velocity and of any height is the estimate of
the largest error in doubles.  Where a decision changes, nothing is claimed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from functools import partial
from itertools import cycle
from typing import Final, NamedTuple

from vibrosweep.proof.measures import ProvedMeasures
from vibrosweep.proof.reference._flint import UndecidableError, arb, ctx, exact
from vibrosweep.proof.reference.coupled import (
    PATIENCE,
    Coupled,
    TooManyLandingsError,
    coupled,
)
from vibrosweep.proof.reference.motion import EPS
from vibrosweep.proof.reference.results import Flight, Impact, Trajectory
from vibrosweep.proof.sample import Realization
from vibrosweep.proof.statistics import LandingErrors, size_of
from vibrosweep.proof.tolerances import order_claims, reaches

# Most landings of a realization: about ten seconds, or longer if few particles make all of them.
MAX_COUPLED: Final = 1000
MAX_BITS: Final = 1 << 13
CHANGE: Final = 2.0**-44
SIGNS: Final = (1.0, -1.0, 1.0, 1.0, -1.0)  # signs without a pattern in which changes could cancel


class Estimate(NamedTuple):
    """Estimates of the largest errors of a realization in doubles."""

    time: float  # of landings and lift-offs, s
    velocity: float  # of rebound velocities, m s-1
    height: float  # of the highest points of flights, m
    relative: float  # of arrivals and rebounds relative to the base, in units of g / 2 f

    def record_claims(self, realization: Realization, number: float) -> Mapping[str, float]:
        """Largest error of a recorded number of that size, for each variable of the record."""
        rounding = 4.0 * EPS * (abs(number) if math.isfinite(number) else 0.0)
        period = 1.0 / realization.parameters["frequency"]
        # the time from one event, or launch, to the next is one double
        longest = max(
            abs(float(time)) for time in (realization.duration, *realization.launch_times)
        )
        time = self.time + 4.0 * EPS * longest + 8.0 * EPS * period
        times = dict.fromkeys(("landing_time", "liftoff_time"), time)
        return times | {"rebound_velocity": self.velocity + rounding, "rested": 0.0}

    def landing_errors(self, realization: Realization, flight: Flight) -> LandingErrors:
        """Estimates of the errors of a landing, and of the rebound from it, after a flight."""
        phase = self.time * realization.parameters["frequency"] + 8.0 * EPS
        speed = self.relative + 8.0 * EPS
        return LandingErrors(phase, 2.0 * phase, speed, speed)

    def claims(self, realization: Realization, measured: ProvedMeasures) -> dict[str, float | None]:
        """Largest error of each variable, in its own unit; None where nothing is claimed."""
        frequency = realization.parameters["frequency"]
        rounding = (measured.longest + len(realization.launch_times) + 10) * EPS
        claimed: dict[str, float | None] = {}
        for name, proved in measured.values.items():
            plain, size = name.removeprefix("particle_"), rounding * size_of(proved)
            claimed[name] = 0.0
            if plain.startswith(("rebound_height", "flight_height")):
                claimed[name] = self.height + size
            elif plain.startswith(("flight_time", "dt_min")):
                claimed[name] = 2.0 * self.time + 4.0 * EPS / frequency + size
            elif plain == "impact_speed_max":
                unit = realization.parameters["gravity"] / (2.0 * frequency)
                claimed[name] = (self.relative + 8.0 * EPS) * unit + size
        if reaches(measured.overlap, 3.0 * self.time):
            claimed |= dict.fromkeys(("base_shared", "collision_free"))
        claimed |= order_claims(self.time, realization, measured)
        if realization.scene.windowed and abs(measured.launch_depth) < realization.launch_rounding:
            claimed["flight_height_max"] = None
        return claimed


def prove(
    realization: Realization, max_landings: int
) -> tuple[Sequence[Trajectory], Estimate | None]:
    """Proved trajectories of a realization, and estimates of their errors in doubles.

    The estimates are None where rounding may change a decision.  Raises an UndecidableError where
    the reference cannot decide, and a TooManyLandingsError where more landings come before the end.
    """
    launches, given = realization.launch_times, realization.parameters
    follow = partial(
        coupled,
        duration=realization.duration,
        laws=realization.laws,
        deviates=realization.deviates,
        max_bits=MAX_BITS,
    )
    proved = follow(given, launches, max_landings=max_landings)
    changed = {
        name: value if name == "frequency" else value * (1.0 + sign * CHANGE)
        for (name, value), sign in zip(given.items(), cycle(SIGNS), strict=False)
    }
    changed["restitution"] = min(changed["restitution"], 1.0)
    later = Fraction(CHANGE) / Fraction(given["frequency"])
    moved = tuple(time + j * later for j, time in enumerate(launches))
    try:
        other = follow(changed, moved, max_landings=2 * max_landings, bits=proved.precision_bits)
    except (UndecidableError, TooManyLandingsError):
        return proved.particles, None
    pairs = list(zip(proved.particles, other.particles, strict=True))
    if any(_decisions(a) != _decisions(b) for a, b in pairs):
        return proved.particles, None
    with ctx.workprec(proved.precision_bits):
        changes = [change for a, b in pairs for change in _changes(a, b)]
        estimate = Estimate(*(max(column) for column in zip(*changes, strict=True)))
        end, period = exact(realization.duration), 1 / arb(given["frequency"])
        edges = [end, end + PATIENCE / exact(given["frequency"])]
        if realization.scene.windowed:
            edges.append(exact(realization.transient))
        times = zip(_ends(proved, launches, period), _ends(other, moved, period), strict=True)
        near = any(
            abs(time - edge) < max(estimate.time, _apart(time, neighbour))
            for time, neighbour in times
            for edge in edges
        )
    return proved.particles, None if near else estimate


def _decisions(trajectory: Trajectory) -> tuple[bool, list[tuple[bool, bool]]]:
    """List the decisions about a particle."""
    each = [(impact.rested, impact.liftoff_time is None) for impact in trajectory.impacts]
    return trajectory.at_rest, each


def _changes(a: Trajectory, b: Trajectory) -> Iterator[tuple[float, float, float, float]]:
    """Changes of times, velocities, heights, and speeds relative to the base."""
    yield 0.0, 0.0, _apart(a.launch.height, b.launch.height), 0.0
    for one, other in zip(a.impacts, b.impacts, strict=True):
        yield (
            max(
                _apart(one.landing_time, other.landing_time),
                _apart(one.liftoff_time, other.liftoff_time),
            ),
            _apart(one.rebound_velocity, other.rebound_velocity),
            0.0
            if one.flight is None or other.flight is None
            else _apart(one.flight.height, other.flight.height),
            max(_apart(one.arrival, other.arrival), _apart(_rebound(one), _rebound(other))),
        )


def _rebound(impact: Impact) -> arb | None:
    """Speed relative to the base after an impact; None where the particle stays."""
    return None if impact.rested or impact.flight is None else impact.flight.speed


def _apart(a: arb | None, b: arb | None) -> float:
    """Distance of two numbers; 0 where either is None."""
    return 0.0 if a is None or b is None else float((a - b).abs_upper())


def _ends(motion: Coupled, launches: Sequence[Fraction], period: arb) -> Iterator[arb]:
    """Times of all lift-offs and landings, with the first landings after the end."""
    for trajectory, launched in zip(motion.particles, launches, strict=True):
        left, flight = exact(launched), trajectory.launch
        for impact in trajectory.impacts:
            yield impact.landing_time
            if impact.liftoff_time is None or impact.flight is None:
                break  # the particle rides the base at the end
            left, flight = impact.liftoff_time, impact.flight
            yield left
        else:
            yield left + flight.duration * period
