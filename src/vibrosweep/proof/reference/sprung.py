"""Particles on a base of finite mass, event by event, in ball arithmetic.

Phase x is in turns, time in forcing periods, speeds in g / 2 f; so heights are in g / 2 f^2, and
gravity is 2.  Without particles the base moves as Yf = alpha W(x), a sum of harmonics
(`vibrosweep.proof.reference.laws`).  While n particles ride it, the deviation D = Y - Yf obeys,
with the load l = n mu and nu = f0 / f of the mount,

    (1 + l) D'' + 2 zeta w0 D' + w0^2 D = -l (Yf'' + 2),        w0 = 2 pi nu

D is the sum of a constant, forced oscillations and a free one, h.  As h'' + 2 Z h' + Q h = 0 with
Z = zeta w0 / (1 + l) and Q = w0^2 / (1 + l), and all derivatives of h obey the same equation,
(h^(k+1))^2 + Q (h^(k))^2 never grows: this bounds all of them from any instant on.

A particle of velocity v lands on a base of velocity V on which n particles ride, with the approach
speed c = V - v.  mu is the mass ratio:

* It sticks if e c <= r and the base then presses it: V and v become
  ((1 + n mu) V + mu v) / (1 + (n + 1) mu).
* Else v rises by (1 + e) c / (1 + mu), and V falls by w = mu (1 + e) c / (1 + mu).  The riders keep
  their velocity and so leave with the relative speed w, if w > r.
* Else base and riders take the impact as one body: mu / (1 + n mu) replaces mu.

The base presses its riders while it would not, alone, fall faster than gravity:
Yf'' - 2 zeta w0 D' - w0^2 D > -2.  When that ends, all riders leave with its velocity.  Particles
in the same state land in the order of their numbers; those that the recoiling base no longer
approaches fly on.

The next event is proved to be the next: the first landing of every flight is enclosed, or proved to
be later, and two enclosures that overlap require more precision.  Balls are carried from event to
event as they are, so the precision needed grows with the number of landings of a particle.

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
from functools import cache, cached_property, partial
from itertools import groupby
from typing import Final, NamedTuple

from vibrosweep.errors import ParameterError
from vibrosweep.model.measures import Status
from vibrosweep.model.shapes import PARABOLIC_NAME, SINE, Waveform
from vibrosweep.proof.reference.arithmetic import (
    FRAME_BITS,
    UncertainError,
    WidthLimits,
    arb,
    certain_above,
    ctx,
    decided,
    exact,
    first_precision,
    nearest_integer,
)
from vibrosweep.proof.reference.laws import Laws, Random, Restitution, Wave, wave_of
from vibrosweep.proof.reference.motion import (
    END,
    SHORTENING,
    Deviates,
    ProvedCourse,
    ProvedFlight,
    ProvedImpact,
    Trajectory,
    first_root,
    narrowed,
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
    def wave(self) -> Wave:
        """Shape of the motion of the base without particles."""
        return wave_of(self.waveform)


class _Tone(NamedTuple):
    """Coefficients of the cosine and the sine of a harmonic, in the time since an arc began."""

    number: int
    # forced, answered: of the height of the base, and of its deviation D
    forced: tuple[arb, arb]
    answered: tuple[arb, arb]


class Tones:
    """Forced oscillations under a load, from a phase in turns on.

    Raises an UncertainError, about the next landing, at a resonance without damping.
    """

    def __init__(self, mount: ExactMount, x: arb, load: arb, impact: int) -> None:
        self._tones = []
        numbers = [h for h, _, _ in mount.waveform.tones] or [1]
        for number, (u, v) in zip(numbers, mount.wave.at_liftoff(2 * x), strict=True):
            turn = _turn(number)
            bare = -mount.alpha * v / turn, mount.alpha * u / turn
            c, d = _answer(mount, load, turn, bare, impact)
            self._tones.append(_Tone(number, (bare[0] + c, bare[1] + d), (c, d)))
        self._last: tuple[arb, list[tuple[arb, arb]]] | None = None

    def _at(self, s: arb) -> list[tuple[arb, arb]]:
        """Sine and cosine of each oscillation after s periods; the last ones are kept."""
        if self._last is None or self._last[0] is not s:
            self._last = s, [(2 * tone.number * s).sin_cos_pi() for tone in self._tones]
        return self._last[1]

    def derivative(self, order: int, s: arb) -> arb:
        """Height after s periods (0), its velocity (1), acceleration (2), ..."""
        total = ZERO
        for (h, (c, d), _), (sine, cosine) in zip(self._tones, self._at(s), strict=True):
            forced = d * cosine - c * sine if order % 2 else c * cosine + d * sine
            total += forced * _turn(h) ** order * (-1) ** (order // 2)
        return total

    def since(self, s: arb) -> tuple[arb, arb]:
        """Change of the height beyond uniform motion, and of the velocity, in s periods."""
        far = fast = ZERO
        for (h, (c, d), _), (sine, cosine) in zip(self._tones, self._at(s), strict=True):
            far += c * (cosine - 1) + d * (sine - _turn(h) * s)
            fast += _turn(h) * (d * (cosine - 1) - c * sine)
        return far, fast

    def answer(self, s: arb) -> tuple[arb, arb]:
        """Forced part of D and of D' after s periods."""
        height = rate = ZERO
        for (h, _, (c, d)), (sine, cosine) in zip(self._tones, self._at(s), strict=True):
            height += c * cosine + d * sine
            rate += _turn(h) * (d * cosine - c * sine)
        return height, rate

    def most(self, order: int) -> arb:
        """Bound on the modulus of a derivative."""
        total = ZERO
        for turn, size in self._sizes:
            total += size * turn**order
        return total

    @cached_property
    def _sizes(self) -> list[tuple[arb, arb]]:
        return [
            (_turn(tone.number), (tone.forced[0] ** 2 + tone.forced[1] ** 2).upper().sqrt())
            for tone in self._tones
        ]


