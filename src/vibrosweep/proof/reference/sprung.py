"""Particles on a base of finite mass, event by event, in ball arithmetic.

Phase x is in turns, time in forcing periods, speeds in g / 2 f; so heights are in g / 2 f^2, and
gravity is 2.  Without particles the base moves as Yf = alpha W(x), a sum of harmonics
(`vibrosweep.proof.reference.laws`).  While n particles ride it, the deviation D = Y - Yf obeys,
with the load l = n mu and nu = f0 / f of the mount,

    (1 + l) D'' + 2 zeta w0 D' + w0^2 D = -l (Yf'' + 2),        w0 = 2 pi nu

D is the sum of a constant, forced oscillations and a free one, h, with h'' + 2 Z h' + Q h = 0,
Z = zeta w0 / (1 + l) and Q = w0^2 / (1 + l).  (h''')^2 + Q (h'')^2 never grows, which bounds h''
from any instant on.

A particle of velocity v lands on a base of velocity V on which n particles ride, with the approach
speed c = V - v.  mu is the mass ratio:

* It sticks if e c <= r and the base then presses it: V and v become
  ((1 + n mu) V + mu v) / (1 + (n + 1) mu).
* Else v rises by (1 + e) c / (1 + mu), and V falls by w = mu (1 + e) c / (1 + mu).  The riders keep
  their velocity and so leave with the relative speed w, if w > r.
* Else base and riders take the impact as one body: mu / (1 + n mu) replaces mu.

The base presses its riders while it would not, alone, fall faster than gravity:
(1 + l) (Y'' + 2) = Yf'' + 2 - 2 zeta w0 D' - w0^2 D > 0.  When that ends, all riders leave with its
velocity.  Particles in the same state land in the order of their numbers; those that the recoiling
base no longer approaches fly on.

The next event is proved to be the next: `first_root` encloses the first landing of every flight and
the first lift-off of the riders, or proves that they are later, and two enclosures that overlap
require more precision.  Balls are carried from event to event as they are, so the precision needed
grows with the number of landings.

`coupled` takes parameters as the exact doubles that they are.  A landing at t' counts if and only
if t' <= duration; the motion is followed until all particles in flight have landed.  A particle
that rides the base at the end has no lift-off.  It is at rest for good if all particles ride and
the forced oscillation, with the envelope of the free one, can no longer throw them off.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache, partial
from itertools import groupby
from typing import Final, NamedTuple

from vibrosweep.errors import ParameterError
from vibrosweep.model.measures import Status
from vibrosweep.model.shapes import PARABOLIC_NAME, SINE, Waveform
from vibrosweep.proof.reference.arithmetic import (
    Course,
    UncertainError,
    WidthLimits,
    acb,
    arb,
    certain_above,
    ctx,
    decided,
    exact,
    first_precision,
    narrowed,
    nearest_integer,
)
from vibrosweep.proof.reference.laws import Laws, Random, Restitution
from vibrosweep.proof.reference.motion import (
    END,
    Deviates,
    ProvedFlight,
    ProvedImpact,
    Trajectory,
    first_root,
)

ZERO, HALF = arb(0), arb(0.5)


class ExactMount(NamedTuple):
    """A base and its mount."""

    alpha: arb  # factor of the velocity of the base without particles
    natural: arb  # w0, angle per forcing period
    damping: arb  # zeta
    mass_ratio: arb  # mu, of one particle and the base
    waveform: Waveform = SINE  # of the base without particles

    @property
    def has_corners(self) -> bool:
        """True if the acceleration of the drive jumps, at phases 1/4 and 3/4."""
        return self.waveform.name == PARABOLIC_NAME

    @property
    def tones(self) -> Sequence[tuple[int, float, float]]:
        """Number, weight and phase of each harmonic of the velocity."""
        return self.waveform.tones or (() if self.has_corners else ((1, 1.0, 0.0),))


class Arc:
    """Motion of the base from an instant on, until an event changes it.

    The state, D and D', is that `after` periods after an instant of phase x, or before it.  Times
    s are those since the instant; balls that hold an interval give bounds on it.  Where the drive
    has corners, the arc is that of the half turn from phase piece / 2 - 1/4 on.  Raises an
    UncertainError, about the next landing, at a resonance without damping.
    """

    def __init__(
        self,
        mount: ExactMount,
        x: arb,
        state: tuple[arb, arb],
        riders: int,
        after: arb,
        impact: int,
        piece: int = 0,
    ) -> None:
        load, w0 = riders * mount.mass_ratio, mount.natural
        mass, drag = 1 + load, 2 * mount.damping * w0
        self._z, self._q = drag / (2 * mass), w0 * w0 / mass
        self._root = w0 / mass * acb(mount.damping * mount.damping - mass).sqrt()
        # i times each angular frequency, and complex amplitudes of the height and of D
        self._tones = []
        for number, weight, phase in mount.tones:
            rate, answer = acb(0, 2 * arb.pi() * number), acb(0)
            turned = acb(2 * number * x).exp_pi_i() * acb(0, arb(phase)).exp()
            bare = -mount.alpha * arb(weight) / (2 * arb.pi() * number) * turned
            if not load.is_zero():
                resists = mass * rate * rate + drag * rate + w0 * w0
                if not abs(resists) > 0:
                    what = "whether the loaded base is driven at its resonance"
                    raise UncertainError(what, impact)
                answer = -load * rate * rate * bare / resists
            self._tones.append((rate, bare + answer, answer))
        side = (-1) ** piece if mount.has_corners else 0
        # the parabola of a drive with corners: height, velocity and acceleration at the instant
        pull, y = 4 * side * mount.alpha, x - arb(piece) / 2
        self._drive = pull / 2 * y * y - side * mount.alpha / 8, pull * y, pull
        self._level = -load * (2 + pull) / (w0 * w0)
        self._changes = side != 0 and not load.is_zero()  # at the next corner
        self._free = [ZERO, ZERO]
        forced = self.deviation(after)
        self._free = [state[0] - forced[0], state[1] - forced[1]]
        self._free = self._free_at(-after)

    def _waves(self, s: arb) -> tuple[arb, arb]:
        """exp(-Z s) times cosh(k s), and times sinh(k s) / k; k^2 = Z^2 - Q has either sign."""
        z, k = self._z, self._root
        if abs(k * s) < 1:  # k may be 0
            fade, turned = (-z * s).exp(), k * s
            return fade * turned.cosh().real, fade * s * (acb(0, 1) * turned).sinc().real
        slow, fast = ((k - z) * s).exp(), (-(k + z) * s).exp()
        return ((slow + fast) / 2).real, ((slow - fast) / (2 * k)).real

    def _free_at(self, s: arb, order: int = 1) -> list[arb]:
        """Values of h and its derivatives, up to an order of at least 1."""
        (h, v), z, q = self._free, self._z, self._q
        even, odd = self._waves(s)
        free = [h * (even + z * odd) + v * odd, v * (even - z * odd) - h * q * odd]
        while len(free) <= order:
            free.append(-2 * z * free[-1] - q * free[-2])
        return free

    def derivative(self, order: int, s: arb) -> arb:
        """Height of the base (0), its velocity (1), acceleration (2), ..."""
        y, v, pull = self._drive
        drive = (y + self._level + s * (v + pull / 2 * s), v + pull * s, pull)
        total = self._free_at(s, order)[order] + (drive[order] if order < len(drive) else ZERO)
        for rate, height, _ in self._tones:
            total += (height * rate**order * (rate * s).exp()).real
        return total

    def deviation(self, s: arb) -> tuple[arb, arb]:
        """D and D'."""
        height, velocity = self._free_at(s)
        for rate, _, answer in self._tones:
            turned = answer * (rate * s).exp()
            height, velocity = height + turned.real, velocity + (rate * turned).real
        return height + self._level, velocity

    def presses_for_good(self, s: arb) -> bool:
        """Return whether the base, if no event changes its arc, presses its riders from s on."""
        _, _, bend, rate = self._free_at(s, 3)
        largest = (bend * bend + rate * rate / self._q).abs_upper().sqrt() + abs(self._drive[2])
        for turn, height, _ in self._tones:
            largest += abs(height * turn * turn)
        return not self._changes and bool(largest < 2)


