"""A base at a constant level that differs from particle to particle: a tilted base or view.

Free flight does not depend on the level: the track of each particle is shifted by the difference of
its level from the common one, the flights are found, and everything is shifted back.  Flights
beside a stay meet below the base, and on a periodic orbit all at the same height.  If all bounces
of a particle are alike, a low level can therefore not be told from stays, and is replaced by the
common level.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from vibrosweep.arrays import Array
from vibrosweep.lab.contacts import Contacts
from vibrosweep.lab.flight_search import POOR, Flights, find_flights
from vibrosweep.lab.flights import meet
from vibrosweep.lab.junctions import ON_BASE, base_level
from vibrosweep.lab.segments import Samples

# Relative scatter of speeds from which bounces are not alike, many times the effect of noise
DIFFERENT: Final = 0.05


def flights_on_levels(
    samples: Samples, contacts: Contacts, gravity: float, exposure: float = 0.0
) -> Flights:
    """Find flights, with a level for each particle if the bounces contradict a common one.

    The bounces contradict it if the chi-square of the levels about their mean is as improbable as
    that of a poor flight.  The contacts are those of the same samples, found without a level; the
    other arguments are those of `find_flights`.
    """
    level, error, alike = _levels(contacts, int(samples.particle[-1]) + 1)
    known = np.isfinite(error) & ~alike
    known |= alike & (level > _mean(level[known], error[known]))
    off = level - _mean(level[known], error[known])
    chi_square = float(np.sum((off[known] / error[known]) ** 2))
    if known.sum() < 2 or chi_square < chdtri(known.sum() - 1.0, POOR):
        return find_flights(samples, gravity, None, exposure)
    shift = np.where(known, off, 0.0)
    moved = replace(samples, height=samples.height - shift[samples.particle])
    found = find_flights(moved, gravity, None, exposure)
    by_flight, joint = shift[found.particle], found.junctions
    return found._replace(
        fits=found.fits._replace(level=found.fits.level + by_flight),
        junctions=joint._replace(height=joint.height + by_flight[joint.before]),
        levels=found.levels + shift,
        base=float(np.mean(found.levels + shift)),
        base_error=float(np.mean(error[known])),
    )


def _mean(level: Array, error: Array) -> float:
    return float(np.average(level, weights=error**-2.0)) if level.size else float("nan")


def _levels(contacts: Contacts, count: int) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Level (m) at which each particle bounces, its standard error, and whether bounces are alike.

    Level and error are NaN for a particle with too few bounces.
    """
    met = meet(contacts.before, contacts.after, contacts.time, contacts.gravity)
    spread = contacts.noise * np.sqrt(met.height_variance)
    level, error = np.full((2, count), np.nan)
    alike, closing = np.zeros(count, np.bool_), contacts.departure - contacts.arrival
    for p in range(count):
        chosen = contacts.particle == p
        height, speed = contacts.height[chosen], closing[chosen]
        level[p], error[p] = base_level(height, spread[chosen], np.nan)
        speed = speed[np.abs(height - level[p]) < ON_BASE * spread[chosen]]
        alike[p] = speed.size > 0 and speed.std() < DIFFERENT * speed.mean()
    return level, error, alike
