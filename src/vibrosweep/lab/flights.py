"""Flights in samples: cut at gaps and low points, fitted by parabolas, joined at bounces."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks
from scipy.special import chdtri
from scipy.stats import trim_mean

from vibrosweep.arrays import Array, Flags, Indices
from vibrosweep.kernels._jit import Floats, kernel
from vibrosweep.lab.ballistics import Input, bend

# -----------------------------------------------------------------------------
# Samples of tracks, cut at gaps, and the low points between flights.

# Length in frames above which a gap may hide a whole flight, so that no landing is assigned to it
GAP_FRAMES: Final = 3.5
# Depth of a low point below the samples on both sides, in units of the noise; by chance, hardly one
# in a million samples near an apex is as deep
PROMINENCE: Final = 5.0
# Largest height of a low point relative to the higher of the neighbouring flights; with four frames
# in a flight the lowest can be at 0.44
LOW: Final = 0.5
# Quantile of the heights of low points that estimates the height of the base: the frame nearest to
# a landing is up to half a frame away from it, and so above the base.
LOW_QUANTILE: Final = 0.25


@dataclass(frozen=True)
class Samples:
    """Measured positions of all particles, particle after particle."""

    # time, height: in s and m; all arrays have the shape (sample,)
    time: Array
    height: Array
    # frame, particle: indices in the array of tracks
    frame: Indices
    particle: Indices
    piece: Indices  # index of the uninterrupted piece of track, increasing

    @property
    def bounds(self) -> Indices:
        """Index of the first sample of each piece, then the number of samples; (piece + 1,)."""
        return np.searchsorted(self.piece, np.arange(self.piece[-1] + 2))


def samples_of(time: Array, height: Array, cuts: NDArray[np.bool_]) -> Samples:
    """Collect the measured positions, in pieces that end at long gaps and at cuts.

    Times increase.  Heights and cuts have the shape (frame, particle): a height is NaN where the
    particle is not visible, a cut is True where no flight continues from the previous frame.
    """
    particle, frame = np.nonzero(np.isfinite(height.T))
    when = time[frame]
    interval = float(np.median(np.diff(time)))
    passed = np.cumsum(cuts, axis=0)[frame, particle]
    new = (
        (np.diff(particle, prepend=-1) != 0)
        | (np.diff(when, prepend=-np.inf) > GAP_FRAMES * interval)
        | (np.diff(passed, prepend=0) != 0)
    )
    return Samples(when, height[frame, particle], frame, particle, np.cumsum(new) - 1)


def rough_noise(samples: Samples) -> float:
    """Estimate the noise of a position in m from third differences, before flights are known.

    These vanish on a parabola and are large across a landing, so that a low quantile is used.  If
    flights last only a few frames, the estimate is too large by up to a factor of two.
    """
    third = np.abs(np.diff(samples.height, 3))[np.diff(samples.piece, 3) == 0]
    # first quartile of the absolute value of a normal deviate, and norm of (1, -3, 3, -1)
    return float(np.quantile(third, 0.25)) / (0.3186 * np.sqrt(20.0)) if third.size else 0.0


def moving_noise(samples: Samples) -> float:
    """Estimate the noise of a position in m from third differences where the particle moves.

    A particle at rest is tracked more accurately than a moving one.
    """
    third = np.abs(np.diff(samples.height, 3))
    moved = np.abs(samples.height[3:] - samples.height[:-3])
    moving = third[moved >= MOVES * np.quantile(moved, 0.9)] if third.size else third
    return float(1.4826 * np.median(moving) / np.sqrt(20.0)) if moving.size else 0.0


def low_points(samples: Samples, noise: float, base: float | None) -> tuple[Indices, float]:
    """Find the lowest samples between flights, and the height of the base in m.

    The height is estimated from the low points if `base` is None.  `noise` is the standard
    deviation of a position (m).
    """
    least = max(PROMINENCE * noise, 1e-6 * float(np.ptp(samples.height)))
    bounds = samples.bounds
    found = [
        begin + find_peaks(-samples.height[begin:end], prominence=least)[0]
        for begin, end in pairwise(bounds)
    ]
    low = np.concatenate(found).astype(np.intp)
    if base is None:
        lowest = samples.height[low] if low.size else samples.height
        base = float(np.quantile(lowest, LOW_QUANTILE))
    # a point not well below the neighbouring flights is noise near an apex
    edges = np.unique(np.concatenate([bounds[:-1], low]))
    tops = np.maximum.reduceat(samples.height, edges)
    place = np.searchsorted(edges, low)
    above = np.maximum(tops[place - 1], tops[place]) - base
    return low[samples.height[low] - base <= LOW * above + 2.0 * noise], base


# -----------------------------------------------------------------------------
# Parabolas through the samples of all flights, and their intersections.
#
# Gravity is known, so that y + g t^2 / 2 is a straight line in t and a flight has two unknowns.
# Two neighbouring flights differ by a straight line, which is zero at the landing between them.
# The landing therefore follows without the height of the base.

# Standard errors by which an acceleration must differ from gravity to contradict it, and fraction
# of gravity up to which the difference is attributed to the scale
SCALE_OFF: Final = 5.0
WRONG_SCALE: Final = 0.2
# Smallest number of high flights that can show an error of the scale
FEWEST_HIGH: Final = 5
# Smallest height, in units of the noise, of a flight whose curvature shows gravity: many times that
# of a spurious flight, noise between two low points
HIGH_ABOVE_NOISE: Final = 7.0
# High flights have at least half the height at this quantile.
HIGH: Final = 0.95
OUTLYING: Final = 4.5  # standard errors from which a curvature is left out of the mean
TRIMMED: Final = 0.25  # fraction of the curvatures trimmed on either side


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

    def height(self, time: Array, gravity: Array | float) -> Array:
        """Height of each flight at one time each, m."""
        since = time - self.centre
        return self.level + since * (self.slope - 0.5 * gravity * since)

    def take(self, chosen: Indices | NDArray[np.bool_]) -> Fits:
        """Return the chosen flights."""
        return Fits._make(values[chosen] for values in self)


def fit_parabolas(samples: Samples, flight: Indices, flights: int, gravity: Array | float) -> Fits:
    """Fit a parabola of known curvature (m s-2), the same or one each, to each flight.

    `flight` is the index of the flight of each sample, -1 for none.
    """
    used = flight >= 0
    owner, time = flight[used], samples.time[used]

    def total(values: Array) -> Array:
        return np.bincount(owner, values, flights).astype(np.float64)

    with np.errstate(invalid="ignore", divide="ignore"):
        count = total(np.ones(owner.size))
        centre = total(time) / count
        since = time - centre[owner]
        fall = np.broadcast_to(gravity, flights)[owner]
        straight = samples.height[used] + 0.5 * fall * since**2
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
    """Downward acceleration of the flights, and its standard error, m s-2.

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


