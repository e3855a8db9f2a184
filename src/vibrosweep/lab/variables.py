"""Variables of datasets with units and meanings, and values with their errors as text."""

from __future__ import annotations

import math
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


def with_error(value: float, error: float, digits: int = 4) -> str:
    """State a value, and its standard error if it has one."""
    return f"{value:.{digits}g}" + (f" ± {error:.2g}" if math.isfinite(error) else "")
