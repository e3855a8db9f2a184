"""Proved landing times, and errors against them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from flint import arb, ctx

from methods.scenes import Case, Scene, Sweep
from vibrosweep.proof.reference import trajectories as ball
from vibrosweep.proof.reference.motion import Deviates, Trajectory
from vibrosweep.proof.reference.sprung import coupled
from vibrosweep.proof.sampling import deviates_of

BITS = 256
DIGITS = 32  # of the proved numbers


@dataclass(frozen=True)
class Orbit:
    """Landings of one trajectory: time = count + phase + low, in s, to within radius.

    Attributes
    ----------
    count, phase, low
        Shape (impact,): whole periods, and the reduced phase as an unevaluated sum of two doubles.
    radius
        Proved bound of the remainder.
    """

    count: np.ndarray
    phase: np.ndarray
    low: np.ndarray
    radius: float

    @property
    def size(self) -> int:
        return self.count.size

    def errors(self, times: np.ndarray) -> np.ndarray:
        """Distance of landing times, in order, from the proved ones, s.

        Missing landings make the array shorter.
        """
        n = min(self.size, int(np.count_nonzero(np.isfinite(times))))
        error = ((times[:n] - self.count[:n]) - self.phase[:n]) - self.low[:n]
        return np.abs(error) + self.radius


def prove(sweep: Sweep) -> list[Orbit]:
    """The orbits of the sweep's sample."""
    return [_orbit(found) for found in trajectories(sweep)]


def trajectories(scene: Scene | Sweep) -> Sequence[Trajectory]:
    """The proved trajectories of the sample; over a base of finite mass those of all particles."""
    cases = scene.cases
    if scene.base == "sprung":
        launches = [case.launch for case in cases]
        found = coupled(cases[0].parameters, launches, scene.duration, digits=DIGITS)
        return found.particles
    return [
        ball.trajectory(
            **case.parameters, launch_time=case.launch, duration=case.duration, base=case.base,
            rebound=case.rebound, waveform=case.waveform, digits=DIGITS,
            deviates=_deviates(case),
        )
        for case in cases
    ]  # fmt: skip


def _deviates(case: Case) -> Deviates | None:
    return deviates_of(0, 0.0, case.particle) if "kick_noise" in case.parameters else None


def _orbit(found: Trajectory) -> Orbit:
    count = np.array([impact.count for impact in found.impacts], dtype=np.float64)
    split = [_two_doubles(impact.phase) for impact in found.impacts]
    phase, low, radius = (np.array(column) for column in zip(*split, strict=True))
    return Orbit(count, phase, low, float(radius.max()))


def _two_doubles(value: arb) -> tuple[float, float, float]:
    """Two doubles whose sum is the ball's midpoint, and a bound of the remainder."""
    with ctx.workprec(BITS):
        high = float(value)
        low = float(value - high)
        return high, low, float((value - high - low).abs_upper())


def worst(orbits: list[Orbit], times: list[np.ndarray]) -> tuple[float, str]:
    """Largest landing-time error, and a note where landings are missing."""
    errors = [orbit.errors(time) for orbit, time in zip(orbits, times, strict=True)]
    missing = sum(orbit.size - e.size for orbit, e in zip(orbits, errors, strict=True))
    total = sum(orbit.size for orbit in orbits)
    note = f"{missing} of {total} landings missing" if missing else ""
    return max(float(e.max()) for e in errors if e.size), note