class ParabolicDrive:
    """Parabolic motion under a load, from a phase in turns on until the next corner.

    Its acceleration is constant, 4 alpha on the side 1 around phase 0 and -4 alpha on the side -1,
    and so is the forced part of D.
    """

    def __init__(self, mount: ExactMount, x: arb, load: arb, side: int) -> None:
        middle = nearest_integer(x) if side > 0 else nearest_integer(x - HALF) + HALF
        self._y, self._pull = x - middle, 4 * side * mount.alpha
        self._top = mount.alpha / 8
        self._sag = -load * self._pull / (mount.natural * mount.natural)

    def derivative(self, order: int, s: arb) -> arb:
        """As in `Tones`."""
        y = self._y + s
        if order == 0:
            top = self._top if self._pull > 0 else -self._top
            return self._pull / 2 * y * y - top + self._sag
        return self._pull * y if order == 1 else self._pull if order == 2 else ZERO

    def since(self, s: arb) -> tuple[arb, arb]:
        """As in `Tones`."""
        return self._pull / 2 * s * s, self._pull * s

    def answer(self, s: arb) -> tuple[arb, arb]:
        """As in `Tones`."""
        return self._sag, ZERO

    def most(self, order: int) -> arb:
        """As in `Tones`, until the next corner."""
        sizes = (self._top + abs(self._sag), abs(self._pull) / 4, abs(self._pull))
        return sizes[order] if order < len(sizes) else ZERO


def _turn(number: int) -> arb:
    """Angular frequency of a harmonic, per forcing period."""
    return 2 * arb.pi() * number


def _answer(
    mount: ExactMount, load: arb, turn: arb, bare: tuple[arb, arb], impact: int
) -> tuple[arb, arb]:
    """Forced part of D under a load: coefficients, from those of the bare base."""
    if load.is_zero():
        return ZERO, ZERO
    stiff = mount.natural * mount.natural - (1 + load) * turn * turn
    drag = 2 * mount.damping * mount.natural * turn
    size = stiff * stiff + drag * drag
    if not size > 0:
        raise UncertainError("whether the loaded base is driven at its resonance", impact)
    push = load * turn * turn / size
    c, d = bare
    return push * (c * stiff - d * drag), push * (d * stiff + c * drag)


# Number of derivatives of the height of the base that are needed.
ORDERS: Final = 7


