"""Fingerprints of functions, and the values that they may take from outside."""

import math
import types

import numba
import numpy as np
import pytest

from vibrosweep.errors import ParameterError
from vibrosweep.model.functions import changes_its_arguments, parts

CALLS = "def f(t, x): t[0] += g()"
USES = "def f(t, x): t[0] += K"


def defined(text, **outside):
    """Define the function f of this text in a module with these globals."""
    names = dict(outside)
    exec(text, names)
    return names["f"]


def identified(function):
    return tuple(parts(function, "here"))


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (USES, "def f(t, x): t[0] -= K"),
        ("def f(t, x): t[0] += 1.0", "def f(t, x): t[0] += 2.0"),
        ("def f(t, x): t[0] += x.phase", "def f(t, x): t[0] += x.arrival"),
        ("def f(t, x=1): pass", "def f(t, x=2): pass"),
        (f"def g(*, k=1): return k\n{CALLS}", f"def g(*, k=2): return k\n{CALLS}"),
        (f"def g(): return 1.0\n{CALLS}", f"def g(): return 2.0\n{CALLS}"),
        ("def f(t, x): t[:] = [i for i in t]", "def f(t, x): t[:] = [-i for i in t]"),
    ],
)
def test_a_function_that_does_something_else_has_another_fingerprint(before, after):
    texts = (before, f"# again\n\n{before}", after)
    first, same, other = (identified(defined(text, K=1.0)) for text in texts)
    assert first == same
    assert first != other


def test_values_from_outside_enter_the_fingerprint():
    values = (1, 1.0, 2.0, (1, 2), "a", math, np.float64(1), math.sin, np.sin, np.clip, float)
    values += (np.float32(1), np.int64(1), (1.0,), (np.float64(1),), ((np.float32(1),), 2))
    assert len({identified(defined(USES, K=k)) for k in values}) == len(values)

    def enclosed(k):
        def f(totals, landing):
            totals[0] += k

        return f

    assert identified(enclosed(1.0)) == identified(enclosed(1.0)) != identified(enclosed(2.0))


def test_functions_that_call_each_other_have_a_fingerprint():
    def pair(k):
        def even(n):
            return n == 0 or odd(n - 1)

        def odd(n):
            return n != 0 and even(n - k)

        return even

    assert identified(pair(1)) == identified(pair(1)) != identified(pair(2))
    assert identified(defined(CALLS, g=pair(1))) == identified(
        defined(CALLS, g=numba.njit(pair(1)))
    )


@pytest.mark.parametrize("value", [[1.0], np.ones(2), {"a": 1}, object(), (1.0, [2.0])])
def test_values_that_could_change_unnoticed_are_refused(value):
    with pytest.raises(ParameterError, match=r"here: .* uses K, of type "):
        identified(defined(USES, K=value))


def test_a_module_of_the_user_is_refused():
    with pytest.raises(ParameterError, match=r"uses K, of type module, .* settings import"):
        identified(defined(USES, K=types.ModuleType("settings")))


@pytest.mark.parametrize("expression", ["K.random.rand()", "K.random.default_rng().random()"])
def test_random_numbers_are_refused(expression):
    with pytest.raises(ParameterError, match="draws random numbers"):
        identified(defined(f"def f(t, x): t[0] += {expression}", K=np))
    for drawing in (np.random, np.random.rand, np.random.default_rng):
        with pytest.raises(ParameterError, match="uses K"):
            identified(defined("def f(t, x): t[0] += K()", K=drawing))


@pytest.mark.parametrize(
    ("body", "changes"),
    [
        ("t[0] = 1.0", True),
        ("t[:] = 1.0", True),
        ("t += 1.0", True),
        ("t.fill(1.0)", True),
        ("t = t + 1.0", False),
        ("return t[0]", False),
    ],
)
def test_whether_a_function_can_change_anything(body, changes):
    assert changes_its_arguments(defined(f"def f(t, x): {body}")) == changes
