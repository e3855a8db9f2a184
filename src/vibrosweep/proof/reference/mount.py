"""The base of finite mass on its mount, between events, in ball arithmetic.

Phase x in turns, time in forcing periods, speeds in g / 2 f: heights are in g / 2 f^2, and gravity
is 2.  Without particles the base moves as Yf = -(alpha / 2 pi) cos 2 pi x.  While n particles ride
it, the deviation D = Y - Yf obeys, with the load l = n mu and nu = f0 / f of the mount,

    (1 + l) D'' + 2 zeta w0 D' + w0^2 D = -l (Yf'' + 2),        w0 = 2 pi nu

D is a constant, a forced oscillation and a free one, h.  As h'' + 2 Z h' + Q h = 0 with
Z = zeta w0 / (1 + l) and Q = w0^2 / (1 + l), and all derivatives of h obey the same equation,
(h^(k+1))^2 + Q (h^(k))^2 never grows: this bounds all of them from any instant on.
"""

from __future__ import annotations

from functools import cached_property
from typing import Final, NamedTuple

from vibrosweep.proof.reference._flint import arb
from vibrosweep.proof.reference.decisions import UncertainError
from vibrosweep.proof.reference.landing import SHY

ZERO = arb(0)
# Number of derivatives of the height of the base that are needed.
ORDERS: Final = 7


class Mount(NamedTuple):
    """A base and its mount."""

    alpha: arb  # largest velocity of the base without particles
    natural: arb  # w0, angle per forcing period
    damping: arb  # zeta
    mass_ratio: arb  # mu, of one particle and the base

    def velocity(self, x: arb) -> arb:
        """Velocity of the base without particles."""
        return self.alpha * (2 * x).sin_pi()


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
        Number of the next landing, for the error.

    Raises
    ------
    UncertainError
        More precision is needed to know the kind of its motion.
    """

    def __init__(
        self, mount: Mount, x: arb, state: tuple[arb, arb], riders: int, after: arb, impact: int
    ) -> None:
        load = riders * mount.mass_ratio
        mass, square = 1 + load, mount.natural * mount.natural
        self._omega = 2 * arb.pi()
        self._z, self._q = mount.damping * mount.natural / mass, square / mass
        excess = mount.damping * mount.damping - mass  # its sign is that of Z^2 - Q
        if not (excess > 0 or excess < 0 or excess.is_zero()):
            raise UncertainError("whether the free base oscillates", impact)
        self._excess = ZERO if excess.is_zero() else self._z * self._z - self._q
        self.level = -2 * load / square
        sine, cosine = (2 * x).sin_cos_pi()
        bare = -mount.alpha / self._omega  # without particles
        by_cos, by_sin = self._answer(mount, load, impact)
        # coefficients of the cosine and the sine of the time that has passed
        self._answered = by_cos * cosine + by_sin * sine, by_sin * cosine - by_cos * sine
        self._forced = bare * cosine + self._answered[0], -bare * sine + self._answered[1]
        sine, cosine = (2 * after).sin_cos_pi()
        c, d = self._answered
        h = state[0] - self.level - c * cosine - d * sine
        v = state[1] - self._omega * (d * cosine - c * sine)
        self._free = self._carried(h, v, -after)
        self._last: tuple[arb, tuple[arb, arb, arb, arb, arb]] | None = None

    def _answer(self, mount: Mount, load: arb, impact: int) -> tuple[arb, arb]:
        """Forced part of D: coefficients of the cosine and the sine of the phase."""
        if load.is_zero():
            return ZERO, ZERO
        stiff = mount.natural * mount.natural - (1 + load) * self._omega * self._omega
        drag = 2 * mount.damping * mount.natural * self._omega
        size = stiff * stiff + drag * drag
        if not size > 0:
            raise UncertainError("whether the loaded base is driven at its resonance", impact)
        push = -load * self._omega * mount.alpha / size
        return push * stiff, push * drag

    def _carried(self, h: arb, v: arb, s: arb) -> tuple[arb, arb]:
        """Values of h and h' after s periods."""
        if h.is_zero() and v.is_zero():
            return h, v
        keeps, drifts, brakes = self._waves(s)
        return h * keeps + v * drifts, v * brakes - h * self._q * drifts

    def _waves(self, s: arb) -> tuple[arb, arb, arb]:
        """Free motion in s periods: h = 1 and h' = 1 to h, and h' = 1 to h'.

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

    def _at(self, s: arb) -> tuple[arb, arb, arb, arb, arb]:
        """Cosine and sine of the time s, and `_waves`; the last ones are kept."""
        if self._last is None or self._last[0] is not s:
            sine, cosine = (2 * s).sin_cos_pi()
            self._last = s, (cosine, sine, *self._waves(s))
        return self._last[1]

    def _free_at(self, s: arb) -> list[arb]:
        """Values of h and its derivatives after s periods."""
        _, _, keeps, drifts, brakes = self._at(s)
        h, v = self._free
        free = [h * keeps + v * drifts, v * brakes - h * self._q * drifts]
        while len(free) < ORDERS:
            free.append(-2 * self._z * free[-1] - self._q * free[-2])
        return free

    def derivative(self, order: int, s: arb) -> arb:
        """Height of the base after s periods (0), its velocity (1), acceleration (2), ..."""
        cosine, sine, *_ = self._at(s)
        c, d = self._forced
        forced = d * cosine - c * sine if order % 2 else c * cosine + d * sine
        forced *= self._omega**order * (-1) ** (order // 2)
        return forced + self._free_at(s)[order] + (ZERO if order else self.level)

    def since(self, s: arb) -> tuple[arb, arb]:
        """Y(s) - Y(0) - Y'(0) s and Y'(s) - Y'(0), without the uncertainty of Y(0) and Y'(0)."""
        cosine, sine, keeps, drifts, brakes = self._at(s)
        (c, d), (h, v) = self._forced, self._free
        far = c * (cosine - 1) + d * (sine - self._omega * s)
        fast = self._omega * (d * (cosine - 1) - c * sine)
        far += h * (keeps - 1) + v * (drifts - s)
        return far, fast + v * (brakes - 1) - h * self._q * drifts

    def deviation(self, s: arb) -> tuple[arb, arb]:
        """D and D' after s periods."""
        cosine, sine, *_ = self._at(s)
        (c, d), (h, v, *_) = self._answered, self._free_at(s)
        return self.level + c * cosine + d * sine + h, self._omega * (d * cosine - c * sine) + v

    def most(self, order: int, s: arb) -> arb:
        """Bound of the modulus of a derivative, from s on; of the height, from its mean."""
        free, low = self._free_at(s), max(order - 1, 0)
        energy = free[low + 1] * free[low + 1] + self._q * free[low] * free[low]
        decaying = (energy if order else energy / self._q).upper().sqrt()
        return (self._size * self._omega**order + decaying).upper()

    @cached_property
    def _size(self) -> arb:
        c, d = self._forced
        return (c * c + d * d).upper().sqrt()


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
        """As `vibrosweep.proof.reference.landing.Course.curvature`."""
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
        return ((v - root.sqrt()) / 2).upper(), ((v + SHY * root.sqrt()) / 2).lower()


