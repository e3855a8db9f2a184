"""The error that a dataset claims for each of its numbers, and the recurrence of proved orbits.

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

The recurrence of a proved orbit follows: whether it repeats as stated, its cycle and exponents.
The state after a rest depends only on the phase at which the rest ends: two rests that end at the
same phase close a cycle, which the orbit entered with the first.  Otherwise the kernel detects
recurrence when a state returns bit for bit, whereas the exact orbit approaches its cycle
asymptotically.  A proof can show that it repeats as stated, up to the tolerance with which the
kernel identifies states and the errors that the dataset claims; impacts and periods of the cycle
then follow exactly.  Recurrence is stated at the second occurrence of a state, after which the
orbit may end almost at once; so states are compared from the first occurrence on.

`mean_growth` follows small perturbations along an orbit.  The kernel's orbit differs from the
proved one by no more than the dataset's bounds, and its Jacobians differ accordingly.  A change of
a Jacobian changes the growth at that impact, and turns the direction that is carried on: both
effects are followed here to first order, and doubled to cover the higher orders.

`largest_exponent` proves that a cycle exists, and its multipliers.  The state (x, u), phase and
speed relative to the base at lift-off, lies on a cycle of p impacts in q periods if p impacts lead
to (x + q, u).  Newton's method finds it next to a state of an orbit; the interval Newton operator
(Krawczyk 1969; Moore 1966) then maps a box around it into its interior, which proves that one and
only one such state lies in the box, and the Jacobians over the box enclose the cycle's own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import partial
from itertools import cycle
from typing import Any, Final, NamedTuple

from vibrosweep.kernels.settle import SAME_ORBIT
from vibrosweep.model.measures import Regime
from vibrosweep.proof.measures import HARMONICS, LandingErrors, ProvedMeasures, size_of
from vibrosweep.proof.reference.arithmetic import (
    Proved,
    UndecidableError,
    arb,
    ctx,
    exact,
    nearest_integer,
)
from vibrosweep.proof.reference.motion import EPS, PeriodMap, ProvedFlight, ProvedImpact, Trajectory
from vibrosweep.proof.reference.sprung import PATIENCE, CoupledMotion, TooManyLandingsError, coupled
from vibrosweep.proof.report import CHANGE
from vibrosweep.proof.sampling import ExactRealization

# Factor for the higher orders, which the derivatives of a flight leave out
FIRST_ORDER: Final = 2.0


class ErrorBounds(NamedTuple):
    """Bounds on the errors of all landings of a realization."""

    landing_time: float  # s
    rebound_velocity: float  # m s-1

    def phase_error(self, realization: ExactRealization) -> float:
        """Bound on the errors of the phases of lift-offs, in turns."""
        frequency = realization.parameters["frequency"]
        return self.landing_time * frequency + realization.liftoff_error + 4.0 * EPS

    def height_error(self, realization: ExactRealization) -> float:
        """Bound on the errors of the height of the base at lift-offs, in m."""
        velocity, frequency = realization.velocity, realization.parameters["frequency"]
        return velocity * self.phase_error(realization) / frequency if velocity > 0.0 else 0.0

    def speed_error(self, realization: ExactRealization) -> float:
        """Bound on the errors of speeds relative to the base, in units of g / 2 f."""
        p = realization.parameters
        base = 2.0 * math.pi * p["frequency"] * self.height_error(realization)
        return (self.rebound_velocity + base) * 2.0 * p["frequency"] / p["gravity"]

    def record_claims(self, realization: ExactRealization, number: float) -> Mapping[str, float]:
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

    def duration_error(self, realization: ExactRealization, flight: ProvedFlight) -> float:
        """Bound on the error of the duration of a flight, in s."""
        speed, period = self.speed_error(realization), 1.0 / realization.parameters["frequency"]
        if flight.slopes is None:
            return speed * period
        by_phase, by_speed = flight.slopes
        linear = abs(by_phase) * self.phase_error(realization) + abs(by_speed) * speed
        return FIRST_ORDER * linear * period

    def landing_errors(self, realization: ExactRealization, flight: ProvedFlight) -> LandingErrors:
        """Bounds on the errors of a landing, and of the rebound from it, after a flight."""
        frequency = realization.parameters["frequency"]
        duration = self.duration_error(realization, flight) * frequency
        speed = self.speed_error(realization)
        phase = self.landing_time * frequency + 4.0 * EPS
        # gravity adds twice the duration to a speed, in units of g / 2 f
        return LandingErrors(phase, duration, speed + 2.0 * duration, speed)

    def claims(
        self, realization: ExactRealization, measured: ProvedMeasures
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
        self, realization: ExactRealization, measured: ProvedMeasures
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
    dt: float, realization: ExactRealization, measured: ProvedMeasures
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


def _stay_error(dt: float, realization: ExactRealization) -> float:
    """Error of the time between a landing and the end of another particle's stay, s.

    It involves two landings, a lift-off and a sum of phases.
    """
    rounding = 8.0 * EPS / realization.parameters["frequency"]
    return 3.0 * dt + _lift_off_error(dt, realization) + rounding


def _lift_off_error(dt: float, realization: ExactRealization) -> float:
    """Error in s of a lift-off after a rest, if landings have the error dt.

    With a random amplitude it is within dt, since each period lifts at another phase.
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

    def record_claims(self, realization: ExactRealization, number: float) -> Mapping[str, float]:
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

    def landing_errors(self, realization: ExactRealization, flight: ProvedFlight) -> LandingErrors:
        """Estimates of the errors of a landing, and of the rebound from it, after a flight."""
        phase = self.time * realization.parameters["frequency"] + 8.0 * EPS
        speed = self.relative + 8.0 * EPS
        return LandingErrors(phase, 2.0 * phase, speed, speed)

    def claims(
        self, realization: ExactRealization, measured: ProvedMeasures
    ) -> dict[str, float | None]:
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
    realization: ExactRealization, max_landings: int
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


