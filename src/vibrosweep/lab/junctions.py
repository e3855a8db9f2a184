"""Junctions of neighbouring flights: a bounce, a stay on the base, or neither."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from vibrosweep.arrays import Array, Flags, Indices
from vibrosweep.lab.flights import Ends, Fits, line_variance, meet

# Standard errors by which two flights must miss each other on the base for a stay between them
MISSED: Final = 4.0
# Standard errors from the base within which flights meet on it
ON_BASE: Final = 4.0
# Quantile of the heights at which flights meet, the first estimate of the height of the base; it is
# high because parabolas beside a stay meet below the base
FROM_ABOVE: Final = 0.8
FEWEST: Final = 3  # meetings
BASE_ROUNDS: Final = 5


class Junctions(NamedTuple):
    """Junctions of flights `before` and `before + 1`; arrays of shape (junction,)."""

    before: Indices  # number of the flight that lands
    # landing, liftoff: s; equal unless the particle stayed on the base
    landing: Array
    liftoff: Array
    # landing_error, liftoff_error: standard errors, s
    landing_error: Array
    liftoff_error: Array
    # Covariance of the lift-off with the landing that ends its flight, s^2; NaN if that is unseen
    covariance: Array
    stayed: Flags  # the particle stayed on the base, or bounced too low to be seen
    overlapping: Flags  # the flights meet above the base, where nothing turns the particle
    # height, height_error: height at which the parabolas meet, and its standard error, m
    height: Array
    height_error: Array


def join(fits: Fits, piece: Indices, ends: Ends, noise: float, gravity: float) -> Junctions:
    """Join the neighbouring flights of each piece of track.

    `piece` is the number of the piece of each flight, `noise` the standard deviation of a sample
    (m).
    """
    before = np.flatnonzero(np.diff(piece) == 0)
    after = before + 1
    up, down = ends.up, ends.down
    met = meet(fits.take(before), fits.take(after), (down[before] + up[after]) / 2.0, gravity)
    with np.errstate(invalid="ignore", divide="ignore"):
        fall = noise * np.sqrt(line_variance(fits, down)) / ends.fall
        rise = noise * np.sqrt(line_variance(fits, up)) / ends.rise
        miss = (up[after] - down[before]) / np.hypot(fall[before], rise[after])
        stayed = (miss > MISSED) | ~(met.closing > 0.0)
        landing = np.where(stayed, down[before], met.time)
        liftoff = np.where(stayed, up[after], met.time)
        error = noise * np.sqrt(met.time_variance)
        # an error of height shifts an instant by error / speed; at a bounce both speeds add
        falls = np.where(stayed, ends.fall[before], met.closing)
        rises = np.where(stayed, ends.rise[after], met.closing)
        covariance = np.full(before.size, np.nan)
        linked = np.flatnonzero(after[:-1] == before[1:])
        shared = line_variance(fits.take(after[linked]), liftoff[linked], landing[linked + 1])
        covariance[linked] = -(noise**2) * shared / (rises[linked] * falls[linked + 1])
    return Junctions(
        before,
        landing,
        liftoff,
        np.where(stayed, fall[before], error),
        np.where(stayed, rise[after], error),
        covariance,
        stayed,
        miss < -MISSED,
        met.height,
        noise * np.sqrt(met.height_variance),
    )


def base_level(height: Array, error: Array, fallback: float) -> tuple[float, float]:
    """Height of the base in m, and its standard error.

    It is the weighted mean of the heights at which flights meet on the base, or the `fallback` with
    the error NaN if too few do.  `error` holds the standard errors of the heights.
    """
    sound = np.isfinite(height) & np.isfinite(error)
    height, error = height[sound], error[sound]
    if height.size < FEWEST:
        return fallback, float("nan")
    level = float(np.quantile(height, FROM_ABOVE))
    for _ in range(BASE_ROUNDS):
        near = np.abs(height - level) < ON_BASE * error
        if near.sum() < FEWEST:
            return fallback, float("nan")
        weight = error[near] ** -2.0
        level = float(weight @ height[near] / weight.sum())
    return level, float(weight.sum() ** -0.5)
