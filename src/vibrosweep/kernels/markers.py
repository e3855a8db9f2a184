"""Empty named tuples, whose types choose what is compiled.

Machine code is kept on disk by the names of types.  The type of code from outside the package has a
digest of that code in its name, so that machine code of an earlier version never runs.
"""

from __future__ import annotations

from collections import namedtuple


def kind(name: str) -> type:
    """Return the type ``Kind_<name>``, a new one where there is none yet."""
    name = f"Kind_{name}"
    if name not in globals():
        globals()[name] = namedtuple(name, (), module=__name__)
    found: type = globals()[name]
    return found


def __getattr__(name: str) -> type:
    """Return a type that machine code on disk names; another process may have declared it."""
    if name.startswith("Kind_"):
        return kind(name.removeprefix("Kind_"))
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
