"""Conditions on a realization, and where they hold: at points of a plane, and under noise.

Under noise a condition holds in a share of replicas.  Replica r takes stream r of random numbers at
every point, so that shares vary smoothly with the parameters.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.common import States, reached, settle_from
from vibrosweep.analysis.datasets import require, shares, variable
from vibrosweep.arrays import Array
from vibrosweep.engine.measure import batch_of, measure, orbit_variables, statistics
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.fixed import (
    ABSENT,
    ATTRACTS,
    REPELS,
    FixedOrbits,
    empty_fixed,
    end_errors,
    find_fixed,
    may_push_back,
)
from vibrosweep.kernels.impact import base_of
from vibrosweep.kernels.statistics import LONGEST, RESTS, SHORTEST
from vibrosweep.model.functions import digest_of, is_function, plain, source_of
from vibrosweep.model.measures import MEASURE_OF, UNDETERMINED, VARIABLES, Regime, Status, known
from vibrosweep.model.parameters import (
    STREAM,
    Dimensionless,
    Launches,
    dimensionless,
)
from vibrosweep.model.restitution_laws import CONSTANT
from vibrosweep.scene.scene import Scene
from vibrosweep.store.arranged import arranged

__all__ = ["FAILS", "HOLDS", "NAMES", "UNDETERMINED", "Condition", "Locked", "named"]

Codes = NDArray[np.int64]
FAILS, HOLDS = 0, 1  # codes of a decided condition
Points = dict[str, Array]  # restitution, and the forcing by its name, each of shape (point,)
STATES: Final = 3  # of a fixed orbit
# Codes of `locked` for which an orbit attracts; they include `HOLDS`, a code of other conditions
HOLDING: Final = frozenset(
    straight + STATES * turned
    for straight in (ABSENT, ATTRACTS, REPELS)
    for turned in (ABSENT, ATTRACTS, REPELS)
    if ATTRACTS in (straight, turned)
)
TRAJECTORIES_AT_A_TIME: Final = 1 << 18
FIXED_PER_TASK: Final = 256
REPLICAS: Final = 100
NEAR: Final = 0.25  # forcing periods by which a flight of a locked particle may differ from k
DIMS: Final = ("condition", "direction", "restitution", "scan")
COMMENT: Final = (
    "for locked(k) the share of replicas and particles that begin on the orbit and are locked at "
    "the end, 0 where there is no orbit; NaN where no replica is decided"
)


@dataclass(frozen=True)
class Condition:
    """A condition on the measured variables of a realization.

    Attributes
    ----------
    name
        Name in messages and files.
    holds
        Function from a dataset with the dimension ``realization`` to booleans, one for each.  The
        dataset holds the variables named below, the physical parameters as coordinates, and the
        attribute ``particles``.  Where one of these variables has no value, or the realization did
        not complete, the condition is undetermined, whatever the function returns; a function that
        decides this itself returns codes instead: `HOLDS`, `FAILS` or `UNDETERMINED`.
    variables
        The measured variables that `holds` reads.
    sentence
        Meaning of the condition, in one sentence.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import Condition
    >>> low = Condition("low", lambda ds: ds["rebound_height_max"] < 2.0, ("rebound_height_max",))
    >>> found = vs.windows(restitution=0.9, amplitude=[0.5, 1.0, 2.0, 3.0], conditions=[low])
    >>> found.condition.values.tolist()
    ['low']
    """

    name: str
    holds: Callable[[xr.Dataset], object]
    variables: tuple[str, ...]
    sentence: str = ""

    def __post_init__(self) -> None:
        unknown = [name for name in self.variables if name not in VARIABLES]
        if unknown:
            raise ParameterError(
                f"condition {self.name}: {unknown[0]} is not a measured variable; choose from "
                f"{', '.join(VARIABLES)}"
            )

    @property
    def code(self) -> str:
        """Name, digest of what the function computes, and its source where Python has it.

        The digest is left out for a function that uses values that could change.  Raises a
        ParameterError for a function with neither digest nor source.
        """
        function: Any = plain(self.holds)
        try:
            digest = (
                digest_of([function], f"condition {self.name}") if is_function(function) else ""
            )
        except ParameterError:
            digest = ""
        source = source_of(function)
        if not (digest or source):
            raise ParameterError(
                f"condition {self.name}: its function has no source and uses values that may "
                f"change, so that a result cannot state it; write it with def in a file"
            )
        return f"{self.name}: {digest}\n{source}".rstrip()

    @property
    def measures(self) -> dict[str, bool]:
        """Keys of the measures that the condition needs."""
        return {MEASURE_OF[name]: True for name in self.variables if name in MEASURE_OF}

    def judge(self, dataset: xr.Dataset) -> Codes:
        """Code for each realization of a dataset: `HOLDS`, `FAILS` or `UNDETERMINED`.

        Raises
        ------
        DataError
            The dataset lacks a variable that the condition reads.
        ParameterError
            The function does not give one boolean per realization.
        """
        dataset = arranged(dataset)
        require(dataset, f"condition {self.name}", *self.variables)
        size, held = dataset.sizes["realization"], np.asarray(self.holds(dataset))
        coded = held.dtype.kind == "i" and np.isin(held, (FAILS, HOLDS, UNDETERMINED)).all()
        if not (held.dtype == np.bool_ or coded) or held.shape != (size,):
            raise ParameterError(
                f"condition {self.name}: its function gave {held.dtype} of shape {held.shape}; it "
                f"must give one boolean per realization"
            )
        if coded:
            return held.astype(np.int64)
        decided = np.ones(size, np.bool_)
        if "status" in dataset:
            decided = dataset["status"].values == Status.COMPLETED
        for name in self.variables:
            decided = decided & known(name, dataset).reshape(size, -1).all(axis=1)
        return np.where(decided, np.where(held, HOLDS, FAILS), UNDETERMINED)


@dataclass(frozen=True)
class Locked:
    """Condition that the fixed orbit of k forcing periods exists and attracts.

    It may hold even if no launch leads to the orbit.  The orbit is found as a fixed point of the
    map (`vibrosweep.kernels.fixed`): near the edge of its window, a simulation would converge too
    slowly.
    """

    k: int

    @property
    def name(self) -> str:
        """Name in messages and files."""
        return f"locked({self.k})"

    @property
    def sentence(self) -> str:
        """Meaning of the condition, in one sentence."""
        return f"The locked orbit with one impact every {self.k} periods exists and attracts."


def _of_particles(holds: NDArray[np.bool_], decided: NDArray[np.bool_]) -> Codes:
    """Code of a condition on all particles; both arrays have shape (realization, particle)."""
    fails = (decided & ~holds).any(axis=1)
    return np.where(fails, FAILS, np.where(decided.all(axis=1), HOLDS, UNDETERMINED))


def _settled(dataset: xr.Dataset) -> NDArray[np.bool_]:
    """Mark particles known to follow an orbit of their regime; (realization, particle)."""
    return np.asarray(known("regime", dataset) & (dataset["regime"].values != Regime.UNSETTLED))


def _in_regimes(*regimes: Regime) -> Callable[[xr.Dataset], object]:
    def holds(dataset: xr.Dataset) -> object:
        return _of_particles(np.isin(dataset["regime"].values, regimes), _settled(dataset))

    return holds


def _regular(dataset: xr.Dataset) -> object:
    decided = _settled(dataset) & known("lyapunov_largest", dataset)
    return _of_particles(dataset["lyapunov_largest"].values < 0.0, decided)


def _separated(dataset: xr.Dataset) -> object:
    """Codes of separation, which holds for a single particle, and if no two particles landed."""
    gap, followed = dataset["dt_min"].values, known("base_shared", dataset)
    holds = np.isnan(gap) | (gap > dataset["contact_time"].values)
    decided = ~np.isnan(gap) | followed | (dataset.attrs["particles"] == 1)
    return _of_particles(holds[:, np.newaxis], decided[:, np.newaxis])


def _collision_free(dataset: xr.Dataset) -> object:
    free = dataset["collision_free"].values
    return np.full_like(free, HOLDS) if dataset.attrs["particles"] == 1 else free


NAMED: Final = {
    condition.name: condition
    for condition in (
        Condition(
            "ordered",
            _in_regimes(Regime.LOCKED),
            ("regime",),
            "The orbits of all particles repeat without a rest.",
        ),
        Condition(
            "periodic",
            _in_regimes(Regime.LOCKED, Regime.RESTING),
            ("regime",),
            "The orbits of all particles repeat, with rests or without.",
        ),
        Condition(
            "separated",
            _separated,
            ("dt_min", "base_shared"),
            "No two landings of different particles are closer than the contact time.",
        ),
        Condition(
            "collision_free",
            _collision_free,
            ("collision_free",),
            "No two particles are on the base at once in the window.",
        ),
        Condition(
            "regular",
            _regular,
            ("regime", "lyapunov_largest"),
            "The largest Lyapunov exponent of every particle is below zero.",
        ),
    )
}


NAMES: Final = ("locked(k)", *NAMED)


def named(name: str) -> Condition | Locked:
    """Return the condition of that name; raise a ParameterError if there is none."""
    mode = re.fullmatch(r"locked\(([1-9][0-9]{0,8})\)", name)
    if mode:
        return Locked(int(mode[1]))
    if name not in NAMED:
        raise ParameterError(
            f"condition {name!r} is not known; choose from {', '.join(NAMES)} with k = 1, 2, ..."
        )
    return NAMED[name]


def _dataset(scene: Scene, parameters: dict[str, Array], measured: dict[str, Any]) -> xr.Dataset:
    """Dataset that a condition takes: variables, parameters as coordinates, number of particles."""
    return xr.Dataset(
        {name: (VARIABLES[name].dims, v) for name, v in measured.items() if name in VARIABLES},
        coords={name: ("realization", values) for name, values in parameters.items()},
        attrs={"particles": scene.particles},
    )


def locked(scene: Scene, condition: Locked, points: Points, workers: Workers) -> Codes:
    """Code of the states of the fixed orbits at each point, shape (point,).

    An orbit is absent, attracting or repelling.  Under the law `reflect` there may be two orbits,
    one of them reflected at every impact, and the code combines both states.  Along the
    forcing each orbit is first absent, then attracting, then repelling, so that no code occurs in
    two intervals: between two points of the same code nothing changes.
    """
    problem = dimensionless(scene.parameters(points), scene.duration)

    def state(sign: float) -> Codes:
        return fixed_orbits(scene, condition.k, sign, problem, workers).state.astype(np.int64)

    straight = state(1.0)
    return straight + STATES * state(-1.0) if may_push_back(scene.rebound) else straight


def fixed_orbits(
    scene: Scene, k: int, sign: float, problem: Dimensionless, workers: Workers
) -> FixedOrbits:
    """Fixed orbits of k periods of each problem, without noise; `sign` as in `find_fixed`."""
    found, base = empty_fixed(problem.kick.size), base_of(*scene.mechanics)
    modes = np.full(problem.kick.size, k)
    workers.run(
        lambda first, last: find_fixed(first, last, base, problem, modes, sign, found),
        modes.size,
        FIXED_PER_TASK,
        found,
    )
    return found


def law_errors(scene: Scene, condition: Locked, points: Points) -> Array:
    """Relative error that a law of restitution adds to the end of a window at each point."""
    found = np.zeros(points["restitution"].size)
    if scene.restitution_law == CONSTANT or not found.size:
        return found
    problem = dimensionless(scene.parameters(points), scene.duration)
    end_errors(base_of(*scene.mechanics), problem, condition.k, found)
    return np.asarray(found / problem.kick)


def launched(scene: Scene, condition: Condition, points: Points, workers: Workers) -> Codes:
    """Code of a condition for the scene's launches at each point; shape (point,)."""
    held = [
        condition_codes(scene, condition, scene.parameters(piece), workers)
        for piece in in_pieces(points, scene.particles)
    ]
    return np.concatenate(held)


