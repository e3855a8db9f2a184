"""Finite contact times and scatter of the restitution, over a sinusoidally moving base."""

import numpy as np
import pytest

from vibrosweep.lab.ballistics import Input
from vibrosweep.lab.base_fit import Contacts, Inputs, Oscillation, fit_base
from vibrosweep.lab.flights import Fits, meet
from vibrosweep.lab.paths import compress

G, NOISE, FRAMES, HALF = 9.81, 1e-4, 20.0, 0.04
TRUTH = np.array([0.7, 0.12, 0.09])  # e, S and C
ANY = Input(0.0, 5e-3)  # s
BASE = Oscillation(np.array([*TRUTH[1:], 20.0]))


def bounces(lasting, scatter, number=200):
    """Bounces at random phases between flights known with noise."""
    rng = np.random.default_rng(7)
    lands = np.sort(rng.uniform(0.0, 20.0, number))
    leaves, towards = lands.copy(), rng.uniform(0.2, 0.8, number)
    away = (TRUTH[0] + scatter * rng.standard_normal(number)) * towards
    for k in range(number if lasting else 0):

        def push(since, k=k):
            down = G + float(BASE.acceleration(lands[k] + lasting * since))
            return down * lasting / towards[k]

        run = compress(away[k] / towards[k], "dashpot", push)
        leaves[k] += lasting * run.t[-1]
        away[k] = -towards[k] * run.y[1, -1]
    flights = []
    for time, speed, way in (
        (lands, BASE.velocity(lands) - towards, -1.0),
        (leaves, BASE.velocity(leaves) + away, 1.0),
    ):
        since = -way * HALF  # from the middle of the flight to its end on the base
        slope = speed + G * since
        level = BASE.height(time) - since * (slope - 0.5 * G * since)
        spread = FRAMES * (2.0 * HALF) ** 2 / 12.0
        level += NOISE / np.sqrt(FRAMES) * rng.standard_normal(number)
        slope += NOISE / np.sqrt(spread) * rng.standard_normal(number)
        same = np.ones(number)
        flights.append(
            Fits(FRAMES * same, time - since, spread * same, level, slope, 18.0 * NOISE**2 * same)
        )
    before, after = flights
    met = meet(before, after, lands, G)
    arrival = before.slope - G * (met.time - before.centre)
    owner, linked = np.zeros(number, np.intp), np.zeros(number, bool)
    departure = arrival + met.closing
    return Contacts(
        before, after, owner, linked, met.time, met.height, arrival, departure, NOISE, G
    )


@pytest.mark.parametrize("lasting", [0.0, 5e-4, 2e-3])
@pytest.mark.parametrize("scatter", [0.0, 0.003, 0.012])
def test_contact_and_scatter_are_found_and_bias_nothing(lasting, scatter):
    """Four standard errors, and the upper limit of the scatter: chance failures are negligible."""
    found = fit_base(
        bounces(lasting, scatter),
        20.0,
        free=False,
        moves=True,
        inputs=Inputs(Input(G), contact=ANY),
    )
    error = np.sqrt(np.diag(found.covariance))
    assert (np.abs(found.values[:3] - TRUTH) < 4.0 * error[:3]).all()
    assert abs(found.values[-1] - lasting) < 4.0 * error[-1]
    assert error[-1] < 1e-4
    assert scatter <= found.scatter_limit < 1.3 * scatter + 2e-3
    assert found.problem.scatter == pytest.approx(scatter, abs=0.2 * scatter + 1e-3)
    assert found.used.mean() > 0.95
