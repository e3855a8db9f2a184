"""One flight over a moving base, proved in ball arithmetic."""

from __future__ import annotations

from vibrosweep.model.shapes import SINE
from vibrosweep.proof.reference._flint import arb, ctx
from vibrosweep.proof.reference.decisions import decided
from vibrosweep.proof.reference.laws import Constant
from vibrosweep.proof.reference.moving import MovingMap
from vibrosweep.proof.reference.waves import wave_of


def first_landing(e, a, x, y, bits=128, max_bits=1 << 13, waveform=SINE):
    """Proved landing of one flight from exact doubles.

    Kick a in forcing periods, alpha = a / (1 + e); phase x in turns, and speed y relative to the
    base in units of g / 2 f, at lift-off.  The precision is doubled until the landing is certain;
    an UndecidableError where a graze is not told from a landing.

    Returns
    -------
    s, z
        Balls of the duration of the flight in forcing periods, 0 where it lands at once, and of
        the relative speed of arrival.
    """

    def attempt(bits):
        with ctx.workprec(bits):
            alpha = arb(a) / (1 + arb(e))
            m = MovingMap(Constant(arb(e)), alpha, arb(0), wave_of(waveform))
            s = m.flight(arb(x), arb(y), 1)
            if s is None:
                return arb(0), -arb(y)
            return s, -2 * m.clearance(arb(x), arb(y)).slope(s)

    return decided(attempt, bits, max_bits)