def _rebound(impact: ProvedImpact) -> arb | None:
    """Speed relative to the base after an impact; None where the particle stays."""
    return None if impact.rested or impact.flight is None else impact.flight.speed


def _apart(a: arb | None, b: arb | None) -> float:
    """Distance of two numbers; 0 where either is None."""
    return 0.0 if a is None or b is None else float((a - b).abs_upper())


def _ends(motion: CoupledMotion, launches: Sequence[Fraction], period: arb) -> Iterator[arb]:
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


MOST_BLOCKS: Final = 32
TURNED: Final = 1e-3  # error of the direction beyond which the first-order estimate is useless


class Mean(NamedTuple):
    """Mean logarithm of the growth per impact."""

    value: float
    # Standard error of the mean, from the means of blocks; None below two blocks
    standard_error: float | None
    # Bound on the errors of both, from the dataset's bounds; None where there is none
    claim: float | None


def mean_growth(
    m: PeriodMap,
    phases: Sequence[arb],
    flights: Sequence[ProvedFlight],
    errors: tuple[float, float],
) -> Mean:
    """Mean growth of a perturbation of the phase alone, over one or more impacts without rests.

    The phases of successive lift-offs (turns) and the flights that follow them are proved; the
    kernel's phases and speeds may be off by `errors`.
    """
    c, s, turned, logarithms, wrongs = 1.0, 0.0, 0.0, [], []
    for x, flight in zip(phases, flights, strict=True):
        carried = m.carried(x, flight, (c, s), errors)
        (ax, ay), (bx, by) = carried.along, carried.across
        along = math.hypot(ax, ay)
        if along == 0.0:
            return Mean(-math.inf, 0.0, 0.0 if turned == 0.0 else None)
        wrong = carried.wrong / along
        logarithms.append(math.log(along))
        wrongs.append(abs(ax * bx + ay * by) / along**2 * turned + wrong + 4.0 * EPS)
        turned = abs(ax * by - ay * bx) / along**2 * turned + wrong
        c, s = ax / along, (-ay if carried.turned_back else ay) / along
        if not turned <= TURNED:
            return Mean(math.nan, None, None)
    claim = FIRST_ORDER * max(wrongs) + 2.0 * len(wrongs) * EPS * max(map(abs, logarithms))
    return Mean(math.fsum(logarithms) / len(logarithms), _standard_error(logarithms), claim)


