"""Regimes and cycles against the proved orbits.

That an orbit recurs is found by the kernel, where a state returns bit for bit; the exact orbit
approaches its cycle for ever, or falls into it at a rest.  What can be proved is that it repeats as
stated from the time stated on, up to what makes two states one for the kernel and to the errors
that the dataset admits: then impacts, periods and rests of the cycle follow exactly.  Where no
recurrence was found nothing is said of the orbit, and only that its numbers agree is judged.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from vibrosweep.kernels.orbits import SAME_ORBIT
from vibrosweep.reference._flint import arb, ctx
from vibrosweep.reference.ball import Trajectory
from vibrosweep.status import Regime
from vibrosweep.variables import REGIMES
from vibrosweep.verify.claims import EPS, Bounds, record_claims
from vibrosweep.verify.judgement import Judgement, judge
from vibrosweep.verify.measures import Proved
from vibrosweep.verify.sample import Scene

__all__ = ["REGIME_VARIABLES", "judge_regimes"]

COUNTED: Final = {f"{r.meaning}_count": r for r in Regime if r is not Regime.AT_REST}
REGIME_VARIABLES: Final = (*REGIMES, *COUNTED)


def judge_regimes(
    stored: Mapping[str, Any], scene: Scene, bounds: Bounds, trajectories: Sequence[Trajectory]
) -> list[Judgement]:
    """Judge all that is stored of the regimes of one realization, by the names of variables."""
    judged, regimes = [], []
    late = record_claims(bounds, scene, scene.duration)["liftoff_time"]
    for particle, trajectory in enumerate(trajectories):
        own = {name: stored[name][particle].item() for name in REGIMES}
        with ctx.workprec(2 * trajectory.precision_bits):
            proved = _proved(own, scene, bounds, trajectory, particle)
            for name, value in proved.items():
                claim = late if name == "recurrent_from" else 0.0
                judged.append(judge(name, particle, float(own[name]), value, claim))
        regimes.append(proved["regime"])
    for name, regime in COUNTED.items():
        judged.append(judge(name, None, float(stored[name]), regimes.count(int(regime)), 0.0))
    return judged


def _proved(
    own: Mapping[str, Any], scene: Scene, bounds: Bounds, trajectory: Trajectory, particle: int
) -> dict[str, Proved]:
    """What should be stored of a particle, given when it is said to recur."""
    cycle, start = 0, 0
    orbit = _Orbit(scene, bounds, trajectory, particle)
    if not trajectory.at_rest and _recurs(own):
        stated = max(0, own["cycle_impacts"])
        start = orbit.start(own["recurrent_from"], stated)
        cycle = orbit.cycle(start, stated)
    if cycle == 0:
        regime = Regime.AT_REST if trajectory.at_rest else Regime.UNSETTLED
        return {"recurrent_from": None, "regime": int(regime)} | dict.fromkeys(
            ("cycle_impacts", "cycle_periods", "cycle_rests"), 0
        )
    rests = sum(impact.rested for impact in trajectory.impacts[start : start + cycle])
    return {
        "recurrent_from": orbit.times[start],
        "cycle_impacts": cycle,
        "cycle_periods": orbit.periods(start, cycle),
        "cycle_rests": rests,
        "regime": int(Regime.RESTING if rests else Regime.LOCKED),
    }


def _recurs(own: Mapping[str, Any]) -> bool:
    """Whether a particle is said to recur, by most of its numbers if they disagree."""
    said = (
        own["regime"] in (Regime.RESTING, Regime.LOCKED),
        own["cycle_impacts"] > 0,
        own["cycle_periods"] > 0,
        math.isfinite(own["recurrent_from"]),
    )
    return bool(2 * sum(said) >= len(said))


class _Orbit:
    """States of a particle after its launch and after each impact: lift-off time, flight."""

    def __init__(self, scene: Scene, bounds: Bounds, trajectory: Trajectory, particle: int) -> None:
        launch = scene.launch_times[particle]
        gravity, self.frequency = scene.parameters["gravity"], arb(scene.parameters["frequency"])
        first = 2 * self.frequency * arb(scene.parameters["launch_velocity"]) / arb(gravity)
        left = [impact for impact in trajectory.impacts if impact.liftoff_time is not None]
        self.times = [
            arb(launch.numerator) / launch.denominator,
            *(impact.liftoff_time for impact in left),
        ]
        self.flights = [first, *(impact.flight for impact in left)]
        frequency = scene.parameters["frequency"]
        time = record_claims(bounds, scene, 0.0)["liftoff_time"] * frequency
        flight = bounds.rebound_velocity * 2.0 * frequency / gravity
        # of the difference of two states of the kernel, in periods
        self.error = 2.0 * max(time, flight) + 8.0 * EPS

    def start(self, time: float, cycle: int) -> int:
        """Return the number of the state nearest to a time; without one, the last with a cycle."""
        if not math.isfinite(time):
            return max(0, len(self.times) - 1 - cycle)
        gaps = [float(abs(t - time)) for t in self.times]
        return gaps.index(min(gaps))

    def periods(self, state: int, cycle: int) -> int:
        """Forcing periods from a state to the one that many impacts later, as a whole number."""
        turns = (self.times[state + cycle] - self.times[state]) * self.frequency
        return int((turns.mid() + arb(0.5)).floor().fmpz())

    def cycle(self, start: int, stated: int) -> int:
        """Impacts in the cycle from a state on; 0 where the orbit does not repeat.

        The stated number holds if the orbit repeats after so many impacts and, certainly, not after
        fewer that divide them.
        """
        if stated > 0 and self._repeats(start, stated, SAME_ORBIT + self.error):
            shorter = (d for d in range(1, stated) if stated % d == 0)
            return next(
                (d for d in shorter if self._repeats(start, d, SAME_ORBIT - self.error)), stated
            )
        others = range(1, len(self.times) - start)
        return next((n for n in others if self._repeats(start, n, SAME_ORBIT + self.error)), 0)

    def _repeats(self, start: int, cycle: int, error: float) -> bool:
        """Whether all states from one on are equal to those a cycle later, up to an error."""
        last = len(self.times) - cycle
        if start >= last:
            return False
        periods = self.periods(start, cycle)
        for n in range(start, last):
            turns = (self.times[n + cycle] - self.times[n]) * self.frequency - periods
            if abs(turns) > error or abs(self.flights[n + cycle] - self.flights[n]) > error:
                return False
        return True