def mean_gravity(samples: Samples, flight: Indices, flights: int, noise: float) -> Input:
    """Downward acceleration of the flights, m s-2: the weighted mean without outliers.

    `noise` is the standard deviation of a sample, m.
    """
    acceleration, weight = curvatures(samples, flight, flights)
    acceleration, weight = acceleration[weight > 0.0], weight[weight > 0.0]
    if not weight.size:
        return Input(np.nan, np.inf)
    order = np.argsort(acceleration)
    middle = acceleration[order][np.searchsorted(np.cumsum(weight[order]), weight.sum() / 2.0)]
    sound = np.abs(acceleration - middle) * np.sqrt(weight) < OUTLYING * noise
    acceleration, weight = acceleration[sound], weight[sound]
    mean = float(np.average(acceleration, weights=weight))
    chi_square = float(weight @ (acceleration - mean) ** 2) / noise**2
    wider = max(1.0, chi_square / max(weight.size - 1, 1))
    return Input(mean, noise * float(np.sqrt(wider / weight.sum())))


def contradicts(acceleration: float, error: float, gravity: float) -> bool:
    """Return whether the acceleration of flights contradicts an assumed one, both in m s-2.

    NaN, for flights whose curvature is not resolved, contradicts nothing.
    """
    return abs(acceleration - gravity) > SCALE_OFF * error


