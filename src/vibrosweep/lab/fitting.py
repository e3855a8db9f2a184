"""Find flights in tracks over a base that moves or has a constant level, iteratively."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import chdtri

from vibrosweep.arrays import Array, Indices
from vibrosweep.errors import TrackError, require_one_of
from vibrosweep.lab.ballistics import Input, bend
from vibrosweep.lab.base_fit import (
    COUNT,
    INSTANT,
    UNDETERMINED,
    BaseFit,
    Contacts,
    Cut,
    Inputs,
    Problem,
    Trace,
    contacts_between,
    covariance_of_fit,
    find_contacts,
    fit_base,
    moves,
    which_base,
    without_drag,
    without_outliers,
)
from vibrosweep.lab.flights import (
    ON_BASE,
    SCALE_OFF,
    WRONG_SCALE,
    Ends,
    Fits,
    Junctions,
    Samples,
    apparent_gravity,
    base_level,
    contradicts,
    crossings,
    fit_parabolas,
    high_flights,
    join,
    low_points,
    mean_gravity,
    measured_gravity,
    meet,
    near_gravity,
    rough_noise,
    samples_of,
)
from vibrosweep.lab.regression import FITTED, FittedLaw, Law, failed_fit, fit_law, with_speed
from vibrosweep.lab.traces import trace_of_mark
from vibrosweep.lab.tracks import find_swaps
from vibrosweep.lab.variables import require_number, require_parameter

# -----------------------------------------------------------------------------
# Find flights in samples: fit them, intersect neighbours, reassign the samples, and repeat.

# Fraction of the height of a flight above which samples belong to it, wherever its ends are
UPPER: Final = 0.25
# Smallest number of samples of a flight, one more than its unknowns, and its smallest height in
# units of the noise
LEAST_SAMPLES: Final = 3
LEAST_HEIGHT: Final = 4.0
FIRST_SHARE: Final = 0.6  # factor on the first estimate of the noise, which may be too large
# Significance level of the test for poor flights: one good flight in a million fails it
POOR: Final = 1e-6
# Fraction of poor flights at which the search has failed
MOSTLY: Final = 0.5
# Distance from the base, in units of the noise, within which a sample is on it
OFF_BASE: Final = 3.0
# Largest number of trial accelerations, each found from flights fitted with the previous one
SCALES: Final = 3
# Iterations; in most tracks no sample changes its flight after three.
ROUNDS: Final = 4


class Flights(NamedTuple):
    """All resolved flights of all particles, in order."""

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
    """Find and fit all flights.

    `base` is the height of the base in m, or None to estimate it.  Frames whose `exposure` (s)
    contains a landing belong to no flight.  Raises a TrackError if there is no flight, or if
    flights do not fall with gravity.
    """
    fall = gravity
    for _ in range(SCALES):
        flights = _search(samples, fall, base, exposure)
        found, error = flights.gravity, flights.gravity_error
        if not contradicts(found, error, fall):
            return flights
        require_gravity(found, error, gravity)
        fall = found  # parabolas with the wrong curvature would miss the landings
    raise TrackError(
        f"flights fall with {found:.4g} ± {error:.2g} m s-2 when fitted with "
        f"{flights.curvature:.4g} m s-2, and gravity is {gravity:g} m s-2: no scale fits all "
        f"of them; check the heights, or film faster or closer"
    )


def _search(samples: Samples, gravity: float, base: float | None, exposure: float) -> Flights:
    noise = rough_noise(samples)
    # too large a noise estimate would hide low flights
    rough = _iterate(samples, FIRST_SHARE * noise, gravity, base, exposure)
    noise = min(noise, rough.noise)
    flights = _iterate(samples, noise, gravity, base, exposure)
    if base is not None or flights.poor.mean() < MOSTLY:
        return flights
    # if every flight is followed by a stay, the parabolas meet below the base, and the lowest
    # samples lie on it
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
        # a stay mistaken for part of a flight would inflate the noise and thus remain hidden
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
    """Assign the samples in the upper part of each flight to it, without fitting.

    Returns the number of the flight of each sample (-1 for none), the piece of track of each
    flight, the height of the base, and the largest height in each flight.
    """
    low, base = low_points(samples, noise, known)
    edges = np.unique(np.concatenate([samples.bounds[:-1], low]))
    tops = np.maximum.reduceat(samples.height, edges)
    flight = np.searchsorted(edges, np.arange(samples.time.size), side="right") - 1
    upper = samples.height - base > UPPER * (tops[flight] - base)
    upper[low] = False
    # only the stretch around the highest sample, because a stay elsewhere may be equally high
    stretch = np.cumsum(np.diff(np.where(upper, flight, -1), prepend=-2) != 0)
    at_top = samples.height == tops[flight]
    resolved = np.zeros(int(stretch[-1]) + 1, bool)
    resolved[stretch[at_top]] = True
    return np.where(upper & resolved[stretch], flight, -1), samples.piece[edges], base, tops


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
    require_gravity(found, error, gravity)


def _shows_gravity(acceleration: float, error: float, gravity: float) -> bool:
    """Return whether an acceleration is near gravity, and its error too small for chance."""
    return near_gravity(acceleration, gravity) and SCALE_OFF * error < WRONG_SCALE * gravity


def _rough_gravity(samples: Samples, base: float | None) -> tuple[float, float]:
    """Acceleration of the highest flights, and its standard error, m s-2."""
    noise = rough_noise(samples)
    member, _, base, tops = _upper_samples(samples, FIRST_SHARE * noise, base)
    high = high_flights(tops - base, noise)
    return apparent_gravity(samples, np.where(high[member], member, -1), tops.size)


def require_gravity(found: float, error: float, gravity: float) -> None:
    """Raise a TrackError if flights fall with an acceleration (m s-2) far from gravity."""
    # both are NaN, and raise no error, if no flight has enough frames to determine its curvature
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
    """Fit the flights, and select those that are resolved; also return the noise."""
    fits = fit_parabolas(samples, member, piece.size, gravity)
    noise = flight_noise(fits, float(np.ptp(samples.height)))
    with np.errstate(invalid="ignore"):
        high = fits.top(gravity) - base > LEAST_HEIGHT * noise
    resolved, fits, member = keep_resolved(fits, high, member)
    return fits, piece[resolved], member, noise


def keep_resolved(
    fits: Fits, high: NDArray[np.bool_], member: Indices
) -> tuple[Indices, Fits, Indices]:
    """Select the flights that are `high` and have enough samples, and renumber them."""
    resolved = np.flatnonzero(high & (fits.number >= LEAST_SAMPLES))
    if not resolved.size:
        raise TrackError(
            "no flight rises out of the noise: check the heights, their axis, scale and base, or "
            "film faster where flights last fewer than five frames"
        )
    number = np.full(high.size + 1, -1)
    number[resolved] = np.arange(resolved.size)
    return resolved, fits.take(resolved), number[member]


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
    # noise-free positions still have rounding errors
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
    """Return the index of each sample's flight; -1 on the base and during a landing."""
    start, end = ends.up.copy(), ends.down.copy()
    end[junctions.before] = junctions.landing
    start[junctions.before + 1] = junctions.liftoff
    # a time axis on which pieces do not overlap: each has an interval longer than the track
    origin, length = samples.time.min(), 2.0 * np.ptp(samples.time) + 1.0
    place = length * samples.piece + (samples.time - origin)
    margin = exposure / 2.0

    def along(time: Array) -> Array:
        return np.asarray(length * piece + np.clip(time - origin, 0.0, length / 2.0))

    flight = np.searchsorted(along(start), place, side="right") - 1
    inside = (flight >= 0) & (piece[flight] == samples.piece)
    inside &= (samples.time > start[flight] + margin) & (samples.time < end[flight] - margin)
    return np.where(inside, flight, -1)


