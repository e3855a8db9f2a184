"""What an analysis that asks the engine again keeps fixed: parameters, launches, observation."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from vibrosweep.abilities import refusal
from vibrosweep.arrays import Array
from vibrosweep.engine.observation import Observation
from vibrosweep.errors import ParameterError
from vibrosweep.mistakes import Key
from vibrosweep.model.forcing import (
    FORCINGS,
    INPUTS,
    completed,
    differing,
    forcing_of,
    only_parameters,
    refuse_large,
)
from vibrosweep.model.measures import Measures
from vibrosweep.model.mount import OF_MOUNT
from vibrosweep.model.parameters import (
    HIGH_BOUNCE,
    LAWS,
    PARAMETERS,
    STAGGERED,
    refuse_masked,
)
from vibrosweep.model.times import Periods, Time, amount, in_seconds, one_time, precedes, unit_of
from vibrosweep.runs.notes import short_observation
from vibrosweep.runs.result import TIMES, coordinate_attributes, periods_given
from vibrosweep.spec.rules import Axis
from vibrosweep.system import physical_memory
from vibrosweep.theory import FIXED

if TYPE_CHECKING:
    from vibrosweep.spec.sweep import SweepSpec

__all__ = ["Scene", "axis", "grid_axes", "require_memory"]


DURATION: Final = 2000.0  # s, by default
# Of the forcings, what a result holds in any case
KEPT: Final = ("amplitude", "base_acceleration")


@dataclass(frozen=True)
class Scene:
    """Physical parameters, launches and observation that all points of an analysis share.

    What an analysis varies, such as the amplitude of a bifurcation diagram, overrides the value
    given here.

    Attributes
    ----------
    restitution, frequency, phase, gravity, launch_velocity, contact_time
        Physical parameters (1, Hz, rad, m s-2, m s-1, s).
    amplitude, base_velocity, base_displacement, base_acceleration
        The forcing, in one of four ways (m s-1, m s-1, m, 1); without any the amplitude of Table 1.
    particles
        Number of particles.
    launch
        ``"staggered"`` evenly over one forcing period, or the launch times of all particles in s.
    duration, duration_periods
        End of the observation in s, 2000 by default, or in forcing periods: orbits that have not
        recurred by then are unsettled or aperiodic.
    transient, transient_periods
        Time before the window that measures cover, in s, 0 by default, or in forcing periods.
    base
        ``"high-bounce"`` or ``"moving"``.
    rebound
        ``"rest"`` or ``"reflect"``; only the former with a moving base.
    impact_budget
        Impacts after which a particle is given up.

    Raises
    ------
    ParameterError
        A value is of the wrong kind or outside its range, or two contradict each other.

    Examples
    --------
    >>> from vibrosweep.analysis import Scene
    >>> scene = Scene(base="moving", base_acceleration=0.9, restitution=0.7, particles=20)
    >>> scene.launch, scene.contact_time
    ('staggered', 0.0001)
    """

    restitution: float = PARAMETERS["restitution"].default
    amplitude: float | None = None
    base_velocity: float | None = None
    base_displacement: float | None = None
    base_acceleration: float | None = None
    frequency: float = PARAMETERS["frequency"].default
    phase: float = PARAMETERS["phase"].default
    gravity: float = PARAMETERS["gravity"].default
    launch_velocity: float = PARAMETERS["launch_velocity"].default
    contact_time: float = PARAMETERS["contact_time"].default
    particles: int = 1
    launch: str | tuple[float, ...] = STAGGERED
    duration: float | None = None
    duration_periods: float | None = None
    transient: float | None = None
    transient_periods: float | None = None
    base: str = HIGH_BOUNCE
    rebound: str = LAWS[0]
    impact_budget: int = Measures.impact_budget

    def __post_init__(self) -> None:
        own = self._own()
        for name, value in own.items():
            axis(name, value)
        refuse_large(self.quantities(), forcing_of(own))
        self._require(self.particles >= 1, "particles", "at least 1")
        self._require(self.impact_budget >= 1, "impact_budget", "at least 1")
        self._require(self.base in FIXED, "base", f"one of {', '.join(FIXED)}")
        self._require(self.rebound in LAWS, "rebound", f"one of {', '.join(LAWS)}")
        self._judge_window()
        if isinstance(self.launch, str):
            self._require(self.launch == STAGGERED, "launch", f'"{STAGGERED}" or launch times in s')
        else:
            fits = len(self.launch) == self.particles and all(map(math.isfinite, self.launch))
            self._require(fits, "launch", f"{self.particles} finite launch times in s")
        self.observation()  # judges base and rebound together

    def _judge_window(self) -> None:
        begin, end = self._stated("transient"), self._stated("duration")
        positive = 0.0 < amount(self.end) < math.inf
        self._require(positive, end, f"finite and greater than 0 {unit_of(self.end)}")
        inside = precedes(self.begin, self.end, np.array([self.frequency]))
        allowed = f"at least 0 {unit_of(self.begin)} and below {end} = {amount(self.end)}"
        self._require(amount(self.begin) >= 0.0 and inside, begin, allowed)

    def _require(self, condition: bool, name: str, allowed: str) -> None:
        if not condition:
            raise ParameterError(f"{name} = {getattr(self, name)!r}: must be {allowed}")

    def _stated(self, name: str) -> str:
        """Name of a time as it is given: in s or in periods."""
        periods = f"{name}_periods"
        return name if getattr(self, periods) is None else periods

    @classmethod
    def of(cls, spec: SweepSpec) -> Scene:
        """Scene of a sweep file; a sampled parameter is at its default."""
        given = {
            "impact_budget": spec.measures.impact_budget,
            **{name: getattr(spec, name) for name in ("particles", "launch", "base", "rebound")},
            **spec.fixed,
        }
        for name, time in (("duration", spec.duration), ("transient", spec.measures.transient)):
            given[f"{name}_periods" if isinstance(time, Periods) else name] = amount(time)
        return cls(**given)

    @property
    def end(self) -> Time:
        """End of the observation."""
        return one_time("duration", self.duration, self.duration_periods, DURATION)

    @property
    def begin(self) -> Time:
        """Beginning of the window that measures cover."""
        return one_time("transient", self.transient, self.transient_periods, 0.0)

    def _own(self) -> dict[str, float]:
        """What is given of `INPUTS`, defaults included."""
        given = {name: getattr(self, name) for name in INPUTS if name not in OF_MOUNT}
        given = {name: value for name, value in given.items() if value is not None}
        return {forcing_of(given): PARAMETERS["amplitude"].default, **given}

    def quantities(self, **varied: Array) -> dict[str, Array]:
        """Return `parameters`, the forcing that is given, and the acceleration of the base."""
        size = max((values.size for values in varied.values()), default=1)
        own: dict[str, ArrayLike] = {**self._own()}
        if not FORCINGS.keys().isdisjoint(varied):
            del own[forcing_of(own)]
        return completed(
            {
                name: np.ascontiguousarray(np.broadcast_to(value, (size,)), np.float64)
                for name, value in {**own, **varied}.items()
            }
        )

    def parameters(self, **varied: Array) -> dict[str, Array]:
        """Every parameter of a batch of realizations, each of shape (realization,)."""
        return only_parameters(self.quantities(**varied))

    def observation(self, **measured: bool) -> Observation:
        """Return the observation of this scene's particles, with the measures that are named."""
        measures = Measures(self.begin, impact_budget=self.impact_budget)
        plain = Observation(
            self.particles, self.launch, self.end, self.rebound, measures, base=self.base
        )
        return plain.measuring(**measured)

    def short_observation(self, restitution: float | None = None) -> str:
        """Say where orbits of up to that restitution may not be recognised in time; else empty."""
        highest = self.restitution if restitution is None else restitution
        return short_observation(self.base, highest, self.frequency, self.end)

    def attributes(self, title: str) -> dict[str, Any]:
        """Attributes of a dataset, without those parameters that it holds as coordinates."""
        launch = self.launch if isinstance(self.launch, str) else np.asarray(self.launch)
        return {
            "title": title,
            "particles": self.particles,
            "launch": launch,
            "base": self.base,
            "rebound": self.rebound,
            "forcing": forcing_of(self._own()),
            "impact_budget": self.impact_budget,
            **periods_given(self.end, self.begin),
        }

    def shared(self, varied: Collection[str]) -> dict[str, Any]:
        """Variables without dimensions: times, and what is not varied nor follows from that."""
        found = self.quantities()
        given = forcing_of([name for name in varied if name in FORCINGS] or self._own())
        differ = {*differing(varied, given), *(FORCINGS.keys() - {*KEPT, given})}
        fixed: dict[str, Any] = {
            name: ((), values[0], coordinate_attributes(INPUTS[name]))
            for name, values in found.items()
            if name not in differ
        }
        for (name, attributes), time in zip(TIMES.items(), (self.end, self.begin), strict=True):
            fixed[name] = ((), in_seconds(time, found["frequency"])[0], attributes)
        return fixed


