"""A base of finite mass: the scalar loop, and SciPy over base and particles at once.

The program for SciPy lets no particle ride the base, because the scene has no rests.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.integrate import solve_ivp

from coupled_loop import scalar_coupled
from methods.compiled import MARGIN, SCALAR, arrays
from methods.flights import SCIPY, setting_of
from methods.scenes import Point, Scene
from methods.timing import timed
from vibrosweep.kernels.restitution import Constant
from vibrosweep.kernels.waveforms import Sine
from vibrosweep.model.parameters import dimensionless, launches, mounts

MOST = 10  # times the landings: an orbit spoilt by errors may end in ever shorter flights


def scalar_mounted(scene: Scene, sizes: list[int], threads: int) -> Iterator[Point]:
    """Run the scalar loop on one thread."""
    given, shape = arrays(scene, scene.realizations), (scene.realizations, scene.proved)
    mount = mounts(given, Constant(), Sine())
    start = launches(tuple(scene.sample.tolist()), scene.proved, given["frequency"])

    def run(last: int, end: float, times: np.ndarray | None) -> int:
        found, problem = np.zeros(shape, np.int64), dimensionless(given, end)
        scalar_coupled(0, last, problem, mount, start, end, times, found)
        return int(found.sum())

    times = np.full((1, scene.proved, max(sizes)), np.nan)
    run(1, scene.duration + MARGIN, times)
    run(1, scene.duration, None)
    landings, seconds = timed(lambda: run(scene.realizations, scene.duration, None))
    lanes = scene.realizations * scene.proved
    yield Point(scene.key, SCALAR, "streaming", 1, lanes, landings, seconds, list(times[0]))


class Mounted:
    """Base on its spring and particles above it, as one system of equations of motion.

    The state is the deviation of the base from the motion that it has without particles, its rate,
    and height and velocity of each particle in the frame at rest.
    """

    def __init__(self, scene: Scene, rtol: float) -> None:
        p = self.p = scene.parameters
        self.scene, self.rtol, self.size = scene, rtol, scene.proved
        self.omega = 2.0 * math.pi * p["frequency"]
        self.velocity = p["amplitude"] / (1.0 + p["restitution"])
        own = 2.0 * math.pi * p["mount_frequency"]
        self.stiffness, self.drag = own * own, 2.0 * p["mount_damping"] * own

    def base(self, t: float, y: np.ndarray) -> tuple[float, float]:
        """Height and velocity of the base."""
        angle = self.omega * t + self.p["phase"]
        height = -self.velocity / self.omega * math.cos(angle) + y[0]
        return height, self.velocity * math.sin(angle) + y[1]

    def _motion(self, t: float, y: np.ndarray) -> np.ndarray:
        out = np.empty_like(y)
        out[0], out[1] = y[1], -self.drag * y[1] - self.stiffness * y[0]
        out[2 : 2 + self.size] = y[2 + self.size :]
        out[2 + self.size :] = -self.p["gravity"]
        return out

    def _clearance(self, j: int):
        """Height of a particle above the base on its way down; a positive number on its way up."""

        def above(t: float, y: np.ndarray) -> float:
            height, rate = self.base(t, y)
            return y[2 + j] - height if y[2 + self.size + j] < rate else 1.0

        above.terminal, above.direction = True, -1.0  # type: ignore[attr-defined]
        return above

    def landings(self, sizes: list[int]) -> list[np.ndarray]:
        """The first landing times of each particle."""
        n, e, mu = self.size, self.p["restitution"], self.p["mass_ratio"]
        found: list[list[float]] = [[] for _ in range(n)]
        t, y, launched = 0.0, np.zeros(2 + 2 * n), 0
        times = [*self.scene.sample.tolist(), self.scene.duration + MARGIN]
        for _ in range(MOST * sum(sizes)):
            done = all(len(f) >= size for f, size in zip(found, sizes, strict=True))
            if done or launched > n:
                break
            events = [self._clearance(j) for j in range(launched)]
            run = solve_ivp(
                self._motion, (t, times[launched]), y, "DOP853", events=events,
                rtol=self.rtol, atol=1e-3 * self.rtol,
            )  # fmt: skip
            t, y = float(run.t[-1]), run.y[:, -1].copy()
            if run.status == 0:  # the next launch
                if launched < n:
                    y[2 + launched] = self.base(t, y)[0]
                    y[2 + n + launched] = self.p["launch_velocity"]
                launched += 1
                continue
            j = next(j for j, at in enumerate(run.t_events) if at.size)
            found[j].append(t)
            height, rate = self.base(t, y)
            given = (1.0 + e) * (rate - y[2 + n + j]) / (1.0 + mu)
            y[2 + j] = height
            y[2 + n + j] += given
            y[1] -= mu * given
        return [np.array(f[:size]) for f, size in zip(found, sizes, strict=True)]


def scipy_mounted(scene: Scene, sizes: list[int], threads: int) -> Iterator[Point]:
    """Every tolerance, one realization, one thread."""
    for rtol in scene.tolerances:
        mounted = Mounted(scene, rtol)
        times, seconds = timed(lambda mounted=mounted: mounted.landings(sizes))
        setting = setting_of(scene, rtol)
        landings = sum(time.size for time in times)
        yield Point(scene.key, SCIPY, setting, 1, scene.proved, landings, seconds, times)
