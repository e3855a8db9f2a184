"""Which columns of a table belong together: times, heights, and where they lie side by side."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Final

from vibrosweep.errors import TrackError
from vibrosweep.lab.recording import Reading
from vibrosweep.scene.cells import MISSING, Cells
from vibrosweep.scene.headings import PIXELS, Heading, length_factor

FORMATS: Final = (
    "give a column of times and one of heights, such as time and height, or t and y; frames with "
    "x and y; or times of impacts"
)


@dataclass(frozen=True)
class Columns:
    """Columns of one recording of a table, by their places."""

    time: int
    height: int | None
    horizontal: int | None
    label: str


def chosen_headings(table: Cells, how: Reading) -> list[Heading]:
    """Return the headings of a table; with a chosen column no other holds heights or times."""
    headings = list(table.headings)
    if len(headings) == 1 and not headings[0].role and table.wordless(0):
        headings[0] = replace(headings[0], role="time")
    if how.column is None:
        return headings
    wanted = [k for k, h in enumerate(headings) if h.means(how.column)]
    if not wanted:
        return [replace(h, role="") for h in headings]
    impacts = any(headings[k].role == "time" for k in wanted)
    drop = ("height", "depth", "time") if impacts else ("height", "depth")
    roles = [("" if h.role in drop else h.role) for h in headings]
    for k in wanted:
        roles[k] = "time" if impacts else "height"
    return [replace(h, role=role) for h, role in zip(headings, roles, strict=True)]


def series_of_columns(table: Cells, headings: list[Heading]) -> list[Columns]:
    """Find the columns of each recording."""
    places = {
        role: [k for k, h in enumerate(headings) if h.role == role and _holds(table, k)]
        for role in ("time", "frame", "height", "depth", "horizontal")
    }
    times = places["time"] or places["frame"]
    heights = places["height"] or places["depth"] or _lengths(table, headings)
    if not heights:
        # a trace of the base, or a track without its heights
        other = any(h.role in ("acceleration", "horizontal", "frame") for h in headings)
        times = [] if other else places["time"]
        if len(times) > 1 and not _alike([headings[k] for k in times]):
            raise _ambiguous(table, [headings[k] for k in times], "times of impacts")
        return [
            Columns(k, None, None, headings[k].label or (str(n) if len(times) > 1 else ""))
            for n, k in enumerate(times, start=1)
        ]
    if not times:
        raise TrackError(f"{table.source}: has the columns {table.names}; {FORMATS}")
    if len(heights) > 1 and not _alike([headings[k] for k in heights]):
        raise _ambiguous(table, [headings[k] for k in heights], "heights")
    series = []
    for n, k in enumerate(heights, start=1):
        low = heights[n - 2] if n > 1 else -1
        high = heights[n] if n < len(heights) else len(headings)
        beside = [j for j in places["horizontal"] if low < j < high]
        beside.sort(key=lambda j: abs(j - k))
        series.append(
            Columns(
                max((j for j in times if j < k), default=times[0]),
                k,
                beside[0] if beside else None,
                headings[k].label or (str(n) if len(heights) > 1 else ""),
            )
        )
    return series


def _holds(table: Cells, k: int) -> bool:
    return any(cell.lower() not in MISSING for cell in table.column(k))


def _lengths(table: Cells, headings: list[Heading]) -> list[int]:
    """Return the columns in a unit of length whose names say nothing."""
    return [
        k
        for k, h in enumerate(headings)
        if not h.role and h.unit and (length_factor(h.unit) or h.unit in PIXELS)
    ]


def _alike(headings: list[Heading]) -> bool:
    """Tell whether columns differ at most in their labels or in a number: drops side by side."""
    names = {re.sub(r"[\W\d_]+", " ", h.text.lower()).strip() for h in headings}
    labels = {h.label for h in headings}
    return len(names) == 1 or (len(labels) == len(headings) and "" not in labels)


def _ambiguous(table: Cells, headings: list[Heading], what: str) -> TrackError:
    names = ", ".join(f'"{h.text}"' for h in headings)
    return TrackError(
        f"{table.source}: several columns may hold {what}: {names}; choose one by its name "
        f"(column=, --column)"
    )