LAUNCH, LANDING, LIFTOFF = "launch", "landing", "lift-off"


class Bodies(NamedTuple):
    """The moving bodies: the base on its mount, and identical particles."""

    mount: ExactMount
    restitution: Restitution
    r: arb  # relative speed at and below which a particle sticks where the base presses it
    u0: arb  # velocity of a launch
    # Law of restitution of an impact with its random numbers, by the particle and the number of its
    # impact, from 0; None where nothing is random
    drawn: Callable[[int, int], Restitution] | None = None


class ParticleEvent(NamedTuple):
    """An event of one particle."""

    kind: str  # `LAUNCH`, `LANDING`, or `LIFTOFF` of a rider
    particle: int  # its number
    turns: arb  # phase of the forcing, whole periods included
    height: arb  # of the base and the particle
    # before, after: velocity of the particle
    before: arb
    after: arb
    # base_before, base: velocity of the base, before and afterwards
    base_before: arb
    base: arb
    # Speed of the particle relative to the base, if it leaves; None if it stays
    relative: arb | None
    number: int  # number of landings so far, of all particles
    riders: int  # number of particles that ride afterwards
    # deviation, rate: D and D' afterwards
    deviation: arb
    rate: arb


@dataclass(eq=False)
class Flying:
    """Particles that left the base together and fly as one."""

    particles: tuple[int, ...]  # their numbers
    speed: arb  # relative to the base, after all impacts of the instant at which they left
    lifted: bool = False  # True if the base pressed them until they left
    # instant, height, velocity: a phase, an exact number, and the motion at it
    instant: arb = ZERO
    height: arb = ZERO
    velocity: arb = ZERO
    clear: arb = ZERO  # time in the present arc before which they cannot land


