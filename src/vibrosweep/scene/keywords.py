"""Turn keywords of Python, or a mapping of them, into the same checked sweep as a sweep file.

A tuple is the range of a physical parameter, a list or an array is an axis of a grid, and a number
is a fixed value.  Keywords become the tables of a sweep file, which are then checked.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final

import numpy as np

from vibrosweep.abilities import WITHOUT_MEANING
from vibrosweep.arrays import Array
from vibrosweep.mistakes import PYTHON, RANGE, Mistakes, nearest
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.limits import another_name, answer_to, likely_parameter
from vibrosweep.model.parameters import NOISE, STREAM, STREAMS, refuse_masked
from vibrosweep.scene.columns import GivenTable
from vibrosweep.scene.design import DESIGNS, GRID
from vibrosweep.scene.keys import MAX_STEPS, SECTIONS
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import Sweep, checked, text_of

_RANGE: Final = "is a range, because it is a tuple, and nothing is drawn from a range here"
BUDGET: Final = "impact_budget"
# Tables that may hold a keyword, in the order in which they are searched
HOMES: Final = ("scene", "sample", "measure")
# This many evenly spaced values, or more, are written as start, stop and num.
LONG: Final = 10


def keyword_spec(
    given: Mapping[str, Any],
    analysis: str = "",
    stated_for_it: Collection[str] = (),
    kept: Callable[[], str] | None = None,
) -> Sweep:
    """Validate keywords, or a mapping of them that may hold whole tables of a sweep file.

    A keyword that is None counts as not given.  A mapping under the name of a table is this table.
    The table of an `analysis` is searched for a keyword before all others.  A keyword among
    `stated_for_it` that has no meaning for the analysis is a mistake, unless it is False.  `kept`
    is that of `vibrosweep.scene.sweep.read_spec`.  Raises a SpecError that lists all mistakes, each
    with its keyword, and a ParameterError for masked values.
    """
    stated = {name: value for name, value in given.items() if value is not None}
    mistakes = Mistakes(dialect=PYTHON, given=stated)
    for name in WITHOUT_MEANING.get(analysis, ()):
        if name in stated_for_it and stated.get(name, False) is not False:
            homes = (f"{home}.{name}" for home in HOMES if name in SECTIONS[home])
            rule = f"has no meaning for {analysis}"
            mistakes.add_broken(next(homes, name), rule, stated.pop(name), "leave it out")
    first = [analysis] if analysis in SECTIONS else []
    data = _tables(stated, (*first, *HOMES), mistakes)
    sweep = checked(data, "", None, mistakes, kept)
    return sweep if sweep.text else replace(sweep, text=text_of(data))


def batch(given: Mapping[str, Any], *measured: str) -> tuple[Scene, dict[str, Array]]:
    """Validate keywords of a batch of realizations; return the scene and the varying parameters.

    A list or 1-D array of a physical parameter has one entry for each realization, or a single one
    for all; ``launch_time`` is a number or a list.  Of the keywords of [measure] only the impact
    budget and `measured` are known.  Raises a SpecError that lists all mistakes.
    """
    stated = {name: value for name, value in given.items() if value is not None}
    mistakes, remaining = Mistakes(dialect=PYTHON, given=stated), dict(stated)
    known = (*SECTIONS["scene"], "launch_time", STREAM, BUDGET, *measured)
    for name in remaining.keys() - {*known}:
        _note_unknown(name, remaining.pop(name), known, mistakes)
    if "launch_time" in remaining:
        times = _numbers("launch_time", remaining.pop("launch_time"), mistakes)
        if "launch" in remaining or "particles" in remaining:
            rule = "gives the launch of each particle, and so do particles and launch"
            mistakes.add_broken("launch_time", rule, None, "keep one of the two")
        remaining["launch"] = times.ravel().tolist()
    varied = {}
    if STREAM in remaining:
        varied[STREAM] = _streams(remaining.pop(STREAM), remaining, mistakes)
    for name in [name for name in INPUTS if name in remaining]:
        if _kind(remaining[name]) is None:
            continue
        values = _numbers(name, remaining[name], mistakes)
        wrong = values[~INPUTS[name].accepts(values)]
        remaining[name] = float((wrong if wrong.size else values)[0])
        varied[name] = values
    sizes = {name: values.size for name, values in varied.items()}
    if len({*sizes.values()} - {1}) > 1:
        mistakes.add("", f"arrays of realizations must have one length, or length 1: {sizes}")
    for name in [name for name, value in remaining.items() if isinstance(value, tuple)]:
        mistakes.add_broken(name, _RANGE, remaining.pop(name), "give a list")
    measure = {n: _plain(n, remaining.pop(n)) for n in (BUDGET, *measured) if n in remaining}
    data = {
        "title": "A scene",
        "scene": {n: _plain(n, remaining[n]) for n in remaining},
        "measure": measure,
    }
    scene = checked(data, "", None, mistakes).scene
    size = max(sizes.values(), default=1)
    # copies: numba would compile the kernels again for read-only arrays
    several = [name for name in varied if size > 1 or name == STREAM]
    return scene, {name: np.array(np.broadcast_to(varied[name], size)) for name in several}


def _streams(value: object, given: Collection[str], mistakes: Mistakes) -> Array:
    """Return the indices of the random streams of realizations; report invalid ones."""
    streams = _numbers(STREAM, value, mistakes)
    if NOISE.keys().isdisjoint(given):
        rule = "selects random numbers, but nothing is random"
        remedy = f"give {', '.join(NOISE)} as well, or leave it out"
        mistakes.add_broken(STREAM, rule, value, remedy)
    elif not ((streams >= 0) & (streams < STREAMS) & (streams == np.rint(streams))).all():
        rule = f"must be whole numbers, at least 0 and below 2**{STREAMS.bit_length() - 1}"
        mistakes.add_broken(STREAM, rule, value)
    return streams


def _numbers(name: str, value: object, mistakes: Mistakes) -> Array:
    """Return one or more finite numbers as a 1-D array; report anything else."""
    refuse_masked(name, value)
    if isinstance(value, tuple):
        mistakes.add_broken(name, _RANGE, value, "give a list")
        return np.zeros(1)
    try:
        array = np.atleast_1d(np.asarray(value))
        if array.dtype == object:
            array = np.array([_as_float(one) for one in array])
    except ValueError:
        array = np.empty(0)
    numeric = array.dtype.kind in "iuf" and array.ndim == 1 and array.size > 0
    if numeric and (name in INPUTS or np.isfinite(array).all()):
        return array.astype(np.float64)
    mistakes.add_broken(name, "must be a finite number or a 1-D array of finite numbers", value)
    return np.zeros(1)


def _tables(given: Mapping[str, Any], homes: tuple[str, ...], mistakes: Mistakes) -> dict[str, Any]:
    """Return the tables of an equivalent sweep file."""
    data: dict[str, Any] = {
        name: _plain(name, value)
        for name, value in given.items()
        if name == "title" or name in SECTIONS
    }
    for name in [n for n in data if n in SECTIONS and not isinstance(data[n], Mapping)]:
        mistakes.add_broken(name, "must be a mapping of keys to values", data.pop(name))
    for name, value in given.items():
        if name in data:
            continue
        home = _home(name, value, homes)
        if home is None:
            known = dict.fromkeys(key for one in homes for key in SECTIONS[one])
            _note_unknown(name, value, known, mistakes)
        elif isinstance(value, tuple) and name not in INPUTS:
            mistakes.add_broken(name, _RANGE, value, "give a list")
        elif name in data.setdefault(home, {}):
            mistakes.add_broken(name, f"is given in {home} too", value, "keep one of the two")
        else:
            plain = _plain(name, value)
            data[home][name] = short_axis(plain) if name in INPUTS else plain
    _choose_design(given, data, mistakes)
    data.setdefault("title", _title(given))
    return data


def _home(name: str, value: object, homes: tuple[str, ...]) -> str | None:
    """Return the table to which a keyword belongs."""
    if name in INPUTS and _kind(value) is not None:
        return "sample"
    return next((home for home in homes if name in SECTIONS[home]), None)


def _kind(value: object) -> str | None:
    """Return "range" or "axis" for the value of a parameter that varies; None for any other."""
    if isinstance(value, tuple):
        return "range"
    several = isinstance(value, list | range | Mapping) or np.ndim(np.asarray(value)) > 0
    return "axis" if several else None


def _choose_design(given: Mapping[str, Any], data: dict[str, Any], mistakes: Mistakes) -> None:
    """Choose a grid if there are axes; report ranges and axes that do not fit the design."""
    kinds = {name: _kind(value) for name, value in given.items() if name in INPUTS}
    axes, ranges = ([n for n, kind in kinds.items() if kind == k] for k in ("axis", "range"))
    sample = data.get("sample", {})
    design = sample.get("design") if isinstance(sample, Mapping) else None
    if axes and ranges:
        rule = f"is an axis of a grid, but {ranges[0]} is a range"
        mistakes.add_broken(axes[0], rule, given[axes[0]], "give all as lists, or as tuples")
    elif axes and design is None:
        data["sample"]["design"] = GRID
    elif axes and isinstance(design, str) and design in DESIGNS:
        rule = f'is an axis of a grid, but design = "{design}" draws values'
        mistakes.add_broken(axes[0], rule, given[axes[0]], ("give a tuple ", RANGE))
    elif ranges and design == GRID:
        rule = 'is a range, but design = "grid" takes lists of values'
        mistakes.add_broken(ranges[0], rule, given[ranges[0]], "give them as a list")


def _title(given: Mapping[str, Any]) -> str:
    varied = [name for name, value in given.items() if name in INPUTS and _kind(value) is not None]
    return f"Sweep over {', '.join(varied)}" if varied else "A sweep"


def _note_unknown(name: str, value: object, known: Collection[str], mistakes: Mistakes) -> None:
    if answer := answer_to(name, known):
        mistakes.add_broken(name, f"is not a known keyword: {answer}", value)
        mistakes.broken |= {f"{home}.{another_name(name)}" for home in HOMES}
        return
    for section, function in (("windows", "windows"), ("sample", "sweep")):
        if name in SECTIONS[section]:
            rule = f"is not a known keyword: it is one of vibrosweep.{function}"
            mistakes.add_broken(name, rule, value)
            return
    guess = "launch" if name == "launch_time" else nearest(name, known) or likely_parameter(name)
    hint = f'; did you mean "{guess}"?' if guess else "."
    text = f"is not a known keyword{hint} Known keywords: {', '.join(known)}"
    mistakes.add_broken(name, text, value)
    if guess:  # the keyword that was meant is neither missing nor at its default
        mistakes.broken |= {f"{home}.{guess}" for home in HOMES}


def _plain(name: str, value: Any) -> Any:
    """Return a value as `tomllib` would: with plain numbers, strings, lists and dicts."""
    if name == "design" and not isinstance(value, str):
        return GivenTable.from_table(value)
    refuse_masked(name, value)
    if isinstance(value, Mapping):
        return {str(key): _plain(str(key), member) for key, member in value.items()}
    if isinstance(value, list | tuple | range):
        return [_plain(name, member) for member in value]
    return np.asarray(value).tolist() if hasattr(value, "__array__") else _as_float(value)


def _as_float(value: Any) -> Any:
    """Turn a Fraction or Decimal into a float, unless it is too large for one."""
    if hasattr(value, "as_integer_ratio") and not isinstance(value, int):
        with suppress(OverflowError):
            return float(value)
    return value


def short_axis(values: Any) -> Any:
    """Write a long, evenly spaced axis as start, stop and num if that gives the same values."""
    if not (isinstance(values, list) and LONG <= len(values) <= MAX_STEPS):
        return values
    if not all(isinstance(v, float) for v in values) or not values[0] < values[-1]:
        return values
    even = np.linspace(values[0], values[-1], len(values)).tolist() == values
    return {"start": values[0], "stop": values[-1], "num": len(values)} if even else values
