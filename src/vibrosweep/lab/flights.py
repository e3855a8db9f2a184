"""Parabolas through the samples of all flights, and their intersections.

Gravity is known, so that y + g t^2 / 2 is a straight line in t and a flight has two unknowns.  Two
neighbouring flights differ by a straight line, which is zero at the landing between them.  The
landing therefore follows without the height of the base.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import trim_mean

from vibrosweep.arrays import Array, Flags, Indices
from vibrosweep.lab.segments import Samples

# Standard errors by which the acceleration of tracks must differ from gravity to contradict it, and
# share of gravity up to which the difference is taken for an error of the scale
SCALE_OFF: Final = 5.0
WRONG_SCALE: Final = 0.2
# Fewest high flights that can show an error of the scale
FEWEST: Final = 5
# Least height, in units of the noise, of a flight whose curvature shows gravity: many times that of
# a false flight, noise between two low points
HIGH_ABOVE_NOISE: Final = 7.0
# High flights have at least half the height at this quantile.
HIGH: Final = 0.95
TRIMMED: Final = 0.25  # share of the curvatures trimmed on either side


class Fits(NamedTuple):
    """Parabolas y = level + slope s - g s^2 / 2 with s = t - centre; arrays of shape (flight,)."""

    number: Array  # number of samples
    centre: Array  # mean time of the samples, s
    spread: Array  # sum of the squared deviations of the times from the centre, s^2
    # level, slope: height (m) and velocity (m s-1) at the centre
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
        """Return the chosen flights."""
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
    """Fit the acceleration (m s-2) of each flight together with its level and slope.

    Returns the accelerations and their weights: the variance of a sample over that of the
    acceleration; 0 with fewer than four samples.
    """
    used = flight >= 0
    owner, time, height = flight[used], samples.time[used], samples.height[used]
    count = np.bincount(owner, minlength=flights)

    def project(values: Array, since: Array) -> Array:
        """Subtract the straight line that fits the values of each flight."""
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

    It is the mean of the middle half of the curvatures of all flights with at least four samples,
    or NaN if there are none.  Stretches that are not flights do not affect it, and rounding to
    whole pixels affects it less than a median.
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

    NaN, the acceleration of flights that do not show their curvature, contradicts nothing.
    """
    return abs(acceleration - gravity) > SCALE_OFF * error


def near_gravity(acceleration: float, gravity: float) -> bool:
    """Return whether the acceleration of flights can be gravity seen with a wrong scale."""
    return abs(acceleration - gravity) < WRONG_SCALE * gravity


def measured_gravity(
    samples: Samples, member: Indices, rise: Array, noise: float, gravity: float
) -> tuple[float, float]:
    """Acceleration with which flights fall, and its standard error, m s-2.

    It is that of all flights or, if this contradicts gravity, that of the high ones, because low
    flights are cut and selected with the assumed acceleration.  `rise` is the height of each
    flight, m.
    """
    acceleration = apparent_gravity(samples, member, rise.size)
    if not contradicts(*acceleration, gravity):
        return acceleration
    high = gravity_of_high_flights(samples, member, rise, noise)
    # without high flights the scale is not judged, but an acceleration far from gravity is refused
    return (
        acceleration if np.isnan(high[0]) and not near_gravity(acceleration[0], gravity) else high
    )


def gravity_of_high_flights(
    samples: Samples, member: Indices, rise: Array, noise: float
) -> tuple[float, float]:
    """Return `apparent_gravity` of the flights that are high enough; NaN if they are too few."""
    high = high_flights(rise, noise)
    if high.sum() < FEWEST:
        return float("nan"), float("nan")
    return apparent_gravity(samples, np.where(high[member], member, -1), rise.size)


def high_flights(rise: Array, noise: float) -> Flags:
    """Mark the flights that are among the highest and rise well above the noise; all in m."""
    return np.asarray(rise > np.fmax(HIGH_ABOVE_NOISE * noise, np.quantile(rise, HIGH) / 2.0))


def line_variance(fits: Fits, time: Array, other: Array | None = None) -> Array:
    """Variance of the height of a flight at an instant, or its covariance with that at another.

    Both are in units of the variance of a sample.
    """
    other = time if other is None else other
    return 1.0 / fits.number + (time - fits.centre) * (other - fits.centre) / fits.spread


class Ends(NamedTuple):
    """Ends of flights on the base; arrays of shape (flight,)."""

    # up, down: instants of lift-off and landing, s
    up: Array
    down: Array
    # rise, fall: speeds relative to the base at these instants, m s-1
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
    # time_variance, height_variance: in units of the variance of a sample, s^2 / m^2 and 1
    time_variance: Array
    height_variance: Array


def meet(before: Fits, after: Fits, near: Array, gravity: float) -> Meetings:
    """Intersect flights with those that follow; instants `near` (s) keep rounding errors small."""

    def at(fits: Fits, time: Array) -> tuple[Array, Array]:
        return fits.height(time, gravity), fits.slope - gravity * (time - fits.centre)

    (low, falling), (high, rising) = at(before, near), at(after, near)
    closing = rising - falling
    with np.errstate(invalid="ignore", divide="ignore"):
        time = near + (low - high) / closing
        height, falling = at(before, time)
        _, rising = at(after, time)
        landing, leaving = line_variance(before, time), line_variance(after, time)
        time_variance = (landing + leaving) / closing**2
        height_variance = (rising**2 * landing + falling**2 * leaving) / closing**2
    return Meetings(time, height, closing, time_variance, height_variance)
