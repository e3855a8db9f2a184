"""Keys of a sweep file, which are also the keywords of Python: types, ranges, rules between them.

The checks are plain functions, because building the models of a validation library took longer than
a whole small sweep.  The functions after `SECTIONS` report contradictions between keys, each with
its remedy.
"""

from __future__ import annotations

import itertools
import math
import os
import unicodedata
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import PurePath
from typing import Any, Final, TypeGuard

import numpy as np

from vibrosweep.abilities import refusal
from vibrosweep.errors import ParameterError
from vibrosweep.mistakes import (
    PYTHON,
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
from vibrosweep.model.forcing import (
    FORCINGS,
    INPUTS,
    another_name,
    answer_to,
    completed,
    forcing_of,
    likely_parameter,
    only_parameters,
    refuse_extreme,
)
from vibrosweep.model.measures import MEASURES, OPTIONS, Option
from vibrosweep.model.observables import KEYS, Measures
from vibrosweep.model.parameters import (
    BASES,
    LAWS,
    MASS_RATIO,
    MASSES,
    MOUNT,
    NOISE,
    OF_MOUNT,
    OF_RESTITUTION,
    RELATIVE_NOISE,
    SPRUNG,
    STAGGERED,
    STREAM_PARTICLES,
    STREAMS,
    Parameter,
    Periods,
    Time,
    amount,
    dimensionless,
    launches,
    mount_mistakes,
    noise_mistakes,
    precedes,
    unit_of,
)
from vibrosweep.model.restitution_laws import (
    CONSTANT,
    NUMBERS_OF,
    POINTS,
    RESTITUTION_LAWS,
    SPEED,
    Points,
    exponent_of,
    implied,
    name_of,
    points_of,
    speed_mistakes,
    text_of,
)
from vibrosweep.scene.design import DESIGNS, GRID, TABLE, GivenTable, GridAxis, Range
from vibrosweep.scene.scene import Scene, waveform_of

__all__ = [
    "MAX_SEED",
    "SECTIONS",
    "Check",
    "Sections",
    "flag",
    "one_of",
    "read_tables",
    "whole_number",
]

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
    # free of control characters, which a terminal might obey
    if isinstance(value, str) and value.strip() and "Cc" not in map(unicodedata.category, value):
        return value
    raise ValueError("must be one line of text, not empty, that says what the sweep shows")


def _table(name: str, value: object) -> Mapping[str, Any]:
    if isinstance(value, Mapping):
        return value
    raise ValueError("must be ", Word(f"a table: write [{name}] on a separate line", "a mapping"))


def whole(low: int, high: int, value: object) -> int:
    """Return a whole number in a range, or raise ValueError."""
    if isinstance(value, int) and not isinstance(value, bool) and low <= value <= high:
        return int(value)
    raise ValueError(f"must be a whole number, at least {low} and at most {high}")


def whole_number(low: int, high: int) -> Check:
    """Return the check of a whole number in a range."""
    return partial(whole, low, high)


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


def _points(value: object) -> Points | str:
    """Return points of a law of restitution, or the path of their table."""
    if isinstance(value, str | os.PathLike):
        if str(value).lower().endswith(".csv"):
            return str(value)
        raise ValueError("the path of a table of points must end in .csv")
    return points_of(value)


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
    "restitution_exponent": exponent_of,
    "restitution_points": _points,
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


# The base and the law of restitution, with the parameters that only some of them need
_LAW: Final = ("restitution_law", *NUMBERS_OF.values())
_IMPLIED: Final = f"follows from {NUMBERS_OF[POINTS]}; leave it out"
DEPENDENT: Final = ("base", *OF_MOUNT, *_LAW, *OF_RESTITUTION)
OF_SLIP: Final = frozenset(("restitution_noise", RELATIVE_NOISE))  # ways to give the same noise
Table = Mapping[str, Any]  # valid values of a table of a sweep file, by key


def kind(sample: Table) -> str:
    """Return the kind of design; a path means ``"table"``."""
    design = sample.get("design", "uniform")
    known = isinstance(design, str) and design in (*DESIGNS, GRID)
    return str(design) if known else TABLE


def settings(name: str, table: Table, shared: Table, mistakes: Mistakes) -> dict[str, Any]:
    """Return the settings of the table ``name`` ([scene] or [record]), completed by ``shared``.

    These are the fields of a `Scene`, apart from its inputs and measures.
    """
    found = {key: table.get(key, value) for key, value in shared.items()}
    found["restitution_law"] = _law(name, table, shared["restitution_law"], mistakes)
    launch = found["launch"]
    if "launch" in table and "particles" not in table and isinstance(launch, tuple):
        found["particles"] = len(launch)
    if "particles" in table and isinstance(launch, tuple) and len(launch) != found["particles"]:
        holder = f"{name}.launch" if "launch" in table else "scene.launch"
        mistakes.add(
            f"{name}.particles",
            (f"contradicts the {len(launch)} launch times of ", Key(holder)),
            found["particles"],
            "give one for each particle",
            involves=[f"{name}.launch", "scene.launch"],
        )
    wrong = refusal(found["base"], law=found["rebound"])
    if wrong and not {"base", "rebound"}.isdisjoint(table):
        involved = [f"{t}.{k}" for t in (name, "scene") for k in ("base", "rebound")]
        mistakes.add(f"{name}.", wrong, involves=involved)
    return found


def _law(home: str, table: Table, shared: str, mistakes: Mistakes) -> str:
    """Return the law of restitution of a table with its numbers, by default a shared one."""
    law = table.get("restitution_law", name_of(shared))
    involved = [f"{t}.{key}" for t in (home, "scene") for key in _LAW]
    for name, key in NUMBERS_OF.items():
        if key in table and name != law:
            rule = f'belongs to restitution_law = "{name}"'
            remedy = "write that law, or leave it out"
            mistakes.add(f"{home}.{key}", rule, table[key], remedy, involved)
    if law not in NUMBERS_OF:
        return str(law)
    if NUMBERS_OF[law] in table:
        return text_of(law, table[NUMBERS_OF[law]])
    if law == name_of(shared):
        return shared
    rule = f'is missing; restitution_law = "{law}" needs it'
    mistakes.add(f"{home}.{NUMBERS_OF[law]}", rule, involves=involved)
    mistakes.broken.add(f"{home}.{NUMBERS_OF[law]}")
    return CONSTANT


def check_window(
    begin: Time, end: Time, frequencies: Collection[float], mistakes: Mistakes
) -> None:
    """Report if the window of measures is empty at one of the frequencies, in Hz."""
    if not precedes(begin, end, np.array([*frequencies], np.float64)):
        keys = [
            f"{key}_periods" if isinstance(time, Periods) else key
            for key, time in (("measure.transient", begin), ("scene.duration", end))
        ]
        rule = ("must be less than ", Key(keys[1]), f" = {amount(end)} {unit_of(end)}")
        mistakes.add(keys[0], rule, amount(begin), involves=["scene.duration", *keys])


def check_measures(
    base: str, noise: Collection[str], measures: Measures, mistakes: Mistakes
) -> None:
    """Report measures that do not work with the base or the noise."""
    for key in MEASURES:
        wrong = refusal(base, measure=key, noise=noise)
        if wrong and getattr(measures, key):
            mistakes.add(f"measure.{key}", wrong, True, involves=["scene.base"])


def check_noise(
    scene: Table, homes: Mapping[str, str], sizes: Mapping[str, int], mistakes: Mistakes
) -> None:
    """Report noise that the base does not support, or too many realizations or particles for it.

    `scene` holds the settings of the scene; `homes` names the table that gives each kind of noise.
    """
    for name, home in homes.items():
        if wrong := refusal(scene["base"], noise=(name,)):
            mistakes.add(f"{home}.{name}", wrong, involves=["scene.base", "record.base"])
    for key, most in (("sample.realizations", STREAMS), ("scene.particles", STREAM_PARTICLES)):
        number = sizes.get(key, 0)
        if homes and number > most:
            rule = f"with noise it must be at most {most}, the number of random sequences"
            mistakes.add(key, rule, number)


def noise_homes(numbers: Table, sample: Table, varied: Collection[str]) -> dict[str, str]:
    """Return the table that gives each kind of noise that is not zero."""
    on = [name for name in NOISE if name in varied or numbers.get(name, 0.0) != 0.0]
    return {name: "sample" if name in sample or name in varied else "scene" for name in on}


def check_forcing(scene: Table, sample: Table, mistakes: Mistakes) -> None:
    """Report a forcing that is given in two ways."""
    given: list[tuple[str, str, object]] = [
        (f"{table}.{name}", name, parameters[name])
        for table, parameters in (("scene", scene), ("sample", sample))
        for name in FORCINGS
        if name in parameters
    ]
    named = sample.get("columns", ())
    given += [("sample.columns", name, named) for name in FORCINGS if name in named]
    for key, name, value in given[1:]:
        first, before, _ = given[0]
        if name != before:
            also = Word(f"{before} in {first}", before)
            rule = (f"{name} gives the forcing, and so does ", also)
            mistakes.add(key, rule, value, "keep one of the two", involves=[first])


def check_given(base: str, law: str, scene: Table, sample: Table, mistakes: Mistakes) -> None:
    """Report parameters that the base or the law of restitution lacks, or does not have.

    If the file does not name the columns of its table, they are checked when the table is read.
    """
    if kind(sample) == TABLE and "columns" not in sample:
        return
    homes = dict.fromkeys(sample.get("columns", ()), "sample.columns")
    homes |= {name: f"sample.{name}" for name in inputs_in(sample)}
    homes |= {name: f"scene.{name}" for name in inputs_in(scene)}
    involved = [f"{t}.{name}" for t in ("scene", "sample") for name in DEPENDENT]
    wrong = {name: _IMPLIED for name in implied(law) if name in homes}
    wrong |= {**mount_mistakes(base, homes), **speed_mistakes(law, {*homes, *implied(law)})}
    wrong |= noise_mistakes(homes)
    for name, text in wrong.items():
        key = homes.get(name, f"scene.{name}")
        mistakes.add(key, text if key.endswith(name) else f"{name} {text}", involves=involved)


def fixed_numbers(scene: Table, sample: Table, mistakes: Mistakes) -> dict[str, float]:
    """Return the parameters that are given as numbers; report those that are given twice."""
    in_scene, in_sample = inputs_in(scene), inputs_in(sample)
    for name in in_sample:
        if name in in_scene:
            rule = ("is given as ", Key(f"scene.{name}"), f" = {in_scene[name]} too")
            mistakes.add(f"sample.{name}", rule, in_sample[name], "keep one of the two")
    return {**in_scene} | {n: v for n, v in in_sample.items() if isinstance(v, float)}


def sampled(sample: Table, mistakes: Mistakes) -> dict[str, Range | GridAxis]:
    """Return the ranges, or under a grid the axes, in the order of `INPUTS`."""
    found: dict[str, Range | GridAxis] = {}
    for name, value in inputs_in(sample).items():
        if isinstance(value, float):
            continue
        key = f"sample.{name}"
        if kind(sample) == TABLE:
            mistakes.add(key, "must be a number, because the table gives what varies", value)
        elif kind(sample) == GRID:
            found[name] = _axis(key, value, mistakes)
        else:
            found[name] = _range(key, value, kind(sample), mistakes)
    return found


def _axis(key: str, value: tuple[float, ...] | Steps, mistakes: Mistakes) -> GridAxis:
    if isinstance(value, Steps):
        values = tuple(np.linspace(value.start, value.stop, value.num).tolist())
    else:
        values = value
    if len(set(values)) < len(values):
        mistakes.add(key, "names a value of the axis twice", value, "name each once")
    return GridAxis(values)


def _range(key: str, value: tuple[float, ...] | Steps, design: str, mistakes: Mistakes) -> Range:
    rule: Text
    if isinstance(value, Steps) or len(value) != 2:
        rule = ("must be a number or ", RANGE, f' under design = "{design}"')
        shown = asdict(value) if isinstance(value, Steps) else value
        mistakes.add(key, rule, shown, 'an axis needs "grid"')
        return Range(0.0, 1.0)
    low, high = value
    allowed = INPUTS[key.partition(".")[2]].allowed
    if low == high:
        rule = f"the range is empty: low must be less than high (allowed: {allowed})"
        mistakes.add(key, rule, value, f"to keep the parameter fixed write the number {low}")
    elif low > high:
        rule = f"the range is reversed: low must be less than high (allowed: {allowed})"
        mistakes.add(key, rule, value, ("write ", Value((high, low))))
    return Range(low, high)


def check_unused(tables: Tables, mistakes: Mistakes, *, every: bool) -> None:
    """Report keys that have no meaning because another key is missing.

    If `every` is False, only keywords are reported: the text that a result of an earlier version
    holds may have such keys.
    """
    scene, sample, measure = (tables.get(name, {}) for name in ("scene", "sample", "measure"))
    design, unless = kind(sample), " as well, or leave it out"
    unused: dict[str, tuple[Text, Text]] = {}
    if "seed" in sample and design in (GRID, TABLE):
        rule = f"nothing is drawn under a {design}"
        unused["sample.seed"] = (rule, "leave it out, or take a design that draws")
    random = NOISE.keys() & {*scene, *sample, *sample.get("columns", ())}
    if "noise_seed" in scene and not random and (design != TABLE or "columns" in sample):
        unused["scene.noise_seed"] = ("nothing is random", f"give {', '.join(NOISE)}{unless}")
    if "tolerance" in measure and "trust" not in measure:
        rule = "bounds the error up to which landings are trusted"
        unused["measure.tolerance"] = (rule, ("give ", Key("measure.trust"), unless))
    for key, (words, remedy) in unused.items():
        table, _, name = key.partition(".")
        if every or PYTHON.key(key) in mistakes.given:
            value = tables[table][name]
            mistakes.add(key, words, value, remedy, involves=["sample.design", "measure.trust"])


def columns(sample: Table, numbers: Collection[str], mistakes: Mistakes) -> tuple[str, ...] | None:
    """Return the columns of the table to use; report those that are also fixed numbers."""
    named: tuple[str, ...] | None = sample.get("columns")
    if named is not None and kind(sample) != TABLE:
        remedy = 'give its path as the design, as in design = "table.csv"'
        involved = ["sample.design"]
        mistakes.add("sample.columns", "needs a table", named, remedy, involves=involved)
    for name in named or ():
        if name in numbers:
            rule = f"{name} is a fixed number too"
            mistakes.add("sample.columns", rule, named, "keep one of the two")
    return named


def realizations(
    sample: Table, spreads: Mapping[str, Range | GridAxis], mistakes: Mistakes
) -> int | None:
    """Return the number of realizations; None for a table whose length the file does not state."""
    key, number, design = "sample.realizations", sample.get("realizations"), kind(sample)
    if design == TABLE:
        return number
    if design == GRID:
        sizes = [len(axis.values) for axis in spreads.values() if isinstance(axis, GridAxis)]
        product = math.prod(sizes)
        if number is not None and number != product:
            rule, remedy = f"contradicts the grid, whose axes make {product}", "leave this key out"
            mistakes.add(key, rule, number, remedy, involves=["sample.design"])
        if product > MAX_REALIZATIONS:
            text = f"the grid's axes make {product}, at most {MAX_REALIZATIONS} are allowed"
            mistakes.add(key, text, involves=["sample.design"])
        return product
    if number is None and spreads:
        remedy = (
            "state how many realizations to draw from the ranges, a whole number, at least 1, or "
            "take a grid of values"
        )
        mistakes.add(key, "is missing", remedy=remedy, involves=["sample.design"])
    return number or 1


def record(
    table: Table,
    shared: Table,
    values: Mapping[str, float],
    varied: Collection[str] | None,
    mistakes: Mistakes,
) -> dict[str, Any]:
    """Return the fields of the recorded scene: [record], completed by ``values`` of the sweep.

    ``varied`` names the sampled parameters; None if they are known only from the table.
    """
    given, fields = inputs_in(table), settings("record", table, shared, mistakes)
    base, law = fields["base"], fields["restitution_law"]
    if varied is None:
        rule = "the recorded scene must state what the table samples"
        names = Value(["restitution", "amplitude"])
        remedy: Text = ("name the table's columns, as in ", Key("sample.columns"), " = ", names)
        mistakes.add("record", rule, remedy=remedy, involves=["sample.design", "sample.columns"])
    forcings = [name for name in FORCINGS if name in given]
    if len(forcings) > 1:
        first, second, *_ = forcings
        also = ("gives the forcing, and so does ", Key(f"record.{first}"))
        mistakes.add(f"record.{second}", also, given[second], "keep one of the two")
    # values of the sweep that [record] gives in another way, or that its base or law does not have
    replaced = {*FORCINGS} if forcings else set()
    replaced |= {*MASSES} if MASS_RATIO in given else set()
    replaced |= set() if MASSES.keys().isdisjoint(given) else {MASS_RATIO}
    replaced |= {*OF_MOUNT} if base != SPRUNG else set()
    replaced |= set() if OF_SLIP.isdisjoint(given) else OF_SLIP
    of_points = law != shared["restitution_law"] and implied(shared["restitution_law"])
    replaced |= {SPEED} if law == CONSTANT or of_points else set()
    replaced |= implied(law).keys()
    for name in varied or ():
        if name in INPUTS and name not in given and name not in replaced:
            state = f"so state the value of the recorded scene (allowed: {INPUTS[name].allowed})"
            mistakes.add(f"record.{name}", f"is missing; the sweep samples it, {state}")
    for name in implied(law).keys() & given.keys():
        mistakes.add(f"record.{name}", _IMPLIED, given[name])
    given |= implied(law)
    found = {n: v for n, v in values.items() if n not in replaced} | {**given}
    tables = ("scene", "sample", "record")
    involved = [f"{t}.{name}" for t in tables for name in DEPENDENT]
    wrong = {**mount_mistakes(base, found), **speed_mistakes(law, found), **noise_mistakes(found)}
    for name, text in wrong.items():
        mistakes.add(f"record.{name}", text, involves=involved)
    homes = dict.fromkeys(noise_homes(found, {}, ()), "record")
    check_noise(fields, homes, {}, mistakes)
    if base == SPRUNG:
        found = {"mount_damping": MOUNT["mount_damping"].default, **found}
    return {**fields, "inputs": inputs_in(found), "given": frozenset(found)}


def check_extremes(
    key: str, scene: Scene, sampled: Mapping[str, Range | GridAxis], mistakes: Mistakes
) -> None:
    """Report parameters whose extreme values cannot be computed together.

    The forcing may give too large an amplitude, the masses too large a mass ratio, and a run may
    have more forcing periods than can be counted exactly.
    """
    ends: dict[str, tuple[float, ...]] = {name: (value,) for name, value in scene.inputs.items()}
    ends |= {name: tuple(sorted({*spread.ends})) for name, spread in sampled.items()}
    ends = {name: values for name, values in ends.items() if name not in NOISE}
    corners = np.array([*itertools.product(*ends.values())]).T
    values = completed(dict(zip(ends, corners, strict=True)), scene.waveform)
    # the phase does not affect the number of periods
    arrays = only_parameters(values) | {"phase": np.zeros(corners.shape[1])}
    try:
        refuse_extreme(values, forcing_of(ends), scene.restitution_law)
        dimensionless(arrays, scene.duration)
        launches(scene.launch, 1, np.max(arrays["frequency"], keepdims=True))
    except ParameterError as error:
        mistakes.add(f"{key}.", str(error))
