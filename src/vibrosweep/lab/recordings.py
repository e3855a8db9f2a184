"""Recordings from files as other programs write them: tracks, times of impacts, and sound."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.errors import TrackError
from vibrosweep.lab.mtrack import mtrack_recordings
from vibrosweep.lab.recording import Reading, Recording, Track, made
from vibrosweep.lab.table_columns import FORMATS, Columns, chosen_headings, series_of_columns
from vibrosweep.scene.cells import MISSING, Cells, cells_of, read_content
from vibrosweep.scene.clocks import even_times, rounding_of
from vibrosweep.scene.headings import PIXELS, Heading, time_factor

SKIPPED: Final = ("metadata device", "metadata time")  # sheets of phyphox
WHOLE: Final = "all"  # its sheet with the list of all events


def read_recordings(
    paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    *,
    scale: float | None = None,
    frame_rate: float | None = None,
    axis: str | None = None,
    column: str | None = None,
    particle: str | None = None,
    sheet: str | None = None,
) -> list[Recording]:
    r"""Read tracks or times of impacts from files, whose content shows their format.

    Parameters
    ----------
    paths
        A file or several: text with columns, workbooks (xls, xlsx, ods), exports of Tracker,
        trackpy, TrackMate, MTrack2 and phyphox, and sound (WAV).
    scale
        m per unit of the file, such as m per pixel; by default the unit in the heading.
    frame_rate
        Frames per second, Hz; needed for speeds where a file holds frames.  Times of other files
        are rescaled to it: a slow-motion video is often exported with its playing rate.
    axis
        ``"up"`` or ``"down"``, the direction in which heights grow in the file; by default up, but
        down where a file holds frames or pixels.
    column
        Name of the column of heights, or of times of impacts, where several are possible.
    particle
        Name of the only particle to read.
    sheet
        Name of the only sheet of a workbook to read.

    Returns
    -------
    list of Recording
        One for each drop, or for each ball of a film.

    Raises
    ------
    TrackError
        A file cannot be read, holds no recording, or can be read in several ways.

    Examples
    --------
    >>> import tempfile, pathlib, vibrosweep as vs
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "drop.csv")
    ...     _ = path.write_text("Event time (ms)\n281\n1092\n1817\n2460\n")
    ...     vs.lab.read_recordings(path)[0].time
    array([0.281, 1.092, 1.817, 2.46 ])
    """
    how = Reading(scale, frame_rate, axis, column, particle, sheet)
    files = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    return [recording for path in files for recording in read_file(Path(path), how)]


def read_file(path: Path, how: Reading) -> list[Recording]:
    """Read the recordings of a file."""
    source = str(path)
    try:
        content = read_content(path)
        if content.startswith(b"RIFF"):
            from vibrosweep.lab.sound import clicks_of

            time, peaks, step = clicks_of(content, source)
            return [Recording(source, "", time, None, None, False, True, step, peaks)]
        found = mtrack_recordings(content, source, how) or _tabled(content, source, how)
    except ValueError as error:
        raise error if isinstance(error, TrackError) else TrackError(str(error)) from error
    if how.particle is not None:
        known = ", ".join(r.label for r in found if r.label) or "none"
        found = [r for r in found if r.label == how.particle]
        if not found:
            raise TrackError(f"{source}: has no particle {how.particle}; its particles are {known}")
    return found


def _tabled(content: bytes, source: str, how: Reading) -> list[Recording]:
    """Return the recordings of all tables of a file."""
    tables = [t for t in cells_of(content, source, how.sheet) if t.sheet.lower() not in SKIPPED]
    whole = [t for t in tables if t.sheet.lower() == WHOLE]
    kinds: dict[bool, list[Recording]] = {}
    for table in whole or tables:
        for recording in recordings_of(table, how):
            kinds.setdefault(recording.height is None, []).append(recording)
    if not kinds:
        names = "; ".join(dict.fromkeys(table.names for table in tables))
        raise TrackError(f"{source}: has the columns {names}; {FORMATS}")
    if len(kinds) > 1:
        sheets = ", ".join(dict.fromkeys(t.sheet or t.title for t in tables))
        raise TrackError(
            f"{source}: holds tracks and times of impacts; choose one by its sheet ({sheets}) or "
            f"its column"
        )
    (found,) = kinds.values()
    if len({r.group for r in found}) > 1:  # each sheet is a group
        return found
    labels = [r.label for r in found]
    groups = _groups(labels) if found[0].height is None else [""] * len(found)
    return [replace(r, group=g) for r, g in zip(found, groups, strict=True)]


def recordings_of(table: Cells, how: Reading) -> Iterator[Recording]:
    """Yield the recordings of a table; none if it is another kind of table."""
    headings = chosen_headings(table, how)
    series = series_of_columns(table, headings)
    owners = [
        next((k for k, h in enumerate(headings) if h.role == role), None)
        for role in ("recording", "particle")
    ]
    keys = [table.column(k) for k in owners if k is not None]
    labels = [" ".join(cells) for cells in zip(*keys, strict=True)] if keys else []
    if labels and "" in (cell for cells in keys for cell in cells):
        line = table.lines[min(cells.index("") for cells in keys if "" in cells)]
        raise TrackError(f"{table.source}: line {line} has no particle; name or number it")
    for one in series:
        clock = _times(table, headings, one, how)
        label = " ".join(filter(None, (table.title, one.label)))
        owner = np.array(labels or [label] * len(table.rows), dtype=object)
        for name in dict.fromkeys(owner.tolist()):
            rows = np.flatnonzero(owner == name)
            yield from _recording(table, headings, one, clock, rows, how, str(name))


@dataclass(frozen=True)
class _Clock:
    """Times of the rows of a table, in s, or in frames if the rate is not known."""

    time: Array
    known: bool
    rounding: float


def _times(table: Cells, headings: list[Heading], one: Columns, how: Reading) -> _Clock:
    """Return the times of all rows."""
    place = one.time
    frames = [k for k, h in enumerate(headings) if h.role == "frame"]
    if one.height is not None and how.frame_rate is not None and frames:
        place = frames[0]
    head = headings[place]
    time = table.numbers(place)
    factor = time_factor(head.unit)
    if head.role == "frame" or head.unit.lower() in ("frame", "frames"):
        known = how.frame_rate is not None
        return _Clock(time / (how.frame_rate or 1.0), known, 0.0)
    if factor is None:
        raise TrackError(
            f'{table.source}: column "{head.text}" is in {head.unit!r}; known units of time: s, '
            f"ms, us, min"
        )
    step = rounding_of(c for c in table.column(place) if c.lower() not in MISSING)
    time, step = time * factor[0] / factor[1], step * factor[0] / factor[1]
    if one.height is None:
        return _Clock(time, True, step)
    seen = np.isfinite(time)
    stamps, index = np.unique(time[seen], return_inverse=True)
    even, rate = even_times(stamps, step, how.frame_rate)
    if even is not stamps or step < 1e-6 / rate:
        step = 0.0
    if how.frame_rate is not None and abs(rate / how.frame_rate - 1.0) > 1e-12:
        even = even * (rate / how.frame_rate)
    time[seen] = even[index]
    return _Clock(time, True, step)


def _recording(
    table: Cells,
    headings: list[Heading],
    one: Columns,
    clock: _Clock,
    rows: NDArray[np.intp],
    how: Reading,
    label: str,
) -> Iterator[Recording]:
    """Yield the recording of some rows; several where times begin anew after an empty line."""
    name = f"{table.source}, {label}" if label else table.source
    time = clock.time[rows]
    about: dict[str, Any] = {
        "scale_known": False,
        "rate_known": clock.known,
        "rounding": clock.rounding,
    }
    if one.height is None:
        seen = np.isfinite(time)
        time, rows = time[seen], rows[seen]
        time = _ended(table, headings, one.time, time, rows)
        falls = np.flatnonzero(np.diff(time) <= 0.0) + 1
        for k in falls[falls < rows.size]:
            if not any(rows[k - 1] < b <= rows[k] for b in table.breaks):
                raise TrackError(
                    f"{table.source}: line {table.lines[rows[k]]}: the time {time[k]:g} s is not "
                    f"after the one before, {time[k - 1]:g} s; sort the times, or leave a line "
                    f"empty before each drop"
                )
        parts = np.split(time, falls)
        for n, part in enumerate(parts, start=1):
            if part.size < 2:
                continue
            tail = f" part {n}" if len(parts) > 1 else ""
            yield Recording(
                name + tail, table.sheet, part, None, None, peaks=None, label=label + tail, **about
            )
        return
    head = headings[one.height]
    height = table.numbers(one.height)[rows]
    beside = None if one.horizontal is None else table.numbers(one.horizontal)[rows]
    unseen = np.flatnonzero(np.isnan(time) & np.isfinite(height))
    if unseen.size:
        line = table.lines[rows[unseen[0]]]
        raise TrackError(f"{table.source}: line {line} has no time; give that of every position")
    kept = np.flatnonzero(np.isfinite(time))
    kept = kept[np.argsort(time[kept], kind="stable")] if _numbered(headings) else kept
    track = Track(time[kept], height[kept], None if beside is None else beside[kept])
    falls = np.flatnonzero(np.diff(track.time) <= 0.0)
    if falls.size:
        line = table.lines[rows[kept[falls[0] + 1]]]
        raise TrackError(
            f"{table.source}: line {line}: the time {track.time[falls[0] + 1]:.6g} s is not after "
            f"the one before; sort the rows by time, or name the particle in a column"
        )
    if track.time.size < 2:
        return
    image = head.unit.lower() in PIXELS or _numbered(headings)
    yield made(track, head, how, image, name, table.sheet, label, about)


def _ended(
    table: Cells, headings: list[Heading], place: int, time: Array, rows: NDArray[np.intp]
) -> Array:
    """Add the impact that ends the last interval, where intervals stand beside the times."""
    if place + 1 == len(headings) or headings[place + 1].role != "interval" or time.size < 2:
        return time
    interval = table.numbers(place + 1)[rows]
    factor = time_factor(headings[place + 1].unit or headings[place].unit)
    if factor is None or not np.isfinite(interval).all():
        return time
    interval = interval * factor[0] / factor[1]
    after = np.allclose(np.diff(time), interval[:-1], rtol=0.0, atol=1e-3 * interval.max())
    return np.append(time, time[-1] + interval[-1]) if after and interval[-1] > 0.0 else time


def _numbered(headings: list[Heading]) -> bool:
    """Tell whether a table numbers its frames, as programs do that read images."""
    return any(h.role == "frame" for h in headings)


def _groups(labels: Iterable[str]) -> list[str]:
    """Name the recordings alike that differ only in a number, the last that does so."""
    names = list(labels)
    stems = [
        [name[: m.start()] + "*" + name[m.end() :] for m in re.finditer(r"\d+", name)][::-1]
        for name in names
    ]
    counts = Counter(stem for own in stems for stem in own)
    groups = [
        next((stem for stem in own if counts[stem] > 1), name)
        for own, name in zip(stems, names, strict=True)
    ]
    return groups if len(set(groups)) > 1 else [""] * len(names)
