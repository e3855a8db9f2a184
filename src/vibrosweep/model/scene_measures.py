"""The measures of a scene, with their window and the observables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Final

from vibrosweep.model.measures import ALWAYS, MEASURES, TRANSIENT_PERIODS, Variable
from vibrosweep.model.observables import Observable
from vibrosweep.model.parameters import SPRUNG
from vibrosweep.model.restitution_laws import VISCOELASTIC
from vibrosweep.model.times import Time


@dataclass(frozen=True)
class Measures:
    """Values of the keys of [measure], and the observables of Python, which have no key.

    The keys are those of `MEASURES` and `OPTIONS` of `vibrosweep.model.measures`.  A measure
    switches on the measures that it requires.
    """

    transient: Time = 0.0
    separation: bool = False
    per_particle: bool = False
    regimes: bool = False
    lyapunov: bool = False
    trust: bool = False
    ordering: bool = False
    undecided: bool = False
    joint: bool = False
    impact_speed: bool = False
    tolerance: float = 1e-9
    impact_budget: int = 10_000_000
    observables: tuple[Observable, ...] = ()

    def __post_init__(self) -> None:
        taken = [measure for key, measure in MEASURES.items() if getattr(self, key)]
        for required in {key for measure in taken for key in measure.requires}:
            object.__setattr__(self, required, True)

    def over(self, base: str, restitution_law: str) -> Measures:
        """Return these measures and those that are always taken with this base or this law."""
        limited = restitution_law == VISCOELASTIC
        return replace(
            self,
            ordering=self.ordering or base == SPRUNG,
            undecided=self.undecided or base == SPRUNG,
            impact_speed=self.impact_speed or limited,
        )

    @property
    def variables(self) -> tuple[Variable, ...]:
        """Variables of a result, in their order."""
        taken = (measure for key, measure in MEASURES.items() if getattr(self, key))
        return (
            *ALWAYS,
            *(variable for measure in taken for variable in measure.variables),
            *(observable.variable for observable in self.observables),
        )

    @property
    def observable_names(self) -> set[str]:
        """Names of the variables and dimensions of observables."""
        return {o.name for o in self.observables}.union(self.observable_dims)

    @property
    def observable_dims(self) -> dict[str, tuple[float, ...]]:
        """Dimensions of observables, with their coordinates."""
        return {o.along: o.values for o in self.observables if o.along}


# The keys of [measure] with their defaults; None for an alternative to another key
KEYS: Final[Mapping[str, bool | float | None]] = {
    "transient": 0.0,
    TRANSIENT_PERIODS: None,
    **{f.name: getattr(Measures(), f.name) for f in fields(Measures) if f.name != "observables"},
}
