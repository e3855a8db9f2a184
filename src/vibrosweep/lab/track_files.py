"""Tracks of one recording, from files or a table in memory, as a dataset."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from vibrosweep.arrays import Array
from vibrosweep.errors import TrackError
from vibrosweep.lab.recording import Reading, Recording
from vibrosweep.lab.recordings import read_file, recordings_of
from vibrosweep.lab.tracks import table_to_tracks, with_mark
from vibrosweep.scene.cells import Cells
from vibrosweep.scene.clocks import even_times, origin_of
from vibrosweep.scene.headings import heading

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["read_tracks", "tracks_from_frame"]


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
    column, particle, sheet
        As in `read_recordings`.

    Returns
    -------
    xarray.Dataset
        As `make_tracks` returns it.  Where the clock of the file counts from 1970 or from midnight,
        times are counted from the attribute ``origin`` (s).

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
    files = [Path(p) for p in ([paths] if isinstance(paths, str | os.PathLike) else paths)]
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
    """Put the tracks of one recording side by side."""
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
    owner = np.repeat(
        np.array(names, object if isinstance(names[0], str) else None), [h.size for h in heights]
    )
    time = np.concatenate([one.time for one in found])
    origin = origin_of(np.unique(time))
    if origin:  # so far from its zero a double rounds by 0.2 us
        stamps, index = np.unique(time, return_inverse=True)
        time = even_times(stamps - origin, 4.0 * float(np.spacing(abs(origin))))[0][index]
    tracks = table_to_tracks(time, owner, np.concatenate(heights), source)
    if origin:
        tracks.attrs["origin"] = origin
    if frame_rate is not None:
        tracks.attrs["frame_rate"] = frame_rate
    if remarks := dict.fromkeys(remark for one in found for remark in one.remarks):
        tracks.attrs["remarks"] = "\n".join(remarks)
    return tracks