def near_gravity(acceleration: float, gravity: float) -> bool:
    """Return whether a wrong scale can explain the difference of an acceleration from gravity."""
    return abs(acceleration - gravity) < WRONG_SCALE * gravity


def measured_gravity(
    samples: Samples, member: Indices, rise: Array, noise: float, gravity: float
) -> tuple[float, float]:
    """Downward acceleration of flights, and its standard error, m s-2.

    It is that of all flights or, if this contradicts gravity, that of the high ones, because low
    flights are biased towards the acceleration assumed in their selection.  `rise` is the height of
    each flight, m.
    """
    acceleration = apparent_gravity(samples, member, rise.size)
    if not contradicts(*acceleration, gravity):
        return acceleration
    high = gravity_of_high_flights(samples, member, rise, noise)
    # without high flights the scale is not tested, but an acceleration far from gravity is an error
    return (
        acceleration if np.isnan(high[0]) and not near_gravity(acceleration[0], gravity) else high
    )


def gravity_of_high_flights(
    samples: Samples, member: Indices, rise: Array, noise: float
) -> tuple[float, float]:
    """Return `apparent_gravity` of the high flights; NaN if there are too few."""
    high = high_flights(rise, noise)
    if high.sum() < FEWEST_HIGH:
        return float("nan"), float("nan")
    return apparent_gravity(samples, np.where(high[member], member, -1), rise.size)


def high_flights(rise: Array, noise: float) -> Flags:
    """Mark the flights that are among the highest and well above the noise; all in m."""
    return np.asarray(rise > np.fmax(HIGH_ABOVE_NOISE * noise, np.quantile(rise, HIGH) / 2.0))


def line_variance(fits: Fits, time: Array, other: Array | None = None) -> Array:
    """Variance of the height of a flight at a time, or covariance of the heights at two times.

    Both are in units of the variance of a sample.
    """
    other = time if other is None else other
    return 1.0 / fits.number + (time - fits.centre) * (other - fits.centre) / fits.spread


class Ends(NamedTuple):
    """Ends of flights on the base; arrays of shape (flight,)."""

    # up, down: instants of lift-off and landing, s
    up: Array
    down: Array
    # rise, fall: speeds relative to the base at these times, m s-1
    rise: Array
    fall: Array


class Meetings(NamedTuple):
    """Intersections of flights; arrays of shape (meeting,)."""

    # time, height: s and m
    time: Array
    height: Array
    closing: Array  # arrival speed plus lift-off speed, m s-1
    # time_variance, height_variance: in units of the variance of a sample, s^2 / m^2 and 1
    time_variance: Array
    height_variance: Array


def meet(before: Fits, after: Fits, near: Array, gravity: float) -> Meetings:
    """Intersect flights with the following ones; times `near` them (s) limit rounding errors."""

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


# -----------------------------------------------------------------------------
# Cut tracks into stretches of free flight, without the height of the base.
#
# The function y + g t^2 / 2 of a particle is a straight line in flight, bends upwards on the base
# and has a kink at a bounce.  The partition into straight lines that minimises chi-square plus a
# fixed penalty for each line is found exactly (optimal partitioning, Jackson et al. 2005, IEEE
# Signal Process. Lett. 12, 105).  If g is not known, y is cut into parabolas.

