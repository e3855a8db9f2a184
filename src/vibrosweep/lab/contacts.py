"""Where neighbouring flights meet: contacts with the base, whatever its height is then."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from vibrosweep.arrays import Array, Flags, Indices
from vibrosweep.lab.flights import Fits, apparent_gravity, fit, meet, scale_is_off
from vibrosweep.lab.segments import Samples
from vibrosweep.lab.stretches import clear_flights, stretches

# Stretches at least half as high as this quantile are flights.
HIGH: Final = 0.95


class Contacts(NamedTuple):
    """Bounces between two flights that are clearly seen; arrays of shape (contact,)."""

    # before, after: the flights
    before: Fits
    after: Fits
    particle: Indices  # the particle of each
    linked: Flags  # whether the next contact ends the flight that this one begins
    # time, height: where the parabolas meet, s and m
    time: Array
    height: Array
    # arrival, departure: velocities there, m s-1
    arrival: Array
    departure: Array
    noise: float  # standard deviation of a sample, m
    gravity: float  # curvature of the parabolas, m s-2

    def first(self, number: int) -> Contacts:
        """The earliest contacts of all particles, at most so many."""
        if self.time.size <= number:
            return self
        chosen = self.time <= np.partition(self.time, number - 1)[number - 1]
        # the next contact of the same particle is chosen too, or ends the chain
        linked = self.linked[chosen] & np.append(chosen[1:], False)[chosen]
        return self._replace(
            before=self.before.take(chosen),
            after=self.after.take(chosen),
            particle=self.particle[chosen],
            linked=linked,
            time=self.time[chosen],
            height=self.height[chosen],
            arrival=self.arrival[chosen],
            departure=self.departure[chosen],
        )


def find_contacts(samples: Samples, gravity: float) -> tuple[Contacts, Indices]:
    """Find contacts with the base, and the stretch of track that each sample is in.

    Gravity is the true acceleration in m s-2; where the tracks clearly contradict it, theirs is
    taken.
    """
    fall = gravity
    for _ in range(2):
        member, noise = stretches(samples, fall)
        start = np.flatnonzero(np.diff(member, prepend=-1))
        # high stretches, which are no stays on the base
        extent = np.maximum.reduceat(samples.height, start)
        extent -= np.minimum.reduceat(samples.height, start)
        high = extent > np.quantile(extent, HIGH) / 2.0
        seen, error = apparent_gravity(samples, np.where(high[member], member, -1), start.size)
        if not scale_is_off(seen, error, fall):
            break
        fall = seen
    fits = fit(samples, member, start.size, fall)
    every = np.diff(samples.piece[start]) == 0
    return contacts_between(samples, member, fits, np.flatnonzero(every), (noise, fall)), member


def contacts_between(
    samples: Samples, member: Indices, fits: Fits, place: Indices, scale: tuple[float, float]
) -> Contacts:
    """Contacts between flights `place` and the next ones, where both are clearly seen.

    `member` is the number of the flight of each sample, -1 for none; `scale` the standard deviation
    of a sample (m), and the curvature of flights (m s-2).
    """
    noise, fall = scale
    clear = clear_flights(samples, member, fits, noise, fall)
    # pooled over flights alone, which a stay does not enlarge
    free = fits.number[clear] - 2.0
    noise = float(np.sqrt(fits.residue[clear].sum() / free.sum())) if free.size else noise
    place = place[clear[place] & clear[place + 1]]
    before, after = fits.take(place), fits.take(place + 1)
    met = meet(before, after, (before.centre + after.centre) / 2.0, fall)
    arrival = before.slope - fall * (met.time - before.centre)
    departure = arrival + met.closing
    # above rounding: between the halves of one flight there is no contact
    opening = departure > arrival
    place, before, after = place[opening], before.take(opening), after.take(opening)
    owner = np.zeros(fits.number.size, np.intp)
    owner[member[member >= 0]] = samples.particle[member >= 0]
    linked = np.append(np.diff(place) == 1, False)[: place.size]
    return Contacts(
        before=before,
        after=after,
        particle=owner[place],
        linked=linked,
        time=met.time[opening],
        height=met.height[opening],
        arrival=arrival[opening],
        departure=departure[opening],
        noise=noise,
        gravity=fall,
    )
