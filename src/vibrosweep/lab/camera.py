"""A camera that films flights: frames, exposure, pixels and noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.kernels.record import Record
from vibrosweep.lab.surfaces import Surface


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
        True if positions are rounded to whole pixels.
    exposure
        Time for which the shutter is open, s; a position is the mean over it.
    dropped
        Fraction of the frames that are lost.
    scale_error
        Relative error of the size of a pixel, by which measured heights are too large.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> vs.lab.Experiment(camera=vs.lab.Camera(frame_rate=480.0)).camera.pixel
    0.0001
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
    """Flights of one particle in order of time; between them it is on the base."""

    # start, end: times of lift-off and landing, s; the end is infinite if it is after the record
    start: Array
    end: Array
    # velocity, rise: velocity (m s-1) and height (m) at lift-off
    velocity: Array
    rise: Array
    gravity: float  # m s-2
    surface: Surface  # of the base

    @classmethod
    def from_record(
        cls, record: Record, particle: int, time: float, speed: float, gravity: float, base: Surface
    ) -> Motion:
        """Take the flights of a particle from a record; `time` and `speed` are of its launch."""
        landing, liftoff = record.landing_time[particle], record.liftoff_time[particle]
        flies = np.isfinite(liftoff)
        start = np.append(time, liftoff[flies])
        velocity = np.append(speed, record.rebound_velocity[particle][flies])
        end = np.append(landing, np.inf)[: start.size]
        end = np.where(np.isnan(end), np.inf, end)
        return cls(start, end, velocity, base.height(start), gravity, base)

    @property
    def apex(self) -> Array:
        """Height of the apex of each flight above the mean level of the base, m."""
        return self.rise + self.velocity**2 / (2.0 * self.gravity)

    def means(self, begin: float, end: float) -> tuple[float, float]:
        """Mean apex (m) and duration (s) of the flights in an interval; NaN if there are none."""
        inside = (self.start >= begin) & (self.end <= end)
        if not inside.any():
            return np.nan, np.nan
        return float(np.mean(self.apex[inside])), float(np.mean((self.end - self.start)[inside]))

    def _flight(self, time: Array) -> tuple[NDArray[np.intp], Array, NDArray[np.bool_]]:
        """Latest flight at each instant, or the first; time since its start; True on the base."""
        flight = np.maximum(np.searchsorted(self.start, time, side="right") - 1, 0)
        since = time - self.start[flight]
        return flight, since, (since < 0.0) | (time > self.end[flight])

    def height(self, time: Array) -> Array:
        """Height in m at instants in s."""
        flight, since, down = self._flight(time)
        flying = self.rise[flight] + since * (self.velocity[flight] - 0.5 * self.gravity * since)
        return np.where(down, self.surface.height(time), flying)

    def mean_height(self, time: Array, exposure: float) -> Array:
        """Mean height in m over an exposure (s) centred at each instant."""

        def flown_area(flight: NDArray[np.intp], since: Array) -> Array:
            speed = self.velocity[flight] / 2.0 - self.gravity * since / 6.0
            return since * (self.rise[flight] + since * speed)

        below = self.surface.area(self.start)
        end = np.where(np.isfinite(self.end), self.end, self.start)
        flown = flown_area(np.arange(end.size), end - self.start)
        # area between the flights and the base, up to the start of each flight
        above = np.append(0.0, np.cumsum(flown - (self.surface.area(end) - below)))

        def area(instant: Array) -> Array:
            flight, since, down = self._flight(instant)
            resting = self.surface.area(instant) + np.where(since < 0.0, 0.0, above[flight + 1])
            flying = above[flight] + below[flight] + flown_area(flight, since)
            return np.where(down, resting, flying)

        return (area(time + exposure / 2.0) - area(time - exposure / 2.0)) / exposure


def heights(motions: list[Motion], time: Array, exposure: float) -> Array:
    """Average the true heights (m) over an exposure (s); shape (frame, particle)."""
    return np.stack(
        [m.mean_height(time, exposure) if exposure else m.height(time) for m in motions], axis=1
    )


def film(true: Array, camera: Camera, rng: np.random.Generator) -> Array:
    """Turn true heights (m), shape (frame, particle), into tracked ones; NaN in lost frames."""
    pixels = true * (1.0 + camera.scale_error) / camera.pixel
    pixels = pixels + camera.noise * rng.standard_normal(pixels.shape)
    if camera.whole_pixels:
        pixels = np.rint(pixels)
    pixels[rng.random(len(pixels)) < camera.dropped] = np.nan
    return np.asarray(pixels * camera.pixel)
