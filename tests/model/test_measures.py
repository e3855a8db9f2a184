"""Measures and observables."""

import math
import operator
import pickle
import re
from collections import Counter
from dataclasses import fields, replace
from functools import reduce

import numpy as np
import pytest

from docs.page_tables import TABLES, insert
from tests.cases import each_of
from vibrosweep.errors import ParameterError, SpecError
from vibrosweep.kernels.advance import LOOK_AFTER
from vibrosweep.model.measures import (
    ALWAYS,
    MEASURE_OF,
    MEASURES,
    OPTIONS,
    RECORD,
    TRANSIENT_PERIODS,
    VARIABLES,
)
from vibrosweep.model.observables import KEYS, Measures, Observable, observables_of
from vibrosweep.proof.report import Judgement, VariableReport
from vibrosweep.runs.result import Summary
from vibrosweep.scene.sweep import parse_spec

# The registry of measures is consistent, and everything derived from it agrees with it.


def test_every_key_is_a_measure_or_an_option_and_every_variable_has_one_home():
    assert [field.name for field in fields(Measures)] == list(vars(Measures()))
    keys = vars(Measures()).keys() - {"observables"}  # functions, which no file can hold
    assert {*MEASURES, *OPTIONS} == KEYS.keys() == keys | {TRANSIENT_PERIODS}
    homes = Counter(v.name for m in MEASURES.values() for v in m.variables)
    homes.update(v.name for v in ALWAYS)
    assert set(homes.values()) == {1}
    assert VARIABLES.keys() == homes.keys() == MEASURE_OF.keys() | {v.name for v in ALWAYS}


@each_of("key", MEASURES)
def test_a_measure_brings_what_it_requires_and_nothing_else(key):
    asked = Measures(**{key: True})
    expected = {key, *MEASURES[key].requires}
    assert {other for other in MEASURES if getattr(asked, other)} == expected
    names = {v.name for v in ALWAYS} | {n for n, home in MEASURE_OF.items() if home in expected}
    assert [v.name for v in asked.variables] == [n for n in VARIABLES if n in names]


def test_exponents_require_regimes():
    assert replace(Measures(lyapunov=True), regimes=False).regimes


@each_of("variable", [*VARIABLES.values(), *RECORD.values()])
def test_a_code_fits_its_type_and_only_codes_are_eight_bits(variable):
    codes = [code for code, _ in variable.flags]
    assert bool(codes) == (variable.dtype == "int8")
    assert np.array_equal(np.array(codes, variable.dtype), codes)
    assert len(set(codes)) == len(codes)


@each_of("key", MEASURES)
def test_a_sweep_file_asks_for_a_measure_by_its_key(key):
    base = "sprung" if MEASURES[key].coupled else "high-bounce"
    mount = "mass_ratio = 0.01\nmount_frequency = 1.0\n" if MEASURES[key].coupled else ""
    text = f'title = "x"\n[scene]\nbase = "{base}"\n{mount}[measure]\n'
    found = parse_spec(f"{text}{key} = true").scene.measures
    assert found == Measures(**{key: True}).over(base, "constant")
    with pytest.raises(SpecError, match=f"measure.{key} = 1: "):
        parse_spec(f"{text}{key} = 1")


@each_of(
    ("key", "refused"),
    [
        ("transient", -1e-300),
        ("transient_periods", -1e-300),
        ("tolerance", 0.0),
        ("impact_budget", 0),
        ("impact_budget", 2**62 + 1),
    ],
)
def test_an_option_out_of_its_range_is_refused_in_the_words_of_the_registry(key, refused):
    assert all(OPTIONS[k].accepts(KEYS[k]) for k in OPTIONS if KEYS[k] is not None)
    with pytest.raises(SpecError) as caught:
        parse_spec(f'title = "x"\n[measure]\n{key} = {refused}')
    assert f"must be {OPTIONS[key].allowed}" in str(caught.value)


def test_the_meaning_of_the_budget_states_its_multiple():
    assert OPTIONS["impact_budget"].meaning.endswith(f"a multiple of {LOOK_AFTER}")


def test_tables_go_between_their_markers():
    empty = "\n".join(f"<!-- begin {name} -->\n\n<!-- end {name} -->" for name in TABLES)
    assert all(f" -->\n{table}\n<!-- end" in insert(f"a\n{empty}\nb") for table in TABLES.values())
    with pytest.raises(ValueError, match="variables"):
        insert(empty.replace("<!-- end variables -->", ""))


@each_of("name", [n for n in VARIABLES if "lyapunov" in n or "exponent" in n])
def test_an_exponent_says_whether_it_is_per_impact_or_per_period(name):
    variable = VARIABLES[name]
    per = "period" if name.startswith("joint") else "impact"
    assert variable.attributes["per"] == per
    assert re.search(rf"per (forcing )?{per}\b", variable.attributes["long_name"])
    report = VariableReport()
    report.add("realization 0", Judgement(name, None, 0.0, 1e-9))
    for line in (report.line(name, 1), *_summary(name)):
        assert line.startswith(f"{name} (per {per})")


def _summary(name):
    """Lines of a summary about a variable of realizations."""
    summary = Summary()
    summary.add({"impact_count": np.ones(1, np.int64), name: np.ones(1)})
    return [line for line in summary.lines() if line.startswith(name)]


# Observables: what is refused, what identifies a function, units, and sums over particles.

BINS = 8


def count(totals, landing):
    totals[0] += 1.0


def spread(totals, landing):
    totals[int((landing.phase + 0.5) * BINS) % BINS] += math.fabs(landing.impact_speed)


def make(function=count, **changes):
    given = {"name": "seen", "meaning": "landings"} | changes
    return Observable(function=function, **given)


def defined(text, **outside):
    """Define the function f of this text in a module with these globals."""
    names = dict(outside)
    exec(text, names)
    return names["f"]


@each_of(
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
