"""Tracks as a checked dataset: height against time for each particle, and their defects."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from vibrosweep.arrays import Array
from vibrosweep.errors import TrackError
from vibrosweep.lab.flights import GAP_FRAMES
from vibrosweep.scene.tables import even_times

__all__ = ["FRAME_RATES", "check_size", "make_tracks", "rate_of"]

# -----------------------------------------------------------------------------
# Tracks as a checked dataset: height against time for each particle.

# Range of sampling rates (Hz), and limit of times (s), heights (m) and accelerations (m s-2):
# powers of far larger numbers overflow.
FRAME_RATES: Final = (1e-3, 1e9)
MOST: Final = 1e12


def make_tracks(
    time: ArrayLike, height: ArrayLike, particle: ArrayLike | None = None, source: str = "tracks"
) -> xr.Dataset:
    """Make tracks from an array of heights with one row per frame.

    Parameters
    ----------
    time
        Middle of the exposure of each frame in s, shape (frame,), increasing.
    height
        Heights in m, upwards, shape (frame, particle); NaN where a particle is not visible.
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
        A particle is never visible, times do not increase, shapes do not match, or a number is
        unreasonably large.

    Examples
    --------
    >>> import numpy as np
    >>> from vibrosweep.lab import make_tracks
    >>> time = np.arange(60) / 100.0
    >>> height = 0.05 - 4.9 * (time % 0.2 - 0.1) ** 2
    >>> make_tracks(time, height[:, np.newaxis]).height.shape
    (60, 1)
    """
    try:
        times, heights = (np.asarray(values, dtype=np.float64) for values in (time, height))
    except (TypeError, ValueError):
        raise TrackError(f"{source}: times and heights must be numbers") from None
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
        raise TrackError(f"{source}: give each of {heights.shape[1]} particles a unique name")
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


def with_mark(tracks: xr.Dataset, name: str) -> xr.Dataset:
    """Convert the particle `name`, a mark on the base, into the variable ``base_height`` (m).

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
    """Return the sampling rate (Hz) of increasing times (s); raise a TrackError if out of range."""
    check_size("time", times, source)
    (_, rate), (low, high) = even_times(times, 0.0), FRAME_RATES
    if not low <= rate <= high:
        raise TrackError(
            f"{source}: holds {rate:.3g} frames per second: must be {low:g} to {high:g}; check the "
            f"times, which are in s"
        )
    return rate


def check_size(name: str, values: Array, source: str) -> None:
    """Raise a TrackError for a value too large for the computation."""
    largest = float(np.nanmax(np.abs(values)))
    if largest > MOST:
        raise TrackError(
            f"{source}: {name} {largest:.3g}: must be at most {MOST:g} in size; check its unit, "
            f"the scale and the base"
        )


def _more(places: NDArray[np.intp]) -> str:
    return f" ({places.size} such cases in all)" if places.size > 1 else ""


# -----------------------------------------------------------------------------
# Defects of tracks, particle by particle: lost frames, gaps, exchanged names.

# Deviations from the continuation of a flight, in units of the noise: above the first the flight
# ends, below the second it continues.
BROKEN: Final = 6.0
CONTINUES: Final = 3.0


def coverage(tracks: xr.Dataset) -> dict[str, tuple[Any, str, str]]:
    """Count visible frames, lost frames and gaps of each particle: columns for `with_units`."""
    height, time = tracks["height"].values, tracks["time"].values
    interval = 1.0 / tracks.attrs["frame_rate"]
    present = np.isfinite(height)
    count = present.sum(axis=0)
    first, last = present.argmax(axis=0), len(present) - 1 - present[::-1].argmax(axis=0)
    lost = np.rint((time[last] - time[first]) / interval).astype(np.int64) + 1 - count
    gaps = [
        int((np.diff(time[present[:, p]]) > GAP_FRAMES * interval).sum()) for p in range(len(count))
    ]
    return {
        "frames_seen": (count, "1", "frames in which the particle was seen"),
        "frames_lost": (lost, "1", "frames lost between its first and last"),
        "gaps": (np.array(gaps), "1", "gaps too long to bridge"),
        "first_seen": (time[first], "s", "time of the first frame with the particle"),
        "last_seen": (time[last], "s", "time of the last frame with the particle"),
    }


def find_swaps(
    time: Array, height: Array, noise: float, base: float, gravity: float
) -> list[tuple[int, int, int]]:
    """Find the frames at which two particles exchange their names.

    Returns each frame with the indices of both particles.  In such a frame neither particle
    continues its own flight, each continues that of the other, and neither is near the base.  An
    exchange at nearly the same height and speed cannot be detected; it leaves a poorly fitted
    flight.  Times have the shape (frame,), heights (frame, particle); `noise` is the standard
    deviation of a position, m.
    """
    before, after = np.diff(time)[:-1, np.newaxis], np.diff(time)[1:, np.newaxis]
    expected = height[1:-1] + (height[1:-1] - height[:-2]) * after / before
    expected -= 0.5 * gravity * after * (before + after)
    spread = noise * np.sqrt(1.0 + (1.0 + after / before) ** 2 + (after / before) ** 2)
    broken = np.abs(height[2:] - expected) > BROKEN * spread
    flying = expected > base - CONTINUES * noise
    suspects = broken & flying
    found = []
    for i in np.flatnonzero(suspects.sum(axis=1) > 1):
        who = np.flatnonzero(suspects[i])
        fits = np.abs(height[i + 2, who] - expected[i, who, np.newaxis]) < CONTINUES * spread[i]
        for a, b in zip(*np.nonzero(np.triu(fits & fits.T, 1)), strict=True):
            found.append((int(i + 2), int(who[a]), int(who[b])))
    return found


def remarks(impacts: xr.Dataset) -> list[str]:
    """Report the error of the scale and the defects of each particle's track, one per line."""
    interval = 1.0 / impacts.attrs["frame_rate"]
    begin, end = impacts.attrs["begin"], impacts.attrs["end"]
    lines = []
    if impacts.attrs["scale_off"]:
        shown, true = impacts.attrs["apparent_gravity"], impacts.attrs["gravity"]
        lines.append(
            f"all flights fall with {shown:.4g} m s-2 instead of {true:g} m s-2: the scale of the "
            f"heights is off by {100.0 * (shown / true - 1.0):+.2g} %"
        )
    for p, name in enumerate(impacts["particle"].values):
        names = ("frames_lost", "gaps", "swaps", "poor_flights", "first_seen", "last_seen")
        lost, gaps, swaps, poor, first, last = (impacts[n].values[p].item() for n in names)
        faults = {
            f"{lost} of its frames lost": lost > 0,
            f"{gaps} gaps too long for finding a landing": gaps > 0,
            f"comes into view at {first:.3f} s": first > begin + GAP_FRAMES * interval,
            f"leaves the view at {last:.3f} s": last < end - GAP_FRAMES * interval,
            f"exchanges its name with another particle {swaps} times": swaps > 0,
            f"{poor} flights fit badly": poor > 0,
        }
        parts = [text for text, present in faults.items() if present]
        if parts:
            lines.append(f"particle {name}: {'; '.join(parts)}")
    return lines
