"""Virtual experiments: the base, the camera, and their files."""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from vibrosweep.abilities import ANALYSES, refusal
from vibrosweep.arrays import Array
from vibrosweep.engine.coupled import BaseTrack
from vibrosweep.errors import ParameterError, SpecError, refuse
from vibrosweep.kernels.record import Record
from vibrosweep.lab.variables import require_number
from vibrosweep.mistakes import Mistakes
from vibrosweep.model.forcing import FORCINGS
from vibrosweep.model.parameters import MOVING, PARAMETERS
from vibrosweep.model.restitution_laws import implied
from vibrosweep.model.shapes import SINE, Waveform
from vibrosweep.scene.keys import (
    MAX_SEED,
    SECTIONS,
    Check,
    Sections,
    flag,
    one_of,
    read_tables,
    whole_number,
)
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import batch, checked, read_text

__all__ = ["LABORATORY", "Experiment", "Variation"]

# -----------------------------------------------------------------------------
# Surfaces of the bases of virtual experiments: at rest, oscillating, or recoiling on a mount.

STEPS_PER_PERIOD: Final = 1000
CONTACTS: Final = ("dashpot", "hertz")  # laws of force of contacts that last
SHORTEST_CONTACT: Final = 1e-5  # s, of contacts that last


class Surface(NamedTuple):
    """Motion of a base, as functions of time in s."""

    height: Callable[[Array], Array]  # m
    area: Callable[[Array], Array]  # integral of the height over time, m s
    velocity: Callable[[Array], Array]  # m s-1
    acceleration: Callable[[Array], Array]  # m s-2


LEVEL: Final = Surface(*4 * (np.zeros_like,))


def oscillating_surface(scene: Mapping[str, float], waveform: Waveform = SINE) -> Surface:
    """Make the surface of `base = "moving"`: y = (V0 / f) W(f t + phi / 2 pi).

    V0 is A / (1 + e).  A sine is -B cos(2 pi f t + phi) with 2 pi f B = V0.
    """
    frequency, phase = scene["frequency"], scene["phase"]
    omega = 2.0 * math.pi * frequency
    size = scene["amplitude"] / ((1.0 + scene["restitution"]) * omega)
    if waveform != SINE:
        unit = 2.0 * math.pi * size
        return Surface(
            lambda t: unit * waveform.height(frequency * t + phase / (2.0 * math.pi)),
            lambda t: unit / frequency * waveform.area(frequency * t + phase / (2.0 * math.pi)),
            lambda t: unit * frequency * waveform.velocity(frequency * t + phase / (2.0 * math.pi)),
            lambda t: unit * frequency**2 * waveform.slope(frequency * t + phase / (2.0 * math.pi)),
        )
    return Surface(
        lambda t: np.asarray(-size * np.cos(omega * t + phase)),
        lambda t: np.asarray(-size / omega * np.sin(omega * t + phase)),
        lambda t: np.asarray(size * omega * np.sin(omega * t + phase)),
        lambda t: np.asarray(size * omega**2 * np.cos(omega * t + phase)),
    )


def recoiling_surface(track: BaseTrack, frequency: float, end: float) -> Surface:
    """Make the surface of `base = "sprung"`, interpolated between a thousand points per period.

    `track` is the motion of the base in one realization from the first launch on; before that the
    base is assumed to rest at its initial height.  The surface extends to `end` (s).
    """
    begin = float(track.track.time[0, 0])
    time = begin + np.arange(int((end - begin) * frequency * STEPS_PER_PERIOD) + 2) / (
        frequency * STEPS_PER_PERIOD
    )
    spline = CubicHermiteSpline(time, *track.at(time))
    integral, velocity, acceleration = (spline.derivative(n) for n in (-1, 1, 2))
    start = float(spline(begin))
    return Surface(
        lambda t: np.asarray(spline(np.maximum(t, begin))),
        lambda t: np.asarray(integral(np.maximum(t, begin)) + start * np.minimum(t - begin, 0.0)),
        lambda t: np.where(t < begin, 0.0, velocity(t)),
        lambda t: np.where(t < begin, 0.0, acceleration(t)),
    )


# -----------------------------------------------------------------------------
# Camera: frames, exposure, pixels and noise.


