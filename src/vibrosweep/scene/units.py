"""Units of a table's columns, as netCDF attributes spell them: ``mm s-1``, ``m/s``, ``deg``."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping
from typing import Final

# Unit -> numerator and denominator of its size, and its dimension with an exponent.  Dividing by
# the integer 1000 is rounded once; multiplying by 0.001 would be rounded twice.
_UNITS: Final[Mapping[str, tuple[float, float, str, int]]] = {
    "m": (1, 1, "m", 1),
    "km": (1000, 1, "m", 1),
    "cm": (1, 100, "m", 1),
    "mm": (1, 1000, "m", 1),
    "um": (1, 10**6, "m", 1),
    "kg": (1, 1, "kg", 1),
    "g": (1, 1000, "kg", 1),
    "mg": (1, 10**6, "kg", 1),
    "s": (1, 1, "s", 1),
    "ms": (1, 1000, "s", 1),
    "us": (1, 10**6, "s", 1),
    "ns": (1, 10**9, "s", 1),
    "min": (60, 1, "s", 1),
    "h": (3600, 1, "s", 1),
    "Hz": (1, 1, "s", -1),
    "mHz": (1, 1000, "s", -1),
    "kHz": (1000, 1, "s", -1),
    "MHz": (10**6, 1, "s", -1),
    "rpm": (1, 60, "s", -1),
    "rad": (1, 1, "rad", 1),
    "mrad": (1, 1000, "rad", 1),
    "deg": (math.pi, 180, "rad", 1),
    "degree": (math.pi, 180, "rad", 1),
    "degrees": (math.pi, 180, "rad", 1),
    "turn": (2.0 * math.pi, 1, "rad", 1),
    "1": (1, 1, "", 0),
    "%": (1, 100, "", 0),
    "percent": (1, 100, "", 0),
}
KNOWN_UNITS: Final = tuple(_UNITS)
_SAME: Final = {"\N{MICRO SIGN}": "u", "\N{GREEK SMALL LETTER MU}": "u", "\N{DEGREE SIGN}": "deg"}
_FACTOR: Final = re.compile(r"([A-Za-z%]+|1)(?:\^|\*\*)?([+-]?[1-9])?")


def factor(unit: str, wanted: str) -> tuple[float, float] | None:
    """Return numerator and denominator of the factor that converts a value to the wanted unit.

    A unit is a product of known units with exponents, as ``mm s-1``, ``mm.s^-1`` or ``mm/s``.
    Returns None if it is not known or has other dimensions than the wanted one.
    """
    given, target = _parsed(unit), _parsed(wanted)
    if given is None or target is None or given[2] != target[2]:
        return None
    return given[0] * target[1], given[1] * target[0]


def _parsed(unit: str) -> tuple[float, float, Mapping[str, int]] | None:
    """Return numerator and denominator of the size of a unit, and exponents of its dimensions."""
    for mark, plain in _SAME.items():
        unit = unit.replace(mark, plain)
    numerator, denominator, dimensions = 1.0, 1.0, Counter[str]()
    for k, side in enumerate(unit.split("/")):
        for word in re.split(r"[\s.]+|(?<!\*)\*(?!\*)", side.strip()):
            match = _FACTOR.fullmatch(word)
            if match is None or match[1] not in _UNITS:
                return None
            above, below, dimension, exponent = _UNITS[match[1]]
            power = int(match[2] or 1) * (-1 if k else 1)
            if power < 0:
                above, below = below, above
            numerator, denominator = (
                numerator * above ** abs(power),
                denominator * below ** abs(power),
            )
            dimensions[dimension] += exponent * power
    return numerator, denominator, {d: n for d, n in dimensions.items() if n and d}