def contact_free(arc: Arc, now: arb, speed: arb, *, lifted: bool, impact: int) -> arb:
    """Time until which a particle that leaves the base `now` has not landed.

    Its speed is relative to the base; `lifted` is True if the base presses it until then.
    Raises an UncertainError, about the next impact, where more precision is needed.
    """
    until = ZERO
    if speed > 0:
        until = speed / (2 + arc.most(2, now))
    elif lifted:  # the base falls ever faster for a while
        until = -arc.derivative(3, now) / arc.most(4, now)
    elif speed.is_zero():
        until = -(2 + arc.derivative(2, now)) / arc.most(3, now)
    if not until > 0:
        raise UncertainError("whether a particle leaves the base", impact)
    return until.lower()


class Pressure:
    """Acceleration of the base above that of gravity: it presses what rides while positive."""

    def __init__(self, arc: Arc) -> None:
        self._arc = arc

    def height(self, s: arb) -> arb:
        """Y'' + 2."""
        return 2 + self._arc.derivative(2, s)

    def slope(self, s: arb) -> arb:
        """Its rate."""
        return self._arc.derivative(3, s)

    def curvature(self, s: arb) -> tuple[arb, arb, arb, arb]:
        """As `Above.curvature`."""
        arc = self._arc
        return -arc.derivative(4, s), -arc.derivative(5, s), arc.most(6, s), arc.most(4, s)

    def above_all(self) -> None:
        """No time is known to be free of roots."""

    def lasts(self, s: arb) -> bool:
        """Tell whether it is proved to stay positive from then on."""
        return bool(2 - self._arc.most(2, s) > 0)
