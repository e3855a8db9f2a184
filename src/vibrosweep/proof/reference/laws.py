"""Laws of rebound in ball arithmetic: the speed kept at an impact, and the turning back.

The speed after an impact is w = kept + kick.  Where w is negative the particle is pushed into the
base: it rests, or the law turns it back with the speed -w.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

from vibrosweep.model.outside_laws import OUTSIDE
from vibrosweep.model.outside_laws import Law as OutsideLaw
from vibrosweep.proof.reference._flint import arb


class Law(NamedTuple):
    """A law of rebound."""

    # Speed kept, from restitution, speed of arrival, and the speed whose flight lasts one forcing
    # period, in the same unit
    kept: Callable[[arb, arb, arb], arb]
    slope: Callable[[arb, arb, arb], arb]  # derivative of `kept` by the speed of arrival
    # Bound of the modulus of the second derivative, from the restitution; speeds are in units of
    # that whose flight lasts one forcing period
    bend: Callable[[float], float]
    turns_back: bool  # True if a particle that is pushed into the base is turned back


def _share(restitution: arb, speed: arb, unit: arb) -> arb:
    return restitution * speed


def _restitution(restitution: arb, speed: arb, unit: arb) -> arb:
    return restitution


def _straight(restitution: float) -> float:
    return 0.0


def law_of(name: str) -> Law:
    """Return a law by its name, one from outside the package as it is at this moment."""
    return LAW_OF[name] if name in LAW_OF else _from_outside(OUTSIDE[name])


def _from_outside(law: OutsideLaw) -> Law:
    kept, slope = law.ball_kept or law.kept, law.ball_slope or law.slope
    return Law(
        lambda e, v, unit: kept(e, v / unit) * unit,
        lambda e, v, unit: slope(e, v / unit),
        law.bend,
        turns_back=False,
    )


LAW_OF: Final[Mapping[str, Law]] = {
    "rest": Law(_share, _restitution, _straight, turns_back=False),
    "reflect": Law(_share, _restitution, _straight, turns_back=True),
}
