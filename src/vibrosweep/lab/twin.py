"""Simulated copy of a recording: the predicted motion, filmed and measured like the real one.

The errors of this measurement are those of the camera alone, because the motion is the prediction.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
import xarray as xr

from vibrosweep.arrays import Array
from vibrosweep.engine.landings import all_parameters
from vibrosweep.kernels.impact import Batch, base_of
from vibrosweep.kernels.record import Record
from vibrosweep.lab.camera import Camera, Motion, film, heights
from vibrosweep.lab.fitting import Setup, fit_tracks
from vibrosweep.lab.impacts import impacts_of
from vibrosweep.lab.oscillation import Trace
from vibrosweep.lab.prediction import ComparisonOptions, first_flights
from vibrosweep.lab.relative_errors import QUANTITIES, comparable, errors_of
from vibrosweep.lab.surfaces import LEVEL, oscillating_surface
from vibrosweep.lab.tracks import make_tracks
from vibrosweep.lab.wander import wandering_record
from vibrosweep.model.parameters import HIGH_BOUNCE, Launches, dimensionless
from vibrosweep.model.shapes import Waveform
from vibrosweep.scene.scene import Scene

# Variance of S and C of a base without motion, (m s-1)^2
LEAST_VARIANCE: Final = 1e-24


def camera_shares(
    tracks: xr.Dataset,
    impacts: xr.Dataset,
    numbers: Mapping[str, float],
    scene: Scene,
    options: ComparisonOptions,
) -> Array:
    """Errors in per cent that frames alone cause, and those that pixels add.

    Their shape is (2, quantity, reading).  `numbers` are the parameters of the prediction, and the
    `scene` is one of `scene_of`.
    """
    motions = predicted_motions(impacts, numbers, scene)
    time = tracks["time"].values
    true = heights(motions, time, options.setup.exposure)
    means = [motion.means(time[0], time[-1]) for motion in motions]
    predicted = dict(zip(QUANTITIES, np.array(means).T, strict=True))
    noise, rate = impacts.attrs["noise"], impacts.attrs["frame_rate"]
    # the fit of a moving base is weighted with the noise, which must not be zero
    least = 0.0 if impacts.attrs["base_motion"] == "level" else 0.01
    setup = options.setup
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
    """Trace of the predicted base, as if it had been measured to one part in a million."""
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
    """Predict the motion of each particle with a whole flight, on the clock of the recording."""
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
    """Film true heights, measure them, and return the errors of `predicted` against them."""
    height = film(true, camera, np.random.default_rng(options.seed))
    tracks = make_tracks(time, height, source="the predicted motion, filmed as the recording was")
    fitted = fit_tracks(tracks, options.gravity, setup)
    by_fit = impacts_of(tracks, fitted, options.gravity, "fit")
    impacts = impacts_of(tracks, fitted, options.gravity, options.method)
    return errors_of(impacts, predicted, comparable(by_fit))
