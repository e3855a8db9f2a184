"""Keywords of Python mean the same as keys of a sweep file; mistakes are named by keyword."""

import re
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from tests.cases import each_of
from vibrosweep.errors import ParameterError, SpecError
from vibrosweep.model.parameters import Periods
from vibrosweep.scene.design import GridAxis, Range
from vibrosweep.scene.sweep import batch, keyword_spec, parse_spec

DRAWN = {"restitution": (0.8, 0.98), "amplitude": (0.2, 3.5), "realizations": 20}


def same(one, other):
    return {**vars(one), "text": ""} == {**vars(other), "text": ""}


def test_keywords_are_a_sweep_file():
    by_keywords = keyword_spec(
        {
            **DRAWN,
            "design": "sobol",
            "seed": 3,
            "particles": 5,
            "duration_periods": 40,
            "separation": True,
            "transient": 1.0,
            "gravity": 9.5,
            "title": "one",
        }
    )
    by_file = parse_spec(
        """title = "one"
        [scene]
        particles = 5
        duration_periods = 40
        gravity = 9.5
        [sample]
        design = "sobol"
        restitution = [0.8, 0.98]
        amplitude = [0.2, 3.5]
        realizations = 20
        seed = 3
        [measure]
        separation = true
        transient = 1.0
        """
    )
    assert same(by_keywords, by_file)
    assert by_keywords.scene.duration == Periods(40.0)


@pytest.mark.parametrize(
    "values",
    [
        [0.5, 0.7, 0.9],
        np.array([0.5, 0.7, 0.9]),
        pd.Series([0.5, 0.7, 0.9], index=[4, 2, 1]),
        xr.DataArray([0.5, 0.7, 0.9]),
    ],
)
def test_a_list_is_an_axis_and_makes_a_grid(values):
    spec = keyword_spec({"restitution": values, "frequency": np.float64(2.0)})
    assert spec.design.name == "grid"
    assert spec.design.sampled == {"restitution": GridAxis((0.5, 0.7, 0.9))}
    assert spec.scene.inputs["frequency"] == 2.0


def test_a_tuple_is_a_range():
    spec = keyword_spec(DRAWN)
    assert spec.design.name == "uniform"
    assert spec.design.sampled == {"restitution": Range(0.8, 0.98), "amplitude": Range(0.2, 3.5)}


def test_tables_of_a_sweep_file_can_be_keywords():
    spec = keyword_spec(
        {"sample": {"restitution": [0.8, 0.9], "realizations": 4}, "particles": 3, "title": "x"}
    )
    assert spec.design.sampled == {"restitution": Range(0.8, 0.9)}
    assert spec.scene.particles == 3


AXES = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=30, unique=True)


@given(AXES, st.floats(1e-3, 1e3), st.booleans())
def test_the_stored_text_asks_for_the_same_sweep(values, frequency, separation):
    asks = {"restitution": values, "frequency": frequency, "separation": separation}
    spec = keyword_spec(asks)
    assert same(parse_spec(spec.text), spec)


def test_even_axes_are_written_briefly_and_exactly():
    even = np.linspace(0.1, 0.7, 101)
    spec = keyword_spec({"restitution": even})
    assert "num = 101" in spec.text
    assert spec.design.sampled["restitution"].values == tuple(even.tolist())
    uneven = np.geomspace(0.1, 0.7, 101)
    spec = keyword_spec({"restitution": uneven})
    assert "num" not in spec.text
    assert parse_spec(spec.text).design.sampled["restitution"].values == tuple(uneven.tolist())


