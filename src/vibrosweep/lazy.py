"""Public names of a package, each loaded when it is first used."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from vibrosweep.waiting import WaitingLine


def lazily(
    package: str, homes: Mapping[str, str], replaced: Mapping[str, str] | None = None
) -> Callable[[str], Any]:
    """Return the ``__getattr__`` of a package.

    `homes` gives the module that defines each public name; a name that is the last part of its
    module's name stands for the module itself.  `replaced` gives advice for names that are no
    longer public.  No name may be that of another module of the package: as soon as that module is
    imported, Python finds it first.
    """

    def find(name: str) -> Any:
        if name not in homes:
            advice = f"; {replaced[name]}" if replaced and name in replaced else ""
            raise AttributeError(f"module {package!r} has no attribute {name!r}{advice}")
        home = sys.modules.get(homes[name])
        if home is None:
            with WaitingLine("loading"):
                home = import_module(homes[name])
        return home if homes[name].endswith(f".{name}") else getattr(home, name)

    return find
