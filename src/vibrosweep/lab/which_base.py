"""Whether the contacts of a recording favour a base that moves, or one that stays at its level."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.lab.contacts import Contacts
from vibrosweep.lab.flights import line_variance
from vibrosweep.lab.oscillation import Shaken, first_guess, fit_shaken
from vibrosweep.lab.regression import FEWEST, weakest_signal, with_subharmonics

FREQUENCIES: Final = (1.0, 100.0)
# Contacts that are used: more hardly change the decision.
MOST: Final = 1000
# Difference of chi-square at which one base is preferred: likelihoods in the ratio of 2e4.
DECIDED: Final = 20.0

# Signal of the weakest direction below which nothing is fitted; noise alone makes at most 1.
LEAST_SIGNAL: Final = 3.0


class Judgement(NamedTuple):
    """Outcome of the comparison of both bases."""

    says: str  # ``"moving"``, ``"level"``, or ``"undetermined"``
    shaken: Shaken | None  # the base if it moves; None where there are too few contacts
    # Chi-square of the base that stays at its level less that of the one that moves
    advantage: float


def which_base(contacts: Contacts, frequency: float | None = None) -> Judgement:
    """Fit contacts with a base that moves and with one that stays at its level, and compare both.

    Both have the same number of parameters.  Neither is preferred where the contacts do not
    determine how the base moves, as those of a locked orbit, which all happen at one phase.  The
    frequency in Hz is sought where None.
    """
    few = contacts.first(MOST)
    if few.time.size < FEWEST + np.unique(few.particle).size:
        return Judgement("undetermined", None, 0.0)
    free = frequency is None
    speeds = (-few.arrival, few.departure, few.time)
    rates = with_subharmonics(speeds, FREQUENCIES) if frequency is None else [frequency]
    rates = [r for r in rates if signal_of(few, first_guess(few, r), r) >= LEAST_SIGNAL]
    if not rates:
        return Judgement("undetermined", None, 0.0)
    shaken, still = (
        min((fit_shaken(few, r, free=free, moves=moves) for r in rates), key=_distance)
        for moves in (True, False)
    )
    better = shaken if shaken.distance < still.distance else still
    advantage = (still.distance - shaken.distance) / max(better.misfit, 1.0)
    if abs(advantage) < DECIDED:
        return Judgement("undetermined", shaken, advantage)
    return Judgement("moving" if advantage > 0.0 else "level", shaken, advantage)


def _distance(shaken: Shaken) -> float:
    return shaken.distance


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