def _standard_error(logarithms: Sequence[float]) -> float | None:
    """Standard error of a mean, from the means of fewer than `MOST_BLOCKS` blocks."""
    length = 1
    while len(logarithms) // length >= MOST_BLOCKS:
        length *= 2
    blocks = len(logarithms) // length
    if blocks < 2:
        return None
    means = [math.fsum(logarithms[b * length : (b + 1) * length]) / length for b in range(blocks)]
    middle = math.fsum(means) / blocks
    return math.sqrt(math.fsum((m - middle) ** 2 for m in means) / (blocks * (blocks - 1)))


# Impacts; a longer cycle would take too long to verify.
MAX_CYCLE: Final = 1000
# Periods; if the cycle found by Newton's method is farther from the orbit, it is another one.
NEAR: Final = 2.0**-20
ROUNDS: Final = 40


class _Return(NamedTuple):
    """Image of a state after one cycle, and the Jacobian along it, by rows."""

    x: arb
    u: arb
    jacobian: tuple[arb, arb, arb, arb]
    determinant: arb


def largest_exponent(
    map_of: Callable[[], PeriodMap],
    state: tuple[arb, arb],
    impacts: int,
    periods: int,
) -> arb | None:
    """Largest Lyapunov exponent per impact of the cycle without rests that passes next to a state.

    The state, phase in turns and speed at lift-off, is one of an orbit that has come near to the
    cycle; `map_of` returns the map in forcing periods, at the current precision.  None if no such
    cycle is proved: a decision along it is uncertain, a multiplier may be 1 or all may be 0, or it
    is longer than `MAX_CYCLE`.
    """
    if impacts > MAX_CYCLE:
        return None
    with ctx.workprec(128 + 4 * math.ceil(impacts * map_of().lost())):
        found = _proved_return(map_of(), state, impacts, periods)
        return None if found is None else _exponent(found, impacts)


