"""Scenes of many realizations: random parameters, a few particles each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from methods.scenes import TABLE_1, TOLERANCES, Case
from vibrosweep.model.parameters import HIGH_BOUNCE, PARAMETERS


def paper_parameters(realizations: int) -> dict[str, np.ndarray]:
    """Random realizations of the ranges of sweeps/paper.toml, each of shape (realization,)."""
    rng = np.random.default_rng(1)
    parameters = {name: np.full(realizations, value) for name, value in TABLE_1.items()}
    parameters["restitution"] = rng.uniform(0.80, 0.98, realizations)
    parameters["amplitude"] = rng.uniform(0.2, 3.5, realizations)
    return parameters


@dataclass(frozen=True)
class Sweep:
    """Random realizations of the ranges of sweeps/paper.toml, each with staggered particles.

    Attributes
    ----------
    key, title
        Name in the table, and heading of the panel.
    realizations, particles
        Their numbers; the trajectories are all pairs, particles running fastest.
    duration
        s; landings at t <= duration count.
    proved
        Trajectories, evenly over all, that are compared with the proved reference.
    tolerances
        Relative tolerances of SciPy and diffrax.
    """

    key: str
    title: str
    realizations: int
    particles: int
    duration: float
    proved: int
    tolerances: tuple[float, ...]
    rebound: str = "rest"
    reflect: None = None
    base: str = HIGH_BOUNCE

    @cached_property
    def arrays(self) -> dict[str, np.ndarray]:
        """Every parameter, shape (realization,)."""
        return paper_parameters(self.realizations)

    @property
    def lanes(self) -> int:
        """Number of trajectories."""
        return self.realizations * self.particles

    @cached_property
    def table(self) -> np.ndarray:
        """One row per trajectory: the seven parameters and the launch time."""
        columns = [np.repeat(self.arrays[name], self.particles) for name in PARAMETERS]
        launch = np.arange(self.particles) / (self.particles * TABLE_1["frequency"])
        return np.column_stack([*columns, np.tile(launch, self.realizations)])

    @property
    def chosen(self) -> np.ndarray:
        """Trajectories that are proved, from different realizations, spread over all launches."""
        spread = np.arange(self.proved)
        return spread * (self.realizations // self.proved) * self.particles + (
            spread % self.particles
        )

    @property
    def cases(self) -> list[Case]:
        """The trajectories that are compared with the proved reference."""
        rows = self.table[self.chosen].tolist()
        named = [dict(zip(PARAMETERS, row, strict=False)) for row in rows]
        return [
            Case(parameters, self.rebound, self.duration, row[-1])
            for parameters, row in zip(named, rows, strict=True)
        ]


SWEEPS = (
    Sweep(
        key="short",
        title="12 periods",
        realizations=2000,
        particles=20,
        duration=12.0,
        proved=40,
        tolerances=TOLERANCES[-1:],
    ),
    Sweep(
        key="long",
        title="1000 periods",
        realizations=200,
        particles=20,
        duration=1000.0,
        proved=10,
        tolerances=TOLERANCES[-1:],
    ),
)