# -----------------------------------------------------------------------------
# A base at a constant level that differs between particles: a tilted base or camera.
#
# Free flight does not depend on the level: the track of each particle is shifted by the difference
# of its level from the common one, the flights are found, and everything is shifted back.  Flights
# separated by a stay meet below the base, and on a periodic orbit all at the same height.  If all
# bounces of a particle are equal, a low level cannot therefore be distinguished from stays, and is
# replaced by the common level.

# Relative scatter of speeds above which bounces are not equal, many times the effect of noise
DIFFERENT: Final = 0.05


def flights_on_levels(
    samples: Samples, contacts: Contacts, gravity: float, exposure: float = 0.0
) -> Flights:
    """Find flights, with a level for each particle if the bounces contradict a common one.

    They contradict it if the chi-square of the levels about their mean is as improbable as that of
    a poor flight.  The contacts are those of the same samples, found without a level; the other
    arguments are as in `find_flights`.
    """
    level, error, equal = _levels(contacts, int(samples.particle[-1]) + 1)
    known = np.isfinite(error) & ~equal
    known |= equal & (level > _mean(level[known], error[known]))
    off = level - _mean(level[known], error[known])
    chi_square = float(np.sum((off[known] / error[known]) ** 2))
    if known.sum() < 2 or chi_square < chdtri(known.sum() - 1.0, POOR):
        return find_flights(samples, gravity, None, exposure)
    shift = np.where(known, off, 0.0)
    moved = replace(samples, height=samples.height - shift[samples.particle])
    found = find_flights(moved, gravity, None, exposure)
    by_flight, joint = shift[found.particle], found.junctions
    return found._replace(
        fits=found.fits._replace(level=found.fits.level + by_flight),
        junctions=joint._replace(height=joint.height + by_flight[joint.before]),
        levels=found.levels + shift,
        base=float(np.mean(found.levels + shift)),
        base_error=float(np.mean(error[known])),
    )