def _proved_return(
    m: PeriodMap, state: tuple[arb, arb], impacts: int, periods: int
) -> _Return | None:
    """Return from a box in which the cycle is proved to pass, or None."""
    x, u = state[0].mid(), state[1].mid()
    radius = arb(2) ** (-ctx.prec // 2)
    for _ in range(ROUNDS):
        back = _once_round(m, x, u, impacts)
        step = None if back is None else _newton(back, back, x, u, periods)
        if step is None:
            return None
        x, u = (x + step[0]).mid(), (u + step[1]).mid()
        if not (abs(x - state[0]) < NEAR and abs(u - state[1]) < NEAR):
            return None
        if abs(step[0]) < radius and abs(step[1]) < radius:
            break
    back = _once_round(m, x, u, impacts)
    wide = arb(0, radius)
    box = _once_round(m, x + wide, u + wide, impacts)
    if back is None or box is None:
        return None
    step = _newton(back, box, x, u, periods)
    inside = step is not None and abs(step[0]) < radius and abs(step[1]) < radius
    return box if inside else None


def _once_round(m: PeriodMap, x: arb, u: arb, impacts: int) -> _Return | None:
    """Follow a ball of states round the cycle; None if one may rest, or a decision is uncertain."""
    j00, j01, j10, j11 = arb(1), arb(0), arb(0), arb(1)
    determinant = arb(1)
    for _ in range(impacts):
        step = m.step(x, u)
        if step is None:
            return None
        (xx, xu), (ux, uu) = step.rows
        j00, j10 = xx * j00 + xu * j10, ux * j00 + uu * j10
        j01, j11 = xx * j01 + xu * j11, ux * j01 + uu * j11
        determinant *= step.determinant
        x, u = x + step.duration, step.speed
    return _Return(x, u, (j00, j01, j10, j11), determinant)


def _newton(back: _Return, slope: _Return, x: arb, u: arb, periods: int) -> tuple[arb, arb] | None:
    """Step to the fixed point from the residual of `back` and the Jacobian of `slope`."""
    j00, j01, j10, j11 = slope.jacobian
    j00, j11 = j00 - 1, j11 - 1
    determinant = j00 * j11 - j01 * j10
    if determinant.contains(0):
        return None
    g, h = x + periods - back.x, u - back.u
    return (j11 * g - j01 * h) / determinant, (j00 * h - j10 * g) / determinant


def _exponent(found: _Return, impacts: int) -> arb | None:
    """Logarithm of the largest modulus of the eigenvalues, per impact."""
    trace = abs(found.jacobian[0] + found.jacobian[3])
    discriminant = trace * trace - 4 * found.determinant
    if discriminant < 0:
        modulus = found.determinant.sqrt()
    else:  # where it may be 0, the modulus is between those of both cases
        root = discriminant.abs_upper().sqrt()
        least = discriminant.abs_lower().sqrt() if discriminant > 0 else arb(0)
        modulus = (trace + least.union(root)) / 2
    return modulus.log() / impacts if modulus > 0 else None


# Precision in bits of numbers that become doubles
FLOATING: Final = 128
# Signs that a particle recurs: variables, each with its test
RECURS: Final[dict[str, Callable[[Any], bool]]] = {
    "regime": lambda code: code in (Regime.RESTING, Regime.LOCKED),
    "cycle_impacts": lambda number: number > 0,
    "cycle_periods": lambda number: number > 0,
    "recurrent_from": math.isfinite,
    "cycle_uncertain": lambda code: code >= 0,
    "orbit": lambda number: number >= 0,
    "slot": lambda number: number >= 0,
}


class Representative(NamedTuple):
    """A lift-off: whole periods, phase in turns, speed relative to the base in units of g / 2 f."""

    whole: int
    phase: float
    speed: float


@dataclass(frozen=True)
class EnteredCycle:
    """A cycle that a proved orbit has entered."""

    # Number of the state at which recurrence is stated, or of that after the first of two rests
    since: int
    # impacts, periods, rests: in one cycle
    impacts: int
    periods: int
    rests: int


class Orbit:
    """States of a particle after its launch (number 0) and after each impact.

    Attributes
    ----------
    trajectory
        Proved landings.
    times, flights, speeds
        For each state: time of lift-off in s, flight that follows, and its speed relative to the
        base.
    time_error
        Largest error in s of the kernel's time of a state.
    """

    def __init__(
        self,
        realization: ExactRealization,
        bounds: ErrorBounds,
        trajectory: Trajectory,
        particle: int,
    ) -> None:
        p, launch = realization.parameters, realization.launch_times[particle]
        self.trajectory, self._realization, self._bounds = trajectory, realization, bounds
        self._frequency = arb(p["frequency"])
        left = [i for i in trajectory.impacts if i.liftoff_time is not None]
        with ctx.workprec(2 * trajectory.precision_bits):
            launched = arb(launch.numerator) / launch.denominator
        self.times = [launched, *(i.liftoff_time for i in left)]
        self.flights = [f for f in (trajectory.launch, *(i.flight for i in left)) if f is not None]
        self.speeds = [flight.speed for flight in self.flights]
        end = float(realization.duration)
        self.time_error = bounds.record_claims(realization, end)["liftoff_time"]
        self._time_error = bounds.landing_time * p["frequency"] + 4.0 * EPS
        time = bounds.record_claims(realization, 0.0)["liftoff_time"] * p["frequency"]
        # error of the difference of two states of the kernel, in periods
        self._error = 2.0 * max(time, bounds.speed_error(realization)) + 8.0 * EPS

    def from_rest_to_rest(self) -> EnteredCycle | None:
        """Cycle between two rests that end at the same phase; None if there are no two such rests.

        Lift-offs are compared with that of rest 1, 2, 4, ... (Brent's algorithm), as in the
        kernels: with several phases of lift-off other rests may come before the cycle.
        """
        lifted = (n for n, i in enumerate(self.trajectory.impacts, 1) if i.rested)
        anchor, first = 0, 0  # number of a rest, and of its lift-off
        with ctx.workprec(2 * self.trajectory.precision_bits):
            for rest, state in enumerate(lifted, 1):
                same = False
                if anchor and state < len(self.times):
                    turns = (self.times[state] - self.times[first]) * self._frequency
                    periods = nearest_integer(turns)
                    same = bool(abs(turns - periods) < SAME_ORBIT)
                    if same and periods > 0:
                        return EnteredCycle(first, state - first, periods, rest - anchor)
                if not same and rest >= 2 * anchor:
                    anchor, first = rest, state
        return None

    def recurrence(self, time: float, stated: int) -> EnteredCycle | None:
        """Cycle without rests at a stated time, with the stated number of impacts if correct.

        A time (s) of NaN stands for the last state, and 0 impacts for a number that is not stated.
        None where the orbit does not repeat.
        """
        if self.trajectory.at_rest:
            return None
        with ctx.workprec(2 * self.trajectory.precision_bits):
            for since in self._at(time):
                impacts = self._cycle(since, stated)
                if impacts > 0:
                    return EnteredCycle(since, impacts, self._periods(since - impacts, impacts), 0)
        return None

    def _at(self, time: float) -> Sequence[int]:
        """Numbers of the states that may be at a given time, or nearest to it."""
        if not math.isfinite(time):
            return [len(self.times) - 1]
        gaps = [float(abs(t - time)) for t in self.times]
        near = [n for n, gap in enumerate(gaps) if gap <= self.time_error]
        return near or [gaps.index(min(gaps))]

    def _periods(self, state: int, cycle: int) -> int:
        """Forcing periods from a state to the one `cycle` impacts later, as a whole number."""
        return nearest_integer((self.times[state + cycle] - self.times[state]) * self._frequency)

    def _cycle(self, since: int, stated: int) -> int:
        """Impacts in the cycle of a state; 0 if the orbit does not repeat.

        The stated number is correct if the orbit may repeat after it, and does not certainly repeat
        after one of its proper divisors.
        """
        if stated > 0 and self._repeats(since - stated, stated, SAME_ORBIT + self._error):
            shorter = (d for d in range(1, stated) if stated % d == 0)
            certain = SAME_ORBIT - self._error
            return next((d for d in shorter if self._repeats(since - stated, d, certain)), stated)
        others = range(1, since + 1)
        return next((n for n in others if self._repeats(since - n, n, SAME_ORBIT + self._error)), 0)

    def _repeats(self, first: int, cycle: int, error: float) -> bool:
        """Return whether all states from `first` on return a cycle later, up to an error."""
        last = len(self.times) - cycle
        if not 0 <= first < last:
            return False
        periods = self._periods(first, cycle)
        if periods < 1:
            return False
        for n in range(first, last):
            turns = (self.times[n + cycle] - self.times[n]) * self._frequency - periods
            if abs(turns) > error or abs(self.speeds[n + cycle] - self.speeds[n]) > error:
                return False
        return True

    def map(self) -> PeriodMap:
        """Map in forcing periods, at the current precision."""
        realization = self._realization
        return realization.reference.period_map(realization.parameters, realization.laws)

    def contraction(self, first: int, last: int) -> tuple[arb | float, float]:
        """Mean logarithm of the contraction of areas by impacts, from state `first` to `last`.

        Also returns its largest error, from the errors that the dataset claims.
        """
        error = self._bounds.speed_error(self._realization)
        speeds = [impact.arrival for impact in self.trajectory.impacts[first:last]]
        with ctx.workprec(self.trajectory.precision_bits):
            return self.map().contraction(speeds, error)

    def last_state(self) -> tuple[arb, arb]:
        """Phase in turns, not reduced, and speed of the last state."""
        with ctx.workprec(2 * self.trajectory.precision_bits):
            return self._turns(-1), self.speeds[-1]

    def growth(self, first: int, last: int) -> Mean:
        """Mean growth by the impacts from state `first` to state `last`."""
        with ctx.workprec(2 * self.trajectory.precision_bits):
            phases = [self._turns(n) for n in range(first, last)]
        errors = self._time_error, self._bounds.speed_error(self._realization)
        with ctx.workprec(FLOATING):
            return mean_growth(self.map(), phases, self.flights[first:last], errors)

    def _turns(self, state: int) -> arb:
        return self.times[state] * self._frequency + arb(self._realization.parameters["phase"]) / (
            2 * arb.pi()
        )

    def representative(self, cycle: EnteredCycle) -> Representative | None:
        """State of a cycle with the lowest speed; of equally slow ones, that of lowest phase.

        Whole periods are counted with the phase of the forcing reduced to one turn.  None if states
        are too close to decide.
        """
        with ctx.workprec(2 * self.trajectory.precision_bits):
            whole = nearest_integer(arb(self._realization.parameters["phase"]) / (2 * arb.pi()))
            members = []
            for n in range(len(self.times) - cycle.impacts, len(self.times)):
                turns = self._turns(n)
                count = nearest_integer(turns)
                members.append(
                    Representative(count - whole, float(turns - count), float(self.speeds[n]))
                )
        slowest = min(member.speed for member in members)
        tied = sorted(
            (m for m in members if m.speed <= slowest + 3 * SAME_ORBIT), key=lambda m: m[1]
        )
        if any(m.speed > slowest + SAME_ORBIT / 3 for m in tied):
            return None
        found = tied[0]
        if len(tied) > 1 and tied[1].phase - found.phase < 3 * SAME_ORBIT:
            return None
        if found.phase < SAME_ORBIT / 3 - 0.5:  # -1/2 and 1/2 are the same phase
            return Representative(found.whole - 1, found.phase + 1.0, found.speed)
        return None if found.phase < 3 * SAME_ORBIT - 0.5 else found


def numbered(
    cycles: Sequence[EnteredCycle | None], states: Sequence[Representative | None]
) -> Sequence[int | None]:
    """Number the orbits of particles, each new one after those of earlier particles.

    Each particle is given by its cycle and representative.  A particle without a cycle has the
    number -1; all are None if it cannot be decided whether two particles are on one orbit.
    """
    numbers: list[int] = []
    firsts: list[tuple[EnteredCycle, Representative]] = []
    for entered, state in zip(cycles, states, strict=True):
        if entered is None:
            numbers.append(-1)
            continue
        same = [] if state is None else [_same(entered, state, *first) for first in firsts]
        if state is None or None in same:
            return [None] * len(cycles)
        if True not in same:
            firsts.append((entered, state))
            same.append(True)
        numbers.append(same.index(True))
    return numbers


def _same(
    cycle: EnteredCycle, state: Representative, other: EnteredCycle, first: Representative
) -> bool | None:
    """Decide whether two particles are on one orbit; None if uncertain."""
    if (cycle.impacts, cycle.periods, cycle.rests) != (other.impacts, other.periods, other.rests):
        return False
    apart = state.phase - first.phase
    distance = max(abs(state.speed - first.speed), abs(apart - round(apart)))
    return None if SAME_ORBIT / 3 < distance < 3 * SAME_ORBIT else distance < SAME_ORBIT
