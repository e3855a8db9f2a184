"""Realizations that are the same problem are found, and no others."""

import numpy as np

from vibrosweep.engine.measure import find_equal
from vibrosweep.model.parameters import dimensionless, launches


def test_a_grid_of_different_problems_shares_nothing(parameters):
    e, amplitude = np.meshgrid([0.5, 0.7, 0.9], [0.5, 1.0, 2.0])
    grid = parameters(restitution=e.ravel(), amplitude=amplitude.ravel())
    problem = dimensionless(grid, 10.0, 0.0)
    assert find_equal(problem, launches((0.0, 0.25), 2, grid["frequency"])) is None


def test_equal_problems_are_found_unless_something_else_differs(parameters):
    twice = parameters(restitution=[0.5, 0.7, 0.5, 0.7])
    problem = dimensionless(twice, 10.0, 0.0)
    launch = launches((0.0, 0.25), 2, twice["frequency"])
    assert find_equal(problem, launch).tolist() == [0, 1, 0, 1]
    tolerance = np.array([1.0, 1.0, 1.0, 2.0])
    assert find_equal(problem, launch, tolerance).tolist() == [0, 1, 0, 3]
