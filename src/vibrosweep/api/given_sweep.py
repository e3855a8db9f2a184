"""Sweeps that public functions are given as a sweep file, a mapping, or keywords."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from vibrosweep.errors import ParameterError, ShortObservationWarning
from vibrosweep.scene.keywords import keyword_spec
from vibrosweep.scene.sweep import Sweep, read_spec

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Spec", "as_sweep", "warned"]

Spec = str | os.PathLike[str] | Mapping[str, Any]


def as_sweep(spec: Spec | None, keywords: Mapping[str, Any], *first: str, **defaults: Any) -> Sweep:
    """Return the sweep that a path or a mapping asks for, or keywords where there is neither.

    `first` is that of `keyword_spec`; `defaults` complete keywords or a mapping, but not a file.
    Raises a SpecError that lists all mistakes, and a ParameterError where there are both, or `spec`
    is neither path nor mapping.
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


def warned(found: xr.Dataset) -> xr.Dataset:
    """Warn of the notes of a result; the command line prints them itself."""
    if found.attrs["notes"]:
        warnings.warn(found.attrs["notes"], ShortObservationWarning, stacklevel=3)
    return found
