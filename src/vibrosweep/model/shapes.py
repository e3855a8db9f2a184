"""Waveforms: shapes of the motion of the base over a period.

At the phase X in turns the base has the velocity V0 w(X) and the height (V0 / f) W(X), W' = w.  The
shape w has the period 1 and the mean zero:

    w(X) = sum c_h sin(2 pi h X + psi_h)        W(X) = -sum c_h cos(2 pi h X + psi_h) / (2 pi h)

or, for "parabolic", w(X) = 4 X for |X| <= 1/4 and 2 - 4 X for 1/4 <= X <= 3/4.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.mistakes import toml
from vibrosweep.model.parameters import physical, turns_of_radians

PARABOLIC_NAME: Final = "parabolic"
SINE_NAME: Final = "sine"
HARMONICS_NAME: Final = "harmonics"
WAVEFORMS: Final = (SINE_NAME, PARABOLIC_NAME, HARMONICS_NAME)
MOST_HARMONICS: Final = 16
TWO_PI: Final = 2.0 * math.pi
OFFSET: Final = 0.49087  # of the intervals of a search, so that no end is likely to be a zero
NARROW: Final = 2.0**-44  # turns; two closer zeros count as one

FORMS: Final = (
    f'must be "{SINE_NAME}", "{PARABOLIC_NAME}", or the harmonics of the velocity of the base, '
    f"each with its number, weight and phase in rad, as in "
    f"{{ {HARMONICS_NAME} = [[1, 1.0, 0.0], [2, 0.4, 1.1]] }}, or a measured trace, as in "
    f'{{ trace = "shaker.csv", column = "height", {HARMONICS_NAME} = 8 }}'
)
LARGEST_TONE: Final = 1e6  # largest modulus of a weight and of a phase

Tone = tuple[int, float, float]  # number, weight and phase in rad of a harmonic


class FittedTrace(NamedTuple):
    """A measured motion to which harmonics were fitted."""

    trace: str  # path of the file
    column: str
    digest: str  # of the file
    held: float  # share of the variance of the trace that the harmonics explain


@dataclass(frozen=True)
class Waveform:
    """A waveform, one of `WAVEFORMS`; its harmonics are sorted by number, each once."""

    name: str = SINE_NAME
    tones: tuple[Tone, ...] = ()
    trace: FittedTrace | tuple[()] = ()

    @property
    def text(self) -> str:
        """Text of the key ``waveform`` in a result: a name, or harmonics and their origin."""
        return self.name if self.name != HARMONICS_NAME else toml(self.value)

    @property
    def value(self) -> Any:
        """Value of the key ``waveform`` in a sweep file that does not need the trace."""
        if self.name != HARMONICS_NAME:
            return self.name
        origin = self.trace._asdict() if isinstance(self.trace, FittedTrace) else {}
        return {self.name: [list(tone) for tone in self.tones], **origin}

    def height(self, x: ArrayLike) -> Array:
        """Return W at phases in turns."""
        return self.derivative(x, -1)

    def velocity(self, x: ArrayLike) -> Array:
        """Return w at phases in turns."""
        return self.derivative(x, 0)

    def slope(self, x: ArrayLike) -> Array:
        """Return the derivative of w with respect to the phase in turns."""
        return self.derivative(x, 1)

    def area(self, x: ArrayLike) -> Array:
        """Return the integral of W over the phase in turns, with mean zero."""
        return self.derivative(x, -2)

    @functools.cached_property
    def highest(self) -> float:
        """Largest velocity, in units of V0."""
        if self.name != HARMONICS_NAME:
            return 1.0
        return float(self.velocity(zeros(self, 1)).max())

    @functools.cached_property
    def per_displacement(self) -> float:
        """V0 / (f B), where B is half the height from the lowest to the highest level."""
        if self.name != HARMONICS_NAME:
            return TWO_PI if self.name == SINE_NAME else 8.0
        levels = self.height(zeros(self, 0))
        return 2.0 / float(levels.max() - levels.min())

    @functools.cached_property
    def fall(self) -> float:
        """Greatest downward acceleration in units of f V0."""
        if self.name != HARMONICS_NAME:
            return TWO_PI if self.name == SINE_NAME else 4.0
        return -float(np.min(self.slope(zeros(self, 2))))

    def sum_of(self, power: int) -> float:
        """Return the sum of (2 pi h)^power |c_h|, a bound of the derivative of w of this order."""
        return math.fsum((TWO_PI * h) ** power * abs(c) for h, c, _ in self.harmonics)

    @property
    def harmonics(self) -> tuple[Tone, ...]:
        """Harmonics of w, for the sine too, with phases of more than a turn reduced."""
        return tuple((h, c, _reduced(psi)) for h, c, psi in self.tones or ((1, 1.0, 0.0),))

    def derivative(self, x: ArrayLike, order: int) -> Array:
        """Return the derivative of w of an order; negative orders are integrals of mean zero."""
        x = np.asarray(x, dtype=np.float64)
        if self.name == PARABOLIC_NAME:
            return _parabolic(x, order)
        found = np.zeros_like(x)
        for h, weight, phase in self.harmonics:
            angle = TWO_PI * (h * x - np.rint(h * x)) + phase
            found += weight * (TWO_PI * h) ** order * np.sin(angle + 0.5 * math.pi * order)
        return found


def _reduced(psi: float) -> float:
    """Return a phase in rad without its whole turns; one within a turn keeps its bits."""
    return psi if abs(psi) <= TWO_PI else TWO_PI * float(turns_of_radians(np.asarray(psi)))


SINE: Final = Waveform()


def harmonics_of(listed: object, origin: FittedTrace | tuple[()] = ()) -> Waveform:
    """Return the waveform of a list of harmonics; a ValueError says what is allowed."""
    if not isinstance(listed, list) or not listed:
        raise ValueError("the list of harmonics is empty; ", FORMS)
    if len(listed) > MOST_HARMONICS:
        raise ValueError(f"has {len(listed)} harmonics; at most {MOST_HARMONICS} are allowed")
    tones = tuple(sorted(map(_tone, listed)))
    numbers = [h for h, _, _ in tones]
    if len({*numbers}) < len(numbers):
        raise ValueError("gives a harmonic twice; sum the two, or leave one out")
    if not any(weight for _, weight, _ in tones):
        raise ValueError("has no harmonic whose weight differs from 0: such a base does not move")
    return Waveform(HARMONICS_NAME, tones, origin)


def given_shape(waveform: str | Mapping[str, Any]) -> Waveform:
    """Return the shape that a name or a list of harmonics gives."""
    if waveform in (SINE_NAME, PARABOLIC_NAME):
        return Waveform(str(waveform))
    if not isinstance(waveform, Mapping) or set(waveform) != {HARMONICS_NAME}:
        raise ParameterError(f"waveform = {waveform!r}: {FORMS}")
    try:
        return harmonics_of(waveform[HARMONICS_NAME])
    except ValueError as error:
        raise ParameterError(f"waveform = {waveform!r}: {''.join(error.args)}") from None


@physical
def base_motion(
    turns: ArrayLike, waveform: str | Mapping[str, Any] = SINE_NAME
) -> tuple[Array, Array]:
    """Velocity and height of the base at phases of the forcing.

    A scene with the amplitude A and the restitution e moves its base with the velocity V0 w(X) at
    the height (V0 / f) W(X), where V0 = A / (1 + e), X = f t + phi / (2 pi) and W' = w.

    Parameters
    ----------
    turns
        Phases X in turns, of any shape.
    waveform
        ``"sine"``, ``"parabolic"``, or ``{"harmonics": [[number, weight, phase in rad], ...]}``.

    Returns
    -------
    velocity, height : numpy.ndarray
        w(X) and W(X), both without unit and with mean zero, of the shape of `turns`.

    Raises
    ------
    ParameterError
        The waveform is not one of these, or a phase is not finite.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> velocity, height = vs.theory.base_motion([0.0, 0.125, 0.25], "parabolic")
    >>> velocity
    array([0. , 0.5, 1. ])
    >>> height
    array([-0.125  , -0.09375,  0.     ])
    """
    shape = given_shape(waveform)
    return shape.velocity(turns), shape.height(turns)


def _tone(harmonic: Any) -> Tone:
    """Return number, weight and phase of a harmonic."""
    if not isinstance(harmonic, list) or len(harmonic) != 3:
        raise ValueError(f"harmonic {harmonic!r} is not a list of number, weight and phase in rad")
    h, *others = harmonic
    if h == 0 and not isinstance(h, bool):
        raise ValueError("harmonic 0 is a mean velocity, with which the base would drift away")
    if isinstance(h, bool) or not isinstance(h, int) or not 1 <= h <= MOST_HARMONICS:
        raise ValueError(
            f"harmonic number {h!r} must be a whole number from 1 to {MOST_HARMONICS}, so that the "
            f"motion has the period of the forcing"
        )
    for what, number in zip(("weight", "phase in rad"), others, strict=True):
        real = isinstance(number, int | float) and not isinstance(number, bool)
        if not (real and math.isfinite(number) and abs(number) <= LARGEST_TONE):
            raise ValueError(
                f"the {what} of harmonic {h} is {number!r}; it must be a number from "
                f"{-LARGEST_TONE:g} to {LARGEST_TONE:g}"
            )
    return h, float(others[0]), float(others[1])


def name_in(attributes: Mapping[str, Any]) -> str:
    """Return the name of the waveform in attributes of a result; by default the sine."""
    given = str(attributes.get("waveform", SINE_NAME))
    return given if given in WAVEFORMS else HARMONICS_NAME


def _parabolic(x: Array, order: int) -> Array:
    """Return the derivative of the parabolic shape, of order -2 to 1."""
    near = x - np.rint(x)
    rises = np.abs(near) <= 0.25
    y = np.where(rises, near, near - np.copysign(0.5, near))  # from the middle of the half period
    sign = np.where(rises, 1.0, -1.0)
    if order == -2:
        return sign * y * (2.0 * y * y / 3.0 - 0.125)
    if order == -1:
        return sign * (2.0 * y * y - 0.125)
    return sign * (4.0 * y if order == 0 else 4.0)


def zeros(waveform: Waveform, order: int) -> Array:
    """Return the phases in [-1/2, 1/2], ascending, at which a derivative of w is zero.

    `order` is that of the derivative; the waveform must be of harmonics.  All zeros are found,
    except pairs closer than `NARROW`: an interval is discarded when a bound of the next derivative
    excludes a zero, and halved until the function is monotone in it.
    """
    bounds = [waveform.sum_of(order + 1) * 1.001, waveform.sum_of(order + 2) * 1.001]

    def value(x: Array) -> Array:
        return waveform.derivative(x, order)

    def slope(x: Array) -> Array:
        return waveform.derivative(x, order + 1)

    most = max(h for h, _, _ in waveform.tones)
    edges = np.linspace(0.0, 1.0, 16 * most + 1) - OFFSET
    left, right = edges[:-1], edges[1:]
    found = []
    while left.size:
        middle, half = 0.5 * (left + right), 0.5 * (right - left)
        empty = np.abs(value(middle)) > bounds[0] * half
        monotone = np.abs(slope(middle)) > bounds[1] * half
        narrow = half < NARROW
        crosses = (value(left) < 0.0) != (value(right) < 0.0)
        done = ~empty & (monotone | narrow)
        found.append(_bisected(value, left[done & crosses], right[done & crosses]))
        undecided = ~empty & ~done
        left, right = (
            np.concatenate([left[undecided], middle[undecided]]),
            np.concatenate([middle[undecided], right[undecided]]),
        )
    phases = np.concatenate(found)
    return np.sort(phases - np.rint(phases))


def _bisected(value: Callable[[Array], Array], left: Array, right: Array) -> Array:
    """Return the zero of a function in each interval; its signs differ at the ends."""
    below = value(left) < 0.0
    for _ in range(60):
        middle = 0.5 * (left + right)
        same = (value(middle) < 0.0) == below
        left, right = np.where(same, middle, left), np.where(same, right, middle)
    return 0.5 * (left + right)
