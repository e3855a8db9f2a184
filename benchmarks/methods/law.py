"""The exact rebound and rest in plain Python, for methods that integrate one flight at a time."""

from __future__ import annotations

import math
from typing import NamedTuple

from methods.scenes import Case
from vibrosweep.model.shapes import SINE
from vibrosweep.proof.sampling import deviates_of

AFTER_REST = 1e-5  # radians of phase; see `MovingBase`


class LiftOff(NamedTuple):
    """Start of a flight: time in s, height above the base in m, speed relative to it in m/s."""

    time: float
    height: float
    speed: float


class HighBounceBase:
    """Impacts of a particle on a base at rest that kicks.

    Parameters
    ----------
    case
        The trajectory's parameters and law.
    """

    shaking = 0.0  # largest acceleration of the base, m s-2

    def __init__(self, case: Case) -> None:
        p = case.parameters
        self.gravity = p["gravity"]
        self.restitution, self.amplitude = p["restitution"], p["amplitude"]
        self.omega = 2.0 * math.pi * p["frequency"]
        self.phase = p["phase"]
        self.rest_velocity = 0.5 * p["gravity"] * p["contact_time"]
        self.liftoff_angle = math.asin(self.rest_velocity / self.amplitude)
        self.reflects = case.rebound == "reflect"
        self.start = LiftOff(case.launch, 0.0, p["launch_velocity"])
        self.tones = case.waveform.tones or ((1, 1.0, 0.0),)
        self.push = (1.0 + self.restitution) * p.get("kick_noise", 0.0)
        self.drawn, self.impacts = deviates_of(0, 0.0, case.particle).of_impact, 0
        self.plain = case.waveform == SINE and self.push == 0.0

    def leave(self, time: float, speed: float) -> LiftOff:
        """Lift-off after a landing at `time` with `speed`."""
        angle = self.omega * time + self.phase
        shape = sum(weight * math.sin(h * angle + psi) for h, weight, psi in self.tones)
        w = self.restitution * speed + self.amplitude * shape
        if self.push > 0.0:
            w += self.push * self.drawn(self.impacts)[1]
            self.impacts += 1
        if self.reflects:
            w = abs(w)
        if w > self.rest_velocity:
            return LiftOff(time, 0.0, w)
        if not self.plain:
            raise NotImplementedError("a rest under two tones or noise, which no scene here has")
        wait = (self.liftoff_angle - angle) % (2.0 * math.pi)
        return LiftOff(time + wait / self.omega, 0.0, self.rest_velocity)


class MovingBase:
    """Impacts of a particle on a moving base; height and speed are relative to the base.

    After a rest a particle leaves with neither speed nor acceleration.  No event can be found from
    there, so its flight begins `AFTER_REST` later, where its height is known to a relative 1e-5.

    Parameters
    ----------
    case
        The trajectory's parameters.
    """

    def __init__(self, case: Case) -> None:
        p = case.parameters
        self.gravity = p["gravity"]
        self.restitution = p["restitution"]
        self.omega = 2.0 * math.pi * p["frequency"]
        self.phase = p["phase"]
        velocity = p["amplitude"] / (1.0 + self.restitution)
        self.shaking = self.omega * velocity
        self.rest_velocity = 0.5 * p["gravity"] * p["contact_time"]
        gamma = self.shaking / self.gravity
        self.liftoff_angle = math.acos(-1.0 / gamma) if gamma > 1.0 else math.nan
        falls = math.sqrt(max(gamma * gamma - 1.0, 0.0)) * self.gravity * AFTER_REST**2
        self.after_rest = (
            falls * AFTER_REST / (6.0 * self.omega * self.omega), falls / (2.0 * self.omega)
        )  # fmt: skip
        launched = p["launch_velocity"] - velocity * math.sin(self.omega * case.launch + self.phase)
        self.start = LiftOff(case.launch, 0.0, launched)

    def leave(self, time: float, speed: float) -> LiftOff:
        """Lift-off after a landing at `time` with `speed`; NaN where it rests for good."""
        angle = self.omega * time + self.phase
        presses = self.gravity + self.shaking * math.cos(angle) > 0.0
        if self.restitution * speed > self.rest_velocity or not presses:
            return LiftOff(time, 0.0, self.restitution * speed)
        wait = (self.liftoff_angle - angle) % (2.0 * math.pi) + AFTER_REST
        return LiftOff(time + wait / self.omega, *self.after_rest)


BASE_OF: dict[str, type[HighBounceBase | MovingBase]] = {
    "high-bounce": HighBounceBase,
    "moving": MovingBase,
}
