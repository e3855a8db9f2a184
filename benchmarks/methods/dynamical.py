"""pynamicalsys: the same map through its own ensemble call."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numba
import numpy as np
from numba import njit
from pynamicalsys import DiscreteDynamicalSystem

from loops import LANES, bare_map, lanes
from methods.compiled import MARGIN, count_landings
from methods.scenes import Point, Sweep, table
from methods.timing import medians, timed
from vibrosweep.engine.workers import Workers
from vibrosweep.model.parameters import PARAMETERS

PYNAMICALSYS = "pynamicalsys"
GRAVITY, VELOCITY = (list(PARAMETERS).index(name) for name in ("gravity", "launch_velocity"))


@njit
def _impact(state, parameters):
    """From lift-off to lift-off under the `rest` law; the state is running time and velocity."""
    e, amplitude, frequency, phi, gravity, _, contact, _ = parameters
    t, v = state
    t += 2.0 * v / gravity
    angle = 2.0 * np.pi * frequency * t + phi
    w = e * v + amplitude * np.sin(angle)
    rest = 0.5 * gravity * contact
    if w > rest:
        return np.array([t, w])
    wait = (np.arcsin(rest / amplitude) - angle) % (2.0 * np.pi)
    return np.array([t + wait / (2.0 * np.pi * frequency), rest])


def _starts(rows: np.ndarray) -> np.ndarray:
    """States at launch, shape (trajectory, 2)."""
    return np.ascontiguousarray(rows[:, [-1, VELOCITY]])


def ensemble(sweep: Sweep, sizes: list[int], threads: int) -> Iterator[Point]:
    """One call per realization, because a call takes one parameter set; it keeps all states.

    A call takes a number of impacts, not an end: here as many as the longest trajectory needs.
    """
    system = DiscreteDynamicalSystem(
        mapping=_impact, system_dimension=2, number_of_parameters=len(PARAMETERS) + 1
    )
    times = []
    for row in table(sweep.cases):
        impacts = int(count_landings(row[None], sweep.duration + MARGIN, sweep.reflect)[0])
        states = system.trajectory(_starts(row[None]), impacts, parameters=row)
        left = np.concatenate([_starts(row[None]), states[:-1]])
        times.append(left[:, 0] + 2.0 * left[:, 1] / row[GRAVITY])
    counts = count_landings(sweep.table, sweep.duration, sweep.reflect)
    by_realization = sweep.table.reshape(sweep.realizations, sweep.particles, -1)
    longest = counts.reshape(sweep.realizations, -1).max(axis=1)
    calls = [(_starts(r), int(n), r[0]) for r, n in zip(by_realization, longest, strict=True)]

    def run() -> None:
        for start, impacts, row in calls:
            system.trajectory(start, impacts, parameters=row)

    by_threads = {}
    for used in {1, threads}:  # short calls are over before a second thread has joined
        numba.set_num_threads(used)
        run()
        by_threads[used] = timed(run, threads)[1]
    used = min(by_threads, key=by_threads.__getitem__)
    landings = int(counts.sum())
    steps = int(longest.sum()) * sweep.particles / landings
    note = f"one call per realization; {steps:.2g} times the landings, for want of an end"
    run_of = (used, sweep.lanes, landings, by_threads[used], times)
    yield Point(sweep.key, PYNAMICALSYS, "", *run_of, note)


@njit
def _bare_as_its_models(state, parameters):
    """The map without rests, written as the models of pynamicalsys are."""
    e, a = parameters
    x, u = state
    x_new = (x + u) % 1
    u_new = e * u + a * np.sin(2 * np.pi * x_new)
    return np.array([x_new, u_new])


@njit
def _bare_reduced(state, parameters):
    """The map without rests, with the cheaper reduction that this package uses."""
    x = state[0] + state[1]
    x -= np.rint(x)
    return np.array([x, parameters[0] * state[1] + parameters[1] * np.sin(2.0 * np.pi * x)])


BARE = {"default": (_bare_as_its_models, True), "fastest": (_bare_reduced, False)}


class BareMap:
    """The bare map of this package and pynamicalsys' ensemble call, on as many threads.

    Both advance 256 trajectories for each thread.  pynamicalsys' ways are: `default`, the map
    written as its own models are and every state stored, as it does by default; and
    `fastest`, with the cheaper reduction of this package's map and only the last states stored.

    Parameters
    ----------
    threads
        Number of threads.
    impacts, their_impacts
        Impacts of each trajectory in a call of each.  By default both calls last about a tenth of
        a second, which hides the start of threads.
    """

    def __init__(self, threads: int, impacts: int = 400_000, their_impacts: int = 4000) -> None:
        numba.set_num_threads(threads)
        self.threads, self.impacts, self.their_impacts = threads, impacts, their_impacts
        self.trajectories = threads * LANES
        self._state = [lanes() for _ in range(threads)]
        self._workers = Workers(threads)
        rng = np.random.default_rng(1)
        ranges = ((0.0, 1.0), (0.0, 3.0))
        self._start = np.column_stack([rng.uniform(*r, self.trajectories) for r in ranges])

    def ours(self) -> None:
        """This package's map."""
        self._workers.run(lambda i, _: bare_map(self._state[i], self.impacts), self.threads, 1)

    def theirs(self, way: str) -> Callable[[], np.ndarray]:
        """pynamicalsys' call in one of its ways."""
        mapping, keep = BARE[way]
        system = DiscreteDynamicalSystem(
            mapping=mapping, system_dimension=2, number_of_parameters=2
        )
        left_out = None if keep else self.their_impacts - 1
        return lambda: system.trajectory(
            self._start, self.their_impacts, parameters=[0.9, 0.24], transient_time=left_out
        )


def bare_points(threads: int) -> list[Point]:
    """Points of the bare map and both ways of pynamicalsys, timed in turn, errors unknown."""
    bare = BareMap(threads)
    seconds = medians(bare.ours, *(bare.theirs(way) for way in BARE))
    runs = [("vibrosweep", "", bare.impacts)]
    runs += [(PYNAMICALSYS, way, bare.their_impacts) for way in BARE]
    size = bare.trajectories
    return [
        Point("bare", name, way, threads, size, size * impacts, taken, [])
        for (name, way, impacts), taken in zip(runs, seconds, strict=True)
    ]
