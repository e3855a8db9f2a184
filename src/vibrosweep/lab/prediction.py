"""Predictions with measured or estimated parameters, from the first lift-off of each particle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
import xarray as xr

from vibrosweep.arrays import Array, Indices
from vibrosweep.engine.landings import all_parameters
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.lab.base_harmonics import with_values
from vibrosweep.model.parameters import HIGH_BOUNCE, MOVING, PARAMETERS
from vibrosweep.model.shapes import SINE, Waveform
from vibrosweep.scene.scene import Scene

DRAWS: Final = 64
# Motion of the base of a recording -> name of the base.
BASE_OF_MOTION: Final = {"level": HIGH_BOUNCE, "moving": MOVING}
# Unphysical draws may outnumber the draws by this many, which are due to chance.
CHANCE: Final = 10


class Prediction(NamedTuple):
    """Predicted means of each particle."""

    # height, period: m and s, shape (draw, particle); NaN for a particle without a whole flight
    height: Array
    period: Array


def draw(
    scene: Mapping[str, float],
    estimated: xr.Dataset | None,
    draws: int,
    seed: int = 0,
    waveform: Waveform = SINE,
) -> tuple[dict[str, Array], list[Waveform], int]:
    """Draw parameter sets: first the best one, then samples of a normal posterior.

    `scene` holds every parameter of `PARAMETERS`; those in `estimated`, a result of `estimate`,
    override it, and of the waveform too.  Without an estimate there is only the scene itself.

    Returns
    -------
    parameters
        Arrays of shape (draw,).
    waveforms
        One for each draw.
    refused
        Number of draws outside the physical range, which were replaced.

    Raises
    ------
    ParameterError
        The orbit does not determine the parameters, the best set is not physical, or more than
        half of the draws are not.
    """
    if estimated is None:
        return {name: np.array([scene[name]]) for name in PARAMETERS}, [waveform], 0
    names = [str(name) for name in estimated["parameter"].values]
    best, covariance = estimated["estimate"].values, estimated["covariance"].values
    if not np.isfinite(covariance).all():
        raise ParameterError(f"the parameters cannot be used: {estimated.attrs['warning']}")
    physical = [(k, PARAMETERS[name]) for k, name in enumerate(names) if name in PARAMETERS]
    for name, value in zip(names, best, strict=True):
        if name in PARAMETERS and not PARAMETERS[name].accepts(value):
            raise ParameterError(
                f"{name} is estimated as {value:.4g}: must be {PARAMETERS[name].allowed}; check "
                f"the scale and the frequency, or give the parameters"
            )
    rng = np.random.default_rng(seed)
    kept, refused = [best], 0
    while len(kept) <= draws:
        values = rng.multivariate_normal(best, covariance)
        if all(bool(one.accepts(values[k])) for k, one in physical):
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
    every = {name: drawn.get(name, np.full(len(kept), scene[name])) for name in PARAMETERS}
    return every, shapes, refused


class FirstFlights(NamedTuple):
    """Particles with a whole flight, and the beginning of the first one."""

    particle: Indices
    # start, speed: time (s) and speed (m s-1) of its lift-off
    start: Array
    speed: Array
    # Parameters of shape (draw * particle,): a launch at time t equals one at t = 0 with the phase
    # phi + 2 pi f t, so that each particle is a realization
    sets: dict[str, Array]


def first_flights(impacts: xr.Dataset, parameters: Mapping[str, Array]) -> FirstFlights:
    """Launch each particle as it first left the base.

    The parameters are all of `model.parameters.PARAMETERS`, of shape (draw,); the phase is that at
    t = 0 of the recording, and the launch velocity is not used.
    """
    whole = np.isfinite(impacts["flight_time"].values)
    particle = np.flatnonzero(whole.any(axis=1))
    first = whole[particle].argmax(axis=1) if particle.size else particle
    start, speed = (
        impacts[name].values[particle, first] for name in ("liftoff_time", "impact_speed")
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
    workers: Workers,
    rebound: str = "rest",
) -> Prediction:
    """Means of each particle from its first whole flight to the end of the film.

    The parameters are those of `first_flights`, with a waveform for each draw.  A particle that
    appears late is followed for as long as the others.
    """
    draws = parameters["frequency"].size
    height, period = np.full((2, draws, impacts.sizes["particle"]), np.nan)
    flown, start, _, sets = first_flights(impacts, parameters)
    if flown.size:
        length = impacts.attrs["end"] - float(start.min())
        base = BASE_OF_MOTION[impacts.attrs["base_motion"]]
        bare = Scene(1, (0.0,), length, rebound, base=base).recorded()
        for shape in dict.fromkeys(waveforms):
            alike = np.array([one == shape for one in waveforms])
            chosen = {name: values[np.repeat(alike, flown.size)] for name, values in sets.items()}
            found = measure(all_parameters(chosen), replace(bare, waveform=shape), workers)
            for each, name in ((height, "rebound_height_mean"), (period, "flight_time_mean")):
                each[np.ix_(alike, flown)] = found[name].reshape(-1, flown.size)
    return Prediction(height, period)
