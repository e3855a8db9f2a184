"""Time saved by skipping work; run with ``pytest benchmarks/test_skips.py -s``.

The subject skips, the reference simulates everything.
"""

from __future__ import annotations

import numpy as np
import pytest

from methods.scenes import paper_parameters
from test_kernels import THREADS
from vibrosweep.engine import measure as engine
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import PARAMETERS, dimensionless, launches
from vibrosweep.scene.scene import Scene


def observed(particles=20, duration=1e3, base="high-bounce", skip=True, **keys):
    return Scene(particles, "staggered", duration, "rest", Measures(**keys), skip, base)


def drawn(realizations, **given):
    """Random parameters from the ranges of sweeps/paper.toml; given ones replace them."""
    rng = np.random.default_rng(3)
    values = {
        "restitution": rng.uniform(0.80, 0.98, realizations),
        "amplitude": rng.uniform(0.2, 3.5, realizations),
    } | given
    return {
        name: np.broadcast_to(np.asarray(values.get(name, p.default), float), realizations).copy()
        for name, p in PARAMETERS.items()
    }


def measuring(parameters, workers, particles=20, **options):
    """Return a function that measures a batch; `skip` is one of the options."""
    return lambda: measure(parameters, observed(particles, **options), workers)


def skipping(race, parameters, **options):
    """Race skipping against simulating everything."""
    with Workers(THREADS) as workers:
        subject, reference = (
            measuring(parameters, workers, skip=skip, **options) for skip in (True, False)
        )
        return race(subject, reference)


def test_recurrence_at_a_thousand_periods(race):
    assert skipping(race, drawn(200)) >= 2.0


def test_separations_at_a_thousand_periods(race):
    assert skipping(race, drawn(200), separation=True) >= 1.0


def test_separations_at_ten_thousand_periods(race):
    assert skipping(race, drawn(50), separation=True, duration=1e4) >= 4.0


def test_nothing_to_skip_over_a_short_horizon(race):
    """Nothing recurs in time: skipping must cost nothing."""
    assert skipping(race, drawn(20_000), duration=12.0) >= 0.9


@pytest.mark.parametrize("regimes", [False, True])
def test_detection_over_a_short_horizon(race, monkeypatch, regimes):
    """Cost of looking for recurrence, and with regimes of counting the few cycles found in time."""
    monkeypatch.setattr(engine, "PERIODS_TO_RECUR", 0.0)
    parameters = drawn(20_000)
    scene = observed(duration=12.0, regimes=regimes)
    problem = dimensionless(parameters, 12.0, 0.0)
    launch = launches("staggered", 20, parameters["frequency"])
    with Workers(THREADS) as workers:
        cycles = workers.cycles(400_000)
        ratio = race(
            lambda: engine.statistics(
                engine.batch_of(problem, launch, scene), scene, workers, cycles
            ),
            lambda: engine.statistics(engine.batch_of(problem, launch, scene), scene, workers),
        )
    assert ratio >= (0.8 if regimes else 0.85)


def test_a_million_periods_against_a_thousand(race):
    """Every orbit of these realizations recurs; a chaotic one would be simulated to the end."""
    with Workers(THREADS) as workers:
        late, early = (
            measuring(drawn(200), workers, duration=periods, separation=True, regimes=True)
            for periods in (1e6, 1e3)
        )
        ratio = race(late, early)
    assert ratio >= 1.0 / 3.0


def test_a_million_periods_with_chaos_against_a_thousand(race):
    """Nine trajectories of one realization never recur, so that all their impacts are computed."""
    rng = np.random.default_rng(1)
    ranges = {"restitution": rng.uniform(0.80, 0.98, 200), "amplitude": rng.uniform(0.2, 3.5, 200)}
    with Workers(THREADS) as workers:
        late, early = (
            measuring(drawn(200, **ranges), workers, duration=periods, separation=True)
            for periods in (1e6, 1e3)
        )
        race(late, early)


def test_separation_against_the_trajectories_alone(race):
    """The time of separations, as a multiple of the streaming statistics; 100 particles."""
    parameters = paper_parameters(1000)
    with Workers(THREADS) as workers:
        both, alone = (
            measuring(parameters, workers, particles=100, duration=12.0, separation=asked)
            for asked in (True, False)
        )
        landings = int(alone()["impact_count"].sum())
        race(both, alone, work_subject=landings, work_reference=landings)
