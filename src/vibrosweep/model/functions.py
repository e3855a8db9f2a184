"""The fingerprint of a user's function: its code, and all values that it takes from outside."""

from __future__ import annotations

import dis
import hashlib
import inspect
import textwrap
from collections.abc import Iterable, Iterator
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any, Final

import numpy as np

from vibrosweep.errors import ParameterError

# Modules that change only with a version, which is part of the identity of a run
FIXED_MODULES: Final = ("builtins", "cmath", "math", "numpy")


def plain(value: object) -> Any:
    """Return the Python function of a function compiled by numba, or the value itself."""
    return getattr(value, "py_func", value)


def outside(function: FunctionType) -> dict[str, Any]:
    """Return the global and enclosed values that a function, and functions inside it, use."""
    names = _arguments(function.__code__, "LOAD_GLOBAL")
    found = {n: function.__globals__[n] for n in sorted(names) if n in function.__globals__}
    cells = zip(function.__code__.co_freevars, function.__closure__ or (), strict=True)
    return found | {name: cell.cell_contents for name, cell in cells}


def is_function(value: object) -> bool:
    """Return whether a value is a Python function, compiled by numba or not."""
    return isinstance(plain(value), FunctionType)


def source_of(function: Any) -> str:
    """Return the source text of a function; empty if Python does not have it."""
    try:
        return textwrap.dedent(inspect.getsource(plain(function)))
    except (OSError, TypeError):
        return ""


def changes_its_arguments(function: FunctionType) -> bool:
    """Return whether a function could change an array that is its argument."""
    return any(
        instruction.opname.startswith(("STORE_SUBSCR", "STORE_SLICE", "CALL"))
        or (instruction.opname == "BINARY_OP" and instruction.argrepr.endswith("="))
        for instruction in dis.get_instructions(function)
    )


def parts(function: FunctionType, where: str) -> Iterator[str]:
    """Yield everything on which the results of a function depend.

    Raises a ParameterError, which begins with `where`, if the function draws random numbers or uses
    something from outside whose value could change without notice.
    """
    yield from _parts(function, where, set())


def digest_of(functions: Iterable[FunctionType], where: str, *texts: str) -> str:
    """Return a digest of what functions compute, and of texts; raises as `parts` does."""
    every = [part for function in functions for part in parts(function, where)]
    text = "\n".join([*every, *texts])
    return hashlib.blake2b(text.encode(), digest_size=16).hexdigest()


def _parts(function: FunctionType, where: str, seen: set[FunctionType]) -> Iterator[str]:
    seen.add(function)
    yield from _code(function.__code__)
    if "random" in _arguments(function.__code__, "LOAD_ATTR", "LOAD_METHOD"):
        raise ParameterError(
            f"{where}: its function draws random numbers, which would depend on the threads"
        )
    defaults = [*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).items()]
    given = {f"default {k}": value for k, value in enumerate(defaults)}
    for name, value in (outside(function) | given).items():
        yield name
        if is_function(value):
            if plain(value) not in seen:
                yield from _parts(plain(value), where, seen)
        elif _fixed(value):
            yield _fixed(value)
        elif _is_constant(value):
            yield _text(value)
        else:
            remedy = "numbers, tuples of numbers, or functions"
            if isinstance(value, ModuleType):
                remedy = f"an import of what it needs, as from {value.__name__} import ..."
            raise ParameterError(
                f"{where}: its function uses {name}, of type {type(value).__name__}, whose value "
                f"could change without notice; use {remedy} instead"
            )


def _fixed(value: Any) -> str:
    """Return the name of a member of `FIXED_MODULES`, or of such a module; else empty."""
    if isinstance(value, np.ufunc):
        return f"numpy.{value.__name__}"
    if isinstance(value, ModuleType):
        name = value.__name__
    elif isinstance(value, type | BuiltinFunctionType) or type(value) is type(np.sum):
        name = f"{value.__module__}.{value.__name__}"
    else:
        return ""
    return name if name.split(".")[0] in FIXED_MODULES and "random" not in name else ""


def _is_constant(value: object) -> bool:
    if isinstance(value, tuple):
        return all(map(_is_constant, value))
    return value is None or isinstance(value, bool | int | float | complex | str | np.number)


def _text(value: object) -> str:
    """Return a constant as text, with the types of NumPy's numbers, which NumPy 1 leaves out."""
    if isinstance(value, tuple):
        return f"({' '.join(f'{_text(one)},' for one in value)})"
    if isinstance(value, np.number):
        return f"np.{type(value).__name__}({value})"
    return repr(value)


def _code(code: CodeType) -> Iterator[str]:
    """Yield the compiled code, without file names and line numbers."""
    yield code.co_code.hex()
    yield repr((code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars))
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code(constant)
        else:
            yield repr(sorted(constant, key=repr) if isinstance(constant, frozenset) else constant)


def _arguments(code: CodeType, *operations: str) -> set[str]:
    """Return the arguments of these operations in a function and in functions inside it."""
    found = {i.argval for i in dis.get_instructions(code) if i.opname in operations}
    inside: Iterable[CodeType] = [c for c in code.co_consts if isinstance(c, CodeType)]
    return found.union(*(_arguments(c, *operations) for c in inside))
