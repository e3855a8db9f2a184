"""What an analysis that asks the engine again keeps fixed: parameters, launches, observation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibrosweep.engine.landings import physical_memory
from vibrosweep.engine.observation import Observation
from vibrosweep.errors import ParameterError, SpecError
from vibrosweep.model.measures import Measures
from vibrosweep.model.parameters import LAWS, PARAMETERS, STAGGERED, refuse_masked
from vibrosweep.runs.driver import available_threads
from vibrosweep.runs.result import DURATION, TRANSIENT, coordinate_attributes
from vibrosweep.spec.rules import Axis

if TYPE_CHECKING:
    from vibrosweep.spec.sweep import SweepSpec

__all__ = ["Scene", "axis", "grid_axes", "require_memory", "thread_count"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scene:
    """Physical parameters, launches and observation that all points of an analysis share.

    What an analysis varies, such as the amplitude of a bifurcation diagram, overrides the value
    given here.

    Attributes
    ----------
    restitution, amplitude, frequency, phase, gravity, launch_velocity, contact_time
        Physical parameters (1, m s-1, Hz, rad, m s-2, m s-1, s).
    particles
        Number of particles.
    launch
        ``"staggered"`` evenly over one forcing period, or the launch times of all particles in s.
    duration
        End of the observation in s: orbits that have not recurred by then are unsettled or
        aperiodic.
    transient
        Time in s before the window that measures cover.
    rebound
        ``"rest"`` or ``"reflect"``.
    impact_budget
        Impacts after which a particle is given up.

    Raises
    ------
    ParameterError
        A value is of the wrong kind or outside its range.
    """

    restitution: float = PARAMETERS["restitution"].default
    amplitude: float = PARAMETERS["amplitude"].default
    frequency: float = PARAMETERS["frequency"].default
    phase: float = PARAMETERS["phase"].default
    gravity: float = PARAMETERS["gravity"].default
    launch_velocity: float = PARAMETERS["launch_velocity"].default
    contact_time: float = PARAMETERS["contact_time"].default
    particles: int = 1
    launch: str | tuple[float, ...] = STAGGERED
    duration: float = 2000.0
    transient: float = Measures.transient
    rebound: str = LAWS[0]
    impact_budget: int = Measures.impact_budget

    def __post_init__(self) -> None:
        for name in PARAMETERS:
            axis(name, getattr(self, name))
        self._require(self.particles >= 1, "particles", "at least 1")
        self._require(self.impact_budget >= 1, "impact_budget", "at least 1")
        self._require(self.rebound in LAWS, "rebound", f"one of {', '.join(LAWS)}")
        positive = 0.0 < self.duration < math.inf
        self._require(positive, "duration", "finite and greater than 0 s")
        inside = 0.0 <= self.transient < self.duration
        self._require(inside, "transient", f"at least 0 s and below duration = {self.duration}")
        if isinstance(self.launch, str):
            self._require(self.launch == STAGGERED, "launch", f'"{STAGGERED}" or launch times in s')
        else:
            fits = len(self.launch) == self.particles and all(map(math.isfinite, self.launch))
            self._require(fits, "launch", f"{self.particles} finite launch times in s")

    def _require(self, condition: bool, name: str, allowed: str) -> None:
        if not condition:
            raise ParameterError(f"{name} = {getattr(self, name)!r}: must be {allowed}")

    @classmethod
    def of(cls, spec: SweepSpec) -> Scene:
        """Scene of a sweep file; a sampled parameter is at its default."""
        own = {field.name for field in fields(cls)} - PARAMETERS.keys()
        given = {**vars(spec), **vars(spec.measures)}
        values: dict[str, Any] = {name: given[name] for name in own}
        return cls(**{**values, **spec.fixed})

    def parameters(self, **varied: Array) -> dict[str, Array]:
        """Every parameter of a batch of realizations, each of shape (realization,)."""
        size = max((values.size for values in varied.values()), default=1)
        return {
            name: np.ascontiguousarray(
                np.broadcast_to(varied.get(name, getattr(self, name)), (size,)), np.float64
            )
            for name in PARAMETERS
        }

    def observation(self, **measured: bool) -> Observation:
        """Return the observation of this scene's particles, with the measures that are named."""
        measures = Measures(self.transient, impact_budget=self.impact_budget)
        plain = Observation(self.particles, self.launch, self.duration, self.rebound, measures)
        return plain.measuring(**measured)

    def attributes(self, title: str) -> dict[str, Any]:
        """Attributes of a dataset, without those parameters that it holds as coordinates."""
        launch = self.launch if isinstance(self.launch, str) else np.asarray(self.launch)
        return {
            "title": title,
            "particles": self.particles,
            "launch": launch,
            "rebound": self.rebound,
            "impact_budget": self.impact_budget,
        }

    def coordinates(self, varied: Mapping[str, object] | tuple[str, ...]) -> dict[str, Any]:
        """Scalar coordinates: the parameters that are not varied, and the observation's times."""
        fixed: dict[str, Any] = {
            name: ((), getattr(self, name), coordinate_attributes(parameter))
            for name, parameter in PARAMETERS.items()
            if name not in varied
        }
        for name, attributes in (("duration", DURATION), ("transient", TRANSIENT)):
            fixed[name] = ((), getattr(self, name), attributes)
        return fixed


