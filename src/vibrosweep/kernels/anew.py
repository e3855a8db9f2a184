"""Compilation of functions from outside the package."""

from __future__ import annotations

from collections.abc import Callable
from types import CellType, FunctionType
from typing import Any

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
