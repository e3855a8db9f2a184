"""The scenes of the comparisons, and their measured points.

Every scene has frequency 1 Hz and phase 0, so seconds are forcing periods and an instant is a whole
number plus a reduced phase without any rounding.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vibrosweep.model.parameters import HIGH_BOUNCE, MOUNT, PARAMETERS
from vibrosweep.model.shapes import SINE, Waveform

TOLERANCES = (1e-3, 1e-6, 1e-9, 1e-12)
TABLE_1 = {name: parameter.default for name, parameter in PARAMETERS.items()}


@dataclass(frozen=True)
class Case:
    """One trajectory.

    Attributes
    ----------
    parameters
        As in `vibrosweep.model.parameters`.
    rebound
        The law.
    duration
        s; landings at t <= duration count.
    launch
        Launch time in s.
    base
        One of `vibrosweep.model.parameters.BASES`.
    waveform
        Shape of the motion of the base.
    particle
        Its number, which determines its random numbers.
    """

    parameters: dict[str, float]
    rebound: str
    duration: float
    launch: float
    base: str = HIGH_BOUNCE
    waveform: Waveform = SINE
    particle: int = 0

    @property
    def longest_flight(self) -> float:
        """Bound of flight times: speeds stay below the larger of launch speed and A / (1 - e).

        On the moving base A becomes (1 + 3 e) V0, and a flight may end twice the displacement
        below its beginning.
        """
        p = self.parameters
        e, gravity = p["restitution"], p["gravity"]
        speed, drop = p["amplitude"] / (1.0 - e), 0.0
        if self.base == "moving":
            speed *= (1.0 + 3.0 * e) / (1.0 + e)
            drop = 2.0 * p["amplitude"] / ((1.0 + e) * 2.0 * math.pi * p["frequency"])
        speed = max(p["launch_velocity"], speed)
        return (speed + math.sqrt(speed * speed + 2.0 * gravity * drop)) / gravity


def table(cases: list[Case]) -> np.ndarray:
    """One row per trajectory: the seven parameters and the launch time."""
    return np.array([[*(c.parameters[name] for name in PARAMETERS), c.launch] for c in cases])


@dataclass(frozen=True)
class Scene:
    """One parameter set, launched at many instants.

    Attributes
    ----------
    key, title
        Name in the table, and heading of the panel.
    parameters
        As in `vibrosweep.model.parameters`.
    rebound
        The law.
    duration
        s; landings at t <= duration count.
    span
        First and last launch time in s.
    lanes
        Trajectories launched evenly over the span, for methods that run many at once.
    proved
        Trajectories, evenly over the span, that are compared with the proved reference.
    tolerances
        Relative tolerances of SciPy and diffrax.
    base
        One of `vibrosweep.model.parameters.BASES`.
    waveform
        Shape of the motion of the base.
    realizations
        Number of realizations; several where particles act on each other, so that each has few.
    """

    key: str
    title: str
    parameters: dict[str, float]
    rebound: str
    duration: float
    span: tuple[float, float]
    lanes: int
    proved: int
    tolerances: tuple[float, ...] = TOLERANCES
    base: str = HIGH_BOUNCE
    waveform: Waveform = SINE
    realizations: int = 1

    @property
    def batch(self) -> np.ndarray:
        """All launch times."""
        return np.linspace(*self.span, self.lanes)

    @property
    def sample(self) -> np.ndarray:
        """Launch times of the trajectories that are compared with the proved reference."""
        return np.linspace(*self.span, self.proved)

    @property
    def cases(self) -> list[Case]:
        """The trajectories that are compared with the proved reference."""
        p, law = self.parameters, self.rebound
        return [
            Case(p, law, self.duration, float(t), self.base, self.waveform, i)
            for i, t in enumerate(self.sample)
        ]

    @property
    def table(self) -> np.ndarray:
        """One row per trajectory of the batch: the seven parameters and the launch time."""
        rows = np.tile([*(self.parameters[name] for name in PARAMETERS), 0.0], (self.lanes, 1))
        rows[:, -1] = self.batch
        return rows

    @property
    def reflect(self) -> int | None:
        """The law as compiled functions take it."""
        return 1 if self.rebound == "reflect" else None


@dataclass(frozen=True)
class Point:
    """One measured point.

    Attributes
    ----------
    scene, method, setting
        Scene, method and its setting.
    threads
        Threads that shared the trajectories.
    trajectories, impacts
        Numbers covered by the timed run.
    seconds
        Median time of a run: processor time for one thread, wall time for several.
    times
        Landing times of each proved trajectory.
    note
        Note for the reader on this point.
    partial
        Whether it covers fewer landings than the scene has.
    error
        Largest error of these times, s, once they have been compared.
    """

    scene: str
    method: str
    setting: str
    threads: int
    trajectories: int
    impacts: int
    seconds: float
    times: list[np.ndarray] = field(repr=False)
    note: str = ""
    partial: bool = False
    error: float = math.nan

    @property
    def ns_per_impact(self) -> float:
        """Time over impacts."""
        return 1e9 * self.seconds / self.impacts


STEPS = (1e-2, 1e-3, 1e-4, 1e-5)

MAP_SCENES = (
    Scene(
        key="locked",
        title="Locked after a transient, 200 periods",
        parameters=TABLE_1,
        rebound="rest",
        duration=200.0,
        span=(0.12, 0.13),
        lanes=32768,
        proved=9,
    ),
    Scene(
        key="resting",
        title="Rests in every cycle, 50 periods",
        parameters=TABLE_1,
        rebound="rest",
        duration=50.0,
        span=(0.0, 0.001),
        lanes=16384,
        proved=9,
    ),
    Scene(
        key="chaotic",
        title="Chaotic, 8 periods",
        parameters=TABLE_1 | {"amplitude": 3.5},
        rebound="reflect",
        duration=8.0,
        span=(0.1, 0.2),
        lanes=32768,
        proved=9,
    ),
)


def _moving(key: str, title: str, e: float, gamma: float, **others) -> Scene:
    """A scene on a moving base with a largest acceleration of gamma times gravity."""
    mount = {name: others.pop(name) for name in MOUNT if name in others}
    amplitude = (1.0 + e) * gamma * TABLE_1["gravity"] / (2.0 * math.pi)
    return Scene(
        key=key,
        title=title,
        parameters=TABLE_1 | {"restitution": e, "amplitude": amplitude} | mount,
        rebound="rest",
        **{"base": "moving"} | others,
    )


TWO_TONES = Waveform("harmonics", ((1, 1.0, 0.0), (2, 0.4, 1.1)))

SCENES = (
    *MAP_SCENES,
    _moving(
        "moving-locked", "Moving, Gamma = 0.9, 200 periods", 0.7, 0.9,
        duration=200.0, span=(0.12, 0.13), lanes=32768, proved=9,
    ),
    _moving(
        "moving-resting", "Moving, Gamma = 2, 50 periods", 0.5, 2.0,
        duration=50.0, span=(0.1, 0.2), lanes=16384, proved=9,
    ),
    _moving(
        "moving-chaotic", "Moving, Gamma = 5, 8 periods", 0.8, 5.0,
        duration=8.0, span=(0.1, 0.2), lanes=32768, proved=9,
    ),
    _moving(
        "sprung", "Finite mass, 4 particles, 20 periods", 0.8, 5.0,
        duration=20.0, span=(0.2, 0.5), lanes=4, proved=4, base="sprung", realizations=500,
        mass_ratio=0.02, mount_frequency=0.5, mount_damping=0.05,
    ),
    replace(MAP_SCENES[-1], key="tones", title="Two tones, 8 periods", waveform=TWO_TONES),
    Scene(
        key="noise",
        title="Noise of the kick, 50 periods",
        parameters=TABLE_1 | {"kick_noise": 0.01},
        rebound="rest",
        duration=50.0,
        span=(0.12, 0.13),
        lanes=16384,
        proved=9,
    ),
)  # fmt: skip


# Scenes of many realizations: random parameters, a few particles each.


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
