"""Windows of locked orbits under any waveform, in closed form (numpy only).

An orbit of mode k lands where a w(x) = n, with n = (1 - e) k on either base; it attracts for
-m < a w'(x) < 0, with m = 2 (1 + e) on the high-bounce base and m = 4 (1 + e^2) / (1 + e) on one
that moves.  Under the law `reflect` there is also the orbit that is turned back at every impact,
with -w in place of w, n = (1 + e) k and m = 2 (1 - e).  Another law of restitution has other n and
m, which do not depend on the kick either.

So with a = n / w(x) each phase x with w > 0 and w' < 0 belongs to one kick, which grows with x
while w falls: a window is an interval of phases between zeros of w, of w' (a fold, where two orbits
meet) and of n w' + m w (a period doubling), which is a sum of harmonics, too.  All zeros are found.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, Final, NamedTuple

from vibrosweep.errors import ParameterError
from vibrosweep.model.orbit_theory import moves
from vibrosweep.model.parameters import HIGH_BOUNCE
from vibrosweep.model.physical import physical
from vibrosweep.model.shapes import (
    FORMS,
    HARMONICS_NAME,
    NARROW,
    PARABOLIC_NAME,
    SINE_NAME,
    TWO_PI,
    Waveform,
    harmonics_of,
    zeros,
)

FOLD: Final = "fold"  # two orbits meet, or one is born at a corner of the velocity
DOUBLING: Final = "doubling"
NONE: Final = "none"  # the window has no end there
EPS: Final = 2.0**-52


class LockedWindow(NamedTuple):
    """A window of one branch of an orbit: kicks a in forcing periods, phases in turns.

    Of `locked_windows` it holds amplitudes A in m s-1 in place of kicks.
    """

    # low, high: kicks at its ends, the last infinite where it has none
    low: float
    high: float
    # low_error, high_error: bounds of their errors
    low_error: float
    high_error: float
    # from_phase, to_phase: of the landings there
    from_phase: float
    to_phase: float
    # begins, ends: what happens there
    begins: str
    ends: str


class Mode(NamedTuple):
    """Conditions of an orbit, with bounds of their errors beyond some roundings."""

    # need, limit: n and m
    need: float
    limit: float
    need_error: float = 0.0
    limit_error: float = 0.0


def mode_of(k: float, e: float, base: str, *, turned: bool = False) -> Mode:
    """Conditions of mode k under a constant restitution.

    `turned` asks for the orbit that is turned back at every impact.
    """
    if turned:
        return Mode((1.0 + e) * k, 2.0 * (1.0 - e))
    return Mode((1.0 - e) * k, 4.0 * (1.0 + e * e) / (1.0 + e) if moves(base) else 2.0 * (1.0 + e))


@physical
def locked_windows(
    k: float,
    restitution: float,
    waveform: str | Mapping[str, Any] = SINE_NAME,
    frequency: float = 1.0,
    gravity: float = 9.81,
    base: str = HIGH_BOUNCE,
) -> list[LockedWindow]:
    """Windows of amplitudes in which orbits of mode k exist and attract, under any waveform.

    With the velocity V0 w(x) of the base an orbit lands where A w(x) = (1 - e) g k / (2 f), and
    attracts until its multipliers leave the unit circle.  A mode has one window for each branch
    of its orbits; windows may overlap.

    Parameters
    ----------
    k, restitution, frequency, gravity
        Mode (forcing periods between impacts), e (0 to 1, constant), f (Hz) and g (m s-2).
    waveform
        ``"sine"``, ``"parabolic"``, or ``{"harmonics": [[number, weight, phase in rad], ...]}``.
    base
        ``"high-bounce"`` or ``"moving"``.  Over a moving base a window may end earlier, where its
        flight grazes the base: `vibrosweep.windows` finds such ends.

    Returns
    -------
    list of LockedWindow
        By their lower ends, each a named tuple: ``low``, ``high`` and bounds of their errors
        ``low_error``, ``high_error`` (m s-1); ``from_phase``, ``to_phase`` of the landings there
        (turns); ``begins``, ``ends``: ``"fold"``, ``"doubling"`` or ``"none"``.

    Raises
    ------
    ParameterError
        The base or the waveform is not one of these, or an argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> two = {"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}
    >>> for one in vs.theory.locked_windows(1, 0.85, two, gravity=2.0):
    ...     print(round(one.low, 4), round(one.high, 4), one.ends)
    0.1688 0.2855 fold
    0.2852 0.6657 doubling
    """
    unit = gravity / (2.0 * frequency)
    return [
        one._replace(
            low=unit * one.low,
            high=unit * one.high,
            low_error=unit * one.low_error + 4.0 * EPS * unit * one.low,
            high_error=unit * one.high_error + 4.0 * EPS * unit * one.high,
        )
        for one in windows_of(_shape(waveform), mode_of(k, restitution, base))
    ]


def _shape(waveform: str | Mapping[str, Any]) -> Waveform:
    """Return the shape that a name or a list of harmonics gives."""
    if waveform in (SINE_NAME, PARABOLIC_NAME):
        return Waveform(str(waveform))
    if not isinstance(waveform, Mapping) or set(waveform) != {HARMONICS_NAME}:
        raise ParameterError(f"waveform = {waveform!r}: {FORMS}")
    try:
        return harmonics_of(waveform[HARMONICS_NAME])
    except ValueError as error:
        raise ParameterError(f"waveform = {waveform!r}: {''.join(error.args)}") from None


def windows_of(waveform: Waveform, mode: Mode, *, turned: bool = False) -> list[LockedWindow]:
    """Windows of an orbit by their phases, one for each branch and interval.

    An earlier landing over a base that moves, which may end a window, is not looked for.
    """
    need, limit, need_error, limit_error = mode
    sign = -1.0 if turned else 1.0
    if waveform.name == PARABOLIC_NAME:  # w falls with the slope -4 from 1, at a corner, to 0
        if need >= 0.25 * limit:
            return []
        x = -0.25 if turned else 0.25
        y, error = x + 0.25 * (1.0 - 4.0 * need / limit), 4.0 * EPS
        high = 0.25 * limit
        low_error, high_error = error * need + need_error, error * high + 0.25 * limit_error
        return [LockedWindow(need, high, low_error, high_error, x, y, FOLD, DOUBLING)]
    tones = waveform.tones or ((1, 1.0, 0.0),)
    w = Waveform(HARMONICS_NAME, tuple((h, sign * c, psi) for h, c, psi in tones))
    if need == 0.0:  # it lands on a zero of w at any kick
        falls = [(float(x), -float(w.slope(x))) for x in zeros(w, 0) if w.slope(x) < 0.0]
        off = 64.0 * EPS * w.sum_of(1)
        return sorted(
            LockedWindow(0.0, limit / s, 0.0, off * limit / s**2, x, x, NONE, DOUBLING)
            for x, s in falls
        )
    mixed = _mixed(w, need, limit)
    kinds = {NONE: zeros(w, 0), FOLD: zeros(w, 1), DOUBLING: zeros(mixed, 0)}
    ends = sorted((float(x), kind) for kind, phases in kinds.items() for x in phases)
    found = []
    for (x, begins), (y, stops) in pairwise([*ends, (ends[0][0] + 1.0, ends[0][1])]):
        middle = 0.5 * (x + y)
        if w.velocity(middle) > 0.0 > w.slope(middle) and mixed.velocity(middle) > 0.0:
            low, low_error = _kick(w, mixed, mode, x, begins)
            high, high_error = _kick(w, mixed, mode, y, stops)
            found.append(LockedWindow(low, high, low_error, high_error, x, y, begins, stops))
    return sorted(found)


def _kick(w: Waveform, mixed: Waveform, mode: Mode, x: float, kind: str) -> tuple[float, float]:
    """Kick of an orbit that lands at phase x, an end of a window of a kind, and its error."""
    value, slope = float(w.velocity(x)), float(w.slope(x))
    # the phase is off by the rounding of the function whose zero it is, over its slope
    of, order = (w, 1) if kind == FOLD else (mixed, 0)
    steep = abs(float(of.derivative(x, order + 1)))
    off = 64.0 * EPS * of.sum_of(order) / steep if steep > 0.0 else NARROW
    change = abs(slope) * off + w.sum_of(2) * off * off
    error = (change + 64.0 * EPS * w.sum_of(0)) / value + 8.0 * EPS
    return mode.need / value, mode.need / value * error + _moved(w, mode, x, kind)


def _moved(w: Waveform, mode: Mode, x: float, kind: str) -> float:
    """Bound of the error of a kick by those of the conditions.

    At a fold the phase stays.  At a period doubling K w = n and K w' = -m of the kick K and the
    phase change together: dK (w'^2 - w w'') = -w' dm - w'' dn.
    """
    value, slope = float(w.velocity(x)), float(w.slope(x))
    if kind != DOUBLING or mode.need_error == mode.limit_error == 0.0:
        return mode.need_error / value
    bend = float(w.derivative(x, 2))
    steep = abs(slope) * mode.limit_error + abs(bend) * mode.need_error
    return steep / abs(slope * slope - value * bend)


def _mixed(w: Waveform, need: float, limit: float) -> Waveform:
    """Return the sum need w' + limit w as harmonics."""
    tones = []
    for h, c, psi in w.tones:
        along, across = limit * c, need * TWO_PI * h * c
        tones.append((h, math.hypot(along, across), psi + math.atan2(across, along)))
    return Waveform(HARMONICS_NAME, tuple(tones))
