"""Waveforms as a sweep file gives them."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
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
from vibrosweep.scene.traces import COLUMNS, Traced

_TRACE: Final = ("trace", "column", HARMONICS_NAME)
_STORED: Final = (HARMONICS_NAME, *Trace._fields)  # keys of a fitted trace in a result


def waveform_of(value: object) -> Waveform | Traced:
    """Return the waveform that a key gives, or raise a ValueError that says what is allowed."""
    if value in (SINE_NAME, PARABOLIC_NAME):
        return Waveform(str(value))
    if isinstance(value, Mapping) and set(value) == {*_TRACE} and _of_trace(value):
        return Traced(value["trace"], value["column"], value[HARMONICS_NAME])
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


def _of_trace(value: Mapping[str, Any]) -> bool:
    """Return True for a valid description of a trace; a ValueError says what is wrong with it."""
    number = value[HARMONICS_NAME]
    if not isinstance(value["trace"], str) or not value["trace"]:
        raise ValueError('the trace must be the path of a CSV file, as in "shaker.csv"')
    if value["column"] not in COLUMNS:
        raise ValueError(f"the column of the trace must be {quoted(COLUMNS)}")
    if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= MOST_HARMONICS:
        raise ValueError(f"harmonics of a trace: must be a whole number from 1 to {MOST_HARMONICS}")
    return True
