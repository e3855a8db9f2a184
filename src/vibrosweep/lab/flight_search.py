"""Find flights in samples: fit them, intersect neighbours, assign the samples again, repeat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from vibrosweep.arrays import Array, Indices
from vibrosweep.errors import TrackError
from vibrosweep.lab.flights import (
    SCALE_OFF,
    WRONG_SCALE,
    Ends,
    Fits,
    apparent_gravity,
    contradicts,
    crossings,
    fit_parabolas,
    high_flights,
    measured_gravity,
    near_gravity,
)
from vibrosweep.lab.junctions import Junctions, base_level, join
from vibrosweep.lab.oscillation import BaseFit
from vibrosweep.lab.segments import Samples, low_points, rough_noise
from vibrosweep.lab.speed_laws import FittedLaw

# Share of the height of a flight above which samples belong to it, wherever its ends are
UPPER: Final = 0.25
# Fewest samples of a flight, one more than its unknowns, and least height in units of the noise
LEAST_SAMPLES: Final = 3
LEAST_HEIGHT: Final = 4.0
FIRST_SHARE: Final = 0.6  # used share of the first estimate of the noise, which may be too large
# Significance level of the test for poor flights: one good flight in a million fails it
POOR: Final = 1e-6
# Share of poor flights at which the search has failed
MOSTLY: Final = 0.5
# Distance from the base, in standard deviations of the noise, within which a sample is on it
OFF_BASE: Final = 3.0
# Most accelerations that are tried, each found from flights fitted with the one before
SCALES: Final = 3
# Iterations: in most tracks no sample changes its flight after three.
ROUNDS: Final = 4


class Flights(NamedTuple):
    """Flights of all particles that frames and noise resolve, in order."""

    fits: Fits  # parabolas, arrays of shape (flight,)
    # piece, particle: numbers of the piece of track and of the particle, shape (flight,)
    piece: Indices
    particle: Indices
    member: Indices  # number of the flight of each sample, -1 for none
    poor: NDArray[np.bool_]  # True if the residuals of a flight are larger than noise explains
    ends: Ends  # where the flights leave and reach the base
    junctions: Junctions  # bounces and stays between neighbouring flights
    levels: Array  # (mean) height of the base below each particle, m
    # base, base_error: mean of the levels, and the standard error of a level, m
    base: float
    base_error: float
    noise: float  # standard deviation of a sample, m
    # gravity, gravity_error: acceleration with which flights fall, and its standard error, m s-2
    gravity: float
    gravity_error: float
    # Acceleration of the parabolas, m s-2: gravity, or that of the tracks if they contradict
    # gravity
    curvature: float
    base_fit: BaseFit | None = None  # motion of the base; None if it has a constant level
    laws: Sequence[FittedLaw] = ()  # laws of restitution, fitted over a moving base


def find_flights(
    samples: Samples, gravity: float, base: float | None, exposure: float = 0.0
) -> Flights:
    """Find and fit every flight.

    `base` is the height of the base in m, or None if it is to be found.  Frames whose `exposure`
    (s) contains a landing belong to no flight.  Raises a TrackError if nothing flies, or if flights
    do not fall with gravity.
    """
    fall = gravity
    for _ in range(SCALES):
        flights = _search(samples, fall, base, exposure)
        found, error = flights.gravity, flights.gravity_error
        if not contradicts(found, error, fall):
            return flights
        refuse_gravity(found, error, gravity)
        fall = found  # parabolas of the wrong curvature would miss the landings
    raise TrackError(
        f"flights fall with {found:.4g} ± {error:.2g} m s-2 when fitted with "
        f"{flights.curvature:.4g} m s-2, and gravity is {gravity:g} m s-2: no scale describes all "
        f"of them; check the heights, or film faster or closer"
    )


def _search(samples: Samples, gravity: float, base: float | None, exposure: float) -> Flights:
    noise = rough_noise(samples)
    # a noise that is too large would hide low flights
    rough = _iterate(samples, FIRST_SHARE * noise, gravity, base, exposure)
    noise = min(noise, rough.noise)
    flights = _iterate(samples, noise, gravity, base, exposure)
    if base is not None or flights.poor.mean() < MOSTLY:
        return flights
    # if a stay follows every flight, the parabolas meet below the base, and the lowest samples lie
    # on it
    parted = _iterate(samples, noise, gravity, low_points(samples, noise, None)[1], exposure)
    rests = samples.height[parted.member < 0]
    if not rests.size or parted.poor.mean() >= MOSTLY:
        return flights
    # leave out the samples of bounces that are too low to be resolved
    rests = rests[np.abs(rests - np.median(rests)) <= OFF_BASE * parted.noise]
    found = _iterate(samples, noise, gravity, float(rests.mean()), exposure)
    return found._replace(base_error=parted.noise / float(np.sqrt(rests.size)))


def _iterate(
    samples: Samples, noise: float, gravity: float, known: float | None, exposure: float
) -> Flights:
    """Fit flights, join them, assign samples to flights by the landings found; repeat.

    `known` is the height of the base in m, or None.
    """
    member, piece, base, _ = _upper_samples(samples, noise, known)
    error, noise = 0.0, np.inf
    for turn in range(ROUNDS):
        fits, piece, member, found = _keep_resolved(samples, member, piece, base, gravity)
        # a stay that is taken for part of a flight would raise the noise, and thereby be hidden
        noise = min(noise, found)
        ends = crossings(fits, base, gravity)
        junctions = join(fits, piece, ends, noise, gravity)
        if known is None:
            base, error = base_level(junctions.height, junctions.height_error, base)
            ends = crossings(fits, base, gravity)
            junctions = join(fits, piece, ends, noise, gravity)
        if turn < ROUNDS - 1:
            member = assign_samples(samples, piece, junctions, ends, exposure)
    return Flights(
        fits,
        piece,
        samples.particle[samples.bounds[piece]],
        member,
        poor_flights(fits, noise),
        ends,
        junctions,
        np.full(samples.particle[-1] + 1, base),
        base,
        error,
        noise,
        *measured_gravity(samples, member, fits.top(gravity) - base, noise, gravity),
        gravity,
    )


def _upper_samples(
    samples: Samples, noise: float, known: float | None
) -> tuple[Indices, Indices, float, Array]:
    """Assign the samples in the upper part of each flight to it, without fits.

    Returns the number of the flight of each sample (-1 for none), the piece of track of each
    flight, the height of the base, and the largest height in each flight.
    """
    low, base = low_points(samples, noise, known)
    edges = np.unique(np.concatenate([samples.bounds[:-1], low]))
    tops = np.maximum.reduceat(samples.height, edges)
    flight = np.searchsorted(edges, np.arange(samples.time.size), side="right") - 1
    upper = samples.height - base > UPPER * (tops[flight] - base)
    upper[low] = False
    # only the stretch around the highest sample, because a stay elsewhere may be as high
    stretch = np.cumsum(np.diff(np.where(upper, flight, -1), prepend=-2) != 0)
    at_top = samples.height == tops[flight]
    kept = np.zeros(int(stretch[-1]) + 1, bool)
    kept[stretch[at_top]] = True
    return np.where(upper & kept[stretch], flight, -1), samples.piece[edges], base, tops


def check_gravity(samples: Samples, gravity: float, base: float | None) -> None:
    """Raise a TrackError if the highest flights fall upwards, or not with gravity."""
    found, error = _rough_gravity(samples, base)
    if not _shows_gravity(found, error, gravity):
        turned = replace(samples, height=-samples.height)
        falls, scatter = _rough_gravity(turned, None if base is None else -base)
        if _shows_gravity(falls, scatter, gravity):
            raise TrackError(
                f"heights grow downwards: with the axis turned, the particles fall with "
                f"{falls:.3g} m s-2, and gravity is {gravity:g} m s-2; turn the axis"
            )
    refuse_gravity(found, error, gravity)


def _shows_gravity(acceleration: float, error: float, gravity: float) -> bool:
    """Return whether an acceleration is near gravity, and its error too small for chance."""
    return near_gravity(acceleration, gravity) and SCALE_OFF * error < WRONG_SCALE * gravity


def _rough_gravity(samples: Samples, base: float | None) -> tuple[float, float]:
    """Acceleration that the highest flights show, and its standard error, m s-2."""
    noise = rough_noise(samples)
    member, _, base, tops = _upper_samples(samples, FIRST_SHARE * noise, base)
    high = high_flights(tops - base, noise)
    return apparent_gravity(samples, np.where(high[member], member, -1), tops.size)


def refuse_gravity(found: float, error: float, gravity: float) -> None:
    """Raise a TrackError if flights fall with an acceleration (m s-2) far from gravity."""
    # both are NaN, and nothing is refused, if no flight has enough frames to show its curvature
    if not abs(found - gravity) > max(WRONG_SCALE * gravity, SCALE_OFF * error):
        return
    units = f"multiply the scale by about {gravity / found:.2g}, or " if found > 0.0 else ""
    raise TrackError(
        f"the particles fall with {found:.3g} m s-2 instead of {gravity:g} m s-2: {units}turn the "
        f"axis, or correct the frame rate, or film faster where flights last fewer than five "
        f"frames; particles that hardly leave the base do not show gravity"
    )


def _keep_resolved(
    samples: Samples, member: Indices, piece: Indices, base: float, gravity: float
) -> tuple[Fits, Indices, Indices, float]:
    """Fit the flights, and keep those that frames and noise resolve; return the noise too."""
    fits = fit_parabolas(samples, member, piece.size, gravity)
    noise = flight_noise(fits, float(np.ptp(samples.height)))
    with np.errstate(invalid="ignore"):
        high = fits.top(gravity) - base > LEAST_HEIGHT * noise
    kept, fits, member = keep_resolved(fits, high, member)
    return fits, piece[kept], member, noise


def keep_resolved(
    fits: Fits, high: NDArray[np.bool_], member: Indices
) -> tuple[Indices, Fits, Indices]:
    """Keep the flights that are `high` and have enough samples, and renumber them."""
    kept = np.flatnonzero(high & (fits.number >= LEAST_SAMPLES))
    if not kept.size:
        raise TrackError(
            "no flight rises out of the noise: check the heights, their axis, scale and base, or "
            "film faster where flights last fewer than five frames"
        )
    number = np.full(high.size + 1, -1)
    number[kept] = np.arange(kept.size)
    return kept, fits.take(kept), number[member]


def flight_noise(fits: Fits, extent: float) -> float:
    """Estimate the standard deviation of a sample in m from the flights that are not poor."""
    freedom = fits.number - 2.0
    judged = freedom > 0.0
    if not judged.any():
        return 1e-9 * extent
    residue, freedom = fits.residue[judged], freedom[judged]
    variance = float(np.median(residue / _chi_square(0.5, freedom)))
    largest = _chi_square(POOR, freedom)
    for _ in range(2):
        good = residue <= variance * largest
        variance = float(residue[good].sum() / freedom[good].sum()) if good.any() else variance
    # positions without noise still have errors of rounding
    return max(float(np.sqrt(variance)), 1e-9 * extent)


def poor_flights(fits: Fits, noise: float) -> NDArray[np.bool_]:
    """Mark the flights whose residuals are larger than the noise (m) explains."""
    largest = _chi_square(POOR, np.maximum(fits.number - 2.0, 1.0))
    return np.asarray(fits.residue > noise**2 * largest)


def _chi_square(probability: float, freedom: Array) -> Array:
    """Chi-square that is exceeded with this probability, for integer degrees of freedom."""
    values = chdtri(np.arange(freedom.max(initial=1.0) + 1.0), probability)
    return np.asarray(values[freedom.astype(np.intp)])


def assign_samples(
    samples: Samples, piece: Indices, junctions: Junctions, ends: Ends, exposure: float
) -> Indices:
    """Return the number of each sample's flight; -1 on the base and during a landing."""
    start, end = ends.up.copy(), ends.down.copy()
    end[junctions.before] = junctions.landing
    start[junctions.before + 1] = junctions.liftoff
    # an axis on which pieces do not overlap: each has an interval longer than the track
    origin, length = samples.time.min(), 2.0 * np.ptp(samples.time) + 1.0
    place = length * samples.piece + (samples.time - origin)
    margin = exposure / 2.0

    def along(time: Array) -> Array:
        return np.asarray(length * piece + np.clip(time - origin, 0.0, length / 2.0))

    flight = np.searchsorted(along(start), place, side="right") - 1
    inside = (flight >= 0) & (piece[flight] == samples.piece)
    inside &= (samples.time > start[flight] + margin) & (samples.time < end[flight] - margin)
    return np.where(inside, flight, -1)
