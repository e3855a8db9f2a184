"""Closed orbits, their bifurcations and branches of them, proved by Krawczyk's method.

A point holds the p landing times of an orbit, in forcing periods, and the kick a.  The equations
are those of the page on periodic orbits, in units of the dimensionless form: each impact turns the
speed at the end of one flight into that at the beginning of the next one.

The multipliers of an
orbit are the roots of M^2 - T M + D, with the trace T and the determinant D of the Jacobian of a
cycle; one of them is M = 1 or -1 where 1 - M T + D = 0.

For a box Z around m, and a matrix C near the inverse of F'(m), Krawczyk's operator

    K = m - C F(m) + (1 - C F'(Z)) (Z - m)

contains every root of F in Z; if K lies inside Z, there is exactly one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from vibrosweep.proof.reference.arithmetic import Jet, arb, arb_mat, ctx, variables
from vibrosweep.proof.reference.laws import SINE_WAVE, Constant, Restitution, Wave

Box = list[arb]
# Reasons why a particle may be unable to follow an orbit
EARLIER: Final = "earlier_landing_not_excluded"
RESTING: Final = "rest_not_excluded"


class ClosedOrbit(NamedTuple):
    """An orbit without rests, by its base, restitution, impacts and periods."""

    base: str  # "high-bounce" or "moving"
    e: arb
    p: int
    q: int
    rest: arb  # speed at and below which a particle rests
    wave: Wave = SINE_WAVE
    law: Restitution | None = None  # of restitution, where it is not constant
    turns_back: bool = False  # True if a rebound downwards is turned back, as under `reflect`


class BaseJets(NamedTuple):
    """The motion of the base at a phase."""

    w: Jet
    height: Jet  # W
    slope: Jet  # w'


class ClosedFlight(NamedTuple):
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


class ClosedCycle(NamedTuple):
    """Equations and multipliers of an orbit, evaluated at a point or over a box."""

    off: list[Jet]  # residuals of the equations: errors of the speeds after the impacts
    flights: list[ClosedFlight]
    trace: Jet
    determinant: Jet
    obstacle: str  # reason why a particle may be unable to follow the orbit; "" if it can


def cycle(orbit: ClosedOrbit, z: Sequence[Jet]) -> ClosedCycle:
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
    return ClosedCycle(off, flights, m[0] + m[3], determinant, obstacle)


def _base_motion(wave: Wave, turns: Jet) -> BaseJets:
    """Motion of the base, with derivatives; the slope has none at a corner."""
    h = 2 * turns.v
    level, velocity, slope = wave.level(h), wave.velocity(h), wave.slope(h)
    jumps = wave.bounds.bend == 0 and slope.rad() > 0
    rate = arb("nan") if jumps else wave.rate(h)
    return BaseJets(
        Jet(velocity, [slope * d for d in turns.d]),
        Jet(level, [velocity * d for d in turns.d]),
        Jet(slope, [rate * d for d in turns.d]),
    )


def _impact(orbit: ClosedOrbit, v: Jet) -> tuple[Jet, Jet]:
    """Relative speed after an impact with the relative speed v, and its derivative by v."""
    law = orbit.law or Constant(orbit.e)
    slope = law.slope(v.v)
    bend = law.bend(v.v)
    return Jet(law.kept(v.v), [slope * d for d in v.d]), Jet(slope, [bend * d for d in v.d])


def _bounce(orbit: ClosedOrbit, a: Jet, s: Jet, first: BaseJets, last: BaseJets) -> ClosedFlight:
    """A flight of the high-bounce map."""
    kept, q = _impact(orbit, s)
    w, k = kept + a * last.w, a * last.slope
    if orbit.turns_back and w.v < 0:
        w, k, q = -w, -k, -q
    one = 0 * a + 1
    return ClosedFlight(s, s, s, w, (one, one, k, k + q), q, arb(1), "")


def _fly(orbit: ClosedOrbit, a: Jet, s: Jet, first: BaseJets, last: BaseJets) -> ClosedFlight:
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
    return ClosedFlight(y, leaves, v, w, step, shrinks, presses, meets)


def _meets_base(wave: Wave, alpha: arb, u: arb, height: arb) -> str:
    """Reason why a flight that begins with the absolute speed u may land earlier, or "".

    It cannot where its height above the base is concave, nor where the particle, when it comes down
    to the highest level of the base, falls faster than the base ever moves.
    """
    concave = alpha * wave.bounds.steep <= 2
    most, drop = alpha * wave.bounds.fast, alpha * (wave.bounds.top - height)
    fast = u > 0 and u * u >= 4 * drop + most * most
    return "" if concave or fast else EARLIER


BITS: Final = 160
NEWTON: Final = 6  # Newton steps for the middle of a box, from a double
SHARP: Final = arb(2) ** -60  # radius of the box from which an enclosure is narrowed
SHARPER: Final = 3  # number of steps that narrow it
WIDE: Final = (4, 5, 6, 8, 10, 12, 16, 20, 24, 30)  # radii 2^-w of boxes tried for a single root
OVERLAP: Final = 0.05  # of a piece of a branch with the next one
DEEPEST: Final = 12  # most halvings of a piece
ENLARGED: Final = 1.2  # radius of a box, relative to that of the points it should hold
TRIES: Final = 4  # boxes tried around a piece


@dataclass(frozen=True)
class Bifurcation:
    """A proved bifurcation."""

    multiplier: int
    box: Box  # holds it
    alone: Box  # holds no other one


class _System(NamedTuple):
    """Equations of an orbit, and one that sets a multiplier or the place along a direction."""

    orbit: ClosedOrbit
    multiplier: int = 0
    direction: Sequence[arb] = ()
    origin: Sequence[arb] = ()
    place: arb = arb(0)

    def at(self, z: Sequence[arb]) -> tuple[list[Jet], ClosedCycle]:
        """Equations at a point, or over a box."""
        point = variables(z)
        found = cycle(self.orbit, point)
        if self.multiplier:
            last = 1 - self.multiplier * found.trace + found.determinant
        else:
            last = Jet(arb(0), [arb(0)] * len(z)) - self.place
            for one, start, share in zip(point, self.origin, self.direction, strict=True):
                last = last + (one - start) * share
        return [*found.off, last], found


def _matrix(jets: Sequence[Jet]) -> arb_mat:
    return arb_mat([list(jet.d) for jet in jets])


def _inverse(system: _System, middle: Sequence[arb]) -> arb_mat | None:
    """Return an exact matrix near the inverse of the derivative; None if that may be singular."""
    try:
        return _matrix(system.at(middle)[0]).inv().mid()
    except ZeroDivisionError:
        return None


def _newton(system: _System, guess: Sequence[arb]) -> Box:
    """Approach a root by Newton's method, without proof."""
    z = [arb(one).mid() for one in guess]
    for _ in range(NEWTON):
        inverse = _inverse(system, z)
        if inverse is None:
            break
        values = arb_mat([[jet.v.mid()] for jet in system.at(z)[0]])
        step = inverse * values
        moved = [(one - step[i, 0]).mid() for i, one in enumerate(z)]
        if not all(one.is_finite() for one in moved):
            break
        z = moved
    return z