def _mean(level: Array, error: Array) -> float:
    return float(np.average(level, weights=error**-2.0)) if level.size else float("nan")


def _levels(contacts: Contacts, count: int) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Level (m) at which each particle bounces, its standard error, and whether bounces are equal.

    Level and error are NaN for a particle with too few bounces.
    """
    met = meet(contacts.before, contacts.after, contacts.time, contacts.gravity)
    spread = contacts.noise * np.sqrt(met.height_variance)
    level, error = np.full((2, count), np.nan)
    equal, closing = np.zeros(count, np.bool_), contacts.departure - contacts.arrival
    for p in range(count):
        chosen = contacts.particle == p
        height, speed = contacts.height[chosen], closing[chosen]
        level[p], error[p] = base_level(height, spread[chosen], np.nan)
        speed = speed[np.abs(height - level[p]) < ON_BASE * spread[chosen]]
        equal[p] = speed.size > 0 and speed.std() < DIFFERENT * speed.mean()
    return level, error, equal


# -----------------------------------------------------------------------------
# Flights over a moving base: cut where they meet it, distinguished from stays by their height.
#
# Laws of restitution are then fitted to the contacts, together with the motion of the base.

FIT_ROUNDS: Final = 3
# Steps per period of the highest harmonic in the search for the end of a flight, and bisections of
# the last step
STEPS: Final = 100
HALVINGS: Final = 40
# Quantile of the heights above the base taken as the level of a particle without contacts
LOW: Final = 0.25


def with_gravity(inputs: Inputs, samples: Samples, member: Indices, noise: float) -> Inputs:
    """Return the inputs with the apparent gravity that flights measure, if it is not exact.

    `member` is the number of the flight of each sample, -1 for none.
    """
    prior = inputs.gravity
    if not prior.error:
        return inputs
    found = mean_gravity(samples, member, int(member.max()) + 1, noise)
    weights = np.array([prior.error, found.error]) ** -2.0
    if not np.isfinite(found.value):
        return inputs
    value = float(np.average([prior.value, found.value], weights=weights))
    return inputs._replace(gravity=Input(value, float(weights.sum() ** -0.5)))


def flights_over(
    samples: Samples, cut: Cut, base_fit: BaseFit, exposure: float, inputs: Inputs
) -> Flights:
    """Find the flights over a moving base from a first fit of its motion, and refine that fit.

    `exposure` is the exposure time (s), `inputs` are priors of flights and contacts.
    Raises a TrackError if there is no flight, or if too few contacts are left.
    """
    member, fall = cut.member, cut.contacts.gravity
    free, trace = base_fit.problem.frequency is None, base_fit.problem.trace
    noise = np.inf
    for turn in range(FIT_ROUNDS):
        if inputs.gravity.error and turn:  # frames during contacts may have biased the first one
            fall = base_fit.gravity[0]
            if not near_gravity(fall, inputs.gravity.value):
                raise TrackError(UNDETERMINED)
        levels = _levels_below(base_fit, samples)
        below = levels[samples.particle] + base_fit.oscillation.height(samples.time)
        fits = fit_parabolas(samples, member, int(member.max()) + 1, fall)
        noise = min(noise, flight_noise(fits, float(np.ptp(samples.height))))
        member, fits = _keep_flights(samples, member, fits, below, noise, fall)
        start = np.flatnonzero(np.diff(np.maximum.accumulate(member), prepend=-1))
        piece, owner = samples.piece[start], samples.particle[start]
        ends = _ends(samples, member, fits, levels[owner], base_fit, fall, cut.contacts.drag)
        contact = base_fit.lasting(ends.fall, ends.down)
        junctions = join(fits, piece, ends, noise, fall, contact, cut.contacts.drag)
        if turn < FIT_ROUNDS - 1:
            member = assign_samples(samples, piece, junctions, ends, exposure)
        poor = poor_flights(fits, noise)
        sound = ~(junctions.stayed | junctions.overlapping)
        sound &= ~(poor[junctions.before] | poor[junctions.before + 1])
        # a lift-off from rest has no kink: frames before it would distort the flight
        lifted = np.zeros(poor.size, bool)
        lifted[junctions.before[junctions.stayed] + 1] = True
        sound &= ~lifted[junctions.before]
        contacts = contacts_between(samples, member, fits, junctions.before[sound], noise, fall)
        contacts = contacts._replace(drag=cut.contacts.drag)
        own = with_gravity(inputs, samples, np.where(poor[member], -1, member), noise)
        base_fit = fit_base(
            contacts,
            base_fit.oscillation.frequency,
            free=free,
            moves=True,
            trace=trace,
            inputs=own,
            start=(base_fit.values[: base_fit.problem.parameters], levels),
        )
    of_levels = slice(-COUNT - base_fit.levels.size, -COUNT)
    spread = base_fit.covariance[of_levels, of_levels]
    gravity = measured_gravity(samples, member, fits.top(fall) - levels[owner], noise, fall)
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
        *gravity,
        fall,
        base_fit,
    )


def _levels_below(base_fit: BaseFit, samples: Samples) -> Array:
    """Level below each particle; one without contacts is assumed to rest mostly on the base."""
    above = samples.height - base_fit.oscillation.height(samples.time)
    levels = np.array(
        [np.quantile(above[samples.particle == p], LOW) for p in range(samples.particle[-1] + 1)]
    )
    levels[base_fit.particles] = base_fit.levels
    return levels


def _keep_flights(
    samples: Samples, member: Indices, fits: Fits, below: Array, noise: float, fall: float
) -> tuple[Indices, Fits]:
    """Select the stretches that rise clearly above the base, whose heights are `below`."""
    path = fits.take(member).height(samples.time, fall)
    clear = np.full(fits.number.size, -np.inf)
    used = (member >= 0) & np.isfinite(path)
    np.maximum.at(clear, member[used], (path - below)[used])
    _, fits, member = keep_resolved(fits, clear > LEAST_HEIGHT * noise, member)
    return member, fits


def _ends(
    samples: Samples,
    member: Indices,
    fits: Fits,
    level: Array,
    base_fit: BaseFit,
    fall: float,
    drag: float,
) -> Ends:
    """Find the ends of each flight, outwards from its highest sample above the base."""
    base = base_fit.oscillation
    used = member >= 0
    flight, when = member[used], samples.time[used]
    clear = samples.height[used] - level[flight] - base.height(when)
    order = np.lexsort((clear, flight))
    top = when[order[np.searchsorted(flight[order], np.arange(fits.number.size), side="right") - 1]]

    def above(time: Array) -> Array:
        bent = bend(time - fits.centre - fits.slope / fall, fall, drag)
        return np.asarray(fits.height(time, fall) + bent - level - base.height(time))

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
    """Fit the laws of `FITTED` to the contacts of a moving base that are not outliers.

    That of a constant restitution is the fit of the base itself.
    """
    of_base = slice(base_fit.problem.parameters)
    constant = FittedLaw(
        Law(),
        base_fit.values[of_base],
        base_fit.covariance[of_base, of_base],
        base_fit.misfit,
        base_fit.freedom,
        int(base_fit.used.sum()),
        base_fit.distance,
    )
    contacts = base_fit.problem.contacts
    speeds = base_fit.oscillation.velocity(contacts.time) - contacts.arrival
    speeds = np.maximum(speeds[base_fit.used], 1e-6)
    return [constant] + [
        fit_law(name, speeds, lambda law: _fit_law(base_fit.problem._replace(law=law), base_fit))
        for name in FITTED[1:]
    ]


def _fit_law(problem: Problem, base_fit: BaseFit) -> FittedLaw:
    law, start = problem.law, base_fit.values
    if law.parameters:
        start = np.append(start, np.log(law.speed))
    spread = np.sqrt(np.maximum(np.diag(base_fit.covariance), 1e-20))
    scale = np.append(spread, [0.1] * law.parameters)
    try:
        _, found, used, _ = without_outliers(problem, start, scale, base_fit.used)
    except np.linalg.LinAlgError:
        return failed_fit(law, base_fit.used.size)
    covariance, misfit, freedom = covariance_of_fit(found)
    last = found.x.size - law.parameters
    of_law = np.r_[: problem.parameters, last : found.x.size]  # without the levels
    values, spread = with_speed(law, found.x[of_law], covariance[np.ix_(of_law, of_law)])
    return FittedLaw(
        law, values, spread, misfit, freedom, int(used.sum()), problem.distance(found.x)
    )


# -----------------------------------------------------------------------------
# Fit the flights of tracks over a moving base, or over one at a constant level.

MOTIONS: Final = ("detect", "level", "moving")
# Largest fraction of neighbouring flights that may meet above a moving base; otherwise its fit is
# rejected.  In irregular films a correct fit has at most 2 % of them, a wrong one 9 % and more.
TURNED_ABOVE: Final = 0.05
# Scatter of the restitution from bounce to bounce above which the fit is rejected; that of balls is
# below 0.05
MOST_SCATTER: Final = 0.1
FREQUENCIES_APART: Final = 0.01  # largest relative difference of the given frequency from a trace


class Setup(NamedTuple):
    """Information about a recording that its tracks do not contain."""

    base: float | None = None  # height in m at which particles land; None if unknown
    exposure: float = 0.0  # exposure time, s
    # One of `MOTIONS`: the base moves, has a constant level, or the contacts decide
    motion: str = "detect"
    frequency: float | None = None  # frequency of the forcing in Hz; None if unknown
    trace: Trace | None = None  # measured motion of a moving base
    inputs: Inputs | None = None  # of flights and contacts over a moving base
    laws: bool = True  # fit the laws of restitution over a moving base


class FittedTracks(NamedTuple):
    """Tracks with the flights found in them."""

    # samples, flights: measured positions, and parabolas through them
    samples: Samples
    flights: Flights
    swaps: list[tuple[int, int, int]]  # exchanged names, as `find_swaps` returns them
    # Base favoured by the contacts, ``"moving"``, ``"level"`` or ``"undetermined"``; or that of the
    # setup
    favoured_base: str


def fit_tracks(tracks: xr.Dataset, gravity: float, setup: Setup = Setup()) -> FittedTracks:  # noqa: B008
    """Find and fit the flights of tracks; raise the errors of `find_impacts`."""
    _check_setup(gravity, setup)
    if setup.trace is not None:
        setup = setup._replace(trace=setup.trace._replace(gravity=gravity))
    if "base_height" in tracks:
        if setup.trace is not None:
            raise TrackError("a trace and a mark on the base are given: leave one of them out")
        setup = setup._replace(trace=trace_of_mark(tracks, setup.exposure))
    if setup.trace is not None:
        setup = setup._replace(trace=setup.trace.since(tracks.attrs.get("origin", 0.0)))
    _check_trace(setup)
    _check_base(tracks, setup.base)
    time, height = tracks["time"].values, tracks["height"].values
    cuts = np.zeros(height.shape, bool)
    try:
        samples = samples_of(time, height, cuts)
        check_gravity(samples, gravity, setup.base)
        flights, favoured = _flights(samples, gravity, setup)
        highest = float(flights.levels.max())
        if flights.base_fit is not None:
            highest += flights.base_fit.oscillation.reach
        swaps = find_swaps(time, height, flights.noise, highest, gravity)
        if swaps:
            for frame, *pair in swaps:
                cuts[frame, pair] = True
            samples = samples_of(time, height, cuts)
            flights, favoured = _flights(samples, gravity, setup)
    except TrackError as error:
        raise TrackError(f"{tracks.attrs['source']}: {error}") from error
    lasts = INSTANT if setup.inputs is None else setup.inputs.contact
    if flights.base_fit is None and lasts != INSTANT:
        raise TrackError(
            f"{tracks.attrs['source']}: contact = {lasts.value:.2g} s is given, which "
            f"counts over a moving base only, but the landings "
            f"{'favour a base at rest' if favoured == 'level' else 'do not determine its motion'}: "
            f"correct the contact time, or leave it out"
        )
    return FittedTracks(samples, flights, swaps, favoured)


def _flights(samples: Samples, gravity: float, setup: Setup) -> tuple[Flights, str]:
    """Find the flights over the given base or the one favoured by contacts; return its name too."""
    level = setup.motion == "level" or (setup.motion == "detect" and setup.base is not None)
    level = level and setup.trace is None
    if level and setup.base is not None:
        return find_flights(samples, gravity, setup.base, setup.exposure), "level"
    fall, favoured, problem = gravity, "level", TrackError(UNDETERMINED)
    inputs = setup.inputs or Inputs(Input(gravity))
    for _ in range(SCALES):
        cut = find_contacts(samples, fall)
        if inputs.gravity.error and not level:
            own = with_gravity(inputs, samples, cut.member, cut.contacts.noise)
            fall = own.gravity.value
            cut = find_contacts(samples, fall)
        flying, drag = samples, inputs.drag.value
        if drag and not level:  # it would bend long flights into two
            flying = without_drag(samples, cut.member, fall, drag)
            cut = find_contacts(flying, fall)
            cut = cut._replace(contacts=cut.contacts._replace(drag=drag))
        found, error, assumed, over = cut.fall, cut.error, fall, None
        if not level:
            try:
                favoured, over = _over_moving(flying, cut, setup, inputs)
            except TrackError as reason:
                favoured, problem = "undetermined", reason
        if over is not None and over.base_fit is not None:
            found, error = over.gravity, over.gravity_error
            assumed, spread = over.base_fit.gravity
            if not contradicts(found, error, assumed):
                laws = _fit_laws(over.base_fit) if setup.laws else ()
                over = over._replace(laws=laws)
                if inputs.gravity.error:
                    over = over._replace(gravity=assumed, gravity_error=spread)
                return over, favoured
        elif not contradicts(found, error, fall):
            break
        # compared with gravity, so that the total correction of all rounds remains small
        if not near_gravity(found, gravity):
            break
        fall = found
        if not inputs.gravity.error:  # the scale is off by an unknown amount
            inputs = inputs._replace(gravity=Input(fall, WRONG_SCALE * fall))
    if over is not None:  # the flights over this base contradict the assumed acceleration
        favoured = "undetermined"
        problem = TrackError(
            f"over a base that moves, flights fall with {found:.4g} ± {error:.2g} m s-2, but were "
            f"fitted with {assumed:.4g} m s-2: check the scale, the frame rate and the frequency"
        )
    if not level and (setup.motion == "moving" or setup.trace is not None):
        raise problem
    return flights_on_levels(samples, cut.contacts, gravity, setup.exposure), favoured


def _over_moving(
    samples: Samples, cut: Cut, setup: Setup, inputs: Inputs
) -> tuple[str, Flights | None]:
    """Return the base favoured by contacts, and the flights over it if it moves, else None."""
    own = with_gravity(inputs, samples, cut.member, cut.contacts.noise)
    if setup.trace is None:
        favoured, base_fit = which_base(
            cut.contacts, setup.frequency, own, setup.motion == "moving"
        )
    else:
        favoured, rate = "moving", float(setup.trace.values[2])
        base_fit = fit_base(
            cut.contacts, rate, free=True, moves=True, trace=setup.trace, inputs=own
        )
    detected = setup.motion == "detect" and setup.trace is None
    if base_fit is None or (detected and favoured != "moving"):
        return favoured, None
    over = flights_over(samples, cut, base_fit, setup.exposure, inputs)
    correct = "" if inputs.contact == INSTANT else ", or correct the contact time"
    above = float(over.junctions.overlapping.mean()) if over.junctions.before.size else 0.0
    if above > TURNED_ABOVE:
        raise TrackError(
            f"{100.0 * above:.0f} % of the flights over the base that was found meet above it, "
            f"which is impossible: the landings do not determine how the base moves; film "
            f"faster or closer, or give the frequency or a trace of the base{correct}"
        )
    if over.base_fit is not None and over.base_fit.problem.scatter > MOST_SCATTER:
        raise TrackError(
            f"over the base that was found restitutions scatter by "
            f"{over.base_fit.problem.scatter:.2g}, more than any ball: the landings do not "
            f"determine how the base moves; film faster or closer, or give the frequency or a "
            f"trace of the base{correct}"
        )
    # the contacts of the fitted flights are more accurate, and must favour a moving base too
    if detected and over.base_fit is not None and not moves(over.base_fit):
        return "undetermined", None
    return favoured, over


def _check_setup(gravity: float, setup: Setup) -> None:
    require_parameter("gravity", gravity)
    if setup.frequency is not None:
        require_parameter("frequency", setup.frequency)
    require_number("exposure", setup.exposure, 0.0, 1.0, error=TrackError)
    require_one_of("motion", setup.motion, MOTIONS, TrackError)
    if setup.base is not None:
        require_number("base", setup.base, error=TrackError)
    if not isinstance(setup.trace, Trace | None):
        raise TrackError(f"trace = {setup.trace!r}: must be one that read_trace returned")


def _check_trace(setup: Setup) -> None:
    if setup.base is not None and (setup.motion == "moving" or setup.trace is not None):
        raise TrackError(
            "a height of the base requires a constant level, but a trace or the motion 'moving' is "
            "given: leave the height out"
        )
    if setup.trace is None:
        return
    if setup.motion == "level":
        raise TrackError(
            "a trace requires a base that moves, but the motion 'level' is given: leave one of "
            "them out"
        )
    traced = float(setup.trace.values[2])
    apart = 0.0 if setup.frequency is None else abs(setup.frequency - traced)
    if apart > FREQUENCIES_APART * traced:
        raise TrackError(
            f"the frequency is given as {setup.frequency:g} Hz, but the trace of the base repeats "
            f"at {traced:.6g} Hz: leave the frequency out, or give the trace of this recording"
        )


def _check_base(tracks: xr.Dataset, base: float | None) -> None:
    if base is None:
        return
    middle, top = (float(tracks["height"].quantile(q)) for q in (0.5, 1.0))
    if not base < middle:
        where = "above the whole track" if base > top else "above half of the positions"
        raise TrackError(
            f"{tracks.attrs['source']}: the base at {base:g} m lies {where} (the highest position "
            f"is {top:.4g} m): give the height at which particles land, or leave it out"
        )
