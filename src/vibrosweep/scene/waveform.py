"""Waveforms as a sweep file gives them."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from vibrosweep.mistakes import quoted
from vibrosweep.model.shapes import (
    FORMS,
    HARMONICS_NAME,
    MOST_HARMONICS,
    PARABOLIC_NAME,
    SINE,
    SINE_NAME,
    Trace,
    Waveform,
    harmonics_of,
    name_in,
)

COLUMNS: Final = ("height", "acceleration")  # of a trace
_STORED: Final = (HARMONICS_NAME, *Trace._fields)  # keys of a fitted trace in a result


@dataclass(frozen=True)
class Traced:
    """A waveform that is given by the path of a trace."""

    trace: str
    column: str
    harmonics: int


def waveform_of(value: object) -> Waveform | Traced:
    """Return the waveform that a key gives, or raise a ValueError that says what is allowed."""
    if value in (SINE_NAME, PARABOLIC_NAME):
        return Waveform(str(value))
    if isinstance(value, Mapping) and set(value) == {"trace", "column", HARMONICS_NAME}:
        return _traced(**value)
    if not isinstance(value, Mapping) or set(value) not in ({HARMONICS_NAME}, {*_STORED}):
        raise ValueError(FORMS)
    origin = Trace(*(value[name] for name in Trace._fields)) if "trace" in value else ()
    return harmonics_of(value[HARMONICS_NAME], origin)


def stored(attributes: Mapping[str, Any]) -> Waveform:
    """Return the waveform that attributes of a result hold; by default the sine."""
    text = str(attributes.get("waveform", SINE_NAME))
    value = text if name_in(attributes) == text else tomllib.loads(f"waveform = {text}")["waveform"]
    found = waveform_of(value)
    return found if isinstance(found, Waveform) else SINE


def _traced(trace: object, column: object, harmonics: Any) -> Traced:
    """Check the description of a trace; a ValueError says what is wrong with it."""
    if not isinstance(trace, str) or not trace:
        raise ValueError('the trace must be the path of a CSV file, as in "shaker.csv"')
    if column not in COLUMNS:
        raise ValueError(f"the column of the trace must be {quoted(COLUMNS)}")
    whole = isinstance(harmonics, int) and not isinstance(harmonics, bool)
    if not whole or not 1 <= harmonics <= MOST_HARMONICS:
        raise ValueError(f"harmonics of a trace: must be a whole number from 1 to {MOST_HARMONICS}")
    return Traced(trace, column, harmonics)
