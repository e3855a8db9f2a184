"""Motion that the drive forces on a base of finite mass, between events, in ball arithmetic.

The units and names are those of `vibrosweep.proof.reference.mount`.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

from vibrosweep.model.shapes import PARABOLIC_NAME, SINE, Waveform
from vibrosweep.proof.reference._flint import arb
from vibrosweep.proof.reference.decisions import UncertainError, nearest_integer
from vibrosweep.proof.reference.waves import Wave, wave_of

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
