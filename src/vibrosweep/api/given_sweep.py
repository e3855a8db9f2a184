"""Sweeps as public functions take them: a sweep file, a mapping, a result, or keywords."""

from __future__ import annotations

import os
import tomllib
import warnings
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from vibrosweep.errors import DataError, ParameterError, ShortObservationWarning
from vibrosweep.model.forcing import INPUTS
from vibrosweep.scene.sweep import Sweep, keyword_spec, read_spec

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
    """Return the sweep that a path, a mapping or a result describes, or keywords if `spec` is None.

    `analysis` is passed to `keyword_spec`, `kept` to `read_spec`.  `defaults` complete keywords, a
    mapping or a result, but not a file; so does `realizations` where keywords or a mapping hold
    ranges.  Raises a SpecError that lists all mistakes, a ParameterError for keywords beside a file
    or a mapping and for a `spec` of another type, and a DataError for a dataset that does not hold
    the sweep from which it was computed.
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
            f"{', '.join(keywords)}: cannot be given beside a sweep file or a mapping; write it "
            f"there"
        )
    if isinstance(spec, Mapping):
        return keyword_spec({**defaults, **spec}, analysis, kept=kept)
    if isinstance(spec, str | os.PathLike):
        return read_spec(spec, kept)
    raise ParameterError(
        f"{type(spec).__name__}: is not a sweep; give keywords, a mapping, or the path of a sweep "
        f"file"
    )


def _sweep_of(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the tables of the sweep file of a result."""
    if "sweep_file" not in attributes:
        raise DataError(
            "the dataset is not a result of vibrosweep.sweep, run or open_sweep, or has lost its "
            "attributes, which hold the sweep: give keywords, or the path of a sweep file"
        )
    return tomllib.loads(str(attributes["sweep_file"]))


def warned(found: xr.Dataset) -> xr.Dataset:
    """Issue the notes of a result as a warning and return it; the command line prints them."""
    if found.attrs["notes"]:
        warnings.warn(found.attrs["notes"], ShortObservationWarning, stacklevel=3)
    return found
