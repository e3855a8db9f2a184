"""Decide from the contacts of a recording whether the base moves or has a constant level."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.lab.contacts import Contacts
from vibrosweep.lab.flights import line_variance
from vibrosweep.lab.oscillation import BaseFit, first_guess, fit_base
from vibrosweep.lab.regression import (
    FEWEST,
    Speeds,
    is_nearer,
    is_unphysical,
    weakest_signal,
    with_subharmonics,
)

FREQUENCIES: Final = (1.0, 100.0)
# Most contacts that are used; more hardly change the decision.
MOST: Final = 1000
# Weakest signal for which a base is fitted; that of noise alone is at most 1.
LEAST_SIGNAL: Final = 3.0


class Judgement(NamedTuple):
    """Outcome of the comparison of both bases."""

    favoured: str  # ``"moving"``, ``"level"``, or ``"undetermined"``
    moving: BaseFit | None  # fit of a moving base; None if there are too few contacts


def which_base(contacts: Contacts, frequency: float | None = None) -> Judgement:
    """Fit a moving base and one at a constant level to contacts, and compare both.

    The result is undetermined if the contacts do not determine the motion; those of a locked orbit,
    which all have one phase, do not.  A frequency (Hz) of None is estimated.
    """
    few = contacts.earliest(MOST)
    if _too_few(few):
        return Judgement("undetermined", None)
    free = frequency is None
    speeds = Speeds(-few.arrival, few.departure, few.time)
    rates = with_subharmonics(speeds, FREQUENCIES) if frequency is None else [frequency]
    rates = [r for r in rates if signal_of_contacts(few, first_guess(few, r), r) >= LEAST_SIGNAL]
    if not rates:
        return Judgement("undetermined", None)
    moving, level = (
        min((fit_base(few, r, free=free, moves=moves) for r in rates), key=_distance)
        for moves in (True, False)
    )
    return Judgement(_preferred(moving, level), moving)


def moves(contacts: Contacts, moving: BaseFit, *, free: bool) -> bool:
    """Return whether contacts favour the moving base fitted to them over one at a constant level.

    The frequency of the latter is fitted too if `free`, as that of the moving base was.
    """
    if _too_few(contacts):
        return False
    level = fit_base(contacts, moving.oscillation.frequency, free=free, moves=False)
    return _preferred(moving, level) == "moving"


def _too_few(contacts: Contacts) -> bool:
    return bool(contacts.time.size < FEWEST + np.unique(contacts.particle).size)


def _preferred(moving: BaseFit, level: BaseFit) -> str:
    """Return the base that describes the same contacts significantly better, by Vuong's test.

    Both models have the same number of parameters, and neither contains the other.  A base that
    implies an unphysical restitution is never preferred.
    """
    for favoured, better, worse in (("moving", moving, level), ("level", level, moving)):
        if is_nearer(better.distance, worse.distance):
            return "undetermined" if is_unphysical(better.values, better.covariance) else favoured
    return "undetermined"


def _distance(moving: BaseFit) -> tuple[bool, float]:
    return is_unphysical(moving.values, moving.covariance), float(moving.distance.sum())


def signal_of_contacts(contacts: Contacts, guess: Array, frequency: float) -> float:
    """Compute the `weakest_signal` of contacts, with a guess of restitution, S and C (m s-1)."""
    time, before = contacts.time, contacts.before
    closing = contacts.departure - contacts.arrival
    when = line_variance(before, time) + line_variance(contacts.after, time)
    turn = 2.0 * np.pi * frequency
    speed, phase = contacts.noise**2 * np.stack([1.0 / before.spread, turn**2 * when / closing**2])
    amplitude = (1.0 + guess[0]) * float(np.hypot(guess[1], guess[2]))
    variances = float(speed.mean()), float(phase.mean())
    return weakest_signal(-contacts.arrival, turn * time, amplitude, *variances)
