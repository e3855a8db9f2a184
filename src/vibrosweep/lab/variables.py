"""Variables of datasets, with units and meanings."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from typing import Any


def with_units(
    dims: Hashable | Sequence[Hashable], columns: Mapping[str, tuple[Any, str, str]]
) -> dict[str, Any]:
    """Make variables of a dataset from the values, units and meaning of each."""
    return {
        name: (dims, values, {"units": units, "long_name": words})
        for name, (values, units, words) in columns.items()
    }
