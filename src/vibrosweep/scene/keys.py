"""Tables and keys of a sweep file, which are also the keywords of Python: types and ranges.

`vibrosweep.scene.rules` reports contradictions between keys.  The checks are plain functions,
because building the models of a validation library took longer than a whole small sweep.
"""

from __future__ import annotations

import math
import unicodedata
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import PurePath
from typing import Any, Final, TypeGuard

from vibrosweep.mistakes import (
    RANGE,
    SWITCH,
    Key,
    Mistakes,
    Text,
    Value,
    Word,
    nearest,
    quoted,
    table,
)
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.limits import another_name, answer_to, likely_parameter
from vibrosweep.model.measures import OPTIONS, Option
from vibrosweep.model.parameters import BASES, LAWS, STAGGERED, Parameter
from vibrosweep.model.restitution_laws import RESTITUTION_LAWS
from vibrosweep.model.scene_measures import KEYS
from vibrosweep.model.times import Periods
from vibrosweep.scene.columns import GivenTable
from vibrosweep.scene.design import DESIGNS, GRID
from vibrosweep.scene.waveform import waveform_of

SUFFIXES: Final = (".csv", ".nc")

# Far beyond any disk or memory, and small enough that no index reaches 2**63
MAX_REALIZATIONS: Final = 10**12
MAX_PARTICLES: Final = 10**9
MAX_SEED: Final = 2**63 - 1  # the largest integer of TOML
MAX_STEPS: Final = 10**6  # values of an axis, which is held in memory

# Returns the value of a key in its own type, or raises a ValueError that says what is allowed
Check = Callable[[object], Any]
# Checks of the keys of each table
Sections = Mapping[str, Mapping[str, Check]]


@dataclass(frozen=True)
class Steps:
    """An axis as ``{ start = ..., stop = ..., num = ... }``: num values, both ends included."""

    start: float
    stop: float
    num: int


Spread = float | tuple[float, ...] | Steps  # values of a parameter in [sample]
Tables = dict[str, dict[str, Any]]


def read_tables(
    data: Mapping[str, Any], mistakes: Mistakes, sections: Sections | None = None
) -> tuple[str | None, Tables]:
    """Check each key of a parsed file by itself; return its title and its tables.

    Keys with a mistake are noted in ``mistakes`` and left out, so that the rules between the
    remaining keys can still be checked.  By default the tables are those of a sweep file.
    """
    sections = sections or SECTIONS
    of_tables: dict[str, Check] = {name: partial(_table, name) for name in sections}
    top = _valid("", data, {"title": _title, **of_tables}, mistakes, sections)
    tables = {
        name: _valid(name, top[name], checks, mistakes, sections)
        for name, checks in sections.items()
        if name in top
    }
    for name, time in (("scene", "duration"), ("record", "duration"), ("measure", "transient")):
        _one_time(name, time, tables.get(name, {}), mistakes)
    return top.get("title"), tables


