"""diffrax: one solve per flight with the landing as an event, compiled by XLA, many lanes."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator

import numpy as np

from methods.scenes import Point, Scene
from methods.timing import timed
from methods.truth import Orbit, worst

# read when jax is first imported
os.environ["JAX_ENABLE_X64"] = "1"
os.environ["JAX_PLATFORMS"] = "cpu"
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"

import diffrax
import jax
import jax.numpy as jnp
import optimistix

# XLA sizes its pool of threads by the processors that it may use when it starts
_allowed = os.sched_getaffinity(0)
os.sched_setaffinity(0, {max(_allowed)})
jax.devices()
os.sched_setaffinity(0, _allowed)

DIFFRAX = "diffrax"
LANES = 256
ABOVE = 1e-300  # an event needs a change of sign, so the flight starts above the base
ROOT = 1e-12  # Newton's last step; it converges quadratically, so the root is better than that


def _flight(scene: Scene, rtol: float) -> Callable:
    """A function of the lift-off velocity: duration of the flight, and speed of the landing."""
    gravity = scene.parameters["gravity"]
    term = diffrax.ODETerm(lambda t, y, args: (y[1], jnp.full_like(y[1], -gravity)))
    landing = diffrax.Event(
        lambda t, y, args, **kwargs: y[0], optimistix.Newton(ROOT, ROOT), direction=False
    )
    controller = diffrax.PIDController(rtol=rtol, atol=1e-3 * rtol)

    def fly(v):
        found = diffrax.diffeqsolve(
            term, diffrax.Tsit5(), 0.0, 1.01 * scene.longest_flight, None, (ABOVE, v),
            stepsize_controller=controller, event=landing, throw=False,
        )  # fmt: skip
        return found.ts[-1], -found.ys[1][-1]

    return fly


def _trajectories(scene: Scene, rtol: float, impacts: int) -> Callable:
    """A compiled function of launch times: landing times, shape (trajectory, impact)."""
    p, fly = scene.parameters, _flight(scene, rtol)
    omega, rest = 2.0 * math.pi * p["frequency"], 0.5 * p["gravity"] * p["contact_time"]
    lift_angle = math.asin(rest / p["amplitude"])

    def impact(state, _):
        t, v = state
        duration, speed = fly(v)
        t = t + duration
        angle = omega * t + p["phase"]
        w = p["restitution"] * speed + p["amplitude"] * jnp.sin(angle)
        w = jnp.abs(w) if scene.reflect else w
        leaves = w > rest
        wait = jnp.mod(lift_angle - angle, 2.0 * math.pi) / omega
        return (jnp.where(leaves, t, t + wait), jnp.where(leaves, w, rest)), t

    def trajectory(launch):
        return jax.lax.scan(impact, (launch, p["launch_velocity"]), None, length=impacts)[1]

    return jax.jit(jax.vmap(trajectory))


def diffrax_events(scene: Scene, orbits: list[Orbit], threads: int) -> Iterator[Point]:
    """Every tolerance of the scene; the sample and further lanes in one vectorised run."""
    impacts = max(orbit.size for orbit in orbits)
    lanes = LANES if impacts < 10_000 else scene.proved
    extra = scene.batch[:: scene.lanes // LANES][: lanes - scene.proved]
    launch_times = jnp.concatenate([scene.sample, extra])
    for rtol in scene.tolerances:
        solve = _trajectories(scene, rtol, impacts).lower(launch_times).compile()
        found, seconds = timed(lambda solve=solve: np.asarray(solve(launch_times)))
        error, note = worst(orbits, list(found[: scene.proved]))
        yield Point(
            scene.key, DIFFRAX, f"rtol {rtol:.0e}", 1, lanes, impacts * lanes, seconds, error,
            note or f"{lanes} lanes under vmap; compilation is not timed",
        )  # fmt: skip