@dataclass(frozen=True)
class Camera:
    """A camera with the tracking of its images.

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
        Exposure time, s; a position is the mean over it.
    dropped
        Fraction of lost frames.
    scale_error
        Relative error of the scale, positive if measured heights are too large.
    rounding
        Resolution of the time stamps, s.

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
    rounding: float = 0.0

    def __post_init__(self) -> None:
        _check_values(self, "camera")


class Filmable(Protocol):
    """A motion that a camera can film."""

    def height(self, time: Array) -> Array:
        """Height in m at times in s."""

    def mean_height(self, time: Array, exposure: float) -> Array:
        """Mean height in m over an exposure (s) centred at each time."""


@dataclass(frozen=True)
class Motion:
    """Flights of one particle in chronological order; between them it is on the base."""

    # start, end: times of lift-off and landing, s; the end is infinite if the record ends earlier
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
        """Extract a particle's flights from a record; `time` and `speed` are those of launch."""
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
        """Index of the latest flight or the first, time since its start, True on the base."""
        flight = np.maximum(np.searchsorted(self.start, time, side="right") - 1, 0)
        since = time - self.start[flight]
        return flight, since, (since < 0.0) | (time > self.end[flight])

    def height(self, time: Array) -> Array:
        """Height in m at times in s."""
        flight, since, down = self._flight(time)
        flying = self.rise[flight] + since * (self.velocity[flight] - 0.5 * self.gravity * since)
        return np.where(down, self.surface.height(time), flying)

    def mean_height(self, time: Array, exposure: float) -> Array:
        """Mean height in m over an exposure (s) centred at each time."""

        def flown_area(flight: NDArray[np.intp], since: Array) -> Array:
            speed = self.velocity[flight] / 2.0 - self.gravity * since / 6.0
            return since * (self.rise[flight] + since * speed)

        below = self.surface.area(self.start)
        end = np.where(np.isfinite(self.end), self.end, self.start)
        flown = flown_area(np.arange(end.size), end - self.start)
        # accumulated area between the flights and the base, up to the start of each flight
        above = np.append(0.0, np.cumsum(flown - (self.surface.area(end) - below)))

        def area(instant: Array) -> Array:
            flight, since, down = self._flight(instant)
            resting = self.surface.area(instant) + np.where(since < 0.0, 0.0, above[flight + 1])
            flying = above[flight] + below[flight] + flown_area(flight, since)
            return np.where(down, resting, flying)

        return (area(time + exposure / 2.0) - area(time - exposure / 2.0)) / exposure


def heights(motions: Sequence[Filmable], time: Array, exposure: float) -> Array:
    """Average true heights (m) over an exposure (s); shape (frame, particle)."""
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


# -----------------------------------------------------------------------------
# Virtual experiments: particles, a base and a camera, all with imperfections.

# Table 1 scaled to 20 Hz: the same dimensionless kick, 2 f A / g = 0.2446, and first flight
LABORATORY: Final[Mapping[str, float]] = {
    "restitution": 0.9,
    "amplitude": 0.06,
    "frequency": 20.0,
    "phase": 0.0,
    "gravity": PARAMETERS["gravity"].default,
    "launch_velocity": 0.25,
    "contact_time": 2.5e-5,
}
DEFAULTS: Final[Mapping[str, Any]] = {
    **LABORATORY,
    "particles": 5,
    "transient": 20.0,
    "duration": 60.0,
}
# Keys for the beginning of a recording, in the table [measure] of a file
WINDOW: Final = ("transient", "transient_periods")


@dataclass(frozen=True)
class Variation:
    """Imperfections of particles and base.

    Attributes
    ----------
    frequency_jitter
        Relative standard deviation of the length of a forcing period.
    frequency_setting
        Relative standard deviation of the mean frequency between repeats.
    amplitude_setting
        Relative standard deviation of the amplitude between repeats.
    restitution_spread
        Standard deviation of the restitution among particles; the particles are the same in all
        repeats.
    level_spread
        Standard deviation among particles of the level of the base below them (m), as caused by a
        tilted base or camera.
    scatter
        Standard deviation of the restitution from bounce to bounce.
    contact_time, contact
        Duration of a contact at 1 m/s (s), by default 0, and its law of force: ``"dashpot"``, a
        linear spring and a dashpot, or ``"hertz"``, with longer contacts at low speed.
    terminal_speed
        Terminal speed in air, m/s; by default there is no drag.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> vs.lab.Experiment(variation=vs.lab.Variation(frequency_jitter=0.01)).repeats
    4
    """

    frequency_jitter: float = 0.0
    frequency_setting: float = 0.0
    amplitude_setting: float = 0.0
    restitution_spread: float = 0.0
    level_spread: float = 0.0
    scatter: float = 0.0
    contact_time: float = 0.0
    contact: str = CONTACTS[0]
    terminal_speed: float = math.inf

    def __post_init__(self) -> None:
        _check_values(self, "variation")

    @property
    def integrated(self) -> bool:
        """Whether paths of balls are integrated: contacts last, e scatters, or air drags."""
        return bool(self.scatter or self.contact_time or self.terminal_speed < math.inf)


