"""Recordings from files of other programs: tracks, times of impacts, and sound."""

from __future__ import annotations

import contextlib
import io
import os
import re
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.arrays import Array, Flags
from vibrosweep.errors import TrackError, require_one_of
from vibrosweep.lab.tracks import FRAME_RATES, make_tracks, with_mark
from vibrosweep.lab.variables import require_name, require_number
from vibrosweep.mistakes import cut
from vibrosweep.scene.tables import (
    MISSING,
    PIXELS,
    Cells,
    Heading,
    cells_of,
    decoded,
    even_times,
    heading,
    length_factor,
    origin_of,
    read_content,
    rounding_of,
    time_factor,
)

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["read_tracks", "tracks_from_frame"]

# -----------------------------------------------------------------------------
# Tracks in units of their files, and options of reading.

AXES: Final = ("up", "down")
SENTINELS: Final = (0.0, -1.0)  # placeholders for lost positions in some programs
# Frames per second in Hz, m per unit, and a height in units
RANGES: Final = (("frame_rate", *FRAME_RATES), ("scale", 1e-30, 1e30), ("base", -1e30, 1e30))


@dataclass(frozen=True, slots=True)
class Recording:
    """One drop or one film of one ball: a track, or times of impacts.

    Examples
    --------
    >>> import numpy as np
    >>> import vibrosweep as vs
    >>> times = np.array([0.0, 0.80, 1.52, 2.168])  # s, of four impacts
    >>> drop = vs.lab.Recording("drop 1", "", times, None, None, True, True, 0.0, None)
    >>> print(drop.height is None)
    True
    """

    name: str  # name of the file, with a suffix if it holds several recordings
    group: str  # name of a group of recordings to pool; empty if the file names none
    time: NDArray[np.float64]  # s on the clock of the file, or frames if their rate is not known
    # Upwards, in m, or in units of the file if the scale is not known; None for times of impacts
    height: NDArray[np.float64] | None
    horizontal: NDArray[np.float64] | None  # horizontal coordinate of a track, if any
    scale_known: bool
    rate_known: bool
    rounding: float  # s, resolution of the times; 0 if they are not rounded
    peaks: NDArray[np.float64] | None  # loudness of each click in a sound recording
    label: str = ""  # name of the particle or of the recording inside its file
    pixels: bool = False  # heights are rows of an image
    remarks: tuple[str, ...] = ()  # positions taken for lost or left out
    clock_error: float = 0.0  # s, standard error of the clock after rounding was undone


@dataclass(frozen=True)
class Reading:
    """Options of reading files, as the arguments of `read_recordings`."""

    scale: float | None = None
    frame_rate: float | None = None
    axis: str | None = None
    column: str | None = None
    particle: str | None = None
    sheet: str | None = None
    base: float | None = None  # the zero of heights, in units of the file

    def __post_init__(self) -> None:
        for name, low, high in RANGES:
            if (value := getattr(self, name)) is not None:
                require_number(name, value, low, high, error=TrackError)
        require_one_of("axis", "up" if self.axis is None else self.axis, AXES, TrackError)
        for name in ("column", "particle", "sheet"):
            require_name(name, getattr(self, name))


def convert(track: Recording, head: Heading, how: Reading) -> Recording:
    """Convert the heights of a track, in units of its file, to m, upwards."""
    name, pixels = track.name, head.unit.lower() in PIXELS
    factor = (1.0, 1.0) if pixels else length_factor(head.unit)
    if factor is None:
        raise TrackError(
            f"{name}: heights are in {head.unit!r}; known units: m, cm, mm, um, px; export them in "
            f"m, or without a unit and give the scale"
        )
    if how.scale is not None:
        factor = (how.scale, 1.0)
    stated = bool(head.unit) and not pixels
    known = how.scale is not None or stated or (head.text.lower() == "height" and not track.pixels)
    height, horizontal, remarks = np.array(track.height), track.horizontal, []
    for value in SENTINELS:
        lost = _lost_positions(height, value)
        if lost.any():
            height[lost] = np.nan
            remarks.append(
                f"{name}: {lost.sum()} heights are {value:g}, far from the neighbouring ones: "
                f"taken for lost positions"
            )
    up = how.axis or ("down" if track.pixels else "up")
    sign = 1.0 if up == "up" else -1.0
    with np.errstate(over="ignore"):
        if horizontal is not None:
            horizontal = np.where(np.isnan(height), np.nan, horizontal) * factor[0] / factor[1]
        height = sign * (height - (how.base or 0.0)) * factor[0] / factor[1]
    if np.isinf(height).any() or (horizontal is not None and np.isinf(horizontal).any()):
        raise TrackError(f"{name}: positions are too large for the computation; check the scale")
    return replace(
        track, height=height, horizontal=horizontal, scale_known=known, remarks=tuple(remarks)
    )