class Arc:
    """Motion of the base from an instant on, until an event changes it.

    Attributes
    ----------
    level
        Mean height.

    Parameters
    ----------
    mount
        The base.
    x
        Phase at the instant, turns.
    state
        D and D', `after` periods later.
    riders
        Number n of particles that ride.
    after
        Time between the instant and that state, which may be negative.
    impact
        Number of the next landing, for an error.
    side
        Side of the drive if its waveform has corners (`ParabolicDrive`); the arc ends at the next
        corner.

    Raises
    ------
    UncertainError
        More precision is needed to decide the kind of its motion.
    """

    def __init__(
        self,
        mount: ExactMount,
        x: arb,
        state: tuple[arb, arb],
        riders: int,
        after: arb,
        impact: int,
        side: int = 1,
    ) -> None:
        load = riders * mount.mass_ratio
        mass, square = 1 + load, mount.natural * mount.natural
        self._z, self._q = mount.damping * mount.natural / mass, square / mass
        excess = mount.damping * mount.damping - mass  # its sign is that of Z^2 - Q
        if not (excess > 0 or excess < 0 or excess.is_zero()):
            raise UncertainError("whether the free base oscillates", impact)
        self._excess = ZERO if excess.is_zero() else self._z * self._z - self._q
        self.level = -2 * load / square
        self._drive: Tones | ParabolicDrive = (
            ParabolicDrive(mount, x, load, side)
            if mount.has_corners
            else Tones(mount, x, load, impact)
        )
        answered, rate = self._drive.answer(after)
        self._free = self._carried(state[0] - self.level - answered, state[1] - rate, -after)
        self._last: tuple[arb, tuple[arb, arb, arb]] | None = None

    def _carried(self, h: arb, v: arb, s: arb) -> tuple[arb, arb]:
        """Values of h and h' after s periods."""
        if h.is_zero() and v.is_zero():
            return h, v
        keeps, drifts, brakes = self._waves(s)
        return h * keeps + v * drifts, v * brakes - h * self._q * drifts

    def _waves(self, s: arb) -> tuple[arb, arb, arb]:
        """Free motion over s periods: factors of h and h' in h(s), and of h' in h'(s).

        They are C + Z S, S and C - Z S with C = exp(-Z s) cosh(k s), S = exp(-Z s) sinh(k s) / k
        and k^2 = Z^2 - Q, of either sign.
        """
        z = self._z
        if self._excess > 0:
            root = self._excess.sqrt()
            slow, fast = ((root - z) * s).exp(), (-(root + z) * s).exp()
            even, odd = (slow + fast) / 2, (slow - fast) / (2 * root)
        else:
            even = (-z * s).exp()
            odd = even * s
            if self._excess < 0:
                root = (-self._excess).sqrt()
                sine, cosine = (root * s).sin_cos()
                even, odd = even * cosine, even * sine / root
        return even + z * odd, odd, even - z * odd

    def _at(self, s: arb) -> tuple[arb, arb, arb]:
        """Return `_waves`; the last ones are kept."""
        if self._last is None or self._last[0] is not s:
            self._last = s, self._waves(s)
        return self._last[1]

    def _free_at(self, s: arb) -> list[arb]:
        """Values of h and its derivatives after s periods."""
        keeps, drifts, brakes = self._at(s)
        h, v = self._free
        free = [h * keeps + v * drifts, v * brakes - h * self._q * drifts]
        while len(free) < ORDERS:
            free.append(-2 * self._z * free[-1] - self._q * free[-2])
        return free

    def derivative(self, order: int, s: arb) -> arb:
        """Height of the base after s periods (0), its velocity (1), acceleration (2), ..."""
        forced = self._drive.derivative(order, s)
        return forced + self._free_at(s)[order] + (ZERO if order else self.level)

    def since(self, s: arb) -> tuple[arb, arb]:
        """Y(s) - Y(0) - Y'(0) s and Y'(s) - Y'(0), without the uncertainty of Y(0) and Y'(0)."""
        keeps, drifts, brakes = self._at(s)
        (far, fast), (h, v) = self._drive.since(s), self._free
        far += h * (keeps - 1) + v * (drifts - s)
        return far, fast + v * (brakes - 1) - h * self._q * drifts

    def deviation(self, s: arb) -> tuple[arb, arb]:
        """D and D' after s periods."""
        (height, rate), (h, v, *_) = self._drive.answer(s), self._free_at(s)
        return self.level + height + h, rate + v

    def most(self, order: int, s: arb) -> arb:
        """Bound on the modulus of a derivative from s on; for order 0, of height minus mean."""
        free, low = self._free_at(s), max(order - 1, 0)
        energy = free[low + 1] * free[low + 1] + self._q * free[low] * free[low]
        decaying = (energy if order else energy / self._q).upper().sqrt()
        return (self._drive.most(order) + decaying).upper()


