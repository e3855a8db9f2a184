"""Orbits of particles that share a slot of a locked orbit, on a base of finite mass.

Units and symbols are those of `vibrosweep.theory.sprung`, whose text derives the patterns.
"""

from __future__ import annotations

import numpy as np

from vibrosweep.theory.sprung import (
    after,
    find_cycle,
    landing_phase,
    mount_propagator,
    reversing_separation,
    steepness,
)

SAMPLES = 500  # per period
ROUNDING = 1e-12


def pattern(base, k, rank):
    """Return the landing times of particles in one slot that repeat a sequence of orders.

    The times, in periods from the mean of each landing, are those to first order in the mass ratio.
    `rank`, of the same shape (landing, particle), is the number of particles that land before each
    particle.  Returns None if there is no such pattern: the times do not have the assumed order, or
    mode k is not stable at mu = 0.
    """
    order = np.asarray(rank)
    e, gamma, mu, _, _ = base
    if np.isnan(reversing_separation(k, e, gamma, mu)):
        return None
    s = float(steepness(k, e, gamma))
    z = np.exp(2j * np.pi * np.fft.fftfreq(order.shape[0]))
    polynomial = z * z - (1.0 + e * e - (1.0 + e) ** 2 * s) * z + e * e
    response = -z * k * mu * (1.0 + e) ** 2 / polynomial
    spectrum = np.fft.fft(order - 0.5 * (order.shape[1] - 1), axis=0)
    times = np.fft.ifft(response[:, np.newaxis] * spectrum, axis=0).real
    reproduced = np.argsort(np.argsort(times, axis=1), axis=1)
    return times if np.array_equal(reproduced, order) else None


def pattern_orbit(base, k, rank):
    """Find the exact orbit close to a pattern; raises a ParameterError if there is none."""
    landings, particles = np.shape(rank)
    phase = float(landing_phase(base.acceleration, k, base.restitution, *base[2:]))
    times = phase + k * np.arange(landings)[:, np.newaxis] + pattern(base, k, rank)
    places = np.argsort(times.ravel())
    numbers = np.tile(np.arange(particles), landings)[places]
    return find_cycle(base, k, times.ravel()[places], numbers, k * landings)


def pair_gaps(cycle):
    """Gaps of the two particles of an orbit at their landings, sorted."""
    return np.sort(np.diff(cycle.time)[::2])


def is_clear(cycle):
    """Return whether every particle stays above the base between its impacts.

    Only 500 instants of each period are compared, so that a graze may be missed.
    """
    base, periods = cycle.base, cycle.periods
    at = cycle.time[-1] - periods + (np.arange(SAMPLES * periods) + 0.5) / SAMPLES
    last, since = _since(cycle.time, at, periods)
    struck = [after(base, d, c) for d, c in zip(cycle.deviation, cycle.approach, strict=True)]
    free = mount_propagator(base.natural, base.damping, since)
    surface = base.drive(at)[0] + (free @ np.array(struck)[last, :, np.newaxis])[:, 0, 0]
    height = base.drive(cycle.time)[0] + cycle.deviation[:, 0]
    for i in np.unique(cycle.particle):
        impacts = np.flatnonzero(cycle.particle == i)
        last, s = _since(cycle.time[impacts], at, periods)
        j = impacts[last]
        if (height[j] + (cycle.speed[j] - s) * s < surface - ROUNDING).any():
            return False
    return True


def _since(time, at, periods):
    """Return the index of the last of recurring times before each instant, and the time since."""
    last = np.searchsorted(time, at) - 1
    return last, at - time[last] + np.where(last < 0, periods, 0)