def _lost_positions(height: Array, value: float) -> Flags:
    """Mark positions equal to a placeholder, which shows as unusual jumps of the track."""
    hit = height == value
    seen = np.isfinite(height)
    none = np.zeros(height.size, np.bool_)
    if hit.sum() < 2 or 2 * hit.sum() > seen.sum():
        return none
    steps = np.abs(np.diff(height))
    apart = hit[1:] != hit[:-1]
    jumps = steps[apart & np.isfinite(steps)]
    usual = steps[~apart & ~hit[1:] & np.isfinite(steps)]
    if not jumps.size or not usual.size:
        return none
    far = np.median(jumps) > 2.0 * np.quantile(usual, 0.995)
    return hit if far else none


# -----------------------------------------------------------------------------
# Grouping of columns: times, heights, and recordings side by side.

FORMATS: Final = (
    "give a column of times and one of heights, such as time and height, or t and y; frames with "
    "x and y; or times of impacts, whose column may be chosen by its name (column=, --column)"
)


@dataclass(frozen=True)
class Columns:
    """Indices of the columns of one recording."""

    time: int
    height: int | None
    horizontal: int | None
    label: str


def chosen_headings(table: Cells, how: Reading) -> list[Heading]:
    """Return the headings of a table; a chosen column is the only one with heights or times."""
    headings = list(table.headings)
    columns = range(len(headings))
    if len(columns) in (2, 3) and all(headings[k].text == f"column {k + 1}" for k in columns):
        values = [table.numbers(k) if table.wordless(k) else np.empty(0) for k in columns]
        rising = [len(v) > 1 and bool((np.diff(v) > 0.0).all()) for v in values]
        if rising[0] and not any(rising[1:]) and all(map(len, values)):  # a film: t, y or t, x, y
            places = zip(
                headings, ("time", *("horizontal",)[: len(columns) - 2], "height"), strict=True
            )
            return [replace(h, role=role) for h, role in places]
    nameless = [not h.role and h.text != f"column {k}" for k, h in enumerate(headings, start=1)]
    wordless = all(map(table.wordless, columns))
    if (all(nameless) or len(headings) == 1) and wordless and _are_side_by_side(headings):
        # names that say nothing, such as drop 1, drop 2
        headings = [replace(h, role=h.role or "time") for h in headings]
    if how.column is None:
        return headings
    wanted = [k for k, h in enumerate(headings) if h.means(how.column)]
    if not wanted:
        return [replace(h, role="") for h in headings]
    clocks = [k for k, h in enumerate(headings) if h.role in ("time", "frame")]
    impacts = not clocks or any(headings[k].role == "time" for k in wanted)
    drop = ("height", "depth", "time") if impacts else ("height", "depth")
    roles = [("" if h.role in drop else h.role) for h in headings]
    for k in wanted:
        roles[k] = "time" if impacts else "height"
    return [replace(h, role=role) for h, role in zip(headings, roles, strict=True)]


