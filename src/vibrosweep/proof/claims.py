"""The error that a dataset claims for each of its numbers.

A dataset bounds the errors of a realization's landing times (dt) and rebound velocities (dv)
against the exact model.  Every other claim follows from these two and from the roundings of the
few sums and products that lead from flights to the stored number; EPS is one rounding, 2**-53.

* Counts and codes are exact.
* A height v^2 / 2 g: (2 v dv + dv^2) / 2 g with the largest rebound speed v of the realization;
  the height of a moving base, of velocity V0 at most, adds V0 dt.
* The mean flight time 2 v / g: 2 dv / g.  Over a moving base, the errors of phase and relative
  speed at lift-off times the derivatives by them, doubled to cover the higher orders.
* Means are sums of n positive numbers, first over each particle, then over the particles: relative
  error (n + particles) EPS with n flights of a particle, and 10 EPS for the change of units.
* A separation is the difference of two landing times: 2 dt, and the rounding of the difference of
  two phases, 2 EPS periods; the smallest of all separations changes by no more.
* An order parameter of harmonic h changes by no more than the phases: h 2 pi dt, dt in periods.
* Landings of different particles within 2 dt of each other may come in either order: then neither
  `order_changes` nor `gap_median` is claimed, unless the particles land as one.
* Whether two stays overlap is decided by the difference of a landing and a lift-off.  If the exact
  difference is within its error, nothing is claimed.
* A recorded time is rounded relative to itself and, when the phase of the forcing is subtracted,
  relative to a period; to a lift-off after a rest the error of its phase is added.
* A landing within its error of the beginning of the window may be counted or not: then nothing is
  claimed for the measures over the window.  The dataset's own bounds cover the window's end.

Over a base of finite mass no error bounds are proved.  Instead the reference follows a realization
twice: as it is, and with its parameters changed by a relative `CHANGE`, some up and some down, and
with each launch delayed by that fraction of a period more than the one before, since simultaneous
landings would otherwise stay simultaneous.  These changes are 512 times a rounding error. The
largest change of any landing or lift-off, of any velocity and of any height is the estimate of the
largest error in doubles.  Where a decision changes, nothing is claimed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from functools import partial
from itertools import cycle
from typing import Final, NamedTuple

from vibrosweep.proof.measures import HARMONICS, LandingErrors, ProvedMeasures, size_of
from vibrosweep.proof.reference.arithmetic import Proved, UndecidableError, arb, ctx, exact
from vibrosweep.proof.reference.motion import EPS, Flight, Impact, Trajectory
from vibrosweep.proof.reference.sprung import PATIENCE, Coupled, TooManyLandingsError, coupled
from vibrosweep.proof.report import CHANGE
from vibrosweep.proof.sampling import Realization

# Factor for the higher orders, which the derivatives of a flight leave out
FIRST_ORDER: Final = 2.0


class Bounds(NamedTuple):
    """Bounds on the errors of all landings of a realization."""

    landing_time: float  # s
    rebound_velocity: float  # m s-1

    def phase_error(self, realization: Realization) -> float:
        """Bound on the errors of the phases of lift-offs, in turns."""
        frequency = realization.parameters["frequency"]
        return self.landing_time * frequency + realization.liftoff_error + 4.0 * EPS

    def height_error(self, realization: Realization) -> float:
        """Bound on the errors of the height of the base at lift-offs, in m."""
        velocity, frequency = realization.velocity, realization.parameters["frequency"]
        return velocity * self.phase_error(realization) / frequency if velocity > 0.0 else 0.0

    def speed_error(self, realization: Realization) -> float:
        """Bound on the errors of speeds relative to the base, in units of g / 2 f."""
        p = realization.parameters
        base = 2.0 * math.pi * p["frequency"] * self.height_error(realization)
        return (self.rebound_velocity + base) * 2.0 * p["frequency"] / p["gravity"]

    def record_claims(self, realization: Realization, number: float) -> Mapping[str, float]:
        """Largest error of a recorded number of that size, for each variable of the record."""
        size = abs(number) if math.isfinite(number) else 0.0
        period = 1.0 / realization.parameters["frequency"]
        landing = self.landing_time + 4.0 * EPS * (size + 2.0 * period)
        return {
            "landing_time": landing,
            "liftoff_time": landing + _lift_off_error(self.landing_time, realization),
            "rebound_velocity": self.rebound_velocity + 4.0 * EPS * size,
            "rested": 0.0,
        }

    def duration_error(self, realization: Realization, flight: Flight) -> float:
        """Bound on the error of the duration of a flight, in s."""
        speed, period = self.speed_error(realization), 1.0 / realization.parameters["frequency"]
        if flight.slopes is None:
            return speed * period
        by_phase, by_speed = flight.slopes
        linear = abs(by_phase) * self.phase_error(realization) + abs(by_speed) * speed
        return FIRST_ORDER * linear * period

    def landing_errors(self, realization: Realization, flight: Flight) -> LandingErrors:
        """Bounds on the errors of a landing, and of the rebound from it, after a flight."""
        frequency = realization.parameters["frequency"]
        duration = self.duration_error(realization, flight) * frequency
        speed = self.speed_error(realization)
        phase = self.landing_time * frequency + 4.0 * EPS
        # gravity adds twice the duration to a speed, in units of g / 2 f
        return LandingErrors(phase, duration, speed + 2.0 * duration, speed)

    def claims(
        self, realization: Realization, measured: ProvedMeasures
    ) -> Mapping[str, float | None]:
        """Largest error of each variable, in its own unit; None where nothing is claimed."""
        dt, period = self.landing_time, 1.0 / realization.parameters["frequency"]
        names = ("at_rest_count", "status", "particle_at_rest", "particle_status")
        exact: dict[str, float | None] = dict.fromkeys(names, 0.0)
        undecided = reaches(measured.overlap, _stay_error(dt, realization))
        exact |= dict.fromkeys(("base_shared", "collision_free"), None if undecided else 0.0)
        windowed = self.statistics_claims(realization, measured)
        for name in ("dt_min", "dt_min_same_index"):
            rounding = EPS * (2.0 * period + 2.0 * size_of(measured.values[name]))
            windowed[name] = 2.0 * dt + rounding
        unit = realization.parameters["gravity"] / (2.0 * realization.parameters["frequency"])
        landed = (self.landing_errors(realization, flight).arrival for flight in measured.landed)
        rounding = 4.0 * EPS * size_of(measured.values["impact_speed_max"])
        windowed["impact_speed_max"] = max(landed, default=0.0) * unit + rounding
        order = order_claims(dt, realization, measured)
        windowed["order_changes"] = order.pop("order_changes")
        if reaches(measured.edge, dt + 4.0 * EPS * period):
            windowed = dict.fromkeys(windowed)
        # rounding may decide whether a launch so close to an edge of the window is inside
        if realization.scene.windowed and abs(measured.launch_depth) < realization.launch_rounding:
            windowed["flight_height_max"] = None
        return exact | order | windowed

    def statistics_claims(
        self, realization: Realization, measured: ProvedMeasures
    ) -> dict[str, float | None]:
        """Largest errors of the statistics of a realization and of each particle."""
        p, dv = realization.parameters, self.rebound_velocity
        gravity, launch = p["gravity"], p["launch_velocity"]
        rounding = (measured.longest + len(realization.launch_times) + 10) * EPS
        v = size_of(measured.fastest)
        raised = realization.velocity / (2.0 * math.pi * p["frequency"])
        most = max(v, launch) ** 2 / (2.0 * gravity) + raised
        height = (2.0 * v * dv + dv**2) / (2.0 * gravity)
        height += self.height_error(realization) + rounding * most
        flights = measured.flights
        lasting = max((float(flight.duration) for flight in flights), default=0.0) / p["frequency"]
        duration = max((self.duration_error(realization, f) for f in flights), default=0.0)
        claimed: dict[str, float | None] = {
            "impact_count": 0.0,
            "rest_count": 0.0,
            "rebound_height_mean": height,
            "rebound_height_max": height,
            "flight_time_mean": duration + rounding * lasting,
        }
        of_each = {f"particle_{name}": claim for name, claim in claimed.items()}
        return {**claimed, **of_each, "flight_height_max": height}


def order_claims(
    dt: float, realization: Realization, measured: ProvedMeasures
) -> dict[str, float | None]:
    """Largest errors of the measures of order, if landing times have the error dt in s."""
    frequency = realization.parameters["frequency"]
    lasting = float(realization.duration) - float(min(realization.launch_times))
    # the product of a harmonic and whole periods is rounded
    turned = dt + EPS * (8.0 / frequency + 2.0 * lasting)
    rounding = (len(realization.launch_times) + 10) * EPS
    claimed: dict[str, float | None] = {
        name: 2.0 * math.pi * float(harmonic) * frequency * turned + rounding
        for name, harmonic in HARMONICS.items()
    }
    undecided = reaches(measured.apart, 2.0 * dt)
    at_edge = reaches(measured.last_period, dt + 4.0 * EPS / frequency)
    for name, open_ in (("gap_min", at_edge), ("gap_median", at_edge or undecided)):
        rounding = EPS * (4.0 / frequency + 2.0 * size_of(measured.values[name]))
        claimed[name] = None if open_ else 2.0 * dt + rounding
    return claimed | {"order_changes": None if undecided else 0.0}


def _stay_error(dt: float, realization: Realization) -> float:
    """Error of the time between a landing and the end of another particle's stay, s.

    It involves two landings, a lift-off and a sum of phases.
    """
    rounding = 8.0 * EPS / realization.parameters["frequency"]
    return 3.0 * dt + _lift_off_error(dt, realization) + rounding


def _lift_off_error(dt: float, realization: Realization) -> float:
    """Error in s of a lift-off after a rest, if landings have the error dt.

    With a random amplitude it is within dt, since each period lifts at a phase of its own.
    """
    p = realization.parameters
    if p.get("drive_noise", 0.0) > 0.0:
        return dt
    return realization.liftoff_error / p["frequency"]


def reaches(distance: Proved, error: float) -> bool:
    """Return whether zero is within the error of an exact distance; None stands for no distance."""
    return distance is not None and not bool(abs(distance) > error)


# Most landings of a realization: about ten seconds, or longer if few particles make all of them.
MAX_COUPLED: Final = 1000
MAX_BITS: Final = 1 << 13
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
