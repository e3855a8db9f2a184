"""Tracks from files: plain CSV, trackpy's table, and exports of Tracker (Open Source Physics)."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr

from vibrosweep.arrays import Array
from vibrosweep.errors import TrackError, require_one_of
from vibrosweep.lab.tracks import FRAME_RATES, make_tracks, table_to_tracks, with_mark

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["AXES", "read_tracks", "tracks_from_frame"]


AXES: Final = ("up", "down")
PLAIN: Final = ("time", "particle", "height")
TRACKPY: Final = ("frame", "particle", "y")
_METRES: Final = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_FORMATS: Final = (
    "the file must have the columns time, particle, height; or frame, particle, y as trackpy "
    "writes them; or be an export of Tracker with the columns t and y"
)


def read_tracks(
    paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    *,
    frame_rate: float | None = None,
    scale: float | None = None,
    axis: str | None = None,
    base: float | None = None,
    base_track: str | None = None,
) -> xr.Dataset:
    """Read the tracks of one recording; the first lines of a file show its format.

    Parameters
    ----------
    paths
        A file, or several that hold different particles of the same recording.
    frame_rate
        Frames per second, Hz; required for the table of trackpy.  The times of other files are
        rescaled to this rate: a slow-motion video is often exported with its playing rate.
    scale
        m per unit of the file, such as m per pixel; by default 1, required for the table of
        trackpy.
    axis
        ``"up"`` or ``"down"``, the direction in which heights grow in the file; by default up, but
        down for the pixel rows of trackpy.
    base
        Height of the base in units of the file, the zero of heights; by default 0.
    base_track
        Name of a particle that is a mark on the base.  Its track becomes the variable
        ``base_height`` (m), to which `find_impacts` fits the harmonics of the base.

    Returns
    -------
    xarray.Dataset
        As `make_tracks` returns it.

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
    import pandas as pd

    files = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    frames = [_table(Path(path)) for path in files]
    if len(frames) > 1:
        if len({frozenset(frame.columns) for frame in frames}) > 1:
            raise TrackError(f"{files[0]} and others: have different formats; convert them to one")
        names = [set(frame["particle"]) for frame in frames]
        shared = set.intersection(*names)
        if shared:
            raise TrackError(
                f"{files[0]} and others: particle {min(shared, key=str)} is in each of them; "
                f"rename it, or read different recordings separately"
            )
    return tracks_from_frame(
        pd.concat(frames, ignore_index=True),
        frame_rate=frame_rate,
        scale=scale,
        axis=axis,
        base=base,
        base_track=base_track,
        source=", ".join(str(path) for path in files),
    )


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
    lowest, highest = FRAME_RATES
    if frame_rate is not None and not lowest <= frame_rate <= highest:
        raise TrackError(f"frame_rate = {frame_rate:g}: must be {lowest:g} to {highest:g} Hz")
    if scale is not None and not 0.0 < scale < np.inf:
        raise TrackError(f"scale = {scale:g}: must be a finite number above 0")
    if base is not None and not np.isfinite(base):
        raise TrackError(f"base = {base:g}: must be a finite number")
    require_one_of("axis", axis or "up", AXES, TrackError)
    if set(PLAIN) <= set(table.columns):
        time = _numbers(table, "time", source)
        height = _numbers(table, "height", source)
    elif set(TRACKPY) <= set(table.columns):
        if frame_rate is None or scale is None:
            raise TrackError(
                f"{source}: frames and pixels need the frame rate in Hz and the scale in m per "
                f"pixel; give both"
            )
        with np.errstate(over="ignore"):  # refused below
            time = _numbers(table, "frame", source) / frame_rate
        height, axis = _numbers(table, "y", source), axis or "down"
    else:
        found = ", ".join(map(str, table.columns)) or "none"
        raise TrackError(f"{source}: has the columns {found}; {_FORMATS}")
    upwards = 1.0 if (axis or "up") == "up" else -1.0
    with np.errstate(over="ignore"):
        height = upwards * (scale or 1.0) * (height - (base or 0.0))
    particle = table["particle"]
    unnamed = np.flatnonzero(particle.isna())
    if unnamed.size:
        raise TrackError(f"{source}: row {unnamed[0] + 1} has no particle; name or number it")
    numbered = particle.dtype.kind in "iuf"
    owner = particle.to_numpy() if numbered else particle.astype(str).to_numpy(object)
    tracks = table_to_tracks(time, owner, height, source)
    if frame_rate is not None and "time" in table.columns:
        seconds = tracks["time"].values * (tracks.attrs["frame_rate"] / frame_rate)
        names = tracks["particle"].values
        tracks = make_tracks(seconds, tracks["height"].values, names, source)
        tracks.attrs["frame_rate"] = frame_rate
    return tracks if base_track is None else with_mark(tracks, base_track)