class Above:
    """Height of a ballistic particle above the base.

    Parameters
    ----------
    arc
        Motion of the base.
    gap, speed
        Height and speed relative to the base at the beginning of the arc.
    """

    def __init__(self, arc: Arc, gap: arb, speed: arb) -> None:
        self._arc, self._gap, self._speed = arc, gap, speed

    def height(self, s: arb) -> arb:
        """Height above the base."""
        return self._gap + s * (self._speed - s) - self._arc.since(s)[0]

    def slope(self, s: arb) -> arb:
        """Speed relative to the base."""
        return self._speed - 2 * s - self._arc.since(s)[1]

    def curvature(self, s: arb) -> tuple[arb, arb, arb, arb]:
        """As `vibrosweep.proof.reference.motion.ProvedCourse.curvature`."""
        arc = self._arc
        return (
            2 + arc.derivative(2, s),
            arc.derivative(3, s),
            arc.most(4, s),
            2 + arc.most(2, s),
        )

    def above_all(self) -> tuple[arb, arb] | None:
        """Interval of time in which the particle is above every height of the base."""
        arc = self._arc
        y, v = arc.derivative(0, ZERO) + self._gap, arc.derivative(1, ZERO) + self._speed
        root = v * v + 4 * (y - arc.level - arc.most(0, ZERO))
        if not root > 0:
            return None
        return ((v - root.sqrt()) / 2).upper(), ((v + SHORTENING * root.sqrt()) / 2).lower()


def contact_free(arc: Arc, now: arb, speed: arb, *, lifted: bool, impact: int) -> arb:
    """Time until which a particle that leaves the base `now` has not landed.

    Its speed is relative to the base; `lifted` is True if the base pressed it until it left.
    Raises an UncertainError, about the next impact, where more precision is needed.
    """
    until = ZERO
    if speed > 0:
        until = speed / (2 + arc.most(2, now))
    elif lifted:  # the base falls ever faster for a while
        until = -arc.derivative(3, now) / arc.most(4, now)
    elif speed.is_zero():
        least = arc.most(3, now)
        falls = -(2 + arc.derivative(2, now))
        until = falls / least if least > 0 else (arb(1) if falls > 0 else ZERO)
    if not until > 0:
        raise UncertainError("whether a particle leaves the base", impact)
    return until.lower()


class Pressure(ProvedCourse):
    """Acceleration of the base relative to free fall: while positive, riders are pressed."""

    def __init__(self, arc: Arc) -> None:
        self._arc = arc

    def height(self, s: arb) -> arb:
        """Y'' + 2."""
        return 2 + self._arc.derivative(2, s)

    def slope(self, s: arb) -> arb:
        """Rate of Y''."""
        return self._arc.derivative(3, s)

    def curvature(self, s: arb) -> tuple[arb, arb, arb, arb]:
        """As `Above.curvature`."""
        arc = self._arc
        return -arc.derivative(4, s), -arc.derivative(5, s), arc.most(6, s), arc.most(4, s)

    def lasts(self, s: arb) -> bool:
        """Return whether it is proved to stay positive from then on."""
        return bool(2 - self._arc.most(2, s) > 0)


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
    # gap, speed: height and speed relative to the base
    gap: arb
    speed: arb
    lifted: bool = False  # True if the base pressed them until they left
    # Time before which they cannot land; None where that is the time of the last event
    clear: arb | None = None


class Launch(NamedTuple):
    """Particles that are launched at one instant, in the order of their numbers."""

    turns: arb
    particles: tuple[int, ...]


class Corner(NamedTuple):
    """A corner of the velocity of the drive."""

    turns: arb


class Riders(NamedTuple):
    """Particles that ride the base and may leave it."""

    particles: tuple[int, ...]


class Next(NamedTuple):
    """An event that may be the next one, `s` periods after the present instant.

    The function `course` has its first root at that time; None where the time is known.
    """

    s: arb
    what: Launch | Corner | Flying | Riders
    course: ProvedCourse | None = None

    def narrowed(self) -> Next:
        """Return the event with its time as narrow as the precision allows."""
        if self.course is None:
            return self
        return self._replace(s=narrowed(self.course, self.s))

    def __str__(self) -> str:
        if isinstance(self.what, Corner):
            return "a corner of the drive"
        does = {Launch: "launch", Flying: "landing", Riders: "lift-off"}[type(self.what)]
        numbers = " and ".join(map(str, self.what.particles))
        return f"the {does} of particle {numbers}"


