"""heyoka.py: Taylor series with the landing as a terminal event."""

from __future__ import annotations

from collections.abc import Iterator

import heyoka
import numpy as np

from methods.law import BASE_OF, HighBounceBase, MovingBase
from methods.scenes import Case, Point, Scene, Sweep
from methods.timing import timed

HEYOKA = "heyoka.py"
TOLERANCES = (1e-3, 1e-9, 1e-15)

heyoka.set_logger_level_error()  # a root search that gives up is counted here, not logged

# Height at lift-off.  From exactly 0 heyoka 7.13 misses the landing when the whole flight fits
# into one step; any positive height is seen, and this one moves no landing.
ABOVE = 1e-300


class Bouncer:
    """One particle: a Taylor integrator that stops at landings.

    Parameters
    ----------
    base
        The base of all its trajectories.
    tolerance
        Of the Taylor series; it sets the order.
    """

    def __init__(self, base: HighBounceBase | MovingBase, tolerance: float) -> None:
        self.repeated = 0
        y, v = heyoka.make_vars("y", "v")
        fall = heyoka.expression(-base.gravity)
        if base.shaking > 0.0:
            fall -= base.shaking * heyoka.cos(base.omega * heyoka.time + base.phase)

        # heyoka copies its callback deeply: a bound method would act on a copy of this object
        def land(integrator: heyoka.taylor_adaptive, sign: int) -> bool:
            return self._land(integrator)

        self.integrator = heyoka.taylor_adaptive(
            [(y, v), (v, fall)],
            [ABOVE, 0.0],
            tol=tolerance,
            # the automatic cooldown grows with the tolerance and swallows short flights; here an
            # event cannot repeat itself, because the particle leaves from above the base
            t_events=[
                heyoka.t_event(
                    y, callback=land, direction=heyoka.event_direction.negative, cooldown=0.0
                )
            ],
        )

    def _land(self, integrator: heyoka.taylor_adaptive) -> bool:
        """Record the landing; go on at once unless the particle rests or all are recorded."""
        t = self.times[self.found] = integrator.time
        self.found += 1
        self.left = self.base.leave(t, abs(integrator.state[1]))
        integrator.state[:] = ABOVE, self.left.speed
        return self.left.time == t and self.found < self.times.size

    def landings(self, case: Case, impacts: int) -> np.ndarray:
        """The first landing times of a trajectory."""
        ta, self.base = self.integrator, BASE_OF[case.base](case)
        self.times, self.found = np.empty(impacts), 0
        self.left = self.base.start
        step = longest = 1.01 * case.longest_flight
        while self.found < impacts:
            # a rest moves the clock, which no callback may do
            ta.time, ta.state[:] = self.left.time, (self.left.height + ABOVE, self.left.speed)
            ta.reset_cooldowns()
            before = self.found
            ta.propagate_until(self.left.time + impacts * longest, max_delta_t=step)
            if self.found == before:  # the search for the root gave up and the particle fell on
                self.repeated += 1
                step *= 0.5
            else:
                step = longest
        return self.times


def heyoka_events(scene: Scene | Sweep, sizes: list[int], threads: int) -> Iterator[Point]:
    """Every tolerance, or for a sweep the finest, on one thread."""
    pairs = list(zip(scene.cases, sizes, strict=True))
    for tolerance in TOLERANCES if len(scene.tolerances) > 1 else TOLERANCES[-1:]:
        bouncer = Bouncer(BASE_OF[scene.cases[0].base](scene.cases[0]), tolerance)

        def run(bouncer: Bouncer = bouncer) -> list[np.ndarray]:
            bouncer.repeated = 0
            return [bouncer.landings(case, size) for case, size in pairs]

        times, seconds = timed(run)
        impacts = sum(sizes)
        note = "the rebound is a Python callback"
        if bouncer.repeated:
            note += f"; event missed and sought again with a shorter step {bouncer.repeated} times"
        setting = f"tol {tolerance:.0e}"
        yield Point(scene.key, HEYOKA, setting, 1, len(pairs), impacts, seconds, times, note)
