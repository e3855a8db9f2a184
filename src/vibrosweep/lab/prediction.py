"""Predictions with measured or estimated parameters, from the first lift-off of each particle."""

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
from vibrosweep.lab.speed_laws import law_of
from vibrosweep.model.parameters import HIGH_BOUNCE, MOVING, OF_RESTITUTION, PARAMETERS
from vibrosweep.model.restitution_laws import CONSTANT, SPEED, range_mistake
from vibrosweep.model.shapes import SINE, Waveform
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.waveform import stored

DRAWS: Final = 64
USED: Final = ("restitution", "amplitude", "frequency", SPEED)
# Motion of the base of a recording -> name of the base.
BASE_OF_MOTION: Final = {"level": HIGH_BOUNCE, "moving": MOVING}
# Unphysical draws may outnumber the draws by this many, which are due to chance.
CHANCE: Final = 10


class Prediction(NamedTuple):
    """Predicted means of each particle."""

    # height, period: m and s, shape (draw, particle); NaN for a particle without a whole flight
    height: Array
    period: Array


@dataclass(frozen=True)
class ComparisonOptions:
    """Options of the comparison of recordings with prediction."""

    # Known parameters, by their names in `PARAMETERS` and `OF_RESTITUTION`; without them
    # restitution, amplitude, phase and frequency are estimated
    known: Mapping[str, float]
    method: str = "fit"  # ``"fit"`` or ``"sign_change"``
    setup: Setup = field(default_factory=Setup)  # as `find_impacts` takes it
    draws: int = DRAWS  # parameter sets drawn within the errors of an estimate
    rebound: str = "rest"  # ``"rest"`` or ``"reflect"``
    seed: int = 0  # of the random numbers
    restitution_law: str = CONSTANT  # of a restitution that is known

    @property
    def gravity(self) -> float:
        """Gravity in m s-2."""
        return self.known.get("gravity", PARAMETERS["gravity"].default)


def parameters_of(
    impacts: xr.Dataset, options: ComparisonOptions
) -> tuple[dict[str, float], Scene, xr.Dataset | None]:
    """Known parameters, the scene of the prediction, and the estimate of other parameters."""
    known = {name: p.default for name, p in PARAMETERS.items()} | dict(options.known)
    given = {"restitution", "amplitude"} & options.known.keys()
    if len(given) == 1:
        raise ParameterError(
            f"{given.pop()} is given alone: give restitution and amplitude, or leave both to be "
            f"estimated"
        )
    if not given:
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
    """Draw parameter sets: first the best one, then samples of a normal posterior.

    `known` holds every parameter of `PARAMETERS`, and the speed of a law of restitution; those in
    `estimated`, a result of `estimate`, override them, and the waveform of the scene.  Without an
    estimate there is only what is known.

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
    waveform, law = scene.waveform, scene.restitution_law
    if estimated is None:
        return {name: np.array([value]) for name, value in known.items()}, [waveform], 0
    names = [str(name) for name in estimated["parameter"].values]
    best, covariance = estimated["estimate"].values, estimated["covariance"].values
    if not np.isfinite(covariance).all():
        raise ParameterError(f"the parameters cannot be used: {estimated.attrs['warning']}")
    every = {**PARAMETERS, **OF_RESTITUTION}
    physical = [(k, every[name]) for k, name in enumerate(names) if name in every]
    for k, one in physical:
        if not one.accepts(best[k]):
            raise ParameterError(
                f"{one.name} is estimated as {best[k]:.4g}: must be {one.allowed}; check the "
                f"scale and the frequency, or give the parameters"
            )
    rng = np.random.default_rng(seed)
    kept, refused = [best], 0
    while len(kept) <= draws:
        values = rng.multivariate_normal(best, covariance)
        within = not range_mistake(law, values[:1])  # the restitution is the first
        if within and all(bool(one.accepts(values[k])) for k, one in physical):
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
    """Scene of one particle that is launched at t = 0, over the base of a recording."""
    base = BASE_OF_MOTION[impacts.attrs["base_motion"]]
    return Scene(
        1,
        (0.0,),
        rebound=rebound,
        base=base,
        waveform=waveform,
        restitution_law=restitution_law,
    ).recorded()


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

    The parameters are those of `draw_parameters`, of shape (draw,); the phase is that at
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
    scene: Scene,
    workers: Workers,
) -> Prediction:
    """Means of each particle from its first whole flight to the end of the film.

    The parameters are those of `first_flights`, with a waveform for each draw, in a scene of
    `scene_of`.  A particle that appears late is followed for as long as the others.
    """
    draws = parameters["frequency"].size
    height, period = np.full((2, draws, impacts.sizes["particle"]), np.nan)
    flown, start, _, sets = first_flights(impacts, parameters)
    if flown.size:
        length = impacts.attrs["end"] - float(start.min())
        for shape in dict.fromkeys(waveforms):
            alike = np.array([one == shape for one in waveforms])
            chosen = {name: values[np.repeat(alike, flown.size)] for name, values in sets.items()}
            own = replace(scene, duration=length, waveform=shape)
            found = measure(all_parameters(chosen), own, workers)
            for each, name in ((height, "rebound_height_mean"), (period, "flight_time_mean")):
                each[np.ix_(alike, flown)] = found[name].reshape(-1, flown.size)
    return Prediction(height, period)
