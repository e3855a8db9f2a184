"""Closed forms refuse physically impossible arguments."""

import inspect

import numpy as np
import pytest

import vibrosweep as vs

IMPOSSIBLE = {
    "restitution": (-0.1, 1.1),
    "frequency": (0.0, -1.0),
    "gravity": (0.0, -9.81),
    "contact_time": (0.0,),
    "k": (0, -1),
    "turns": (),
}
FUNCTIONS = {n: f for n, f in vars(vs.theory).items() if n in vs.theory.__all__ and callable(f)}


def possible(function):
    values = {"restitution": 0.9, "acceleration": 2.0, "contact_time": 1e-4}
    chosen = ("base", "law", "waveform")  # by their names
    names = [n for n in inspect.signature(function).parameters if n not in chosen]
    return {name: values.get(name, 1.0) for name in names}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_argument_has_its_range(name):
    given = possible(FUNCTIONS[name])
    FUNCTIONS[name](**given)
    for argument in given:
        for value in (*IMPOSSIBLE.get(argument, (-1.0,)), np.nan, np.inf):
            with pytest.raises(vs.errors.ParameterError, match=f"^{argument} = .*: must be at"):
                FUNCTIONS[name](**{**given, argument: value})


def test_the_first_value_outside_is_named():
    with pytest.raises(vs.errors.ParameterError, match=r"restitution = 1\.5:"):
        vs.theory.amplitude_min(1, [0.5, 1.5, np.nan])


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_error_of_a_wrong_call_names_the_function(name):
    with pytest.raises(TypeError, match=rf"^{name}\(\) got .*'colour'"):
        FUNCTIONS[name](**possible(FUNCTIONS[name]), colour=1)