def _numbers(table: pd.DataFrame, name: str, source: str) -> Array:
    """Convert a column to numbers; empty cells become NaN."""
    import pandas as pd

    values = pd.to_numeric(table[name], errors="coerce").to_numpy(np.float64)
    words = np.flatnonzero(np.isnan(values) & table[name].notna().to_numpy())
    if words.size:
        raise TrackError(
            f'{source}: column "{name}", row {words[0] + 1} (the first row of values is 1): '
            f"{table[name].iloc[words[0]]!r} is not a number; leave lost positions empty"
        )
    return values


def _table(path: Path) -> pd.DataFrame:
    """Read a file of any format into the columns that `tracks_from_frame` takes."""
    import pandas as pd

    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise TrackError(f"{path}: there is no such file of tracks; check the path") from error
    except UnicodeDecodeError as error:
        raise TrackError(f"{path}: is not UTF-8 text; export the tracks as text") from error
    except OSError as error:
        raise TrackError(f"{path}: cannot be read: {error.strerror}") from error
    lines = text.splitlines()
    if not any(line.strip() for line in lines):
        raise TrackError(f"{path}: is empty; {_FORMATS}")
    mass, start = _tracker_header(lines)
    header = lines[start]
    separator = next((mark for mark in "\t;," if mark in header), ",")
    comma = separator != "," and any("," in line for line in lines[start + 1 : start + 9])
    # Tracker ends some of the lines with a separator
    columns = max(line.count(separator) for line in lines[start:]) + 1
    try:
        table = pd.read_csv(
            io.StringIO("\n".join(lines[start:])),
            sep=separator,
            header=0 if mass is None else None,
            names=None if mass is None else range(columns),
            skiprows=0 if mass is None else 1,
            decimal="," if comma else ".",
            skipinitialspace=True,
            low_memory=False,
        )
    except (ValueError, pd.errors.ParserError) as error:
        if len(lines) == start + 1:
            raise TrackError(f"{path}: holds no positions; check the file") from error
        raise TrackError(f"{path}: is not a table: {str(error).strip()}") from error
    if mass is None:
        return table.rename(columns=str.strip)
    masses = [mass] if mass else [cell.strip() for cell in lines[start - 1].split(separator)]
    return _tracker_heights(path, table, header.split(separator), masses)


def _tracker_header(lines: list[str]) -> tuple[str | None, int]:
    """Return the name of the mass, and the index of the line with the header.

    The name is empty if several masses are side by side, and None if Tracker did not write the
    lines.
    """
    for mass, start in (("", 2), (lines[0].strip(), 1)):
        if len(lines) > start and re.match(r"t\s*(\(.*?\))?\s*[\t;,]", lines[start].strip()):
            return mass, start
    return None, 0


def _tracker_heights(
    path: Path, table: pd.DataFrame, header: list[str], masses: list[str]
) -> pd.DataFrame:
    """Put the heights of all masses below each other.

    A name in `masses` stands above the first column of its mass, and empty cells above the others.
    """
    import pandas as pd

    owners: list[str] = []
    for k in range(len(header)):
        name = masses[k] if k < len(masses) else ""
        owners.append(name or (owners[-1] if owners else ""))
    parts: list[Any] = []
    for k, cell in enumerate(header):
        column = re.fullmatch(r"y(?:_\{?\w+\}?)?\s*(?:\((.*)\))?", cell.strip())
        if column is None or k >= table.shape[1]:
            continue
        unit = column[1] or "m"
        if unit not in _METRES:
            raise TrackError(
                f"{path}: heights are in {unit!r}; known units: {', '.join(_METRES)}; export them "
                f"in m, or without a unit and give the scale"
            )
        part = pd.DataFrame({"time": table[0], "particle": owners[k], "height": table[k]})
        part["height"] = _METRES[unit] * _numbers(part, "height", str(path))
        parts.append(part[part["time"].notna()])
    if not parts:
        raise TrackError(f"{path}: an export of Tracker without a column y; add y to its table")
    joined: pd.DataFrame = pd.concat(parts, ignore_index=True)
    return joined