def latest_start(found: Sequence[Next]) -> arb:
    """Time after which an event cannot be the next one."""
    return min((one.s.upper() for one in found), default=END)


# Periods for which a lift-off is looked for at a time.
STRETCH: Final = arb(16)


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
        self._instant, self._late = self._waiting[0].turns.mid(), ZERO
        self._side = self._first_side()
        self._deviation, self._rate = deviation, rate
        self._arc = self._motion()

    def _motion(self) -> Arc:
        """Motion of the base from its present state on."""
        state = (self._deviation, self._rate), len(self._riders), self._late
        return Arc(self._bodies.mount, self._instant, *state, self.landings + 1, self._side)

    def _first_side(self) -> int:
        """Side of the drive at the first launch; 1 without corners."""
        if not self._bodies.mount.has_corners:
            return 1
        rises = self._bodies.mount.wave.slope(2 * self._instant)
        return 1 if certain_above(rises, ZERO, "the side of the first launch", 0) else -1

    def _corner(self) -> list[Next]:
        """Next corner of the drive; none without corners, or if nothing more can happen."""
        if not self._bodies.mount.has_corners:
            return []
        offset = arb(0.25) if self._side > 0 else arb(0.75)
        turns = offset + nearest_integer(self._instant + arb(0.5) - offset)
        over = not (self._flying or self._waiting) and turns > self._end
        return [] if over else [Next(turns - self._instant, Corner(turns))]

    def riders_stay(self, turns: arb) -> bool:
        """Return whether no rider can leave from a phase on, if nothing lands until then."""
        mount = self._bodies.mount
        if mount.has_corners and self._riders and not mount.mass_ratio.is_zero():
            return False  # the corners keep exciting a base under a load
        return Pressure(self._arc).lasts(turns - self._instant)

    def advance(self) -> bool:
        """Carry out the next event; False if there is none.

        Raises an UncertainError where more precision is needed to find it, or to decide what
        happens.
        """
        first = self._next()
        if first is None:
            return False
        arrival = self._go_to(first)
        if isinstance(first.what, Launch):
            self._waiting.pop(0)
            self._launch(first.what.particles)
        elif isinstance(first.what, Corner):
            self._turn()
        elif isinstance(first.what, Riders):
            self._leave(ZERO, lifted=True)
        else:
            self._land(first.what.particles, arrival)
        self._settle()
        return True

    def _next(self) -> Next | None:
        """Return the first of all events that may come."""
        found = self._corner()
        if self._waiting:
            found.append(Next(self._waiting[0].turns - self._instant, self._waiting[0]))
        for flying in self._flying:
            above = Above(self._arc, flying.gap, flying.speed)
            start = self._late.lower() if flying.clear is None else flying.clear
            found += self._root(above, start, latest_start(found), flying)
        if self._riders:
            last = latest_start(found) if found else (self._end - self._instant).upper()
            found += self._liftoff(last)
        # few bits are enough to separate most of them
        least, number = latest_start(found), self.landings + 1
        found = [one if one.s > least else one.narrowed() for one in found]
        if not found:
            return None
        first = min(found, key=lambda one: one.s.mid())
        for other in found:
            if first is not other and not first.s < other.s:
                raise UncertainError(f"whether {first} precedes {other}", number)
        if self.events and not first.s > self._late:
            raise UncertainError(f"whether {first} follows the last event", number)
        return first

    def _root(
        self, course: ProvedCourse, start: arb, until: arb, what: Flying | Riders
    ) -> list[Next]:
        """First root, where it comes before `until`; few bits are enough in most cases."""
        try:
            with ctx.workprec(FRAME_BITS):
                s = first_root(course, start, self.landings + 1, until)
        except UncertainError:
            s = first_root(course, start, self.landings + 1, until)
        return [Next(s, what, course)] if s.is_finite() else []

    def _liftoff(self, until: arb) -> list[Next]:
        """Find the instant at which the base falls away from its riders, if before `until`."""
        pressure, start = Pressure(self._arc), self._late.lower()
        while start < until and not pressure.lasts(start):
            stretch = (start + STRETCH).lower().min(until)
            found = self._root(pressure, start, stretch, Riders(tuple(self._riders)))
            if found:
                return found
            start = stretch
        return []

    def _go_to(self, event: Next) -> arb:
        """Carry base and flights to an event; return the speed at which its particles land."""
        arc, s = self._arc, event.s
        what = event.what
        turns = what.turns if isinstance(what, Launch | Corner) else self._instant + s
        instant = turns.mid()
        passed = self._passed = instant - self._instant
        self._instant, self._late, self._recoiled = instant, turns - instant, ZERO
        arrival = ZERO
        if isinstance(event.what, Flying):
            self._flying.remove(event.what)
            arrival = event.what.speed - 2 * s - arc.since(s)[1]
        for flying in self._flying:
            far, fast = arc.since(passed)
            flying.gap += passed * (flying.speed - passed) - far
            flying.speed -= 2 * passed + fast
            flying.clear = None
        self._deviation, self._rate = arc.deviation(s)
        alpha, wave, h = self._bodies.mount.alpha, self._bodies.mount.wave, 2 * turns
        self._turns, self._height = turns, self._deviation + alpha * wave.level(h)
        slope = arb(4 * self._side) if self._bodies.mount.has_corners else wave.slope(h)
        self._own_velocity, self._own_press = alpha * wave.velocity(h), 2 + alpha * slope
        return arrival

    def _turn(self) -> None:
        """Pass a corner, where the base may begin to fall faster than gravity at once."""
        self._side = -self._side
        self._own_press = 2 + 4 * self._side * self._bodies.mount.alpha
        if self._riders and not self._presses(self._rate):
            self._leave(ZERO, lifted=False)

    def _presses(self, rate: arb) -> bool:
        """Decide whether the base presses a particle when its deviation has this rate."""
        mount = self._bodies.mount
        pull = mount.natural * (2 * mount.damping * rate + mount.natural * self._deviation)
        what = "the base presses a particle"
        return certain_above(self._own_press - pull, ZERO, what, self.landings)

    def _settle(self) -> None:
        """Continue the base and the flights after the event from the exact instant next to it."""
        late, around = self._late, ZERO.union(self._late)
        before, self._arc = self._arc.derivative(2, self._passed + around), self._motion()
        after = self._arc.derivative(2, around)
        for flying in self._flying:
            flying.gap -= late * (self._recoiled + late / 2 * (after - before))
            flying.speed += self._recoiled + late * (after - before)
        for flying in self._leaving:
            speed, lifted = flying.speed, flying.lifted
            clear = contact_free(self._arc, late, speed, lifted=lifted, impact=self.landings + 1)
            flying.clear = (late + clear).lower()
            flying.gap = -late * (speed + late / 2 * (2 + after))
            flying.speed = speed + late * (2 + after)
        self._flying += self._leaving
        self._leaving = []

    @property
    def _velocity(self) -> arb:
        """Velocity of the base at the event."""
        return self._own_velocity + self._rate

    def _recoil(self, velocity: arb) -> None:
        """Reduce the velocity of the base."""
        self._rate -= velocity
        self._recoiled += velocity
        for flying in self._leaving:
            flying.speed += velocity

    def _launch(self, particles: Sequence[int]) -> None:
        """Launch particles; those slower than the base land at once."""
        flying = []
        for particle in particles:
            speed = self._bodies.u0 - self._velocity
            self._note(LAUNCH, particle, self._bodies.u0, speed)
            what = "a launch is faster than the base"
            if certain_above(speed, ZERO, what, self.landings + 1):
                flying.append(particle)
            else:
                self._impact([particle], speed)
        if flying:
            speed = self._bodies.u0 - self._velocity
            self._leaving.append(Flying(tuple(flying), ZERO, speed))

    def _leave(self, speed: arb, *, lifted: bool) -> None:
        """Let all riders leave, with a speed relative to the base."""
        riders, self._riders = tuple(sorted(self._riders)), []
        self._leaving.append(Flying(riders, ZERO, speed, lifted))
        for particle in riders:
            self._note(LIFTOFF, particle, self._velocity + speed, speed)

    def _land(self, particles: Sequence[int], speed: arb) -> None:
        """Let particles in one state land in order, or as one if massless and without noise."""
        if self._bodies.mount.mass_ratio.is_zero() and self._bodies.drawn is None:
            self._impact(particles, speed)
            return
        recoiled = self._recoiled
        for place, particle in enumerate(particles):
            now = speed + self._recoiled - recoiled
            what = "the base still approaches a particle that lands with another"
            if place and not certain_above(-now, ZERO, what, self.landings + 1):
                self._leaving.append(Flying((particle,), ZERO, now))
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
        self._leaving.append(Flying(tuple(particles), ZERO, w))

    def _law(self, particles: Sequence[int]) -> Restitution:
        """Law of restitution of the next impact of a particle, or of all that land as one."""
        if self._bodies.drawn is None:
            return self._bodies.restitution
        (particle,) = particles
        self._drawn[particle] += 1
        return self._bodies.drawn(particle, self._drawn[particle] - 1)

    def _sticks(self, c: arb, w: arb) -> bool:
        """Decide if a particle that approaches with speed c, and would leave with w, sticks."""
        mount, r, riding = self._bodies.mount, self._bodies.r, len(self._riders)
        if certain_above(w, r, "e c > r", self.landings):
            return False
        if riding:  # the base presses the riders, and even more after the impact
            return True
        return self._presses(self._rate - mount.mass_ratio * c / (1 + mount.mass_ratio))

    def _note(
        self, kind: str, particle: int, before: arb, relative: arb | None, base: arb | None = None
    ) -> None:
        now = self._velocity
        after = now if relative is None else now + relative
        moves = before, after, now if base is None else base, now, relative
        state = self.landings, len(self._riders), self._deviation, self._rate
        self.events.append(ParticleEvent(kind, particle, self._turns, self._height, *moves, *state))


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


