"""Faults of tracks, particle by particle: lost frames, gaps, exchanged names."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import xarray as xr

from vibrosweep.arrays import Array
from vibrosweep.lab.segments import GAP_FRAMES

# Deviations from the continuation of a flight, in standard deviations of the noise: above the first
# number the flight is broken, below the second it continues.
BROKEN: Final = 6.0
CONTINUES: Final = 3.0


def coverage(tracks: xr.Dataset) -> dict[str, tuple[Any, str, str]]:
    """Count frames seen, frames lost and gaps of each particle: columns for `with_units`."""
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

    Returns each frame with the numbers of both particles.  In such a frame neither particle
    continues its own flight, each continues that of the other, and neither is near the base.  An
    exchange at nearly the same height and speed cannot be found; it leaves a flight that fits
    badly.  Times are of shape (frame,), heights of shape (frame, particle); `noise` is the standard
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
    """Describe the faults of the scale and of each particle's track, a line each."""
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
            f"{gaps} gaps across which no landing is sought": gaps > 0,
            f"comes into view at {first:.3f} s": first > begin + GAP_FRAMES * interval,
            f"leaves the view at {last:.3f} s": last < end - GAP_FRAMES * interval,
            f"exchanges its name with another particle {swaps} times": swaps > 0,
            f"{poor} flights fit badly": poor > 0,
        }
        parts = [text for text, present in faults.items() if present]
        if parts:
            lines.append(f"particle {name}: {'; '.join(parts)}")
    return lines