def inputs_in(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return the physical parameters of a table, in the order of `INPUTS`."""
    return {name: table[name] for name in INPUTS if name in table}


def _valid(
    home: str,
    data: Mapping[str, Any],
    checks: Mapping[str, Check],
    mistakes: Mistakes,
    sections: Sections,
) -> dict[str, Any]:
    """Return the values of the known keys that pass their check; note the others."""
    valid = {}
    for name, value in data.items():
        key = f"{home}.{name}" if home else name
        if name not in checks:
            _note_unknown(home, name, value, mistakes, sections)
            continue
        try:
            valid[name] = checks[name](value)
        except ValueError as error:
            mistakes.add_broken(key, error.args, value)
    return valid


def _note_unknown(
    home: str, name: str, value: object, mistakes: Mistakes, sections: Sections
) -> None:
    """Say which key was probably meant, or where it belongs."""
    known: Collection[str] = sections[home] if home else ("title", *sections)
    prefix = f"{home}." if home else ""
    if answer := answer_to(name, known):
        mistakes.add_broken(prefix + name, f"is not a known key: {answer}", value)
        mistakes.broken.add(f"{prefix}{another_name(name)}")
        return
    homes = [table(t) for t, checks in sections.items() if name in checks]
    guess = None if homes else nearest(name, known)
    hint: Text = f'; did you mean "{guess}"?' if guess else "."
    if homes:
        hint = ("; it belongs in ", homes[0], *((" or ", home) for home in homes[1:]), ".")
    where: Text = ("of ", table(home)) if home else Word("at the top of the file", "here")
    rule = ("is not a known key", hint, " Known keys ", where, f": {', '.join(known)}")
    mistakes.add_broken(prefix + name, rule, value)
    if guess:  # the key that was meant is neither missing nor at its default
        mistakes.broken.add(prefix + guess)


def _one_time(home: str, key: str, values: dict[str, Any], mistakes: Mistakes) -> None:
    """Store a time given in periods under the key of the time in s; report if both are given."""
    of_periods = f"{key}_periods"
    if of_periods not in values:
        return
    number = values.pop(of_periods)
    if key in values:
        rule = (Key(f"{home}.{key}"), f" = {values[key]} is given too")
        mistakes.add_broken(f"{home}.{of_periods}", rule, number, "keep one of the two")
        mistakes.broken.add(f"{home}.{key}")
    else:
        values[key] = Periods(number)


def _title(value: object) -> str:
    if isinstance(value, str) and value.strip() and is_plain(value):
        return value
    raise ValueError("must be one line of text, not empty, that says what the sweep shows")


def is_plain(text: str) -> bool:
    """Return whether a text is free of control characters, which a terminal might obey."""
    return not any(unicodedata.category(character) == "Cc" for character in text)


def _table(name: str, value: object) -> Mapping[str, Any]:
    if isinstance(value, Mapping):
        return value
    raise ValueError("must be ", Word(f"a table: write [{name}] on a line of its own", "a mapping"))


def whole_number(low: int, high: int) -> Check:
    """Return the check of a whole number in a range."""

    def check(value: object) -> int:
        if isinstance(value, int) and not isinstance(value, bool) and low <= value <= high:
            return int(value)
        raise ValueError(f"must be a whole number, at least {low} and at most {high}")

    return check


def flag(value: object) -> bool:
    """Return a boolean, or raise ValueError."""
    if isinstance(value, bool):
        return value
    raise ValueError("must be ", SWITCH)


def _positive(units: str, value: object) -> float:
    if _is_finite_number(value) and value > 0:
        return float(value)
    raise ValueError(f"must be a number, finite and above 0 {units}")


def _option(option: Option, kind: type[float], value: object) -> float:
    if _is_finite_number(value) and option.accepts(value) and isinstance(value, int | kind):
        return kind(value)
    raise ValueError(f"must be {option.allowed}")


def _launch(value: object) -> str | tuple[float, ...]:
    if value == STAGGERED:
        return STAGGERED
    if isinstance(value, list) and value and all(_is_finite_number(v) for v in value):
        return tuple(float(v) for v in value)
    raise ValueError(f'must be "{STAGGERED}" or a list of finite launch times in s')


def one_of(names: Sequence[str], value: object) -> str:
    """Return a value that is one of these names, or raise ValueError."""
    if isinstance(value, str) and value in names:
        return value
    raise ValueError(f"must be {quoted(names)}")


def _spread(parameter: Parameter, value: object) -> Spread:
    if isinstance(value, list):
        if not value:
            raise ValueError(
                "the list is empty: give ",
                RANGE,
                f", or under a grid the values (allowed: {parameter.allowed})",
            )
        return tuple(_within(parameter, v) for v in value)
    if isinstance(value, Mapping):
        return _steps(parameter, value)
    return _within(parameter, value)


def _design(value: object) -> str | GivenTable:
    if isinstance(value, GivenTable):
        return value
    known = (*DESIGNS, GRID)
    text = value if isinstance(value, str) else ""
    if text in known or PurePath(text).suffix.lower() in SUFFIXES:
        return text
    guess = nearest(text, known)
    hint = f'; did you mean "{guess}"?' if guess else ""
    raise ValueError(
        f"is not a known design; it must be {quoted(known)}, or the path of a table that ends "
        f"in {quoted(SUFFIXES)}{hint}"
    )


def _conditions(value: object) -> tuple[Any, ...]:
    """Return conditions: names, or objects such as `vibrosweep.analysis.Condition`."""
    listed = value if isinstance(value, list) else []
    if listed and all(isinstance(one, str) or hasattr(one, "judge") for one in listed):
        return tuple(dict.fromkeys(listed))
    raise ValueError('must be a list of one or more names of conditions, as in ["locked(1)"]')


def _bracket(value: object) -> float:
    if isinstance(value, float) and 1e-14 <= value < 1.0:
        return value
    raise ValueError("must be a number, at least 1e-14 and below 1")


def _columns(value: object) -> tuple[str, ...]:
    if not (isinstance(value, list) and value and all(isinstance(v, str) for v in value)):
        raise ValueError(f"must be a list of columns of the table: {quoted(INPUTS)}, and labels")
    for name in value:
        guess = None if name in INPUTS else likely_parameter(name)
        if guess:
            raise ValueError(
                f'"{name}" is not a physical parameter; did you mean "{guess}"? Known: '
                f"{quoted(INPUTS)}; a label needs another name"
            )
    if not set(value) & INPUTS.keys():
        raise ValueError(f"must name one or more of {quoted(INPUTS)}")
    if len(set(value)) < len(value):
        raise ValueError("names a column twice: name each once")
    return tuple(sorted(value, key=[*INPUTS, *value].index))


def _is_finite_number(value: object) -> TypeGuard[float]:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond double precision
        return False


def _within(parameter: Parameter, value: object) -> float:
    """Return a number in the parameter's range, or raise a ValueError that says what is allowed."""
    if not _is_finite_number(value):
        raise ValueError(Value(value), f" is not a finite number (allowed: {parameter.allowed})")
    if not parameter.accepts(float(value)):
        rule = f" is out of range: the {parameter.long_name} must be {parameter.allowed}"
        raise ValueError(Value(value), rule)
    return float(value)


def _single(parameter: Parameter, value: object) -> float:
    """Return a number, or raise a ValueError; several numbers belong elsewhere."""
    if not isinstance(value, list | tuple | Mapping):
        return _within(parameter, value)
    rule = f"must be one number (allowed: {parameter.allowed}); ranges and lists are for "
    raise ValueError(rule, table("sample"))


def _steps(parameter: Parameter, value: Mapping[str, object]) -> Steps:
    if set(value) != {"start", "stop", "num"}:
        axis = "{ start = 0.1, stop = 0.9, num = 9 }"
        raise ValueError(f"write an axis as {axis}, with exactly these keys, or a range as ", RANGE)
    start, stop = _within(parameter, value["start"]), _within(parameter, value["stop"])
    num = value["num"]
    if isinstance(num, bool) or not isinstance(num, int) or not 2 <= num <= MAX_STEPS:
        raise ValueError(f"num must be a whole number, at least 2 and at most {MAX_STEPS}")
    if not start < stop:
        raise ValueError("start must be less than stop")
    return Steps(start, stop, num)


_SEED: Final = whole_number(0, MAX_SEED)
_SCENE: Final[Mapping[str, Check]] = {
    **{name: partial(_single, parameter) for name, parameter in INPUTS.items()},
    "particles": whole_number(1, MAX_PARTICLES),
    "launch": _launch,
    "duration": partial(_positive, "s"),
    "duration_periods": partial(_positive, "forcing periods"),
    "base": partial(one_of, BASES),
    "rebound": partial(one_of, LAWS),
    "waveform": waveform_of,
    "noise_seed": _SEED,
    "restitution_law": partial(one_of, RESTITUTION_LAWS),
}
SECTIONS: Final[Sections] = {
    "scene": _SCENE,
    "sample": {
        "design": _design,
        "realizations": whole_number(1, MAX_REALIZATIONS),
        "seed": _SEED,
        "columns": _columns,
        **{name: partial(_spread, parameter) for name, parameter in INPUTS.items()},
    },
    "measure": {
        key: partial(_option, OPTIONS[key], int if isinstance(default, int) else float)
        if key in OPTIONS
        else flag
        for key, default in KEYS.items()
    },
    "record": {**_SCENE, "ragged": flag},
    "windows": {
        "conditions": _conditions,
        "continuation": flag,
        "tolerance": _bracket,
        "prove": flag,
        "noise_replicas": whole_number(1, 10**6),
    },
}
