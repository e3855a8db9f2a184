"""Closed orbits, their bifurcations and branches of them, proved by Krawczyk's method.

The equations are those of `vibrosweep.proof.reference.orbit_equations`.  The multipliers of an
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

from vibrosweep.proof.reference._flint import arb, arb_mat, ctx
from vibrosweep.proof.reference.jets import Jet, variables
from vibrosweep.proof.reference.orbit_equations import Box, Cycle, Orbit, cycle

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
class Event:
    """A proved bifurcation."""

    multiplier: int
    box: Box  # holds it
    alone: Box  # holds no other one


class _System(NamedTuple):
    """Equations of an orbit, and one that sets a multiplier or the place along a direction."""

    orbit: Orbit
    multiplier: int = 0
    direction: Sequence[arb] = ()
    origin: Sequence[arb] = ()
    place: arb = arb(0)

    def at(self, z: Sequence[arb]) -> tuple[list[Jet], Cycle]:
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


def prove_event(orbit: Orbit, multiplier: int, guess: Sequence[float]) -> Event | None:
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
                return Event(multiplier, box, alone)
        return Event(multiplier, box, box)


class Proved(NamedTuple):
    """A proved orbit."""

    box: Box  # holds its landing times, and the kick
    cycle: Cycle
    slopes: list[list[float]]  # moduli of derivatives of the times by errors of the equations


def prove_orbit(orbit: Orbit, guess: Sequence[float], kick: arb) -> Proved | None:
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
        return Proved(box, cycle(orbit, variables(box)), slopes)


# Reasons why a branch is not covered
NOT_ENCLOSED: Final = "branch_not_enclosed"
NOT_ATTRACTING: Final = "attraction_not_proved"


class _Piece(NamedTuple):
    """A proved piece of a branch."""

    whole: Box  # in which there is no other orbit at the same place along the piece
    last: Box  # its last point
    met: tuple[Event, ...]


def cover(orbit: Orbit, points: Sequence[Sequence[float]], events: Sequence[Event]) -> str:
    """Prove that the orbits of a branch exist and attract, apart from bifurcations at its ends.

    Points lie on the branch, close to each other, and begin and end with the events, where there
    are some.  The branch is cut into pieces, each a curve inside a box; neighbours share a point.
    Returns the reason why there is no proof, empty where there is one.
    """
    met: list[Event] = []
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
    orbit: Orbit, one: Box, other: Box, events: Sequence[Event], joint: Box | None
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
