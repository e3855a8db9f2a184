"""Virtual experiments: particles, a base and a camera, all with imperfections."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, Final

from vibrosweep.abilities import ANALYSES, refusal
from vibrosweep.errors import ParameterError
from vibrosweep.lab.camera import Camera
from vibrosweep.model.forcing import FORCINGS
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import batch

__all__ = ["LABORATORY", "Experiment", "Variation"]


# Table 1 at 20 Hz, with the same dimensionless kick, 2 f A / g = 0.2446, and the same first flight
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
# Keys that say when a recording begins, in the table [measure] of a file
WINDOW: Final = ("transient", "transient_periods")


@dataclass(frozen=True)
class Variation:
    """Imperfections of particles and base.

    Attributes
    ----------
    frequency_jitter
        Standard deviation of the length of each forcing period, relative to its mean.
    frequency_setting
        Standard deviation of the mean frequency from repeat to repeat, relative.
    amplitude_setting
        Standard deviation of the amplitude from repeat to repeat, relative.
    restitution_spread
        Standard deviation of the restitution among the particles, which are the same in all
        repeats.
    level_spread
        Standard deviation, among the particles, of the height (m) of the base below them, as caused
        by a tilted base or view.

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
        The camera, and the imperfections of particles and base.
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
        A keyword is unknown, or the scene is impossible; the message lists all mistakes.
    ParameterError
        An imperfection cannot be computed over this base.

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
                "scene: must be the scene of an experiment, without keywords beside it; give "
                "parameters as keywords, as in Experiment(amplitude=0.06, particles=2)"
            )
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
        """Scene whose landings are all kept, from the launch to the end of the recording."""
        return replace(self.scene.recorded(), duration=self.window[1])


def with_defaults(keywords: Mapping[str, Any]) -> dict[str, Any]:
    """Complete the keywords of a scene with the defaults of the laboratory."""
    alternatives: dict[str, Collection[str]] = {
        "amplitude": FORCINGS,
        "transient": ("transient_periods",),
        "duration": ("duration_periods",),
        "particles": () if isinstance(keywords.get("launch"), str) else ("launch", "launch_time"),
    }
    defaults = {
        name: value
        for name, value in DEFAULTS.items()
        if keywords.keys().isdisjoint(alternatives.get(name, ()))
    }
    return {**defaults, **keywords}