def _krawczyk(
    system: _System, middle: Sequence[arb], radii: Sequence[arb], tries: int = 1
) -> tuple[Box, Box] | None:
    """Return an enclosure of the only root in a box, and the box; None if there is no proof.

    Each further try takes the image of the previous box, slightly enlarged.
    """
    inverse = _inverse(system, middle)
    if inverse is None:
        return None
    n = len(middle)
    values = arb_mat([[jet.v] for jet in system.at(middle)[0]])
    moved = inverse * values
    unit = arb_mat([[int(i == k) for k in range(n)] for i in range(n)])
    for _ in range(tries):
        spread = [arb(0, radius.abs_upper()) for radius in radii]
        box = [m + s for m, s in zip(middle, spread, strict=True)]
        wide, _ = system.at(box)
        shrunk = (unit - inverse * _matrix(wide)) * arb_mat([[s] for s in spread])
        image = [m - moved[i, 0] + shrunk[i, 0] for i, m in enumerate(middle)]
        if all(b.contains_interior(k) for b, k in zip(box, image, strict=True)):
            return image, box
        if not all(one.is_finite() for one in image):
            return None
        radii = [ENLARGED * (k - m).abs_upper() + SHARP for k, m in zip(image, middle, strict=True)]
    return None


def prove_event(orbit: ClosedOrbit, multiplier: int, guess: Sequence[float]) -> Bifurcation | None:
    """Prove a bifurcation near a guess of landing times and kick; None where that fails."""
    with ctx.workprec(BITS):
        system = _System(orbit, multiplier)
        middle = _newton(system, [arb(one) for one in guess])
        box: Box | None = None
        radii: Sequence[arb] = [SHARP] * len(middle)
        for _ in range(SHARPER):
            proved = _krawczyk(system, middle, radii)
            if proved is None:
                break
            box = proved[0]
            middle, radii = [one.mid() for one in box], [2 * one.rad() for one in box]
        if box is None:
            return None
        for w in WIDE:
            size = arb(2) ** -w
            if _krawczyk(system, middle, [size] * len(middle)):
                alone = [m + arb(0, size) for m in middle]
                return Bifurcation(multiplier, box, alone)
        return Bifurcation(multiplier, box, box)


class ProvedOrbit(NamedTuple):
    """A proved orbit."""

    box: Box  # holds its landing times, and the kick
    cycle: ClosedCycle
    slopes: list[list[float]]  # moduli of derivatives of the times by errors of the equations