def series_of_columns(table: Cells, headings: list[Heading]) -> list[Columns]:
    """Find the columns of each recording."""
    places = {
        role: [k for k, h in enumerate(headings) if h.role == role and _has_values(table, k)]
        for role in ("time", "frame", "height", "depth", "horizontal", "interval")
    }
    times = places["time"] or places["frame"]
    heights = places["height"] or places["depth"] or _lengths(table, headings)
    if not heights:
        # a trace of the base, or a track without heights
        other = any(h.role in ("acceleration", "horizontal", "frame") for h in headings)
        times = [] if other else places["time"] or places["interval"]
        if len(times) > 1 and not _are_side_by_side([headings[k] for k in times]):
            raise _ambiguous(table, [headings[k] for k in times], "times of impacts")
        return [
            Columns(k, None, None, headings[k].label or (str(n) if len(times) > 1 else ""))
            for n, k in enumerate(times, start=1)
        ]
    if not times:
        raise TrackError(f"{table.source}: has the columns {table.names}; {FORMATS}")
    if len(heights) > 1 and not _are_side_by_side([headings[k] for k in heights]):
        raise _ambiguous(table, [headings[k] for k in heights], "heights")
    series = []
    for n, k in enumerate(heights, start=1):
        low = heights[n - 2] if n > 1 else -1
        high = heights[n] if n < len(heights) else len(headings)
        horizontal = [j for j in places["horizontal"] if low < j < high]
        horizontal.sort(key=lambda j: abs(j - k))
        series.append(
            Columns(
                max((j for j in times if j < k), default=times[0]),
                k,
                horizontal[0] if horizontal else None,
                headings[k].label or (str(n) if len(heights) > 1 else ""),
            )
        )
    return series


def _has_values(table: Cells, k: int) -> bool:
    return any(cell.lower() not in MISSING for cell in table.column(k))


def _lengths(table: Cells, headings: list[Heading]) -> list[int]:
    """Return the columns with a unit of length and an uninformative name."""
    return [
        k
        for k, h in enumerate(headings)
        if not h.role and h.unit and (length_factor(h.unit) or h.unit in PIXELS)
    ]


def _are_side_by_side(headings: list[Heading]) -> bool:
    """Return whether columns differ only in labels or in a number, as for drops side by side."""
    names = {re.sub(r"[\W\d_]+", " ", h.text.lower()).strip() for h in headings}
    labels = {h.label for h in headings}
    return len(names) == 1 or (len(labels) == len(headings) and "" not in labels)


def _ambiguous(table: Cells, headings: list[Heading], what: str) -> TrackError:
    names = ", ".join(f'"{h.text}"' for h in headings)
    return TrackError(
        f"{table.source}: several columns may hold {what}: {names}; choose one by its name "
        f"(column=, --column)"
    )


# -----------------------------------------------------------------------------
# Tracks of MTrack2, an ImageJ plugin.

REACH: Final = 30.0  # largest displacement per frame in pixels for joining positions
MEMORY: Final = 10.0  # frames without a position after which a track ends
STILL: Final = 0.25  # range of motion, relative to that of the ball, below which a track is a mark


def mtrack_recordings(content: bytes, source: str, how: Reading) -> list[Recording]:
    """Read an MTrack2 export of ImageJ; empty for another format.

    Separators of empty cells may be lost; positions are then assigned to the nearest track.
    """
    if not re.match(rb"(\xef\xbb\xbf)?\s*Frame\W+X1\W+Y1\W+Flag1\b", content):
        return []
    lines = decoded(content, source).splitlines()
    tracks: list[dict[float, tuple[float, float]]] = []
    remarks: list[str] = []
    for number, line in enumerate(lines, start=1):
        if line.startswith("Frame"):
            base = len(tracks)
            mark = next((m for m in "\t,;" if m in line), None)
            tracks += [{} for _ in re.findall(r"X\d+", line)]
            continue
        if line.startswith("Track "):
            break
        cells = [c.strip() for c in (line.split(mark) if mark else line.split())]
        if not cells or not cells[0] or cells[0].startswith("Tracks"):
            continue
        try:
            frame, rest = float(cells[0]), cells[1:]
            if mark:
                pairs = {
                    base + k // 3: (float(rest[k]), float(rest[k + 1]))
                    for k in range(0, len(rest) - 1, 3)
                    if rest[k]
                }
            else:
                bare = [float(c) for c in rest if c != "*"]
                if len(bare) % 2:  # a cell was lost, so that the pairs are ambiguous
                    remarks.append(f"{source}: line {number} has an incomplete pair: left out")
                    continue
                pairs = _joined_table(tracks, frame, list(zip(bare[::2], bare[1::2], strict=True)))
            for k, pair in pairs.items():
                tracks[k][frame] = pair
        except (ValueError, IndexError) as error:
            raise TrackError(
                f"{source}: line {number}: {line.strip()!r} does not hold a frame and pairs of "
                f"positions"
            ) from error
    return _moving_tracks(tracks, source, how, remarks)