# Penalty of a piece in units of chi-square; noise then adds one cut in hundreds of flights
PRICE: Final = 25.0
# Standard deviations by which the chi-square of a piece may exceed its mean
BENT: Final = 6.0
# Price of a sample that a parabola of unknown curvature takes from a flight without being tested
UNJUDGED: Final = 10.0
# Most samples of such a parabola, because the time for a long rest grows with their number
MOST_SAMPLES: Final = 2000.0
NOISE_ROUNDS: Final = 3
# Least noise, in units of the range of heights: rounding errors of the sums over a piece
ROUNDED: Final = 1e-6
LOWEST: Final = 0.25  # quantile of the residuals of stretches from which the noise is estimated
MOVES: Final = 0.1  # share of the displacements of a moving particle that one at rest stays below
# Standard errors by which the acceleration of a flight may differ from gravity, and by which
# gravity must differ from zero, the acceleration of a stay on a base at rest
FALLS: Final = 3.5
SEEN: Final = 5.0


@kernel
def _partition(
    time: Floats,
    height: Floats,
    variance: float,
    gravity: float,
    terms: int,
    unjudged: float,
    longest: float,
    starts: Flags,
) -> None:
    """Mark the samples at which the polynomials of the best partition begin.

    They have so many `terms` beyond the parabola of free fall.  The samples of a piece that has no
    more of them than terms cost `unjudged` each, except the first.  A piece has at most `longest`
    samples.
    """
    begin = np.empty(time.size, np.int64)  # start of the last piece up to each sample
    cost = np.full(time.size + 1, np.inf)
    cost[0] = 0.0
    row, table = np.empty(terms + 1), np.empty((terms, terms + 1))
    for last in range(time.size):
        # least squares by Givens rotations, extended backwards from the last sample
        table[:] = 0.0
        count, residue = 0.0, 0.0
        for first in range(last, -1, -1):
            since = time[first] - time[last]
            row[0] = 1.0
            for k in range(1, terms):
                row[k] = since * row[k - 1]
            row[terms] = height[first] - height[last] + 0.5 * gravity * since * since
            for k in range(terms):
                size = math.hypot(table[k, k], row[k])
                if size == 0.0:
                    continue
                cosine, sine = table[k, k] / size, row[k] / size
                for j in range(k, terms + 1):
                    above, below = table[k, j], row[j]
                    table[k, j] = cosine * above + sine * below
                    row[j] = cosine * below - sine * above
            count += 1.0
            if count > longest:
                break
            free = count - terms
            if free > 0.0:
                residue += row[terms] ** 2 / variance
                if residue > free + BENT * math.sqrt(2.0 * free) + PRICE:
                    break
            own = residue if free > 0.0 else unjudged * (count - 1.0)
            total = cost[first] + own + PRICE
            if total < cost[last + 1]:
                cost[last + 1] = total
                begin[last] = first
    k = time.size
    while k > 0:
        k = begin[k - 1]
        starts[k] = True


def stretches(samples: Samples, gravity: float | None) -> tuple[Indices, float]:
    """Cut each piece of track into parabolas, whose curvature is gravity if this is known.

    Returns the index of the stretch of each sample, increasing, and the standard deviation of a
    sample in m, from the residuals of the parabolas.
    """
    fall, terms, unjudged, longest = (
        (0.0, 3, UNJUDGED, MOST_SAMPLES) if gravity is None else (gravity, 2, 0.0, np.inf)
    )
    least = ROUNDED * float(np.ptp(samples.height))
    noise = max(rough_noise(samples) if gravity else moving_noise(samples), least)
    member = np.zeros(samples.time.size, np.intp)
    for _ in range(NOISE_ROUNDS):
        starts = np.zeros(samples.time.size, bool)
        for begin, end in pairwise(samples.bounds):
            piece = slice(begin, end)
            time, height = samples.time[piece], samples.height[piece]
            _partition(time, height, noise**2, fall, terms, unjudged, longest, starts[piece])
        member = np.cumsum(starts) - 1
        count = int(member[-1]) + 1
        curvature, weight = curvatures(samples, member, count)
        own = np.where(weight > 0.0, curvature, 0.0) if gravity is None else fall
        fits = fit_parabolas(samples, member, count, own)
        free = fits.number - terms
        long = free > 1.0
        if gravity is None:  # a particle at rest is tracked more accurately than a moving one
            moves = np.abs(own) * np.sqrt(weight) > SEEN * noise
            long = long & moves if (long & moves).any() else long
        if not long.any():
            break
        # a low quantile, because stretches that are not parabolas have large residuals
        ratio = fits.residue[long] / chdtri(free[long], 1.0 - LOWEST)
        found = math.sqrt(float(np.quantile(ratio, LOWEST)))
        noise = max(found, least)
    return member, noise


