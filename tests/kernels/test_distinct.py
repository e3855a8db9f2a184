"""The search for identical realizations, against a comparison of all pairs."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep.kernels.distinct import first_of_each
from vibrosweep.model.parameters import Launches

NUMBERS = st.sampled_from([0.0, -0.0, 1.0, np.nextafter(1.0, 2.0), -1.0, np.inf])
SHARED = Launches(np.zeros((1, 2)), np.zeros((1, 2)))


@given(st.lists(st.tuples(NUMBERS, NUMBERS), min_size=1, max_size=60))
def test_the_first_of_equal_columns(columns):
    columns = np.array(columns).T.copy()
    first = np.empty(columns.shape[1], np.int64)
    found = first_of_each(columns, SHARED, first)
    names = [column.tobytes() for column in columns.T]
    assert first.tolist() == [names.index(name) for name in names]
    assert found == len(set(names))


@pytest.mark.parametrize("field", ["whole", "phase"])
def test_launches_are_compared_where_they_differ(field):
    columns = np.zeros((3, 4))
    launches = Launches(np.zeros((4, 5)), np.zeros((4, 5)))
    getattr(launches, field)[2:, 4] = 0.25
    first = np.empty(4, np.int64)
    assert first_of_each(columns, launches, first) == 2
    assert first.tolist() == [0, 0, 2, 2]


def test_many_at_once():
    rng = np.random.default_rng(1)
    columns = rng.uniform(size=(10, 50_000))
    columns[:, 25_000:] = columns[:, rng.permutation(25_000)]
    first = np.empty(50_000, np.int64)
    assert first_of_each(columns, SHARED, first) == 25_000
    assert np.array_equal(columns[:, first], columns)
