"""The base of finite mass on its mount, between events, in ball arithmetic.

Phase x is in turns, time in forcing periods, speeds in g / 2 f; so heights are in g / 2 f^2, and
gravity is 2.  Without particles the base moves as Yf = alpha W(x), a sum of harmonics
(`vibrosweep.proof.reference.laws`).  While n particles ride it, the deviation D = Y - Yf obeys,
with the load l = n mu and nu = f0 / f of the mount,

    (1 + l) D'' + 2 zeta w0 D' + w0^2 D = -l (Yf'' + 2),        w0 = 2 pi nu

D is the sum of a constant, forced oscillations and a free one, h.  As h'' + 2 Z h' + Q h = 0 with
Z = zeta w0 / (1 + l) and Q = w0^2 / (1 + l), and all derivatives of h obey the same equation,
(h^(k+1))^2 + Q (h^(k))^2 never grows: this bounds all of them from any instant on.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final, NamedTuple

from vibrosweep.model.shapes import PARABOLIC_NAME, SINE, Waveform
from vibrosweep.proof.reference.arithmetic import UncertainError, arb, nearest_integer
from vibrosweep.proof.reference.laws import Wave, wave_of
from vibrosweep.proof.reference.motion import SHORTENING, Course

ZERO, HALF = arb(0), arb(0.5)


class Mount(NamedTuple):
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

    def __init__(self, mount: Mount, x: arb, load: arb, impact: int) -> None:
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


class Stretch:
    """Parabolic motion under a load, from a phase in turns on until the next corner.

    Its acceleration is constant, 4 alpha on the side 1 around phase 0 and -4 alpha on the side -1,
    and so is the forced part of D.
    """

    def __init__(self, mount: Mount, x: arb, load: arb, side: int) -> None:
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
    mount: Mount, load: arb, turn: arb, bare: tuple[arb, arb], impact: int
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
        Side of the drive if its waveform has corners (`Stretch`); the arc ends at the next corner.

    Raises
    ------
    UncertainError
        More precision is needed to decide the kind of its motion.
    """

    def __init__(
        self,
        mount: Mount,
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
        self._drive: Tones | Stretch = (
            Stretch(mount, x, load, side) if mount.has_corners else Tones(mount, x, load, impact)
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
        """As `vibrosweep.proof.reference.motion.Course.curvature`."""
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


class Pressure(Course):
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
