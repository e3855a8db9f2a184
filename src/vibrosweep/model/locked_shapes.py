"""Windows of locked orbits under any waveform, in closed form (numpy only).

An orbit of mode k lands where a w(x) = n, with n = (1 - e) k on either base; it attracts for
-m < a w'(x) < 0, with m = 2 (1 + e) on the high-bounce base and m = 4 (1 + e^2) / (1 + e) on one
that moves.  Under the law `reflect` there is also the orbit that is turned back at every impact,
with -w in place of w, n = (1 + e) k and m = 2 (1 - e).

So with a = n / w(x) each phase x with w > 0 and w' < 0 belongs to one kick, which grows with x
while w falls: a window is an interval of phases between zeros of w, of w' (a fold, where two orbits
meet) and of n w' + m w (a period doubling), which is a sum of harmonics, too.  All zeros are found.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final, NamedTuple

from vibrosweep.model.orbit_theory import moves
from vibrosweep.model.shapes import (
    HARMONICS_NAME,
    NARROW,
    PARABOLIC_NAME,
    TWO_PI,
    Waveform,
    zeros,
)

FOLD: Final = "fold"  # two orbits meet, or one is born at a corner of the velocity
DOUBLING: Final = "doubling"
NONE: Final = "none"  # the window has no end there
EPS: Final = 2.0**-52


class LockedWindow(NamedTuple):
    """A window of one branch of an orbit: kicks a in forcing periods, phases in turns."""

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


def locked_windows(
    waveform: Waveform, k: float, e: float, base: str, *, turned: bool = False
) -> list[LockedWindow]:
    """Windows of mode k by their phases, one for each branch and interval.

    `turned` asks for the orbit that is turned back at every impact.  An earlier landing over a base
    that moves, which may end a window, is not looked for.
    """
    need = (1.0 + e if turned else 1.0 - e) * k
    limit = 4.0 * (1.0 + e * e) / (1.0 + e) if moves(base) else 2.0 * (1.0 + e)
    limit = 2.0 * (1.0 - e) if turned else limit
    sign = -1.0 if turned else 1.0
    if waveform.name == PARABOLIC_NAME:  # w falls with the slope -4 from 1, at a corner, to 0
        if need >= 0.25 * limit:
            return []
        x = -0.25 if turned else 0.25
        y, error = x + 0.25 * (1.0 - 4.0 * need / limit), 4.0 * EPS
        high = 0.25 * limit
        return [LockedWindow(need, high, error * need, error * high, x, y, FOLD, DOUBLING)]
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
            low, low_error = _kick(w, mixed, need, x, begins)
            high, high_error = _kick(w, mixed, need, y, stops)
            found.append(LockedWindow(low, high, low_error, high_error, x, y, begins, stops))
    return sorted(found)


def _kick(w: Waveform, mixed: Waveform, need: float, x: float, kind: str) -> tuple[float, float]:
    """Kick of an orbit that lands at phase x, an end of a window of a kind, and its error."""
    value, slope = float(w.velocity(x)), float(w.slope(x))
    # the phase is off by the rounding of the function whose zero it is, over its slope
    of, order = (w, 1) if kind == FOLD else (mixed, 0)
    steep = abs(float(of.derivative(x, order + 1)))
    off = 64.0 * EPS * of.sum_of(order) / steep if steep > 0.0 else NARROW
    change = abs(slope) * off + w.sum_of(2) * off * off
    error = (change + 64.0 * EPS * w.sum_of(0)) / value + 8.0 * EPS
    return need / value, need / value * error


def _mixed(w: Waveform, need: float, limit: float) -> Waveform:
    """Return the sum need w' + limit w as harmonics."""
    tones = []
    for h, c, psi in w.tones:
        along, across = limit * c, need * TWO_PI * h * c
        tones.append((h, math.hypot(along, across), psi + math.atan2(across, along)))
    return Waveform(HARMONICS_NAME, tuple(tones))
