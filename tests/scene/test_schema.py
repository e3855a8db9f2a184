"""The JSON Schema of sweep files accepts what the checks of the keys accept, and nothing else."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

from hypothesis import assume, given, settings
from hypothesis import strategies as st
from jsonschema import Draft7Validator

from tests.cases import each_of
from vibrosweep.scene import keys, schema

SWEEPS = Path(__file__).parents[2] / "sweeps"
FILES = sorted(SWEEPS.glob("*.toml"))
SCHEMA = schema.schema()
VALID = Draft7Validator(SCHEMA)
VALIDATORS = {
    (table, key): Draft7Validator(SCHEMA["properties"][table]["properties"][key])
    for table, checks in keys.SECTIONS.items()
    for key in checks
}

# as TOML holds them; a schema has no word for nan, and takes 3.0 for a whole number
NUMBERS = st.one_of(
    st.integers(-(2**63), 2**63 - 1),
    st.floats(allow_nan=False).filter(lambda x: not x.is_integer()),
    st.sampled_from([0.1, 0.5, 1e-14, 1e-15, 1e31, float("inf"), -float("inf")]),
)
WORDS = ["sine", "grid", "rows.csv", "rows.txt", "staggered", "moving", "", "x", "plastic", "rest"]
PLAIN = st.one_of(NUMBERS, st.booleans(), st.sampled_from(WORDS))
VALUES = st.one_of(
    PLAIN,
    st.lists(PLAIN, max_size=3),
    st.lists(NUMBERS, min_size=1, max_size=3),
    st.dictionaries(st.sampled_from(["start", "stop", "num", "harmonics", "trace"]), PLAIN),
)


def accepted(check, value):
    try:
        check(value)
    except ValueError:
        return False
    return True


def test_the_shipped_schema_is_that_of_the_keys():
    """``python -m vibrosweep.scene.schema > sweeps/sweep.schema.json`` writes it again."""
    Draft7Validator.check_schema(SCHEMA)
    # in a process of its own, where no other test has registered a design
    words = [sys.executable, "-m", "vibrosweep.scene.schema"]
    written = subprocess.run(words, capture_output=True, check=True, encoding="utf-8").stdout
    assert (SWEEPS / "sweep.schema.json").read_text("utf-8") == written


@each_of("path", FILES)
def test_every_example_names_the_schema_and_agrees_with_it(path):
    text = path.read_text("utf-8")
    assert text.splitlines()[0] == "#:schema sweep.schema.json"
    assert [*VALID.iter_errors(tomllib.loads(text))] == []


@settings(max_examples=60, deadline=None)
@given(value=VALUES)
def test_a_value_is_valid_where_its_check_accepts_it(value):
    if isinstance(value, dict):  # start < stop is a rule between two keys
        assume("start" not in value)
    whole = isinstance(value, int) and not isinstance(value, bool)
    for (table, key), valid in VALIDATORS.items():
        if key == "columns" and isinstance(value, list):
            continue  # its names are compared with those of the parameters
        if (table, key) == ("windows", "tolerance") and whole:
            continue
        assert valid.is_valid(value) == accepted(keys.SECTIONS[table][key], value), (table, key)


TEXT = """title = "x"
[scene]
base = "moving"
{scene}
[sample]
design = "grid"
{sample}
"""
GOOD = {"scene": "particles = 2", "sample": "amplitude = { start = 0.2, stop = 3.5, num = 12 }"}


@each_of(
    ("table", "line", "place"),
    [
        ("scene", "particels = 2", "scene"),  # a key
        ("sample", "transient = 3.0", "sample"),
        ("scene", 'particles = "2"', "scene.particles"),  # a type
        ("scene", "launch = 0.5", "scene.launch"),
        ("sample", 'restitution = "0.8"', "sample.restitution"),
        ("scene", "particles = 0", "scene.particles"),  # a range
        ("scene", "restitution = 1.2", "scene.restitution"),
        ("sample", "restitution = [0.8, 1.2]", "sample.restitution"),
        ("sample", "amplitude = { start = 0.2, stop = 3.5, num = 1 }", "sample.amplitude"),
        ("scene", 'waveform = "triangle"', "scene.waveform"),
        ("scene", "waveform = { harmonics = [[0, 1.0, 0.0]] }", "scene.waveform"),
    ],
)
def test_a_bad_file_is_refused_at_its_fault(table, line, place):
    assert VALID.is_valid(tomllib.loads(TEXT.format(**GOOD)))
    errors = [*VALID.iter_errors(tomllib.loads(TEXT.format(**{**GOOD, table: line})))]
    assert [".".join(map(str, error.absolute_path)) for error in errors] == [place]


def test_the_schema_describes_every_key():
    for table in keys.SECTIONS:
        for name, one in SCHEMA["properties"][table]["properties"].items():
            assert one.keys() & {"type", "enum", "anyOf"}, f"{table}.{name}"
    assert json.loads(schema.written()) == SCHEMA