def require_ability(analysis: str, base: str) -> None:
    """Refuse a base over which an analysis cannot be had."""
    wrong = refusal(base, analysis=analysis)
    if wrong:
        raise ParameterError(f"{analysis}: {wrong}")


def axis(name: str, values: ArrayLike) -> Array:
    """Values of a physical parameter as a 1-D array; a ParameterError unless all are in range."""
    parameter = INPUTS[name]
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

    Raises a SpecError that names the purpose unless the design is a grid with the axis that is
    needed, and no others than those allowed.
    """
    axes = {n: np.sort(s.values) for n, s in spec.sampled.items() if isinstance(s, Axis)}
    other = [name for name in axes if name not in (needed, *allowed)]
    if spec.design != "grid" or needed not in axes or other:
        wrong = Key(f"sample.{other[0]}" if other else "sample.design")
        value = "" if other else f' = "{spec.design}"'
        also = f" and, if need be, of {' or '.join(allowed)}" if allowed else " and no other"
        grid = 'design = "grid" with an axis of' if spec.source else "a list of values for"
        raise spec.refusal((wrong, f"{value}: {purpose} need {grid} {needed}{also}"))
    return axes


def require_memory(what: str, count: int, bytes_each: int) -> None:
    """Refuse, with a ParameterError, what has too many points to fit into this machine's memory."""
    available = physical_memory()
    if count * bytes_each > available:
        raise ParameterError(
            f"{count} {what} need {count * bytes_each / 2**30:.3g} GiB of memory, but this machine "
            f"has {available / 2**30:.3g} GiB: take fewer of them"
        )
