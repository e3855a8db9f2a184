"""Stability windows: the intervals of amplitude in which a condition holds, for each restitution.

A coarse scan over the amplitude finds between which of its points a condition begins or ceases to
hold; all these edges, of all restitutions, are then bisected together.  What hides between two
neighbouring points of the scan, a window narrower than its step, is not seen: the scan is the
resolution.  Locked orbits are the exception, for a scan also sees where they exist without being
stable.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from vibrosweep.analysis import evaluate
from vibrosweep.analysis.bisection import find_edges, windows_of_row
from vibrosweep.analysis.conditions import NAMES, Condition, Locked, named
from vibrosweep.analysis.scene import Scene, axis, grid_axes, thread_count
from vibrosweep.errors import ParameterError, SpecError
from vibrosweep.scene import PARAMETERS
from vibrosweep.sweep.result import coordinate_attributes
from vibrosweep.sweep.workers import Workers

if TYPE_CHECKING:
    from vibrosweep.analysis.bisection import Codes
    from vibrosweep.sweep.spec import SweepSpec

__all__ = ["DIRECTIONS", "TOLERANCE", "find_windows", "summary", "windows_of_spec"]

Array = NDArray[np.float64]

TOLERANCE: Final = 1e-9
FRESH: Final = ("launch",)
DIRECTIONS: Final = ("up", "down")
FINEST: Final = 1e-14


def find_windows(
    scene: Scene,
    restitution: ArrayLike,
    amplitude: ArrayLike,
    conditions: Sequence[str | Condition | Locked],
    *,
    continuation: bool = False,
    tolerance: float = TOLERANCE,
    threads: int | None = None,
) -> xr.Dataset:
    """Intervals of amplitude in which conditions hold, for every restitution.

    Parameters
    ----------
    scene
        All other parameters, launches and the observation.
    restitution
        Values, shape (restitution,).
    amplitude
        Points of the coarse scan in m s-1, ascending, at least two.
    conditions
        Names as in `conditions.NAMES`, or conditions of one's own.
    continuation
        Whether orbits go on along the amplitude from the last one, upwards and downwards, instead
        of being launched anew at every point: coexisting and hysteretic windows then show as
        differences between the directions.
    tolerance
        Width of a bracket around an edge, relative to the edge.
    threads
        Number of threads, by default all processors; the result does not depend on it.

    Returns
    -------
    xarray.Dataset
        Dims (condition, direction, restitution, window): ``A_min`` and ``A_max`` (m s-1), the
        middles of brackets of width ``A_min_bracket`` and ``A_max_bracket`` (NaN where a window
        reaches the end of the scan, which is then no edge), all NaN past the last window; dims
        (condition, direction, restitution): ``window_count`` and ``widest``, the index of the
        widest window, -1 without any.

    Raises
    ------
    ParameterError
        A value is outside its range, or a condition cannot be continued.
    """
    e, a = axis("restitution", restitution), axis("amplitude", amplitude)
    if a.size < 2 or not np.all(np.diff(a) > 0.0):
        raise ParameterError("amplitude: must be at least two values in ascending order")
    if not FINEST <= tolerance < 1.0:
        raise ParameterError(f"tolerance = {tolerance!r}: must be at least {FINEST} and below 1")
    if not conditions:
        raise ParameterError("conditions: must name at least one condition")
    chosen = [named(c) if isinstance(c, str) else c for c in conditions]
    directions = DIRECTIONS if continuation else FRESH
    with Workers(thread_count(threads)) as workers:
        found = [
            _windows(scene, condition, e, a, direction, tolerance, workers)
            for condition in chosen
            for direction in directions
        ]
    table = _table(found, (len(chosen), len(directions), e.size))
    return _dataset(scene, chosen, directions, e, a, tolerance, table)


def windows_of_spec(spec: SweepSpec, threads: int) -> xr.Dataset:
    """Windows of a sweep file with a [windows] section, as `find_windows`.

    Raises
    ------
    SpecError
        The file has no such section, a condition is not known, or the design is no grid over
        restitution and amplitude alone.
    """
    if spec.windows is None:
        raise SpecError(
            f"{spec.source}: [windows] is missing; add it with conditions = [...], each one of "
            f"{', '.join(NAMES)}"
        )
    try:
        conditions = [named(name) for name in spec.windows.conditions]
    except ParameterError as error:
        raise SpecError(f"{spec.source}: windows.conditions: {error}") from error
    axes = grid_axes(spec, "windows", "amplitude", ("restitution",))
    return find_windows(
        Scene.of(spec),
        axes.get("restitution", spec.fixed.get("restitution", ())),
        axes["amplitude"],
        conditions,
        continuation=spec.windows.continuation,
        tolerance=spec.windows.tolerance,
        threads=threads,
    ).assign_attrs(title=spec.title, sweep_file=spec.text)


def summary(windows: xr.Dataset) -> Iterator[str]:
    """Say in a line for each condition and direction how many restitutions have a window."""
    for condition in windows["condition"].values:
        for direction in windows["direction"].values:
            count = windows["window_count"].sel(condition=condition, direction=direction).values
            name = condition if direction in FRESH else f"{condition} {direction}"
            yield (
                f"{name:24}holds at {np.count_nonzero(count)} of {count.size} restitutions, in up "
                f"to {count.max()} windows"
            )


Row = list[tuple[float, float, float, float]]


def _windows(
    scene: Scene,
    condition: Condition | Locked,
    e: Array,
    a: Array,
    direction: str,
    tolerance: float,
    workers: Workers,
) -> list[Row]:
    """Windows of one condition in one direction, a list for each restitution."""

    def judge(rows: Codes, at: Array, states: Array) -> tuple[Codes, Array]:
        if isinstance(condition, Locked):
            return evaluate.locked(scene, condition, e[rows], at, workers), states
        if direction in FRESH:
            return evaluate.launched(scene, condition, e[rows], at, workers), states
        return evaluate.continued(scene, condition, e[rows], at, states, workers)

    fresh = isinstance(condition, Locked) or direction in FRESH
    start = None if fresh else evaluate.launch_states(scene, e.size)
    upward = direction != DIRECTIONS[1]
    codes, edges = find_edges(judge, e.size, a, tolerance, start=start, upward=upward)
    return [windows_of_row(codes, a, edges, row, evaluate.HOLDS) for row in range(e.size)]


def _table(found: list[list[Row]], shape: tuple[int, int, int]) -> Array:
    """Ends and bracket widths, shape (4, *shape, window), NaN past the last window."""
    rows = [row for rows in found for row in rows]
    most = max(1, max(len(row) for row in rows))
    table = np.full((4, len(rows), most), np.nan)
    for i, row in enumerate(rows):
        if row:
            table[:, i, : len(row)] = np.array(row).T
    return table.reshape(4, *shape, most)


def _dataset(
    scene: Scene,
    conditions: list[Condition | Locked],
    directions: Sequence[str],
    e: Array,
    a: Array,
    tolerance: float,
    table: Array,
) -> xr.Dataset:
    dims = ("condition", "direction", "restitution", "window")
    lower, upper, lower_bracket, upper_bracket = table
    width = upper - lower
    count = np.count_nonzero(np.isfinite(width), axis=-1)
    widest = np.where(count > 0, np.argmax(np.nan_to_num(width, nan=-1.0), axis=-1), -1)
    open_end = "NaN where the window reaches the end of the scan, which is then no edge of it"
    data: dict[str, Any] = {
        "A_min": (dims, lower, _attributes("lower end of the window")),
        "A_max": (dims, upper, _attributes("upper end of the window")),
        "A_min_bracket": (dims, lower_bracket, _attributes("width of the lower bracket", open_end)),
        "A_max_bracket": (dims, upper_bracket, _attributes("width of the upper bracket", open_end)),
        "window_count": (dims[:-1], count, {"units": "1", "long_name": "number of windows"}),
        "widest": (
            dims[:-1],
            widest,
            {"units": "1", "long_name": "index of the widest window", "comment": "-1 without any"},
        ),
    }
    scan = {
        **coordinate_attributes(PARAMETERS["amplitude"]),
        "comment": "points of the coarse scan",
    }
    coordinates = {
        "condition": [condition.name for condition in conditions],
        "direction": list(directions),
        "restitution": (("restitution",), e, coordinate_attributes(PARAMETERS["restitution"])),
        "scan": (("scan",), a, scan),
        **scene.coordinates(("restitution", "amplitude")),
    }
    meanings = "; ".join(f"{c.name}: {c.sentence}" for c in conditions if c.sentence)
    attributes = scene.attributes("Intervals of amplitude in which conditions hold")
    return xr.Dataset(
        data, coordinates, {**attributes, "tolerance": tolerance, "meaning": meanings}
    )


def _attributes(long_name: str, comment: str = "") -> dict[str, str]:
    return {"units": "m s-1", "long_name": long_name} | ({"comment": comment} if comment else {})
