"""Sweeps that public functions are given as a sweep file, a mapping, or keywords."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from vibrosweep.errors import ParameterError
from vibrosweep.scene.keywords import keyword_spec
from vibrosweep.scene.sweep import Sweep, read_spec

__all__ = ["Spec", "as_sweep"]

Spec = str | os.PathLike[str] | Mapping[str, Any]


def as_sweep(spec: Spec | None, keywords: Mapping[str, Any], *first: str, **defaults: Any) -> Sweep:
    """Return the sweep that a path or a mapping asks for, or keywords where there is neither.

    `first` is that of `keyword_spec`; `defaults` are what keywords or a mapping need not state, and
    a file must.  Raises a SpecError that lists all mistakes, and a ParameterError where there are
    both, or `spec` is neither path nor mapping.
    """
    if spec is None:
        return keyword_spec({**defaults, **keywords}, *first)
    if keywords:
        raise ParameterError(
            f"{', '.join(keywords)}: not beside a sweep file or a mapping; write it there"
        )
    if isinstance(spec, Mapping):
        return keyword_spec({**defaults, **spec}, *first)
    if isinstance(spec, str | os.PathLike):
        return read_spec(spec)
    raise ParameterError(
        f"{type(spec).__name__}: is no sweep; give keywords, a mapping, or the path of a sweep file"
    )