@dataclass(frozen=True)
class _CoupledProblem:
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

    def require_narrow(self, impact: ProvedImpact, number: int) -> None:
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
        size = p.get("restitution_noise", ZERO)
        size += p.get("restitution_noise_relative", ZERO) * p["restitution"]
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
    values = {name: float(value) for name, value in parameters.items()}
    launched = tuple(Fraction(time) for time in launch_times)
    problem = _CoupledProblem(
        values, launched, Fraction(duration), laws, max_landings, digits, deviates
    )
    first = max(bits, first_precision(digits))
    return decided(partial(_attempt, problem), first, max_bits)


class _Course:
    """Events of one particle: `counted` of them up to the end of the observation, then later ones.

    A lift-off that no longer counts is left out, with all later events.
    """

    def __init__(self) -> None:
        self.events: list[ParticleEvent] = []
        self.counted = 0
        self.complete = False  # True once no later event is needed

    def add(self, event: ParticleEvent, after: bool, late: bool) -> None:
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

    def trajectory(self, problem: _CoupledProblem, rest: bool, bits: int) -> Trajectory:
        """Return the trajectory; a particle that rides at the end may be at `rest` for good."""
        impacts: list[ProvedImpact] = []
        for i, landed in enumerate(self.events[: self.counted]):
            if landed.kind is not LANDING:
                continue
            rested = _rests(landed)
            left, count = i + rested, nearest_integer(landed.turns)
            leaves = left < len(self.events)
            impacts.append(
                ProvedImpact(
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

    def _flight(self, problem: _CoupledProblem, left: int) -> ProvedFlight:
        """Flight that an event begins, and the next one ends."""
        event, landed = self.events[left : left + 2]
        if landed.turns is event.turns:  # a launch that is slower than the base
            return ProvedFlight(event.relative, problem.length * event.height, ZERO, None)
        rising = event.after.max(ZERO)
        top = event.height + rising * rising / 4
        return ProvedFlight(event.relative, problem.length * top, landed.turns - event.turns, None)


def _rests(event: ParticleEvent) -> bool:
    """Return whether the particle stays on the base after an event."""
    return event.relative is None


def _attempt(problem: _CoupledProblem, bits: int) -> CoupledMotion:
    """Return the motion at one precision, or raise `UncertainError`."""
    with ctx.workprec(bits):
        bodies = bodies_of(problem.parameters, problem.laws, problem.deviates)
        end = problem.turns(problem.duration)
        system, counted, seen = CoupledSystem(bodies, problem.launches, end + PATIENCE), 0, 0
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
        return CoupledMotion(particles, tuple(system.events[:counted]), bits)
