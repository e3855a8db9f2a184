"""One realization to verify: stored, proved and recomputed values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Final, NamedTuple

import numpy as np

from vibrosweep.model.observables import Observable
from vibrosweep.proof.bounds import Errors
from vibrosweep.proof.coupled import Estimate
from vibrosweep.proof.cycle import largest_exponent
from vibrosweep.proof.measures import ProvedMeasures, prove_measures
from vibrosweep.proof.observables import ProvedObservable, prove_observable
from vibrosweep.proof.recurrence import SIGNS, Cycle, Orbit, State, numbered
from vibrosweep.proof.reference._flint import arb, exact
from vibrosweep.proof.reference.results import Impact, Trajectory
from vibrosweep.proof.sample import Realization
from vibrosweep.proof.statistics import Proved
from vibrosweep.proof.tolerances import Bounds

# An aperiodic orbit has at least this many landings in the window, and an exponent that exceeds
# zero by this many standard errors.
LANDINGS: Final = 64
CERTAIN: Final = 3.0


class Exponent(NamedTuple):
    """Proved Lyapunov exponent of a particle."""

    value: Proved
    claim: float | None  # largest error that the dataset allows; None where none is known
    # Error that must be stored with it, to within the claim: the standard error of a mean along the
    # orbit, 0 if the exponent is minus infinity; None where undefined
    error: Proved = None
    bounded: bool = False  # True if the stored error is a bound on the rounding error instead


@dataclass(frozen=True)
class Case:
    """One realization to be judged."""

    stored: Mapping[str, Any]  # its variables: numbers, or arrays over the particles
    # Bounds and other variables as this version computes them; empty if another version computed
    # the file
    again: Mapping[str, Any]
    realization: Realization
    bounds: Bounds  # bounds on the errors of its landings
    trajectories: Sequence[Trajectory]  # proved; empty where there is no proof
    # Proved errors of the kernel's landings of each particle, where the file bounds them
    errors: Sequence[Errors]
    tolerance: float  # error of a landing time in s up to which it is trusted
    # Estimate of the errors of its landings, if its particles are coupled and it is proved
    estimate: Estimate | None = None

    @cached_property
    def measures(self) -> ProvedMeasures:
        """Proved measures."""
        return prove_measures(self.realization, self.trajectories)

    @cached_property
    def claims(self) -> Mapping[str, float | None]:
        """Largest errors that the dataset allows for the measures."""
        return (self.estimate or self.bounds).claims(self.realization, self.measures)

    def observable(self, observable: Observable) -> ProvedObservable:
        """Proved value of an observable, and the largest errors that the dataset allows."""
        errors = partial((self.estimate or self.bounds).landing_errors, self.realization)
        status: Any = self.measures.values["particle_status"]
        found = prove_observable(observable, self.realization, self.trajectories, status, errors)
        if self.claims["impact_count"] is None:
            return found._replace(claims=[None] * len(found.claims))
        return found

    @property
    def deviation(self) -> tuple[float, float] | None:
        """Largest error in s of the kernel's landings, and its estimate; None if one is missing."""
        if self.estimate is None or not self.errors:
            return None
        largest = max(float(np.max(e.landing_time, initial=0.0)) for e in self.errors)
        return largest, self.estimate.time

    @cached_property
    def orbits(self) -> Sequence[Orbit]:
        """Proved states of each particle."""
        return [
            Orbit(self.realization, self.bounds, trajectory, particle)
            for particle, trajectory in enumerate(self.trajectories)
        ]

    @cached_property
    def cycles(self) -> Sequence[Cycle | None]:
        """Cycle of each particle: from rest to rest, or as at least half of the variables state."""
        if self.realization.deviates is not None:  # random motion never repeats
            return [None] * len(self.orbits)
        signs = [np.array([SIGNS[n](v) for v in self.stored[n]]) for n in SIGNS if n in self.stored]
        found = []
        for particle, orbit in enumerate(self.orbits):
            cycle = orbit.from_rest_to_rest()
            if cycle is None and 2 * sum(one[particle] for one in signs) >= len(signs):
                stated = max(0, int(self.stored["cycle_impacts"][particle]))
                cycle = orbit.recurrence(float(self.stored["recurrent_from"][particle]), stated)
            found.append(cycle)
        return found

    @cached_property
    def _states(self) -> Sequence[State | None]:
        pairs = zip(self.orbits, self.cycles, strict=True)
        return [None if cycle is None else orbit.representative(cycle) for orbit, cycle in pairs]

    @cached_property
    def orbit_numbers(self) -> Sequence[int | None]:
        """Number of the orbit of each particle, -1 if it has no cycle; None if undecided."""
        return numbered(self.cycles, self._states)

    @cached_property
    def slots(self) -> Sequence[int | None]:
        """Slot of each particle, -1 if it has no cycle; None where this cannot be decided."""
        return [
            -1 if cycle is None else None if state is None else state.whole % cycle.periods
            for cycle, state in zip(self.cycles, self._states, strict=True)
        ]

    @cached_property
    def exponents(self) -> Mapping[str, Sequence[Exponent]]:
        """Exponents of each particle, by the variable that holds them."""
        largest, total = zip(*map(self._exponents, range(len(self.orbits))), strict=True)
        return {"lyapunov_largest": largest, "lyapunov_sum": total}

    def _exponents(self, particle: int) -> tuple[Exponent, Exponent]:
        """Largest exponent of a particle, and the sum of both."""
        orbit, cycle = self.orbits[particle], self.cycles[particle]
        impacts, first = self._window(particle)
        unclaimed = self.claims["impact_count"] is None and cycle is None
        if orbit.trajectory.at_rest or (cycle is not None and cycle.rests):
            return (Exponent(-math.inf, 0.0, 0.0),) * 2
        rounding = self._stated("lyapunov_sum_error", particle)
        if cycle is not None:
            last = len(orbit.speeds) - 1
            total, change = orbit.contraction(last - cycle.impacts, last)
            found = largest_exponent(orbit.map, orbit.last_state(), cycle.impacts, cycle.periods)
            stated = self._stated("lyapunov_largest_error", particle)
            claim = None if found is None else stated
            return Exponent(found, claim, bounded=True), _sum(total, rounding, change)
        if unclaimed:
            return (Exponent(None, None),) * 2
        if first == len(impacts) or any(i.rested for i in impacts[first:]):
            return (Exponent(None, 0.0),) * 2  # undefined
        if self.realization.deviates is not None:
            return (Exponent(None, None),) * 2
        mean = orbit.growth(first, len(impacts))
        total, change = orbit.contraction(first, len(impacts))
        largest = Exponent(mean.value, mean.claim, mean.standard_error)
        return largest, _sum(total, rounding, change)

    def aperiodic(self, particle: int) -> bool | None:
        """Decide whether a particle that does not recur is aperiodic; None if uncertain."""
        impacts, first = self._window(particle)
        if len(impacts) - first < LANDINGS or any(i.rested for i in impacts[first:]):
            return False
        mean = self.orbits[particle].growth(first, len(impacts))
        if mean.claim is None or mean.standard_error is None:
            return None
        above = mean.value - CERTAIN * mean.standard_error
        return above > 0.0 if abs(above) > (1.0 + CERTAIN) * mean.claim else None

    def _window(self, particle: int) -> tuple[Sequence[Impact], int]:
        """Impacts of a particle, and the number of the first one in the window."""
        impacts = self.orbits[particle].trajectory.impacts
        if not self.realization.scene.windowed:
            return impacts, 0
        begin = exact(self.realization.transient)
        return impacts, sum(1 for i in impacts if i.landing_time < begin)

    def _stated(self, name: str, particle: int) -> float | None:
        """Return an error that the dataset states; None where it states none."""
        error = float(self.stored[name][particle])
        return error if math.isfinite(error) else None


def _sum(total: arb | float, rounding: float | None, change: float) -> Exponent:
    """Sum of both exponents; `rounding` is its stated error bound, None where none is stated."""
    claim = None if rounding is None or not math.isfinite(change) else rounding + change
    return Exponent(total, claim, 0.0, bounded=isinstance(total, arb))
