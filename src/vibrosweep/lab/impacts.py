"""Landings from tracks, and summary quantities of a recording with their variation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import circmean

from vibrosweep.analysis import require
from vibrosweep.arrays import Array
from vibrosweep.errors import TrackError, require_one_of
from vibrosweep.lab.ballistics import Input, ball_inputs, given
from vibrosweep.lab.base_fit import COUNT, BaseFit, Inputs, Trace
from vibrosweep.lab.fitting import FittedTracks, Flights, Setup, fit_tracks
from vibrosweep.lab.flights import line_variance, low_points
from vibrosweep.lab.regression import TWO_PI, FittedLaw, law_variables, possible_laws, preferred_law
from vibrosweep.lab.tracks import coverage
from vibrosweep.lab.variables import require_parameter, with_units

__all__ = [
    "BOUNCED",
    "CRITERION",
    "DOUBTFUL",
    "METHODS",
    "QUANTITY_UNITS",
    "STAYED",
    "agreement",
    "find_impacts",
    "impacts_of",
    "phases",
    "quantities",
]

# -----------------------------------------------------------------------------
# Landings from tracks, by parabolas through the flights or by the sign of the velocity.

METHODS: Final = ("fit", "sign_change")
BOUNCED, STAYED, DOUBTFUL = 0, 1, 2
# Variables of bounces over a moving base
OF_BOUNCES: Final = {
    "contact": ("s", "contact time"),
    "contact_error": ("s", "its standard error"),
    "contact_effect": ("1", "its contribution to the error of the restitution"),
    "scatter": ("1", "scatter of the restitution from bounce to bounce"),
    "scatter_limit": ("1", "upper limit (95 %) of the scatter"),
}
SHORT: Final = 1e-3  # relative error of a given contact time
_VARIABLES: Final = {
    "landing_time": ("s", "time of landing"),
    "landing_time_error": ("s", "standard error of the time of landing"),
    "liftoff_time": ("s", "time of lift-off"),
    "liftoff_time_error": ("s", "standard error of the time of lift-off"),
    "next_covariance": ("s2", "covariance of the lift-off with the next landing"),
    "flight_time": ("s", "time from the lift-off to the next landing"),
    "impact_speed": (
        "m s-1",
        "velocity at lift-off; over a level base also the impact speed at the end of the flight",
    ),
    "rebound_height": (
        "m",
        "height of the flight that follows, above the (mean) level of the base",
    ),
    "rebound_height_error": ("m", "standard error of that height"),
}


def find_impacts(
    tracks: xr.Dataset,
    *,
    gravity: float | tuple[float, float] = 9.81,
    base: float | None = None,
    exposure: float = 0.0,
    method: str = "fit",
    motion: str = "detect",
    frequency: float | None = None,
    trace: Trace | None = None,
    contact: float | tuple[float, float] | None = None,
    mass: float | None = None,
    diameter: float | None = None,
) -> xr.Dataset:
    """Find the landings of every particle, with standard errors.

    Parameters
    ----------
    tracks
        Result of `read_tracks` or `make_tracks`.
    gravity
        Gravity in m s-2, the curvature of the flights.  A range, such as (9.76, 9.86), states that
        the scale is uncertain by as much: the apparent gravity is then fitted, and the scale of
        the motion of the base taken from it.
    base
        Height of the base in m; by default it is estimated from the flights.
    exposure
        Exposure time, s.
    method
        ``"fit"``: successive parabolas are intersected.  ``"sign_change"``: landings are the
        frames at which falling turns to rising, apexes the highest frames between them.
    motion
        ``"level"``: the base has a constant level; ``"moving"``: it oscillates; ``"detect"``: the
        landings decide; the level is constant if they do not, or if `base` is given.
    frequency
        Forcing frequency in Hz; by default that of a moving base is estimated.
    trace
        Measured motion of the base, from `vibrosweep.lab.read_trace`.
    contact
        Contact time over a moving base in s, or a range: the prior (its mean and standard
        deviation) of what the film determines.  By default it is 0, or in the range of 0.2 to 5 ms
        if the bounces fit significantly better with it.
    mass, diameter
        Of the balls, kg and m, for the drag in air over a moving base; by default there is none.

    Returns
    -------
    xarray.Dataset
        Dims (particle, impact), NaN past the last landing:

        - ``landing_time``, ``liftoff_time`` and their errors (s);
        - ``next_covariance`` (s2) of a lift-off with the next landing;
        - ``flight_time``, ``rebound_height`` and ``impact_speed`` (velocity at lift-off, over a
          level base also the speed at landing) of the flight that follows, NaN if its landing was
          not observed or one of its ends is doubtful;
        - ``quality``.

        Dim particle: numbers of frames, gaps and poor flights, and the level of the base (m).

        Attributes: the noise of a position (m), the height of the base (m), the acceleration with
        which the particles fall, and ``favoured_base``, ``"moving"``, ``"level"`` or
        ``"undetermined"``.

        Over a moving base ``shaken`` and ``shaken_covariance`` hold restitution, S, C (m s-1) and,
        if it was found, the frequency f (Hz); the base has the velocity S sin 2 pi f t + C cos 2 pi
        f t.  With a trace that is not a sine they hold S and C of each harmonic h, the factors of
        sine and cosine of 2 pi h f t.  If the bounces rule out a constant restitution, all values
        are those of the law that the attribute ``restitution_law`` names first, with its
        ``restitution_speed`` (m s-1) if that was fitted.  ``contact`` (s) is the contact
        time, with its error and its contribution to the error of the restitution; ``scatter`` is
        that of the restitution from bounce to bounce, with its upper limit (95 %).

    Raises
    ------
    TrackError
        There are no bounces, no flights fall with gravity, the base is not below the tracks, or
        `motion` is ``"moving"`` and the landings do not determine the motion.
    ParameterError
        Gravity or frequency is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.lab import Experiment, perform_trials
    >>> film = perform_trials(Experiment(particles=2, repeats=1, transient=5.0, duration=10.0))
    >>> vs.lab.find_impacts(film[0].tracks).landing_time.dims
    ('particle', 'impact')
    """
    require_one_of("method", method, METHODS, TrackError)
    fall = gravity_of(gravity)
    inputs = inputs_of(contact, mass, diameter, fall)
    setup = Setup(base, exposure, motion, frequency, trace, inputs)
    return impacts_of(tracks, fit_tracks(tracks, fall.value, setup), fall.value, method)


def gravity_of(gravity: float | tuple[float, float]) -> Input:
    """Return the prior of the apparent gravity (m s-2)."""
    if isinstance(gravity, tuple | list):
        return given("gravity", gravity)
    require_parameter("gravity", gravity)
    return Input(gravity)


def inputs_of(
    contact: float | tuple[float, float] | None,
    mass: float | None,
    diameter: float | None,
    gravity: Input,
) -> list[Inputs]:
    """Return the priors of flights and contacts over a moving base, for `Setup`."""
    ball = ball_inputs(contact or None, mass, diameter, gravity.value, None)
    instant = Inputs(gravity, ball.drag or Input(0.0))
    if contact is None:
        return [instant, instant.lasting()]
    if contact == 0:
        return [instant]
    lasts = Input(ball.contact.value, ball.contact.error or SHORT * ball.contact.value)
    return [instant.lasting(lasts)]


def impacts_of(tracks: xr.Dataset, fitted: FittedTracks, gravity: float, method: str) -> xr.Dataset:
    """Make the result of `find_impacts` from fitted tracks, by one of the `METHODS`."""
    flights, swaps = fitted.flights, fitted.swaps
    particles = tracks.sizes["particle"]
    if method == "fit":
        owner, columns = _landings_by_fit(flights, gravity)
    else:
        owner, columns = _landings_by_sign(fitted, tracks.attrs["frame_rate"], gravity)
    if not owner.size:
        raise TrackError(
            f"{tracks.attrs['source']}: no landing is seen: the track holds no two flights with a "
            f"bounce between them"
        )
    poor = np.bincount(flights.particle[flights.poor], minlength=particles)
    exchanged = np.bincount(np.array([p for _, *pair in swaps for p in pair], int), None, particles)
    of_particles = coverage(tracks) | {
        "poor_flights": (poor, "1", "flights that fit badly"),
        "swaps": (exchanged, "1", "exchanges of names with another particle"),
        "level": (flights.levels, "m", "(mean) level of the base below the particle"),
    }
    found = _table(owner, columns, particles).assign(with_units("particle", of_particles))
    found = found.assign_coords(particle=tracks["particle"])
    if flights.base_fit is not None:
        law, scale = preferred_law(flights.laws), gravity / flights.base_fit.gravity[0]
        clock = tracks.attrs.get("clock_error", 0.0)
        found = found.merge(_base_variables(flights.base_fit, law, scale, clock))
        found = found.assign(law_variables(flights.laws, scale))
    found.attrs = {
        "method": method,
        "source": tracks.attrs["source"],
        "frame_rate": tracks.attrs["frame_rate"],
        "begin": float(tracks["time"][0]),
        "end": float(tracks["time"][-1]),
        "gravity": gravity,
        "noise": flights.noise,
        "base": flights.base,
        "base_error": flights.base_error,
        "apparent_gravity": flights.gravity,
        "apparent_gravity_error": flights.gravity_error,
        "scale_off": int(flights.curvature != gravity),
        "base_motion": "level" if flights.base_fit is None else "moving",
        "restitution_law": " or ".join(possible_laws(flights.laws)),
        "favoured_base": fitted.favoured_base,
    }
    return found


def harmonic_numbers(impacts: xr.Dataset) -> tuple[int, ...]:
    """Numbers of the harmonics of a moving base, the strongest first."""
    return tuple(int(n[1:] or 1) for n in impacts["of_base"].values.astype(str) if n[0] == "S")


def _base_variables(
    base_fit: BaseFit, law: FittedLaw | None, scale: float, clock: float
) -> xr.Dataset:
    """Variables of restitution and motion of the base, from the fit with `law` if there is one.

    `scale` multiplies speeds, to correct the scale of the tracks; `clock` is the standard error of
    their clock, s.
    """
    numbers = base_fit.oscillation.numbers
    words = "of the base that moves with S sin 2 pi f t + C cos 2 pi f t"
    pairs = ["S", "C"]
    if len(numbers) > 1:
        pairs = [f"{letter}{h}" for h in numbers for letter in "SC"]
        words = "of the base that moves with the sum of Sh sin 2 pi h f t + Ch cos 2 pi h f t"
    names = ["restitution", *pairs[:2], "frequency", *pairs[2:]]
    names = names[: base_fit.problem.parameters]  # the frequency may be known
    fit, used = law or base_fit, law.bounces if law else int(base_fit.used.sum())
    names += ["restitution_speed"] if law and law.law.parameters else []
    of_base = slice(None, len(names))
    units = {"restitution": "1", "frequency": "Hz"}
    scaled = ~np.isin(names, list(units))
    values = np.where(scaled, scale, 1.0) * fit.values[of_base]
    covariance = np.outer(*2 * (np.where(scaled, scale, 1.0),)) * fit.covariance[of_base, of_base]
    # speeds change in inverse proportion to the apparent gravity, which has an error
    gravity, error = base_fit.gravity
    slope = np.where(scaled, -values / gravity, 0.0)
    shared = np.zeros(values.size)
    motion = slice(None, base_fit.problem.parameters)
    shared[motion] = base_fit.covariance[motion, -COUNT] * np.where(scaled, scale, 1.0)[motion]
    covariance += np.outer(slope, slope) * error**2 + np.outer(slope, shared)
    covariance += np.outer(shared, slope)
    sines, cosines = (np.char.startswith(names, letter) for letter in "SC")
    turn = TWO_PI * base_fit.oscillation.frequency * np.array(numbers)
    later = np.zeros(values.size)
    later[sines], later[cosines] = -turn * values[cosines], turn * values[sines]
    covariance += np.outer(later, later) * clock**2
    return xr.Dataset(
        {
            "shaken": ("of_base", values, {"long_name": words}),
            "shaken_covariance": (("of_base", "other"), covariance, {"long_name": "covariance"}),
            "shaken_frequency": ((), base_fit.oscillation.frequency, {"units": "Hz"}),
            "shaken_misfit": ((), fit.misfit, {"long_name": "chi-square per degree of freedom"}),
            "shaken_freedom": ((), fit.freedom, {"long_name": "degrees of freedom"}),
            "shaken_bounces": ((), used, {"long_name": "bounces used"}),
            **with_units((), _of_bounces(base_fit)),
        },
        coords={
            "of_base": names,
            "other": names,
            "of_base_units": ("of_base", [units.get(name, "m s-1") for name in names]),
        },
    )


def _of_bounces(fit: BaseFit) -> dict[str, tuple[float, str, str]]:
    """Contact time and scatter of the restitution, as variables with their errors."""
    error, limit = float(np.sqrt(fit.covariance[-1, -1])), fit.scatter_limit
    effect = abs(float(fit.covariance[0, -1])) / error
    values = (max(float(fit.values[-1]), 0.0), error, effect, fit.problem.scatter, limit)
    return {
        name: (value, *meaning)
        for (name, meaning), value in zip(OF_BOUNCES.items(), values, strict=True)
    }


def _landings_by_fit(
    flights: Flights, gravity: float
) -> tuple[NDArray[np.intp], dict[str, NDArray[Any]]]:
    """Particle of each landing, and columns of `_VARIABLES` and quality, from fitted flights."""
    joint, fits = flights.junctions, flights.fits
    after = joint.before + 1
    doubtful = flights.poor[joint.before] | flights.poor[after] | joint.overlapping
    linked = np.flatnonzero((after[:-1] == joint.before[1:]) & ~doubtful[:-1] & ~doubtful[1:])
    duration = np.full(joint.before.size, np.nan)
    duration[linked] = joint.landing[linked + 1] - joint.liftoff[linked]
    seen = np.isfinite(duration)
    apex = fits.centre + fits.slope / flights.curvature  # where the slope is zero
    height = fits.top(flights.curvature) - flights.levels[flights.particle]
    error = np.hypot(flights.noise * np.sqrt(line_variance(fits, apex)), flights.base_error)
    speed = 0.5 * gravity * duration
    if flights.base_fit is not None:
        leaves = fits.slope[after] - flights.curvature * (joint.liftoff - fits.centre[after])
        speed = np.where(seen, leaves * gravity / flights.curvature, np.nan)
    columns = {
        "landing_time": joint.landing,
        "landing_time_error": joint.landing_error,
        "liftoff_time": joint.liftoff,
        "liftoff_time_error": joint.liftoff_error,
        "next_covariance": joint.covariance,
        "flight_time": duration,
        "impact_speed": speed,
        "rebound_height": np.where(seen, height[after], np.nan),
        "rebound_height_error": np.where(seen, error[after], np.nan),
        "quality": np.where(doubtful, DOUBTFUL, np.where(joint.stayed, STAYED, BOUNCED)),
    }
    return flights.particle[joint.before], columns


def _landings_by_sign(
    fitted: FittedTracks, frame_rate: float, gravity: float
) -> tuple[NDArray[np.intp], dict[str, NDArray[Any]]]:
    """As `_landings_by_fit`, from frames: the lowest are landings, the highest apexes."""
    samples, flights, _, _ = fitted
    above = replace(samples, height=samples.height - flights.levels[samples.particle])
    low, _ = low_points(above, flights.noise, 0.0)
    time, owner = samples.time[low], samples.particle[low]
    linked = np.flatnonzero(np.diff(samples.piece[low]) == 0)
    duration, height = np.full((2, low.size), np.nan)
    duration[linked] = time[linked + 1] - time[linked]
    if low.size:
        height[linked] = np.maximum.reduceat(above.height, low)[linked]
    error = np.full(low.size, 1.0 / frame_rate / np.sqrt(12.0))
    columns = {
        "landing_time": time,
        "landing_time_error": error,
        "liftoff_time": time,
        "liftoff_time_error": error,
        "next_covariance": np.where(np.isfinite(duration), 0.0, np.nan),
        "flight_time": duration,
        "impact_speed": 0.5 * gravity * duration,
        "rebound_height": height,
        "rebound_height_error": np.where(np.isfinite(height), flights.noise, np.nan),
        "quality": np.full(low.size, BOUNCED),
    }
    return owner, columns


def _table(owner: NDArray[np.intp], columns: dict[str, NDArray[Any]], particles: int) -> xr.Dataset:
    """Dataset of shape (particle, impact) from rows sorted by particle and time."""
    count = np.bincount(owner, minlength=particles)
    place = np.arange(owner.size) - (np.cumsum(count) - count)[owner]
    shape = (particles, int(count.max(initial=0)))
    tables: dict[str, Any] = {}
    for name, about in _VARIABLES.items():
        values = np.full(shape, np.nan)
        values[owner, place] = columns[name]
        tables[name] = values, *about
    variables = with_units(("particle", "impact"), tables)
    quality = np.full(shape, -1, np.int8)
    quality[owner, place] = columns["quality"]
    flags = {
        "long_name": "quality of the landing",
        "flag_values": np.array([-1, BOUNCED, STAYED, DOUBTFUL], np.int8),
        "flag_meanings": "none bounced stayed_or_bounced_unseen doubtful",
    }
    variables["quality"] = (("particle", "impact"), quality, flags)
    variables |= with_units("particle", {"impact_count": (count, "1", "landings that were seen")})
    return xr.Dataset(variables)


# -----------------------------------------------------------------------------
# Summary quantities of a recording, and their variation over repeats of an experiment.
#
# The study repeats each case four times and accepts a quantity if its coefficient of variation
# over the repeats is below 8 %.

CRITERION: Final = 0.08
QUANTITY_UNITS: Final = {
    "flight_time": ("s", "mean flight time"),
    "rebound_height_max": ("m", "maximum rebound height"),
    "rebound_height_mean": ("m", "mean rebound height"),
    "impact_speed": ("m s-1", "mean velocity at lift-off; over a level base the impact speed"),
    "impact_phase": ("1", "mean phase of impact, in turns"),
    "phase_lock": ("1", "length of the mean phase vector; 1 where all impacts share one phase"),
    "phase_difference": ("1", "mean separation in phase of neighbouring particles, in turns"),
    "dt_min": ("s", "smallest separation of landings of different particles, if above its error"),
}
# Phases have an arbitrary zero, so that their coefficient of variation has no meaning.
_ANGLES: Final = ("impact_phase", "phase_difference")


def phases(impacts: xr.Dataset, frequency: float, phase: float = 0.0) -> Array:
    """Phase of the forcing at each landing, in turns from 0 to 1; shape (particle, impact)."""
    turns = frequency * impacts["landing_time"].values + phase / (2.0 * np.pi)
    return np.asarray(turns - np.floor(turns))


def quantities(
    impacts: xr.Dataset, *, frequency: float | None = None, phase: float = 0.0
) -> xr.Dataset:
    """Summarise one recording over all particles.

    Parameters
    ----------
    impacts
        Result of `find_impacts`.
    frequency
        Forcing frequency in Hz; without it the phases are NaN.
    phase
        Phase of the forcing at t = 0 of the recording, rad.

    Returns
    -------
    xarray.Dataset
        Scalars: ``flight_time`` (s), ``rebound_height_max`` and ``rebound_height_mean`` (m),
        ``impact_speed`` (m s-1), ``impact_phase`` and ``phase_difference`` (turns),
        ``phase_lock``, the length of the mean phase vector, and ``dt_min`` (s).

    Raises
    ------
    DataError
        The dataset is not a result of `find_impacts`.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.lab import Experiment, perform_trials, quantities
    >>> film = perform_trials(Experiment(particles=2, repeats=1, transient=5.0, duration=10.0))
    >>> found = quantities(vs.lab.find_impacts(film[0].tracks), frequency=20.0)
    >>> found.rebound_height_mean.dims
    ()
    """
    needed = ("quality", "flight_time", "rebound_height", "impact_speed", "landing_time")
    require(impacts, "quantities", *needed, source="find_impacts")
    good = impacts["quality"].values == BOUNCED
    flight = impacts["flight_time"].values
    height = impacts["rebound_height"].values
    seen = np.isfinite(flight)
    found = dict.fromkeys(QUANTITY_UNITS, float("nan"))
    if seen.any():
        found["flight_time"] = float(flight[seen].mean())
        found["rebound_height_max"] = float(height[seen].max())
        found["rebound_height_mean"] = float(height[seen].mean())
        found["impact_speed"] = float(impacts["impact_speed"].values[seen].mean())
    if frequency is not None and good.any():
        vector = np.where(good, np.exp(2j * np.pi * phases(impacts, frequency, phase)), 0.0)
        mean = vector.sum() / good.sum()
        found["phase_lock"] = float(np.abs(mean))
        found["impact_phase"] = float(np.angle(mean) / (2.0 * np.pi) % 1.0)
        found["phase_difference"] = _neighbours(vector.sum(axis=1))
    found["dt_min"] = _closest(impacts)
    return xr.Dataset(
        with_units((), {n: (found[n], *about) for n, about in QUANTITY_UNITS.items()})
    )


def _neighbours(vectors: NDArray[np.complex128]) -> float:
    """Mean difference in phase of successive particles, in turns from 0 to 1/2."""
    vectors = vectors[np.abs(vectors) > 0.0]
    if vectors.size < 2:
        return float("nan")
    turned = np.angle(vectors[1:] * np.conj(vectors[:-1])) / (2.0 * np.pi)
    return float(np.abs(turned).mean())


def _closest(impacts: xr.Dataset) -> float:
    """Smallest separation in s of landings of different particles; NaN if below its error."""
    quality = impacts["quality"].values
    certain = (quality >= BOUNCED) & (quality != DOUBTFUL)
    time = np.where(certain, impacts["landing_time"].values, np.nan)
    owner = np.broadcast_to(np.arange(time.shape[0])[:, np.newaxis], time.shape)
    landed = np.isfinite(time)
    order = np.argsort(time[landed])
    times, owners = time[landed][order], owner[landed][order]
    errors = impacts["landing_time_error"].values[landed][order]
    # the closest landings of different particles are consecutive in time
    different = np.flatnonzero(np.diff(owners) != 0)
    if not different.size:
        return float("nan")
    gaps = np.diff(times)[different]
    pair = different[gaps.argmin()]
    error = float(np.hypot(errors[pair], errors[pair + 1]))
    return float(gaps.min()) if gaps.min() > error else float("nan")


def agreement(trials: Sequence[xr.Dataset]) -> xr.Dataset:
    """Compute mean, standard deviation and coefficient of variation over repeats.

    Parameters
    ----------
    trials
        Results of `quantities`, one for each repeat.

    Returns
    -------
    xarray.Dataset
        Dim quantity: ``mean``, ``sd``, ``variation`` (sd / mean; NaN for phases, whose zero is
        arbitrary), and ``accepted``: 1 if the variation is below the study's criterion of 8 %, 0
        if not, -1 if undefined.

    Raises
    ------
    DataError
        A dataset is not a result of `quantities`.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.lab import Experiment, agreement, perform_trials, quantities
    >>> film = perform_trials(Experiment(particles=2, repeats=2, transient=5.0, duration=10.0))
    >>> landings = [vs.lab.find_impacts(trial.tracks) for trial in film]
    >>> trials = [quantities(impacts, frequency=20.0) for impacts in landings]
    >>> agreement(trials)["mean"].dims
    ('quantity',)
    """
    for trial in trials:
        require(trial, "agreement", *QUANTITY_UNITS, source="quantities")
    values = np.array([[float(trial[name]) for name in QUANTITY_UNITS] for trial in trials])
    names = list(QUANTITY_UNITS)
    mean = values.mean(axis=0)
    sd = values.std(axis=0, ddof=1) if len(trials) > 1 else np.full(len(names), np.nan)
    k = names.index("impact_phase")  # a circular quantity
    mean[k] = circmean(values[:, k], high=1.0)
    off = values[:, k] - mean[k]
    if len(trials) > 1:
        sd[k] = np.sqrt(np.sum((off - np.rint(off)) ** 2) / (len(trials) - 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        variation = np.where(np.isin(names, _ANGLES), np.nan, sd / mean)
    judged = np.isfinite(variation)
    accepted = np.where(judged, (variation < CRITERION).astype(int), -1).astype(np.int8)
    flags = {"flag_values": np.array([-1, 0, 1], np.int8), "flag_meanings": "undetermined no yes"}
    return xr.Dataset(
        {
            "mean": ("quantity", mean, {"long_name": "mean over the repeats"}),
            "sd": ("quantity", sd, {"long_name": "standard deviation over the repeats"}),
            "variation": ("quantity", variation, {"units": "1", "long_name": "sd / mean"}),
            "accepted": ("quantity", accepted, {"long_name": "variation below 8 %", **flags}),
        },
        coords={
            "quantity": names,
            "units": ("quantity", [QUANTITY_UNITS[name][0] for name in names]),
        },
        attrs={"repeats": len(trials)},
    )