def _joined_table(
    tracks: list[dict[float, tuple[float, float]]],
    frame: float,
    pairs: list[tuple[float, float]],
) -> dict[int, tuple[float, float]]:
    """Assign positions to the tracks with the nearest last position, or to new tracks."""
    from scipy.optimize import linear_sum_assignment

    live = [k for k, t in enumerate(tracks) if t and frame - max(t) <= MEMORY]
    found: dict[int, tuple[float, float]] = {}
    if live and pairs:
        last = np.array([tracks[k][max(tracks[k])] for k in live])
        since = np.array([frame - max(tracks[k]) for k in live])
        apart = np.hypot(*(last[:, np.newaxis] - np.array(pairs)).transpose(2, 0, 1))
        apart /= since[:, np.newaxis]
        for i, j in zip(*linear_sum_assignment(np.minimum(apart, REACH)), strict=True):
            if apart[i, j] < REACH:
                found[live[i]] = pairs[j]
    for pair in pairs:
        if pair not in found.values():
            tracks.append({})
            found[len(tracks) - 1] = pair
    return found


def _moving_tracks(
    tracks: list[dict[float, tuple[float, float]]], source: str, how: Reading, remarks: list[str]
) -> list[Recording]:
    """Make recordings of the moving tracks; the others are marks."""
    moves = [float(np.ptp([y for _, y in t.values()])) if t else 0.0 for t in tracks]
    least = STILL * max(moves, default=0.0) if how.particle is None else 0.0
    balls = [k for k, move in enumerate(moves) if move > least]
    several = len(balls) > 1 or how.particle is not None
    timed = how.frame_rate is not None
    found = []
    for k in balls:
        frames = sorted(tracks[k])
        x, y = np.array([tracks[k][frame] for frame in frames]).T
        time = np.array(frames) / (how.frame_rate or 1.0)
        name = f"{source}, track {k + 1}" if several else source
        ball = Recording(name, "", time, y, x, False, timed, 0.0, None, str(k + 1), pixels=True)
        found.append(convert(ball, Heading("Y", "height", "px", ""), how))
    if not found:
        raise TrackError(f"{source}: holds no track that moves; check the file")
    still = len([t for t in tracks if t]) - len(balls)
    if still:
        remarks.append(f"{source}: {still} tracks stay where they are: taken for marks")
    return [replace(r, remarks=(*r.remarks, *remarks)) for r in found]


# -----------------------------------------------------------------------------
# Clicks of impacts in a sound file.

BAND: Final = (300.0, 8000.0)  # Hz; hum and most of the noise lie outside
WINDOW: Final = 1e-3  # s, averaging time of the loudness
APART: Final = 0.05  # s, shortest time between two clicks
BEAT: Final = 3e-3  # s, longest dip inside a click, as where an echo interferes
ATTACK: Final = 0.025  # s, longest time from the onset of a click to its peak
RISE: Final = 10.0  # dB, height of a click above the noise
DIP: Final = 6.0  # dB, rise of a click above what precedes it
QUIETEST: Final = -60.0  # dB relative to the loudest click
# Echoes: dB below a click, and dB per s by which they fade; a reverberation of 0.5 s
ECHO: Final = (6.0, 120.0)
ONSET: Final = 0.3  # fraction of the loudness of a click at its onset


