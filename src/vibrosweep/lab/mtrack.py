"""Tracks of MTrack2, a plugin of ImageJ."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, Final

import numpy as np

from vibrosweep.errors import TrackError
from vibrosweep.lab.recording import Reading, Recording, Track, made
from vibrosweep.scene.cells import decoded
from vibrosweep.scene.headings import Heading

REACH: Final = 30.0  # pixels in a frame up to which positions are joined
MEMORY: Final = 10.0  # frames without a position that end a track
STILL: Final = 0.25  # movement of a mark or a hand, relative to that of the ball


def mtrack_recordings(content: bytes, source: str, how: Reading) -> list[Recording]:
    """Read an export of MTrack2 of ImageJ; empty if the file is none.

    Separators of empty cells may be lost: positions are then joined to the nearest ones before.
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
                if len(bare) % 2:  # a cell was lost, and with it which numbers are pairs
                    remarks.append(f"{source}: line {number} has no whole pairs: left out")
                    continue
                pairs = _joined(tracks, frame, list(zip(bare[::2], bare[1::2], strict=True)))
            for k, pair in pairs.items():
                tracks[k][frame] = pair
        except (ValueError, IndexError) as error:
            raise TrackError(
                f"{source}: line {number}: {line.strip()!r} does not hold a frame and pairs of "
                f"positions"
            ) from error
    return _balls(tracks, source, how, remarks)


def _joined(
    tracks: list[dict[float, tuple[float, float]]],
    frame: float,
    pairs: list[tuple[float, float]],
) -> dict[int, tuple[float, float]]:
    """Give positions to the tracks whose last position is nearest, and others to new tracks."""
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


def _balls(
    tracks: list[dict[float, tuple[float, float]]], source: str, how: Reading, remarks: list[str]
) -> list[Recording]:
    """Make recordings of the tracks that move; the others are marks."""
    arrays = [
        Track(
            np.array(sorted(t)) / (how.frame_rate or 1.0),
            np.array([t[f][1] for f in sorted(t)]),
            np.array([t[f][0] for f in sorted(t)]),
        )
        for t in tracks
    ]
    moves = [float(np.ptp(a.height)) if a.height.size else 0.0 for a in arrays]
    balls = [k for k, move in enumerate(moves) if move > STILL * max(moves, default=0.0)]
    if how.particle is not None:
        balls = [k for k, move in enumerate(moves) if move]
    about: dict[str, Any] = {
        "scale_known": False,
        "rate_known": how.frame_rate is not None,
        "rounding": 0.0,
    }
    head = Heading("Y", "height", "px", "")
    several = len(balls) > 1 or how.particle is not None
    found = [
        made(
            arrays[k],
            head,
            how,
            True,
            f"{source}, track {k + 1}" if several else source,
            "",
            str(k + 1),
            about,
        )
        for k in balls
        if arrays[k].time.size > 1
    ]
    if not found:
        raise TrackError(f"{source}: holds no track that moves; check the file")
    still = len([t for t in tracks if t]) - len(balls)
    if still:
        remarks.append(f"{source}: {still} tracks stay where they are: taken for marks")
    return [replace(r, remarks=(*r.remarks, *remarks)) for r in found]
