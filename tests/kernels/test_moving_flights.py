"""Landings on the moving base against a search that cannot miss one (checks/first_roots.py)."""

import math

import numpy as np
import pytest

from first_roots import (
    LARGEST_ERROR,
    MOST_GRAZES,
    Flights,
    clearance,
    first_root,
    judge,
    lift_offs,
    touching,
    wide,
)


@pytest.mark.parametrize("draw", [wide, lift_offs, touching])
def test_no_first_landing_is_missed(draw):
    found = judge(draw(20_000, np.random.default_rng(7)), threads=1)
    assert not found.missed.any()
    assert np.nanmax(found.error) <= LARGEST_ERROR
    assert np.nanmax(found.speed_error) <= LARGEST_ERROR


def test_a_search_that_could_go_round_in_a_circle_ends():
    """The clearance almost touches zero before the only root: steps from there go far beyond it."""
    flights = [
        (3.302346846384233, -0.43936362171441556, 1.5382503131016738),
        (3.316581779056401, -0.44437260812262924, 1.5150245044985238),
        (3.2723546059369837, -0.4267990149481009, 1.5932871441334888),
        (3.775636337046582, 0.4143900441613707, 0.6750001320711176),
        (3.8301911075977197, 0.39186915745876116, 0.5458878846101514),
    ]
    gamma, x, y = np.array(flights).T
    found = judge(Flights(gamma / math.pi, x.copy(), y.copy()), threads=1)
    assert not found.missed.any()
    assert np.max(found.error) <= LARGEST_ERROR
    assert np.max(found.speed_error) <= LARGEST_ERROR


def test_the_search_finds_the_first_change_of_sign_of_a_fine_scan():
    flights = wide(300, np.random.default_rng(8))
    for alpha, x, y in zip(*flights, strict=True):
        root, undecided = first_root(alpha, x, y, np.empty((MOST_GRAZES, 2)))
        assert undecided == 0
        # from a tenth of the earliest possible root on, with steps in proportion to the root
        s = np.linspace(0.1 * y / (1.0 + math.pi * alpha), 1.0001 * root, 20_000)
        turned = 2.0 * math.pi * s
        values = s * (y - s) / 2.0 + alpha / (4.0 * math.pi) * (
            math.sin(2.0 * math.pi * x) * (turned - np.sin(turned))
            - math.cos(2.0 * math.pi * x) * 2.0 * np.sin(0.5 * turned) ** 2
        )
        assert (values[s < 0.9999 * root] > 0.0).all()
        assert values[-1] < 0.0


def test_a_clearance_that_touches_zero_is_undecided():
    flights = touching(2_000, np.random.default_rng(9))
    grazes = np.empty((MOST_GRAZES, 2))
    seen = 0
    for alpha, x, y in zip(*flights, strict=True):
        _, undecided = first_root(alpha, x, y, grazes)
        for left, right in grazes[:undecided]:
            value, noise, _, _ = clearance(alpha, x, y, 0.5 * (left + right))
            assert abs(value) <= 100.0 * noise
            seen += 1
    assert seen > 100
