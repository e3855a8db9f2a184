"""The registry of measures is consistent, and everything derived from it agrees with it."""

import re
from collections import Counter
from dataclasses import fields, replace

import numpy as np
import pytest

from docs.page_tables import TABLES, insert
from vibrosweep.errors import SpecError
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
from vibrosweep.model.observables import KEYS, Measures
from vibrosweep.proof.report import Judgement, VariableReport
from vibrosweep.runs.result import Summary
from vibrosweep.scene.sweep import parse_spec


def test_every_key_is_a_measure_or_an_option_and_every_variable_has_one_home():
    assert [field.name for field in fields(Measures)] == list(vars(Measures()))
    keys = vars(Measures()).keys() - {"observables"}  # functions, which no file can hold
    assert {*MEASURES, *OPTIONS} == KEYS.keys() == keys | {TRANSIENT_PERIODS}
    homes = Counter(v.name for m in MEASURES.values() for v in m.variables)
    homes.update(v.name for v in ALWAYS)
    assert set(homes.values()) == {1}
    assert VARIABLES.keys() == homes.keys() == MEASURE_OF.keys() | {v.name for v in ALWAYS}


@pytest.mark.parametrize("key", MEASURES)
def test_a_measure_brings_what_it_requires_and_nothing_else(key):
    asked = Measures(**{key: True})
    expected = {key, *MEASURES[key].requires}
    assert {other for other in MEASURES if getattr(asked, other)} == expected
    names = {v.name for v in ALWAYS} | {n for n, home in MEASURE_OF.items() if home in expected}
    assert [v.name for v in asked.variables] == [n for n in VARIABLES if n in names]


def test_exponents_require_regimes():
    assert replace(Measures(lyapunov=True), regimes=False).regimes


@pytest.mark.parametrize("variable", [*VARIABLES.values(), *RECORD.values()], ids=lambda v: v.name)
def test_a_code_fits_its_type_and_only_codes_are_eight_bits(variable):
    codes = [code for code, _ in variable.flags]
    assert bool(codes) == (variable.dtype == "int8")
    assert np.array_equal(np.array(codes, variable.dtype), codes)
    assert len(set(codes)) == len(codes)


@pytest.mark.parametrize("key", MEASURES)
def test_a_sweep_file_asks_for_a_measure_by_its_key(key):
    base = "sprung" if MEASURES[key].coupled else "high-bounce"
    mount = "mass_ratio = 0.01\nmount_frequency = 1.0\n" if MEASURES[key].coupled else ""
    text = f'title = "x"\n[scene]\nbase = "{base}"\n{mount}[measure]\n'
    found = parse_spec(f"{text}{key} = true").scene.measures
    assert found == Measures(**{key: True}).over(base, "constant")
    with pytest.raises(SpecError, match=f"measure.{key} = 1: "):
        parse_spec(f"{text}{key} = 1")


@pytest.mark.parametrize(
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


@pytest.mark.parametrize("name", [n for n in VARIABLES if "lyapunov" in n or "exponent" in n])
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
