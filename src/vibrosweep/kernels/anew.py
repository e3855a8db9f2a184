"""Compilation of functions from outside the package."""

from __future__ import annotations

from collections.abc import Callable
from types import CellType, FunctionType
from typing import Any

import numba
from numba import types

from vibrosweep.errors import ParameterError
from vibrosweep.model.functions import is_function, outside, plain


def compiled_anew(
    function: Any, compiler: Callable[[Any], Any], done: dict[Any, Any] | None = None
) -> Any:
    """Compile a function from outside the package together with those that it calls.

    Their earlier machine code may hold old values of the numbers that they use, and may have been
    compiled with other options.  `done` holds the functions that have been compiled.
    """
    function, done = plain(function), {} if done is None else done
    if function not in done:
        names, code = dict(function.__globals__), function.__code__
        cells = {name: CellType() for name in code.co_freevars}
        enclosed, defaults = tuple(cells.values()), function.__defaults__
        fresh = FunctionType(code, names, function.__name__, defaults, enclosed)
        fresh.__kwdefaults__ = function.__kwdefaults__
        done[function] = compiler(fresh)
        for name, value in outside(function).items():
            anew = compiled_anew(value, compiler, done) if is_function(value) else value
            if name in cells:
                cells[name].cell_contents = anew
            else:
                names[name] = anew
    return done[function]


def require_compilable(
    function: Any, takes: tuple[Any, ...], compiler: Callable[[Any], Any], whose: str, *, real: bool
) -> None:
    """Raise a ParameterError if numba cannot compile a function for the types that it `takes`.

    If `real`, it must return a real number.
    """
    if numba.config.DISABLE_JIT:
        return
    tried = compiled_anew(function, compiler)
    try:
        tried.compile(takes)
    except Exception as error:  # the exceptions of numba have no common base
        reason = next(filter(str.strip, [*str(error).splitlines()[1:], str(error)])).strip()
        remedy = "call it as plain Python to find the mistake"
        raise ParameterError(f"{whose}: numba cannot compile it: {reason}; {remedy}") from error
    returned = tried.nopython_signatures[0].return_type
    if real and not isinstance(returned, types.Integer | types.Float | types.Boolean):
        raise ParameterError(f"{whose} returns {returned}; it must be a real number")