def clicks_of(content: bytes, source: str) -> tuple[Array, Array, float]:
    """Return times (s) and loudness of the clicks in a WAV file, and its sampling interval (s).

    Raises a ValueError if the file cannot be read or has fewer than two clicks.
    """
    from scipy.io import wavfile
    from scipy.ndimage import binary_opening, uniform_filter1d
    from scipy.signal import butter, find_peaks, sosfilt

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks without sound
            rate, samples = wavfile.read(io.BytesIO(content))
    except Exception as error:  # damaged files raise errors without a common base class
        raise ValueError(f"{source}: is not a WAV file that can be read: {error}") from error
    if not (samples.size and rate > 0):
        raise ValueError(f"{source}: is a WAV file without a sound")
    sound = np.asarray(samples, np.float64).reshape(len(samples), -1).mean(axis=1)
    if rate > 4.0 * BAND[0]:
        band = (BAND[0], min(BAND[1], 0.45 * rate))
        sound = sosfilt(butter(2, band, "bandpass", fs=rate, output="sos"), sound)
    loudness = uniform_filter1d(np.abs(sound), max(int(WINDOW * rate), 1))
    loudest = float(loudness.max(initial=0.0))
    noise = max(float(np.median(loudness)), 10.0 ** (QUIETEST / 20.0) * loudest, 1e-300)
    level = 20.0 * np.log10(np.maximum(loudness, noise) / noise)
    places, _ = find_peaks(level, height=RISE, prominence=DIP)
    onsets: list[int] = []
    clicks: list[int] = []
    faded = -np.inf  # level of the echoes of the last click, extrapolated to the beginning
    for place in places.tolist():
        ready = onsets[-1] + int(APART * rate) if onsets else 0
        if place < ready or level[place] < faded - ECHO[1] * place / rate:
            continue
        clicks.append(place)
        faded = level[place] - ECHO[0] + ECHO[1] * place / rate
        begin = max(place - int(ATTACK * rate), ready)
        below = loudness[begin:place] < noise + ONSET * (loudness[place] - noise)
        quiet = np.flatnonzero(binary_opening(below, np.ones(int(BEAT * rate) + 1, np.bool_)))
        onsets.append(begin + (int(quiet[-1]) + 1 if quiet.size else 0))
    if len(onsets) < 2:
        raise ValueError(f"{source}: holds {len(onsets)} clicks; at least two are needed")
    return np.array(onsets) / rate, loudness[clicks], 1.0 / rate


# -----------------------------------------------------------------------------
# Recordings from files of other programs: tracks, times of impacts, and sound.

