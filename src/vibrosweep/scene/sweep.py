"""Checked sweeps, from TOML or keywords: all mistakes are found before anything is computed.

As keywords, a tuple is the range of a physical parameter, a list or an array is an axis of a grid,
and a number is a fixed value.
"""

from __future__ import annotations

import functools
import math
import operator
import os
import re
import tomllib
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from vibrosweep.abilities import WITHOUT_MEANING
from vibrosweep.arrays import Array
from vibrosweep.errors import SpecError, refuse
from vibrosweep.mistakes import PYTHON, RANGE, TOML, Mistakes, Text, nearest, toml
from vibrosweep.model.forcing import (
    FORCINGS,
    INPUTS,
    another_name,
    answer_to,
    inputs_of,
    likely_parameter,
)
from vibrosweep.model.observables import Measures, Observable, observables_of
from vibrosweep.model.parameters import NOISE, STREAM, STREAMS, refuse_masked
from vibrosweep.model.restitution_laws import NUMBERS_OF, POINTS, implied
from vibrosweep.scene import keys
from vibrosweep.scene.design import DESIGNS, GRID, TABLE, Design, GivenTable
from vibrosweep.scene.keys import MAX_STEPS, SECTIONS, Tables, read_tables
from vibrosweep.scene.scene import Scene, Traced

__all__ = ["Sweep", "batch", "checked", "parse_spec", "read_text"]

# Fields of a scene, apart from its inputs, that [record] takes from [scene] by default
SHARED: Final = (
    *("particles", "launch", "duration", "rebound", "restitution_law"),
    *("base", "waveform", "noise_seed"),
)
HDF5: Final = b"\x89HDF"  # the first bytes of a result
LONGEST_SPEC: Final = 2**26  # bytes: a device may have no end
# A text in double quotes with a backslash that begins none of TOML's escapes
BACKSLASH: Final = re.compile(
    r'"((?:[^"\\\n]|\\.)*?\\(?![btnfr"\\]|u[0-9a-fA-F]{4}|U[0-9a-fA-F]{8})[^"\n]*)"'
)
# Line before the original text of a sweep file in which what a file holds replaced its path
WRITTEN_FOR: Final = "# written for\n"
WITH_POINTS: Final = ("scene", "record")  # tables that may name a table of points


