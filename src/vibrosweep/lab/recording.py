"""A track as its file holds it, and how files are read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array, Flags
from vibrosweep.errors import TrackError, require_one_of
from vibrosweep.lab.tracks import FRAME_RATES
from vibrosweep.scene.headings import PIXELS, Heading, length_factor

AXES: Final = ("up", "down")
SENTINELS: Final = (0.0, -1.0)  # what programs write for a position that was lost


@dataclass(frozen=True, slots=True)
class Recording:
    """One drop or one film of one ball: a track, or times of impacts.

    Examples
    --------
    >>> import numpy as np
    >>> import vibrosweep as vs
    >>> times = np.array([0.0, 0.80, 1.52, 2.168])  # s, of four impacts
    >>> heard = vs.lab.Recording("drop 1", "", times, None, None, True, True, 0.0, None)
    >>> print(heard.height is None)
    True
    """

    name: str  # the file, and what tells it from others of that file
    group: str  # what is pooled together; empty if the file names none
    time: NDArray[np.float64]  # s on the clock of the file, or frames if the rate is not known
    # Upwards, in m, or in units of the file if the scale is not known; None if `time` is impacts
    height: NDArray[np.float64] | None
    horizontal: NDArray[np.float64] | None  # the second coordinate of a track if there is one
    scale_known: bool
    rate_known: bool
    rounding: float  # s, step to which times are rounded; 0 if none is seen
    peaks: NDArray[np.float64] | None  # loudness of each click, from a sound
    label: str = ""  # name of the particle or of the recording inside its file
    pixels: bool = False  # heights are rows of an image
    remarks: tuple[str, ...] = ()  # what was taken for lost, or left out


@dataclass(frozen=True)
class Reading:
    """How files are read; as the arguments of `read_recordings`."""

    scale: float | None = None
    frame_rate: float | None = None
    axis: str | None = None
    column: str | None = None
    particle: str | None = None
    sheet: str | None = None
    base: float | None = None  # the zero of heights, in units of the file

    def __post_init__(self) -> None:
        lowest, highest = FRAME_RATES
        if self.frame_rate is not None and not lowest <= self.frame_rate <= highest:
            raise TrackError(
                f"frame_rate = {self.frame_rate:g}: must be {lowest:g} to {highest:g} Hz"
            )
        if self.scale is not None and not 0.0 < self.scale < np.inf:
            raise TrackError(f"scale = {self.scale:g}: must be a finite number above 0")
        if self.base is not None and not np.isfinite(self.base):
            raise TrackError(f"base = {self.base:g}: must be a finite number")
        require_one_of("axis", self.axis or "up", AXES, TrackError)


@dataclass(frozen=True)
class Track:
    """A track in units of its file."""

    time: Array
    height: Array
    horizontal: Array | None


def made(
    track: Track,
    head: Heading,
    how: Reading,
    image: bool,
    name: str,
    group: str,
    label: str,
    about: dict[str, Any],
) -> Recording:
    """Convert a track to m, upwards; `image` tells that rows of pixels are counted downwards."""
    pixels = head.unit.lower() in PIXELS
    factor = (1.0, 1.0) if pixels else length_factor(head.unit)
    if factor is None:
        raise TrackError(
            f"{name}: heights are in {head.unit!r}; known units: m, cm, mm, um, px; export them in "
            f"m, or without a unit and give the scale"
        )
    if how.scale is not None:
        factor = (how.scale, 1.0)
    stated = bool(head.unit) and not pixels
    known = how.scale is not None or stated or (head.text.lower() == "height" and not image)
    height, beside, remarks = track.height.copy(), track.horizontal, []
    for value in SENTINELS:
        lost = _lost(height, value)
        if lost.any():
            height[lost] = np.nan
            remarks.append(
                f"{name}: {lost.sum()} heights are {value:g}, far from those beside them: taken "
                f"for lost positions"
            )
    up = how.axis or ("down" if image else "up")
    sign = 1.0 if up == "up" else -1.0
    with np.errstate(over="ignore"):
        if beside is not None:
            beside = np.where(np.isnan(height), np.nan, beside) * factor[0] / factor[1]
        height = sign * (height - (how.base or 0.0)) * factor[0] / factor[1]
    if np.isinf(height).any() or (beside is not None and np.isinf(beside).any()):
        raise TrackError(f"{name}: positions are too large to be computed with; check the scale")
    return Recording(
        name,
        group,
        track.time,
        height,
        beside,
        peaks=None,
        label=label,
        pixels=image,
        remarks=tuple(remarks),
        **{**about, "scale_known": known},
    )


def _lost(height: Array, value: float) -> Flags:
    """Mark the positions that repeat a value from which the track jumps as from no other."""
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
