"""One realization: what is stored of it, what is proved of it, what the kernel finds again."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from vibrosweep.reference.ball import Trajectory
from vibrosweep.verify.bounds import Errors
from vibrosweep.verify.claims import Bounds, claims
from vibrosweep.verify.cycle import largest_exponent
from vibrosweep.verify.growth import mean_growth
from vibrosweep.verify.measures import Measures, Proved, measures
from vibrosweep.verify.orbits import SAID, Cycle, Orbit, State, numbered
from vibrosweep.verify.sample import Scene

__all__ = ["Case", "Exponents"]


@dataclass(frozen=True)
class Exponents:
    """Proved Lyapunov exponents of a particle.

    Attributes
    ----------
    largest, total
        Largest, and sum of both.
    claim, total_claim
        Largest errors that the dataset admits; None where nothing is proved or claimed.
    standard_error
        Of a mean along the orbit, within `claim`; None where undefined.
    bounds_rounding
        Whether the error of the largest is a bound of its rounding, as it is of a cycle.
    """

    largest: Proved
    claim: float | None
    total: Proved
    total_claim: float | None
    standard_error: Proved = None
    bounds_rounding: bool = False


@dataclass(frozen=True)
class Case:
    """One realization to be judged.

    Attributes
    ----------
    stored
        Its variables: numbers, or arrays over the particles.
    again
        Bounds that the kernel finds for it now, named as variables; empty of another version.
    scene
        What was computed.
    bounds
        Bounds of the errors of its landings.
    trajectories
        Proved; empty where there is no proof.
    errors
        Proved errors of the kernel's landings of each particle, where the file bounds them.
    tolerance
        Error of a landing time in s up to which it is trusted.
    """

    stored: Mapping[str, Any]
    again: Mapping[str, Any]
    scene: Scene
    bounds: Bounds
    trajectories: Sequence[Trajectory]
    errors: Sequence[Errors]
    tolerance: float

    @cached_property
    def measures(self) -> Measures:
        """Proved measures."""
        return measures(self.scene, self.trajectories)

    @cached_property
    def claims(self) -> Mapping[str, float | None]:
        """Largest errors of the measures that the dataset admits."""
        return claims(self.bounds, self.scene, self.measures)

    @cached_property
    def orbits(self) -> Sequence[Orbit]:
        """Proved states of each particle."""
        return [
            Orbit(self.scene, self.bounds, trajectory, particle)
            for particle, trajectory in enumerate(self.trajectories)
        ]

    @cached_property
    def cycles(self) -> Sequence[Cycle | None]:
        """Cycle of each particle whose regime is said to recur; None of one that does not."""
        return self._recurring(("regime", "cycle_impacts", "cycle_periods", "recurrent_from"))

    @cached_property
    def attractors(self) -> Sequence[Cycle | None]:
        """Cycle of each particle that is said to be on a numbered orbit."""
        return self._recurring(("orbit", "slot"))

    def _recurring(self, variables: Sequence[str]) -> list[Cycle | None]:
        """Cycles of the particles that recur by most of some variables, if these disagree."""
        found: list[Cycle | None] = []
        for particle, orbit in enumerate(self.orbits):
            said = [SAID[name](self.stored[name][particle]) for name in variables]
            cycle = None
            if 2 * sum(said) >= len(said):
                time, impacts = math.nan, 0
                if "recurrent_from" in self.stored:
                    impacts = max(0, int(self.stored["cycle_impacts"][particle]))
                if "recurrent_from" in variables:
                    time = float(self.stored["recurrent_from"][particle])
                cycle = orbit.recurrence(time, impacts)
            found.append(cycle)
        return found

    @cached_property
    def _states(self) -> Sequence[State | None]:
        pairs = zip(self.orbits, self.attractors, strict=True)
        return [None if cycle is None else orbit.representative(cycle) for orbit, cycle in pairs]

    @cached_property
    def orbit_numbers(self) -> Sequence[int] | None:
        """Number of the orbit of each particle; None where it is too close to tell."""
        pairs = zip(self.attractors, self._states, strict=True)
        return numbered([None if cycle is None else (cycle, state) for cycle, state in pairs])

    @cached_property
    def slots(self) -> Sequence[int | None]:
        """Slot of each particle, -1 without a cycle; None where it is too close to tell."""
        return [
            -1 if cycle is None else None if state is None else state.whole % cycle.periods
            for cycle, state in zip(self.attractors, self._states, strict=True)
        ]

    @cached_property
    def exponents(self) -> Sequence[Exponents]:
        """Exponents of each particle."""
        return [self._exponents(particle) for particle in range(len(self.orbits))]

    def _exponents(self, particle: int) -> Exponents:
        orbit, cycle = self.orbits[particle], self.attractors[particle]
        impacts = orbit.trajectory.impacts
        first = 0
        if self.scene.windowed:
            first = sum(1 for i in impacts if i.landing_time < self.scene.transient)
        unclaimed = self.claims["impact_count"] is None and cycle is None
        if orbit.trajectory.at_rest or (cycle is not None and cycle.rests):
            return Exponents(-math.inf, 0.0, -math.inf, 0.0, 0.0)
        if cycle is None and any(i.rested for i in impacts[first:]):
            claim = None if unclaimed else 0.0
            return Exponents(-math.inf, claim, -math.inf, claim, 0.0)
        rounding = self._stated("lyapunov_sum_error", particle)
        restitution = self.scene.parameters["restitution"]
        total: Proved = -math.inf
        if restitution > 0.0:
            total = orbit.logarithm(restitution)
        if cycle is not None:
            found = largest_exponent(
                self.scene.parameters,
                self.scene.rebound,
                orbit.last_state(),
                cycle.impacts,
                cycle.periods,
            )
            stated = self._stated("lyapunov_largest_error", particle)
            claim = None if found is None else stated
            return Exponents(found, claim, total, rounding, bounds_rounding=True)
        if unclaimed:
            return Exponents(None, None, None, None)
        if first == len(impacts):
            return Exponents(None, 0.0, None, 0.0)
        mean = mean_growth(
            self.scene, self.bounds, impacts[first:], orbit.flights[first : len(impacts)]
        )
        return Exponents(mean.value, mean.claim, total, rounding, mean.standard_error)

    def _stated(self, name: str, particle: int) -> float | None:
        """Return an error that the dataset states; None where it states none."""
        error = float(self.stored[name][particle])
        return error if math.isfinite(error) else None
