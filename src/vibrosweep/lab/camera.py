"""What a camera sees of recorded flights: frames, exposure, pixels, noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vibrosweep.kernels.record import Record

__all__ = ["Camera", "Motion", "film", "heights"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Camera:
    """A camera and its tracking.

    Attributes
    ----------
    frame_rate
        Frames per second, Hz.
    pixel
        Size of a pixel in the plane of motion, m.
    noise
        Standard deviation of a tracked position, in pixels.
    whole_pixels
        Whether positions are rounded to whole pixels.
    exposure
        Time for which the shutter is open, s; a position is the mean over it.
    dropped
        Share of the frames that are lost.
    scale_error
        Relative error of the size of a pixel: heights come out larger by this.
    """

    frame_rate: float = 240.0
    pixel: float = 1e-4
    noise: float = 1.0
    whole_pixels: bool = True
    exposure: float = 0.0
    dropped: float = 0.0
    scale_error: float = 0.0


@dataclass(frozen=True)
class Motion:
    """Flights of one particle, in their order.

    Attributes
    ----------
    start, end
        Lift-off and landing in s; a flight in progress also ends at its landing.
    velocity
        Speed at lift-off, m s-1.
    gravity
        m s-2.
    """

    start: Array
    end: Array
    velocity: Array
    gravity: float

    @classmethod
    def of(
        cls, record: Record, particle: int, launch: float, launch_velocity: float, gravity: float
    ) -> Motion:
        """Take the flights of one particle out of a record of landings."""
        flies = np.isfinite(record.liftoff_time[particle])
        start = np.append(launch, record.liftoff_time[particle][flies])
        velocity = np.append(launch_velocity, record.rebound_velocity[particle][flies])
        return cls(start, start + 2.0 * velocity / gravity, velocity, gravity)

    def _flight(self, time: Array) -> tuple[NDArray[np.intp], Array]:
        """Last flight begun by then (the first before any), and time since its start."""
        flight = np.maximum(np.searchsorted(self.start, time, side="right") - 1, 0)
        since = np.clip(time - self.start[flight], 0.0, (self.end - self.start)[flight])
        return flight, since

    def height(self, time: Array) -> Array:
        """Height in m at instants in s."""
        flight, since = self._flight(time)
        return since * (self.velocity[flight] - 0.5 * self.gravity * since)

    def mean_height(self, time: Array, exposure: float) -> Array:
        """Mean height in m over exposures of that length in s, centred at the instants."""
        whole = 2.0 * self.velocity**3 / (3.0 * self.gravity**2)
        before = np.concatenate([[0.0], np.cumsum(whole)])

        def area(instant: Array) -> Array:
            flight, since = self._flight(instant)
            part = since**2 * (self.velocity[flight] / 2.0 - self.gravity * since / 6.0)
            return before[flight] + part

        return (area(time + exposure / 2.0) - area(time - exposure / 2.0)) / exposure


def heights(motions: list[Motion], time: Array, exposure: float) -> Array:
    """True heights in m, averaged over the exposure; shape (frame, particle)."""
    return np.stack(
        [m.mean_height(time, exposure) if exposure else m.height(time) for m in motions], axis=1
    )


def film(true: Array, camera: Camera, rng: np.random.Generator) -> Array:
    """Heights as tracked, in m; NaN in lost frames.

    Parameters
    ----------
    true
        Shape (frame, particle), m.
    """
    pixels = true * (1.0 + camera.scale_error) / camera.pixel
    pixels = pixels + camera.noise * rng.standard_normal(pixels.shape)
    if camera.whole_pixels:
        pixels = np.rint(pixels)
    pixels[rng.random(len(pixels)) < camera.dropped] = np.nan
    return np.asarray(pixels * camera.pixel)
