"""Sweeps that public functions are given as a sweep file, a mapping, a result, or keywords."""

from __future__ import annotations

import os
import tomllib
import warnings
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from vibrosweep.errors import DataError, ParameterError, ShortObservationWarning
from vibrosweep.model.forcing import INPUTS
from vibrosweep.scene.keywords import keyword_spec
from vibrosweep.scene.sweep import Sweep, read_spec

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["Spec", "as_sweep", "warned"]

Spec = str | os.PathLike[str] | Mapping[str, Any]


def as_sweep(
    spec: Spec | None,
    keywords: Mapping[str, Any],
    analysis: str = "",
    realizations: int | None = None,
    kept: Callable[[], str] | None = None,
    **defaults: Any,
) -> Sweep:
    """Return the sweep that a path, a mapping or a result asks for, or keywords without any.

    `analysis` is that of `keyword_spec`, `kept` that of `read_spec`.  `realizations`, where there
    are ranges, and `defaults` complete keywords, a mapping or a result, but not a file.  Raises a
    SpecError that lists all mistakes, a ParameterError where there are keywords beside a file or a
    mapping, or `spec` is none of these, and a DataError where a dataset does not hold the sweep
    that it was computed from.
    """
    if spec is not None and hasattr(spec, "attrs"):
        completed = {**defaults, **_sweep_of(spec.attrs), **keywords}
        return keyword_spec(completed, analysis, keywords)
    stated = spec if isinstance(spec, Mapping) else keywords
    if any(name in INPUTS and isinstance(value, tuple) for name, value in stated.items()):
        defaults["realizations"] = realizations
    if spec is None:
        return keyword_spec({**defaults, **keywords}, analysis, keywords)
    if keywords:
        raise ParameterError(
            f"{', '.join(keywords)}: not beside a sweep file or a mapping; write it there"
        )
    if isinstance(spec, Mapping):
        return keyword_spec({**defaults, **spec}, analysis, kept=kept)
    if isinstance(spec, str | os.PathLike):
        return read_spec(spec, kept)
    raise ParameterError(
        f"{type(spec).__name__}: is no sweep; give keywords, a mapping, or the path of a sweep file"
    )


def _sweep_of(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of the sweep file of a result."""
    if "sweep_file" not in attributes:
        raise DataError(
            "the dataset is no result of vibrosweep.sweep, run or open_sweep, or has lost its "
            "attributes, which hold the sweep: give keywords, or the path of a sweep file"
        )
    return tomllib.loads(str(attributes["sweep_file"]))


def warned(found: xr.Dataset) -> xr.Dataset:
    """Warn of the notes of a result; the command line prints them itself."""
    if found.attrs["notes"]:
        warnings.warn(found.attrs["notes"], ShortObservationWarning, stacklevel=3)
    return found
