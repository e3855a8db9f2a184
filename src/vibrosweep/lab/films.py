"""Bounces from films of a ball over a floor."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from vibrosweep.arrays import Array
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
from vibrosweep.lab.recordings import Recording

# -----------------------------------------------------------------------------
# Flights in a track whose scale is not known.
#
# The curvature shared by most stretches of the track is that of free fall.  Stretches with this
# curvature are extended for as long as a parabola fits.

LEAST_SAMPLES: Final = 5  # in a flight
SHARPNESS: Final = 0.2  # largest relative error of the curvature of an initial stretch
RESOLVED: Final = 0.06  # and of a flight: a rise of about fifteen times the noise
STEEP: Final = 8.0  # least rise of an inclined floor over all contacts, in standard deviations
FAR: Final = 4.5  # distance of an outlier, in standard deviations
# A contact takes at most 20 ms and as many frames
CONTACT_FRAMES: Final = 3.5


class Stretch(NamedTuple):
    """Successive samples fitted by a parabola: height, slope and curvature at a centre."""

    samples: NDArray[np.intp]
    centre: float
    length: float
    terms: Array  # height, slope, curvature (positive for free fall)
    errors: Array

    def height(self, time: Array | float, curvature: float) -> Array:
        """Return heights of the parabola with a given curvature."""
        since = np.asarray(time) - self.centre
        return np.asarray(self.terms[0] + self.terms[1] * since - 0.5 * curvature * since**2)


def noise_of(height: Array) -> float:
    """Return the noise of the moving parts of a smooth track, from third differences.

    A ball at rest is tracked more accurately than a moving one.
    """
    third = np.abs(np.diff(height, 3))
    moved = np.abs(height[3:] - height[:-3])
    moving = third[moved >= 0.1 * np.quantile(moved, 0.9)] if third.size else third
    return float(1.48 * np.median(moving) / np.sqrt(20.0)) if moving.size else 0.0


def _parabolas(
    time: Array, height: Array, samples: NDArray[np.intp], noise: float
) -> list[Stretch]:
    """Fit a parabola to each row of samples."""
    t, y = time[samples], height[samples]
    centre, length = t.mean(axis=1), t[:, -1] - t[:, 0]
    # in units of the duration, so that the equations are well conditioned
    since = (t - centre[:, None]) / length[:, None]
    design = np.stack([np.ones_like(since), since, -0.5 * since**2], axis=2)
    inverse = np.linalg.inv(np.einsum("wni,wnj->wij", design, design))
    unit = length[:, None] ** -np.arange(3.0)
    terms = np.einsum("wij,wnj,wn->wi", inverse, design, y) * unit
    errors = noise * np.sqrt(np.einsum("wii->wi", inverse)) * unit
    return [Stretch(*row) for row in zip(samples, centre, length, terms, errors, strict=True)]


def _windows(time: Array, height: Array, noise: float) -> list[Stretch]:
    """Return stretches of various lengths that are parabolas within the noise, longest first."""
    found, length = [], LEAST_SAMPLES
    while length <= time.size:
        starts = np.arange(0, time.size - length + 1, max(1, length // 4))
        for one in _parabolas(time, height, starts[:, None] + np.arange(length), noise):
            left = height[one.samples] - one.height(time[one.samples], one.terms[2])
            if (left @ left) < 1.7**2 * noise**2 * (length - 3) + 1e-300:
                found.append(one)
        length = max(length + 1, int(1.25 * length))
    return found[::-1]


def _shared_curvature(stretches: list[Stretch]) -> float:
    """Return the most common curvature, as half-sample mode; NaN without a stretch.

    A stretch is weighted by its rise above its chord, zero for a ball that is held or at rest.
    """
    sharp = [s for s in stretches if s.errors[2] < SHARPNESS / 2 * abs(s.terms[2])]
    if not sharp:
        return np.nan
    curvature = np.array([s.terms[2] for s in sharp])
    rise = np.abs(curvature) * np.array([s.length**2 for s in sharp]) / 8.0
    copies = np.ceil(200.0 * rise / rise.max()).astype(int) - 1 + (rise == rise.max())
    values = np.sort(np.repeat(curvature, copies))
    while values.size > 2:
        half = min((values.size + 1) // 2 + 1, values.size - 1)
        start = int(np.argmin(values[half - 1 :] - values[: values.size - half + 1]))
        values = values[start : start + half]
    return float(values.mean())


def find_flights(time: Array, height: Array, name: str) -> tuple[list[Stretch], float, float]:
    """Return the flights in chronological order, their curvature, and the noise."""
    step = float(np.median(np.abs(np.diff(height)))) if height.size > 1 else 0.0
    noise = max(noise_of(height), 1e-6 * step, 1e-12 * float(np.ptp(height)))
    stretches = _windows(time, height, noise)
    curvature = _shared_curvature(stretches)
    if curvature < 0.0:
        raise TrackError(f"{name}: the ball falls upwards: reverse the axis (--axis)")
    free = np.ones(time.size, dtype=bool)
    flights = []
    for seed in stretches:
        off = abs(seed.terms[2] - curvature)
        if (
            not free[seed.samples].all()
            or seed.errors[2] > SHARPNESS * curvature
            or off > 5.0 * seed.errors[2] + 0.05 * curvature
        ):
            continue
        extended = _extended(time, height, seed, free, noise)
        free[extended.samples] = False
        off = abs(extended.terms[2] - curvature)
        if extended.errors[2] < RESOLVED * curvature and off < 0.15 * curvature:
            flights.append(extended)
    return sorted(flights, key=lambda s: s.centre), curvature, noise


def _extended(
    time: Array, height: Array, seed: Stretch, free: NDArray[np.bool_], noise: float
) -> Stretch:
    """Extend a stretch on both sides while a parabola fits; single outliers are skipped."""
    now, longest = seed, float(np.median(np.diff(time))) * 8.0
    for side in (1, -1):
        skipped = 0
        place = now.samples[-1 if side > 0 else 0] + side
        while 0 <= place < time.size and free[place] and skipped < 2:
            edge = now.samples[-1 if side > 0 else 0]
            since = time[place] - now.centre
            if abs(time[place] - time[edge]) > longest:
                break
            spread = np.hypot(noise, now.errors @ np.abs([1.0, since, 0.5 * since**2]))
            if abs(height[place] - now.height(time[place], now.terms[2])) < FAR * spread:
                samples = np.sort(np.append(now.samples, place))
                (now,), skipped = _parabolas(time, height, samples[None], noise), 0
            else:
                skipped += 1
            place += side
    return now


class Contact(NamedTuple):
    """Intersection of a flight with the next one."""

    flight: int  # number of the flight that ends
    time: float
    height: float
    speed: float  # of arrival


def contacts_of(flights: list[Stretch], time: Array, curvature: float) -> list[Contact]:
    """Return the contacts between successive flights, wherever the floor is."""
    step = float(np.median(np.diff(time)))
    found = []
    for k, (one, two) in enumerate(pairwise(flights)):
        middle = 0.5 * (one.centre + two.centre)
        up, down = (
            np.array([f.height(middle, curvature), f.terms[1] - curvature * (middle - f.centre)])
            for f in (two, one)
        )
        meeting = middle - (up[0] - down[0]) / (up[1] - down[1]) if up[1] != down[1] else np.inf
        end, start = time[one.samples[-1]], time[two.samples[0]]
        fast = -(down[1] - curvature * (meeting - middle)), up[1] - curvature * (meeting - middle)
        near = end - 2 * step < meeting < start + 2 * step
        if near and 0.0 < fast[1] < 1.1 * fast[0] and start - end < 0.02 + CONTACT_FRAMES * step:
            found.append(Contact(k, meeting, float(one.height(meeting, curvature)), fast[0]))
    return found


def chains_of(contacts: list[Contact], curvature: float, noise: float) -> list[list[int]]:
    """Return chains of flights connected by contacts with the floor."""
    if not contacts:
        return []
    # a contact with a hand is at another height; for a long one the parabolas meet below the floor
    levels, speeds = (
        np.array([getattr(c, name) for c in contacts]) for name in ("height", "speed")
    )
    near_floor = np.abs(levels - np.median(levels)) < 8.0 * noise + 0.2 * speeds**2 / curvature
    chains: list[list[int]] = []
    for (k, *_), good in zip(contacts, near_floor, strict=True):
        if not good:
            continue
        if chains and chains[-1][-1] == k:
            chains[-1].append(k + 1)
        else:
            chains.append([k, k + 1])
    return chains


def slope_of_floor(contacts: list[Contact], time: Array, horizontal: Array, noise: float) -> float:
    """Return the slope of an inclined floor from its contacts; 0 unless it is significant."""
    x, y = (
        np.interp([c.time for c in contacts], time, horizontal),
        np.array([c.height for c in contacts]),
    )
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
RATE: Final = 120.0  # frames per second that are assumed for the drag if they are not known
# A floor is inclined if a level one leaves residuals larger by the first factor, or less than the
# second share of the positions in flights
WORSE: Final = 1.5
EXPLAINED: Final = 0.9
COMMON: Final = 6  # parameters of all flights: curvature, level, contact, drag, p, drift


class FilmFit(NamedTuple):
    """Flights of a film."""

    time: Array  # of samples in flights
    height: Array
    residual: Array  # in the unit of the file
    fitted: Array
    noise: float
    level: float
    gravity: Input


# The bounces of a film, its fit, and a remark if it has none
_OfFilm = tuple[Bounces | None, FilmFit | None, str]


class _Problem:
    """Samples of chains of flights, and their model.

    Parameters: curvature, level, contact time (at the median speed), drag, exponent p of the
    contact time, and drift of the camera, the rate at which all heights increase; then for each
    chain the time of its first apex and the nominal speeds of its flights.  Times are in s relative
    to the middle, heights in the unit of the file.
    """

    def __init__(
        self,
        time: Array,
        height: Array,
        chains: list[list[Stretch]],
        curvature: float,
        priors: tuple[Input, ...],
    ) -> None:
        self.time, self.height, self.priors = time, height, priors
        self.chains, self.noise = chains, 1.0
        step = float(np.median(np.diff(time)))
        self.margin = 0.5 * step
        floors = [
            one.height(0.5 * (time[one.samples[-1]] + time[two.samples[0]]), curvature)
            for chain in chains
            for one, two in pairwise(chain)
        ]
        level = float(np.median(floors))
        start = [curvature, level, *(prior.value for prior in priors)]
        speeds = []
        for chain in chains:
            apices = [f.centre + f.terms[1] / curvature for f in chain]
            tops = [float(f.height(t, curvature)) for f, t in zip(chain, apices, strict=True)]
            rises = np.maximum(np.array(tops) - level, 1e-3 * np.ptp(height))
            speeds.append(np.sqrt(2.0 * curvature * rises))
            start += [apices[0], *speeds[-1]]
        self.start = np.array(start)
        self.speed = float(np.median(np.concatenate([some[:-1] for some in speeds])))

    def pieces(self, p: Array) -> list[tuple[Stretch, float, float, float, float]]:
        """Return each flight with its nominal speed, and times of lift-off, apex and landing."""
        made, place = [], COMMON
        for chain in self.chains:
            apex, speeds = p[place], p[place + 1 : place + 1 + len(chain)]
            place += 1 + len(chain)
            _, _, rise, fall = flight_of(speeds, p[0], p[3])
            contact = p[2] * (np.abs(speeds) / self.speed) ** -p[4]
            for k, flight in enumerate(chain):
                if k:
                    apex = apex + fall[k - 1] + contact[k - 1] + rise[k]
                lift = -np.inf if k == 0 else apex - rise[k]
                made.append((flight, speeds[k], lift, apex, apex + fall[k]))
        return made

    def bounces(self, p: Array, metre: float) -> tuple[Array, Array]:
        """Return the restitutions with contact time and drag (s2 m-2); and the impact speeds."""
        place, e, v = COMMON, [], []
        for chain in self.chains:
            up, down, _, _ = flight_of(p[place + 1 : place + 1 + len(chain)], p[0], p[3])
            e.append(up[1:] / down[:-1])
            v.append(down[:-1])
            place += 1 + len(chain)
        return np.concatenate([*e, [p[2], p[3] / metre**2]]), np.concatenate(v)

    def membership(self, p: Array) -> list[NDArray[np.intp]]:
        """Return the samples of each flight, without those on the floor."""
        members = []
        for flight, _, lift, _, landing in self.pieces(p):
            first, last = flight.samples[0], flight.samples[-1]
            near = np.arange(max(first - 1, 0), min(last + 2, self.time.size))
            if np.isinf(lift):
                near = near[near >= first]
            within = (self.time[near] > lift + self.margin) & (
                self.time[near] < landing - self.margin
            )
            members.append(near[within])
        return members

    def model(self, p: Array, members: list[NDArray[np.intp]]) -> Array:
        """Return the heights of the samples of all flights."""
        parts = []
        for (_, speed, _, apex, _), samples in zip(self.pieces(p), members, strict=True):
            rise = speed**2 / (2.0 * p[0])
            fallen = drop_from_apex(self.time[samples] - apex, p[0], p[3])
            parts.append(p[1] + p[5] * self.time[samples] + rise - fallen)
        return np.concatenate(parts)

    def solve(self) -> tuple[Array, Array, list[NDArray[np.intp]], Array, float]:
        """Return parameters, covariance, samples, residuals and noise."""
        p, noise = self.start, self.noise
        outliers = np.zeros(self.time.size, dtype=bool)
        widths = np.array([prior.error for prior in self.priors])
        means = np.array([prior.value for prior in self.priors])
        start, loose = self.start, np.maximum(np.abs(self.start), 1.0)
        loose[1] += np.ptp(self.height)
        loose[2:COMMON] = np.inf
        for turn in range(4):
            members = [samples[~outliers[samples]] for samples in self.membership(p)]
            every = np.concatenate(members)
            if every.size <= p.size:
                raise np.linalg.LinAlgError

            def off(p: Array, members=members, every=every, noise=noise) -> Array:  # type: ignore[no-untyped-def]
                left = (self.height[every] - self.model(p, members)) / noise
                # weak priors for parameters that no sample determines
                return np.concatenate([left, (p[2:COMMON] - means) / widths, (p - start) / loose])

            found = least_squares(off, p, x_scale=np.maximum(np.abs(p), 1e-3), method="trf")
            p = found.x
            left = found.fun[: every.size] * noise
            noise = float(np.sqrt(left @ left / max(every.size - p.size, 1)))
            noise = max(noise, 1e-9 * float(np.ptp(self.height)))
            if turn == 1:
                limit = FAR * 1.48 * float(np.median(np.abs(left)))
                outliers[every[np.abs(left) > max(limit, 1e-12)]] = True
        jacobian = np.asarray(found.jac)
        covariance = np.linalg.inv(jacobian.T @ jacobian)
        return p, covariance, members, left, noise


def bounces_of_film(recording: Recording, inputs: BallInputs, tilt: float = 0.0) -> _OfFilm:
    """Return the bounces of a film, its fit, and a remark if it has none."""
    track = np.asarray(recording.height, np.float64)
    seen = np.isfinite(track) & np.isfinite(recording.time)
    time, height = recording.time[seen], track[seen]
    if time.size < 2 * LEAST_SAMPLES:
        return None, None, f"{recording.name}: no bounce; has only {time.size} positions"
    middle = float(time.mean())
    time = time - middle
    flights, curvature, noise = find_flights(time, height, recording.name)
    if not flights:
        return None, None, f"{recording.name}: no flight was found"
    contacts = contacts_of(flights, time, curvature)
    if recording.horizontal is not None and not tilt:
        horizontal = recording.horizontal[seen]
        slope = slope_of_floor(contacts, time, horizontal, noise)
        if slope:
            level = bounces_of_film(replace(recording, horizontal=None), inputs)
            inclined = bounces_of_film(*_along_normal(recording, inputs, slope), np.arctan(slope))
            return level if _explains(level, inclined, slope) else inclined
    chains = [[flights[k] for k in chain] for chain in chains_of(contacts, curvature, noise)]
    if not chains:
        longest = max(flights, key=lambda f: f.samples.size)
        used = np.concatenate([f.samples for f in flights])
        fitted = np.concatenate([f.height(time[f.samples], f.terms[2]) for f in flights])
        g = Input(float(longest.terms[2]), float(longest.errors[2]))
        fit = FilmFit(
            time[used] + middle, height[used], height[used] - fitted, fitted, noise, np.nan, g
        )
        return None, fit, f"{recording.name}: no bounce; {_scale_text(recording, g, inputs)}"
    return _fitted(recording, inputs, (time, height, middle), chains, curvature, tilt)


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
    track: tuple[Array, Array, float],
    chains: list[list[Stretch]],
    curvature: float,
    tilt: float,
) -> _OfFilm:
    time, height, middle = track
    own, timed = recording.scale_known and not inputs.scale_from_gravity, recording.rate_known
    rate = 1.0 if timed else RATE
    # m/s per unit of speed; from gravity, unless the scale of the file is used
    metre = rate if own else inputs.gravity.value / curvature / rate
    drag = inputs.drag or from_range(*DRAG)
    wide = Input(drag.value * metre**2, max(20.0 * drag.error, 1e-6) * metre**2)
    step = float(np.median(np.diff(time)))
    # without a frame rate contacts last for up to a few frames
    contact = Input(inputs.contact.value, CONTACT_ERROR) if timed else Input(0.5 * step, 2.0 * step)
    drift = Input(0.0, DRIFT * float(np.ptp(height) / np.ptp(time)))
    problem = _Problem(time, height, chains, curvature, (contact, wide, POWER, drift))
    try:
        # trial values of the fit may be impossible
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            p, covariance, members, left, noise = problem.solve()
    except (np.linalg.LinAlgError, ValueError):
        return None, None, f"{recording.name}: no bounce; its flights do not fit one floor"
    covariance *= _inflation(left)

    rows, v = problem.bounces(p, metre)
    steps = 1e-3 * np.sqrt(np.diag(covariance))
    jacobian = derivatives(lambda at: problem.bounces(at, metre)[0], p, steps)
    pieces = zip(problem.pieces(p), _is_last(chains), strict=True)
    landings = [piece[4] for piece, last in pieces if not last]
    g = Input(float(p[0]), float(np.sqrt(covariance[0, 0])))
    n, means = v.size, {"contact": inputs.contact, "drag": drag}
    slopes = {key: np.zeros(n + 2) for key in means}
    slopes["contact"][n] = slopes["drag"][n + 1] = 1.0
    unit = 1.0 if own else inputs.gravity.value / g.value
    inclined = [f"the floor is inclined by {abs(np.degrees(tilt)):.2f} degrees"] if tilt else []
    every = np.concatenate(members)
    fit = FilmFit(
        time[every] + middle, height[every], left, height[every] - left, noise, float(p[1]), g
    )
    fixed = jacobian @ covariance @ jacobian.T
    # in frames, contact and drag have no meaning beyond this film
    resolved = np.append(np.diag(fixed)[:n] < UNRESOLVED**2, [timed, timed])
    measured = {name: rows[n + k] - means[name].value for k, name in enumerate(means)}
    if not resolved[:n].any():
        text = _scale_text(recording, g, inputs)
        return None, fit, f"{recording.name}: no bounce is resolved; {text}"
    seen = resolved[:n]
    bounces = Bounces(
        name=recording.name,
        group=recording.group,
        restitution=rows[:n][seen],
        speed=v[seen] * unit,
        time=(np.array(landings) + middle)[seen],
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


def _is_last(chains: list[list[Stretch]]) -> list[bool]:
    return [k == len(chain) - 1 for chain in chains for k in range(len(chain))]
