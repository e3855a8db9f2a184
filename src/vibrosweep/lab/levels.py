"""A base that stays at its level, but at another one below each particle: a tilted base or view.

Free flight does not depend on the level: each particle's track is moved by the difference of its
level to the common one, the flights are found, and everything is moved back.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from vibrosweep.lab.contacts import Contacts
from vibrosweep.lab.flight_search import POOR, Flights, find_flights
from vibrosweep.lab.flights import meet
from vibrosweep.lab.junctions import base_level
from vibrosweep.lab.segments import Samples

__all__ = ["flights_on_levels"]

Array = NDArray[np.float64]

ROUNDS: Final = 2


def flights_on_levels(
    samples: Samples, contacts: Contacts, gravity: float, exposure: float = 0.0
) -> Flights:
    """Find flights, with a level for each particle where the landings contradict a common one.

    They do so where the chi-square of the levels about their mean has a probability below that of a
    poor flight.  A particle of which too little is seen gets the mean level.

    Parameters
    ----------
    samples, gravity, exposure
        As of `find_flights`.
    contacts
        Bounces in the same samples, found without a level.

    Raises
    ------
    TrackError
        As of `find_flights`.
    """
    seen = meet(contacts.before, contacts.after, contacts.time, contacts.gravity)
    spread = contacts.noise * np.sqrt(seen.height_variance)
    count = int(samples.particle[-1]) + 1
    shift, error = _levels(contacts.particle, contacts.height, spread, count)
    if not error.any():
        return find_flights(samples, gravity, None, exposure)
    for _ in range(ROUNDS):
        moved = replace(samples, height=samples.height - shift[samples.particle])
        flights = _raised(find_flights(moved, gravity, None, exposure), shift)
        joint = flights.junctions
        owner = flights.particle[joint.before]
        shift, error = _levels(owner, joint.height, joint.height_error, count)
    middle = np.mean(error[error > 0.0]) if error.any() else flights.base_error
    return flights._replace(base_error=float(middle))


def _levels(
    owner: NDArray[np.intp], height: Array, spread: Array, count: int
) -> tuple[Array, Array]:
    """Level below each particle less their mean, and its standard error; 0 where they agree."""
    each = [base_level(height[owner == p], spread[owner == p], np.nan) for p in range(count)]
    level, error = np.array(each).T
    known = np.isfinite(error)
    weight = error[known] ** -2.0
    off = level - (weight @ level[known] / weight.sum() if known.any() else np.nan)
    chi_square = float(weight @ off[known] ** 2)
    if known.sum() < 2 or chi_square < chdtri(known.sum() - 1.0, POOR):
        return np.zeros(count), np.zeros(count)
    return np.where(known, off, 0.0), np.where(known, error, 0.0)


def _raised(flights: Flights, shift: Array) -> Flights:
    """Flights of moved tracks, where the tracks are."""
    own, joint = shift[flights.particle], flights.junctions
    levels = flights.levels + shift
    return flights._replace(
        fits=flights.fits._replace(level=flights.fits.level + own),
        junctions=joint._replace(height=joint.height + own[joint.before]),
        levels=levels,
        base=float(levels.mean()),
    )
