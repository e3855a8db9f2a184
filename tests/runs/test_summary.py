import re
from itertools import pairwise

import numpy as np
import pytest

from vibrosweep.model.measures import OF_REALIZATIONS, Status
from vibrosweep.runs.result import Summary

COUNTS = np.array([3, 4, 5])
HEIGHTS = np.array([1.0, np.nan, 2.5])
CODES = np.array([0, 0, 1], np.int8)


def chunk(first, last):
    rows = slice(first, last)
    return {
        "impact_count": COUNTS[rows],
        "rebound_height_max": HEIGHTS[rows],
        "dt_min": np.full(3, np.nan)[rows],
        "landing_time_error": np.array([1e-9, np.inf, 1e-8])[rows],
        "status": CODES[rows],
        "particle_status": np.zeros((3, 2))[rows],
    }


def lines(*cuts):
    summary = Summary()
    for first, last in pairwise(cuts):
        summary.add(chunk(first, last))
    return summary, list(summary.lines())


def test_a_sum_of_landings_has_every_unit():
    """Each count fits into a double, but their sum neither into a double nor into 64 bits."""
    counts = np.full(3000, 2**53 - 1)
    summary = Summary()
    summary.add({"impact_count": counts, "status": np.zeros(3000, np.int8)})
    assert summary.landings == 3000 * (2**53 - 1)


def test_a_table_of_what_is_known():
    summary, text = lines(0, 3)
    assert (summary.realizations, summary.landings) == (3, 12)
    assert [line.split() for line in text[:5]] == [
        ["min", "mean", "max"],
        ["impact_count", "3", "4", "5"],
        ["rebound_height_max", "(m)", "1", "1.75", "2.5", "undefined", "in", "1"],
        ["dt_min", "(s)", "undefined", "in", "every", "realization"],
        ["landing_time_error", "(s)", "1e-09", "5.5e-09", "1e-08", "inf", "in", "1"],
    ]
    assert text[5].split(maxsplit=1) == [
        "status",
        "completed 2 (66.7%), budget_exceeded 1 (33.3%)",
    ]
    assert text[6] == f"budget_exceeded: {Status.BUDGET_EXCEEDED.sentence}"
    assert len(text) == 7


def test_chunks_add_up():
    assert lines(0, 1, 3)[1] == lines(0, 1, 2, 3)[1] == lines(0, 3)[1]


def test_columns_stand_below_their_heads():
    head, *rows = lines(0, 3)[1]
    assert (
        len({len(re.split("   (undefined|inf) in", row)[0]) for row in (head, rows[0], rows[1])})
        == 1
    )


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ([-np.inf, -np.inf], "-inf in every realization"),
        ([np.nan, np.nan], "undefined in every realization"),
        ([-np.inf, np.nan], "-inf in 1, undefined in 1"),
        ([-np.inf, np.inf], "-inf in 1, inf in 1"),
        ([-np.inf, 2.0], "2 2 2 -inf in 1"),
        ([np.nan, 2.0], "2 2 2 undefined in 1"),
        ([2.0, 2.0], "2 2 2"),
    ],
)
def test_infinite_and_undefined_values_are_told_apart(values, said):
    """An infinite number is not undefined; the division into chunks plays no part."""
    summary = Summary()
    for value in values:
        one = {"impact_count": np.ones(1, np.int64), "lyapunov_max": np.array([value])}
        summary.add(one)
    line = next(text for text in summary.lines() if text.startswith("lyapunov_max"))
    assert line.split() == ["lyapunov_max", "(per", "impact)", *said.split()]


def test_an_empty_summary_is_not_an_error():
    assert len(list(Summary().lines())) == 1


@pytest.mark.parametrize("name", sorted(OF_REALIZATIONS))
def test_codes_for_no_value_enter_no_mean(name):
    variable = OF_REALIZATIONS[name]
    if variable.flags:
        return  # codes are counted, each by its name
    none = np.nan if variable.dtype == "float64" else 0 if variable.cycle else -1
    measured = {"impact_count": np.array([2, 4]), variable.cycle or name: np.array([none, 6.0])}
    measured[name] = np.array([none, 6.0]).astype(variable.dtype)
    summary = Summary()
    summary.add(measured)
    (line,) = [line for line in summary.lines() if line.split()[:1] == [name]]
    assert line.split()[-6:] == ["6", "6", "6", "undefined", "in", "1"]
