"""Flights over a moving base, which are cut at the base and rise higher than stays."""

from __future__ import annotations

from typing import Final

import numpy as np

from vibrosweep.arrays import Array, Indices
from vibrosweep.lab.contacts import Contacts, contacts_between
from vibrosweep.lab.flight_search import (
    LEAST_HEIGHT,
    Flights,
    assign_samples,
    flight_noise,
    keep_resolved,
    poor_flights,
)
from vibrosweep.lab.flights import Ends, Fits, fit_parabolas, measured_gravity
from vibrosweep.lab.junctions import join
from vibrosweep.lab.moving_laws import fit_laws
from vibrosweep.lab.oscillation import BaseFit, Trace, fit_base
from vibrosweep.lab.segments import Samples

ROUNDS: Final = 3
# Steps in a period of the highest harmonic with which the end of a flight is sought, and
# bisections of the last step
STEPS: Final = 100
HALVINGS: Final = 40
# Quantile of the heights above the base that is the level of a particle without contacts
LOW: Final = 0.25


def flights_over(
    samples: Samples,
    member: Indices,
    base_fit: BaseFit,
    fall: float,
    *,
    exposure: float = 0.0,
    free: bool = False,
    trace: Trace | None = None,
) -> tuple[Flights, Contacts]:
    """Find the flights over a moving base with a first fit of its motion, and fit that again.

    Returns the flights, and the contacts between them to which the motion was fitted.

    `member` is the number of the stretch of each sample, `fall` the acceleration of flights (m
    s-2), `exposure` the time for which the shutter was open (s); `free` and `trace` are those of
    `fit_base`.  Raises a TrackError if nothing flies, or if too few contacts are left.
    """
    noise = np.inf
    for turn in range(ROUNDS):
        levels = _levels(base_fit, samples)
        below = levels[samples.particle] + base_fit.oscillation.height(samples.time)
        fits = fit_parabolas(samples, member, int(member.max()) + 1, fall)
        noise = min(noise, flight_noise(fits, float(np.ptp(samples.height))))
        member, fits = _keep_flights(samples, member, fits, below, noise, fall)
        start = np.flatnonzero(np.diff(np.maximum.accumulate(member), prepend=-1))
        piece, owner = samples.piece[start], samples.particle[start]
        ends = _ends(samples, member, fits, levels[owner], base_fit, fall)
        junctions = join(fits, piece, ends, noise, fall)
        if turn < ROUNDS - 1:
            member = assign_samples(samples, piece, junctions, ends, exposure)
        poor = poor_flights(fits, noise)
        sound = ~(junctions.stayed | junctions.overlapping)
        sound &= ~(poor[junctions.before] | poor[junctions.before + 1])
        # a particle lifts off from rest without a kink: frames before that would bend the flight
        lifted = np.zeros(poor.size, bool)
        lifted[junctions.before[junctions.stayed] + 1] = True
        sound &= ~lifted[junctions.before]
        contacts = contacts_between(samples, member, fits, junctions.before[sound], noise, fall)
        base_fit = fit_base(
            contacts, base_fit.oscillation.frequency, free=free, moves=True, trace=trace
        )
    acceleration, acceleration_error = measured_gravity(
        samples, member, fits.top(fall) - levels[owner], noise, fall
    )
    of_levels = slice(base_fit.values.size - base_fit.levels.size, None)
    spread = base_fit.covariance[of_levels, of_levels]
    flights = Flights(
        fits,
        piece,
        owner,
        member,
        poor,
        ends,
        junctions,
        levels,
        float(np.mean(base_fit.levels)),
        float(np.sqrt(spread.sum())) / base_fit.levels.size,
        noise,
        acceleration,
        acceleration_error,
        fall,
        base_fit,
        fit_laws(contacts, base_fit, free=free, trace=trace),
    )
    return flights, contacts


def _levels(base_fit: BaseFit, samples: Samples) -> Array:
    """Level below each particle; one without contacts is assumed to lie mostly on the base."""
    above = samples.height - base_fit.oscillation.height(samples.time)
    levels = np.array(
        [np.quantile(above[samples.particle == p], LOW) for p in range(samples.particle[-1] + 1)]
    )
    levels[base_fit.particles] = base_fit.levels
    return levels


def _keep_flights(
    samples: Samples, member: Indices, fits: Fits, below: Array, noise: float, fall: float
) -> tuple[Indices, Fits]:
    """Keep the stretches that rise clearly above the base, at the heights `below`, as flights."""
    path = fits.take(member).height(samples.time, fall)
    clear = np.full(fits.number.size, -np.inf)
    used = (member >= 0) & np.isfinite(path)
    np.maximum.at(clear, member[used], (path - below)[used])
    _, fits, member = keep_resolved(fits, clear > LEAST_HEIGHT * noise, member)
    return member, fits


def _ends(
    samples: Samples, member: Indices, fits: Fits, level: Array, base_fit: BaseFit, fall: float
) -> Ends:
    """Find the ends of each flight at the base, outwards from its sample farthest above it."""
    base = base_fit.oscillation
    used = member >= 0
    flight, when = member[used], samples.time[used]
    clear = samples.height[used] - level[flight] - base.height(when)
    order = np.lexsort((clear, flight))
    top = when[order[np.searchsorted(flight[order], np.arange(fits.number.size), side="right") - 1]]

    def above(time: Array) -> Array:
        return np.asarray(fits.height(time, fall) - level - base.height(time))

    found = []
    for way in (-1.0, 1.0):
        step = way / (STEPS * max(base.numbers) * base.frequency)
        inner, outer = top.copy(), top + step
        while (flies := above(outer) > 0.0).any():
            inner, outer = np.where(flies, outer, inner), np.where(flies, outer + step, outer)
        for _ in range(HALVINGS):
            middle = (inner + outer) / 2.0
            flies = above(middle) > 0.0
            inner, outer = np.where(flies, middle, inner), np.where(flies, outer, middle)
        velocity = fits.slope - fall * (inner - fits.centre) - base.velocity(inner)
        found.append((inner, np.abs(velocity)))
    (up, rise), (down, lands) = found
    return Ends(up, down, rise, lands)
