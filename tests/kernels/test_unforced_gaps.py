"""Separations without excitation, against all pairs of landings in rational arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibrosweep.scene import PARAMETERS, dimensionless
from vibrosweep.sweep import following
from vibrosweep.sweep.engine import measure
from vibrosweep.sweep.observation import Observation
from vibrosweep.sweep.workers import Workers


def measured(launch, duration, transient=0.0, **given_):
    observation = Observation(
        particles=len(launch),
        launch=tuple(launch),
        duration=duration,
        rebound="rest",
        transient=transient,
        separation=True,
        per_particle=False,
        regimes=False,
        trust=False,
        tolerance=1e-9,
        impact_budget=10_000,
    )
    parameters = {
        name: np.array([given_.get(name, p.default)], float) for name, p in PARAMETERS.items()
    }
    with Workers(1) as workers:
        found = measure(parameters | {"amplitude": np.zeros(1)}, observation, workers)
    return found, dimensionless(parameters | {"amplitude": np.zeros(1)}, duration, transient)


def exact(problem, launch, begin, end):
    """Both smallest separations, and whether any landing is within rounding of the window's edges.

    One forcing period is 1 s, so that launches are exact.
    """
    e, u, r = (
        Fraction(float(v[0]))
        for v in (problem.restitution, problem.launch_flight, problem.rest_flight)
    )
    series, flight, total = [], u, Fraction(0)
    while True:
        total += flight
        flight *= e
        series.append(total)
        if flight <= r:
            break
    near_rest = any(abs(u * e**n / r - 1) < 1e-9 for n in (len(series), len(series) - 1) if e > 0)
    times = [[Fraction(t) + s for s in series] for t in launch]
    edge = min(abs(t - Fraction(w)) for row in times for t in row for w in (begin, end))
    inside = [[begin <= t <= end for t in row] for row in times]
    every = [
        abs(times[p][k] - times[q][m])
        for p in range(len(launch))
        for q in range(p)
        for k in range(len(series))
        for m in range(len(series))
        if inside[p][k] and inside[q][m]
    ]
    same = [
        abs(times[p][k] - times[q][k])
        for p in range(len(launch))
        for q in range(p)
        for k in range(len(series))
        if inside[p][k] and inside[q][k]
    ]
    gaps = [float(min(values)) if values else np.nan for values in (every, same)]
    return gaps, near_rest or edge < 1e-9


@settings(max_examples=60)
@given(
    e=st.sampled_from([0.0, 0.05, 0.5, 0.8, 0.9]),
    launch=st.lists(st.floats(0.0, 3.0), min_size=2, max_size=4),
    transient=st.sampled_from([0.0, 0.7, 4.0]),
    length=st.floats(0.0, 20.0),
)
def test_the_gaps_are_those_of_all_pairs(e, launch, transient, length):
    end = transient + length
    found, problem = measured(
        launch, end, transient, restitution=e, launch_velocity=5.0, contact_time=0.01
    )
    (every, same), at_edge = exact(problem, launch, Fraction(transient), Fraction(end))
    if not at_edge:
        # each instant is a power, a product and a quotient before the limit of the series
        limit = problem.launch_flight[0] / (1.0 - e)
        np.testing.assert_allclose(found["dt_min"][0], every, rtol=0.0, atol=6e-16 * (limit + 1.0))
        # that of two launches, phases in [-1/2, 1/2]
        np.testing.assert_allclose(found["dt_min_same_index"][0], same, rtol=1e-15, atol=3e-16)


def test_particles_at_rest_share_the_base():
    found, _ = measured([0.0, 0.3], 100.0, restitution=0.5)
    assert found["base_shared"].tolist() == [1]
    found, _ = measured([0.0, 0.3], 0.5, restitution=0.5)
    assert found["base_shared"].tolist() == [0]


def test_one_rests_when_the_window_begins_and_the_other_lands():
    """The first has rested for 90 s when the other lands."""
    found, _ = measured([0.0, 100.0], 101.5, transient=99.0, restitution=0.5)
    assert found["base_shared"].tolist() == [1]
    assert np.isnan(found["dt_min"][0])


@pytest.mark.parametrize("particles", [2, 200, 1500])
def test_many_particles(particles):
    """More landings than a list holds, in more than one block."""
    launch = np.arange(particles) / particles
    found, _ = measured(launch, 60.0, restitution=0.9, contact_time=1e-3)
    np.testing.assert_allclose(found["dt_min_same_index"][0], 1.0 / particles, rtol=1e-12)
    assert 0.0 <= found["dt_min"][0] <= 1.0 / particles
    assert found["base_shared"].tolist() == [1]


def test_nothing_is_followed(monkeypatch):
    monkeypatch.setattr(following, "advance", None)
    calls = []
    separate = following.separate
    monkeypatch.setattr(following, "separate", lambda *a: calls.append(a[6].any()) or separate(*a))
    measured([0.0, 0.3], 10.0)
    assert calls == [False]
