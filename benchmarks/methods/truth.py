"""Proved landing times, and errors against them.

A long locked orbit is proved in two parts.  The ball arithmetic follows the transient; then the
state lies so close to the fixed orbit, which is known in closed form, that the map provably never
takes it further away: in the coordinates z where the Jacobian is a rotation times sqrt(e),

    |z'| <= sqrt(e) |z| (1 + 2 pi^2 a sqrt(e) |z| / beta)

with beta the imaginary part of the multipliers.  Where the bracket times sqrt(e) is below 1, every
later landing is the fixed orbit's to within |z|.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import arb, ctx

from methods.scenes import Case, Scene
from methods.sweeps import Sweep
from vibrosweep.proof.reference import ball
from vibrosweep.proof.reference.results import Impact

BITS = 256
SETTLED = 2000.0  # s; the transient shrinks by sqrt(e) at each impact


@dataclass(frozen=True)
class Orbit:
    """Landings of one trajectory: time = count + phase + low, in s, to within radius.

    Attributes
    ----------
    count, phase, low
        Shape (impact,): whole periods, and the reduced phase as an unevaluated sum of two doubles.
    radius
        Proved bound of what is left.
    """

    count: np.ndarray
    phase: np.ndarray
    low: np.ndarray
    radius: float

    @property
    def size(self) -> int:
        return self.count.size

    def head(self, impacts: int) -> Orbit:
        """The first landings only."""
        return Orbit(self.count[:impacts], self.phase[:impacts], self.low[:impacts], self.radius)

    def errors(self, whole: np.ndarray, part: np.ndarray | float = 0.0) -> np.ndarray:
        """Distance of the landings at whole + part, in order, from the proved ones, s.

        The difference from the count is exact, so that errors far below an ulp of the time are
        seen.  Landings that are missing leave the array shorter.
        """
        n = min(self.size, int(np.count_nonzero(np.isfinite(whole))))
        part = part[:n] if isinstance(part, np.ndarray) else part
        error = ((whole[:n] - self.count[:n]) + (part - self.phase[:n])) - self.low[:n]
        return np.abs(error) + self.radius


def prove(scene: Scene | Sweep) -> list[Orbit]:
    """The orbits of the scene's sample."""
    return [_prove_one(case) for case in scene.cases]


def _prove_one(case: Case) -> Orbit:
    followed = min(case.duration, SETTLED) if case.locked else case.duration
    found = ball.trajectory(
        **case.parameters, launch_time=case.launch, duration=followed, rebound=case.rebound,
        base=case.base,
    )  # fmt: skip
    count = np.array([impact.count for impact in found.impacts], dtype=np.float64)
    split = [_two_doubles(impact.phase) for impact in found.impacts]
    phase, low, radius = (np.array(column) for column in zip(*split, strict=True))
    if followed == case.duration:
        return Orbit(count, phase, low, float(radius.max()))
    fixed, distance = _fixed_orbit(case, found.impacts[-1])
    value, rest, error = _two_doubles(fixed)
    last = np.floor(case.duration - value)
    later = np.arange(count[-1] + case.locked, last + 0.5, case.locked)
    return Orbit(
        np.concatenate([count, later]),
        np.concatenate([phase, np.full(later.size, value)]),
        np.concatenate([low, np.full(later.size, rest)]),
        max(float(radius.max()), distance + error),
    )


def _two_doubles(value: arb) -> tuple[float, float, float]:
    """Two doubles whose sum is the ball's midpoint, and a bound of what is left."""
    with ctx.workprec(BITS):
        high = float(value)
        low = float(value - high)
        return high, low, float((value - high - low).abs_upper())


def _fixed_orbit(case: Case, impact: Impact) -> tuple[arb, float]:
    """Phase of the fixed orbit, and a proved bound of every later landing's distance from it."""
    p = case.parameters
    with ctx.workprec(BITS):
        e = arb(p["restitution"])
        a = 2 * arb(p["frequency"]) * arb(p["amplitude"]) / arb(p["gravity"])
        sine = (1 - e) * case.locked / a
        phase = arb(0.5) - sine.asin() / (2 * arb.pi())
        slope = -2 * arb.pi() * a * (1 - sine * sine).sqrt()
        alpha = (1 + e + slope) / 2
        beta = (e - alpha * alpha).sqrt()
        off_phase, off_flight = impact.phase - phase, impact.flight.speed - case.locked
        across = (off_flight - (alpha - 1) * off_phase) / beta
        distance = arb((off_phase * off_phase + across * across).abs_upper()).sqrt()
        growth = e.sqrt() * (1 + 2 * arb.pi() ** 2 * a * e.sqrt() * distance / beta)
        if not growth < 1:
            raise RuntimeError(f"launch {case.launch} s: the orbit is not proved to stay locked")
        return phase, float(distance.abs_upper())


def worst(orbits: list[Orbit], times: list[np.ndarray]) -> tuple[float, str]:
    """Largest landing-time error, and a note where landings are missing."""
    errors = [orbit.errors(time) for orbit, time in zip(orbits, times, strict=True)]
    missing = sum(orbit.size - e.size for orbit, e in zip(orbits, errors, strict=True))
    total = sum(orbit.size for orbit in orbits)
    note = f"{missing} of {total} landings missing" if missing else ""
    return max(float(e.max()) for e in errors if e.size), note


def forced_phase_error(scene: Scene) -> float:
    """Phase error of the locked orbit that rounding the state once per impact can force, turns.

    Half an ulp of the phase and of the flight time enter at each impact and are carried on by the
    Jacobian of the fixed orbit; this is the sum of the absolute values.
    """
    p = scene.parameters
    e, a = p["restitution"], 2.0 * p["frequency"] * p["amplitude"] / p["gravity"]
    sine = (1.0 - e) * scene.locked / a
    slope = -2.0 * np.pi * a * np.sqrt(1.0 - sine * sine)
    phase = 0.5 - np.arcsin(sine) / (2.0 * np.pi)
    rounding = 0.5 * np.spacing(np.array([phase, float(scene.locked)]))
    jacobian = np.array([[1.0, 1.0], [slope, e + slope]])
    power, total = np.eye(2), 0.0
    while np.abs(power).max() > 1e-6:
        total += float(np.abs(power[0]) @ rounding)
        power = jacobian @ power
    return total
