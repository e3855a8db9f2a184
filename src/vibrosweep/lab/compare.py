"""Comparison of recordings with prediction, and the sources of its errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis import require
from vibrosweep.arrays import Array, Flags, Indices
from vibrosweep.engine.landings import all_parameters
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError, TrackError, require_one_of
from vibrosweep.kernels.impact import Batch, base_of
from vibrosweep.kernels.record import Record
from vibrosweep.lab.base_fit import Trace
from vibrosweep.lab.estimation import estimate, fit_phase
from vibrosweep.lab.experiment import LEVEL, Camera, Motion, film, heights, oscillating_surface
from vibrosweep.lab.fitting import Setup, fit_tracks
from vibrosweep.lab.impacts import (
    BOUNCED,
    METHODS,
    gravity_of,
    harmonic_numbers,
    impacts_of,
    inputs_of,
)
from vibrosweep.lab.regression import law_of, law_text
from vibrosweep.lab.traces import polar, with_values
from vibrosweep.lab.tracks import make_tracks
from vibrosweep.lab.trials import wandering_record
from vibrosweep.lab.variables import require_number, require_parameter, with_units
from vibrosweep.model.forcing import ACCELERATION
from vibrosweep.model.parameters import (
    HIGH_BOUNCE,
    LAWS,
    MOVING,
    OF_RESTITUTION,
    PARAMETERS,
    Launches,
    dimensionless,
)
from vibrosweep.model.restitution_laws import (
    CONSTANT,
    SPEED,
    implied,
    range_mistake,
    require_law,
    speed_mistakes,
)
from vibrosweep.model.shapes import SINE, Waveform
from vibrosweep.runs.driver import thread_count
from vibrosweep.scene.scene import Scene, stored

__all__ = ["compare_tracks"]

# -----------------------------------------------------------------------------
# Errors of predicted heights and periods.
#
# The error of a quantity is |measured - predicted| / measured.  It can mean the error of the mean
# over all particles, of the mean of each particle, or of each flight: all three are computed.

# Quantities of a flight, and their variables in a result of `find_impacts`
MEASURED_AS: Final = {"height": "rebound_height", "period": "flight_time"}
QUANTITIES: Final = tuple(MEASURED_AS)
READINGS: Final = ("ensemble", "particle", "worst", "flight")
# Smallest measured fraction of a particle's time and landings for which it is compared
MEASURED: Final = 0.9


def comparable(impacts: xr.Dataset) -> NDArray[np.bool_]:
    """Mark the particles whose flights were nearly all measured.

    Particles that rest or bounce too low for the camera are left out, because the mean over their
    visible flights would be biased.

    Parameters
    ----------
    impacts
        Result of `find_impacts` with the method ``"fit"``.

    Returns
    -------
    numpy.ndarray
        Booleans, shape (particle,).

    Examples
    --------
    >>> import vibrosweep as vs
    >>> experiment = vs.lab.Experiment(particles=2, repeats=1, transient=5.0, duration=10.0)
    >>> film = vs.lab.perform_trials(experiment)
    >>> vs.lab.comparable(vs.lab.find_impacts(film[0].tracks)).shape
    (2,)
    """
    require(impacts, "comparable", "quality", "flight_time", source="find_impacts")
    quality = impacts["quality"].values
    bounced = (quality == BOUNCED).sum(axis=1)
    flying = np.nansum(impacts["flight_time"].values, axis=1)
    length = impacts.attrs["end"] - impacts.attrs["begin"]
    return np.asarray(
        (bounced > MEASURED * np.maximum((quality >= BOUNCED).sum(axis=1), 1))
        & (flying > MEASURED * length)
    )


def measured_means(impacts: xr.Dataset, among: NDArray[np.bool_]) -> dict[str, Array]:
    """Mean height (m) and period (s) of the flights of each particle; NaN where not `among`."""
    return {
        quantity: np.where(among, impacts[name].mean("impact").values, np.nan)
        for quantity, name in MEASURED_AS.items()
    }


def prediction_errors(
    impacts: xr.Dataset, predicted: dict[str, Array], among: NDArray[np.bool_]
) -> dict[str, dict[str, float]]:
    """Return the errors ``|measured - predicted| / measured`` by quantity and reading.

    Parameters
    ----------
    impacts
        Result of `find_impacts`.
    predicted
        Mean ``height`` (m) and ``period`` (s) of each particle, shape (particle,).
    among
        True for each particle that is compared, as `comparable` returns it; shape (particle,).

    Returns
    -------
    dict
        Errors in per cent, by quantity (``height``, ``period``) and reading: ``ensemble``, the
        error of the mean over all particles; ``particle``, the mean of the errors of each
        particle's mean; ``worst``, the largest of these; ``flight``, the mean error of single
        flights against the mean predicted for their particle.  NaN where no particle can be
        compared.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> experiment = vs.lab.Experiment(particles=2, repeats=1, transient=5.0, duration=10.0)
    >>> seen = vs.lab.find_impacts(vs.lab.perform_trials(experiment)[0].tracks)
    >>> predicted = vs.lab.predicted_means(experiment)
    >>> list(vs.lab.prediction_errors(seen, predicted, vs.lab.comparable(seen)))
    ['height', 'period']
    """
    errors = errors_of(impacts, predicted, among).tolist()
    return {
        q: dict(zip(READINGS, row, strict=True)) for q, row in zip(QUANTITIES, errors, strict=True)
    }


def errors_of(impacts: xr.Dataset, predicted: dict[str, Array], among: NDArray[np.bool_]) -> Array:
    """Errors of `prediction_errors` as an array of shape (quantity, reading)."""
    means = measured_means(impacts, among)
    found = np.full((len(QUANTITIES), len(READINGS)), np.nan)
    for row, name in zip(found, QUANTITIES, strict=True):
        measured, foretold = means[name], predicted[name]
        both = np.isfinite(measured) & np.isfinite(foretold)
        if both.any():
            measured, foretold = measured[both], foretold[both]
            flights = impacts[MEASURED_AS[name]].values[both]
            single = 100.0 * np.abs(measured - foretold) / measured
            ensemble = 100.0 * abs(measured.mean() - foretold.mean()) / measured.mean()
            of_flights = 100.0 * np.abs(flights - foretold[:, np.newaxis]) / flights
            row[:] = ensemble, single.mean(), single.max(), np.nanmean(of_flights)
    return found


# -----------------------------------------------------------------------------
# Predictions with known or estimated parameters, from the first flight of each particle.

DRAWS: Final = 64
MEANS: Final = ("rebound_height_mean", "flight_time_mean")  # names of `QUANTITIES` in a sweep
USED: Final = ("restitution", "amplitude", "frequency", SPEED)
# Name of the base by its motion in a recording
BASE_OF_MOTION: Final = {"level": HIGH_BOUNCE, "moving": MOVING}
# Margin by which rejected draws may exceed the requested number
REFUSED_BY_CHANCE: Final = 10


@dataclass(frozen=True)
class ComparisonOptions:
    """Options of a comparison of recordings with prediction."""

    # Known parameters, by their names in `PARAMETERS` and `OF_RESTITUTION`; restitution, amplitude,
    # phase and frequency are estimated if they are not among them
    known: Mapping[str, float]
    method: str = "fit"  # ``"fit"`` or ``"sign_change"``
    setup: Setup = field(default_factory=Setup)  # facts about the recordings
    draws: int = DRAWS  # parameter sets drawn within the errors of an estimate
    rebound: str = "rest"  # ``"rest"`` or ``"reflect"``
    seed: int = 0  # seed of the random numbers
    restitution_law: str = CONSTANT  # law of a known restitution

    def __post_init__(self) -> None:
        require_law("restitution_law", self.restitution_law)
        of_points = implied(self.restitution_law)
        if given := of_points.keys() & self.known.keys():
            raise ParameterError(f"{min(given)}: follows from the points of the law; leave it out")
        object.__setattr__(self, "known", {**self.known, **of_points})

    @property
    def gravity(self) -> float:
        """Gravity in m s-2."""
        return self.known.get("gravity", PARAMETERS["gravity"].default)


def parameters_of(
    impacts: xr.Dataset, options: ComparisonOptions
) -> tuple[dict[str, float], Scene, xr.Dataset | None]:
    """Find the parameters of a prediction.

    Returns the known parameters, the scene, and the estimate of the others, None if all are known.
    """
    known = {name: p.default for name, p in PARAMETERS.items()} | dict(options.known)
    if "restitution" not in options.known:
        found = estimate(impacts, frequency=options.known.get("frequency"))
        law, speed = law_of(found)
        known |= {} if law == CONSTANT else {SPEED: speed}
        return known, scene_of(impacts, options.rebound, stored(found.attrs), law), found
    if impacts.attrs["base_motion"] == "moving":
        values, covariance = impacts["shaken"].values, impacts["shaken_covariance"].values
        plain, _, shape = polar(values, covariance, harmonic_numbers(impacts))
        known |= {"phase": options.known.get("phase", float(plain[2]))}
    else:
        shape = SINE
        if "phase" not in options.known:
            named = {name: known[name] for name in USED if name in known}
            known["phase"] = fit_phase(impacts, law=options.restitution_law, **named)
    return known, scene_of(impacts, options.rebound, shape, options.restitution_law), None


def draw_parameters(
    known: Mapping[str, float],
    scene: Scene,
    estimated: xr.Dataset | None,
    draws: int,
    seed: int = 0,
) -> tuple[dict[str, Array], list[Waveform], int]:
    """Draw parameter sets: the best estimate, then samples from its normal posterior.

    `known` holds all `PARAMETERS` and the speed of the law of restitution.  Values of `estimated`,
    a result of `estimate`, replace them and those of the scene's waveform.  Without an estimate
    there is one set, the known one.

    Returns
    -------
    parameters
        Arrays of shape (draw,).
    waveforms
        Waveform of each draw.
    refused
        Number of draws outside the physical range, which were replaced.

    Raises
    ------
    ParameterError
        The orbit does not determine the parameters, the best set is not physical, or more than
        half of the draws are not.
    """
    waveform, law = scene.waveform, scene.restitution_law
    if estimated is None:
        return {name: np.array([value]) for name, value in known.items()}, [waveform], 0
    names = [str(name) for name in estimated["parameter"].values]
    best, covariance = estimated["estimate"].values, estimated["covariance"].values
    if not np.isfinite(covariance).all():
        raise ParameterError(f"the parameters cannot be used: {estimated.attrs['warning']}")
    every = {**PARAMETERS, **OF_RESTITUTION}
    physical = [(k, every[name]) for k, name in enumerate(names) if name in every]
    for k, parameter in physical:
        if not parameter.accepts(best[k]):
            raise ParameterError(
                f"{parameter.name} is estimated as {best[k]:.4g}: must be {parameter.allowed}; "
                f"check the scale and the frequency, or give the parameters"
            )
    rng = np.random.default_rng(seed)
    accepted, refused = [best], 0
    while len(accepted) <= draws:
        values = rng.multivariate_normal(best, covariance)
        within = not range_mistake(law, values[:1])  # values[0] is the restitution
        if within and all(bool(parameter.accepts(values[k])) for k, parameter in physical):
            accepted.append(values)
        else:
            refused += 1
        if refused > draws + REFUSED_BY_CHANCE:
            raise ParameterError(
                f"{refused} of {refused + len(accepted)} sets drawn within the errors of the "
                f"estimate are not physical: the parameters are too uncertain; give them"
            )
    drawn = dict(zip(names, np.array(accepted).T, strict=True))
    shapes = [
        with_values(waveform, {name: float(values[k]) for name, values in drawn.items()})
        for k in range(len(accepted))
    ]
    sets = {name: drawn.get(name, np.full(len(accepted), value)) for name, value in known.items()}
    return sets, shapes, refused


def scene_of(impacts: xr.Dataset, rebound: str, waveform: Waveform, restitution_law: str) -> Scene:
    """Make the scene of one particle launched at t = 0 over the base of a recording."""
    base = BASE_OF_MOTION[impacts.attrs["base_motion"]]
    return Scene(
        1, (0.0,), rebound=rebound, base=base, waveform=waveform, restitution_law=restitution_law
    ).recorded()


class FirstFlights(NamedTuple):
    """Particles with a complete flight, and the start of the first one."""

    particle: Indices
    # start, speed: time (s) and speed (m s-1) of its lift-off
    start: Array
    speed: Array
    # Parameters of shape (draw * particle,), one realization per particle: a launch at time t is
    # equivalent to one at t = 0 with the phase phi + 2 pi f t
    sets: dict[str, Array]


def first_flights(impacts: xr.Dataset, parameters: Mapping[str, Array]) -> FirstFlights:
    """Launch each particle at the lift-off of its first complete flight.

    The parameters are those of `draw_parameters`, of shape (draw,), with the phase at t = 0 of the
    recording.  Their launch velocity is not used.
    """
    seen = np.isfinite(impacts["flight_time"].values)
    particle = np.flatnonzero(seen.any(axis=1))
    place = seen[particle].argmax(axis=1) if particle.size else particle
    start, speed = (
        impacts[name].values[particle, place] for name in ("liftoff_time", "impact_speed")
    )
    draws = parameters["frequency"].size
    sets = {name: np.repeat(values, particle.size) for name, values in parameters.items()}
    turns = sets["frequency"] * np.tile(start, draws)
    sets["phase"] = sets["phase"] + 2.0 * np.pi * (turns - np.rint(turns))
    sets["launch_velocity"] = np.tile(speed, draws)
    return FirstFlights(particle, start, speed, sets)


def predict(
    impacts: xr.Dataset,
    parameters: Mapping[str, Array],
    waveforms: Sequence[Waveform],
    scene: Scene,
    workers: Workers,
) -> dict[str, Array]:
    """Predict mean height (m) and period (s) from a particle's first flight to the end of the film.

    The shape is (draw, particle), with NaN for a particle without a complete flight.  Parameters
    and waveforms are those of `draw_parameters`, the scene that of `scene_of`.  A particle that
    appears late is simulated for as long as the others.
    """
    draws = parameters["frequency"].size
    size = draws, impacts.sizes["particle"]
    means = {quantity: np.full(size, np.nan) for quantity in QUANTITIES}
    flown, start, _, sets = first_flights(impacts, parameters)
    if flown.size:
        length = impacts.attrs["end"] - float(start.min())
        for shape in dict.fromkeys(waveforms):
            same = np.array([waveform == shape for waveform in waveforms])
            chosen = {name: values[np.repeat(same, flown.size)] for name, values in sets.items()}
            lasting = replace(scene, duration=length, waveform=shape)
            found = measure(all_parameters(chosen), lasting, workers)
            for mean, name in zip(means.values(), MEANS, strict=True):
                mean[np.ix_(same, flown)] = found[name].reshape(-1, flown.size)
    return means


# -----------------------------------------------------------------------------
# Synthetic recording: the predicted motion, filmed and measured like the real one.
#
# The errors of this measurement are those of the camera alone, because the motion is the
# prediction.

# Variance of S and C of a base without motion, (m s-1)^2
LEAST_VARIANCE: Final = 1e-24


def camera_shares(
    tracks: xr.Dataset,
    impacts: xr.Dataset,
    numbers: Mapping[str, float],
    scene: Scene,
    options: ComparisonOptions,
) -> Array:
    """Errors in per cent due to frames alone, and additional errors due to pixels.

    The shape is (2, quantity, reading).  `numbers` are the parameters of the prediction, and
    `scene` is a result of `scene_of`.
    """
    motions = predicted_motions(impacts, numbers, scene)
    time = tracks["time"].values
    true = heights(motions, time, options.setup.exposure)
    means = [motion.means(time[0], time[-1]) for motion in motions]
    predicted = dict(zip(QUANTITIES, np.array(means).T, strict=True))
    noise, rate = impacts.attrs["noise"], impacts.attrs["frame_rate"]
    # the fit of a moving base is weighted by the noise, which must not be zero
    least = 0.0 if impacts.attrs["base_motion"] == "level" else 0.01
    setup = options.setup._replace(laws=False)
    if setup.base is None:
        motion = impacts.attrs["base_motion"]
        trace = _exact_trace(numbers, scene.waveform) if motion == "moving" else None
        setup = setup._replace(motion=motion, trace=trace)
    cameras = (Camera(rate, noise, pixels, whole_pixels=False) for pixels in (least, 1.0))
    by_frames, together = (
        _measurement_error(true, time, camera, predicted, options, setup) for camera in cameras
    )
    return np.stack([by_frames, np.sqrt(np.maximum(together**2 - by_frames**2, 0.0))])


def _exact_trace(numbers: Mapping[str, float], waveform: Waveform) -> Trace:
    """Trace of the predicted base, with an accuracy of one part in a million."""
    velocity = numbers["amplitude"] / (1.0 + numbers["restitution"])
    values = []
    for h, weight, psi in waveform.harmonics:
        angle, size = psi + h * numbers["phase"], weight * velocity
        values += [size * np.cos(angle), size * np.sin(angle)]
    variance = np.insert(np.full(len(values), velocity), 2, numbers["frequency"]) ** 2 * 1e-12
    return Trace(
        np.insert(values, 2, numbers["frequency"]),
        np.diag(np.maximum(variance, LEAST_VARIANCE)),
        tuple(h for h, *_ in waveform.harmonics),
    )


def predicted_motions(
    impacts: xr.Dataset, numbers: Mapping[str, float], scene: Scene
) -> list[Motion]:
    """Predict the motion of each particle with a complete flight, on the clock of the recording."""
    best = {name: np.array([value]) for name, value in numbers.items()}
    _, start, speed, sets = first_flights(impacts, best)
    problem = dimensionless(all_parameters(sets), impacts.attrs["end"] - float(start.min()))
    at_once = np.zeros((1, start.size))
    surface = LEVEL if scene.base == HIGH_BOUNCE else oscillating_surface(numbers, scene.waveform)
    batch = Batch(base_of(*scene.mechanics), problem, Launches(at_once, at_once))
    record = wandering_record(batch, np.zeros(2), numbers["frequency"], numbers["gravity"])
    return [
        Motion.from_record(
            Record(record.landing_time + t, record.liftoff_time + t, *record[2:]),
            p,
            t,
            speed[p],
            numbers["gravity"],
            surface,
        )
        for p, t in enumerate(start)
    ]


def _measurement_error(
    true: Array,
    time: Array,
    camera: Camera,
    predicted: dict[str, Array],
    options: ComparisonOptions,
    setup: Setup,
) -> Array:
    """Film true heights, measure them, and return the errors of `predicted` relative to them."""
    height = film(true, camera, np.random.default_rng(options.seed))
    tracks = make_tracks(time, height, source="the predicted motion, filmed as the recording was")
    fitted = fit_tracks(tracks, options.gravity, setup)
    by_fit = impacts_of(tracks, fitted, options.gravity, "fit")
    impacts = impacts_of(tracks, fitted, options.gravity, options.method)
    return errors_of(impacts, predicted, comparable(by_fit))


# -----------------------------------------------------------------------------
# Comparison of recordings with prediction, and the sources of its errors.

# Parameters that may be given; the launch velocity is that of a particle's first flight
KNOWN: Final = {
    name: parameter
    for name, parameter in {**PARAMETERS, **OF_RESTITUTION}.items()
    if name != "launch_velocity"
}
# The motion is irregular if the flights of two predictions, whose initial conditions differ by the
# measurement error, differ by this fraction of the standard deviation of flights
APART: Final = 0.5
REGULAR: Final = 1e-3  # relative standard deviation below which all flights count as equal
FEWEST: Final = 8  # flights needed for this test
COPIES: Final = 12  # predictions from initial conditions that differ by the measurement error
LIMIT: Final = 0.95  # quantile of the distances between two predictions that is the limit of chance
MOST_DRAWS: Final = 10**6
SHARES: Final = ("frames", "pixels", "parameters")


def compare_tracks(
    recordings: xr.Dataset | Sequence[xr.Dataset],
    *,
    method: str = "fit",
    base: float | None = None,
    exposure: float = 0.0,
    motion: str = "detect",
    trace: Trace | None = None,
    contact: float | tuple[float, float] | None = None,
    rebound: str = "rest",
    restitution_law: str = CONSTANT,
    draws: int = DRAWS,
    seed: int = 0,
    threads: int | None = None,
    **known: float,
) -> xr.Dataset:
    """Compare recordings with prediction, case by case; a case is a number of particles.

    Parameters
    ----------
    recordings
        Tracks, as `read_tracks` returns them, of one recording or of several.
    method, base, exposure, motion, trace, contact
        As in `find_impacts`.
    rebound
        Law of rebound, ``"rest"`` or ``"reflect"``.
    restitution_law
        Law of a known restitution.  With an estimated restitution the best law is used if the
        bounces rule out a constant one.
    draws
        Parameter sets drawn within the errors of an estimate, at least 2.
    seed
        Seed of the random numbers.
    threads
        Number of threads, by default one per processor; the result does not depend on it.
    **known
        Known parameters: restitution (1), amplitude (m s-1), frequency (Hz), phase (rad), gravity
        (m s-2), contact_time (s), restitution_speed (m s-1) of a `restitution_law`.  The first four
        are estimated if they are not given.

    Returns
    -------
    xarray.Dataset
        Dims (case, quantity, reading), in per cent of the measured value:

        - ``error``, ``|measured - predicted| / measured``, its mean over the repeats;
        - contributions of ``frames``, ``pixels`` and ``parameters``, which add in quadrature.

        Dims (case, quantity):

        - ``measured``, ``measured_sd`` over the repeats, and ``predicted`` (m, s);
        - ``distribution_distance``: largest difference between the cumulative distributions of
          measured and predicted flights, the relevant measure for irregular motion.

        Dim case:

        - ``irregular``: fraction of particles whose individual flights cannot be predicted;
        - ``distribution_chance``: distance that two predictions whose initial conditions differ by
          the measurement error exceed in 5 %; flights of one orbit are not independent;
        - ``particles``, ``repeats``, ``compared``, and the parameters used.

        Attributes: the base, the ``waveform`` and the ``restitution_law`` of the prediction.

    Raises
    ------
    TrackError
        A recording cannot be measured, or there is none.
    ParameterError
        There is no parameter of that name, or one is outside its range or not determined.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.lab import Experiment, perform_trials
    >>> film = perform_trials(Experiment(particles=2, repeats=1, transient=5.0, duration=10.0))
    >>> known = {"restitution": 0.9, "amplitude": 0.06, "frequency": 20.0}
    >>> found = vs.lab.compare_tracks(film[0].tracks, **known)
    >>> found.error.dims
    ('case', 'quantity', 'reading')
    """
    for name, value in known.items():
        if name not in KNOWN:
            raise ParameterError(f"{name}: is not a parameter; known are {', '.join(KNOWN)}")
        require_parameter(name, value)
    recordings = [recordings] if isinstance(recordings, xr.Dataset) else recordings
    if not isinstance(recordings, Sequence) or not all(
        isinstance(one, xr.Dataset) and "height" in one for one in recordings
    ):
        raise TrackError("recordings: must be tracks that read_tracks returns, or a list of them")
    frequency = known.get("frequency")
    fall = gravity_of(known.get("gravity", PARAMETERS["gravity"].default))
    setup = Setup(base, exposure, motion, frequency, trace, inputs_of(contact, None, None, fall))
    options = ComparisonOptions(known, method, setup, draws, rebound, seed, restitution_law)
    _check(recordings, options)
    with Workers(thread_count(threads)) as workers:
        found = [_compare_recording(tracks, options, workers) for tracks in recordings]
    counts = sorted({int(row["particles"]) for row in found})
    repeats = ([row for row in found if row["particles"] == count] for count in counts)
    table = xr.concat(map(_case, repeats), "case")
    table = table.assign_coords(case=[f"N={count}" for count in counts])
    texts = {name: {row.attrs[name] for row in found} - {""} for name in found[0].attrs}
    return table.assign_attrs({name: "; ".join(sorted(text)) for name, text in texts.items()})


def _case(repeats: Sequence[xr.Dataset]) -> xr.Dataset:
    """Average over the recordings with one number of particles."""
    every = xr.concat(repeats, "repeat", combine_attrs="drop_conflicts")
    means = every.mean("repeat", keep_attrs=True)
    # contributions to an error, and standard errors, are averaged as root mean squares
    for name in [*SHARES, *(name for name in means if str(name).endswith("_error"))]:
        means[name].values = np.sqrt((every[name] ** 2).mean("repeat").values)
    words = {"long_name": "standard deviation over the repeats"}
    spread = np.nan * means["measured"]
    if len(repeats) > 1:
        spread = every["measured"].std("repeat", ddof=1)
    return means.assign(
        measured_sd=spread.assign_attrs(words), repeats=((), len(repeats), {"units": "1"})
    ).assign_coords(particles=repeats[0]["particles"])


def _check(recordings: Sequence[xr.Dataset], options: ComparisonOptions) -> None:
    """Check all arguments before any recording is measured."""
    require_one_of("method", options.method, METHODS, TrackError)
    if not recordings:
        raise TrackError("there is no recording to compare: give at least one")
    require_one_of("rebound", options.rebound, LAWS)
    # one set has no spread
    require_number("draws", options.draws, 2, MOST_DRAWS, whole=True)
    require_number("seed", options.seed, 0, whole=True)
    law = options.restitution_law
    for name, text in speed_mistakes(law, options.known).items():
        raise ParameterError(f"{name}: {text}")
    if law != CONSTANT and "restitution" not in options.known:
        raise ParameterError(
            f"restitution_law = {law!r}: needs the restitution; give restitution and amplitude, or "
            f"leave out the law and its speed, which are then estimated"
        )
    if wrong := range_mistake(law, np.array(options.known.get("restitution", 1.0))):
        raise ParameterError(wrong)
    stated = {"restitution", "amplitude"} & options.known.keys()
    if len(stated) == 1:
        raise ParameterError(
            f"{stated.pop()} is given alone: give restitution and amplitude, or leave both to be "
            f"estimated"
        )
    if stated and "frequency" not in options.known:
        raise ParameterError("the frequency is missing: give it with restitution and amplitude")


def _compare_recording(
    tracks: xr.Dataset, options: ComparisonOptions, workers: Workers
) -> xr.Dataset:
    """Compare one recording with its prediction, and split the error into contributions."""
    fitted = fit_tracks(tracks, options.gravity, options.setup)
    by_fit = impacts_of(tracks, fitted, options.gravity, "fit")
    impacts = impacts_of(tracks, fitted, options.gravity, options.method)
    among = comparable(by_fit)
    if not among.any():
        raise TrackError(
            f"{tracks.attrs['source']}: no particle has nearly all of its flights measured, so "
            f"nothing can be compared; film faster or closer"
        )
    numbers, scene, estimated = parameters_of(by_fit, options)
    sets, shapes, refused = draw_parameters(numbers, scene, estimated, options.draws, options.seed)
    found = predict(by_fit, sets, shapes, scene, workers)
    best = {name: means[0] for name, means in found.items()}
    if not np.isfinite(best["period"][among]).any():
        raise ParameterError(
            f"{tracks.attrs['source']}: with these parameters none of the particles makes a whole "
            f"flight, so nothing can be compared: check restitution, amplitude and frequency"
        )
    means = measured_means(impacts, among)
    used = {name: float(values[0]) for name, values in sets.items()}
    warnings = [f"{refused} drawn sets were not physical and were redrawn"] if refused else []
    try:
        shares = camera_shares(tracks, by_fit, used, scene, options)
    except TrackError as error:
        shares = np.full((2, len(QUANTITIES), len(READINGS)), np.nan)
        warnings.append(f"the errors of the camera are not known: {error}")
    errors = [errors_of(impacts, best, among), *shares, _spreads(found, means, among)]
    both = [[np.nanmean(mean[q][among]) for q in QUANTITIES] for mean in (means, best)]
    columns = _parameter_columns(estimated, used, scene.waveform)
    columns["compared"] = among.mean(), "1", "share of the particles that could be compared"
    irregular, distances, chance = _distributions(by_fit, used, scene, among)
    columns["irregular"] = irregular, "1", "share of the particles whose single flights are chaotic"
    columns["distribution_chance"] = chance, "1", "distance of two predictions, exceeded in 5 %"
    texts = {
        "method": options.method,
        "warning": "; ".join(warnings),
        "base_motion": impacts.attrs["base_motion"],
        "favoured_base": fitted.favoured_base,
        "waveform": scene.waveform.text,
        "restitution_law": scene.restitution_law,
        "law": "" if estimated is None else law_text(estimated),
    }
    words = {"long_name": "largest difference of the distributions of flights", "units": "1"}
    table = _table(errors, both, columns)
    table["distribution_distance"] = "quantity", distances, words
    return table.assign_coords(particles=among.size).assign_attrs(texts)


def _distributions(
    impacts: xr.Dataset, used: dict[str, float], scene: Scene, among: Flags
) -> tuple[float, Array, float]:
    """Compare the distributions of flights.

    Returns the fraction of particles whose individual flights cannot be predicted, because the
    measurement error of the initial conditions grows; the largest differences between the
    cumulative distributions of heights and of periods; and the difference that two predictions
    exceed in 5 %.
    """
    error = impacts.attrs["gravity"] * float(np.nanmedian(impacts["landing_time_error"]))
    copies = [
        impacts.assign(impact_speed=impacts["impact_speed"] + k * max(error, 1e-6))
        for k in range(COPIES + 1)
    ]
    motions = zip(*(predicted_motions(one, used, scene) for one in copies), strict=True)
    particles = np.flatnonzero(np.isfinite(impacts["flight_time"].values).any(axis=1))
    irregular = []
    flights: list[list[Array]] = [[] for _ in copies]
    for particle, nearby in zip(particles, motions, strict=True):
        if not among[particle]:
            continue
        seen = [motion.end <= impacts.attrs["end"] for motion in nearby]
        for own, motion, used_ones in zip(flights, nearby, seen, strict=True):
            own.append(np.stack([motion.apex, motion.end - motion.start])[:, used_ones])
        number = min(int(used_ones.sum()) for used_ones in seen[:2])
        late = slice(number // 2, number)
        first, second = ((motion.end - motion.start)[late] for motion in nearby[:2])
        if number >= FEWEST:
            apart, spread = float(np.std(first - second)), float(first.std())
            irregular.append(apart > APART * spread > APART * REGULAR * float(first.mean()))
    measured = np.stack([impacts[name].values[among] for name in MEASURED_AS.values()])
    measured = measured[:, np.isfinite(measured).all(axis=0)]
    # flights lower or shorter than all measured ones are too small to be seen
    least = measured.min(axis=1, keepdims=True, initial=np.inf)
    every = [np.concatenate(own, axis=1) for own in flights]
    predicted = [own[:, (own >= least).all(axis=0)] for own in every]
    found = [_distance(measured[k], predicted[0][k]) for k in range(len(QUANTITIES))]
    # between two predictions, whose flights are correlated like those of a recording
    pairs = combinations(predicted, 2)
    chance = [max(map(_distance, one, other)) for one, other in pairs]
    limit = float(np.quantile(chance, LIMIT))
    return float(np.mean(irregular)) if irregular else 0.0, np.array(found), limit


def _distance(one: Array, other: Array) -> float:
    """Return the largest difference of two cumulative distributions; NaN without a flight."""
    if not one.size or not other.size:
        return float("nan")
    places = np.concatenate([one, other])
    shares = [np.searchsorted(np.sort(part), places, "right") / part.size for part in (one, other)]
    return float(np.max(np.abs(shares[0] - shares[1])))


def _table(
    errors: Sequence[Array], means: Sequence[Any], numbers: Mapping[str, tuple[Any, str, str]]
) -> xr.Dataset:
    """Dataset of one recording: errors and their contributions, means, and scalars."""
    words = {"error": "|measured - predicted| / measured"}
    words |= {name: f"error due to {name}" for name in SHARES}
    percent = {
        name: (values, "percent", text)
        for (name, text), values in zip(words.items(), errors, strict=True)
    }
    of_means = {
        name: ("quantity", values, {"long_name": f"{name} mean"})
        for name, values in zip(("measured", "predicted"), means, strict=True)
    }
    return xr.Dataset(
        {**with_units(("quantity", "reading"), percent), **of_means, **with_units((), numbers)},
        coords={
            "quantity": list(QUANTITIES),
            "units": ("quantity", ["m", "s"]),
            "reading": list(READINGS),
        },
    )


def _spreads(found: dict[str, Array], means: dict[str, Array], among: Flags) -> Array:
    """Standard deviation over the draws in per cent of the measured means, zero without draws.

    Its shape is (quantity, reading).
    """
    drawn = np.stack(list(found.values()))[:, 1:, among]
    if not drawn.shape[1]:
        return np.zeros((len(QUANTITIES), len(READINGS)))
    spread = 100.0 * drawn.std(axis=1) / [means[q][among] for q in QUANTITIES]
    worst = np.array(READINGS) == "worst"
    return np.asarray(np.where(worst, spread.max(1, keepdims=True), spread.mean(1, keepdims=True)))


def _parameter_columns(
    estimated: xr.Dataset | None, used: dict[str, float], shape: Waveform
) -> dict[str, tuple[Any, str, str]]:
    """Parameters of a prediction, with Gamma, and their standard errors, NaN for known ones."""
    velocity = used["amplitude"] / (1.0 + used["restitution"])
    gamma = shape.fall * used["frequency"] * velocity / used["gravity"]
    about = {name: (p.units, p.long_name) for name, p in KNOWN.items() if name in USED}
    about[ACCELERATION] = "1", "peak acceleration of the base in units of gravity"
    values, errors = {SPEED: np.nan, **used, ACCELERATION: gamma}, dict.fromkeys(about, np.nan)
    if estimated is not None:
        fitted = zip(estimated["parameter"].values, estimated["error"].values, strict=True)
        errors |= {name: error for name, error in fitted if name in about}
        errors[ACCELERATION] = float(estimated.get("base_acceleration_error", np.nan))
    words = "typical standard error, in one recording, of the "
    return {name: (values[name], *meaning) for name, meaning in about.items()} | {
        f"{name}_error": (error, about[name][0], f"{words}{name}") for name, error in errors.items()
    }
