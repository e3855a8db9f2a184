"""Landings on the moving base against a search that cannot miss one (checks/first_roots.py)."""

import math

import numpy as np
import pytest

from first_roots import (
    LARGEST_ERROR,
    MOST_GRAZES,
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


def test_the_search_finds_the_first_change_of_sign_of_a_fine_scan():
    flights = wide(300, np.random.default_rng(8))
    for alpha, x, y in zip(*flights, strict=True):
        root, undecided = first_root(alpha, x, y, np.empty((MOST_GRAZES, 2)))
        assert undecided == 0
        # from a tenth of the earliest root on, as dense as the root is early
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
