"""Equations of closed orbits, and their multipliers, in balls with derivatives of first order.

A point holds the p landing times of an orbit, in forcing periods, and the kick a.  The equations
are those of the page on periodic orbits, in units of the dimensionless form: each impact turns the
speed at the end of one flight into that at the beginning of the next one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

from vibrosweep.proof.reference._flint import arb
from vibrosweep.proof.reference.jets import Jet
from vibrosweep.proof.reference.laws import Constant, Impact
from vibrosweep.proof.reference.waves import SINE_WAVE, Wave

Box = list[arb]
# Reasons why a particle may be unable to follow an orbit
EARLIER: Final = "earlier_landing_not_excluded"
RESTING: Final = "rest_not_excluded"


class Orbit(NamedTuple):
    """An orbit without rests, by its base, restitution, impacts and periods."""

    base: str  # "high-bounce" or "moving"
    e: arb
    p: int
    q: int
    rest: arb  # speed at and below which a particle rests
    wave: Wave = SINE_WAVE
    law: Impact | None = None  # of restitution, where it is not constant
    turns_back: bool = False  # True if a rebound downwards is turned back, as under `reflect`


class BaseMotion(NamedTuple):
    """The motion of the base at a phase."""

    w: Jet
    height: Jet  # W
    slope: Jet  # w'


class Flight(NamedTuple):
    """A flight and the impact at its end."""

    begins: Jet  # relative speed with which it begins
    leaves: Jet  # absolute speed with which it begins
    arrives: Jet  # relative speed with which it ends
    after: Jet  # relative speed after the impact
    # derivatives of phase and speed after the impact by those before the flight, row by row
    step: tuple[Jet, Jet, Jet, Jet]
    shrinks: Jet  # factor of the determinant of a cycle
    presses: arb  # acceleration in g with which the base presses a particle after the impact
    meets: str  # reason why it may land earlier; empty where it does not


class Cycle(NamedTuple):
    """Equations and multipliers of an orbit, evaluated at a point or over a box."""

    off: list[Jet]  # residuals of the equations: errors of the speeds after the impacts
    flights: list[Flight]
    trace: Jet
    determinant: Jet
    obstacle: str  # reason why a particle may be unable to follow the orbit; "" if it can


def cycle(orbit: Orbit, z: Sequence[Jet]) -> Cycle:
    """Equations and multipliers of an orbit."""
    p, a = orbit.p, z[orbit.p]
    times = [*z[:p], z[0] + orbit.q]
    moves = [_base_motion(orbit.wave, one) for one in times[:p]]
    fly = _bounce if orbit.base == "high-bounce" else _fly
    one, zero = 0 * a + 1, 0 * a
    m, determinant, obstacle = (one, zero, zero, one), one, ""
    flights = []
    for i in range(p):
        flight = fly(orbit, a, times[i + 1] - times[i], moves[i], moves[(i + 1) % p])
        flights.append(flight)
        obstacle = (obstacle or flight.meets) if flight.after.v > orbit.rest else RESTING
        determinant = determinant * flight.shrinks
        xx, xu, ux, uu = flight.step
        m = (
            xx * m[0] + xu * m[2],
            xx * m[1] + xu * m[3],
            ux * m[0] + uu * m[2],
            ux * m[1] + uu * m[3],
        )
    off = [flight.begins - flights[i - 1].after for i, flight in enumerate(flights)]
    return Cycle(off, flights, m[0] + m[3], determinant, obstacle)


def _base_motion(wave: Wave, turns: Jet) -> BaseMotion:
    """Motion of the base, with derivatives; the slope has none at a corner."""
    h = 2 * turns.v
    level, velocity, slope = wave.level(h), wave.velocity(h), wave.slope(h)
    jumps = wave.bounds.bend == 0 and slope.rad() > 0
    rate = arb("nan") if jumps else wave.rate(h)
    return BaseMotion(
        Jet(velocity, [slope * d for d in turns.d]),
        Jet(level, [velocity * d for d in turns.d]),
        Jet(slope, [rate * d for d in turns.d]),
    )


def _impact(orbit: Orbit, v: Jet) -> tuple[Jet, Jet]:
    """Relative speed after an impact with the relative speed v, and its derivative by v."""
    law = orbit.law or Constant(orbit.e)
    slope = law.slope(v.v)
    bend = law.bend(v.v)
    return Jet(law.kept(v.v), [slope * d for d in v.d]), Jet(slope, [bend * d for d in v.d])


def _bounce(orbit: Orbit, a: Jet, s: Jet, first: BaseMotion, last: BaseMotion) -> Flight:
    """A flight of the high-bounce map."""
    kept, q = _impact(orbit, s)
    w, k = kept + a * last.w, a * last.slope
    if orbit.turns_back and w.v < 0:
        w, k, q = -w, -k, -q
    one = 0 * a + 1
    return Flight(s, s, s, w, (one, one, k, k + q), q, arb(1), "")


def _fly(orbit: Orbit, a: Jet, s: Jet, first: BaseMotion, last: BaseMotion) -> Flight:
    """A flight over the moving base."""
    alpha = a / (1 + orbit.e)
    gained = alpha * (last.w - first.w)  # speed of the base
    y = s - alpha * first.w + alpha * (last.height - first.height) / s
    v = 2 * s - y + gained
    w, q = _impact(orbit, v)
    y_s, y_x = v / s, gained / s - alpha * first.slope
    v_s, v_x = 2 - y_s + alpha * last.slope, alpha * last.slope - gained / s
    step = (1 - y_x / y_s, 1 / y_s, q * (v_x - v_s * y_x / y_s), q * v_s / y_s)
    leaves = y + alpha * first.w
    # over a cycle the speeds cancel but for the product of all w / v, each the restitution e(v)
    shrinks = q * (orbit.e if orbit.law is None else w / v)
    meets = _meets_base(orbit.wave, alpha.v, leaves.v, first.height.v)
    presses = 1 + alpha.v * last.slope.v / 2
    return Flight(y, leaves, v, w, step, shrinks, presses, meets)


def _meets_base(wave: Wave, alpha: arb, u: arb, height: arb) -> str:
    """Reason why a flight that begins with the absolute speed u may land earlier, or "".

    It cannot where its height above the base is concave, nor where the particle, when it comes down
    to the highest level of the base, falls faster than the base ever moves.
    """
    concave = alpha * wave.bounds.steep <= 2
    most, drop = alpha * wave.bounds.fast, alpha * (wave.bounds.top - height)
    fast = u > 0 and u * u >= 4 * drop + most * most
    return "" if concave or fast else EARLIER