@each_of(
    ("asks", "message"),
    [
        ({"restituton": 0.9}, 'restituton = 0.9: is not a known keyword; did you mean "restitut'),
        ({"v0": 3.0}, 'did you mean "launch_velocity"'),
        ({"restitution": 1.2}, "restitution = 1.2:"),
        ({"restitution": (0.8, 1.2), "realizations": 2}, r"restitution = (0.8, 1.2):"),
        ({"restitution": (0.9, 0.8), "realizations": 2}, "write (0.8, 0.9)"),
        ({"restitution": (0.8, 0.9)}, "realizations: is missing; state how many"),
        ({"restitution": [0.8, 0.8]}, "restitution = [0.8, 0.8]:"),
        ({"restitution": [0.8], "amplitude": (1.0, 2.0)}, "amplitude is a range; give all as"),
        ({"restitution": [0.8, 0.9], "design": "sobol"}, "draws values; give a tuple (low, high)"),
        ({"restitution": (0.8, 0.9), "design": "grid"}, "give them as a list"),
        ({"amplitude": 1.0, "base_velocity": 2.0}, "and so does amplitude; keep one of the two"),
        ({"separation": 1}, "separation = 1:"),
        ({"transient": 20}, "transient = 20: must be less than duration = 12.0 s"),
        ({"particles": 3, "launch": [0.0]}, "contradicts the 1 launch times of launch"),
        ({"base": "moving", "rebound": "reflect"}, '^rebound = "reflect" has no meaning with'),
        ({"duration": 3, "duration_periods": 3}, "duration = 3.0 is given too"),
        ({"frequency": 1e9, "duration": 1e20}, "forcing periods: at most"),
        ({"scene": {"restitution": 0.9}, "restitution": 0.8}, "is given in scene too"),
        ({"launch": (0.0, 0.5)}, "nothing is drawn from a range here; give a list"),
        ({"launch_time": [0.0]}, 'did you mean "launch"'),
        ({"scene": 3}, "scene = 3:"),
        ({"restitution": object()}, "is not a finite number"),
    ],
)
def test_a_mistake_names_the_keyword_and_no_file(asks, message):
    with pytest.raises(SpecError) as caught:
        keyword_spec(asks)
    told = str(caught.value)
    assert re.search(message, told) if message[0] == "^" else message in told
    assert not re.search(r"\[\w+\] |\b(scene|sample|measure)\.|file", told)


def test_all_mistakes_are_listed_at_once():
    with pytest.raises(SpecError, match=r"^2 mistakes\n  restitution = 2: .*\n  particles = 0: "):
        keyword_spec({"restitution": 2, "particles": 0})


def test_masked_values_are_no_data():
    with pytest.raises(ParameterError, match=r"^restitution: "):
        keyword_spec({"restitution": np.ma.masked_less([0.1, 0.9], 0.5)})


def test_a_keyword_that_is_none_counts_as_not_given():
    assert same(keyword_spec({**DRAWN, "duration": None}), keyword_spec(DRAWN))


def test_fractions_and_decimals_are_numbers():
    half, one = Fraction(1, 2), Decimal(1)
    exact = {"amplitude": half, "restitution": Decimal("0.75"), "duration": Fraction(5)}
    plain = {"amplitude": 0.5, "restitution": 0.75, "duration": 5.0}
    assert same(keyword_spec(exact), keyword_spec(plain))
    for kind in (list, tuple):
        drawn = {"realizations": 2} if kind is tuple else {}
        varied = keyword_spec({"amplitude": kind([half, one]), **drawn})
        assert same(varied, keyword_spec({"amplitude": kind([0.5, 1.0]), **drawn}))
    _, arrays = batch({"amplitude": [half, one]})
    assert arrays["amplitude"].tolist() == [0.5, 1.0]
    with pytest.raises(SpecError, match="amplitude = "):
        keyword_spec({"amplitude": Fraction(10**400)})


@each_of("value", [1, "x", [], 1j])
@each_of("table", ["scene", "sample", "measure", "record"])
def test_a_table_that_is_no_mapping(table, value):
    with pytest.raises(SpecError, match=rf"{table} = .*must be a mapping"):
        keyword_spec({"amplitude": 1.0, table: value})


def test_control_characters_of_an_unknown_keyword_are_escaped():
    with pytest.raises(SpecError) as caught:
        keyword_spec({"\x1b[31mred": 1})
    assert r"\x1b[31mred" in str(caught.value)
    assert "\x1b" not in str(caught.value)
