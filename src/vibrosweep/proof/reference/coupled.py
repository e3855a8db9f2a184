"""Trajectories of all particles on a base of finite mass, with proved error bounds.

Parameters are taken as the exact doubles that they are, as in `vibrosweep.proof.reference.ball`;
`vibrosweep.proof.reference.sprung` states what happens at each event.  A landing at t' counts if
and only if t' <= duration; the motion is followed until all particles in flight have landed.  A
particle that rides the base at the end has no lift-off.  It is at rest for good if all particles
ride and the forced oscillation, with the envelope of the free one, can no longer throw them off.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, partial
from itertools import groupby
from typing import Final

from vibrosweep.errors import ParameterError
from vibrosweep.model.status import Status
from vibrosweep.proof.reference._flint import arb, ctx, exact
from vibrosweep.proof.reference.decisions import (
    WidthLimits,
    certain_above,
    decided,
    first_precision,
    nearest_integer,
)
from vibrosweep.proof.reference.drives import Mount
from vibrosweep.proof.reference.events import LANDING, Bodies, Event, Launch
from vibrosweep.proof.reference.laws import Laws, Random
from vibrosweep.proof.reference.motion import Deviates
from vibrosweep.proof.reference.results import Flight, Impact, Trajectory
from vibrosweep.proof.reference.sprung import System

CONSTANT_LAWS: Final = Laws()
PATIENCE: Final = 1  # periods after the end up to which a lift-off counts
ZERO: Final = arb(0)


class TooManyLandingsError(ParameterError):
    """More landings come before the end than are allowed."""


@dataclass(frozen=True)
class Coupled:
    """The proved motion of a realization."""

    particles: tuple[Trajectory, ...]  # trajectory of each
    # All up to the end, in the order of time, in the units of `vibrosweep.proof.reference.mount`
    events: tuple[Event, ...]
    # Precision at which every decision became certain and every ball narrow enough
    precision_bits: int


@dataclass(frozen=True)
class _Problem:
    """Exact inputs, and the accuracy of the results."""

    parameters: Mapping[str, float]
    launch_times: tuple[Fraction, ...]
    duration: Fraction
    laws: Laws
    max_landings: int
    digits: int
    deviates: Callable[[int], Deviates] | None

    @property
    def launches(self) -> list[Launch]:
        """Particles by their launch, in the order of time and then of their numbers."""
        ordered = sorted(range(len(self.launch_times)), key=self.launch_times.__getitem__)
        return [
            Launch(self.turns(time), tuple(particles))
            for time, particles in groupby(ordered, key=self.launch_times.__getitem__)
        ]

    @property
    def speed(self) -> arb:
        """Unit of speeds, m s-1."""
        return arb(self.parameters["gravity"]) / (2 * arb(self.parameters["frequency"]))

    @property
    def length(self) -> arb:
        """Unit of heights, m."""
        return self.speed / arb(self.parameters["frequency"])

    def turns(self, time: Fraction) -> arb:
        """Phase of the forcing at a time, whole periods included."""
        p = self.parameters
        return arb(p["frequency"]) * exact(time) + arb(p["phase"]) / (2 * arb.pi())

    def time(self, turns: arb) -> arb:
        """Time in s of a phase."""
        p = self.parameters
        return (turns - arb(p["phase"]) / (2 * arb.pi())) / arb(p["frequency"])

    def require_narrow(self, impact: Impact, number: int) -> None:
        """Raise `UncertainError` unless a landing and the lift-off after it are narrow."""
        limits = WidthLimits(self.digits, self.parameters)
        found = [(impact.landing_time, limits.time), (impact.phase, limits.phase)]
        if impact.liftoff_time is not None and impact.rebound_velocity is not None:
            found.append((impact.liftoff_time, limits.time))
            found.append((impact.rebound_velocity, limits.velocity))
        if impact.flight is not None:
            found.append((impact.flight.duration, limits.phase))
        limits.require(number, *found)


def bodies_of(
    parameters: Mapping[str, float],
    laws: Laws = CONSTANT_LAWS,
    deviates: Callable[[int], Deviates] | None = None,
) -> Bodies:
    """Base and particles of physical parameters, at the current precision."""
    p = {name: arb(value) for name, value in parameters.items()}
    rate = 2 * p["frequency"] / p["gravity"]
    mount = Mount(
        alpha=rate * p["amplitude"] / (1 + p["restitution"]),
        natural=2 * arb.pi() * p["mount_frequency"] / p["frequency"],
        damping=p["mount_damping"],
        mass_ratio=p["mass_ratio"],
        waveform=laws.waveform,
    )
    rest, law = p["frequency"] * p["contact_time"], laws.in_periods(p)
    drawn = None
    if deviates is not None:
        of_particle = cache(deviates)
        size = p.get("restitution_noise", ZERO)
        strength = rate * (1 + p["restitution"]) * p.get("kick_noise", ZERO)

        def drawn(particle: int, number: int) -> Random:
            slip, push = of_particle(particle).of_impact(number)
            return Random(law, size * slip, strength * push, thrown=True)

    return Bodies(mount, law, rest, rate * p["launch_velocity"], drawn)


def coupled(
    parameters: Mapping[str, float],
    launch_times: Sequence[float | Fraction],
    duration: float | Fraction,
    *,
    laws: Laws = CONSTANT_LAWS,
    deviates: Callable[[int], Deviates] | None = None,
    max_landings: int = 10_000,
    digits: int = 20,
    max_bits: int = 1 << 14,
    bits: int = 0,
) -> Coupled:
    """Every landing of all particles, with proved error bounds.

    Parameters are those of `vibrosweep.model.parameters.PARAMETERS`, of the mount and, where
    `deviates` gives those of each particle, of the noise of impacts.  Landings at t <= duration (s)
    count; a `Fraction` gives a time exactly.  Radii are at most 10**-digits times the larger of a
    velocity and v_rest, the larger of a time and the contact time, or one turn for a phase.  The
    first precision is `bits`, or more if `digits` needs it.

    Parameters come from a scene that was checked, and are not checked again.  Raises an
    UndecidableError where a decision stays uncertain at `max_bits`: a tie, or motion that loses
    more digits.  It counts the impacts of all particles together.
    """
    values = {name: float(value) for name, value in parameters.items()}
    launched = tuple(Fraction(time) for time in launch_times)
    problem = _Problem(values, launched, Fraction(duration), laws, max_landings, digits, deviates)
    first = max(bits, first_precision(digits))
    return decided(partial(_attempt, problem), first, max_bits)


class _Course:
    """Events of one particle: `counted` of them up to the end of the observation, then later ones.

    A lift-off that no longer counts is left out, with all later events.
    """

    def __init__(self) -> None:
        self.events: list[Event] = []
        self.counted = 0
        self.complete = False  # True once no later event is needed

    def add(self, event: Event, after: bool, late: bool) -> None:
        """Add the next event; it may be `after` the end, or too `late` for a lift-off to count."""
        if self.complete:
            return
        if late and self.waits:
            self.complete = True
            return
        self.events.append(event)
        self.counted += not after
        self.complete = after and event.kind is LANDING

    @property
    def rides(self) -> bool:
        """True if the particle is on the base at the end."""
        return self.counted > 0 and _rests(self.events[self.counted - 1])

    @property
    def waits(self) -> bool:
        """True if the particle is on the base at the end, and its lift-off may still count."""
        return self.rides and self.counted == len(self.events) and not self.complete

    def trajectory(self, problem: _Problem, rest: bool, bits: int) -> Trajectory:
        """Return the trajectory; a particle that rides at the end may be at `rest` for good."""
        impacts: list[Impact] = []
        for i, landed in enumerate(self.events[: self.counted]):
            if landed.kind is not LANDING:
                continue
            rested = _rests(landed)
            left, count = i + rested, nearest_integer(landed.turns)
            leaves = left < len(self.events)
            impacts.append(
                Impact(
                    landing_time=problem.time(landed.turns),
                    liftoff_time=problem.time(self.events[left].turns) if leaves else None,
                    rebound_velocity=problem.speed * self.events[left].after if leaves else None,
                    rested=rested,
                    count=count,
                    phase=landed.turns - count,
                    flight=self._flight(problem, left) if leaves else None,
                    arrival=landed.base_before - landed.before,
                )
            )
            problem.require_narrow(impacts[-1], landed.number)
        launch, at_rest = self._flight(problem, 0), rest and self.rides
        return Trajectory(launch, tuple(impacts), at_rest, Status.COMPLETED, bits)

    def _flight(self, problem: _Problem, left: int) -> Flight:
        """Flight that an event begins, and the next one ends."""
        event, landed = self.events[left : left + 2]
        if landed.turns is event.turns:  # a launch that is slower than the base
            return Flight(event.relative, problem.length * event.height, ZERO, None)
        rising = event.after.max(ZERO)
        top = event.height + rising * rising / 4
        return Flight(event.relative, problem.length * top, landed.turns - event.turns, None)


def _rests(event: Event) -> bool:
    """Return whether the particle stays on the base after an event."""
    return event.relative is None


def _attempt(problem: _Problem, bits: int) -> Coupled:
    """Return the motion at one precision, or raise `UncertainError`."""
    with ctx.workprec(bits):
        bodies = bodies_of(problem.parameters, problem.laws, problem.deviates)
        end = problem.turns(problem.duration)
        system, counted, seen = System(bodies, problem.launches, end + PATIENCE), 0, 0
        courses = [_Course() for _ in problem.launch_times]
        stay = rest = late = False
        while True:
            if counted == len(system.events):  # the end is still to come
                stay = system.riders_stay(end)
            alone = bodies.mount.mass_ratio.is_zero() or all(one.rides for one in courses)
            rest = stay and alone
            if not system.advance():
                break
            for event in system.events[seen:]:
                what = f"the {event.kind} of particle {event.particle} is after the end"
                after = certain_above(event.turns, end, what, event.number)
                late = after and certain_above(event.turns, end + PATIENCE, what, event.number)
                courses[event.particle].add(event, after, late)
                counted += not after
            seen = len(system.events)
            if system.landings > problem.max_landings:
                raise TooManyLandingsError(
                    f"max_landings = {problem.max_landings!r}: more come before the end; raise it "
                    f"or shorten the duration"
                )
            if counted < seen and all(
                one.complete or (one.waits and (late or rest)) for one in courses
            ):
                break
        particles = tuple(one.trajectory(problem, rest, bits) for one in courses)
        return Coupled(particles, tuple(system.events[:counted]), bits)
