"""Motions of the base in ball arithmetic, with derivatives: velocity, height and slope of a shape.

In units of the page on waveforms: the base has the velocity alpha w(X), and twice the height
alpha W(X), W' = w, at the phase X in turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from vibrosweep.proof.reference._flint import arb
from vibrosweep.proof.reference.jets import Jet, waves

Tone = tuple[int, float, float]  # number, weight and phase in rad of a harmonic


class Moved(NamedTuple):
    """The motion at a phase."""

    w: Jet
    height: Jet  # W
    slope: Jet  # w'


class Motion(NamedTuple):
    """A sum of tones, or without any the parabolic waveform."""

    tones: Sequence[Tone]

    def at(self, turns: Jet) -> Moved:
        """Motion at a phase in turns."""
        if not self.tones:
            return _parabolic(turns)
        w = height = slope = Jet(arb(0), [arb(0)] * len(turns.d))
        for h, weight, phase in self.tones:
            turn = 2 * arb.pi() * h
            sine, cosine = waves(h * turns + arb(phase) / (2 * arb.pi()))
            w = w + arb(weight) * sine
            height = height - arb(weight) / turn * cosine
            slope = slope + arb(weight) * turn * cosine
        return Moved(w, height, slope)

    def bound(self, order: int) -> arb:
        """Bound of the derivative of w of an order, of order -1 of its integral."""
        if not self.tones:
            return {-1: arb(1) / 8, 0: arb(1), 1: arb(4)}[order]
        parts = ((2 * arb.pi() * h) ** order * abs(arb(c)) for h, c, _ in self.tones)
        return sum(parts, arb(0))


SINE: Final = Motion(((1, 1.0, 0.0),))


def _parabolic(turns: Jet) -> Moved:
    """W = 4 y for |y| <= 1/4 and -4 z beyond, z the phase from the middle of that half."""
    y = turns - turns.v.mid().floor() if turns.v.is_finite() else turns
    zero = Jet(arb(0), [arb(0)] * len(turns.d))
    # halves of the period, in which it rises or falls; a ball may touch two
    halves = [k for k in range(-1, 5) if not (y.v < _corner(k - 1) or y.v > _corner(k))]
    each = []
    for k in halves:
        sign, z = (1 if k % 2 == 0 else -1), y - arb(k) / 2
        each.append(Moved(4 * sign * z, sign * (2 * z * z - arb(1) / 8), zero + 4 * sign))
    if len(each) == 1:
        return each[0]
    nowhere = Jet(arb(0, 4), [arb("nan")] * len(turns.d))  # the slope jumps at a corner
    if not each:
        return Moved(nowhere, nowhere, nowhere)
    return Moved(_either([one.w for one in each]), _either([one.height for one in each]), nowhere)


def _corner(k: int) -> arb:
    """End of the half k, whose middle is k / 2."""
    return arb(2 * k + 1) / 4


def _either(jets: Sequence[Jet]) -> Jet:
    """Enclose all of some jets."""
    first, *others = jets
    v, d = first.v, list(first.d)
    for other in others:
        v = v.union(other.v)
        d = [a.union(b) for a, b in zip(d, other.d, strict=True)]
    return Jet(v, d)