def clear_flights(
    samples: Samples, member: Indices, fits: Fits, noise: float, fall: float
) -> Flags:
    """Mark the stretches in free fall, unlike stays; shape (stretch,).

    `member` is the result of `stretches`, `noise` the standard deviation of a sample (m), `fall`
    the acceleration of free flight (m s-2).
    """
    acceleration, weight = curvatures(samples, member, fits.number.size)
    with np.errstate(invalid="ignore", divide="ignore"):
        error = noise / np.sqrt(weight)
    return np.asarray((np.abs(acceleration - fall) < FALLS * error) & (fall > SEEN * error))


# -----------------------------------------------------------------------------
# Junctions of neighbouring flights: a bounce, a stay on the base, or neither.

# Time between two flights on the base, in standard errors, above which it is a stay
MISSED: Final = 4.0


class Junctions(NamedTuple):
    """Junctions of flights `before` and `before + 1`; arrays of shape (junction,)."""

    before: Indices  # index of the flight that ends
    # landing, liftoff: s, equal unless the particle stayed on the base
    landing: Array
    liftoff: Array
    # landing_error, liftoff_error: standard errors, s
    landing_error: Array
    liftoff_error: Array
    # Covariance of the lift-off with the landing that ends its flight, s^2; NaN if not observed
    covariance: Array
    stayed: Flags  # the particle stayed on the base, or bounced too low to be seen
    overlapping: Flags  # the flights meet above the base, where nothing turns the particle
    # height, height_error: height at which the parabolas meet, and its standard error, m
    height: Array
    height_error: Array


def join(
    fits: Fits,
    piece: Indices,
    ends: Ends,
    noise: float,
    gravity: float,
    contact: Array | float = 0.0,
    drag: float = 0.0,
) -> Junctions:
    """Join the neighbouring flights of each piece of track.

    `piece` is the index of the piece of each flight, `noise` the standard deviation of a sample
    (m), `contact` the contact time (s) at the end of each flight, `drag` (s2 m-2) that taken out of
    the samples.
    """
    before = np.flatnonzero(np.diff(piece) == 0)
    after = before + 1
    up, down = ends.up, ends.down
    contact = np.broadcast_to(contact, down.shape)[before]
    met = meet(fits.take(before), fits.take(after), (down[before] + up[after]) / 2.0, gravity)
    with np.errstate(invalid="ignore", divide="ignore"):
        since = met.time - fits.centre[[before, after]]
        low, high = bend(since - fits.slope[[before, after]] / gravity, gravity, drag)
        later = (low - high) / met.closing
        falls = fits.slope[before] - gravity * since[0]
        met = met._replace(time=met.time + later, height=met.height + low + falls * later)
        fall = noise * np.sqrt(line_variance(fits, down)) / ends.fall
        rise = noise * np.sqrt(line_variance(fits, up)) / ends.rise
        miss = (up[after] - down[before] - contact) / np.hypot(fall[before], rise[after])
        stayed = (miss > MISSED) | ~(met.closing > 0.0)
        # the parabolas meet within a contact, dividing it in the ratio of the speeds
        share = ends.rise[after] / (ends.fall[before] + ends.rise[after])
        landing = np.where(stayed, down[before], met.time - contact * share)
        liftoff = np.where(stayed, up[after], met.time + contact * (1.0 - share))
        error = noise * np.sqrt(met.time_variance)
        # an error of height shifts a time by error / speed; at a bounce both speeds add
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
