"""JSON Schema of sweep files, with which editors complete and check them as they are written.

It is written from the checks of the keys.  Rules between keys, and what only a run can know, such
as laws that a program registers, are beyond it: `vibrosweep plan` finds those mistakes.
``python -m vibrosweep.scene.schema`` prints it, as sweeps/sweep.schema.json holds it.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from functools import partial
from typing import Any, Final

from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.measures import MEASURES, OPTIONS, TRANSIENT_PERIODS
from vibrosweep.model.observables import KEYS
from vibrosweep.model.parameters import LARGEST, STAGGERED, Parameter
from vibrosweep.model.restitution_laws import MOST_POINTS
from vibrosweep.model.shapes import (
    HARMONICS_NAME,
    LARGEST_TONE,
    MOST_HARMONICS,
    WAVEFORMS,
    FittedTrace,
)
from vibrosweep.scene import keys
from vibrosweep.scene.design import DESIGNS, GRID
from vibrosweep.scene.scene import COLUMNS, Scene

Schema = dict[str, Any]

_FINITE: Final = {"type": "number", "minimum": -sys.float_info.max, "maximum": sys.float_info.max}
_FLAG: Final = {"type": "boolean"}
_ABOVE: Final = {"type": "number", "exclusiveMinimum": 0.0, "maximum": sys.float_info.max}
_OPTIONS: Final[Mapping[str, Schema]] = {
    "transient": {**_FINITE, "minimum": 0.0},
    TRANSIENT_PERIODS: {**_FINITE, "minimum": 0.0},
    "tolerance": _ABOVE,
    "impact_budget": {"type": "integer", "minimum": 1, "maximum": 2**62},
}


def schema() -> Schema:
    """Return the schema of sweep files."""
    title = {
        "type": "string",
        "pattern": r"^(?=.*\S)[^\x00-\x1f\x7f-\x9f]+$",
        "description": "one line that says what the sweep shows",
    }
    tables = {
        name: _object({key: _key(name, key, check) for key, check in checks.items()})
        for name, checks in keys.SECTIONS.items()
    }
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "Sweep file of vibrosweep",
        **_object({"title": title, **tables}),
        "required": ["title"],
    }


def written() -> str:
    """Return the schema as the text of its file."""
    return json.dumps(schema(), indent=1, ensure_ascii=False) + "\n"


def _object(properties: Schema) -> Schema:
    return {"type": "object", "additionalProperties": False, "properties": properties}


def _key(table: str, name: str, check: keys.Check) -> Schema:
    """Return the schema of a key: what its check allows, its meaning, its default."""
    if table == "measure":
        option = OPTIONS.get(name)
        words = f"{option.meaning} ({option.allowed})" if option else MEASURES[name].meaning
        found = {**(_OPTIONS[name] if option else _FLAG), "description": words}
        default = KEYS[name]
    else:
        found, default = _allowed(table, name, check), getattr(Scene, name, None)
    plain = isinstance(default, bool | int | float | str)
    return {**found, "default": default} if plain and table != "record" else found


def _allowed(table: str, name: str, check: keys.Check) -> Schema:
    """Return what the check of a key allows."""
    if name in INPUTS:
        return _spread(INPUTS[name]) if table == "sample" else _number(INPUTS[name])
    if check is keys.flag:
        return _FLAG
    if isinstance(check, partial) and check.func is keys.whole:
        low, high = check.args
        return _whole(low, high)
    if isinstance(check, partial) and check.func is keys.one_of:
        return {"enum": [*check.args[0]]}
    return _OTHERS[name]


def _whole(low: int, high: int) -> Schema:
    return {"type": "integer", "minimum": low, "maximum": high}


def _number(parameter: Parameter) -> Schema:
    units = "" if parameter.units == "1" else f", {parameter.units}"
    found = {
        "type": "number",
        "minimum": parameter.low,
        "maximum": parameter.high,
        "description": f"{parameter.long_name} {parameter.symbol}{units}",
    }
    return found if math.isnan(parameter.default) else {**found, "default": parameter.default}


def _spread(parameter: Parameter) -> Schema:
    """Return the schema of a number, a range or a list, and an axis."""
    description = _number(parameter)["description"]
    number = {"type": "number", "minimum": parameter.low, "maximum": parameter.high}
    num = {"type": "integer", "minimum": 2, "maximum": keys.MAX_STEPS}
    axis = {**_object({"start": number, "stop": number, "num": num})}
    return {
        "description": f"{description}: a number, a range [low, high], or values of a grid",
        "anyOf": [
            number,
            {"type": "array", "minItems": 1, "items": number},
            {**axis, "required": ["start", "stop", "num"]},
        ],
    }


def _waveform() -> Schema:
    tone = {
        "type": "array",
        "minItems": 3,
        "maxItems": 3,
        "items": [
            _whole(1, MOST_HARMONICS),
            *2 * [{"type": "number", "minimum": -LARGEST_TONE, "maximum": LARGEST_TONE}],
        ],
    }
    tones = {"type": "array", "minItems": 1, "maxItems": MOST_HARMONICS, "items": tone}
    path = {"type": "string", "minLength": 1}
    column = {"enum": [*COLUMNS]}
    number = _whole(1, MOST_HARMONICS)
    harmonics = _object({HARMONICS_NAME: tones})
    # as the text of a result holds it
    fitted = _object({**dict.fromkeys(FittedTrace._fields, True), HARMONICS_NAME: tones})
    trace = _object({"trace": path, "column": column, HARMONICS_NAME: number})
    return {
        "description": "shape of the motion of the base over a period",
        "anyOf": [
            {"enum": [name for name in WAVEFORMS if name != HARMONICS_NAME]},
            {**harmonics, "required": [HARMONICS_NAME]},
            {**fitted, "required": [*FittedTrace._fields, HARMONICS_NAME]},
            {**trace, "required": ["trace", "column", HARMONICS_NAME]},
        ],
    }


_POINT: Final = {
    "type": "array",
    "minItems": 2,
    "maxItems": 2,
    "items": [
        {"type": "number", "minimum": 0.0, "maximum": LARGEST},
        {"type": "number", "exclusiveMinimum": 0.0, "maximum": 1.0},
    ],
}
_TEXTS: Final = {"type": "array", "minItems": 1, "items": {"type": "string"}}
_OTHERS: Final[Mapping[str, Schema]] = {
    "duration": {**_ABOVE, "description": "end of the observation, s"},
    "duration_periods": {**_ABOVE, "description": "end of the observation, forcing periods"},
    "launch": {
        "description": "launch times of the particles, s",
        "anyOf": [{"const": STAGGERED}, {"type": "array", "minItems": 1, "items": _FINITE}],
    },
    "waveform": _waveform(),
    "restitution_exponent": {
        "type": "number",
        "minimum": 0.0,
        "exclusiveMaximum": 1.0,
        "description": 'exponent of restitution_law = "power": e(v) falls as v^-exponent',
    },
    "restitution_points": {
        "description": 'points of restitution_law = "points": speed (m s-1) and restitution of '
        "each, or the path of a CSV file with these columns",
        "anyOf": [
            {"type": "array", "minItems": 2, "maxItems": MOST_POINTS, "items": _POINT},
            {"type": "string", "pattern": r"\.[cC][sS][vV]$"},
        ],
    },
    "design": {
        "description": "how realizations are drawn, or the path of their table",
        "anyOf": [
            {"enum": [*DESIGNS, GRID]},
            {"type": "string", "pattern": r"[^/]\.([cC][sS][vV]|[nN][cC])$"},
        ],
    },
    "columns": {**_TEXTS, "uniqueItems": True, "description": "columns of the table to use"},
    "conditions": {
        **_TEXTS,
        "description": 'names of conditions, such as "locked(1)", "periodic", "separated"',
    },
    "tolerance": {
        "type": "number",
        "minimum": 1e-14,
        "exclusiveMaximum": 1.0,
        "description": "relative width to which the ends of windows are found",
    },
}


if __name__ == "__main__":
    sys.stdout.write(written())