def in_pieces(points: Points, trajectories: int) -> Iterator[Points]:
    """Yield the points, each with that many trajectories, in pieces that take little memory."""
    size = max(1, TRAJECTORIES_AT_A_TIME // trajectories)
    for start in range(0, points["restitution"].size, size):
        yield {name: values[start : start + size] for name, values in points.items()}


def condition_codes(
    scene: Scene, condition: Condition, parameters: dict[str, Array], workers: Workers
) -> Codes:
    """Code of a condition for the scene's launches in each realization."""
    measured = measure(parameters, scene.only(**condition.measures), workers)
    return condition.judge(_dataset(scene, parameters, measured))


def continued(
    scene: Scene, condition: Condition, points: Points, states: States, workers: Workers
) -> tuple[Codes, States]:
    """Code of a condition for orbits continued from given states, and their final states.

    Raises a ParameterError for a condition on launches, which a continued orbit does not have.
    """
    parameters = scene.parameters(points)
    orbits = settle_from(scene, parameters, states, workers)
    measured = orbit_variables(orbits, parameters["frequency"])
    del measured["recurrent_from"]  # counts from the last point, not from the launch
    lacking = [name for name in condition.variables if name not in measured]
    if lacking:
        raise ParameterError(
            f"condition {condition.name} reads {lacking[0]}, which depends on the launches: it "
            f"cannot be continued along the forcing; leave continuation out"
        )
    held = condition.judge(_dataset(scene, parameters, measured))
    return held, reached(orbits, scene.particles)


class Trials(NamedTuple):
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
        """Shares with their intervals, as variables of a dataset."""
        share, low, high = (one.reshape(shape) for one in shares(self.held, self.tried))
        words = "share of replicas in which the condition holds"
        ends = "end of the 95 % interval of the share"
        return {
            "share": variable(DIMS, share, words, comment=COMMENT),
            "share_low": variable(DIMS, low, f"lower {ends}"),
            "share_high": variable(DIMS, high, f"upper {ends}"),
        }


def share_of(
    scene: Scene, condition: Condition | Locked, points: Points, replicas: int, workers: Workers
) -> Trials:
    """Count the trials in which a condition holds at each point."""
    share = _locked if isinstance(condition, Locked) else _launched
    found = [
        share(scene, condition, piece, replicas, workers)  # type: ignore[arg-type]
        for piece in in_pieces(points, scene.particles * replicas)
    ]
    return Trials(*(np.concatenate(part) for part in zip(*found, strict=True)))


def _repeated(parameters: Mapping[str, Array], replicas: int) -> dict[str, Array]:
    """Parameters of every replica of the realizations, with its stream of random numbers."""
    found = {name: np.repeat(values, replicas) for name, values in parameters.items()}
    size = parameters["restitution"].size
    return found | {STREAM: np.tile(np.arange(replicas, dtype=np.float64), size)}


def _launched(
    scene: Scene, condition: Condition, points: Points, replicas: int, workers: Workers
) -> Trials:
    """Count the replicas of the scene's launches in which a condition holds."""
    parameters = _repeated(scene.parameters(points), replicas)
    codes = condition_codes(scene, condition, parameters, workers).reshape(-1, replicas)
    held, tried = (codes == HOLDS).sum(axis=1), (codes != UNDETERMINED).sum(axis=1)
    return Trials(held.astype(np.float64), tried.astype(np.float64))


def _locked(
    scene: Scene, condition: Locked, points: Points, replicas: int, workers: Workers
) -> Trials:
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
        batch = batch_of(noisy, launch, scene)
        found = statistics(batch, scene, workers, more=(SHORTEST, LONGEST))
        stays = (found.landings > 0) & (found.totals[RESTS] == 0.0)
        stays &= (found.total("flight_min") > k - NEAR) & (found.total("flight_max") < k + NEAR)
        stays &= found.status == Status.COMPLETED
        held[alive] = stays.reshape(alive.sum(), -1).sum(axis=1)
    if "drive_noise" in parameters:
        held, trials = held / trials, 1
    return Trials(held, np.full(phase.size, float(replicas * trials)))


def _from_orbit(
    scene: Scene, parameters: dict[str, Array], phase: Array, k: float
) -> tuple[Dimensionless, Launches]:
    """Problem and launches of particles that begin with a flight of k periods at a phase.

    Over any base that flight begins and ends at the same height: its absolute speed is k g / 2 f.
    """
    parameters["phase"] = np.zeros_like(phase)  # the phase is that of the forcing
    problem = dimensionless(parameters, scene.duration, scene.measures.transient)
    shape = phase.size, scene.particles
    at = np.array(np.broadcast_to(phase[:, np.newaxis], shape))  # can be written, as all launches
    return problem._replace(launch_flight=np.full(phase.size, k)), Launches(np.zeros(shape), at)
