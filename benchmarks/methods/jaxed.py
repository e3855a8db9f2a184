"""JAX: the map itself, and diffrax with the landing as an event, compiled by XLA, many lanes."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator

import numpy as np

from methods.compiled import MARGIN, count_landings
from methods.scenes import Point, Scene, table
from methods.sweeps import Sweep
from methods.timing import timed
from methods.truth import Orbit, worst
from vibrosweep.model.parameters import PARAMETERS

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

JAX = "JAX"
DIFFRAX = "diffrax"
LANES = 256
BLOCK = 250  # lanes; larger blocks wait longer for their last one
MOST_IMPACTS = 100_000  # of a trajectory, with so many lanes
ABOVE = 1e-300  # an event needs a change of sign, so the flight starts above the base
ROOT = 1e-12  # Newton's last step; it converges quadratically, so the root is better than that


def _constants(row) -> dict:
    """Parameters by name, and what does not change from impact to impact."""
    p = dict(zip(PARAMETERS, row, strict=False))
    rest = 0.5 * p["gravity"] * p["contact_time"]
    return p | {"rest": rest, "liftoff_angle": jnp.arcsin(rest / p["amplitude"])}


def _leave(p: dict, t, speed, reflects: bool):
    """Time and velocity of the lift-off after a landing at t."""
    omega = 2.0 * math.pi * p["frequency"]
    angle = omega * t + p["phase"]
    w = p["restitution"] * speed + p["amplitude"] * jnp.sin(angle)
    w = jnp.abs(w) if reflects else w
    leaves = w > p["rest"]
    wait = jnp.mod(p["liftoff_angle"] - angle, 2.0 * math.pi) / omega
    return jnp.where(leaves, t, t + wait), jnp.where(leaves, w, p["rest"])


def _parabola(p: dict, v):
    """Duration of a flight, and speed of the landing."""
    return 2.0 * v / p["gravity"], v


def _event(rtol: float) -> Callable:
    """The same by integration up to the landing."""
    landing = diffrax.Event(
        lambda t, y, args, **kwargs: y[0], optimistix.Newton(ROOT, ROOT), direction=False
    )
    term = diffrax.ODETerm(lambda t, y, gravity: (y[1], jnp.full_like(y[1], -gravity)))
    controller = diffrax.PIDController(rtol=rtol, atol=1e-3 * rtol)

    def fly(p, v):
        fastest = jnp.maximum(p["launch_velocity"], p["amplitude"] / (1.0 - p["restitution"]))
        end = 1.01 * 2.0 * fastest / p["gravity"]  # no flight is longer
        found = diffrax.diffeqsolve(
            term, diffrax.Tsit5(), 0.0, end, None, (ABOVE, v), args=p["gravity"],
            stepsize_controller=controller, event=landing, throw=False,
        )  # fmt: skip
        return found.ts[-1], -found.ys[1][-1]

    return fly


def _landings(rows: np.ndarray, fly: Callable, reflects: bool, impacts: int) -> Callable:
    """Compiled for these rows: so many landing times of each, shape (trajectory, impact)."""

    def trajectory(row):
        p = _constants(row)

        def impact(state, _):
            t, v = state
            duration, speed = fly(p, v)
            return _leave(p, t + duration, speed, reflects), t + duration

        return jax.lax.scan(impact, (row[-1], p["launch_velocity"]), None, length=impacts)[1]

    return jax.jit(jax.vmap(trajectory)).lower(rows).compile()


def _statistics(rows: np.ndarray, duration: float, reflects: bool) -> Callable:
    """Compiled for these rows: landings, and sum and maximum of the velocities that follow."""

    def trajectory(row):
        p = _constants(row)

        def impact(state):
            t, v, count, total, largest = state
            flight, speed = _parabola(p, v)
            t, v = _leave(p, t + flight, speed, reflects)
            return t, v, count + 1, total + v, jnp.maximum(largest, v)

        start = (row[-1], p["launch_velocity"], 0, 0.0, 0.0)
        more = lambda state: state[0] + 2.0 * state[1] / p["gravity"] <= duration  # noqa: E731
        return jax.lax.while_loop(more, impact, start)[2:]

    return jax.jit(jax.vmap(trajectory)).lower(rows).compile()


def jax_map(scene: Scene | Sweep, orbits: list[Orbit], threads: int) -> Iterator[Point]:
    """The map in a loop under `vmap`, which goes on until the last lane of a block has ended."""
    sample, reflects = table(scene.cases), bool(scene.reflect)
    impacts = int(count_landings(sample, scene.duration + MARGIN, scene.reflect).max())
    found = np.asarray(_landings(sample, _parabola, reflects, impacts)(sample))
    error, note = worst(orbits, list(found))
    blocks = np.array_split(scene.table, scene.lanes // BLOCK)
    solve = _statistics(blocks[0], scene.duration, reflects)
    found, seconds = timed(lambda: jax.block_until_ready([solve(block) for block in blocks]))
    run = (1, scene.lanes, sum(int(counts.sum()) for counts, *_ in found), seconds, error)
    note = note or f"{BLOCK} lanes under vmap; compilation is not timed"
    yield Point(scene.key, JAX, "streaming", *run, note)


def diffrax_events(scene: Scene | Sweep, orbits: list[Orbit], threads: int) -> Iterator[Point]:
    """Every tolerance of the scene; the sample and further lanes in one vectorised run."""
    sample = table(scene.cases)
    long = max(orbit.size for orbit in orbits) >= MOST_IMPACTS
    extra = scene.table[:: scene.lanes // LANES][: 0 if long else LANES - len(sample)]
    rows = np.concatenate([sample, extra])
    counts = count_landings(rows, scene.duration, scene.reflect)
    counts[: len(sample)] = [orbit.size for orbit in orbits]
    for rtol in scene.tolerances:
        solve = _landings(rows, _event(rtol), bool(scene.reflect), int(counts.max()))
        found, seconds = timed(lambda solve=solve: np.asarray(solve(rows)))
        error, note = worst(orbits, list(found[: len(sample)]))
        yield Point(
            scene.key, DIFFRAX, f"rtol {rtol:.0e}", 1, len(rows), int(counts.sum()), seconds,
            error, note or f"{len(rows)} lanes under vmap; compilation is not timed",
        )  # fmt: skip
