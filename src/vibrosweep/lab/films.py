"""Bounces from films of a ball over a floor."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from vibrosweep.arrays import Array, Flags, Indices
from vibrosweep.errors import TrackError
from vibrosweep.lab.ballistics import (
    DRAG,
    POWER,
    BallInputs,
    Bounces,
    Input,
    derivatives,
    drop_from_apex,
    flight_of,
    from_range,
)
from vibrosweep.lab.flights import (
    Fits,
    Meetings,
    Samples,
    curvatures,
    fit_parabolas,
    line_variance,
    meet,
    stretches,
)
from vibrosweep.lab.recordings import Recording

# -----------------------------------------------------------------------------
# Flights in a track whose scale is not known, and the contacts between them.
#
# The track is cut into parabolas.  The curvature on which those that rise most agree is that of
# free fall; a ball that is held, at rest or in contact has another one.

FEWEST: Final = 10  # positions of a film
SHARP: Final = 0.1  # largest relative error of a curvature from which that of free fall is taken
RESOLVED: Final = 0.06  # and of that of a flight: a rise of about fifteen times the noise
# Relative difference of the curvature of a part of a flight from that of free fall, because errors
# of the centre of a ball change slowly
LOOSE: Final = 0.35
AGREE: Final = 0.05  # relative difference of curvatures in free fall, besides their errors
IN_AIR: Final = 0.15  # the same in air, which bends flights
# Closing speed of two stretches, in units of that of two whole flights, below which they are one
# flight, parted by a bad position or bent by air
PARTED: Final = 0.5
GAP_FRAMES: Final = 8.0  # longest gap in a flight
EXTENSIONS: Final = 6
FAR: Final = 4.5  # distance of an outlier, in standard deviations
# A contact takes at most 20 ms and as many frames
LONGEST_CONTACT: Final = 0.02
CONTACT_FRAMES: Final = 3.5
# Number of bounces that show whether a ball loses energy, and the restitution of the best balls
MANY: Final = 8
LEAST_LOSS: Final = 0.985
STEEP: Final = 8.0  # least rise of an inclined floor over all contacts, in standard deviations


class Film(NamedTuple):
    """Flights in a film, in order, and the contacts between them."""

    samples: Samples
    member: Indices  # number of the flight of each sample, -1 for none
    fits: Fits  # parabolas
    begin: Array  # times of the first and last sample of each flight
    end: Array
    gravity: float  # curvature of the parabolas
    noise: float  # standard deviation of a sample
    # before, time, height, speed: numbers of the flights that end in contacts, where these meet the
    # next ones, and the speeds of arrival; shape (contact,)
    before: Indices
    time: Array
    height: Array
    speed: Array


def flights_in(time: Array, height: Array, unit: float, name: str) -> Film | None:
    """Return the flights in a film and their contacts, or None if there is no flight.

    `unit` is a second in units of the time.
    """
    none = np.zeros(time.size, np.intp)
    samples = Samples(time, height, np.arange(time.size), none, none)
    member, noise = stretches(samples, None)
    curvature, error = _curvatures(samples, member, noise)
    g = _shared_curvature(curvature, error, np.ptp(time) * np.bincount(member) / time.size)
    if np.isnan(g):
        return None
    if g < 0.0:
        raise TrackError(f"{name}: the ball falls upwards: reverse the axis (--axis)")
    step = float(np.median(np.diff(time)))
    member = _chosen(member, (error < SHARP * g) & (np.abs(curvature - g) < LOOSE * g))
    if member.max() < 0:
        return None
    fits, begin, end = _flights(samples, member, g)
    met = _meet(fits, g)
    parted = met.closing < PARTED * g * np.diff(fits.centre)
    parted &= begin[1:] - end[:-1] < GAP_FRAMES * step
    number = np.cumsum(np.append(True, ~parted)) - 1
    member, noise = _extended(samples, np.where(member >= 0, number[member], -1), GAP_FRAMES * step)
    curvature, error = _curvatures(samples, member, noise)
    member = _chosen(member, (error < RESOLVED * g) & (np.abs(curvature - g) < IN_AIR * g))
    if member.max() < 0:
        return None
    fits, begin, end = _flights(samples, member, g)
    met = _meet(fits, g)
    fall = g * (met.time - fits.centre[:-1]) - fits.slope[:-1]
    rise, gap = met.closing - fall, begin[1:] - end[:-1]
    meets = (met.time > end[:-1] - 2.0 * step) & (met.time < begin[1:] + 2.0 * step) & (rise > 0.0)
    meets &= gap < LONGEST_CONTACT * unit + CONTACT_FRAMES * step
    if meets.sum() >= MANY and np.median((rise / fall)[meets]) > LEAST_LOSS:
        raise TrackError(
            f"{name}: the ball loses no energy over {meets.sum()} bounces, as over a base that "
            f"shakes: use vibrosweep lab impacts, or vs.lab.find_impacts"
        )
    k = np.flatnonzero(meets & (rise < 1.1 * fall))
    return Film(
        *(samples, member, fits, begin, end, g, noise),
        *(k, met.time[k], met.height[k], fall[k]),
    )


def _curvatures(samples: Samples, member: Indices, noise: float) -> tuple[Array, Array]:
    """Return the curvature of each stretch and its error."""
    curvature, weight = curvatures(samples, member, int(member.max()) + 1)
    with np.errstate(divide="ignore"):
        return curvature, noise / np.sqrt(weight)


def _chosen(member: Indices, chosen: Flags) -> Indices:
    """Renumber the chosen stretches, and leave the others out."""
    number = np.where(chosen, np.cumsum(chosen) - 1, -1)
    return np.where(member >= 0, number[member], -1)


def _extended(samples: Samples, member: Indices, reach: float) -> tuple[Indices, float]:
    """Add neighbouring samples within `reach` (s) that continue flights; also return the noise."""
    time, count, least = samples.time, int(member.max()) + 1, 1e-9 * float(np.ptp(samples.height))
    for _ in range(EXTENSIONS):
        own, weight = curvatures(samples, member, count)
        fits = fit_parabolas(samples, member, count, own)
        noise = float(np.sqrt(fits.residue.sum() / np.maximum(fits.number - 3.0, 1.0).sum()))
        noise = max(noise, least)
        for shift in (1, -1, 2, -2):  # next to the flight, or after a bad position
            flight = np.roll(member, shift)
            near = (member < 0) & (flight >= 0) & (np.abs(time - np.roll(time, shift)) < reach)
            one = fits.take(flight)
            bend = (time - one.centre) ** 2 - one.spread / one.number
            spread = 1.0 + line_variance(one, time) + bend**2 / (4.0 * weight[flight])
            off = np.abs(samples.height - one.height(time, own[flight])) / np.sqrt(spread)
            member = np.where(near & (off < FAR * noise), flight, member)
    return member, noise


def _flights(
    samples: Samples, member: Indices, curvature: Array | float
) -> tuple[Fits, Array, Array]:
    """Fit parabolas; also return the times of their first and last samples."""
    used, number = np.flatnonzero(member >= 0), np.arange(int(member.max()) + 1)
    begin = samples.time[used[np.searchsorted(member[used], number)]]
    end = samples.time[used[np.searchsorted(member[used], number, "right") - 1]]
    return fit_parabolas(samples, member, number.size, curvature), begin, end


def _meet(fits: Fits, g: float) -> Meetings:
    """Return where each flight meets the next one."""
    number = np.arange(fits.number.size - 1)
    one, two = fits.take(number), fits.take(number + 1)
    return meet(one, two, (one.centre + two.centre) / 2.0, g)


def _shared_curvature(curvature: Array, error: Array, length: Array) -> float:
    """Return the curvature on which most stretches agree; NaN without a clear stretch.

    A stretch is weighted by its rise above its chord, zero for a ball that is held or at rest.
    """
    sharp = error < SHARP * np.abs(curvature)
    if not sharp.any():
        return np.nan
    a, error, rise = curvature[sharp], error[sharp], (np.abs(curvature) * length**2)[sharp]
    near = np.abs(a - a[:, None]) < AGREE * np.abs(a) + 3.0 * error
    best = near[np.argmax(near @ rise)]
    return float(np.average(a[best], weights=rise[best]))


def chains_of(film: Film) -> list[Indices]:
    """Return chains of flights connected by contacts with the floor."""
    # a contact with a hand is at another height; for a long one the parabolas meet below the floor
    level = np.median(film.height) if film.height.size else 0.0
    near = np.abs(film.height - level) < 8.0 * film.noise + 0.2 * film.speed**2 / film.gravity
    before = film.before[near]
    parts = np.split(before, np.flatnonzero(np.diff(before) != 1) + 1) if before.size else []
    return [np.append(part, part[-1] + 1) for part in parts]


def slope_of_floor(film: Film, horizontal: Array) -> float:
    """Return the slope of an inclined floor from its contacts; 0 unless it is significant."""
    x, y, noise = np.interp(film.time, film.samples.time, horizontal), film.height, film.noise
    if x.size < 3 or np.ptp(x) < 20.0 * noise:
        return 0.0
    # median over pairs of contacts, robust against a contact with a hand
    one, two = np.triu_indices(x.size, 1)
    wide = np.abs(x[two] - x[one]) > 0.2 * np.ptp(x)
    slope = float(np.median((y[two] - y[one])[wide] / (x[two] - x[one])[wide]))
    left = y - slope * x
    spread = max(1.48 * float(np.median(np.abs(left - np.median(left)))), noise)
    return slope if abs(slope) * np.ptp(x) > STEEP * spread else 0.0


# -----------------------------------------------------------------------------
# Bounces from films of a ball over a floor.
#
# All flights are fitted together, with the level of the floor, the contact time and the drag as
# common parameters, so that a landing follows from the preceding flight.

CONTACT_ERROR: Final = 0.02  # s: wide prior of the contact time in a film, for the pooled fit
UNRESOLVED: Final = 0.1  # error of e from which a bounce is not resolved
DRIFT: Final = 0.005  # prior of the drift of the level in a film, in units of the range of heights
SLOPE: Final = 0.02  # error of the slope of an inclined floor as first found
RATE: Final = 120.0  # frames per second that are assumed for the drag if they are not known
# A floor is inclined if a level one leaves residuals larger by the first factor, or less than the
# second share of the positions in flights
WORSE: Final = 1.5
EXPLAINED: Final = 0.9
MOST_STEPS: Final = 50  # of a fit; flights that do not fit one floor take hundreds
TURNS: Final = 4  # fits, each to the samples in flight according to the previous one
COMMON: Final = 6  # parameters of all flights: curvature, level, contact, drag, p, drift


class FilmFit(NamedTuple):
    """Flights of a film."""

    time: Array  # of samples in flights
    height: Array
    residual: Array  # in the unit of the file
    fitted: Array
    noise: float


# The bounces of a film, its fit, and a remark if it has none
_OfFilm = tuple[Bounces | None, FilmFit | None, str]


class _Problem:
    """Samples of chains of flights, and their model.

    Parameters: curvature, level, contact time (at the median speed), drag, exponent p of the
    contact time, and drift of the camera, the rate at which all heights increase, or the error of
    the slope of an inclined floor; then the times of the first apex of each chain, and the nominal
    speeds of all flights.  Times are in s relative to the middle, heights in the unit of the file.
    """

    def __init__(
        self, film: Film, chains: list[Indices], along: Array, priors: tuple[Input, ...]
    ) -> None:
        self.time, self.height, self.noise = film.samples.time, film.samples.height, film.noise
        self.along = along - along.mean()
        self.priors, g = np.array([prior[:2] for prior in priors]).T, film.gravity
        flights = np.concatenate(chains)
        self.chain = np.repeat(np.arange(len(chains)), [chain.size for chain in chains])
        self.first = np.flatnonzero(np.diff(self.chain, prepend=-1))
        self.lands = np.diff(self.chain, append=-1) == 0  # on the floor, and bounces
        self.begin, self.end = film.begin[flights], film.end[flights]
        self.margin = 0.5 * float(np.median(np.diff(self.time)))
        self.found = film.member >= 0
        fits = film.fits.take(flights)
        level = float(np.median(film.height[np.isin(film.before, flights[self.lands])]))
        rises = np.maximum(fits.top(g) - level, 1e-3 * np.ptp(self.height))
        speeds, apices = np.sqrt(2.0 * g * rises), (fits.centre + fits.slope / g)[self.first]
        self.start = np.concatenate([[g, level], self.priors[0], apices, speeds])
        self.speed = float(np.median(speeds[self.lands]))

    def flights(self, p: Array) -> tuple[Array, ...]:
        """Return speeds of lift-off and of landing, and times of lift-off, apex and landing."""
        apices, speeds = np.split(p[COMMON:], [self.first.size])
        up, down, rise, fall = flight_of(speeds, p[0], p[3])
        contact = p[2] * (np.abs(speeds) / self.speed) ** -p[4]
        later = np.cumsum(np.append(0.0, (fall + contact)[:-1] + rise[1:]))
        apex = apices[self.chain] + later - later[self.first][self.chain]
        return up, down, apex - rise, apex, apex + fall

    def bounces(self, p: Array, metre: float) -> tuple[Array, Array]:
        """Return the restitutions with contact time and drag (s2 m-2); and the impact speeds."""
        up, down, *_ = self.flights(p)
        e = up[1:][self.lands[:-1]] / down[self.lands]
        return np.append(e, [p[2], p[3] / metre**2]), down[self.lands]

    def flight(self, p: Array) -> Indices:
        """Return the number of the flight of each sample, -1 for none and on the floor."""
        _, _, up, _, down = self.flights(p)
        begin, end = up + self.margin, down - self.margin
        # only as far as found where hands may hold the ball
        begin[self.first] = self.begin[self.first]
        end[~self.lands] = np.minimum(end, self.end)[~self.lands]
        number = np.searchsorted(begin, self.time, "right") - 1
        return np.where((number >= 0) & (self.time <= end[number]), number, -1)

    def model(self, p: Array, flight: Indices, samples: Indices | slice) -> Array:
        """Return the heights of samples, whose flights are given."""
        apex, speed = self.flights(p)[3][flight], p[COMMON + self.first.size :][flight]
        fallen = drop_from_apex(self.time[samples] - apex, p[0], p[3])
        return np.asarray(p[1] + p[5] * self.along[samples] + speed**2 / (2.0 * p[0]) - fallen)

    def solve(self) -> tuple[Array, Array, Indices, Array, float]:
        """Return parameters, covariance, numbers of the samples, residuals and noise."""
        p, noise, (means, widths) = self.start, self.noise, self.priors
        loose = np.maximum(np.abs(p), 1.0)
        loose[1] += np.ptp(self.height)
        loose[2:COMMON] = np.inf
        sound = self.found
        for _ in range(TURNS):
            flight = self.flight(p)
            every = np.flatnonzero((flight >= 0) & sound)
            if every.size <= p.size:
                raise np.linalg.LinAlgError

            def off(p: Array, of=flight[every], every=every, noise=noise) -> Array:  # type: ignore[no-untyped-def]
                left = (self.height[every] - self.model(p, of, every)) / noise
                # weak priors for parameters that no sample determines
                weak = (p - self.start) / loose
                return np.concatenate([left, (p[2:COMMON] - means) / widths, weak])

            scale = np.maximum(np.abs(p), 1e-3)
            found = least_squares(off, p, x_scale=scale, max_nfev=MOST_STEPS)
            p = found.x
            left = found.fun[: every.size] * noise
            noise = float(np.sqrt(left @ left / max(every.size - p.size, 1)))
            noise = max(noise, 1e-9 * float(np.ptp(self.height)))
            limit = FAR * 1.4826 * float(np.median(np.abs(left)))
            sound = np.abs(self.height - self.model(p, flight, slice(None))) < max(limit, 1e-12)
        jacobian = np.asarray(found.jac)
        return p, np.linalg.inv(jacobian.T @ jacobian), every, left, noise


def bounces_of_film(recording: Recording, inputs: BallInputs, tilt: float = 0.0) -> _OfFilm:
    """Return the bounces of a film, its fit, and a remark if it has none."""
    track = np.asarray(recording.height, np.float64)
    seen = np.isfinite(track) & np.isfinite(recording.time)
    time, height = recording.time[seen], track[seen]
    if time.size < FEWEST:
        return None, None, f"{recording.name}: no bounce; has only {time.size} positions"
    middle = float(time.mean())
    time = time - middle
    rate = 1.0 if recording.rate_known else RATE
    film = flights_in(time, height, rate, recording.name)
    if film is None:
        return None, None, f"{recording.name}: no flight was found"
    if recording.horizontal is not None and not tilt:
        slope = slope_of_floor(film, recording.horizontal[seen])
        if slope:
            level = bounces_of_film(replace(recording, horizontal=None), inputs)
            inclined = bounces_of_film(*_along_normal(recording, inputs, slope), np.arctan(slope))
            return level if _explains(level, inclined, slope) else inclined
    chains = chains_of(film)
    if not chains:
        curvature, weight = curvatures(film.samples, film.member, film.begin.size)
        k = weight.argmax()
        g = Input(float(curvature[k]), film.noise / float(np.sqrt(weight[k])))
        return None, None, f"{recording.name}: no bounce; {_scale_text(recording, g, inputs)}"
    along = recording.horizontal[seen] if tilt and recording.horizontal is not None else time
    return _fitted(recording, inputs, film, along, middle, chains, tilt)


def _explains(level: _OfFilm, inclined: _OfFilm, slope: float) -> bool:
    """Return whether a level floor describes a film about as well as an inclined one.

    Parabolas meet below a soft floor, the deeper the faster the ball is, as if it were inclined.
    """
    one, other = level[1], inclined[1]
    if level[0] is None or one is None or inclined[0] is None or other is None:
        return level[0] is not None
    # in vertical distances, of which those along the normal are a part
    fits = one.noise < WORSE * other.noise * np.hypot(1.0, slope)
    return bool(fits and one.time.size > EXPLAINED * other.time.size)


def _along_normal(
    recording: Recording, inputs: BallInputs, slope: float
) -> tuple[Recording, BallInputs]:
    """Return heights along the normal of an inclined floor, and the normal component of gravity."""
    cosine = 1.0 / np.hypot(1.0, slope)
    normal = (np.asarray(recording.height) - slope * np.asarray(recording.horizontal)) * cosine
    g = inputs.gravity
    return (
        replace(recording, height=normal),
        replace(inputs, gravity=Input(g.value * cosine, g.error * cosine)),
    )


def _scale_text(recording: Recording, g: Input, inputs: BallInputs) -> str:
    if not recording.rate_known:
        return f"free fall at {_pm(g)} units of the file per squared frame"
    if recording.scale_known:
        return f"apparent gravity {_pm(g)} m/s2"
    scale = inputs.gravity.value / g.value
    found = Input(
        scale, scale * np.hypot(g.error / g.value, inputs.gravity.error / inputs.gravity.value)
    )
    return f"scale from gravity: {_pm(found)} m per unit of the file"


def _pm(one: Input) -> str:
    return f"{one.value:.5g} ± {one.error:.2g}"


def _fitted(
    recording: Recording,
    inputs: BallInputs,
    film: Film,
    along: Array,
    middle: float,
    chains: list[Indices],
    tilt: float,
) -> _OfFilm:
    time, height = film.samples.time, film.samples.height
    own, timed = recording.scale_known and not inputs.scale_from_gravity, recording.rate_known
    rate = 1.0 if timed else RATE
    # m/s per unit of speed; from gravity, unless the scale of the file is used
    metre = rate if own else inputs.gravity.value / film.gravity / rate
    drag = inputs.drag or from_range(*DRAG)
    wide = Input(drag.value * metre**2, max(20.0 * drag.error, 1e-6) * metre**2)
    step = float(np.median(np.diff(time)))
    # without a frame rate contacts last for up to a few frames
    contact = Input(inputs.contact.value, CONTACT_ERROR) if timed else Input(0.5 * step, 2.0 * step)
    # parabolas meet below a soft floor, so that its slope is known roughly
    drift = Input(0.0, SLOPE if tilt else DRIFT * float(np.ptp(height) / np.ptp(time)))
    problem = _Problem(film, chains, along, (contact, wide, POWER, drift))
    try:
        # trial values of the fit may be impossible
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            p, covariance, every, left, noise = problem.solve()
    except (np.linalg.LinAlgError, ValueError):
        return None, None, f"{recording.name}: no bounce; its flights do not fit one floor"
    covariance *= _inflation(left)

    rows, v = problem.bounces(p, metre)
    steps = 1e-3 * np.sqrt(np.diag(covariance))
    jacobian = derivatives(lambda at: problem.bounces(at, metre)[0], p, steps)
    landings = problem.flights(p)[4][problem.lands]
    g = Input(float(p[0]), float(np.sqrt(covariance[0, 0])))
    n, means = v.size, {"contact": inputs.contact, "drag": drag}
    slopes = {key: np.zeros(n + 2) for key in means}
    slopes["contact"][n] = slopes["drag"][n + 1] = 1.0
    unit = 1.0 if own else inputs.gravity.value / g.value
    degrees = abs(np.degrees(tilt + p[5] * np.cos(tilt)))
    inclined = [f"the floor is inclined by {degrees:.2f} degrees"] if tilt else []
    fit = FilmFit(time[every] + middle, height[every], left, height[every] - left, noise)
    fixed = jacobian @ covariance @ jacobian.T
    # in frames, contact and drag have no meaning beyond this film
    resolved = np.append(np.diag(fixed)[:n] < UNRESOLVED**2, [timed, timed])
    measured = {name: rows[n + k] - means[name].value for k, name in enumerate(means)}
    if not resolved[:n].any():
        text = _scale_text(recording, g, inputs)
        return None, None, f"{recording.name}: no bounce is resolved; {text}"
    seen = resolved[:n]
    bounces = Bounces(
        name=recording.name,
        group=recording.group,
        restitution=rows[:n][seen],
        speed=v[seen] * unit,
        time=(landings + middle)[seen],
        fixed=fixed[np.ix_(resolved, resolved)],
        timing=np.zeros((resolved.sum(), resolved.sum())),
        inputs={key: slope[resolved] for key, slope in slopes.items()},
        found=measured if timed else {},
        speed_known=timed and (recording.scale_known or inputs.scale_from_gravity),
        gravity=g,
        remarks=(_scale_text(recording, g, inputs), *inclined),
    )
    return bounces, fit, ""


def _inflation(left: Array) -> float:
    """Return the inflation of variances due to the autocorrelation of residuals."""
    correlation = float(left[1:] @ left[:-1] / (left @ left)) if left.any() else 0.0
    correlation = min(correlation, 0.9) if correlation > 2.0 / np.sqrt(left.size) else 0.0
    return (1.0 + correlation) / (1.0 - correlation)
