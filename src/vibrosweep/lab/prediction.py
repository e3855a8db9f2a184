"""Predictions with known or estimated parameters, from the first flight of each particle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

import numpy as np
import xarray as xr

from vibrosweep.arrays import Array, Indices
from vibrosweep.engine.landings import all_parameters
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.lab.base_harmonics import polar, with_values
from vibrosweep.lab.estimation import estimate, fit_phase
from vibrosweep.lab.fitting import Setup
from vibrosweep.lab.impacts import harmonic_numbers
from vibrosweep.lab.relative_errors import QUANTITIES
from vibrosweep.lab.speed_laws import law_of
from vibrosweep.model.parameters import HIGH_BOUNCE, MOVING, OF_RESTITUTION, PARAMETERS
from vibrosweep.model.restitution_laws import CONSTANT, SPEED, range_mistake
from vibrosweep.model.shapes import SINE, Waveform
from vibrosweep.scene.scene import Scene, stored

DRAWS: Final = 64
MEANS: Final = ("rebound_height_mean", "flight_time_mean")  # the names of `QUANTITIES` in a sweep
USED: Final = ("restitution", "amplitude", "frequency", SPEED)
# Name of the base by its motion in a recording
BASE_OF_MOTION: Final = {"level": HIGH_BOUNCE, "moving": MOVING}
# Number by which refused draws may exceed the draws asked for, by chance
CHANCE: Final = 10


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

    @property
    def gravity(self) -> float:
        """Gravity in m s-2."""
        return self.known.get("gravity", PARAMETERS["gravity"].default)


def parameters_of(
    impacts: xr.Dataset, options: ComparisonOptions
) -> tuple[dict[str, float], Scene, xr.Dataset | None]:
    """Find the parameters of a prediction.

    Returns the known ones, the scene, and the estimate of the others, None if all are known.
    """
    known = {name: p.default for name, p in PARAMETERS.items()} | dict(options.known)
    stated = {"restitution", "amplitude"} & options.known.keys()
    if len(stated) == 1:
        raise ParameterError(
            f"{stated.pop()} is given alone: give restitution and amplitude, or leave both to be "
            f"estimated"
        )
    if not stated:
        found = estimate(impacts, frequency=options.known.get("frequency"))
        law, speed = law_of(found)
        known |= {} if law == CONSTANT else {SPEED: speed}
        return known, scene_of(impacts, options.rebound, stored(found.attrs), law), found
    if "frequency" not in options.known:
        raise ParameterError("the frequency is missing: give it with restitution and amplitude")
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
    """Draw parameter sets: the best estimate, then samples of its normal posterior.

    `known` holds every parameter of `PARAMETERS`, and the speed of a law of restitution.  Values of
    `estimated`, a result of `estimate`, replace them and those of the waveform of the scene.
    Without an estimate there is one set, the known one.

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
    kept, refused = [best], 0
    while len(kept) <= draws:
        values = rng.multivariate_normal(best, covariance)
        within = not range_mistake(law, values[:1])  # values[0] is the restitution
        if within and all(bool(parameter.accepts(values[k])) for k, parameter in physical):
            kept.append(values)
        else:
            refused += 1
        if refused > draws + CHANCE:
            raise ParameterError(
                f"{refused} of {refused + len(kept)} sets drawn within the errors of the estimate "
                f"are not physical: the parameters are too uncertain; give them"
            )
    drawn = dict(zip(names, np.array(kept).T, strict=True))
    shapes = [
        with_values(waveform, {name: float(values[k]) for name, values in drawn.items()})
        for k in range(len(kept))
    ]
    sets = {name: drawn.get(name, np.full(len(kept), value)) for name, value in known.items()}
    return sets, shapes, refused


def scene_of(impacts: xr.Dataset, rebound: str, waveform: Waveform, restitution_law: str) -> Scene:
    """Make the scene of one particle that is launched at t = 0 over the base of a recording."""
    base = BASE_OF_MOTION[impacts.attrs["base_motion"]]
    return Scene(
        1, (0.0,), rebound=rebound, base=base, waveform=waveform, restitution_law=restitution_law
    ).recorded()


class FirstFlights(NamedTuple):
    """Particles with a whole flight, and where the first flight of each begins."""

    particle: Indices
    # start, speed: time (s) and speed (m s-1) of its lift-off
    start: Array
    speed: Array
    # Parameters of shape (draw * particle,), a realization for each particle: a launch at time t
    # equals one at t = 0 with the phase phi + 2 pi f t
    sets: dict[str, Array]


def first_flights(impacts: xr.Dataset, parameters: Mapping[str, Array]) -> FirstFlights:
    """Launch each particle with the lift-off of its first whole flight.

    The parameters are those of `draw_parameters`, of shape (draw,).  Their phase is that at t = 0
    of the recording, and their launch velocity is not used.
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

    The shape is (draw, particle), with NaN for a particle without a whole flight.  Parameters and
    waveforms are those of `draw_parameters`, the scene that of `scene_of`.  A particle that appears
    late is followed for as long as the others.
    """
    draws = parameters["frequency"].size
    size = draws, impacts.sizes["particle"]
    means = {quantity: np.full(size, np.nan) for quantity in QUANTITIES}
    flown, start, _, sets = first_flights(impacts, parameters)
    if flown.size:
        length = impacts.attrs["end"] - float(start.min())
        for shape in dict.fromkeys(waveforms):
            alike = np.array([waveform == shape for waveform in waveforms])
            chosen = {name: values[np.repeat(alike, flown.size)] for name, values in sets.items()}
            lasting = replace(scene, duration=length, waveform=shape)
            found = measure(all_parameters(chosen), lasting, workers)
            for mean, name in zip(means.values(), MEANS, strict=True):
                mean[np.ix_(alike, flown)] = found[name].reshape(-1, flown.size)
    return means
