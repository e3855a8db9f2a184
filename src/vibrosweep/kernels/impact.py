"""One impact: the physics, once, for every kernel.

The dimensionless map, with the phase x in turns and the flight time u in forcing periods:

    x' = x + u          w = e u + a sin(2 pi x')          u' = w  if w > r, else the particle rests

Phases stay in [-1/2, 1/2]; whole periods are counted apart, as integers held in float64.  The
reduction u - rint(u) is exact, so nothing is lost as time grows.
"""

from __future__ import annotations

import numpy as np

from vibrosweep.kernels._jit import fma, jit
from vibrosweep.kernels.sine import sin_turns
from vibrosweep.scene import Dimensionless, Launches

__all__ = ["Scene", "impact", "land", "launch", "lift_off", "rebound", "scene"]

# restitution, kick, rest threshold, phase of lift-off, wait for ever or not, flight after a rest
Scene = tuple[float, float, float, float, float, float]


@jit
def scene(problem: Dimensionless, i: int) -> Scene:
    """What decides the impacts of realization i."""
    a, r = problem.kick[i], problem.rest_flight[i]
    wait, u_lift = (0.0, r) if a > r else (np.inf, 0.0)
    return problem.restitution[i], a, r, problem.liftoff_phase[i], wait, u_lift


@jit
def launch(problem: Dimensionless, launches: Launches, i: int, p: int) -> tuple[float, float]:
    """Whole periods and reduced phase at which particle p of realization i leaves the base."""
    row = i if launches.whole.shape[0] > 1 else 0
    start = launches.phase[row, p] + problem.phase[i]
    carry = np.rint(start)
    return launches.whole[row, p] + carry, start - carry


@jit
def land(x: float, u: float) -> tuple[float, float]:
    """Phase of the landing after a flight of u periods from phase x, and whole periods passed."""
    whole = np.rint(u)
    moved = x + (u - whole)
    carry = np.rint(moved)
    return moved - carry, whole + carry


@jit
def rebound(x: float, u: float, e: float, a: float, reflect: int | None) -> float:
    """Next flight time if the particle leaves at once: the rebound law.

    ``reflect`` is chosen at compile time: None for the `rest` law, which takes w as it is; anything
    else for the `reflect` law, which turns a particle pushed into the base back with |w|.
    """
    w = fma(e, u, a * sin_turns(x))
    if reflect is None:
        return w
    return abs(w)


@jit
def lift_off(
    n: float, x: float, w: float, r: float, x_lift: float, wait: float, u_lift: float
) -> tuple[float, float, float, bool]:
    """Count, phase and flight time with which a particle that landed at (n, x) leaves the base.

    Above r it leaves at once; else it rests until the phase next rises through x_lift.  `wait` is
    0, or infinite where the kick never lifts a particle: the count of the lift-off is then
    infinite, no later instant is inside any window, and u_lift is 0.
    """
    leaves = w > r
    later = n + (wait + (1.0 if x > x_lift else 0.0))
    return (
        n if leaves else later,
        x if leaves else x_lift,
        w if leaves else u_lift,
        leaves,
    )


@jit
def impact(
    scene: Scene, n: float, x: float, u: float, reflect: int | None
) -> tuple[float, float, float, float, float, bool]:
    """Landing and lift-off after a flight u from (n, x).

    Returns count and phase of the landing, those of the lift-off, the next flight, and whether the
    particle leaves at once.
    """
    e, a, r, x_lift, wait, u_lift = scene
    x, passed = land(x, u)
    n += passed
    w = rebound(x, u, e, a, reflect)
    n_off, x_off, u, leaves = lift_off(n, x, w, r, x_lift, wait, u_lift)
    return n, x, n_off, x_off, u, leaves
