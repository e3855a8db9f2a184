"""Damaged and invented input: a short form of checks/fuzz.py, and properties of all sweep files."""

import string
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzz import FUZZERS, campaign, spoilt_bytes
from vibrosweep.errors import SpecError
from vibrosweep.scene.keys import SECTIONS
from vibrosweep.scene.sweep import Sweep, parse_spec

NUMBERS = st.one_of(
    st.integers(),
    st.floats(),
    st.sampled_from(["1e400", "-nan", "0x10", "9" * 5000, "1_000", "2026-01-01", "true"]),
).map(str)
TEXTS = st.text().map(lambda text: f"{text!a}") | st.text(string.printable)
VALUES = st.recursive(
    NUMBERS | TEXTS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4).map(lambda items: f"[{', '.join(items)}]"),
        st.fixed_dictionaries({"start": inner, "stop": inner, "num": inner}).map(
            lambda items: f"{{ {', '.join(f'{k} = {v}' for k, v in items.items())} }}"
        ),
    ),
    max_leaves=6,
)
KEYS = [(table, key) for table, keys in SECTIONS.items() for key in keys]
ENTRIES = st.lists(st.tuples(st.sampled_from(KEYS), VALUES), max_size=6)


def either_valid_or_refused(text):
    """Any other exception fails the test."""
    with suppress(SpecError):
        assert isinstance(parse_spec(text), Sweep)


@given(ENTRIES)
@settings(max_examples=100)
def test_any_value_of_any_key_is_accepted_or_refused(entries):
    tables = {}
    for (table, key), value in entries:
        tables.setdefault(table, {})[key] = value
    sections = (
        f"[{table}]\n" + "\n".join(f"{key} = {value}" for key, value in keys.items())
        for table, keys in tables.items()
    )
    either_valid_or_refused('title = "x"\n' + "\n".join(sections))


@given(st.text())
@settings(max_examples=50)
def test_any_text_is_accepted_or_refused(text):
    either_valid_or_refused(text)


@pytest.mark.parametrize(
    ("name", "number"),
    [("sweep files", 12), ("tables", 8), ("result files", 8), ("results saved again", 2)],
)
def test_nothing_fails_badly(name, number, capsys):
    """No traceback, no hang, nothing written beside the output, no changed numbers shown."""
    (found,) = campaign({name: number}, seed=11).values()
    assert found.failures == []
    assert found.ends.total() >= number
    assert found.ends["refused"] > 0
    assert name in FUZZERS


def test_most_spoilt_bytes_differ_from_sound_ones():
    rng = np.random.default_rng(1)
    sound = bytes(range(256)) * 8
    assert sum(spoilt_bytes(rng, sound) != sound for _ in range(50)) > 40
