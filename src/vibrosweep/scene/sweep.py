"""Checked sweeps, from TOML or keywords: all mistakes are found before anything is computed."""

from __future__ import annotations

import math
import os
import re
import tomllib
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from vibrosweep.errors import SpecError, refuse
from vibrosweep.mistakes import TOML, Mistakes, Text, toml
from vibrosweep.model.forcing import FORCINGS, INPUTS, inputs_of
from vibrosweep.model.observables import Observable, observables_of
from vibrosweep.model.scene_measures import Measures
from vibrosweep.scene import rules
from vibrosweep.scene.design import TABLE, Design
from vibrosweep.scene.keys import SECTIONS, Tables, read_tables
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.waveform import Traced

# Fields of a scene, apart from its inputs, that [record] takes from [scene] by default
SHARED: Final = (
    *("particles", "launch", "duration", "rebound", "restitution_law"),
    *("base", "waveform", "noise_seed"),
)
HDF5: Final = b"\x89HDF"  # the first bytes of a result
# A text in double quotes with a backslash that begins none of TOML's escapes
BACKSLASH: Final = re.compile(
    r'"((?:[^"\\\n]|\\.)*?\\(?![btnfr"\\]|u[0-9a-fA-F]{4}|U[0-9a-fA-F]{8})[^"\n]*)"'
)
# Line before the original text of a sweep file whose trace was replaced by harmonics
WRITTEN_FOR: Final = "# written for\n"


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
    def states_duration(self) -> bool:
        """True if the sweep file states the end of the observation."""
        scene = tomllib.loads(self.text).get("scene", {})
        return not scene.keys().isdisjoint({"duration", "duration_periods"})

    @property
    def sizes(self) -> dict[str, int]:
        """Lengths of the dimensions of a result, apart from that of realizations."""
        along = self.scene.measures.observable_dims
        return {"particle": self.scene.particles} | {dim: len(along[dim]) for dim in along}


def read_spec(path: str | os.PathLike[str], kept: Callable[[], str] | None = None) -> Sweep:
    """Read and validate a sweep file; a SpecError lists all mistakes.

    If the file of its trace is missing, the harmonics come from the text of a result or of an
    unfinished run, which `kept` returns, if that text was written for the same sweep file.
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
        return source.read_bytes().decode("utf-8-sig")
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
    if kept is not None and _lacks_trace(data, folder):
        held = kept()
        if held.partition(WRITTEN_FOR)[2] == _quoted(text or text_of(data)):
            data, text = tomllib.loads(held), held
    title, tables = read_tables(data, mistakes)
    if title is None:
        remedy = 'begin with title = "..." that says what the sweep shows'
        mistakes.add("title", "is missing", remedy=remedy)
    traced = _measured(tables, folder, mistakes)
    if traced:  # so that the text needs no trace
        scene = {**data["scene"], **traced}
        quoted = WRITTEN_FOR + _quoted(text or text_of(data))
        text = text_of({**data, "title": title or "", "scene": scene}) + quoted
    sweep = _assembled(tables, source, mistakes)
    sweep = replace(sweep, title=title or "", text=text)
    # a table is checked when it is read
    if sweep.design.name != TABLE:
        rules.check_extremes("scene", sweep.scene, sweep.design.sampled, mistakes)
    if sweep.record is not None:
        rules.check_extremes("record", sweep.record, {}, mistakes)
    refuse(mistakes)
    return sweep


def _lacks_trace(data: Mapping[str, Any], folder: Path) -> bool:
    """Return whether the scene has a trace, relative to a folder, whose file is missing."""
    try:
        return not (folder / data["scene"]["waveform"]["trace"]).exists()
    except (KeyError, TypeError, ValueError):  # no trace, or a mistake that is reported later
        return False


def text_of(data: Mapping[str, Any]) -> str:
    """Return the text of a sweep file that holds a title and tables."""
    lines = [f"title = {toml(data['title'])}"]
    for section in SECTIONS:
        if section in data:
            lines += [f"[{section}]", *(f"{key} = {toml(v)}" for key, v in data[section].items())]
    return "\n".join(lines) + "\n"


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
    sampled = rules.sampled(sample, mistakes)
    numbers = rules.fixed_numbers(scene, sample, mistakes)
    columns = rules.columns(sample, numbers, mistakes)
    rules.check_forcing(scene, sample, mistakes)
    varied = (*sampled, *(columns or ()))
    defaults = {key: getattr(Scene, key) for key in SHARED}
    settings = rules.settings("scene", scene, defaults, mistakes)
    base = settings["base"]
    rules.check_given(base, settings["restitution_law"], scene, sample, mistakes)
    measures = Measures(**tables.get("measure", {}))
    rules.check_unused(tables, mistakes, every=source is not None)
    noise = rules.noise_homes(numbers, sample, varied)
    rules.check_measures(base, noise, measures, mistakes)
    # only the first forcing, even if two were given and reported
    forcing = next((name for name in FORCINGS if name in (*numbers, *varied)), "amplitude")
    given = [forcing, *(name for name in (*numbers, *varied) if name not in FORCINGS)]
    values = {name: numbers.get(name, INPUTS[name].default) for name in inputs_of(given, base)}
    frequencies: Collection[float] = () if "frequency" in varied else (values["frequency"],)
    if "frequency" in sampled:
        frequencies = sampled["frequency"].ends
    rules.check_window(measures.transient, settings["duration"], frequencies, mistakes)
    recorded = None
    if "record" in tables:
        known = varied if rules.kind(sample) != TABLE or columns is not None else None
        recorded = rules.record(tables["record"], settings, values, known, mistakes)
    realizations = rules.realizations(sample, sampled, mistakes)
    sizes = {"sample.realizations": realizations or 0, "scene.particles": settings["particles"]}
    rules.check_noise(settings, noise, sizes, mistakes)
    refuse(mistakes)
    fixed = {
        name: value
        for name, value in values.items()
        if name not in varied and not math.isnan(value)  # NaN: known from the table only
    }
    kind, named = rules.kind(sample), sample.get("design")
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
