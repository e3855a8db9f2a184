"""Flights over a moving base: cut where they meet it, and told from stays by their height.

Laws of restitution are then fitted to the contacts, together with the motion of the base.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from vibrosweep.arrays import Array, Indices
from vibrosweep.lab.contacts import Cut, contacts_between
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
from vibrosweep.lab.oscillation import (
    BaseFit,
    Problem,
    covariance_of_fit,
    fit_base,
    without_outliers,
)
from vibrosweep.lab.segments import Samples
from vibrosweep.lab.speed_laws import FITTED, FittedLaw, failed_fit, fit_law, with_speed

ROUNDS: Final = 3
# Steps in a period of the highest harmonic with which the end of a flight is sought, and
# bisections of the last step
STEPS: Final = 100
HALVINGS: Final = 40
# Quantile of the heights above the base that is the level of a particle without contacts
LOW: Final = 0.25


def flights_over(samples: Samples, cut: Cut, base_fit: BaseFit, exposure: float) -> Flights:
    """Find the flights over a moving base from a first fit of its motion, and refine that fit.

    `exposure` is the time for which the shutter was open (s).  Raises a TrackError if nothing
    flies, or if too few contacts are left.
    """
    member, fall = cut.member, cut.contacts.gravity
    free, trace = base_fit.problem.frequency is None, base_fit.problem.trace
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
        # a lift-off from rest has no kink: frames before it would distort the flight
        lifted = np.zeros(poor.size, bool)
        lifted[junctions.before[junctions.stayed] + 1] = True
        sound &= ~lifted[junctions.before]
        contacts = contacts_between(samples, member, fits, junctions.before[sound], noise, fall)
        base_fit = fit_base(
            contacts, base_fit.oscillation.frequency, free=free, moves=True, trace=trace
        )
    of_levels = slice(base_fit.values.size - base_fit.levels.size, None)
    spread = base_fit.covariance[of_levels, of_levels]
    return Flights(
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
        *measured_gravity(samples, member, fits.top(fall) - levels[owner], noise, fall),
        fall,
        base_fit,
        _fit_laws(base_fit),
    )


def _levels(base_fit: BaseFit, samples: Samples) -> Array:
    """Level below each particle; one that has no contacts is assumed to lie mostly on the base."""
    above = samples.height - base_fit.oscillation.height(samples.time)
    levels = np.array(
        [np.quantile(above[samples.particle == p], LOW) for p in range(samples.particle[-1] + 1)]
    )
    levels[base_fit.particles] = base_fit.levels
    return levels


def _keep_flights(
    samples: Samples, member: Indices, fits: Fits, below: Array, noise: float, fall: float
) -> tuple[Indices, Fits]:
    """Keep as flights the stretches that rise clearly above the base, whose heights are `below`."""
    path = fits.take(member).height(samples.time, fall)
    clear = np.full(fits.number.size, -np.inf)
    used = (member >= 0) & np.isfinite(path)
    np.maximum.at(clear, member[used], (path - below)[used])
    _, fits, member = keep_resolved(fits, clear > LEAST_HEIGHT * noise, member)
    return member, fits


def _ends(
    samples: Samples, member: Indices, fits: Fits, level: Array, base_fit: BaseFit, fall: float
) -> Ends:
    """Find the ends of each flight, outwards from its sample that is farthest above the base."""
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


def _fit_laws(base_fit: BaseFit) -> list[FittedLaw]:
    """Fit the laws of `FITTED` to the contacts of a moving base that are not outliers."""
    contacts = base_fit.problem.contacts
    speeds = base_fit.oscillation.velocity(contacts.time) - contacts.arrival
    speeds = np.maximum(speeds[base_fit.kept], 1e-6)
    return [
        fit_law(name, speeds, lambda law: _fit_law(base_fit.problem._replace(law=law), base_fit))
        for name in FITTED
    ]


def _fit_law(problem: Problem, base_fit: BaseFit) -> FittedLaw:
    law, start = problem.law, base_fit.values
    if law.parameters:
        start = np.append(start, np.log(law.speed))
    spread = np.sqrt(np.maximum(np.diag(base_fit.covariance), 1e-20))
    scale = np.append(spread, [0.1] * law.parameters)
    try:
        found, used = without_outliers(problem, start, scale, base_fit.kept)
    except np.linalg.LinAlgError:
        return failed_fit(law, base_fit.kept.size)
    covariance, misfit, freedom = covariance_of_fit(found)
    last = found.x.size - law.parameters
    of_law = np.r_[: problem.parameters, last : found.x.size]  # without the levels
    values, spread = with_speed(law, found.x[of_law], covariance[np.ix_(of_law, of_law)])
    return FittedLaw(
        law, values, spread, misfit, freedom, int(used.sum()), problem.distance(found.x)
    )
