"""Measures of a scene, with their window and the observables."""

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
    """Values of the keys of [measure]: `vibrosweep.model.measures` has `MEASURES` and `OPTIONS`.

    Measures that another one requires are taken with it.  Observables, which are functions, have no
    key.
    """

    transient: Time = 0.0
    separation: bool = False
    per_particle: bool = False
    regimes: bool = False
    lyapunov: bool = False
    trust: bool = False
    ordering: bool = False
    joint: bool = False
    impact_speed: bool = False
    tolerance: float = 1e-9
    impact_budget: int = 10_000_000
    observables: tuple[Observable, ...] = ()

    def __post_init__(self) -> None:
        for key in MEASURES:
            if getattr(self, key):
                self._ask(key)

    def _ask(self, key: str) -> None:
        object.__setattr__(self, key, True)
        for other in MEASURES[key].requires:
            self._ask(other)

    def over(self, base: str, restitution_law: str) -> Measures:
        """Return these measures with those that are always taken over this base, by this law."""
        limited = restitution_law == VISCOELASTIC
        return replace(
            self,
            ordering=self.ordering or base == SPRUNG,
            impact_speed=self.impact_speed or limited,
        )

    @property
    def variables(self) -> tuple[Variable, ...]:
        """Variables of a result, in their order."""
        taken = (measure for key, measure in MEASURES.items() if getattr(self, key))
        observed = (one.variable for one in self.observables)
        return (
            *ALWAYS,
            *(variable for measure in taken for variable in measure.variables),
            *observed,
        )

    @property
    def observable_names(self) -> set[str]:
        """Names that observables bring into a result."""
        return {one.name for one in self.observables}.union(self.observable_dims)

    @property
    def observable_dims(self) -> dict[str, tuple[float, ...]]:
        """Dimensions of observables, with their coordinates."""
        return {one.along: one.values for one in self.observables if one.along}


# The keys of [measure] with their defaults; None where another key has one
KEYS: Final[Mapping[str, bool | float | None]] = {
    "transient": 0.0,
    TRANSIENT_PERIODS: None,
    **{
        one.name: getattr(Measures(), one.name)
        for one in fields(Measures)
        if one.name != "observables"
    },
}