SKIPPED: Final = ("metadata device", "metadata time")  # sheets of phyphox
WHOLE: Final = "all"  # phyphox's sheet with the list of all events


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
    r"""Read tracks or times of impacts from files; the format is detected.

    Parameters
    ----------
    paths
        A file or several: text with columns, workbooks (xls, xlsx, ods), exports of Tracker,
        trackpy, TrackMate, MTrack2 and phyphox, and sound (WAV).
    scale
        Length in m of a unit of the file, such as a pixel; by default the unit in the heading.
    frame_rate
        Frames per second, Hz; needed for speeds if a file holds frame numbers.  Times of other
        files are rescaled to it: a slow-motion video is often exported with its playback rate.
    axis
        ``"up"`` or ``"down"``, the direction in which heights increase in the file; by default up,
        but down if a file holds frame numbers or pixels.
    column
        Name of the column of heights or of times of impacts, if several are possible.
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
        A file cannot be read, holds no recording, or is ambiguous.

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
    return [recording for path in files_of(paths) for recording in read_file(path, how)]


def files_of(paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]]) -> list[Path]:
    """Return the paths of one file or several."""
    try:
        return [Path(p) for p in ([paths] if isinstance(paths, str | os.PathLike) else paths)]
    except TypeError:
        raise TrackError(f"paths = {paths!r}: must be a file, or several in a list") from None


def recordings_in(recordings: Sequence[Recording]) -> list[Recording]:
    """Check that an argument holds results of `read_recordings`."""
    several = [recordings] if isinstance(recordings, Recording) else recordings
    if not isinstance(several, Sequence) or not all(isinstance(r, Recording) for r in several):
        raise TrackError(
            f"recordings = {cut(repr(recordings))}: must be a list that read_recordings returns"
        )
    return list(several)


def read_file(path: Path, how: Reading) -> list[Recording]:
    """Read the recordings of a file."""
    source = str(path)
    try:
        content = read_content(path)
        if content.startswith(b"RIFF"):
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
    """Yield the recordings of a table; none for other kinds of tables."""
    table = _upright(table)
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


def _upright(table: Cells) -> Cells:
    """Return a list of times that stands in one row as a column."""
    columns = range(len(table.headings))
    bare = all(h.role in ("", "time") for h in table.headings) and all(map(table.wordless, columns))
    if not (bare and len(table.rows) == 1 and len(columns) > 2):
        return table
    rows, lines = [[cell] for cell in table.rows[0]], table.lines * len(columns)
    unit = table.headings[0].unit
    return replace(table, headings=(heading("time", unit),), rows=rows, lines=lines)


# Times of the rows of a table in s, or in frames if their rate is not known; whether it is known;
# the rounding of the times (s); and the standard error of all of them alike (s)
_Clock = tuple[Array, bool, float, float]


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
        return time / (how.frame_rate or 1.0), how.frame_rate is not None, 0.0, 0.0
    if factor is None:
        raise TrackError(
            f'{table.source}: column "{head.text}" is in {head.unit!r}; known units of time: s, '
            f"ms, us, min"
        )
    step = rounding_of(c for c in table.column(place) if c.lower() not in MISSING)
    time, step = time * factor[0] / factor[1], step * factor[0] / factor[1]
    if one.height is None:
        return time, True, step, 0.0
    seen = np.isfinite(time)
    stamps, index = np.unique(time[seen], return_inverse=True)
    even, rate = even_times(stamps, step, how.frame_rate)
    error = 0.0
    if even is not stamps:  # the stamps determine the clock up to a shift that none of them shows
        error = max(step - float(np.ptp(stamps - even)), 0.0) / np.sqrt(12.0)
    if even is not stamps or step < 1e-6 / rate:
        step = 0.0
    if how.frame_rate is not None and abs(rate / how.frame_rate - 1.0) > 1e-12:
        even = even * (rate / how.frame_rate)
    time[seen] = even[index]
    return time, True, step, error


def _recording(
    table: Cells,
    headings: list[Heading],
    one: Columns,
    clock: _Clock,
    rows: NDArray[np.intp],
    how: Reading,
    label: str,
) -> Iterator[Recording]:
    """Yield the recording of some rows; several if times restart after an empty line."""
    name = f"{table.source}, {label}" if label else table.source
    every, known, rounding, error = clock
    time = every[rows]
    raw = Recording(
        name, table.sheet, time, None, None, False, known, rounding, None, label, clock_error=error
    )
    if one.height is None:
        seen = np.isfinite(time)
        time, rows = time[seen], rows[seen]
        if headings[one.time].role == "interval":
            time, rows = _impacts_between(table, time, rows)
        time = _with_last_impact(table, headings, one.time, time, rows)
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
            yield replace(raw, name=name + tail, time=part, label=label + tail)
        return
    head = headings[one.height]
    height = table.numbers(one.height)[rows]
    horizontal = None if one.horizontal is None else table.numbers(one.horizontal)[rows]
    unseen = np.flatnonzero(np.isnan(time) & np.isfinite(height))
    if unseen.size:
        line = table.lines[rows[unseen[0]]]
        raise TrackError(f"{table.source}: line {line} has no time; give that of every position")
    valid = np.flatnonzero(np.isfinite(time))
    valid = valid[np.argsort(time[valid], kind="stable")] if _numbered(headings) else valid
    again = np.diff(time[valid]) == 0.0  # a frame that was written twice
    again &= np.equal(*(height[valid][part] for part in (slice(1, None), slice(None, -1))))
    valid = valid[np.append(True, ~again)]
    falls = np.flatnonzero(np.diff(time[valid]) <= 0.0)
    if falls.size:
        line = table.lines[rows[valid[falls[0] + 1]]]
        raise TrackError(
            f"{table.source}: line {line}: the time {time[valid[falls[0] + 1]]:.6g} s is not after "
            f"the one before; sort the rows by time, or name the particle in a column"
        )
    if valid.size < 2:
        return
    track = replace(
        raw,
        time=time[valid],
        height=height[valid],
        horizontal=None if horizontal is None else horizontal[valid],
        pixels=head.unit.lower() in PIXELS or (_numbered(headings) and not _in_metres(head)),
    )
    yield convert(track, head, how)


def _impacts_between(
    table: Cells, intervals: Array, rows: NDArray[np.intp]
) -> tuple[Array, NDArray[np.intp]]:
    """Return the times of the impacts that bound intervals, from 0 in each drop, and their rows."""
    drops = np.split(np.arange(rows.size), np.searchsorted(rows, table.breaks))
    parts = [drop for drop in drops if drop.size]
    times = [np.append(0.0, np.cumsum(intervals[part])) for part in parts]
    # the first impact stands in the row of the first interval
    places = [np.append(rows[part[0]], rows[part]) for part in parts]
    return np.concatenate([[], *times]), np.concatenate([np.empty(0, np.intp), *places])


def _with_last_impact(
    table: Cells, headings: list[Heading], place: int, time: Array, rows: NDArray[np.intp]
) -> Array:
    """Add the impact at the end of the last interval, if a column of intervals follows."""
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
    """Return whether a table is of a program that tracks images: with frame numbers.

    A table of times that are not those of particles may have frame numbers too, as Tracker's.
    """
    roles = {h.role for h in headings}
    return "frame" in roles and ("time" not in roles or "particle" in roles)


def _in_metres(head: Heading) -> bool:
    """Return whether heights have a unit that no image-tracking program assumes by itself."""
    return length_factor(head.unit) is not None and head.unit.lower() in ("m", "cm", "mm")


def _groups(labels: Iterable[str]) -> list[str]:
    """Give a common group name to recordings that differ only in a number, the last such number."""
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


# -----------------------------------------------------------------------------
# Tracks of one recording, from files or a table in memory, as a dataset.


def read_tracks(
    paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    *,
    frame_rate: float | None = None,
    scale: float | None = None,
    axis: str | None = None,
    base: float | None = None,
    base_track: str | None = None,
    column: str | None = None,
    particle: str | None = None,
    sheet: str | None = None,
) -> xr.Dataset:
    """Read the tracks of one recording; the format is detected.

    Parameters
    ----------
    paths
        A file, or several with different particles of the same recording.
    frame_rate
        Frames per second, Hz; required for the table of trackpy.  The times of other files are
        rescaled to this rate: a slow-motion video is often exported with its playback rate.
    scale
        Length in m of a unit of the file, such as a pixel; by default 1, required for the table of
        trackpy.
    axis
        ``"up"`` or ``"down"``, the direction in which heights increase in the file; by default up,
        but down for the pixel rows of trackpy.
    base
        Height of the base in units of the file, the zero of heights; by default 0.
    base_track
        Name of a particle that is a mark on the base.  Its track becomes the variable
        ``base_height`` (m), to which `find_impacts` fits the harmonics of the base.
    column, particle, sheet
        As in `read_recordings`.

    Returns
    -------
    xarray.Dataset
        As `make_tracks` returns it.  If the clock of the file starts in 1970 or at midnight, times
        are relative to the attribute ``origin`` (s).

    Raises
    ------
    TrackError
        A file cannot be read, or holds no tracks.

    Examples
    --------
    >>> import tempfile, numpy as np, pandas as pd, vibrosweep as vs
    >>> time = np.arange(60) / 100.0
    >>> height = 0.05 - 4.9 * (time % 0.2 - 0.1) ** 2
    >>> table = pd.DataFrame({"time": time, "particle": "ball", "height": height})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     table.to_csv(f"{folder}/track.csv", index=False)
    ...     vs.lab.read_tracks(f"{folder}/track.csv").height.dims
    ('frame', 'particle')
    """
    require_name("base_track", base_track)
    files = files_of(paths)
    how = Reading(scale, frame_rate, axis, column, particle, sheet, base)
    found = [read_file(path, how) for path in files]
    if len(found) > 1:
        shared = set.intersection(*({r.label for r in own} for own in found))
        if shared - {""}:
            raise TrackError(
                f"{files[0]} and others: particle {min(shared)} is in each of them; "
                f"rename it, or read different recordings separately"
            )
        found = [
            [replace(r, label=r.label or path.stem) for r in own]
            for path, own in zip(files, found, strict=True)
        ]
    tracks = _joined([r for own in found for r in own], ", ".join(map(str, files)), frame_rate)
    return tracks if base_track is None else with_mark(tracks, base_track)


def tracks_from_frame(
    table: pd.DataFrame,
    *,
    frame_rate: float | None = None,
    scale: float | None = None,
    axis: str | None = None,
    base: float | None = None,
    base_track: str | None = None,
    source: str = "the table",
) -> xr.Dataset:
    """Make tracks from a `pandas.DataFrame` of time, particle, height or frame, particle, y.

    Parameters
    ----------
    table
        Times in s, or frames; heights in m or in units of `scale`.
    frame_rate, scale, axis, base, base_track
        As in `read_tracks`.
    source
        Name of the table in messages.

    Returns
    -------
    xarray.Dataset
        As `make_tracks` returns it.

    Raises
    ------
    TrackError
        The table holds no tracks.

    Examples
    --------
    >>> import numpy as np, pandas as pd
    >>> from vibrosweep.lab import tracks_from_frame
    >>> time = np.arange(60) / 100.0
    >>> height = 0.05 - 4.9 * (time % 0.2 - 0.1) ** 2
    >>> table = pd.DataFrame({"time": time, "particle": "ball", "height": height})
    >>> tracks_from_frame(table).height.dims
    ('frame', 'particle')
    """
    how = Reading(scale, frame_rate, axis, base=base)
    if not hasattr(table, "columns"):
        raise TrackError(f"{source}: must be a pandas.DataFrame, not {type(table).__name__}")
    text = table.astype(object).where(table.notna(), "").astype(str)
    cells = Cells(
        source,
        "",
        "",
        tuple(heading(str(name)) for name in table.columns),
        text.to_numpy(object).tolist(),
        list(range(1, len(table) + 1)),
    )
    try:
        found = list(recordings_of(cells, how))
    except ValueError as error:
        raise error if isinstance(error, TrackError) else TrackError(str(error)) from error
    tracks = _joined(found, source, frame_rate)
    return tracks if base_track is None else with_mark(tracks, base_track)


def _joined(found: list[Recording], source: str, frame_rate: float | None) -> xr.Dataset:
    """Combine the tracks of one recording in a dataset."""
    heights: list[Array] = []
    for one in found:
        if one.height is None:
            raise TrackError(f"{one.name}: holds times of impacts, and no tracks with heights")
        if not one.rate_known or (one.pixels and not one.scale_known):
            raise TrackError(
                f"{one.name}: frames and pixels need the frame rate in Hz and the scale in m per "
                f"pixel; give both"
            )
        heights.append(one.height)
    if not found:
        raise TrackError(f"{source}: holds no positions; check the file and its columns")
    labels = [one.label for one in found]
    names: list[object] = list(labels)
    with contextlib.suppress(ValueError):
        names = [float(label or 0) for label in labels]
        names = [int(label or 0) for label in labels]
    if len({*names}) < len(names):
        raise TrackError(
            f"{source}: holds several tracks with the same name; choose one by its sheet (sheet=, "
            f"--sheet), or name the particle in a column"
        )
    particles, order = np.unique(
        np.array(names, object if isinstance(names[0], str) else None), return_index=True
    )
    time, frame = np.unique(np.concatenate([one.time for one in found]), return_inverse=True)
    origin = origin_of(time)
    if origin:  # there the spacing of doubles is 0.2 us
        time = even_times(time - origin, 4.0 * float(np.spacing(abs(origin))))[0]
    grid = np.full((time.size, len(found)), np.nan)
    grid[frame, np.repeat(np.arange(len(found)), [h.size for h in heights])] = np.concatenate(
        heights
    )
    tracks = make_tracks(time, grid[:, order], particles, source)
    if origin:
        tracks.attrs["origin"] = origin
    if error := max(one.clock_error for one in found):
        tracks.attrs["clock_error"] = error
    if frame_rate is not None:
        tracks.attrs["frame_rate"] = frame_rate
    if remarks := dict.fromkeys(remark for one in found for remark in one.remarks):
        tracks.attrs["remarks"] = "\n".join(remarks)
    return tracks
