"""Stability windows: the intervals of the forcing in which a condition holds, for each restitution.

A coarse scan over the forcing finds the pairs of points between which a condition begins or ceases
to hold; all these edges, of all restitutions, are then bisected together.  A window narrower than
the step of the scan may hide between two of its points: the scan is the resolution.  Locked orbits
are the exception, since a scan also detects orbits that exist without being stable: every window of
a locked orbit that is wider than the tolerance is found.  Under a waveform other than the sine a
mode may have several windows, which may overlap: those of all branches are listed, from closed
forms.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import xarray as xr

from vibrosweep.analysis import evaluate
from vibrosweep.analysis.bisection import Window, find_edges, windows_of_row
from vibrosweep.analysis.common import (
    attributes,
    grid_axes,
    meaning,
    require_ability,
    require_memory,
    settling,
    shared,
)
from vibrosweep.analysis.conditions import FAILS, HOLDS, NAMED, NAMES, Condition, Locked, named
from vibrosweep.analysis.replicas import REPLICAS, Share, share_of
from vibrosweep.analysis.shaped_windows import rows_of_shape
from vibrosweep.analysis.window_codes import ENDS, FRESH, HELD, NO_WINDOW, code_of_ends
from vibrosweep.arrays import Array
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.arithmetic import HALF_ULP
from vibrosweep.kernels.fixed import END_ERROR
from vibrosweep.mistakes import Key, Mistake, table
from vibrosweep.model.forcing import AMPLITUDE, FORCINGS, forcing_of
from vibrosweep.model.parameters import NOISE, PARAMETERS
from vibrosweep.model.restitution_laws import CONSTANT
from vibrosweep.model.shapes import SINE
from vibrosweep.runs.result import coordinate_attributes, short_observation
from vibrosweep.scene.scene import Scene

if TYPE_CHECKING:
    from vibrosweep.analysis.bisection import Codes
    from vibrosweep.scene.sweep import Sweep

__all__ = ["DIRECTIONS", "TOLERANCE", "find_windows"]


TOLERANCE: Final = 1e-9
NOISY_TOLERANCE: Final = 1e-3  # under noise
DIRECTIONS: Final = ("up", "down")
RESTITUTIONS, POINTS = 25, 150  # of a scan over ranges
# Relative error of the amplitude that `model.forcing.completed` computes from another forcing: at
# most six roundings, including that of pi
FORCING_ERROR: Final = 6.0 * HALF_ULP
OF_ENDS: Final = (  # comment on the ends of windows
    "NaN where the window reaches the end of the scan, which is not an edge of the condition; "
    f"where {ENDS.name} says undetermined, the condition is known to hold only up to here"
)
BYTES_PER_POINT: Final = 200
BYTES_PER_STATE: Final = 16  # of a continued particle at a point


def find_windows(sweep: Sweep, threads: int) -> xr.Dataset:
    """Windows of a sweep, as `vibrosweep.windows`.

    With continuation, coexisting and hysteretic windows appear as differences between the
    directions.  A bracket around an edge is at most as wide as the tolerance, relative to the edge;
    that of a locked orbit contains the exact edge.  The ranges of a random design are scanned at
    `RESTITUTIONS` and `POINTS` values in even steps, as the attribute ``grid`` says.  Raises a
    SpecError if the sweep asks for no windows, if a condition is not known, or if parameters other
    than the restitution and a forcing vary.
    """
    require_ability("windows", sweep.scene, sweep.design.sampled)
    conditions = _conditions(sweep)
    forcing = forcing_of(sweep.design.sampled)
    points = {"restitution": RESTITUTIONS, forcing: POINTS}
    axes = grid_axes(sweep, "windows", forcing, ("restitution",), points)
    a = axes[forcing]
    e = axes.get("restitution", np.array([sweep.scene.inputs.get("restitution", np.nan)]))
    if a.size < 2:
        raise sweep.refusal(Mistake(f"sample.{forcing}", "must be two or more values", a.tolist()))
    defined = [c for c in conditions if isinstance(c, Condition) and c not in NAMED.values()]
    codes = "\n\n".join(condition.code for condition in defined)
    orbits = any(_of_orbits(c) for c in conditions)
    scene = settling(sweep, float(e.max())) if orbits else sweep.scene
    replicas, keys = _replicas(sweep, conditions), sweep.windows or {}
    tolerance = keys.get("tolerance", NOISY_TOLERANCE if replicas else TOLERANCE)
    continuation = keys.get("continuation", False)
    directions = DIRECTIONS if continuation else FRESH
    states = BYTES_PER_STATE * scene.particles if continuation else 0
    require_memory("points of the scan", e.size * a.size, BYTES_PER_POINT + states)
    scan, shares = Scan(forcing, e, a), []
    with Workers(threads) as workers:
        if replicas:
            noisy = [_noisy(scene, c, scan, tolerance, replicas, workers) for c in conditions]
            found, shares = [rows for rows, _ in noisy], [share for _, share in noisy]
        else:
            found = [
                _windows(scene, condition, scan, direction, tolerance, workers)
                for condition in conditions
                for direction in directions
            ]
    shape = (len(conditions), len(directions), e.size)
    held = np.array([row.codes for rows in found for row in rows], np.int8)
    held = held.reshape(*shape, a.size)
    dataset = _dataset(scene, conditions, directions, scan, _table(found, shape))
    dataset[HELD.name] = (HELD.dims, held, HELD.attributes)
    others: dict[str, Any] = {"tolerance": tolerance}
    if replicas:
        joined = Share(*(np.concatenate(part) for part in zip(*shares, strict=True)))
        dataset = dataset.assign(joined.variables(held.shape))
        others |= {"noise_replicas": replicas, "noise_seed": scene.noise_seed}
    if not sweep.design.axes:
        sizes = f"{e.size} restitutions and {POINTS} values of {forcing} in even steps"
        others["grid"] = f"{sizes} over the ranges of the {sweep.design.name} design"
    if defined:
        others["condition_code"] = codes
    frequency = scene.inputs["frequency"]
    notes = short_observation(scene, float(e.max()), frequency) if orbits else ""
    meanings = "; ".join(f"{c.name}: {c.sentence}" for c in conditions if c.sentence)
    others |= {"forcing": forcing, "meaning": meanings}
    return dataset.assign_attrs(attributes(sweep, scene, notes, **others))


def _conditions(sweep: Sweep) -> list[Condition | Locked]:
    """Conditions of a sweep; raises a SpecError if there are none, or for an unknown one."""
    if sweep.windows is None:
        known = f" is missing; add it with conditions = [...], each one of {', '.join(NAMES)}"
        raise sweep.refusal((table("windows"), known))
    listed = sweep.windows.get("conditions", ("locked(1)",))
    try:
        return [named(one) if isinstance(one, str) else one for one in listed]
    except ParameterError as error:
        raise sweep.refusal((Key("windows.conditions"), f": {error}")) from error


def _replicas(sweep: Sweep, conditions: list[Condition | Locked]) -> int:
    """Number of replicas of each point; 0 without noise.

    Raises a SpecError for keys that have no meaning with, or without, noise.
    """
    keys, noise = sweep.windows or {}, sweep.scene.noise(sweep.design.sampled)
    given = keys.get("noise_replicas")
    if not noise:
        if given is None:
            return 0
        rule = f"has no meaning, since nothing is random: give one of {', '.join(NOISE)}"
        raise sweep.refusal(Mistake("windows.noise_replicas", rule, given))
    rule = f"looks for orbits that repeat: leave it out, or {' and '.join(noise)}"
    for key in ("continuation", "prove"):
        if keys.get(key):
            raise sweep.refusal(Mistake(f"windows.{key}", rule, keys[key]))
    if repeats := [c.name for c in conditions if isinstance(c, Condition) and _of_orbits(c)]:
        raise sweep.refusal(Mistake("windows.conditions", rule, repeats[0]))
    return int(given or REPLICAS)


def _of_orbits(condition: Condition | Locked) -> bool:
    """Return whether a condition depends on the orbits that particles settle on."""
    needed = condition.measures if isinstance(condition, Condition) else {}
    return not needed.keys().isdisjoint({"regimes", "lyapunov"})


class Row(NamedTuple):
    """Results for a condition at one restitution."""

    codes: Codes  # at the points of the scan: `FAILS`, `HOLDS` or `UNDETERMINED`
    windows: list[Window]


class Scan(NamedTuple):
    """Points of a scan."""

    forcing: str  # name, one of `FORCINGS`
    restitution: Array  # shape (restitution,)
    values: Array  # of the forcing, scanned at each restitution; shape (scan,)


def _windows(
    scene: Scene,
    condition: Condition | Locked,
    scan: Scan,
    direction: str,
    tolerance: float,
    workers: Workers,
) -> list[Row]:
    """Windows of one condition in one direction, a row for each restitution."""
    forcing, e, a = scan
    if isinstance(condition, Locked) and scene.waveform != SINE:
        rows = [rows_of_shape(scene, condition.k, forcing, float(one), a, workers) for one in e]
        return [Row(*row) for row in rows]

    def judge(rows: Codes, at: Array, states: Array) -> tuple[Codes, Array]:
        points = {"restitution": e[rows], forcing: at}
        if isinstance(condition, Locked):
            return evaluate.locked(scene, condition, points, workers), states
        if direction in FRESH:
            return evaluate.launched(scene, condition, points, workers), states
        return evaluate.continued(scene, condition, points, states, workers)

    fresh = isinstance(condition, Locked) or direction in FRESH
    upward = direction != DIRECTIONS[1]
    first = {"restitution": e, forcing: np.full(e.size, a[0 if upward else -1])}
    start = None if fresh else evaluate.launch_states(scene, scene.parameters(first))
    width = tolerance
    if isinstance(condition, Locked):  # widened by the error, brackets keep to the tolerance
        error = END_ERROR + (FORCING_ERROR if forcing != AMPLITUDE else 0.0)
        constant = scene.restitution_law == CONSTANT
        width = tolerance - 2.0 * error if constant else 0.5 * tolerance
    codes, edges = find_edges(judge, e.size, a, width, start=start, upward=upward)
    if isinstance(condition, Locked):
        points = {"restitution": e[edges.row], forcing: edges.high}
        off = error + evaluate.law_errors(scene, condition, points)
        edges = edges._replace(low=edges.low * (1.0 - off), high=edges.high * (1.0 + off))
    held = np.where(np.isin(codes, list(evaluate.HOLDING)), HOLDS, np.minimum(codes, FAILS))
    return [
        Row(held[row], windows_of_row(codes, edges, row, evaluate.HOLDING)) for row in range(e.size)
    ]


def _noisy(
    scene: Scene,
    condition: Condition | Locked,
    scan: Scan,
    tolerance: float,
    replicas: int,
    workers: Workers,
) -> tuple[list[Row], Share]:
    """Windows in which a condition holds in half of the replicas, and shares over the scan."""
    (forcing, e, a), shares = scan, []

    def judge(rows: Codes, at: Array, states: Array) -> tuple[Codes, Array]:
        points = {"restitution": e[rows], forcing: at}
        shares.append(share_of(scene, condition, points, replicas, workers))
        return shares[-1].codes, states

    codes, edges = find_edges(judge, e.size, a, tolerance)
    rows = [Row(codes[row], windows_of_row(codes, edges, row, (HOLDS,))) for row in range(e.size)]
    return rows, shares[0]  # the first call judges the whole scan


def _table(found: list[list[Row]], shape: tuple[int, int, int]) -> Array:
    """Ends, bracket widths and codes of ends, shape (5, *shape, window).

    Past the last window they are NaN, and the code is `NO_WINDOW`.
    """
    rows = [row.windows for rows in found for row in rows]
    most = max(1, max(len(row) for row in rows))
    table = np.full((5, len(rows), most), np.nan)
    table[4] = NO_WINDOW
    for i, row in enumerate(rows):
        for j, window in enumerate(row):
            table[:, i, j] = (*window[:4], code_of_ends(window))
    return table.reshape(5, *shape, most)


def _dataset(
    scene: Scene,
    conditions: list[Condition | Locked],
    directions: Sequence[str],
    scan: Scan,
    table: Array,
) -> xr.Dataset:
    (forcing, e, a), dims = scan, ENDS.dims
    symbol = FORCINGS[forcing].symbol
    lower, upper, lower_bracket, upper_bracket, ends = table
    count = np.count_nonzero(ends != NO_WINDOW, axis=-1)
    top, bottom = np.where(np.isnan(upper), a[-1], upper), np.where(np.isnan(lower), a[0], lower)
    covered = np.where(ends == NO_WINDOW, -1.0, top - bottom)
    widest = np.where(count > 0, np.argmax(covered, axis=-1), -1)
    units, comment = FORCINGS[forcing].units, {"comment": OF_ENDS}
    data: dict[str, Any] = {
        f"{symbol}_{name}": (dims, values, meaning(words, units) | comment)
        for name, values, words in (
            ("min", lower, "lower end of the window"),
            ("max", upper, "upper end of the window"),
            ("min_bracket", lower_bracket, "width of the lower bracket"),
            ("max_bracket", upper_bracket, "width of the upper bracket"),
        )
    }
    words = meaning("index of the widest window")
    words["comment"] = "-1 if there is none; an open end counts as the end of the scan"
    data |= {
        ENDS.name: (dims, ends.astype(np.int8), ENDS.attributes),
        "window_count": (dims[:-1], count, meaning("number of windows")),
        "widest": (dims[:-1], widest, words),
    }
    varied = {"restitution": np.repeat(e, a.size), forcing: np.tile(a, e.size)}
    acceleration = scene.quantities(varied)["base_acceleration"].reshape(e.size, a.size)
    words = {**coordinate_attributes(FORCINGS[forcing]), "comment": "points of the coarse scan"}
    coordinates = {
        "condition": [condition.name for condition in conditions],
        "direction": list(directions),
        "restitution": ("restitution", e, coordinate_attributes(PARAMETERS["restitution"])),
        "scan": ("scan", a, words),
        "base_acceleration": (
            ("restitution", "scan"),
            acceleration,
            coordinate_attributes(FORCINGS["base_acceleration"]),
        ),
    }
    return xr.Dataset(data | shared(scene, ["restitution", forcing]), coordinates)
