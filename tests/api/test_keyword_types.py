"""An editor completes the keys of a sweep file, in every function that takes them."""

import inspect

import pytest

import vibrosweep as vs
from vibrosweep.api import keyword_types
from vibrosweep.scene.keys import SECTIONS

KEYS = {"title", *SECTIONS["scene"], *SECTIONS["sample"], *SECTIONS["measure"]}
EXPECTED = {
    "BatchKeywords": {*SECTIONS["scene"], "launch_time", "impact_budget"},
    "RealizationKeywords": KEYS,
    "SweepKeywords": KEYS | {*SECTIONS},
    "WindowKeywords": KEYS | {*SECTIONS} | {*SECTIONS["windows"]},
}
FUNCTIONS = {
    name: inspect.signature(getattr(vs, name)).parameters["keywords"]
    for name in vs.__all__
    if inspect.isfunction(getattr(vs, name))
    and "keywords" in inspect.signature(getattr(vs, name)).parameters
}


@pytest.mark.parametrize("name", keyword_types.__all__)
def test_typed_keywords_are_the_keys_of_a_sweep_file(name):
    assert getattr(keyword_types, name).__optional_keys__ == EXPECTED[name]


def test_every_function_states_the_type_of_its_keywords():
    assert {"sweep", "simulate", "windows", "bifurcation", "basins", "sobol"} <= FUNCTIONS.keys()
    kinds = {one.annotation.removeprefix("Unpack[").removesuffix("]") for one in FUNCTIONS.values()}
    assert kinds == {*keyword_types.__all__}