class Launch(NamedTuple):
    """Particles that are launched at one instant, in the order of their numbers."""

    turns: arb
    particles: tuple[int, ...]


class Next(NamedTuple):
    """An event that may be the next one, `s` periods after the present instant."""

    s: arb
    name: str
    act: Callable[[arb], None]  # carries it out, given its time
    course: Course | None = None  # has its first root at that time; None if it is known


def _latest(found: Sequence[Next], otherwise: arb = END) -> arb:
    """Time after which an event cannot be the next one."""
    return min((one.s.upper() for one in found), default=otherwise)


def _of(kind: str, particles: Sequence[int]) -> str:
    return f"the {kind} of particle {' and '.join(map(str, particles))}"


class CoupledSystem:
    """The base, whose state at the first launch is given, and its particles, at one precision.

    Where all particles ride the base, their lift-off is looked for up to the phase `end`.

    The state is kept at an exact instant next to the last event, to which the motion after the
    event is continued: the uncertain time of the event then widens only balls that depend on it.

    Attributes
    ----------
    events
        All so far, in the order of time.
    landings
        Number of landings so far, of all particles.
    """

    def __init__(
        self,
        bodies: Bodies,
        launches: Sequence[Launch],
        end: arb,
        deviation: arb = ZERO,
        rate: arb = ZERO,
    ) -> None:
        self._bodies, self._waiting, self._end = bodies, list(launches), end
        self._flying: list[Flying] = []
        self._leaving: list[Flying] = []
        self._riders: list[int] = []
        self.events: list[ParticleEvent] = []
        self.landings = 0
        self._drawn: Counter[int] = Counter()  # impacts of each particle whose numbers are drawn
        first, mount = launches[0].turns, bodies.mount
        self._instant, self._late, self._piece = first.mid(), ZERO, nearest_integer(2 * first)
        if mount.has_corners:
            what = "no corner of the drive is at the first launch"
            certain_above(HALF, abs(2 * first - self._piece), what, 0)
        self._arc = Arc(mount, self._instant, (deviation, rate), 0, ZERO, 1, self._piece)

    @property
    def massless(self) -> bool:
        """True if particles do not move the base."""
        return bool(self._bodies.mount.mass_ratio.is_zero())

    def riders_stay(self, turns: arb) -> bool:
        """Return whether no rider can leave from a phase on, if nothing lands until then."""
        return self._arc.presses_for_good(turns - self._instant)

    def advance(self) -> bool:
        """Carry out the next event; False if there is none.

        Raises an UncertainError where more precision is needed to find it, or to decide what
        happens.
        """
        first = self._next()
        if first is None:
            return False
        arc, s, load = self._arc, first.s, len(self._riders) * self._bodies.mount.mass_ratio
        self._turns, self._height = self._instant + s, arc.derivative(0, s)
        self._velocity, (self._deviation, self._rate) = arc.derivative(1, s), arc.deviation(s)
        self._press = (1 + load) * (2 + arc.derivative(2, s))
        first.act(s)
        self._instant = self._turns.mid()
        self._late = self._turns - self._instant
        self._settle()
        return True

    def _next(self) -> Next | None:
        """Return the first of all events that may come."""
        arc, number, found = self._arc, self.landings + 1, []
        corner = arb(2 * self._piece + 1) / 4
        if self._bodies.mount.has_corners and not (
            corner > self._end and not self._flying and not self._waiting
        ):
            found.append(Next(corner - self._instant, "a corner of the drive", self._turn))
        if self._waiting:
            launch = self._waiting[0]
            s, name = launch.turns - self._instant, _of(LAUNCH, launch.particles)
            found.append(Next(s, name, self._launch))
        courses: list[tuple[str, Sequence[int], arb, Callable[[arb], None], Course]] = [
            (LANDING, f.particles, f.clear, partial(self._land, f), partial(self._clearance, f))
            for f in self._flying
        ]
        if self._riders and not arc.presses_for_good(self._late):
            start, press = self._late.lower(), partial(_press, arc)
            courses.append((LIFTOFF, self._riders, start, self._lift, press))
        for kind, particles, start, act, course in courses:
            until = _latest(found, END if self._flying else (self._end - self._instant).upper())
            s = first_root(course, start, number, until)
            if s.is_finite():
                found.append(Next(s, _of(kind, particles), act, course))
        least = _latest(found)
        found = [
            one
            if one.course is None or one.s > least
            else one._replace(s=narrowed(one.course, one.s))
            for one in found
        ]
        if not found:
            return None
        first = min(found, key=lambda one: one.s.mid())
        for other in found:
            if first is not other and not first.s < other.s:
                raise UncertainError(f"whether {first.name} precedes {other.name}", number)
        if self.events and not first.s > self._late:
            raise UncertainError(f"whether {first.name} follows the last event", number)
        return first

    def _clearance(self, flying: Flying, order: int, s: arb) -> arb:
        """Height of particles in flight above the base (0), its derivative (1), ..."""
        flown = self._instant - flying.instant + s
        height = flying.height + flown * (flying.velocity - flown)
        fall = height, flying.velocity - 2 * flown, arb(-2)
        return (fall[order] if order < len(fall) else ZERO) - self._arc.derivative(order, s)

    def _settle(self) -> None:
        """Continue the base and the flights after the event from the exact instant next to it."""
        late, number = self._late, self.landings + 1
        state = (self._deviation, self._rate), len(self._riders), late, number, self._piece
        arc = self._arc = Arc(self._bodies.mount, self._instant, *state)
        for flying in self._flying:
            flying.clear = late.lower()
        bend = 2 + arc.derivative(2, ZERO.union(late))
        for flying in self._leaving:
            speed = flying.speed
            flying.instant = self._instant
            flying.height = arc.derivative(0, ZERO) - late * (speed + late / 2 * bend)
            flying.velocity = arc.derivative(1, ZERO) + speed + late * bend
            flying.clear = self._departed(flying)
        self._flying += self._leaving
        self._leaving = []

    def _departed(self, flying: Flying) -> arb:
        """Time until which particles that have just left the base are proved not to land.

        At first the clearance is 0, and so are its derivatives below the one that is positive for
        a while: the first, the second of particles that leave without a relative speed, or the
        third where the base pressed them until then.
        """
        order = 3 if flying.lifted else 2 if flying.speed.is_zero() else 1
        for shorter in range(ctx.prec // 2):
            until = self._late + arb(0.25) ** (1 + shorter)
            if self._clearance(flying, order, self._late.union(until)) > 0:
                return until.lower()
        raise UncertainError("whether a particle leaves the base", self.landings + 1)

    def _turn(self, _: arb) -> None:
        """Pass a corner, where the base may begin to fall faster than gravity at once."""
        self._piece += 1
        self._press += 8 * (-1) ** self._piece * self._bodies.mount.alpha
        what = "the base presses a particle"
        if self._riders and not certain_above(self._press, ZERO, what, self.landings):
            self._leave(ZERO, lifted=False)

    def _lift(self, _: arb) -> None:
        """Let all riders leave a base that falls away from them."""
        self._leave(ZERO, lifted=True)

    def _recoil(self, velocity: arb) -> None:
        """Reduce the velocity of the base."""
        mount = self._bodies.mount
        self._rate -= velocity
        self._velocity -= velocity
        self._press += 2 * mount.damping * mount.natural * velocity
        for flying in self._leaving:
            flying.speed += velocity

    def _launch(self, _: arb) -> None:
        """Launch particles; those slower than the base land at once."""
        flying = []
        for particle in self._waiting.pop(0).particles:
            speed = self._bodies.u0 - self._velocity
            self._note(LAUNCH, particle, self._bodies.u0, speed)
            what = "a launch is faster than the base"
            if certain_above(speed, ZERO, what, self.landings + 1):
                flying.append(particle)
            else:
                self._impact([particle], speed)
        if flying:
            self._leaving.append(Flying(tuple(flying), self._bodies.u0 - self._velocity))

    def _leave(self, speed: arb, *, lifted: bool) -> None:
        """Let all riders leave, with a speed relative to the base."""
        riders, self._riders = tuple(sorted(self._riders)), []
        self._leaving.append(Flying(riders, speed, lifted))
        for particle in riders:
            self._note(LIFTOFF, particle, self._velocity + speed, speed)

    def _land(self, flying: Flying, s: arb) -> None:
        """Let particles in one state land in order, or as one if massless and without noise."""
        self._flying.remove(flying)
        speed, velocity = self._clearance(flying, 1, s), self._velocity
        if self.massless and self._bodies.drawn is None:
            self._impact(flying.particles, speed)
            return
        for place, particle in enumerate(flying.particles):
            now = speed + velocity - self._velocity
            what = "the base still approaches a particle that lands with another"
            if place and not certain_above(-now, ZERO, what, self.landings + 1):
                self._leaving.append(Flying((particle,), now))
            else:
                self._impact([particle], now)

    def _impact(self, particles: Sequence[int], speed: arb) -> None:
        """Exchange momentum between the base and particles that land with a relative speed."""
        mount, r, base = self._bodies.mount, self._bodies.r, self._velocity
        v, c, riding, mu = base + speed, -speed, len(self._riders), mount.mass_ratio
        w = self._law(particles).kept(c)
        self.landings += len(particles)
        if self._sticks(c, w):
            self._recoil(mu * c / (1 + (riding + 1) * mu))
            self._riders.extend(particles)
            for particle in particles:
                self._note(LANDING, particle, v, None, base)
            return
        thrown = mu * (c + w) / (1 + mu)
        throws = riding > 0 and certain_above(thrown, r, "the riders leave", self.landings)
        ratio = mu if throws else mu / (1 + riding * mu)
        self._recoil(ratio * (c + w) / (1 + ratio))
        for particle in particles:
            self._note(LANDING, particle, v, w, base)
        if throws:
            self._leave(thrown, lifted=False)
        self._leaving.append(Flying(tuple(particles), w))

    def _law(self, particles: Sequence[int]) -> Restitution:
        """Law of restitution of the next impact of a particle, or of all that land as one."""
        if self._bodies.drawn is None:
            return self._bodies.restitution
        (particle,) = particles
        self._drawn[particle] += 1
        return self._bodies.drawn(particle, self._drawn[particle] - 1)

    def _sticks(self, c: arb, w: arb) -> bool:
        """Decide if a particle that approaches with speed c, and would leave with w, sticks."""
        mount = self._bodies.mount
        if certain_above(w, self._bodies.r, "e c > r", self.landings):
            return False
        if self._riders:  # the base presses the riders, and even more after the impact
            return True
        recoil = mount.mass_ratio * c / (1 + mount.mass_ratio)
        pressed = self._press + 2 * mount.damping * mount.natural * recoil
        return certain_above(pressed, ZERO, "the base presses a particle", self.landings)

    def _note(
        self, kind: str, particle: int, before: arb, relative: arb | None, base: arb | None = None
    ) -> None:
        now = self._velocity
        after = now if relative is None else now + relative
        moves = before, after, now if base is None else base, now, relative
        state = self.landings, len(self._riders), self._deviation, self._rate
        self.events.append(ParticleEvent(kind, particle, self._turns, self._height, *moves, *state))


def _press(arc: Arc, order: int, s: arb) -> arb:
    """Acceleration of the base relative to free fall (0), its derivative (1), ..."""
    return arc.derivative(order + 2, s) + (ZERO if order else 2)


CONSTANT_LAWS: Final = Laws()
PATIENCE: Final = 1  # periods after the end up to which a lift-off counts


class TooManyLandingsError(ParameterError):
    """More landings come before the end than are allowed."""


@dataclass(frozen=True)
class CoupledMotion:
    """The proved motion of a realization."""

    particles: tuple[Trajectory, ...]  # trajectory of each
    # All up to the end, in the order of time, in these units
    events: tuple[ParticleEvent, ...]
    # Precision at which every decision became certain and every ball narrow enough
    precision_bits: int


def bodies_of(
    parameters: Mapping[str, float],
    laws: Laws = CONSTANT_LAWS,
    deviates: Callable[[int], Deviates] | None = None,
) -> Bodies:
    """Base and particles of physical parameters, at the current precision."""
    p = {name: arb(value) for name, value in parameters.items()}
    rate = 2 * p["frequency"] / p["gravity"]
    mount = ExactMount(
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

        def drawn(particle: int, number: int) -> Random:
            return Random.drawn(law, p, 1 / rate, of_particle(particle).of_impact(number), True)

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
) -> CoupledMotion:
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
    times = tuple(Fraction(time) for time in launch_times)
    ordered = sorted(range(len(times)), key=times.__getitem__)

    def attempt(bits: int) -> CoupledMotion:
        with ctx.workprec(bits):
            units, bodies = _Units(parameters, digits), bodies_of(parameters, laws, deviates)
            launches = [
                Launch(units.turns(time), tuple(particles))
                for time, particles in groupby(ordered, key=times.__getitem__)
            ]
            end = units.turns(Fraction(duration))
            system = CoupledSystem(bodies, launches, end + PATIENCE)
            counted, courses, rest = _followed(system, end, len(times), max_landings)
            found = [_trajectory(units, *one, rest, bits) for one in courses]
            return CoupledMotion(tuple(found), tuple(system.events[:counted]), bits)

    return decided(attempt, max(bits, first_precision(digits)), max_bits)


class _Units:
    """Conversion of balls to physical units, and how narrow results must be."""

    def __init__(self, parameters: Mapping[str, float], digits: int) -> None:
        self._frequency = arb(parameters["frequency"])
        self._phase = arb(parameters["phase"]) / (2 * arb.pi())
        self.speed = arb(parameters["gravity"]) / (2 * self._frequency)  # unit of speeds, m s-1
        self.length = self.speed / self._frequency  # unit of heights, m
        self.limits = WidthLimits(digits, parameters)

    def turns(self, time: Fraction) -> arb:
        """Phase of the forcing at a time, whole periods included."""
        return self._frequency * exact(time) + self._phase

    def time(self, turns: arb) -> arb:
        """Time in s of a phase."""
        return (turns - self._phase) / self._frequency


# Events of a particle that are needed, and the number of those that count
_Course = tuple[list[ParticleEvent], int]


def _followed(
    system: CoupledSystem, end: arb, particles: int, max_landings: int
) -> tuple[int, list[_Course], bool]:
    """Follow a system until all flights that begin before the end have landed.

    Returns the number of events up to the end, the events of each particle, and whether particles
    that ride at the end are at rest for good.
    """
    counted, stay = 0, False
    while True:
        seen = len(system.events)
        if counted == seen:
            stay = system.riders_stay(end)
        more = system.advance()
        for event in system.events[seen:] if counted == seen else ():
            what = f"{_of(event.kind, [event.particle])} is after the end"
            counted += not certain_above(event.turns, end, what, event.number)
        if system.landings > max_landings:
            raise TooManyLandingsError(
                f"max_landings = {max_landings!r}: more come before the end; raise it "
                f"or shorten the duration"
            )
        if more and counted == len(system.events):
            continue
        own = [[e for e in system.events if e.particle == p] for p in range(particles)]
        before = [sum(e.particle == p for e in system.events[:counted]) for p in range(particles)]
        pairs = list(zip(own, before, strict=True))
        rest = stay and (system.massless or all(n and _rests(each[n - 1]) for each, n in pairs))
        latest = system.events[-1].turns if more else None
        needed = [_needed(each, n, rest, latest, end + PATIENCE) for each, n in pairs]
        if None not in needed:
            found = [(each[:last], n) for (each, n), last in zip(pairs, needed, strict=True)]
            return counted, found, rest


def _needed(
    own: list[ParticleEvent], counted: int, rest: bool, latest: arb | None, patience: arb
) -> int | None:
    """Number of events of a particle up to its first landing after the end; None if it is to come.

    A lift-off that comes too late to count is left out.  `latest` is the time of the last event of
    all particles, None if no other will come.
    """
    if counted and _rests(own[counted - 1]):
        then = own[counted].turns if counted < len(own) else latest
        if (
            rest
            or then is None
            or certain_above(then, patience, "a lift-off counts", own[-1].number)
        ):
            return counted
    return next((k + 1 for k in range(counted, len(own)) if own[k].kind is LANDING), None)


def _rests(event: ParticleEvent) -> bool:
    """Return whether the particle stays on the base after an event."""
    return event.relative is None


def _trajectory(
    units: _Units, events: list[ParticleEvent], counted: int, rest: bool, bits: int
) -> Trajectory:
    """Trajectory of a particle; if it rides at the end, it may be at `rest` for good."""
    impacts: list[ProvedImpact] = []
    for i, landed in enumerate(events[:counted]):
        if landed.kind is not LANDING:
            continue
        rested = _rests(landed)
        left, count = i + rested, nearest_integer(landed.turns)
        liftoff = speed = flight = None
        time, phase = units.time(landed.turns), landed.turns - count
        limits = units.limits
        narrow = [(time, limits.time), (phase, limits.phase)]
        if left < len(events):
            liftoff, speed = units.time(events[left].turns), units.speed * events[left].after
            flight = _flight(units, *events[left : left + 2])
            narrow += [(liftoff, limits.time), (speed, limits.velocity)]
            narrow.append((flight.duration, limits.phase))
        limits.require(landed.number, *narrow)
        arrival = landed.base_before - landed.before
        impacts.append(ProvedImpact(time, liftoff, speed, rested, count, phase, flight, arrival))
    at_rest = rest and counted > 0 and _rests(events[counted - 1])
    launch = _flight(units, *events[:2])
    return Trajectory(launch, tuple(impacts), at_rest, Status.COMPLETED, bits)


def _flight(units: _Units, event: ParticleEvent, landed: ParticleEvent) -> ProvedFlight:
    """Flight that an event begins, and the next one ends."""
    if landed.turns is event.turns:  # a launch that is slower than the base
        return ProvedFlight(event.relative, units.length * event.height, ZERO, None)
    rising = event.after.max(ZERO)
    top = event.height + rising * rising / 4
    return ProvedFlight(event.relative, units.length * top, landed.turns - event.turns, None)
