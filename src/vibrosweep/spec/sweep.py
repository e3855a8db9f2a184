"""TOML text -> validated, frozen `SweepSpec`; every mistake is found before anything runs."""

from __future__ import annotations

import math
import os
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from vibrosweep.abilities import refusal
from vibrosweep.errors import SpecError, refuse
from vibrosweep.mistakes import TOML, Mistakes, Text
from vibrosweep.model.forcing import FORCINGS, INPUTS, inputs_of
from vibrosweep.model.measures import Measures
from vibrosweep.model.observables import Observable, observables_of
from vibrosweep.model.times import Time
from vibrosweep.spec import rules as rules
from vibrosweep.spec.columns import GivenTable
from vibrosweep.spec.rules import Axis, Range, RecordSpec, Setting
from vibrosweep.spec.schema import SpecFile, read_tables
from vibrosweep.spec.windows import WindowsTable


@dataclass(frozen=True)
class SweepSpec:
    """A validated sweep."""

    title: str  # what the sweep shows
    text: str  # the whole TOML text; for keywords, one that asks for the same
    source: Path | None  # the file it was read from, None for a text and for keywords
    # Parameters that are not sampled, defaults included; of the forcings no more than one, and
    # those of a mount for a sprung base only.  Under a table these are all that ``columns`` does
    # not name; a column of the table overrides the default that stands here.
    fixed: Mapping[str, float]
    given: frozenset[str]  # names of the parameters in ``fixed`` that the file states
    # Sampled parameters in the order of `vibrosweep.model.forcing.INPUTS`: a `Range` under a drawn
    # design, an `Axis` under a grid; empty for a table, which decides by itself
    sampled: Mapping[str, Range | Axis]
    # particles, launch, duration, rebound, base: as in `RecordSpec`
    particles: int
    launch: str | tuple[float, ...]
    duration: Time
    rebound: str
    base: str
    design: str  # ``"uniform"``, ``"latin"``, ``"sobol"``, ``"grid"`` or ``"table"``
    table: Path | GivenTable | None  # the table, or its path; None for other designs
    # The columns of the table to use, parameters first and then labels; None for all
    columns: tuple[str, ...] | None
    # Number of realizations; None for a table whose length the file does not state
    realizations: int | None
    seed: int  # seed of the drawn designs
    measures: Measures
    record: RecordSpec | None  # the scene to record, or None
    windows: WindowsTable | None  # the stability windows to find, or None

    def observing(self, observables: Iterable[Observable]) -> SweepSpec:
        """Return the same sweep with observables.

        Raises a ParameterError as `vibrosweep.model.observables.observables_of` does, and a
        SpecError where the base is one of finite mass, whose landings no observable sees.
        """
        found = observables_of(observables)
        wrong = refusal(self.base, analysis="observables")
        if found and wrong:
            raise self.refusal(f"observables: {wrong}")
        return replace(self, measures=replace(self.measures, observables=found))

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Files that the sweep is read from."""
        return tuple(path for path in (self.source, self.table) if isinstance(path, Path))

    def refusal(self, text: Text) -> SpecError:
        """Return the error that says why an analysis cannot use this sweep."""
        if self.source is None:
            return SpecError(text)
        return SpecError(f"{self.source}: ", text, dialect=TOML)

    @property
    def sizes(self) -> dict[str, int]:
        """Lengths of the dimensions of a result, apart from that of realizations."""
        own = {along: len(values) for along, values in self.measures.own_dims.items()}
        return {"particle": self.particles, **own}


def read_spec(path: str | os.PathLike[str]) -> SweepSpec:
    """Read and validate a sweep file; a SpecError lists all mistakes."""
    source = Path(path)
    return parse_spec(read_text(source), source)


def read_text(source: Path) -> str:
    """Read the text of a TOML file; a SpecError where it cannot be read."""
    try:
        # utf-8-sig: editors on Windows put a byte order mark first, which TOML does not know
        return source.read_bytes().decode("utf-8-sig")
    except FileNotFoundError as error:
        raise SpecError(f"{source}: there is no such sweep file; check the path") from error
    except IsADirectoryError as error:
        raise SpecError(f"{source}: is a directory; give the path of a .toml file") from error
    except UnicodeDecodeError as error:
        raise SpecError(
            f"{source}: is not UTF-8 text (byte {error.start}); save it as UTF-8"
        ) from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise SpecError(f"{source}: cannot be read: {reason}") from error


def parse_spec(text: str, source: Path | None = None) -> SweepSpec:
    """Validate the TOML text of a sweep file; a SpecError lists all mistakes.

    Messages name its path `source`, and the path of a table is relative to its folder.
    """
    mistakes = Mistakes("the sweep's text" if source is None else str(source))
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # too many digits, too deep
        raise SpecError(f"{mistakes.where}: is not valid TOML: {error}") from error
    return checked(data, text, source, mistakes)


def checked(
    data: Mapping[str, Any], text: str, source: Path | None, mistakes: Mistakes
) -> SweepSpec:
    """Validate what a sweep file holds, as `tomllib` reads it.

    `text` and `source` are those of `SweepSpec`; `mistakes` takes the mistakes, and words them for
    the SpecError that lists all.
    """
    spec = _assembled(read_tables(data, mistakes), text, source, mistakes)
    refuse(mistakes)
    _check_extremes(spec, mistakes)
    refuse(mistakes)
    return spec


def _assembled(file: SpecFile, text: str, source: Path | None, mistakes: Mistakes) -> SweepSpec:
    """Apply the rules between keys; the result is sound if no mistake was noted."""
    if file.title is None:
        remedy = 'begin with title = "..." that says what the sweep shows'
        mistakes.add("title", "is missing", remedy=remedy)
    sample = file.sample
    design = rules.kind(sample)
    sampled = rules.sampled(sample, mistakes)
    numbers = rules.fixed_numbers(file.scene, sample, mistakes)
    columns = rules.columns(sample, numbers, mistakes)
    rules.check_forcing(file.scene, sample, mistakes)
    varied = (*sampled, *(columns or ()))
    shared = rules.setting("scene", file.scene, Setting(), mistakes)
    rules.check_mount(shared.base, file.scene, sample, mistakes)
    rules.check_measures(shared.base, file.measures, mistakes)
    # one forcing only, for where two were reported
    forcing = next((name for name in FORCINGS if name in (*numbers, *varied)), "amplitude")
    given = [forcing, *(name for name in (*numbers, *varied) if name not in FORCINGS)]
    values = {
        name: numbers.get(name, INPUTS[name].default) for name in inputs_of(given, shared.base)
    }
    frequencies = _values(sampled["frequency"]) if "frequency" in sampled else ()
    if "frequency" not in varied:
        frequencies = (values["frequency"],)
    rules.check_window(file.measures.transient, shared.duration, frequencies, mistakes)
    record = None
    if file.record is not None:
        known = design != "table" or columns is not None
        record = rules.record(file.record, shared, values, varied if known else None, mistakes)
    return SweepSpec(
        title=file.title or "",
        text=text,
        source=source,
        fixed={
            name: value
            for name, value in values.items()
            if name not in varied and not math.isnan(value)  # one that only the table knows
        },
        given=frozenset(numbers),
        sampled=sampled,
        design=design,
        table=_table(sample.design, source) if design == "table" else None,
        columns=columns,
        realizations=rules.realizations(sample, sampled, mistakes),
        seed=sample.seed,
        measures=file.measures.over(shared.base),
        record=record,
        windows=file.windows,
        **shared._asdict(),
    )


def _table(design: str | GivenTable, source: Path | None) -> Path | GivenTable:
    return design if isinstance(design, GivenTable) else (source or Path()).parent / design


def _check_extremes(spec: SweepSpec, mistakes: Mistakes) -> None:
    """Judge the extreme corners of the sweep, and the recorded scene.

    A table is judged when it is computed, for only then its values are known.
    """
    if spec.design != "table":
        shared = Setting(spec.particles, spec.launch, spec.duration)
        ends: dict[str, tuple[float, ...]]
        ends = {name: (value,) for name, value in spec.fixed.items()}
        ends |= {name: _values(spread) for name, spread in spec.sampled.items()}
        rules.check_extremes("scene", ends, shared, mistakes)
    if spec.record is not None:
        own = spec.record
        shared = Setting(own.particles, own.launch, own.duration)
        ends = {name: (value,) for name, value in own.parameters.items()}
        rules.check_extremes("record", ends, shared, mistakes)


def _values(spread: Range | Axis) -> tuple[float, ...]:
    """Return the ends of a range, or the values of an axis."""
    return (spread.low, spread.high) if isinstance(spread, Range) else spread.values