@dataclass(frozen=True)
class Sweep:
    """A scene and the design of its realizations, checked together."""

    title: str  # one line that describes the sweep
    text: str  # the whole TOML text; for keywords, an equivalent one
    source: Path | None  # the file it was read from; None for a text and for keywords
    scene: Scene
    design: Design
    record: Scene | None  # the scene, if any, of which every landing is recorded
    windows: Mapping[str, Any] | None  # values of [windows] by their keys; None if it is missing
    # True to store recorded landings as one list without padding; None if there is no record
    ragged: bool | None = None
    stated: frozenset[str] = frozenset()  # keys of [scene] that were given

    def with_measures(self, **changes: Any) -> Sweep:
        """Return the same sweep with other values of some keys of [measure]."""
        record = self.record
        if record is not None and "impact_budget" in changes:
            record = record.with_measures(impact_budget=changes["impact_budget"])
        return replace(self, scene=self.scene.with_measures(**changes), record=record)

    def with_observables(self, observables: Iterable[Observable]) -> Sweep:
        """Return the same sweep with observables.

        Raises a ParameterError as `vibrosweep.model.observables.observables_of` does.
        """
        return self.with_measures(observables=observables_of(observables))

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Files from which the sweep is read."""
        return tuple(path for path in (self.source, self.design.table) if isinstance(path, Path))

    def refusal(self, text: Text) -> SpecError:
        """Return the error that says why an analysis cannot use this sweep."""
        if self.source is None:
            return SpecError(text)
        return SpecError(f"{self.source}: ", text, dialect=TOML)

    @property
    def sizes(self) -> dict[str, int]:
        """Lengths of the dimensions of a result, apart from that of realizations."""
        along = self.scene.measures.observable_dims
        return {"particle": self.scene.particles} | {dim: len(along[dim]) for dim in along}


def read_spec(path: str | os.PathLike[str], kept: Callable[[], str] | None = None) -> Sweep:
    """Read and validate a sweep file; a SpecError lists all mistakes.

    If the file of its trace or of its points is missing, what was read from it comes from the text
    of a result or of an unfinished run, which `kept` returns, if that text was written for the same
    sweep file.
    """
    source = Path(path)
    return parse_spec(read_text(source), source, kept)


def _quoted(text: str) -> str:
    """Return a text as TOML comments."""
    return "".join(f"# {line}\n" for line in text.splitlines())


def read_text(source: Path) -> str:
    """Read the text of a TOML file; a SpecError says why it cannot be read."""
    try:
        # utf-8-sig: editors on Windows put a byte order mark first, which TOML does not allow
        with source.open("rb") as file:
            data = file.read(LONGEST_SPEC + 1)
        text = data[:LONGEST_SPEC].decode("utf-8-sig")
    except FileNotFoundError as error:
        raise SpecError(f"{source}: there is no such sweep file; check the path") from error
    except IsADirectoryError as error:
        raise SpecError(f"{source}: is a directory; give the path of a .toml file") from error
    except UnicodeDecodeError as error:
        wrong = f"is not UTF-8 text (byte {error.start}); save it as UTF-8"
        if bytes(error.object).startswith(HDF5):
            wrong = "is a result: give its sweep file, or in Python the opened result"
        raise SpecError(f"{source}: {wrong}") from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise SpecError(f"{source}: cannot be read: {reason}") from error
    if len(data) > LONGEST_SPEC:
        raise SpecError(f"{source}: is longer than 64 MiB, too much for a sweep file; check it")
    return text


def parse_spec(
    text: str, source: Path | None = None, kept: Callable[[], str] | None = None
) -> Sweep:
    """Validate the TOML text of a sweep file; a SpecError lists all mistakes.

    Messages name the file `source`; the path of a table is relative to its folder.  `kept` is that
    of `read_spec`.
    """
    mistakes = Mistakes("the sweep's text" if source is None else str(source))
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # too many digits, too deeply nested
        path = BACKSLASH.search(text)
        hint = f"; write a path with backslashes in single quotes, '{path[1]}'" if path else ""
        raise SpecError(f"{mistakes.where}: is not valid TOML: {error}{hint}") from error
    return checked(data, text, source, mistakes, kept)


def checked(
    data: Mapping[str, Any],
    text: str,
    source: Path | None,
    mistakes: Mistakes,
    kept: Callable[[], str] | None = None,
) -> Sweep:
    """Validate the data of a sweep file as `tomllib` reads them.

    `text` and `source` are those of `Sweep`, and `kept` is that of `read_spec`.  Raises a SpecError
    that lists all `mistakes`, including those that this function finds.
    """
    folder = (source or Path()).parent
    if kept is not None and _lacks_file(data, folder):
        held = kept()
        if held.partition(WRITTEN_FOR)[2] == _quoted(text or text_of(data)):
            data, text = tomllib.loads(held), held
    title, tables = read_tables(data, mistakes)
    if title is None:
        remedy = 'begin with title = "..." that says what the sweep shows'
        mistakes.add("title", "is missing", remedy=remedy)
    read = _tabulated(tables, folder, mistakes)
    if traced := _measured(tables, folder, mistakes):
        read["scene"] = read.get("scene", {}) | traced
    if read:  # so that the text needs no file
        replaced = {name: {**data[name], **values} for name, values in read.items()}
        quoted = WRITTEN_FOR + _quoted(text or text_of(data))
        text = text_of({**data, "title": title or "", **replaced}) + quoted
    sweep = _assembled(tables, source, mistakes)
    stated = frozenset(tables.get("scene", {}))
    sweep = replace(sweep, title=title or "", text=text, stated=stated)
    # a table is checked when it is read
    if sweep.design.name != TABLE:
        keys.check_extremes("scene", sweep.scene, sweep.design.sampled, mistakes)
    if sweep.record is not None:
        keys.check_extremes("record", sweep.record, {}, mistakes)
    refuse(mistakes)
    return sweep


def _lacks_file(data: Mapping[str, Any], folder: Path) -> bool:
    """Return whether a trace or a table of points, relative to a folder, is missing."""

    def lacks(home: str, *keys: str) -> bool:
        try:
            return not (folder / functools.reduce(operator.getitem, keys, data[home])).exists()
        except (KeyError, TypeError, ValueError):  # no path, or a mistake that is reported later
            return False

    of_points = (lacks(home, NUMBERS_OF[POINTS]) for home in WITH_POINTS)
    return lacks("scene", "waveform", "trace") or any(of_points)


def text_of(data: Mapping[str, Any]) -> str:
    """Return the text of a sweep file that holds a title and tables."""
    lines = [f"title = {toml(data['title'])}"]
    for section in SECTIONS:
        if section in data:
            lines += [f"[{section}]", *(f"{key} = {toml(v)}" for key, v in data[section].items())]
    return "\n".join(lines) + "\n"


def _tabulated(tables: Tables, folder: Path, mistakes: Mistakes) -> dict[str, dict[str, Any]]:
    """Replace the paths of tables of points by the points; return these keys, by table."""
    found, key = {}, NUMBERS_OF[POINTS]
    for home in WITH_POINTS:
        path = tables.get(home, {}).get(key)
        if not isinstance(path, str):
            continue
        from vibrosweep.scene.traces import points_in  # few sweeps have such a table

        try:
            points = points_in(folder / path)
        except ValueError as error:
            mistakes.add_broken(f"{home}.{key}", error.args, tables[home].pop(key))
            continue
        tables[home][key] = points
        found[home] = {key: [list(point) for point in points]}
    return found


def _measured(tables: Tables, folder: Path, mistakes: Mistakes) -> dict[str, Any]:
    """Replace the trace in [scene] by its harmonics, frequency and velocity; return these keys."""
    scene, sample = tables.get("scene", {}), tables.get("sample", {})
    if isinstance(tables.get("record", {}).get("waveform"), Traced):
        traced = tables["record"].pop("waveform")
        rule = "a trace is read in [scene] only; give its harmonics here"
        mistakes.add_broken("record.waveform", rule, traced.trace)
    if not isinstance(scene.get("waveform"), Traced):
        return {}
    from vibrosweep.scene.traces import measured  # few sweeps have a trace

    traced = scene.pop("waveform")
    try:
        waveform, frequency, velocity = measured(traced, folder)
    except ValueError as error:
        mistakes.add_broken("scene.waveform", error.args, traced.trace)
        return {}
    replaced = {"frequency": frequency, "base_velocity": velocity}
    given = {*scene, *sample, *sample.get("columns", ())}
    if "frequency" in given:
        del replaced["frequency"]
    if not given.isdisjoint(FORCINGS):
        del replaced["base_velocity"]
    scene |= {"waveform": waveform, **replaced}
    return {"waveform": waveform.value, **replaced}


def _assembled(tables: Tables, source: Path | None, mistakes: Mistakes) -> Sweep:
    """Apply the rules between keys; a SpecError lists all mistakes found so far."""
    scene, sample = tables.get("scene", {}), tables.get("sample", {})
    sampled = keys.sampled(sample, mistakes)
    numbers = keys.fixed_numbers(scene, sample, mistakes)
    columns = keys.columns(sample, numbers, mistakes)
    keys.check_forcing(scene, sample, mistakes)
    varied = (*sampled, *(columns or ()))
    settings = keys.settings("scene", scene, {k: getattr(Scene, k) for k in SHARED}, mistakes)
    base = settings["base"]
    keys.check_given(base, settings["restitution_law"], scene, sample, mistakes)
    numbers |= implied(settings["restitution_law"])
    measures = Measures(**tables.get("measure", {}))
    keys.check_unused(tables, mistakes, every=source is not None)
    noise = keys.noise_homes(numbers, sample, varied)
    keys.check_measures(base, noise, measures, mistakes)
    # only the first forcing, even if two were given and reported
    forcing = next((name for name in FORCINGS if name in (*numbers, *varied)), "amplitude")
    given = [forcing, *(name for name in (*numbers, *varied) if name not in FORCINGS)]
    values = {name: numbers.get(name, INPUTS[name].default) for name in inputs_of(given, base)}
    frequencies: Collection[float] = () if "frequency" in varied else (values["frequency"],)
    if "frequency" in sampled:
        frequencies = sampled["frequency"].ends
    keys.check_window(measures.transient, settings["duration"], frequencies, mistakes)
    recorded = None
    if "record" in tables:
        known = varied if keys.kind(sample) != TABLE or columns is not None else None
        recorded = keys.record(tables["record"], settings, values, known, mistakes)
    realizations = keys.realizations(sample, sampled, mistakes)
    sizes = {"sample.realizations": realizations or 0, "scene.particles": settings["particles"]}
    keys.check_noise(settings, noise, sizes, mistakes)
    refuse(mistakes)
    fixed = {
        name: value
        for name, value in values.items()
        if name not in varied and not math.isnan(value)  # NaN: known from the table only
    }
    kind, named = keys.kind(sample), sample.get("design")
    if isinstance(named, str) and kind == TABLE:
        named = (source or Path()).parent / named
    return Sweep(
        title="",
        text="",
        source=source,
        scene=Scene(
            **settings,
            measures=measures.over(base, settings["restitution_law"]),
            inputs=fixed,
            given=frozenset(numbers),
        ),
        design=Design(
            kind,
            sampled,
            realizations,
            sample.get("seed", 0),
            named if kind == TABLE else None,
            columns,
        ),
        record=None if recorded is None else Scene(**recorded, measures=measures).recorded(),
        windows=tables.get("windows"),
        ragged=None if recorded is None else tables["record"].get("ragged", False),
    )


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
    for name in [name for name, value in remaining.items() if isinstance(value, tuple)]:
        mistakes.add_broken(name, _RANGE, remaining.pop(name), "give a list")
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
