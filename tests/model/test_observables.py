"""Observables: what is refused, what identifies a function, units, and sums over particles."""

import math
import operator
import pickle
from functools import reduce

import numpy as np
import pytest

from vibrosweep.errors import ParameterError
from vibrosweep.model.observables import Observable, observables_of

BINS = 8


def count(totals, landing):
    totals[0] += 1.0


def spread(totals, landing):
    totals[int((landing.phase + 0.5) * BINS) % BINS] += math.fabs(landing.arrival)


def make(function=count, **changes):
    given = {"name": "seen", "meaning": "landings"} | changes
    return Observable(function=function, **given)


def defined(text, **outside):
    """Define the function f of this text in a module with these globals."""
    names = dict(outside)
    exec(text, names)
    return names["f"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"name": "impact_count"}, "name = 'impact_count' "),
        ({"name": "two words"}, "name = 'two words' "),
        ({"along": "particle", "values": (1.0,)}, "along = 'particle' "),
        ({"along": "seen", "values": (1.0,)}, "must be another word than the name"),
        ({"function": len}, "must be a Python function"),
        ({"function": lambda totals: None}, "must take two arguments"),
        ({"meaning": " "}, "must say in words"),
        ({"units": "kg"}, "units = 'kg' "),
        ({"along": "bin"}, "along must be given with values"),
        ({"values": (1.0,)}, "along must be given with values"),
        ({"along": "bin", "values": (2.0, 1.0)}, "numbers that increase"),
        ({"along": "bin", "values": (1.0, math.inf)}, "values must be finite"),
        ({"particles": "mean"}, "particles = 'mean' "),
        ({"initial": "0"}, "initial = '0' "),
        ({"units": 1}, "units = 1 "),
        ({"values": 3}, "values = 3 "),
        ({"values": "few"}, "values = 'few' "),
        ({"values": [[1.0], [2.0]]}, "must be a list of numbers"),
        ({"function": lambda totals, landing: totals + 1.0}, "must change totals"),
    ],
)
def test_mistakes_are_named(changes, words):
    with pytest.raises(ParameterError, match=r"^observable .*: ") as raised:
        make(**changes)
    assert words in str(raised.value)


def test_observables_of_one_sweep_have_different_names():
    one, other = make(), make(name="other", along="bin", values=(1.0, 2.0))
    assert observables_of([one, other]) == (one, other)
    with pytest.raises(ParameterError, match="more than once: seen;"):
        observables_of([one, make()])
    with pytest.raises(ParameterError, match="more than once: bin;"):
        observables_of([other, make(name="bin")])
    with pytest.raises(ParameterError, match="same values"):
        observables_of([other, make(along="bin", values=(1.0, 3.0))])
    with pytest.raises(ParameterError, match=r"vibrosweep\.Observable"):
        observables_of([count])
    with pytest.raises(ParameterError, match=r"^observables = Observable.*: "):
        observables_of(one)


def test_the_code_of_a_function_is_that_at_the_time_of_use():
    adding = defined("def f(t, x): t[0] += K", K=1.0)
    one = make(adding)
    adding.__globals__["K"] = 2.0
    (used,) = observables_of([one])
    assert used.code != one.code
    assert used == make(adding)


def test_an_observable_is_the_same_in_another_process():
    one = make(spread, along="bin", values=range(BINS), units="m s-1")
    again = pickle.loads(pickle.dumps(one))
    assert (again, hash(again), again.code) == (one, hash(one), one.code)
    assert again.function is spread
    assert again.source.startswith("def spread(totals, landing):")
    assert make(defined("def f(t, x): t[0] = 1.0")).source == ""


def test_units():
    frequency, gravity = np.array([2.0, 10.0]), np.array([9.81, 1.6])
    velocity = gravity / (2.0 * frequency)
    for units, expected in {
        "1": np.ones(2),
        "s": 1.0 / frequency,
        "m s-1": velocity,
        "m2 s-2": velocity**2,
        "m": velocity / frequency,
        "m s-2": gravity / 2.0,
    }.items():
        np.testing.assert_allclose(make(units=units).scale(frequency, gravity), expected, 1e-15)


def test_totals_of_particles_are_combined():
    totals = np.random.default_rng(1).normal(size=(3, 7, 1))
    # since Python 3.12 the built-in sum compensates for rounding
    in_order = [reduce(operator.add, row) for row in totals[..., 0].tolist()]
    np.testing.assert_array_equal(make().combined(totals), in_order)
    np.testing.assert_array_equal(make(particles="max").combined(totals), totals.max((1, 2)))
    np.testing.assert_array_equal(make(particles="min").combined(totals), totals.min((1, 2)))
    np.testing.assert_array_equal(make(particles="each").combined(totals), totals[..., 0])
    along = make(along="bin", values=range(4))
    assert along.combined(np.ones((3, 7, 4))).tolist() == [[7.0] * 4] * 3
    assert along.variable.dims == ("realization", "bin")
    assert make(particles="each").variable.dims == ("realization", "particle")
