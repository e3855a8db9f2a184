"""Decide from the contacts of a recording whether the base moves or has a constant level."""

from __future__ import annotations

from typing import Final

import numpy as np

from vibrosweep.lab.contacts import Contacts
from vibrosweep.lab.flights import line_variance
from vibrosweep.lab.oscillation import BaseFit, fit_base
from vibrosweep.lab.regression import (
    FEWEST,
    frequencies_to_try,
    is_nearer,
    is_unphysical,
    ordinary_least_squares,
    weakest_signal,
)

FREQUENCIES: Final = (1.0, 100.0)
# Most contacts that are used; more hardly change the decision.
MOST: Final = 1000
# Weakest signal for which a base is fitted; that of noise alone is at most 1.
LEAST_SIGNAL: Final = 3.0


def which_base(contacts: Contacts, frequency: float | None = None) -> tuple[str, BaseFit | None]:
    """Fit a moving base and one at a constant level to contacts, and compare both.

    Returns ``"moving"``, ``"level"`` or ``"undetermined"``, and the fit of a moving base; None for
    contacts that do not determine the motion, such as those of a locked orbit, all at one phase.
    The frequency (Hz) is estimated if it is None.
    """
    few = contacts.earliest(MOST)
    if _too_few(few):
        return "undetermined", None
    free = frequency is None
    rates = frequencies_to_try(few.speeds, frequency, FREQUENCIES)
    rates = [rate for rate in rates if _signal(few, rate) >= LEAST_SIGNAL]
    if not rates:
        return "undetermined", None
    moving, level = (
        min((fit_base(few, r, free=free, moves=moves) for r in rates), key=_distance)
        for moves in (True, False)
    )
    return _preferred(moving, level), moving


def moves(moving: BaseFit) -> bool:
    """Return whether a moving base describes its contacts better than one at a constant level."""
    contacts, free = moving.problem.contacts, moving.problem.frequency is None
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


def _signal(contacts: Contacts, frequency: float) -> float:
    """Compute the `weakest_signal` of contacts, whose speeds are slopes of parabolas."""
    time, before, speeds = contacts.time, contacts.before, contacts.speeds
    closing = contacts.departure - contacts.arrival
    when = line_variance(before, time) + line_variance(contacts.after, time)
    speed_variance, time_variance = contacts.noise**2 * np.stack(
        [1.0 / before.spread, when / closing**2]
    )
    kick = ordinary_least_squares(speeds, frequency)[1:]
    return weakest_signal(speeds, frequency, kick, speed_variance, time_variance)
