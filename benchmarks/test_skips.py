"""What is saved by not doing it; run with ``pytest benchmarks/test_skips.py -s``."""

from __future__ import annotations

import numpy as np

from test_kernels import THREADS, scene
from vibrosweep.kernels.cycles import empty_cycles
from vibrosweep.kernels.ordering import workspace
from vibrosweep.kernels.separation import separate
from vibrosweep.sweep.following import statistics
from vibrosweep.sweep.workers import Workers


def recognising(realizations, periods, workers):
    """Trajectories of the paper's ranges, those that recur followed no further."""
    problem, launch, observation = scene(realizations, 20, periods)
    return lambda: statistics(
        problem, launch, observation, workers, empty_cycles(realizations * 20)
    )


def following(realizations, periods, workers):
    problem, launch, observation = scene(realizations, 20, periods)
    return lambda: statistics(problem, launch, observation, workers)


def test_recurrence_at_a_thousand_periods(race):
    with Workers(THREADS) as workers:
        ratio = race(recognising(200, 1e3, workers), following(200, 1e3, workers))
    assert ratio >= 3.0


def test_recognition_over_a_short_horizon(race):
    """Too short to gain: a fifth of the orbits, those that rest, recur, and are classified."""
    with Workers(THREADS) as workers:
        race(recognising(20_000, 12.0, workers), following(20_000, 12.0, workers))


def test_a_million_periods_against_a_thousand(race):
    """Those few trajectories that never recur are followed to the end; their cost is honest."""
    with Workers(THREADS) as workers:
        race(recognising(200, 1e6, workers), recognising(200, 1e3, workers))


def test_separation_against_the_trajectories_alone(race):
    """The time of separations, as a multiple of the streaming statistics; 100 particles."""
    realizations, particles = 1000, 100
    problem, launch, observation = scene(realizations, particles, 12.0)
    gap, same = np.empty(realizations), np.empty(realizations)
    shared, complete = np.empty(realizations, np.int8), np.ones(realizations, bool)
    with Workers(THREADS) as workers:

        def separations():
            workers.each(
                lambda a, b: separate(
                    a,
                    b,
                    problem,
                    launch,
                    complete,
                    None,
                    None,
                    workspace(particles),
                    gap,
                    same,
                    shared,
                ),
                realizations,
                10,
            )

        landings = int(statistics(problem, launch, observation, workers).landings.sum())
        race(
            separations,
            lambda: statistics(problem, launch, observation, workers),
            work_subject=landings,
            work_reference=landings,
        )
