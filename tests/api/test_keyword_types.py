"""An editor completes the keys of a sweep file, in every function that takes them."""

import inspect

import pytest

import vibrosweep as vs
from vibrosweep.api import keyword_types
from vibrosweep.scene.keys import SECTIONS

KEYS = {"title", *SECTIONS["scene"], *SECTIONS["sample"], *SECTIONS["measure"]}
EXPECTED = {
    "BatchKeywords": {*SECTIONS["scene"], "launch_time", "noise_stream", *SECTIONS["measure"]},
    "RealizationKeywords": KEYS,
    "SweepKeywords": KEYS | {*SECTIONS},
    "WindowKeywords": KEYS | {*SECTIONS} | {*SECTIONS["windows"]},
}
FUNCTIONS = {
    name: getattr(vs, name).__annotations__["keywords"].removeprefix("Unpack[").removesuffix("]")
    for name in vs.__all__
    if inspect.isfunction(getattr(vs, name)) and "keywords" in getattr(vs, name).__annotations__
}


@pytest.mark.parametrize("name", keyword_types.__all__)
def test_typed_keywords_are_the_keys_of_a_sweep_file(name):
    assert getattr(keyword_types, name).__optional_keys__ == EXPECTED[name]


def test_every_function_states_the_type_of_its_keywords():
    assert {"sweep", "simulate", "windows", "bifurcation", "basins", "sobol"} <= FUNCTIONS.keys()
    assert {*FUNCTIONS.values()} == {*keyword_types.__all__}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_signatures_name_every_keyword_so_that_notebooks_complete_it(name):
    """IPython completes what a signature names; it does not look into types."""
    shown = inspect.signature(getattr(vs, name)).parameters
    keys = getattr(keyword_types, FUNCTIONS[name]).__optional_keys__
    assert {one for one, p in shown.items() if p.kind is p.KEYWORD_ONLY} >= keys
    assert "keywords" not in shown
