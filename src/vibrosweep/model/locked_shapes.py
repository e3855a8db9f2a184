"""Windows of locked orbits under any waveform, in closed form (numpy only).

An orbit of mode k lands where a w(x) = n, with n = (1 - e) k.  It attracts for -m < a w'(x) < 0,
with m = 2 (1 + e) in the high-bounce limit and m = 4 (1 + e^2) / (1 + e) over the moving base.
Under the law `reflect` there is a second orbit, which is reflected at every impact, with -w in
place of w, n = (1 + e) k and m = 2 (1 - e).  Another law of restitution has other n and m, which do
not depend on the kick either.

Hence each phase x with w > 0 and w' < 0 belongs to one kick a = n / w(x), which increases with x.
A window is an interval of phases between zeros of w, of w' (a fold, where two orbits meet) and of
n w' + m w (a period doubling), which is a sum of harmonics too.  All zeros are found.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, Final, NamedTuple

from vibrosweep.model.orbit_theory import moves
from vibrosweep.model.parameters import HIGH_BOUNCE
from vibrosweep.model.physical import physical
from vibrosweep.model.shapes import (
    HARMONICS_NAME,
    NARROW,
    PARABOLIC_NAME,
    SINE_NAME,
    TWO_PI,
    Waveform,
    given_shape,
    zeros,
)

FOLD: Final = "fold"  # two orbits meet, or one begins at a corner of the velocity
DOUBLING: Final = "doubling"
NONE: Final = "none"  # the window has no end there
EPS: Final = 2.0**-52


class LockedWindow(NamedTuple):
    """A window of one branch of an orbit: kicks a in forcing periods, phases in turns.

    In results of `locked_windows`, amplitudes A in m s-1 stand in place of kicks.
    """

    low: float  # kick at the lower end
    high: float  # kick at the upper end; infinite if there is none
    low_error: float  # bound on the error of `low`
    high_error: float  # bound on the error of `high`
    from_phase: float  # phase of the landings at the lower end
    to_phase: float  # phase of the landings at the upper end
    begins: str  # kind of the lower end
    ends: str  # kind of the upper end


class Mode(NamedTuple):
    """Conditions of an orbit, with bounds on their errors apart from a few roundings."""

    need: float  # n of the module's text
    limit: float  # m of the module's text
    need_error: float = 0.0
    limit_error: float = 0.0


def mode_of(k: float, e: float, base: str, *, turned: bool = False) -> Mode:
    """Return the conditions of mode k under a constant restitution.

    `turned` selects the orbit that is reflected at every impact.
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

    If V0 w(x) is the velocity of the base, an orbit lands where A w(x) = (1 - e) g k / (2 f).  It
    attracts while its multipliers are inside the unit circle.  A mode has one window for each
    branch of its orbits; windows may overlap.

    Parameters
    ----------
    k, restitution, frequency, gravity
        Mode (forcing periods between impacts), e (0 to 1, constant), f (Hz) and g (m s-2).
    waveform
        ``"sine"``, ``"parabolic"``, or ``{"harmonics": [[number, weight, phase in rad], ...]}``.
    base
        ``"high-bounce"`` or ``"moving"``.  Over a moving base a window may end earlier, where the
        flight grazes the base: `vibrosweep.windows` finds such ends.

    Returns
    -------
    list of LockedWindow
        Windows in the order of their lower ends, each a named tuple: ends ``low``, ``high`` and
        bounds on their errors ``low_error``, ``high_error`` (m s-1); phases of the landings there
        ``from_phase``, ``to_phase`` (turns); kinds of ends ``begins``, ``ends``: ``"fold"``,
        ``"doubling"`` or ``"none"``.

    Raises
    ------
    ParameterError
        The base or the waveform is not one of these, or an argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> two = {"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}
    >>> for window in vs.theory.locked_windows(1, 0.85, two, gravity=2.0):
    ...     print(round(window.low, 4), round(window.high, 4), window.ends)
    0.1688 0.2855 fold
    0.2852 0.6657 doubling
    """
    unit = gravity / (2.0 * frequency)
    return [
        window._replace(
            low=unit * window.low,
            high=unit * window.high,
            low_error=unit * window.low_error + 4.0 * EPS * unit * window.low,
            high_error=unit * window.high_error + 4.0 * EPS * unit * window.high,
        )
        for window in windows_of(given_shape(waveform), mode_of(k, restitution, base))
    ]


def windows_of(waveform: Waveform, mode: Mode, *, turned: bool = False) -> list[LockedWindow]:
    """Return the windows of an orbit, one for each branch and interval of phases.

    The end of a window at a graze, over the moving base, is not searched for.
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
    tones = tuple((h, sign * c, psi) for h, c, psi in waveform.harmonics)
    w = Waveform(HARMONICS_NAME, tones)
    if need == 0.0:  # the orbit lands at a zero of w for any kick
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
    for (x, begins), (y, finishes) in pairwise([*ends, (ends[0][0] + 1.0, ends[0][1])]):
        middle = 0.5 * (x + y)
        if w.velocity(middle) > 0.0 > w.slope(middle) and mixed.velocity(middle) > 0.0:
            low, low_error = _kick(w, mixed, mode, x, begins)
            high, high_error = _kick(w, mixed, mode, y, finishes)
            found.append(LockedWindow(low, high, low_error, high_error, x, y, begins, finishes))
    return sorted(found)


def _kick(w: Waveform, mixed: Waveform, mode: Mode, x: float, kind: str) -> tuple[float, float]:
    """Return the kick of the orbit at an end of a window, at phase x, and a bound on its error."""
    value, slope = float(w.velocity(x)), float(w.slope(x))
    # error of the phase: roundings of the function that vanishes there, over its slope
    function, order = (w, 1) if kind == FOLD else (mixed, 0)
    steep = abs(float(function.derivative(x, order + 1)))
    off = 64.0 * EPS * function.sum_of(order) / steep if steep > 0.0 else NARROW
    change = abs(slope) * off + w.sum_of(2) * off * off
    error = (change + 64.0 * EPS * w.sum_of(0)) / value + 8.0 * EPS
    return mode.need / value, mode.need / value * error + _error_of_conditions(w, mode, x, kind)


def _error_of_conditions(w: Waveform, mode: Mode, x: float, kind: str) -> float:
    """Return a bound on the error of a kick that errors of the conditions cause.

    At a fold the phase does not depend on the conditions.  At a period doubling, K w = n and
    K w' = -m determine both the kick K and the phase: dK (w'^2 - w w'') = -w' dm - w'' dn.
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
        in_phase, quadrature = limit * c, need * TWO_PI * h * c
        tones.append((h, math.hypot(in_phase, quadrature), psi + math.atan2(quadrature, in_phase)))
    return Waveform(HARMONICS_NAME, tuple(tones))