MOST_REPEATS: Final = 1000


@dataclass(frozen=True, init=False)
class Experiment:
    """A scene that is recorded several times.

    Parameters
    ----------
    scene
        Scene of another experiment, instead of keywords.
    repeats
        Number of recordings.
    camera, variation
        Camera, and imperfections of particles and base.
    seed
        Seed of the random numbers.
    **keywords
        Scene, as in `vibrosweep.simulate`: parameters, `particles`, `launch` or `launch_time`,
        `base`, `rebound`.  The recording begins at `transient` and ends at `duration`, in s, or at
        `transient_periods` and `duration_periods` in forcing periods.  By default five particles
        with the parameters of a shaker at 20 Hz are recorded from 20 s to 60 s.

    Raises
    ------
    SpecError
        A keyword is unknown, or the scene is invalid; the message lists all mistakes.
    ParameterError
        An imperfection is not supported over this base.

    Examples
    --------
    >>> from vibrosweep.lab import Experiment
    >>> Experiment(particles=2, transient=5.0, duration=10.0).window
    (5.0, 10.0)
    """

    scene: Scene  # the window of its measures is the recording
    repeats: int
    camera: Camera
    variation: Variation
    seed: int

    def __init__(
        self,
        scene: Scene | None = None,
        *,
        repeats: int = 4,
        camera: Camera | None = None,
        variation: Variation | None = None,
        seed: int = 0,
        **keywords: Any,
    ) -> None:
        if scene is None:
            scene, varied = batch(with_defaults(keywords), *WINDOW)
            if varied:
                raise ParameterError(f"{next(iter(varied))}: an experiment takes one number")
        elif keywords or not isinstance(scene, Scene):
            raise ParameterError(
                "scene: must be the scene of an experiment, without other keywords; give "
                "parameters as keywords, as in Experiment(amplitude=0.06, particles=2)"
            )
        require_number("repeats", repeats, 1, MOST_REPEATS, whole=True)
        require_number("seed", seed, 0, whole=True)
        for name, part, kind in (("camera", camera, Camera), ("variation", variation, Variation)):
            if not isinstance(part, kind | None):
                raise ParameterError(f"{name} = {part!r}: must be a {kind.__name__}")
        values = scene, repeats, camera or Camera(), variation or Variation(), seed
        for field, value in zip(fields(self), values, strict=True):
            object.__setattr__(self, field.name, value)
        noise, law, shape = scene.noise(), scene.restitution_law, scene.waveform.name
        wrong = refusal(
            scene.base, analysis="laboratory", restitution=law, waveform=shape, noise=noise
        )
        if wrong:
            raise ParameterError(f"an experiment {wrong}")
        for name in ANALYSES.keys() & vars(self.variation).keys():
            wrong = refusal(scene.base, analysis=name)
            if wrong and getattr(self.variation, name):
                raise ParameterError(f"variation.{name}: {wrong}")
        if self.variation.integrated and scene.base != MOVING:
            raise ParameterError(
                f"variation: scatter, contact_time and terminal_speed need base = "
                f'"{MOVING}", but the base is "{scene.base}"'
            )
        if implied(law) and self.variation.restitution_spread:
            raise ParameterError(
                "variation.restitution_spread: all particles share the points of the law; "
                "leave it out, or take another restitution_law"
            )

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters of the scene, in SI units."""
        return {name: float(values[0]) for name, values in self.scene.parameters({}).items()}

    @property
    def window(self) -> tuple[float, float]:
        """Times in s at which the recording begins and ends."""
        times = self.scene.timed({})
        return float(times["transient"][0]), float(times["duration"][0])

    @property
    def recorded(self) -> Scene:
        """Scene that records all landings, from the launch to the end of the recording."""
        return replace(self.scene.recorded(), duration=self.window[1])


def with_defaults(keywords: Mapping[str, Any]) -> dict[str, Any]:
    """Complete the keywords of a scene with the defaults of the laboratory."""
    alternatives: dict[str, Collection[str]] = {
        "amplitude": FORCINGS,
        "transient": ("transient_periods",),
        "duration": ("duration_periods",),
        "restitution": ("restitution_points",),
        "particles": () if isinstance(keywords.get("launch"), str) else ("launch", "launch_time"),
    }
    defaults = {
        name: value
        for name, value in DEFAULTS.items()
        if keywords.keys().isdisjoint(alternatives.get(name, ()))
    }
    return {**defaults, **keywords}


# -----------------------------------------------------------------------------
# Read virtual experiments from TOML files.

MOST_PARTICLES: Final = 1000


class ExperimentSpec(NamedTuple):
    """Content of a valid file: its title, and an experiment for each number of particles."""

    title: str
    experiments: tuple[Experiment, ...]


def read_experiments(path: str | os.PathLike[str]) -> ExperimentSpec:
    """Read and validate the file of a virtual experiment; a SpecError lists all mistakes."""
    source = Path(path)
    mistakes = Mistakes(str(source))
    text = read_text(source)
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise SpecError(f"{source}: is not valid TOML: {error}") from error
    title, tables = read_tables(data, mistakes, _SECTIONS)
    refuse(mistakes)
    given = with_defaults({**data.get("scene", {}), **data.get("measure", {})})
    measure = {name: given.pop(name) for name in WINDOW if name in given}
    default = given.pop("particles", None)
    numbers = tables.get("scene", {}).get("particles", (default,))
    experiments = []
    for number in numbers:
        scene = {"particles": number, **given} if number else given
        described = {"title": str(source), "scene": scene, "measure": measure}
        sweep = checked(described, text, source, mistakes)
        try:
            experiments.append(
                Experiment(
                    sweep.scene,
                    camera=Camera(**tables.get("camera", {})),
                    variation=Variation(**tables.get("variation", {})),
                    **tables.get("trials", {}),
                )
            )
        except ParameterError as error:
            raise SpecError(f"{source}: {error}") from error
    return ExperimentSpec(title or "", tuple(experiments))


def _check_values(described: Camera | Variation, table: str) -> None:
    """Raise a ParameterError for the first value that is not allowed in this table of a file."""
    for name, check in _SECTIONS[table].items():
        value = getattr(described, name)
        try:
            check(value.item() if isinstance(value, np.generic) else value)
        except ValueError as error:
            raise ParameterError(f"{name} = {value!r}: ", *error.args) from None


def _number(low: float, high: float, units: str, above: bool = False) -> Check:
    def check(value: object) -> float:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if number and (low < value if above else low <= value) and value <= high:  # type: ignore[operator]
            return float(value)  # type: ignore[arg-type]
        least = f"above {low:g}" if above else f"at least {low:g}"
        raise ValueError(f"must be a number {least} and at most {high:g}{units and ' ' + units}")

    return check


def _contact_time(value: object) -> float:
    number = _number(0.0, 0.1, "s")(value)
    if 0.0 < number < SHORTEST_CONTACT:
        raise ValueError(f"must be 0, or at least {SHORTEST_CONTACT:g} s and at most 0.1 s")
    return float(number)


_COUNT: Final = whole_number(1, MOST_PARTICLES)


def _particles(value: object) -> tuple[int, ...]:
    if not isinstance(value, list):
        return (_COUNT(value),)
    if value and len(set(map(str, value))) == len(value):
        return tuple(map(_COUNT, value))
    raise ValueError("must be a whole number or a list of different ones")


_SECTIONS: Final[Sections] = {
    "scene": {**SECTIONS["scene"], "particles": _particles},
    "measure": {name: SECTIONS["measure"][name] for name in WINDOW},
    "camera": {
        "frame_rate": _number(0.0, 1e6, "Hz", above=True),
        "pixel": _number(0.0, 1.0, "m", above=True),
        "noise": _number(0.0, 100.0, "pixels"),
        "whole_pixels": flag,
        "exposure": _number(0.0, 1.0, "s"),
        "dropped": _number(0.0, 0.9, ""),
        "scale_error": _number(-0.5, 0.5, ""),
        "rounding": _number(0.0, 1.0, "s"),
    },
    "variation": {
        name: _number(0.0, high, units)
        for name, high, units in (
            ("frequency_jitter", 0.1, ""),
            ("frequency_setting", 0.2, ""),
            ("amplitude_setting", 0.2, ""),
            ("restitution_spread", 0.2, ""),
            ("level_spread", 1.0, "m"),
            ("scatter", 0.1, ""),
        )
    }
    | {
        "contact_time": _contact_time,
        "contact": partial(one_of, CONTACTS),
        "terminal_speed": _number(1.0, math.inf, "m/s"),
    },
    "trials": {
        "repeats": whole_number(1, MOST_REPEATS),
        "seed": whole_number(0, MAX_SEED),
    },
}
