"""SciPy's `solve_ivp`: one call per flight, the landing as a terminal event."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from scipy.integrate import solve_ivp

from methods.law import BASE_OF, HighBounceBase, MovingBase
from methods.scenes import Case, Point, Scene, Sweep
from methods.timing import timed
from vibrosweep.model.parameters import HIGH_BOUNCE

SCIPY = "SciPy solve_ivp"
MOST_IMPACTS = 10_000  # per trajectory; a call takes some tenths of a millisecond


def _height(t: float, y: np.ndarray) -> float:
    """Height on the way down.

    On the way up the result is set to a positive number: in a flight that fits into one step the
    lift-off would otherwise be found instead of the landing.
    """
    return y[0] if y[1] < 0.0 else 1.0


_height.terminal = True  # type: ignore[attr-defined]
_height.direction = -1.0  # type: ignore[attr-defined]


def _fall(base: HighBounceBase | MovingBase, left: float) -> Callable:
    """Speed and acceleration relative to the base after a lift-off at the time `left`."""
    gravity, shaking, omega = base.gravity, base.shaking, base.omega
    angle = omega * left + base.phase
    if shaking == 0.0:
        return lambda t, y: (y[1], -gravity)
    return lambda t, y: (y[1], -gravity - shaking * math.cos(angle + omega * t))


def _landings(case: Case, impacts: int, rtol: float) -> np.ndarray:
    """The first landing times; the clock of each flight starts at its lift-off."""
    base = BASE_OF[case.base](case)
    end = 1.01 * case.longest_flight
    method = "RK45" if base.shaking == 0.0 else "DOP853"
    left = base.start
    times = np.full(impacts, np.nan)
    for k in range(impacts):
        flight = solve_ivp(
            _fall(base, left.time), (0.0, end), left[1:], method, events=_height,
            rtol=rtol, atol=1e-3 * rtol,
        )  # fmt: skip
        if not flight.t_events[0].size:  # fallen through the base
            break
        times[k] = left.time + flight.t_events[0][0]
        left = base.leave(times[k], -flight.y_events[0][0][1])
    return times


def setting_of(scene: Scene | Sweep, rtol: float) -> str:
    """Tolerances and method of integration."""
    method = "RK45" if scene.base == HIGH_BOUNCE else "DOP853"
    return f"rtol {rtol:.0e}, atol {1e-3 * rtol:.0e}, {method}"


def scipy_events(scene: Scene | Sweep, sizes: list[int], threads: int) -> Iterator[Point]:
    """Every tolerance of the scene, one thread."""
    partial = max(sizes) > MOST_IMPACTS
    note = f"first {MOST_IMPACTS} landings of a trajectory only" if partial else ""
    pairs = list(zip(scene.cases, sizes, strict=True))
    _landings(scene.cases[0], 1, 1e-3)
    for rtol in scene.tolerances:

        def run(rtol: float = rtol) -> list[np.ndarray]:
            return [_landings(case, min(size, MOST_IMPACTS), rtol) for case, size in pairs]

        times, seconds = timed(run)
        impacts = sum(time.size for time in times)
        yield Point(
            scene.key, SCIPY, setting_of(scene, rtol), 1, len(pairs), impacts, seconds, times,
            note, partial,
        )  # fmt: skip
