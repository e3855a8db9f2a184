"""The motion of particles between recorded events, as exact curves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vibrosweep.analysis.records import BaseMotion, course
from vibrosweep.arrays import Array

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Motion:
    """Flights, rests and landings of one particle up to an instant, as plain arrays."""

    # start, end: of every flight, s; the last one is cut at the instant
    start: Array
    end: Array
    velocity: Array  # at the start of every flight, m s-1
    height: Array  # of the base at the start of every flight, m
    rests: Array  # shape (rest, 2): from landing to lift-off, s
    landings: Array  # instants of landing, s


def motions(one: xr.Dataset, base: BaseMotion, until: float) -> list[Motion]:
    """Flights, rests and landings of every particle of one realization, up to ``until`` s."""
    landing, liftoff = one["landing_time"].values, one["liftoff_time"].values
    flights = course(one, base, until)
    rests = (one["rested"].values == 1) & (landing < until)
    leaves = np.fmin(liftoff, until)  # the lift-off is NaN at permanent rest
    return [
        Motion(
            flights.start[i, flies],
            flights.end[i, flies],
            flights.velocity[i, flies],
            flights.height[i, flies],
            np.stack([landing[i, rests[i]], leaves[i, rests[i]]], axis=1),
            landing[i, landing[i] <= until],
        )
        for i, flies in enumerate(flights.flies)
    ]


def parabolas(motion: Motion, gravity: float) -> Array:
    """Return each flight as two quadratic Bezier curves: shape (flight, 5 points, 2).

    Points 0, 2 and 4 lie on the parabola: the launch, the apex (or the end, if the flight is cut
    before it) and the end.  Points 1 and 3 are the intersections of the tangents at the
    neighbouring points.  A single curve would be exact too, but renderers approximate curves by
    polygons, which reach the end points of a curve and may miss its apex.
    """
    rise = _rise(motion, gravity)
    top = rise * (motion.velocity - gravity * rise / 2.0)
    fall = motion.end - motion.start - rise
    # at point 2: zero at the apex, negative if the flight begins downwards
    slope = motion.velocity - gravity * rise
    times = [0.0 * rise, rise / 2.0, rise, rise + fall / 2.0, rise + fall]
    values = [0.0 * rise, motion.velocity * rise / 2.0, top, top + slope * fall / 2.0]
    values.append(top + slope * fall - gravity * fall**2 / 2.0)
    return np.stack(
        [
            motion.start[:, np.newaxis] + np.stack(times, axis=-1),
            motion.height[:, np.newaxis] + np.stack(values, axis=-1),
        ],
        axis=-1,
    )


def highest(motion: Motion, gravity: float) -> float:
    """Greatest height in m that is drawn, at least 0."""
    rise = _rise(motion, gravity)
    top = motion.height + rise * (motion.velocity - gravity * rise / 2.0)
    return float(np.max(top, initial=0.0))


def _rise(motion: Motion, gravity: float) -> Array:
    """Time in s from the beginning of each flight to its highest point."""
    return np.clip(motion.velocity / gravity, 0.0, motion.end - motion.start)
