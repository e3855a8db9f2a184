"""Codes of stability windows, and their summary."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np

from vibrosweep.analysis.bisection import Window
from vibrosweep.analysis.conditions import FAILS, HOLDS, UNDETERMINED
from vibrosweep.model.forcing import FORCINGS
from vibrosweep.model.measures import Variable

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["ENDS", "NO_WINDOW", "OPEN_END", "PROVED", "UNDETERMINED_ABOVE", "UNDETERMINED_BELOW"]

FRESH: Final = ("launch",)  # the only direction without continuation
NO_WINDOW: Final = -1
PROVED, OPEN_END = 1, 2  # codes of a proof
OPEN_BELOW, OPEN_ABOVE = 1, 2
UNDETERMINED_BELOW, UNDETERMINED_ABOVE = 4, 8
ENDS: Final = Variable(
    "window_ends",
    ("condition", "direction", "restitution", "window"),
    "int8",
    "1",
    "ends of the window that are not edges of the condition",
    flags=(
        (NO_WINDOW, "no_window"),
        (0, "closed"),
        (OPEN_BELOW, "open_below"),
        (OPEN_ABOVE, "open_above"),
        (OPEN_BELOW + OPEN_ABOVE, "open_both"),
        (UNDETERMINED_BELOW, "undetermined_below"),
        (UNDETERMINED_BELOW + OPEN_ABOVE, "undetermined_below_open_above"),
        (UNDETERMINED_ABOVE, "undetermined_above"),
        (OPEN_BELOW + UNDETERMINED_ABOVE, "open_below_undetermined_above"),
        (UNDETERMINED_BELOW + UNDETERMINED_ABOVE, "undetermined_both"),
    ),
    comment="open: the window reaches the end of the scan; undetermined: beyond this end, up "
    "to the next code, it is not known whether the condition holds",
)
HELD: Final = Variable(
    "holds",
    ("condition", "direction", "restitution", "scan"),
    "int8",
    "1",
    "whether the condition holds at a point of the scan",
    flags=((UNDETERMINED, "undetermined"), (FAILS, "fails"), (HOLDS, "holds")),
)


def code_of_ends(window: Window) -> int:
    """Code of a window in `ENDS`."""
    below = {None: OPEN_BELOW, UNDETERMINED: UNDETERMINED_BELOW}
    above = {None: OPEN_ABOVE, UNDETERMINED: UNDETERMINED_ABOVE}
    return below.get(window.below, 0) + above.get(window.above, 0)


def summary(windows: xr.Dataset) -> Iterator[str]:
    """Describe the windows in a line for each condition and direction."""
    if "grid" in windows.attrs:
        yield f"{'scan':24}{windows.attrs['grid']}"
    first, last = windows["scan"].values[[0, -1]]
    units = FORCINGS[windows.attrs["forcing"]].units
    unit = "" if units == "1" else f" {units}"
    for condition in windows["condition"].values:
        for direction in windows["direction"].values:
            one = windows.sel(condition=condition, direction=direction)
            count, ends = one["window_count"].values, one[ENDS.name].values
            name = condition if direction in FRESH else f"{condition} {direction}"
            unknown = "".join(_undetermined(one))
            if not count.any():
                yield f"{name:24}no window was found from {first:g} to {last:g}{unit}{unknown}"
                continue
            number = np.count_nonzero((ends > 0) & (ends & (OPEN_BELOW | OPEN_ABOVE) > 0))
            reach = f"; {number} of {count.sum()} reach the end of the scan" if number else ""
            yield (
                f"{name:24}holds at {np.count_nonzero(count)} of {count.size} restitutions, in up "
                f"to {count.max()} windows{reach}{unknown}"
            )


def proof_lines(found: xr.Dataset) -> Iterator[str]:
    """Describe the share of proved windows, in a line for each condition."""
    for condition in found["condition"].values:
        one = found.sel(condition=condition)
        ends = np.stack([one["min_proof"].values, one["max_proof"].values])
        inside = one["inside_proof"].values
        yield (
            f"{condition:24}proved: {np.count_nonzero(ends == PROVED)} of "
            f"{np.count_nonzero((ends != NO_WINDOW) & (ends != OPEN_END))} ends, attraction inside "
            f"{np.count_nonzero(inside == PROVED)} of {np.count_nonzero(inside != NO_WINDOW)}"
        )


def _undetermined(one: xr.Dataset) -> Iterator[str]:
    """Describe where one condition in one direction is undetermined."""
    bits, ends = UNDETERMINED_BELOW | UNDETERMINED_ABOVE, one[ENDS.name].values
    if number := np.count_nonzero((ends > 0) & (ends & bits > 0)):
        yield f"; {number} of {one['window_count'].values.sum()} end where it is undetermined"
    held = one[HELD.name].values if HELD.name in one else np.zeros(0)
    if number := np.count_nonzero(held == UNDETERMINED):
        yield f"; undetermined at {number} of {held.size} points of the scan"
