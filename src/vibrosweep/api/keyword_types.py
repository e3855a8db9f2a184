"""Types of the keywords of public functions, so that editors complete and check them.

The keywords are the keys of a sweep file.  Values are checked when the function is called.
"""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypedDict, TypeVar

from numpy.typing import ArrayLike

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from vibrosweep.analysis.conditions import Condition

__all__ = ["BatchKeywords", "RealizationKeywords", "SweepKeywords", "WindowKeywords"]

F = TypeVar("F", bound=Callable[..., Any])

# A number; a tuple as a range; a list, an array, or start, stop and num as an axis
Values = ArrayLike | Mapping[str, float] | None
# The names that the package defines; others can be registered
Base = Literal["high-bounce", "moving", "sprung"] | str | None
Law = Literal["rest", "reflect"] | str | None
Waveform = Literal["sine", "parabolic"] | Mapping[str, Any] | None
RestitutionLaw = Literal["constant", "plastic", "viscoelastic", "power", "points"] | str | None
Launch = Literal["staggered"] | Sequence[float] | ArrayLike | None
Design = Literal["uniform", "latin", "sobol", "grid"] | str


class MotionKeywords(TypedDict, total=False):
    """Keywords of a scene: particles, base, and times."""

    restitution: Values
    amplitude: Values
    base_velocity: Values
    base_displacement: Values
    base_acceleration: Values
    frequency: Values
    phase: Values
    gravity: Values
    launch_velocity: Values
    contact_time: Values
    restitution_speed: Values
    mass_ratio: Values
    particle_mass: Values
    base_mass: Values
    mount_frequency: Values
    mount_damping: Values
    particles: int | None
    launch: Launch
    duration: float | None
    duration_periods: float | None
    base: Base
    rebound: Law
    waveform: Waveform
    restitution_noise: Values
    restitution_noise_relative: Values
    kick_noise: Values
    drive_noise: Values
    noise_seed: int | None
    restitution_law: RestitutionLaw
    restitution_exponent: float | None
    restitution_points: ArrayLike | str | os.PathLike[str] | None


class MeasureKeywords(TypedDict, total=False):
    """Measures, and the beginning of their window."""

    transient: float | None
    transient_periods: float | None
    separation: bool | None
    per_particle: bool | None
    regimes: bool | None
    lyapunov: bool | None
    trust: bool | None
    ordering: bool | None
    undecided: bool | None
    joint: bool | None
    impact_speed: bool | None
    tolerance: float | None
    impact_budget: int | None


class BatchKeywords(MotionKeywords, MeasureKeywords, total=False):
    """A scene, its launches, and its measures."""

    launch_time: ArrayLike | None
    noise_stream: ArrayLike | None


class RealizationKeywords(MotionKeywords, MeasureKeywords, total=False):
    """A scene, its realizations, and their measures."""

    title: str | None
    design: Design | os.PathLike[str] | Mapping[str, ArrayLike] | xr.Dataset | pd.DataFrame | None
    realizations: int | None
    seed: int | None
    columns: Sequence[str] | None


class SweepKeywords(RealizationKeywords, total=False):
    """Keywords of realizations, or whole tables of a sweep file."""

    scene: Mapping[str, Any] | None
    sample: Mapping[str, Any] | None
    measure: Mapping[str, Any] | None
    record: Mapping[str, Any] | None
    windows: Mapping[str, Any] | None


class WindowKeywords(SweepKeywords, total=False):
    """A sweep, and the conditions of windows."""

    conditions: Sequence[str | Condition] | None
    continuation: bool | None
    prove: bool | None
    noise_replicas: int | None


def completed(by: type[Any]) -> Callable[[F], F]:
    """Give a function a signature that names each keyword of the type `by`.

    Notebooks complete the names of a signature; type checkers read the annotation of the keywords.
    """

    def with_signature(function: F) -> F:
        plain = inspect.signature(function)
        named = [p for p in plain.parameters.values() if p.kind is not p.VAR_KEYWORD]
        keywords = [
            inspect.Parameter(
                name,
                inspect.Parameter.KEYWORD_ONLY,
                default=None,
                annotation=getattr(hint, "__forward_arg__", hint),
            )
            for name, hint in by.__annotations__.items()
        ]
        function.__signature__ = plain.replace(parameters=[*named, *keywords])  # type: ignore[attr-defined]
        return function

    return with_signature
