"""JAX: the map itself, and diffrax with landings as events, over many lanes, compiled by XLA."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator

import numpy as np

from methods.compiled import MARGIN, count_landings, count_moving_landings
from methods.law import AFTER_REST
from methods.scenes import Point, Scene, Sweep, table
from methods.timing import timed
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
MOST_IMPACTS = 100_000  # of a trajectory; from here on only the sample is run
ABOVE = 1e-300  # an event needs a change of sign, so the flight starts above the base
ROOT = 1e-12  # Newton's last step; it converges quadratically, so the root is better than that


class HighBounce:
    """Impacts on a base at rest that kicks.

    Parameters
    ----------
    reflects
        True for the law `reflect`.
    """

    solver, settings = diffrax.Tsit5(), "rtol {:.0e}, atol {:.0e}, Tsit5"

    def __init__(self, reflects: bool) -> None:
        self.reflects = reflects

    def constants(self, row) -> dict:
        """Parameters by name, and constants that follow from them."""
        p = dict(zip(PARAMETERS, row, strict=False))
        rest = 0.5 * p["gravity"] * p["contact_time"]
        fastest = jnp.maximum(p["launch_velocity"], p["amplitude"] / (1.0 - p["restitution"]))
        return p | {
            "omega": 2.0 * math.pi * p["frequency"],
            "rest": rest,
            "liftoff_angle": jnp.arcsin(rest / p["amplitude"]),
            "longest": 2.0 * fastest / p["gravity"],
        }

    def begin(self, p: dict, t):
        """Time, height and velocity of the launch."""
        return t, ABOVE, p["launch_velocity"]

    def leave(self, p: dict, t, speed):
        """Time, height and velocity of the lift-off after a landing at t."""
        angle = p["omega"] * t + p["phase"]
        w = p["restitution"] * speed + p["amplitude"] * jnp.sin(angle)
        w = jnp.abs(w) if self.reflects else w
        leaves = w > p["rest"]
        wait = jnp.mod(p["liftoff_angle"] - angle, 2.0 * math.pi) / p["omega"]
        return jnp.where(leaves, t, t + wait), ABOVE, jnp.where(leaves, w, p["rest"])

    def acceleration(self, p: dict, left, t):
        """Acceleration at the time t of a flight that began at `left`."""
        return -p["gravity"]


class Moving:
    """Impacts on a moving base; heights and velocities are relative to it."""

    solver, settings = diffrax.Dopri8(), "rtol {:.0e}, atol {:.0e}, Dopri8"

    def constants(self, row) -> dict:
        """Constants by name, as in `HighBounce`."""
        p = dict(zip(PARAMETERS, row, strict=False))
        e, gravity, omega = p["restitution"], p["gravity"], 2.0 * math.pi * p["frequency"]
        velocity = p["amplitude"] / (1.0 + e)
        shaking = omega * velocity
        fastest = jnp.maximum(p["launch_velocity"], (1.0 + 3.0 * e) * velocity / (1.0 - e))
        drop = 2.0 * velocity / omega
        return p | {
            "omega": omega,
            "rest": 0.5 * gravity * p["contact_time"],
            "velocity": velocity,
            "shaking": shaking,
            "liftoff_angle": jnp.arccos(-gravity / shaking),
            "falls": jnp.sqrt(jnp.maximum(shaking**2 - gravity**2, 0.0)),
            "longest": (fastest + jnp.sqrt(fastest**2 + 2.0 * gravity * drop)) / gravity,
        }

    def begin(self, p: dict, t):
        """Time, height and velocity of the launch."""
        return t, ABOVE, p["launch_velocity"] - p["velocity"] * jnp.sin(p["omega"] * t + p["phase"])

    def leave(self, p: dict, t, speed):
        """Time, height and velocity of the lift-off after a landing at t."""
        angle = p["omega"] * t + p["phase"]
        w = p["restitution"] * speed
        leaves = (w > p["rest"]) | (p["gravity"] + p["shaking"] * jnp.cos(angle) <= 0.0)
        wait = (jnp.mod(p["liftoff_angle"] - angle, 2.0 * math.pi) + AFTER_REST) / p["omega"]
        height = p["falls"] * AFTER_REST**3 / (6.0 * p["omega"] ** 2)
        rising = p["falls"] * AFTER_REST**2 / (2.0 * p["omega"])
        return (
            jnp.where(leaves, t, t + wait),
            jnp.where(leaves, ABOVE, height),
            jnp.where(leaves, w, rising),
        )

    def acceleration(self, p: dict, left, t):
        """Acceleration at the time t of a flight that began at `left`."""
        return -p["gravity"] - p["shaking"] * jnp.cos(p["omega"] * (left + t) + p["phase"])


def _parabola(p: dict, left, height, v):
    """Duration of a flight, and speed of the landing."""
    return 2.0 * v / p["gravity"], v


def _event(base: HighBounce | Moving, rtol: float) -> Callable:
    """Return a function like `_parabola` that integrates a flight up to its landing."""
    landing = diffrax.Event(
        lambda t, y, args, **kwargs: y[0], optimistix.Newton(ROOT, ROOT), direction=False
    )
    term = diffrax.ODETerm(
        lambda t, y, args: (y[1], jnp.full_like(y[1], base.acceleration(args[0], args[1], t)))
    )
    controller = diffrax.PIDController(rtol=rtol, atol=1e-3 * rtol)

    def fly(p, left, height, v):
        found = diffrax.diffeqsolve(
            term, base.solver, 0.0, 1.01 * p["longest"], None, (height, v), args=(p, left),
            stepsize_controller=controller, event=landing, throw=False,
        )  # fmt: skip
        return found.ts[-1], -found.ys[1][-1]

    return fly


def _landings(rows: np.ndarray, fly: Callable, base: HighBounce | Moving, impacts: int) -> Callable:
    """Compile for these rows a function that returns landing times (trajectory, impact)."""

    def trajectory(row):
        p = base.constants(row)

        def impact(state, _):
            duration, speed = fly(p, *state)
            t = state[0] + duration
            return base.leave(p, t, speed), t

        return jax.lax.scan(impact, base.begin(p, row[-1]), None, length=impacts)[1]

    return jax.jit(jax.vmap(trajectory)).lower(rows).compile()


def _statistics(rows: np.ndarray, duration: float, reflects: bool) -> Callable:
    """Compile for these rows: number of landings, sum and maximum of rebound velocities."""

    def trajectory(row):
        base = HighBounce(reflects)
        p = base.constants(row)

        def impact(state):
            t, v, count, total, largest = state
            flight, speed = _parabola(p, t, ABOVE, v)
            t, _, v = base.leave(p, t + flight, speed)
            return t, v, count + 1, total + v, jnp.maximum(largest, v)

        start = (row[-1], p["launch_velocity"], 0, 0.0, 0.0)
        more = lambda state: state[0] + 2.0 * state[1] / p["gravity"] <= duration  # noqa: E731
        return jax.lax.while_loop(more, impact, start)[2:]

    return jax.jit(jax.vmap(trajectory)).lower(rows).compile()


def jax_map(scene: Scene | Sweep, sizes: list[int], threads: int) -> Iterator[Point]:
    """The map in a loop under `vmap`, which runs until the last lane of a block has ended."""
    sample, reflects = table(scene.cases), bool(scene.reflect)
    impacts = int(count_landings(sample, scene.duration + MARGIN, scene.reflect).max())
    found = np.asarray(_landings(sample, _parabola, HighBounce(reflects), impacts)(sample))
    times = list(found)
    blocks = np.array_split(scene.table, scene.lanes // BLOCK)
    solve = _statistics(blocks[0], scene.duration, reflects)
    found, seconds = timed(lambda: jax.block_until_ready([solve(block) for block in blocks]))
    run = (1, scene.lanes, sum(int(counts.sum()) for counts, *_ in found), seconds, times)
    note = f"{BLOCK} lanes under vmap; compilation is not timed"
    yield Point(scene.key, JAX, "streaming", *run, note)


def diffrax_events(scene: Scene | Sweep, sizes: list[int], threads: int) -> Iterator[Point]:
    """Every tolerance of the scene; the sample and further lanes in one vectorised run."""
    sample = table(scene.cases)
    long = max(sizes) >= MOST_IMPACTS
    extra = scene.table[:: scene.lanes // LANES][: 0 if long else LANES - len(sample)]
    rows = np.concatenate([sample, extra])
    moving = scene.base == "moving"
    base = Moving() if moving else HighBounce(bool(scene.reflect))
    count = count_moving_landings if moving else count_landings
    counts = count(rows, scene.duration, scene.reflect)
    counts[: len(sample)] = sizes
    for rtol in scene.tolerances:
        solve = _landings(rows, _event(base, rtol), base, int(counts.max()))
        found, seconds = timed(lambda solve=solve: np.asarray(solve(rows)))
        setting, note = base.settings.format(rtol, 1e-3 * rtol), f"{len(rows)} lanes under vmap"
        run = (1, len(rows), int(counts.sum()), seconds, list(found[: len(sample)]))
        yield Point(scene.key, DIFFRAX, setting, *run, note)
