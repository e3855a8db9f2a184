"""The motion of particles between recorded events, as exact curves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vibrosweep.figures import data
from vibrosweep.figures.data import Array

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Motion", "highest", "motions", "parabolas"]


@dataclass(frozen=True)
class Motion:
    """One particle's motion up to some instant, as straight facts: flights, rests, landings.

    Attributes
    ----------
    start, end, velocity
        Beginning and end of every flight in s (a flight in progress ends at the
        instant asked for), and the speed it starts with in m/s.
    rests
        Shape (rest, 2): from landing to lift-off, in s.
    landings
        Instants of landing in s.
    """

    start: Array
    end: Array
    velocity: Array
    rests: Array
    landings: Array


def motions(one: xr.Dataset, until: float) -> list[Motion]:
    """Flights, rests and landings of every particle of one realization, up to ``until`` s."""
    landing, liftoff = one["landing_time"].values, one["liftoff_time"].values
    launch = np.broadcast_to(one["launch_time"].values, landing.shape[:1])[:, np.newaxis]
    start = np.concatenate([launch, liftoff], axis=1)
    speed = np.full_like(launch, data.pick(one, "launch_velocity"))
    velocity = np.concatenate([speed, one["rebound_velocity"].values], axis=1)
    # The last flight lands after the observation: its end follows from its speed
    recorded = np.concatenate([landing, np.full_like(launch, np.nan)], axis=1)
    unrecorded = start + 2.0 * velocity / data.pick(one, "gravity")
    end = np.minimum(np.where(np.isnan(recorded), unrecorded, recorded), until)
    flies = (start < until) & (velocity > 0.0)
    rests = (one["rested"].values == 1) & (landing < until)
    leaves = np.fmin(liftoff, until)  # fmin: a particle at rest for good has NaN and stays
    return [
        Motion(
            start[i, flies[i]],
            end[i, flies[i]],
            velocity[i, flies[i]],
            np.stack([landing[i, rests[i]], leaves[i, rests[i]]], axis=1),
            landing[i, landing[i] <= until],
        )
        for i in range(landing.shape[0])
    ]


def parabolas(motion: Motion, gravity: float) -> Array:
    """Return each flight as two quadratic Bezier curves: shape (flight, 5 points, 2).

    Points 0, 2 and 4 lie on the parabola: the launch, the apex (or the end, if the flight is cut
    before it) and the end.  Points 1 and 3 are where the tangents at their neighbours meet.  One
    curve would be exact too, but renderers flatten it: where many flights share a pixel they would
    draw it lower than the apex, which as the end of a curve is always reached.
    """
    lasting = motion.end - motion.start
    rise = np.minimum(lasting, motion.velocity / gravity)
    top = rise * (motion.velocity - gravity * rise / 2.0)
    fall = np.maximum(lasting - motion.velocity / gravity, 0.0)
    slope = motion.velocity - gravity * rise  # at point 2: zero at the apex
    times = [0.0 * rise, rise / 2.0, rise, rise + fall / 2.0, rise + fall]
    values = [0.0 * rise, motion.velocity * rise / 2.0, top, top + slope * fall / 2.0]
    values.append(top - gravity * fall**2 / 2.0)
    return np.stack(
        [motion.start[:, np.newaxis] + np.stack(times, axis=-1), np.stack(values, axis=-1)], axis=-1
    )


def highest(motion: Motion, gravity: float) -> float:
    """Greatest height of the motion in m: a flight cut before its apex does not reach it."""
    rise = np.minimum(motion.end - motion.start, motion.velocity / gravity)
    return float(np.max(rise * (motion.velocity - gravity * rise / 2.0), initial=0.0))
