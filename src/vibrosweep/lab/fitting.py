"""Find flights in tracks over a base that moves or is at rest, iteratively."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.special import chdtri

from vibrosweep.arrays import Array, Flags, Indices
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
    Oscillation,
    Problem,
    Trace,
    contacts_between,
    covariance_of_fit,
    find_contacts,
    fit_base,
    likeliest,
    moves,
    which_base,
    without_drag,
    without_outliers,
)
from vibrosweep.lab.flights import (
    SCALE_OFF,
    WRONG_SCALE,
    Ends,
    Fits,
    Junctions,
    Samples,
    apparent_gravity,
    clear_flights,
    contradicts,
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
# Flights of all particles, with their junctions and the base below them.

# Smallest number of samples of a flight, one more than its unknowns, and its smallest height in
# units of the noise
LEAST_SAMPLES: Final = 3
LEAST_HEIGHT: Final = 4.0
# Significance level of the test for poor flights: one good flight in a million fails it
POOR: Final = 1e-6
# Largest number of trial accelerations, each found from flights fitted with the previous one
SCALES: Final = 3


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
# A base at rest: its level below each particle, from the heights at which flights meet.
#
# Parabolas separated by a stay meet below the base, on a periodic orbit all at the same height.  If
# the positions between flights lie clearly above that height, they are the level.

# Quantile of the heights at which flights meet, the first estimate of a level: high because of
# stays.  Of the heights of stays it is low, because bounces too low to be seen lie above the base.
FROM_ABOVE: Final = 0.8
# Distance from the base, in standard errors, within which flights meet on it
ON_BASE: Final = 4.0
LEVEL_ROUNDS: Final = 5
# Smallest number of stays for each contact at which they can be the level
STAYS: Final = 0.25
LOWEST: Final = 0.01  # quantile of the positions of a particle, which the base is not above


class Heights(NamedTuple):
    """Heights that are on the base, with their errors, m; arrays of shape (height,)."""

    particle: Indices
    height: Array
    error: Array

    def take(self, chosen: Flags) -> Heights:
        """Return the chosen heights."""
        return Heights._make(values[chosen] for values in self)

    def level(self, particle: int, quantile: float) -> tuple[float, float]:
        """Weighted mean of the heights of a particle that agree with one near a quantile.

        Returns it with its error; NaN without heights.
        """
        own = (self.particle == particle) & np.isfinite(self.height) & np.isfinite(self.error)
        height, weight = self.height[own], self.error[own] ** -2.0
        if not height.size:
            return float("nan"), float("nan")
        # weighted, because two parts of one flight meet anywhere, but not accurately
        order = np.argsort(height)
        total = np.cumsum(weight[order])
        level = float(height[order][np.searchsorted(total, quantile * total[-1])])
        for _ in range(LEVEL_ROUNDS):
            near = np.abs(height - level) * np.sqrt(weight) < ON_BASE
            if near.any():
                level, chosen = float(np.average(height[near], weights=weight[near])), near
        return level, float(weight[chosen].sum() ** -0.5)


class Rest(NamedTuple):
    """A base at rest."""

    levels: Array  # height of the base below each particle, m
    # level, error: mean height, and the standard error of a level, m
    level: float
    error: float
    # True for a particle whose level is that of its stays; empty if the level is given
    stays: Flags
    oscillation: Oscillation = Oscillation(np.array([0.0, 0.0, 1.0]))


def base_at_rest(samples: Samples, cut: Cut, known: float | None, exposure: float) -> Rest:
    """Return the base at the height `known` (m), or at that of the contacts or stays of a cut."""
    contacts, particles = cut.contacts, int(samples.particle[-1]) + 1
    if known is not None:
        return Rest(np.full(particles, known), known, 0.0, np.zeros(0, bool))
    # bounces too low to be seen rise above the base by less than the height of a flight
    least = LEAST_HEIGHT * contacts.noise
    lowest = [np.quantile(samples.height[samples.particle == p], LOWEST) for p in range(particles)]
    meetings, rests = (
        one.take(one.height < np.array(lowest)[one.particle] + least + ON_BASE * one.error)
        for one in (_meetings(contacts), _rests(samples, cut, exposure))
    )
    level = low_points(samples, contacts.noise, None)[1]
    base = Rest(np.full(particles, level), level, float("nan"), np.zeros(particles, bool))
    base = _levels(base, meetings, rests, 0.5)
    count = np.bincount(meetings.particle, None, particles)
    for p in np.unique(rests.particle):
        met = meetings.level(p, FROM_ABOVE)[0] if count[p] else base.level
        above = rests.level(p, 1.0 - FROM_ABOVE)[0] > met + least
        often = np.sum(rests.particle == p) > STAYS * count[p]
        base.stays[p] = often and (np.isnan(base.error) or above)
    return _levels(base, meetings, rests, 1.0 - FROM_ABOVE)


def _meetings(contacts: Contacts) -> Heights:
    """Heights at which flights meet."""
    met = meet(contacts.before, contacts.after, contacts.time, contacts.gravity)
    return Heights(contacts.particle, met.height, contacts.noise * np.sqrt(met.height_variance))


def _rests(samples: Samples, cut: Cut, exposure: float) -> Heights:
    """Mean heights of the samples between flights that differ by noise alone.

    Those that last less than the `exposure` (s) are left out: they may contain a landing.
    """
    noise, fall = cut.contacts.noise, cut.contacts.gravity
    fits = fit_parabolas(samples, cut.member, int(cut.member.max()) + 1, fall)
    clear = clear_flights(samples, cut.member, fits, noise, fall)
    flies = (cut.member >= 0) & clear[cut.member]
    # runs of samples in flight or not
    new = (np.diff(flies, prepend=False) != 0) | (np.diff(samples.piece, prepend=-1) != 0)
    start, run = np.flatnonzero(new), np.cumsum(new) - 1
    last = np.append(start[1:], run.size) - 1
    count = last - start + 1
    height = np.bincount(run, samples.height) / count
    residue = np.bincount(run, (samples.height - height[run]) ** 2)
    still = residue <= noise**2 * _chi_square(POOR, np.maximum(count - 1.0, 1.0))
    still &= ~flies[start] & (samples.time[last] - samples.time[start] >= exposure)
    still &= noise > 0.0  # heights that never change
    return Heights(samples.particle[start], height, noise / np.sqrt(count)).take(still)


def _refined(
    base: Rest,
    samples: Samples,
    member: Indices,
    owner: Indices,
    joint: Junctions,
    sound: Flags,
    noise: float,
) -> Rest:
    """Return the base with levels from the `sound` junctions, or from samples in no flight."""
    sound = sound | np.isnan(base.error)  # all of them if the level is only a guess
    meetings = Heights(owner[joint.before], joint.height, joint.height_error)
    rests = Heights(samples.particle, samples.height, np.full(member.size, noise))
    return _levels(base, meetings.take(sound), rests.take(member < 0), 0.5)


def _levels(base: Rest, meetings: Heights, rests: Heights, quantile: float) -> Rest:
    """Levels from heights at which flights meet or, where there are stays, of `rests`.

    They differ if their chi-square about the mean is as improbable as that of a poor flight; those
    of particles without such heights stay as they are in `base`.
    """
    stays = base.stays
    if not stays.size:
        return base
    found = [
        rests.level(p, quantile) if stay else meetings.level(p, FROM_ABOVE)
        for p, stay in enumerate(stays)
    ]
    level, error = np.array(found).T
    known = np.isfinite(level)
    if not known.any():
        return base
    weight = error[known] ** -2.0
    mean = float(np.average(level[known], weights=weight))
    chi_square = float(weight @ (level[known] - mean) ** 2)
    if known.sum() > 1 and chi_square >= chdtri(known.sum() - 1.0, POOR):
        levels = np.where(known, level, mean if np.isnan(base.error) else base.levels)
        return Rest(levels, float(np.mean(levels)), float(np.mean(error[known])), stays)
    return Rest(np.full(stays.size, mean), mean, float(weight.sum() ** -0.5), stays)


# -----------------------------------------------------------------------------
# Flights over a base, at rest or moving: cut where they meet it, distinguished from stays by their
# height.
#
# Over a moving one, laws of restitution are fitted to the contacts together with its motion.

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
    samples: Samples, cut: Cut, base: BaseFit | Rest, exposure: float, inputs: Inputs
) -> Flights:
    """Find the flights over a base from a first estimate of its motion or level, and refine that.

    `exposure` is the exposure time (s), `inputs` are priors of flights and contacts.
    Raises a TrackError if there is no flight, or if too few contacts are left.
    """
    member, fall = cut.member, cut.contacts.gravity
    noise, contact = np.inf, np.zeros(1)
    for turn in range(FIT_ROUNDS):
        if isinstance(base, BaseFit) and inputs.gravity.error and turn:
            fall = base.gravity[0]  # frames during contacts may have biased the first one
            if not near_gravity(fall, inputs.gravity.value):
                raise TrackError(UNDETERMINED)
        levels = base.levels if isinstance(base, Rest) else _levels_below(base, samples)
        member, fits, start, ends, noise = _whole_flights(
            samples, member, base.oscillation, levels, noise, (fall, cut.contacts.drag)
        )
        piece, owner = samples.piece[start], samples.particle[start]
        if isinstance(base, BaseFit):
            contact = base.lasting(ends.fall, ends.down)
        junctions = join(fits, piece, ends, noise, fall, contact, cut.contacts.drag)
        if turn < FIT_ROUNDS - 1:
            member = assign_samples(samples, piece, junctions, ends, exposure)
        poor = poor_flights(fits, noise)
        sound = _sound(junctions, poor)
        if isinstance(base, Rest):
            base = _refined(base, samples, member, owner, junctions, sound, noise)
            continue
        contacts = contacts_between(samples, member, fits, junctions.before[sound], noise, fall)
        contacts = contacts._replace(drag=cut.contacts.drag)
        own = with_gravity(inputs, samples, np.where(poor[member], -1, member), noise)
        base = fit_base(
            contacts,
            base.oscillation.frequency,
            free=base.problem.frequency is None,
            moves=True,
            trace=base.problem.trace,
            inputs=own,
            start=(base.values[: base.problem.parameters], levels),
        )
    gravity = measured_gravity(samples, member, fits.top(fall) - levels[owner], noise, fall)
    if isinstance(base, Rest):
        base_fit, levels, level, error = None, base.levels, base.level, base.error
    else:
        base_fit, (level, error) = base, _mean_level(base)
    return Flights(
        fits,
        piece,
        owner,
        member,
        poor,
        ends,
        junctions,
        levels,
        level,
        error,
        noise,
        *gravity,
        fall,
        base_fit,
    )


def _whole_flights(
    samples: Samples,
    member: Indices,
    base: Oscillation,
    levels: Array,
    noise: float,
    air: tuple[float, float],
) -> tuple[Indices, Fits, Indices, Ends, float]:
    """Fit the flights that rise clearly above the base, and find their ends.

    `air` is the acceleration of the flights (m s-2) and the drag (s2 m-2).  Returns the number of
    the flight of each sample, the fits, the first sample of each flight, the ends, and the noise
    (m), at most that given.
    """
    below = levels[samples.particle] + base.height(samples.time)
    whole = np.zeros(1, bool)
    while not whole.all():
        fits = fit_parabolas(samples, member, int(member.max()) + 1, air[0])
        found = min(noise, flight_noise(fits, float(np.ptp(samples.height))))
        member, fits = _keep_flights(samples, member, fits, below, found, air[0])
        start = np.flatnonzero(np.diff(np.maximum.accumulate(member), prepend=-1))
        ends = _ends(samples, member, fits, levels[samples.particle[start]], base, *air)
        # two stretches that overlap in time above the base belong to one flight
        whole = np.ones(start.size, bool)
        whole[1:] = (fits.centre[1:] > ends.down[:-1]) & (fits.centre[:-1] < ends.up[1:])
        whole[1:] |= np.diff(samples.piece[start]) != 0
        member = np.append(np.cumsum(whole) - 1, -1)[member]
    return member, fits, start, ends, found


def _sound(junctions: Junctions, poor: Flags) -> Flags:
    """Mark the bounces between two flights that are not `poor`."""
    sound = ~(junctions.stayed | junctions.overlapping)
    sound &= ~(poor[junctions.before] | poor[junctions.before + 1])
    # a lift-off from rest has no kink: frames before it would distort the flight
    lifted = np.zeros(poor.size, bool)
    lifted[junctions.before[junctions.stayed] + 1] = True
    return np.asarray(sound & ~lifted[junctions.before])


def _mean_level(base_fit: BaseFit) -> tuple[float, float]:
    """Mean of the levels below the particles, and the standard error of a level, m."""
    of_levels = slice(-COUNT - base_fit.levels.size, -COUNT)
    spread = base_fit.covariance[of_levels, of_levels]
    return float(np.mean(base_fit.levels)), float(np.sqrt(spread.sum())) / base_fit.levels.size


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
    clear, used = np.full(fits.number.size, -np.inf), member >= 0
    above = fits.take(member[used]).height(samples.time[used], fall) - below[used]
    np.maximum.at(clear, member[used], np.nan_to_num(above, nan=-np.inf))
    resolved = np.flatnonzero((clear > LEAST_HEIGHT * noise) & (fits.number >= LEAST_SAMPLES))
    if not resolved.size:
        raise TrackError(
            "no flight rises out of the noise: check the heights, their axis, scale and base, or "
            "film faster where flights last fewer than five frames"
        )
    number = np.full(clear.size + 1, -1)
    number[resolved] = np.arange(resolved.size)
    return number[member], fits.take(resolved)


def _ends(
    samples: Samples,
    member: Indices,
    fits: Fits,
    level: Array,
    base: Oscillation,
    fall: float,
    drag: float,
) -> Ends:
    """Find the ends of each flight, outwards from its highest sample above the base."""
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
# Tracks in wrong units or with the wrong axis: flights must fall with gravity.

# Fraction of the height of a flight above which samples belong to it, wherever its ends are
UPPER: Final = 0.25
FIRST_SHARE: Final = 0.6  # factor on the first estimate of the noise, which may be too large


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
    """Acceleration of the highest flights, cut at low points, and its standard error, m s-2."""
    noise = rough_noise(samples)
    low, base = low_points(samples, FIRST_SHARE * noise, base)
    edges = np.unique(np.concatenate([samples.bounds[:-1], low]))
    tops = np.maximum.reduceat(samples.height, edges)
    flight = np.searchsorted(edges, np.arange(samples.time.size), side="right") - 1
    high = high_flights(tops - base, noise)[flight]
    upper = high & (samples.height - base > UPPER * (tops[flight] - base))
    upper[low] = False
    # only the stretch around the highest sample, because a stay elsewhere may be equally high
    stretch = np.cumsum(np.diff(np.where(upper, flight, -1), prepend=-2) != 0)
    at_top = upper & np.isin(stretch, stretch[samples.height == tops[flight]])
    return apparent_gravity(samples, np.where(at_top, flight, -1), tops.size)


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
    # Of flights and contacts over a moving base, as in `likeliest`; by default impacts are
    # instantaneous, or last if this fits significantly better
    inputs: Sequence[Inputs] = ()
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
    lasts = setup.inputs[0].contact if setup.inputs else INSTANT
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
    if level and setup.trace is None:
        return _over_rest(samples, gravity, setup), "level"
    fall, favoured, problem = gravity, "level", TrackError(UNDETERMINED)
    instant = Inputs(Input(gravity))
    inputs = setup.inputs or (instant, instant.lasting())
    for _ in range(SCALES):
        cut = find_contacts(samples, fall)
        if inputs[0].gravity.error:
            own = with_gravity(inputs[0], samples, cut.member, cut.contacts.noise)
            fall = own.gravity.value
            cut = find_contacts(samples, fall)
        flying, drag = samples, inputs[0].drag.value
        if drag:  # it would bend long flights into two
            flying = without_drag(samples, cut.member, fall, drag)
            cut = find_contacts(flying, fall)
            cut = cut._replace(contacts=cut.contacts._replace(drag=drag))
        found, error, assumed, over = cut.fall, cut.error, fall, None
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
                if inputs[0].gravity.error:
                    over = over._replace(gravity=assumed, gravity_error=spread)
                return over, favoured
        elif not contradicts(found, error, fall):
            break
        # compared with gravity, so that the total correction of all rounds remains small
        if not near_gravity(found, gravity):
            break
        fall = found
        if not inputs[0].gravity.error:  # the scale is off by an unknown amount
            scale = Input(fall, WRONG_SCALE * fall)
            inputs = [one._replace(gravity=scale) for one in inputs]
    if over is not None:  # the flights over this base contradict the assumed acceleration
        favoured = "undetermined"
        problem = TrackError(
            f"over a base that moves, flights fall with {found:.4g} ± {error:.2g} m s-2, but were "
            f"fitted with {assumed:.4g} m s-2: check the scale, the frame rate and the frequency"
        )
    if setup.motion == "moving" or setup.trace is not None:
        raise problem
    return _over_rest(samples, gravity, setup), favoured


def _over_rest(samples: Samples, gravity: float, setup: Setup) -> Flights:
    """Find the flights over a base at rest, with the acceleration that they have."""
    fall = gravity
    for _ in range(SCALES):
        cut = find_contacts(samples, fall)
        base = base_at_rest(samples, cut, setup.base, setup.exposure)
        try:
            flights = flights_over(samples, cut, base, setup.exposure, Inputs(Input(fall)))
            found, error = flights.gravity, flights.gravity_error
        except TrackError:  # so wrong a curvature cuts all flights into parts
            found, error = _rough_gravity(samples, setup.base)
            if not contradicts(found, error, fall):
                raise
        if not contradicts(found, error, fall):
            return flights
        require_gravity(found, error, gravity)
        fall = found  # parabolas with the wrong curvature would miss the landings
    raise TrackError(
        f"flights fall with {found:.4g} ± {error:.2g} m s-2 when fitted with "
        f"{cut.contacts.gravity:.4g} m s-2, and gravity is {gravity:g} m s-2: no scale fits all "
        f"of them; check the heights, or film faster or closer"
    )


def _over_moving(
    samples: Samples, cut: Cut, setup: Setup, inputs: Sequence[Inputs]
) -> tuple[str, Flights | None]:
    """Return the base favoured by contacts, and the flights over it if it moves, else None."""
    own = [with_gravity(one, samples, cut.member, cut.contacts.noise) for one in inputs]
    if setup.trace is None:
        favoured, base_fit = which_base(
            cut.contacts, setup.frequency, own, setup.motion == "moving"
        )
    else:
        favoured, trace = "moving", setup.trace
        rate = float(trace.values[2])
        base_fit = likeliest(
            own,
            lambda one: fit_base(
                cut.contacts, rate, free=True, moves=True, trace=trace, inputs=one
            ),
        )
    detected = setup.motion == "detect" and setup.trace is None
    if base_fit is None or (detected and favoured != "moving"):
        return favoured, None
    lasting = base_fit.problem.inputs.contact
    chosen = next(one for one in inputs if one.contact == lasting)
    over = flights_over(samples, cut, base_fit, setup.exposure, chosen)
    correct = "" if lasting == INSTANT else ", or correct the contact time"
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