def prove_orbit(orbit: ClosedOrbit, guess: Sequence[float], kick: arb) -> ProvedOrbit | None:
    """Prove an orbit near a guess of its landing times, for all kicks in a ball."""
    with ctx.workprec(BITS):
        n = orbit.p + 1
        direction = [arb(int(i == n - 1)) for i in range(n)]
        origin = [arb(0)] * (n - 1) + [kick.mid()]
        system = _System(orbit, 0, direction, origin, kick - kick.mid())
        middle = _newton(system, [*(arb(one) for one in guess), kick.mid()])
        radii = [SHARP + kick.rad()] * n
        proved, inverse = _krawczyk(system, middle, radii, TRIES), _inverse(system, middle)
        if proved is None or inverse is None:
            return None
        box = proved[0]
        slopes = [[float(abs(inverse[i, k]).upper()) for k in range(n)] for i in range(n - 1)]
        return ProvedOrbit(box, cycle(orbit, variables(box)), slopes)


# Reasons why a branch is not covered
NOT_ENCLOSED: Final = "branch_not_enclosed"
NOT_ATTRACTING: Final = "attraction_not_proved"


class _Piece(NamedTuple):
    """A proved piece of a branch."""

    whole: Box  # in which there is no other orbit at the same place along the piece
    last: Box  # its last point
    met: tuple[Bifurcation, ...]


def cover(
    orbit: ClosedOrbit, points: Sequence[Sequence[float]], events: Sequence[Bifurcation]
) -> str:
    """Prove that the orbits of a branch exist and attract, apart from bifurcations at its ends.

    Points lie on the branch, close to each other, and begin and end with the events, where there
    are some.  The branch is cut into pieces, each a curve inside a box; neighbours share a point.
    Returns the reason why there is no proof, empty where there is one.
    """
    met: list[Bifurcation] = []
    with ctx.workprec(BITS):
        pending = [
            ([arb(a) for a in one], [arb(b) for b in other], 0)
            for one, other in zip(points[-2::-1], points[:0:-1], strict=True)
        ]
        joint: Box | None = None  # the point at the end of the piece before
        while pending:
            one, other, depth = pending.pop()
            piece = _piece(orbit, one, other, events, joint)
            if isinstance(piece, str):
                if depth == DEEPEST:
                    return piece
                middle = [((a + b) / 2).mid() for a, b in zip(one, other, strict=True)]
                pending += [(middle, other, depth + 1), (one, middle, depth + 1)]
                continue
            joint = piece.last
            met += piece.met
    return "" if all(event in met for event in events) else NOT_ENCLOSED


def _along(line: _System, at: Box) -> arb:
    """Place of a point along a piece."""
    parts = zip(line.direction, at, line.origin, strict=True)
    return sum((d * (b - m) for d, b, m in parts), arb(0))


def _holds(outer: Box, inner: Box) -> bool:
    return all(a.contains(b) for a, b in zip(outer, inner, strict=True))


def _piece(
    orbit: ClosedOrbit, one: Box, other: Box, events: Sequence[Bifurcation], joint: Box | None
) -> _Piece | str:
    """Prove that orbits between two points attract, and that the branch passes through a joint."""
    apart = [b - a for a, b in zip(one, other, strict=True)]
    length = sum((d * d for d in apart), arb(0)).sqrt().mid()
    direction = [(d / length).mid() for d in apart]
    half = (length / 2 * (1 + OVERLAP)).mid()
    start = [((a + b) / 2).mid() for a, b in zip(one, other, strict=True)]
    middle = _newton(_System(orbit, 0, direction, start), start)
    line = _System(orbit, 0, direction, middle)
    radii = [abs(d) * half * ENLARGED + SHARP for d in direction]
    proved = _krawczyk(line._replace(place=arb(0, half)), middle, radii, TRIES)
    tip = line._replace(place=(length / 2).mid())
    near = [m + d * tip.place for m, d in zip(middle, direction, strict=True)]
    last = _krawczyk(tip, _newton(tip, near), [SHARP] * len(middle))
    if proved is None or last is None:
        return NOT_ENCLOSED
    box, whole = proved

    def passes(point: Box) -> bool:
        return _holds(whole, point) and bool(abs(_along(line, point)) <= half)

    found, centre = cycle(orbit, variables(box)), cycle(orbit, variables(middle))
    if found.obstacle:
        return found.obstacle
    if not abs(found.determinant.v) < 1:
        return NOT_ATTRACTING
    for multiplier in (1, -1):
        over, at = (1 - multiplier * one.trace + one.determinant for one in (found, centre))
        change = zip(over.d, box, middle, strict=True)
        value = at.v + sum((d * (b - m) for d, b, m in change), arb(0))
        alone = any(_holds(e.alone, box) for e in events if e.multiplier == multiplier)
        if not (alone or value > 0):
            return NOT_ATTRACTING
    if joint is not None and not passes(joint):
        return NOT_ENCLOSED
    return _Piece(whole, last[0], tuple(event for event in events if passes(event.box)))
