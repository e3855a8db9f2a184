"""Tracks as a checked dataset: height against time for each particle."""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from vibrosweep.arrays import Array
from vibrosweep.errors import TrackError
from vibrosweep.scene.clocks import even_times

__all__ = ["FRAME_RATES", "check_size", "make_tracks", "rate_of", "table_to_tracks"]

# Values per second that a measurement may have, and limit of its times (s), heights (m) and
# accelerations (m s-2): powers of far larger numbers overflow.
FRAME_RATES: Final = (1e-3, 1e9)
MOST: Final = 1e12


def make_tracks(
    time: ArrayLike, height: ArrayLike, particle: ArrayLike | None = None, source: str = "tracks"
) -> xr.Dataset:
    """Make tracks from heights with a row for each frame.

    Parameters
    ----------
    time
        Middle of the exposure of each frame in s, shape (frame,), rising.
    height
        Heights in m, upwards, shape (frame, particle); NaN where a particle is not seen.
    particle
        Names or numbers of the particles; 0, 1, ... by default.
    source
        Name of the tracks in messages.

    Returns
    -------
    xarray.Dataset
        Dims (frame, particle): ``height``; coordinates ``time`` and ``particle``; attributes
        ``frame_rate`` (Hz) and ``source``.

    Raises
    ------
    TrackError
        A particle is never seen, times do not rise, shapes differ, or a number is larger than any
        camera measures.

    Examples
    --------
    >>> import numpy as np
    >>> from vibrosweep.lab import make_tracks
    >>> time = np.arange(60) / 100.0
    >>> height = 0.05 - 4.9 * (time % 0.2 - 0.1) ** 2
    >>> make_tracks(time, height[:, np.newaxis]).height.shape
    (60, 1)
    """
    times = np.asarray(time, dtype=np.float64)
    heights = np.asarray(height, dtype=np.float64)
    if not times.size or not heights.size or not np.isfinite(heights).any():
        raise TrackError(f"{source}: holds no positions; check the file and its columns")
    if heights.ndim != 2 or len(heights) != times.size:
        raise TrackError(
            f"{source}: heights are of shape {heights.shape}: must be (frame, particle), with "
            f"{times.size} frames, the number of times"
        )
    if times.size < 2:
        raise TrackError(
            f"{source}: holds one frame only; a flight needs at least five, so film for longer or "
            f"check the column of times"
        )
    if np.isinf(heights).any():
        raise TrackError(f"{source}: a height is infinite; leave lost positions empty")
    if not (np.isfinite(times).all() and (np.diff(times) > 0.0).all()):
        raise TrackError(f"{source}: the times do not rise from frame to frame; sort the frames")
    frame_rate = rate_of(times, source)
    check_size("height", heights, source)
    names = np.arange(heights.shape[1]) if particle is None else np.asarray(particle)
    if names.shape != heights.shape[1:] or np.unique(names).size < names.size:
        raise TrackError(f"{source}: give each of {heights.shape[1]} particles a name of its own")
    never = np.flatnonzero(~np.isfinite(heights).any(axis=0))
    if never.size:
        raise TrackError(
            f"{source}: particle {names[never[0]]} has no position that is a number{_more(never)}; "
            f"leave it out or track it again"
        )
    return xr.Dataset(
        {"height": (("frame", "particle"), heights, {"units": "m", "long_name": "height"})},
        coords={
            "time": ("frame", times, {"units": "s", "long_name": "time"}),
            "particle": ("particle", names, {"long_name": "particle"}),
        },
        attrs={"frame_rate": frame_rate, "source": source},
    )


def table_to_tracks(
    time: ArrayLike, particle: ArrayLike, height: ArrayLike, source: str = "tracks"
) -> xr.Dataset:
    """Make tracks from a table with a row for each position.

    `particle` holds names or numbers.  The times (s) of each particle rise; heights (m, upwards)
    are NaN where it is not seen.  `source` names the tracks in messages.  Raises a TrackError if
    times are missing, decrease or appear twice, or if a particle is never seen.
    """
    times = np.asarray(time, dtype=np.float64)
    heights = np.asarray(height, dtype=np.float64)
    owner = np.asarray(particle)
    if not times.size:
        raise TrackError(f"{source}: holds no positions; check the file and its columns")
    bad = np.flatnonzero(~np.isfinite(times))
    if bad.size:
        raise TrackError(
            f"{source}: row {bad[0] + 1} has no time{_more(bad)}; give the time of every position"
        )
    names, index = np.unique(owner, return_inverse=True)
    order = np.argsort(index, kind="stable")
    steps, same = np.diff(times[order]), np.diff(index[order]) == 0
    wrong = np.flatnonzero(same & (steps <= 0.0))
    if wrong.size:
        before, after = order[wrong[0]], order[wrong[0] + 1]
        who = f"{source}: particle {names[index[before]]}"
        if times[before] == times[after]:
            raise TrackError(
                f"{who} has two positions at {times[before]:.6g} s{_more(wrong)}; keep one "
                f"position a frame, or give particles different names"
            )
        raise TrackError(
            f"{who} goes back in time, from {times[before]:.6g} s to {times[after]:.6g} s"
            f"{_more(wrong)}; sort the rows by time, or give particles different names"
        )
    axis, frame = np.unique(times, return_inverse=True)
    grid = np.full((axis.size, names.size), np.nan)
    grid[frame, index] = heights
    return make_tracks(axis, grid, names, source)


def with_mark(tracks: xr.Dataset, name: str) -> xr.Dataset:
    """Turn the particle of this name, a mark on the base, into the variable ``base_height`` (m).

    Raises a TrackError if there is no such particle, or no other.
    """
    marks = tracks["particle"].values.astype(str) == name
    source, names = tracks.attrs["source"], ", ".join(map(str, tracks["particle"].values))
    if not marks.any():
        raise TrackError(
            f"{source}: no particle is named {name}, the mark on the base; has {names}"
        )
    if marks.all():
        raise TrackError(f"{source}: nothing is tracked but {name}, the mark on the base")
    words = {"units": "m", "long_name": "height of a mark on the base"}
    height = tracks["height"].values[:, marks.argmax()]
    return tracks.isel(particle=~marks).assign(base_height=("frame", height, words))


def rate_of(times: Array, source: str) -> float:
    """Return the values per second at rising times (s); raise a TrackError for impossible rates."""
    check_size("time", times, source)
    (_, rate), (low, high) = even_times(times, 0.0), FRAME_RATES
    if not low <= rate <= high:
        raise TrackError(
            f"{source}: holds {rate:.3g} frames per second: must be {low:g} to {high:g}; check the "
            f"times, which are in s"
        )
    return rate


def check_size(name: str, values: Array, source: str) -> None:
    """Raise a TrackError for a value that is too large for the computations."""
    largest = float(np.nanmax(np.abs(values)))
    if largest > MOST:
        raise TrackError(
            f"{source}: {name} {largest:.3g}: must be at most {MOST:g} in size; check its unit, "
            f"the scale and the base"
        )


def _more(places: NDArray[np.intp]) -> str:
    return f" ({places.size} such cases in all)" if places.size > 1 else ""
