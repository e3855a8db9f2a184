"""Contacts with the base: intersections of neighbouring flights, wherever the base is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.arrays import Array, Flags, Indices
from vibrosweep.lab.flights import Fits, fit_parabolas, gravity_of_high_flights, meet
from vibrosweep.lab.regression import Speeds
from vibrosweep.lab.segments import Samples
from vibrosweep.lab.stretches import clear_flights, stretches


class Contacts(NamedTuple):
    """Bounces between flights that are clearly resolved; arrays of shape (contact,)."""

    # before, after: the flights on both sides
    before: Fits
    after: Fits
    particle: Indices  # number of the particle
    linked: Flags  # True if the next contact ends the flight that begins at this one
    # time, height: where the parabolas meet, s and m
    time: Array
    height: Array
    # arrival, departure: velocities there, m s-1
    arrival: Array
    departure: Array
    noise: float  # standard deviation of a sample, m
    gravity: float  # curvature of the parabolas, m s-2

    @property
    def speeds(self) -> Speeds:
        """Speeds of arrival and departure, and the times."""
        return Speeds(-self.arrival, self.departure, self.time)

    def take(self, chosen: Flags) -> Contacts:
        """Return the chosen contacts; a link ends where the next contact is left out."""
        linked = self.linked & np.append(chosen, False)[1:]
        columns = {"particle", "time", "height", "arrival", "departure"}
        return self._replace(
            before=self.before.take(chosen),
            after=self.after.take(chosen),
            linked=linked[chosen],
            **{name: getattr(self, name)[chosen] for name in columns},
        )

    def earliest(self, number: int) -> Contacts:
        """Return the earliest `number` of contacts, or all if there are no more."""
        if self.time.size <= number:
            return self
        return self.take(self.time <= np.partition(self.time, number - 1)[number - 1])


class Cut(NamedTuple):
    """Tracks cut into stretches of flight, and the contacts between them."""

    contacts: Contacts
    member: Indices  # number of the stretch of each sample
    # fall, error: acceleration with which high stretches fall, and its standard error, m s-2
    fall: float
    error: float


def find_contacts(samples: Samples, gravity: float) -> Cut:
    """Find contacts with the base; flights fall with the acceleration `gravity` (m s-2)."""
    member, noise = stretches(samples, gravity)
    start = np.flatnonzero(np.diff(member, prepend=-1))
    extent = np.maximum.reduceat(samples.height, start)
    extent -= np.minimum.reduceat(samples.height, start)
    found = gravity_of_high_flights(samples, member, extent, noise)  # high stretches are not stays
    fits = fit_parabolas(samples, member, start.size, gravity)
    every = np.flatnonzero(np.diff(samples.piece[start]) == 0)
    return Cut(contacts_between(samples, member, fits, every, noise, gravity), member, *found)


def contacts_between(
    samples: Samples, member: Indices, fits: Fits, landing: Indices, noise: float, fall: float
) -> Contacts:
    """Contacts between the flights numbered `landing` and those that follow them.

    Contacts beside a flight that is not clearly resolved are left out.  `member` is the number of
    the flight of each sample, -1 for none; `noise` the standard deviation of a sample (m), `fall`
    the acceleration of flights (m s-2).
    """
    clear = clear_flights(samples, member, fits, noise, fall)
    # noise of flights alone, because residuals of a stay would enlarge it
    free = fits.number[clear] - 2.0
    noise = float(np.sqrt(fits.residue[clear].sum() / free.sum())) if free.size else noise
    landing = landing[clear[landing] & clear[landing + 1]]
    before, after = fits.take(landing), fits.take(landing + 1)
    met = meet(before, after, (before.centre + after.centre) / 2.0, fall)
    arrival = before.slope - fall * (met.time - before.centre)
    departure = arrival + met.closing
    owner = np.zeros(fits.number.size, np.intp)
    owner[member[member >= 0]] = samples.particle[member >= 0]
    linked = np.append(np.diff(landing) == 1, False)[: landing.size]
    found = Contacts(
        before, after, owner[landing], linked, met.time, met.height, arrival, departure, noise, fall
    )
    # between two parts of one flight there is no contact: their slopes differ only by rounding
    return found.take(departure > arrival)
