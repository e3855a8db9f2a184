"""heyoka.py: Taylor series with the landing as a terminal event."""

from __future__ import annotations

from collections.abc import Iterator

import heyoka
import numpy as np
from methods.law import Base
from methods.scenes import Point, Scene
from methods.timing import once
from methods.truth import Orbit, worst

HEYOKA = "heyoka.py"
TOLERANCES = (1e-3, 1e-9, 1e-15)

# Height at lift-off.  From exactly 0 heyoka 7.13 misses the landing when the whole flight fits
# into one step; any positive height is seen, and this one moves no landing.
ABOVE = 1e-300


class Bouncer:
    """One particle: a Taylor integrator that stops at landings.

    Parameters
    ----------
    scene
        Its parameters.
    tolerance
        Of the Taylor series; it sets the order.
    """

    def __init__(self, scene: Scene, tolerance: float) -> None:
        self.base, self.scene = Base(scene), scene
        y, v = heyoka.make_vars("y", "v")
        gravity = scene.parameters["gravity"]

        # heyoka copies its callback deeply: a bound method would act on a copy of this object
        def land(integrator: heyoka.taylor_adaptive, sign: int) -> bool:
            return self._land(integrator)

        self.integrator = heyoka.taylor_adaptive(
            [(y, v), (v, heyoka.expression(-gravity))],
            [ABOVE, 0.0],
            tol=tolerance,
            t_events=[heyoka.t_event(y, callback=land, direction=heyoka.event_direction.negative)],
        )

    def _land(self, integrator: heyoka.taylor_adaptive) -> bool:
        """Record the landing; go on at once unless the particle rests or all are recorded."""
        t = self.times[self.found] = integrator.time
        self.found += 1
        self.left_at, speed = self.base.leave(t, abs(integrator.state[1]))
        integrator.state[:] = ABOVE, speed
        return self.left_at == t and self.found < self.times.size

    def landings(self, launch: float, impacts: int) -> np.ndarray:
        """The first landing times."""
        ta = self.integrator
        self.times, self.found, self.left_at = np.empty(impacts), 0, launch
        ta.state[:] = ABOVE, self.scene.parameters["launch_velocity"]
        longest = 1.01 * self.scene.longest_flight
        while self.found < impacts:
            # a rest moves the clock, which no callback may do
            ta.time = self.left_at
            ta.reset_cooldowns()
            ta.propagate_until(self.left_at + impacts * longest, max_delta_t=longest)
        return self.times


def heyoka_events(scene: Scene, orbits: list[Orbit], threads: int) -> Iterator[Point]:
    """Every tolerance, one thread; on the long scene the finest one and one trajectory."""
    long = scene.duration > 1e5
    pairs = list(zip(scene.sample, orbits, strict=True))[: 1 if long else None]
    for tolerance in TOLERANCES[-1:] if long else TOLERANCES:
        bouncer = Bouncer(scene, tolerance)
        bouncer.landings(float(scene.sample[0]), 2)
        times: list[np.ndarray] = []
        seconds = once(
            lambda bouncer=bouncer, times=times: times.extend(
                bouncer.landings(float(launch), orbit.size) for launch, orbit in pairs
            )
        )
        error, _ = worst([orbit for _, orbit in pairs], times)
        impacts = sum(time.size for time in times)
        yield Point(
            scene.key, HEYOKA, f"tol {tolerance:.0e}", 1, len(pairs), impacts, seconds, error,
            "the rebound is a Python callback",
        )  # fmt: skip
