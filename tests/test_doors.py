"""Public functions refuse what is no dataset or no number, with an error of this package."""

import contextlib
import inspect
from decimal import Decimal
from fractions import Fraction

import numpy as np
import pytest
import xarray as xr

import vibrosweep as vs
from vibrosweep.errors import DataError, VibrosweepError

ABSURD = (None, -1, 1.5, float("nan"), float("inf"), "x", "", b"x", [], ["x"], {}, {"a": 1})
ABSURD += (object(), 10**400, 1j, [1j], np.datetime64("NaT"), np.zeros((2, 2)), xr.Dataset())
PUBLIC = {
    f"{space.__name__}.{name}": getattr(space, name)
    for space in (vs.analysis, vs.figures, vs.theory, vs.theory.sprung)
    for name in space.__all__
} | {"positions": vs.positions, "rectangle": vs.rectangle}


def needed(function):
    """Return the names of the arguments that a function needs, if it is one."""
    if not inspect.isfunction(function):
        return []
    named = inspect.signature(function).parameters.values()
    varying = (inspect.Parameter.VAR_KEYWORD, inspect.Parameter.VAR_POSITIONAL)
    return [p.name for p in named if p.default is p.empty and p.kind not in varying]


@pytest.mark.parametrize("name", [name for name, one in PUBLIC.items() if needed(one)])
def test_absurd_arguments(name):
    for value in ABSURD:
        with contextlib.suppress(VibrosweepError):
            PUBLIC[name](**dict.fromkeys(needed(PUBLIC[name]), value))


def test_lists_of_datasets():
    for given in ([], (), None, xr.Dataset(), "x", [None]):
        with pytest.raises(DataError, match="dataset"):
            vs.analysis.compare_separations(given)
        with pytest.raises(DataError, match="dataset"):
            vs.figures.separation_distributions(given, ["x"], 1e-4)


def test_any_real_number_is_one():
    expected = vs.theory.locked_height(2)
    for k in (Fraction(2), Decimal(2), np.int8(2), np.float32(2)):
        assert vs.theory.locked_height(k) == expected
    assert len(vs.theory.locked_windows(Fraction(1), Decimal("0.85"))) == 1
