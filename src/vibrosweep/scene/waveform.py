"""Waveforms as a sweep file gives them."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from typing import Any, Final

from vibrosweep.mistakes import quoted
from vibrosweep.model.shapes import (
    HARMONICS_NAME,
    MOST_HARMONICS,
    PARABOLIC_NAME,
    SINE,
    SINE_NAME,
    Tone,
    Trace,
    Waveform,
    name_in,
)
from vibrosweep.scene.traces import COLUMNS, Traced

_FORMS: Final = (
    f'must be "{SINE_NAME}", "{PARABOLIC_NAME}", or the harmonics of the velocity of the base, '
    f"each with its number, weight and phase in rad, as in "
    f"{{ {HARMONICS_NAME} = [[1, 1.0, 0.0], [2, 0.4, 1.1]] }}, or a measured trace, as in "
    f'{{ trace = "shaker.csv", column = "height", {HARMONICS_NAME} = 8 }}'
)
_TRACE: Final = ("trace", "column", HARMONICS_NAME)
_STORED: Final = (HARMONICS_NAME, *Trace._fields)  # as a result holds it
_LARGEST: Final = 1e6  # of a weight and a phase


def waveform_of(value: object) -> Waveform | Traced:
    """Return the waveform that a key gives, or raise ValueError with what is allowed."""
    if value in (SINE_NAME, PARABOLIC_NAME):
        return Waveform(str(value))
    if isinstance(value, Mapping) and set(value) == {*_TRACE} and _of_trace(value):
        return Traced(value["trace"], value["column"], value[HARMONICS_NAME])
    if not isinstance(value, Mapping) or set(value) not in ({HARMONICS_NAME}, {*_STORED}):
        raise ValueError(_FORMS)
    origin = Trace(*(value[name] for name in Trace._fields)) if "trace" in value else ()
    listed = value[HARMONICS_NAME]
    if not isinstance(listed, list) or not listed:
        raise ValueError("the list of harmonics is empty; ", _FORMS)
    if len(listed) > MOST_HARMONICS:
        raise ValueError(f"has {len(listed)} harmonics; at most {MOST_HARMONICS} are allowed")
    tones = tuple(sorted(_tone(one) for one in listed))
    numbers = [h for h, _, _ in tones]
    if len({*numbers}) < len(numbers):
        raise ValueError("gives a harmonic twice; sum the two, or leave one out")
    if not any(weight for _, weight, _ in tones):
        raise ValueError("has no harmonic whose weight differs from 0: such a base does not move")
    return Waveform(HARMONICS_NAME, tones, origin)


def stored(attributes: Mapping[str, Any]) -> Waveform:
    """Waveform that attributes of a result hold; by default the sine."""
    text = str(attributes.get("waveform", SINE_NAME))
    value = text if name_in(attributes) == text else tomllib.loads(f"waveform = {text}")["waveform"]
    found = waveform_of(value)
    return found if isinstance(found, Waveform) else SINE


def _of_trace(value: Mapping[str, Any]) -> bool:
    """Return whether a trace is asked for; a ValueError says what is wrong with it."""
    number = value[HARMONICS_NAME]
    if not isinstance(value["trace"], str) or not value["trace"]:
        raise ValueError('the trace must be the path of a CSV file, as in "shaker.csv"')
    if value["column"] not in COLUMNS:
        raise ValueError(f"the column of the trace must be {quoted(COLUMNS)}")
    if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= MOST_HARMONICS:
        raise ValueError(f"harmonics of a trace: must be a whole number from 1 to {MOST_HARMONICS}")
    return True


def _tone(one: Any) -> Tone:
    """Return number, weight and phase of a harmonic."""
    if not isinstance(one, list) or len(one) != 3:
        raise ValueError(f"harmonic {one!r} is not a list of number, weight and phase in rad")
    h, *others = one
    if h == 0 and not isinstance(h, bool):
        raise ValueError("harmonic 0 is a mean velocity, with which the base would wander off")
    if isinstance(h, bool) or not isinstance(h, int) or not 1 <= h <= MOST_HARMONICS:
        raise ValueError(
            f"harmonic number {h!r} must be a whole number from 1 to {MOST_HARMONICS}, or the "
            f"motion has no period of one turn"
        )
    for what, number in zip(("weight", "phase in rad"), others, strict=True):
        real = isinstance(number, int | float) and not isinstance(number, bool)
        if not (real and math.isfinite(number) and abs(number) <= _LARGEST):
            raise ValueError(
                f"the {what} of harmonic {h} is {number!r}; it must be a number from {-_LARGEST:g} "
                f"to {_LARGEST:g}"
            )
    return h, float(others[0]), float(others[1])