def axis(name: str, values: ArrayLike) -> Array:
    """Values of a physical parameter as a 1-D array, each within its range.

    Raises
    ------
    ParameterError
        They are no numbers, or one is outside its range.
    """
    parameter = PARAMETERS[name]
    refuse_masked(name, values)
    try:
        array = np.atleast_1d(np.asarray(values, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise ParameterError(f"{name} = {values!r}: must be {parameter.allowed}") from error
    bad = array[~parameter.accepts(array)]
    if bad.size or array.ndim != 1 or not array.size:
        shown = float(bad.flat[0]) if bad.size else values
        raise ParameterError(f"{name} = {shown!r}: must be {parameter.allowed}")
    return array


def grid_axes(
    spec: SweepSpec, purpose: str, needed: str, allowed: tuple[str, ...] = ()
) -> dict[str, Array]:
    """Axes of a sweep file's grid, ascending, by the names of parameters.

    Parameters
    ----------
    purpose
        What they are for, as the message names it.
    needed, allowed
        The axis that must be there, and those that may.

    Raises
    ------
    SpecError
        The design is no grid, or has other axes.
    """
    axes = {n: np.sort(s.values) for n, s in spec.sampled.items() if isinstance(s, Axis)}
    other = [name for name in axes if name not in (needed, *allowed)]
    if spec.design != "grid" or needed not in axes or other:
        wrong = f"sample.{other[0]}" if other else f'sample.design = "{spec.design}"'
        also = f" and, if need be, of {' or '.join(allowed)}" if allowed else " and no other"
        raise SpecError(
            f'{spec.source}: {wrong}: {purpose} need design = "grid" with an axis of {needed}{also}'
        )
    return axes


def require_memory(what: str, count: int, bytes_each: int) -> None:
    """Refuse an analysis of so many points that it does not fit into this machine's memory.

    Raises
    ------
    ParameterError
        Naming what there are too many of.
    """
    available = physical_memory()
    if count * bytes_each > available:
        raise ParameterError(
            f"{count} {what} need {count * bytes_each / 2**30:.3g} GiB of memory, but this machine "
            f"has {available / 2**30:.3g} GiB: take fewer of them"
        )


def thread_count(threads: int | None) -> int:
    """Return the number of threads to use, all processors for None."""
    if threads is None:
        return available_threads()
    if threads < 1:
        raise ParameterError(f"threads = {threads!r}: must be at least 1")
    return threads
