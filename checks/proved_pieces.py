"""Pieces of motion from exact doubles, proved in ball arithmetic: a sine, an impact, a flight."""

from __future__ import annotations

from vibrosweep.model.shapes import SINE
from vibrosweep.proof.reference.arithmetic import arb, ctx, decided, nearest_integer
from vibrosweep.proof.reference.high_bounce import BallMap
from vibrosweep.proof.reference.laws import Constant, wave_of
from vibrosweep.proof.reference.moving import MovingMap


def sine(x, bits=300):
    """Ball that contains sin(2 pi x) for a phase x in turns."""
    with ctx.workprec(bits):
        return (2 * arb(x)).sin_pi()


def step(e, a, x, u, bits=300):
    """One impact of the dimensionless map, before the law of rebound.

    Kick a and flight time u are in forcing periods, u below 2**bits, and the phase x in turns.

    Returns
    -------
    phase, count, w
        x' = x + u as a ball around a midpoint in [-1/2, 1/2], and whole periods apart;
        w = e u + a sin(2 pi x').
    """
    with ctx.workprec(bits):
        # gravity 2 and frequency 1: velocities are flight times in periods
        m = BallMap(Constant(arb(e)), arb(a), 2 * arb(x), arb(4), arb(2))
        landed, w = m.impact(arb(0), arb(u))
        turns = arb(x) + landed
        count = nearest_integer(turns)
        return turns - count, count, w


def first_landing(e, a, x, y, bits=128, max_bits=1 << 13, waveform=SINE):
    """Landing of one flight.

    Kick a in forcing periods, alpha = a / (1 + e); phase x in turns, and speed y relative to the
    base in units of g / 2 f, at lift-off.  The precision is doubled until the landing is certain;
    raises an UndecidableError if a graze cannot be told from a landing.

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
