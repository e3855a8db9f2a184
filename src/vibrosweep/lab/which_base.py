"""Whether the contacts of a recording favour a base that moves, or one that stays at its level."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.lab.contacts import Contacts
from vibrosweep.lab.flights import line_variance
from vibrosweep.lab.oscillation import Shaken, first_guess, fit_shaken
from vibrosweep.lab.regression import FEWEST, outside, weakest_signal, with_subharmonics

FREQUENCIES: Final = (1.0, 100.0)
# Contacts that are used: more hardly change the decision.
MOST: Final = 1000
# Standard deviations by which the mean difference of squared distances must differ from zero: of
# independent contacts that favour neither base one recording in 370 would be decided.
DECIDED: Final = 3.0

# Signal of the weakest direction below which nothing is fitted; noise alone makes at most 1.
LEAST_SIGNAL: Final = 3.0


class Judgement(NamedTuple):
    """Outcome of the comparison of both bases."""

    says: str  # ``"moving"``, ``"level"``, or ``"undetermined"``
    shaken: Shaken | None  # the base if it moves; None where there are too few contacts


def which_base(contacts: Contacts, frequency: float | None = None) -> Judgement:
    """Fit contacts with a base that moves and with one that stays at its level, and compare both.

    Neither is preferred where the contacts do not determine how the base moves, as those of a
    locked orbit, which all happen at one phase.  The frequency in Hz is sought where None.
    """
    few = contacts.first(MOST)
    if _too_few(few):
        return Judgement("undetermined", None)
    free = frequency is None
    speeds = (-few.arrival, few.departure, few.time)
    rates = with_subharmonics(speeds, FREQUENCIES) if frequency is None else [frequency]
    rates = [r for r in rates if signal_of(few, first_guess(few, r), r) >= LEAST_SIGNAL]
    if not rates:
        return Judgement("undetermined", None)
    shaken, still = (
        min((fit_shaken(few, r, free=free, moves=moves) for r in rates), key=_distance)
        for moves in (True, False)
    )
    return Judgement(_preferred(shaken, still), shaken)


def moves(contacts: Contacts, shaken: Shaken, *, free: bool) -> bool:
    """Whether contacts favour a base that moves and was fitted to them over one that does not.

    The frequency is adjusted where `free`, as it was for the base that moves.
    """
    if _too_few(contacts):
        return False
    still = fit_shaken(contacts, shaken.oscillation.frequency, free=free, moves=False)
    return _preferred(shaken, still) == "moving"


def _too_few(contacts: Contacts) -> bool:
    return bool(contacts.time.size < FEWEST + np.unique(contacts.particle).size)


def _preferred(shaken: Shaken, still: Shaken) -> str:
    """The base that describes the same contacts better, by the test of Vuong.

    Both models have the same number of parameters and neither contains the other.  That the mean
    difference of their squared distances is zero is tested against the scatter of the differences
    (Vuong 1989, Econometrica 57, 307): a few contacts that fit neither decide nothing, however far
    off they are.  Nor is a base preferred on which the restitution would be no restitution.
    """
    gain = still.distance - shaken.distance
    scatter = float(np.sqrt(np.sum((gain - gain.mean()) ** 2)))
    if not abs(gain.sum()) > DECIDED * scatter:
        return "undetermined"
    says, better = ("moving", shaken) if gain.sum() > 0.0 else ("level", still)
    return "undetermined" if _unphysical(better) else says


def _unphysical(shaken: Shaken) -> bool:
    return outside(shaken.restitution, float(np.sqrt(shaken.covariance[0, 0])))


def _distance(shaken: Shaken) -> tuple[bool, float]:
    return _unphysical(shaken), float(shaken.distance.sum())


def signal_of(contacts: Contacts, guess: Array, frequency: float) -> float:
    """As `weakest_signal`, of contacts with a guess of restitution, S and C (m s-1)."""
    time, before = contacts.time, contacts.before
    closing = contacts.departure - contacts.arrival
    when = line_variance(before, time) + line_variance(contacts.after, time)
    turn = 2.0 * np.pi * frequency
    blurs = contacts.noise**2 * np.stack([1.0 / before.spread, turn**2 * when / closing**2])
    amplitude = (1.0 + guess[0]) * float(np.hypot(guess[1], guess[2]))
    phase_blur, speed_blur = float(blurs[1].mean()), float(blurs[0].mean())
    return weakest_signal(-contacts.arrival, turn * time, amplitude, (speed_blur, phase_blur))
