"""Closed forms of the bouncing ball: locked orbits, and orbits of any kind.

The forms in `sprung` hold over a base of finite mass, the others over a base of infinite mass.
"""

from __future__ import annotations

from vibrosweep.model.orbit_theory import (
    FIXED,
    amplitude_max,
    amplitude_min,
    exponent_sum,
    flight_time_bound,
    liftoff_flight,
    liftoff_speed_bound,
    locked_apex,
    locked_height,
    locked_phase,
    locked_velocity,
    locked_windows,
    multipliers,
    recognition_periods,
    unforced_rest_impact,
    unforced_rest_time,
)
from vibrosweep.model.restitution_laws import restitution_at
from vibrosweep.model.shapes import base_motion
from vibrosweep.theory import sprung

__all__ = [
    "FIXED",
    "amplitude_max",
    "amplitude_min",
    "base_motion",
    "exponent_sum",
    "flight_time_bound",
    "liftoff_flight",
    "liftoff_speed_bound",
    "locked_apex",
    "locked_height",
    "locked_phase",
    "locked_velocity",
    "locked_windows",
    "multipliers",
    "recognition_periods",
    "restitution_at",
    "sprung",
    "unforced_rest_impact",
    "unforced_rest_time",
]


def __dir__() -> list[str]:
    return sorted(__all__)
