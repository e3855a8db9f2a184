"""The exact rebound and rest law in plain Python, for methods that integrate one flight a time."""

from __future__ import annotations

import math

from methods.scenes import Case


class Base:
    """What the base does to a particle.

    Parameters
    ----------
    case
        The trajectory's parameters and law.
    """

    def __init__(self, case: Case) -> None:
        p = case.parameters
        self.restitution, self.amplitude = p["restitution"], p["amplitude"]
        self.omega = 2.0 * math.pi * p["frequency"]
        self.phase = p["phase"]
        self.rest_velocity = 0.5 * p["gravity"] * p["contact_time"]
        self.liftoff_angle = math.asin(self.rest_velocity / self.amplitude)
        self.reflects = case.rebound == "reflect"

    def leave(self, time: float, speed: float) -> tuple[float, float]:
        """Time and velocity of the lift-off after a landing at `time` with `speed`."""
        angle = self.omega * time + self.phase
        w = self.restitution * speed + self.amplitude * math.sin(angle)
        if self.reflects:
            w = abs(w)
        if w > self.rest_velocity:
            return time, w
        wait = (self.liftoff_angle - angle) % (2.0 * math.pi)
        return time + wait / self.omega, self.rest_velocity
