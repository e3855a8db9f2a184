"""Conditions under noise: the share of replicas in which they hold.

Replica r takes stream r of random numbers at every point, so that shares vary smoothly with the
parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
import xarray as xr

from vibrosweep.analysis.conditions import FAILS, HOLDS, UNDETERMINED, Codes, Condition, Locked
from vibrosweep.analysis.evaluate import Points, condition_codes, fixed_orbits, in_pieces
from vibrosweep.analysis.records import variable
from vibrosweep.arrays import Array
from vibrosweep.engine.measure import statistics
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels.statistics import LONGEST, RESTS, SHORTEST
from vibrosweep.model.measures import Status
from vibrosweep.model.parameters import STREAM, Dimensionless, Launches, dimensionless
from vibrosweep.scene.scene import Scene

REPLICAS: Final = 100
NEAR: Final = 0.25  # forcing periods by which a flight of a locked particle may differ from k
LEVEL: Final = 0.95  # confidence level of the interval of a share
DIMS: Final = ("condition", "direction", "restitution", "scan")
COMMENT: Final = (
    "for locked(k) the share of replicas and particles that begin on the orbit and are locked at "
    "the end, 0 where there is no orbit; NaN where no replica is decided"
)


class Share(NamedTuple):
    """Numbers of independent trials at each point: those in which a condition holds, and all.

    Trials in which the condition is undetermined do not count.
    """

    held: Array  # each of shape (point,)
    tried: Array

    @property
    def codes(self) -> Codes:
        """Code for each point: `HOLDS` if the condition holds in at least half of the trials."""
        half = np.where(2.0 * self.held >= self.tried, HOLDS, FAILS)
        return np.where(self.tried > 0.0, half, UNDETERMINED)

    def variables(self, shape: tuple[int, ...]) -> dict[str, xr.Variable]:
        """Shares with their intervals (Clopper & Pearson 1934), as variables of a dataset."""
        from scipy.stats import beta  # slow to import

        missed = self.tried - self.held
        with np.errstate(invalid="ignore"):
            share = self.held / self.tried
        tail = 0.5 * (1.0 - LEVEL)
        low = np.where(self.held > 0.0, beta.ppf(tail, self.held, missed + 1.0), 0.0)
        high = np.where(missed > 0.0, beta.ppf(1.0 - tail, self.held + 1.0, missed), 1.0)
        share, low, high = np.where(self.tried > 0.0, (share, low, high), np.nan).reshape(3, *shape)
        words = "share of replicas in which the condition holds"
        ends = "end of the 95 % interval of the share"
        return {
            "share": variable(DIMS, share, words, comment=COMMENT),
            "share_low": variable(DIMS, low, f"lower {ends}"),
            "share_high": variable(DIMS, high, f"upper {ends}"),
        }


def share_of(
    scene: Scene, condition: Condition | Locked, points: Points, replicas: int, workers: Workers
) -> Share:
    """Count the trials in which a condition holds at each point."""
    share = _locked if isinstance(condition, Locked) else _launched
    found = [
        share(scene, condition, piece, replicas, workers)  # type: ignore[arg-type]
        for piece in in_pieces(points, scene.particles * replicas)
    ]
    return Share(*(np.concatenate(part) for part in zip(*found, strict=True)))


def _repeated(parameters: Mapping[str, Array], replicas: int) -> dict[str, Array]:
    """Parameters of every replica of the realizations, with its stream of random numbers."""
    found = {name: np.repeat(values, replicas) for name, values in parameters.items()}
    size = parameters["restitution"].size
    return found | {STREAM: np.tile(np.arange(replicas, dtype=np.float64), size)}


def _launched(
    scene: Scene, condition: Condition, points: Points, replicas: int, workers: Workers
) -> Share:
    """Count the replicas of the scene's launches in which a condition holds."""
    parameters = _repeated(scene.parameters(points), replicas)
    codes = condition_codes(scene, condition, parameters, workers).reshape(-1, replicas)
    held, tried = (codes == HOLDS).sum(axis=1), (codes != UNDETERMINED).sum(axis=1)
    return Share(held.astype(np.float64), tried.astype(np.float64))


def _locked(
    scene: Scene, condition: Locked, points: Points, replicas: int, workers: Workers
) -> Share:
    """Count the particles that begin on the orbit of k periods and are locked to it at the end.

    A particle is locked if it has landed, has not rested, and every flight was within `NEAR` of k
    periods.  Particles that share the noise of the drive count together as one trial.
    """
    k, parameters = float(condition.k), scene.parameters(points)
    problem = dimensionless(parameters, scene.duration)._replace(noise=None)
    phase = fixed_orbits(scene, condition.k, 1.0, problem, workers).phase
    alive = np.isfinite(phase)
    held, trials = np.zeros(phase.size), scene.particles
    if alive.any():
        kept = {name: values[alive] for name, values in parameters.items()}
        begun = np.repeat(phase[alive], replicas)
        noisy, launch = _from_orbit(scene, _repeated(kept, replicas), begun, k)
        found = statistics(noisy, launch, scene, workers, more=(SHORTEST, LONGEST))
        stays = (found.landings > 0) & (found.totals[RESTS] == 0.0)
        stays &= (found.total("flight_min") > k - NEAR) & (found.total("flight_max") < k + NEAR)
        stays &= found.status == Status.COMPLETED
        held[alive] = stays.reshape(alive.sum(), -1).sum(axis=1)
    if "drive_noise" in parameters:
        held, trials = held / trials, 1
    return Share(held, np.full(phase.size, float(replicas * trials)))


def _from_orbit(
    scene: Scene, parameters: dict[str, Array], phase: Array, k: float
) -> tuple[Dimensionless, Launches]:
    """Problem and launches of particles that begin with a flight of k periods at a phase.

    Over any base that flight begins and ends at the same height: its absolute speed is k g / 2 f.
    """
    parameters["phase"] = np.zeros_like(phase)  # the phase is that of the forcing
    problem = dimensionless(parameters, scene.duration, scene.measures.transient)
    shape = phase.size, scene.particles
    at = np.ascontiguousarray(np.broadcast_to(phase[:, np.newaxis], shape))
    return problem._replace(launch_flight=np.full(phase.size, k)), Launches(np.zeros(shape), at)
