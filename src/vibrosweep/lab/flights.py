"""Parabolas through the samples of all flights, and their intersections.

Gravity is known, so that a flight has two unknowns and y + g t^2 / 2 is a straight line in t.  Two
flights differ by a straight line, which vanishes at the landing between them: the landing follows
without the height of the base.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import trim_mean

from vibrosweep.arrays import Array, Flags, Indices
from vibrosweep.lab.segments import Samples

# Standard errors by which the acceleration of tracks must differ from gravity to contradict it, and
# the share of gravity up to which the difference is an error of the scale.
SCALE_OFF: Final = 5.0
WRONG_SCALE: Final = 0.2
# Fewest flights from which a scale is judged
FEWEST: Final = 5
# Least height, in units of the noise, of a flight whose curvature shows gravity: many times that of
# a wave of noise between two low points.
HIGH_ABOVE_NOISE: Final = 7.0
# High flights are at least half as high as this quantile.
HIGH: Final = 0.95
TRIMMED: Final = 0.25  # share of the curvatures trimmed on either side


class Fits(NamedTuple):
    """Parabolas y = level + slope s - g s^2 / 2 with s = t - centre; arrays of shape (flight,)."""

    number: Array  # of samples
    centre: Array  # mean time of the samples, s
    spread: Array  # sum of the squared distances of the samples from it, s^2
    # level, slope: m and m s-1
    level: Array
    slope: Array
    residue: Array  # sum of squared residuals, m^2

    def top(self, gravity: float) -> Array:
        """Height of each apex, m."""
        return self.level + self.slope**2 / (2.0 * gravity)

    def height(self, time: Array, gravity: float) -> Array:
        """Height at an instant of each flight, m."""
        since = time - self.centre
        return self.level + since * (self.slope - 0.5 * gravity * since)

    def take(self, chosen: Indices | NDArray[np.bool_]) -> Fits:
        """Return some of the flights."""
        return Fits._make(values[chosen] for values in self)


def fit_parabolas(samples: Samples, flight: Indices, flights: int, gravity: float) -> Fits:
    """Fit a parabola of known curvature (m s-2) to each flight.

    `flight` is the number of the flight of each sample; -1 for none.
    """
    used = flight >= 0
    owner, time = flight[used], samples.time[used]

    def total(values: Array) -> Array:
        return np.bincount(owner, values, flights).astype(np.float64)

    with np.errstate(invalid="ignore", divide="ignore"):
        count = total(np.ones(owner.size))
        centre = total(time) / count
        since = time - centre[owner]
        straight = samples.height[used] + 0.5 * gravity * since**2
        spread = total(since**2)
        level = total(straight) / count
        slope = total(since * straight) / spread
        residue = total((straight - level[owner] - slope[owner] * since) ** 2)
    return Fits(count, centre, spread, level, slope, residue)


def curvatures(samples: Samples, flight: Indices, flights: int) -> tuple[Array, Array]:
    """Acceleration (m s-2) of each flight, fitted with its height and slope, and its weight.

    The weight is the reciprocal of the variance, in units of that of a sample; 0 below four
    samples.
    """
    used = flight >= 0
    owner, time, height = flight[used], samples.time[used], samples.height[used]
    count = np.bincount(owner, minlength=flights)

    def project(values: Array, since: Array) -> Array:
        """Subtract from the heights the straight line of each flight."""
        level = np.bincount(owner, values, flights) / count
        slope = np.bincount(owner, since * values, flights) / np.bincount(owner, since**2, flights)
        return values - level[owner] - slope[owner] * since

    with np.errstate(invalid="ignore", divide="ignore"):
        since = time - (np.bincount(owner, time, flights) / count)[owner]
        square, line = project(since**2, since), project(height, since)
        weight = np.bincount(owner, square**2, flights)
        acceleration = -2.0 * np.bincount(owner, square * line, flights) / weight
    return acceleration, np.where(count > 3, weight / 4.0, 0.0)


def apparent_gravity(samples: Samples, flight: Indices, flights: int) -> tuple[float, float]:
    """Acceleration with which the flights fall, and its standard error, m s-2.

    The mean of the middle half of the curvatures of all flights of at least four samples; NaN if
    there are none.  Stretches that are no flights do not disturb it, nor do positions in whole
    pixels, which would disturb a median.
    """
    acceleration, weight = curvatures(samples, flight, flights)
    acceleration = acceleration[weight > 0.0]
    if not acceleration.size:
        return float("nan"), float("nan")
    # standard error of a trimmed mean (Tukey and McLaughlin 1963, Sankhya A 25, 331)
    held = np.clip(acceleration, *np.quantile(acceleration, [TRIMMED, 1.0 - TRIMMED]))
    error = float(held.std()) / ((1.0 - 2.0 * TRIMMED) * float(np.sqrt(acceleration.size)))
    return float(trim_mean(acceleration, TRIMMED)), error


def contradicts(acceleration: float, error: float, gravity: float) -> bool:
    """Return whether the acceleration of flights contradicts an assumed one, both in m s-2.

    It does not if flights do not show their curvature and it is NaN.
    """
    return abs(acceleration - gravity) > SCALE_OFF * error


def near_gravity(acceleration: float, gravity: float) -> bool:
    """Return whether the acceleration of flights may be gravity in tracks of a wrong scale."""
    return abs(acceleration - gravity) < WRONG_SCALE * gravity


def measured_gravity(
    samples: Samples, member: Indices, rise: Array, noise: float, gravity: float
) -> tuple[float, float]:
    """Acceleration with which flights fall, and its standard error, m s-2.

    It is that of all flights or, if that contradicts gravity, of the well-resolved ones, because
    low flights are cut and selected by the assumed acceleration.  `rise` is the height of each
    flight, m.
    """
    acceleration = apparent_gravity(samples, member, rise.size)
    if not contradicts(*acceleration, gravity):
        return acceleration
    high = gravity_of_high_flights(samples, member, rise, noise)
    # too few: low flights give no scale, but tracks that hardly fall are refused
    return (
        acceleration if np.isnan(high[0]) and not near_gravity(acceleration[0], gravity) else high
    )


def gravity_of_high_flights(
    samples: Samples, member: Indices, rise: Array, noise: float
) -> tuple[float, float]:
    """The same, of the flights that are high enough to show it; NaN if they are too few."""
    high = high_flights(rise, noise)
    if high.sum() < FEWEST:
        return float("nan"), float("nan")
    return apparent_gravity(samples, np.where(high[member], member, -1), rise.size)


def high_flights(rise: Array, noise: float) -> Flags:
    """Return which flights are among the highest and stand out of the noise; all in m."""
    return np.asarray(rise > np.fmax(HIGH_ABOVE_NOISE * noise, np.quantile(rise, HIGH) / 2.0))


def line_variance(fits: Fits, one: Array, other: Array | None = None) -> Array:
    """Covariance of the heights of a flight at two instants, over the variance of a sample."""
    other = one if other is None else other
    return 1.0 / fits.number + (one - fits.centre) * (other - fits.centre) / fits.spread


class Ends(NamedTuple):
    """Ends of flights on the base; arrays of shape (flight,)."""

    # up, down: instants of lift-off and landing, s
    up: Array
    down: Array
    # rise, fall: speeds relative to the base there, m s-1
    rise: Array
    fall: Array


def crossings(fits: Fits, base: float, gravity: float) -> Ends:
    """Ends of flights on a base at a constant height."""
    with np.errstate(invalid="ignore"):
        speed = np.sqrt(fits.slope**2 + 2.0 * gravity * (fits.level - base))
    rise = fits.centre + (fits.slope - speed) / gravity
    return Ends(rise, fits.centre + (fits.slope + speed) / gravity, speed, speed)


class Meetings(NamedTuple):
    """Intersections of flights; arrays of shape (meeting,)."""

    # time, height: s and m
    time: Array
    height: Array
    closing: Array  # speed of arrival plus speed of lift-off, m s-1
    # time_variance, height_variance: in units of the variance of a sample: s^2 / m^2 and 1
    time_variance: Array
    height_variance: Array


def meet(before: Fits, after: Fits, near: Array, gravity: float) -> Meetings:
    """Intersect neighbouring flights; instants `near` them (s) keep the differences small."""

    def at(fits: Fits, time: Array) -> tuple[Array, Array]:
        return fits.height(time, gravity), fits.slope - gravity * (time - fits.centre)

    (low, falling), (high, rising) = at(before, near), at(after, near)
    closing = rising - falling
    with np.errstate(invalid="ignore", divide="ignore"):
        time = near + (low - high) / closing
        height, falling = at(before, time)
        _, rising = at(after, time)
        first, second = line_variance(before, time), line_variance(after, time)
        time_variance = (first + second) / closing**2
        height_variance = (rising**2 * first + falling**2 * second) / closing**2
    return Meetings(time, height, closing, time_variance, height_variance)
