"""Stability windows: the intervals of the forcing in which a condition holds, for each restitution.

A coarse scan over the forcing finds the pairs of points between which a condition begins or ceases
to hold; all these edges, of all restitutions, are then bisected together.  A window narrower than
the step of the scan may hide between two of its points: the scan is the resolution.  Locked orbits
are the exception, since a scan also detects orbits that exist without being stable: every window of
a locked orbit that is wider than the tolerance is found.  Under a waveform other than the sine a
mode may have several windows, which may overlap: those of all branches are listed.  Their
ends have closed forms (`vibrosweep.model.orbit_theory`), except where the particle begins to land
earlier, or to rest; such ends are searched at `PHASES` phases of each window and bisected.

A code is the state at a point: 0 or 1 for a condition, and more values where a coarse scan could
step over an intermediate state.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from vibrosweep.analysis.common import (
    attributes,
    grid_axes,
    launch_states,
    meaning,
    require_ability,
    require_memory,
    settling,
    shared,
)
from vibrosweep.analysis.conditions import (
    FAILS,
    HOLDING,
    HOLDS,
    NAMED,
    NAMES,
    REPLICAS,
    UNDETERMINED,
    Condition,
    Locked,
    Trials,
    continued,
    launched,
    law_errors,
    locked,
    named,
    share_of,
)
from vibrosweep.arrays import Array
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.arithmetic import HALF_ULP
from vibrosweep.kernels.fixed import (
    ABSENT,
    ATTRACTS,
    END_ERROR,
    REPELS,
    conditions,
    empty_fixed,
    may_push_back,
    orbits_hold,
)
from vibrosweep.kernels.impact import base_of
from vibrosweep.kernels.memory import unwritten
from vibrosweep.mistakes import Key, Mistake, table
from vibrosweep.model.forcing import AMPLITUDE, FORCINGS, forcing_of
from vibrosweep.model.measures import Variable
from vibrosweep.model.orbit_theory import (
    FOLD,
    NONE,
    LockedWindow,
    OrbitConditions,
    mode_of,
    moves,
    windows_of,
)
from vibrosweep.model.parameters import NOISE, dimensionless
from vibrosweep.model.restitution_laws import CONSTANT
from vibrosweep.model.shapes import SINE
from vibrosweep.runs.result import attributes_of, short_observation
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import Sweep

__all__ = [
    "DIRECTIONS",
    "ENDS",
    "NO_WINDOW",
    "OPEN_END",
    "PROVED",
    "TOLERANCE",
    "UNDETERMINED_ABOVE",
    "UNDETERMINED_BELOW",
    "find_windows",
]

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
Codes = NDArray[np.int64]
# Rows, positions and initial states (first axis: point) -> codes and final states.  The states are
# empty if every point is evaluated independently.
Evaluate = Callable[[Codes, Array, Array], tuple[Codes, Array]]
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
PHASES: Final = 257
HALVINGS: Final = 45
PER_TASK: Final = 256
BEYOND: Final = {FOLD: ABSENT, NONE: None}  # code beyond an end; elsewhere the orbit repels
CONVERTED: Final = 2.0**-49  # relative error of a forcing computed from a kick
Holds = Callable[[Array, Array], NDArray[np.bool_]]  # of phases and kicks


def find_windows(sweep: Sweep, threads: int) -> xr.Dataset:
    """Windows of a sweep, as `vibrosweep.windows`.

    With continuation, coexisting and hysteretic windows appear as differences between the
    directions.  A bracket around an edge is at most as wide as the tolerance, relative to the edge;
    that of a locked orbit contains the exact edge.  The ranges of a random design are scanned at
    `RESTITUTIONS` and `POINTS` values in even steps, as the attribute ``grid`` says.  Raises a
    SpecError if the sweep has no conditions, if one is not known, or if parameters other than the
    restitution and a forcing vary.
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
        joined = Trials(*(np.concatenate(part) for part in zip(*shares, strict=True)))
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
    others["launched"] = any(isinstance(c, Condition) for c in conditions)
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
    windows: list[FoundWindow]


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
            return locked(scene, condition, points, workers), states
        if direction in FRESH:
            return launched(scene, condition, points, workers), states
        return continued(scene, condition, points, states, workers)

    fresh = isinstance(condition, Locked) or direction in FRESH
    upward = direction != DIRECTIONS[1]
    first = {"restitution": e, forcing: np.full(e.size, a[0 if upward else -1])}
    start = None if fresh else launch_states(scene, scene.parameters(first))
    width = tolerance
    if isinstance(condition, Locked):  # widened by the error, brackets keep to the tolerance
        error = END_ERROR + (FORCING_ERROR if forcing != AMPLITUDE else 0.0)
        constant = scene.restitution_law == CONSTANT
        width = tolerance - 2.0 * error if constant else 0.5 * tolerance
    codes, edges = find_edges(judge, e.size, a, width, start=start, upward=upward)
    if isinstance(condition, Locked):
        points = {"restitution": e[edges.row], forcing: edges.high}
        off = error + law_errors(scene, condition, points)
        edges = edges._replace(low=edges.low * (1.0 - off), high=edges.high * (1.0 + off))
    held = np.where(np.isin(codes, list(HOLDING)), HOLDS, np.minimum(codes, FAILS))
    return [Row(held[row], windows_of_row(codes, edges, row, HOLDING)) for row in range(e.size)]


def _noisy(
    scene: Scene,
    condition: Condition | Locked,
    scan: Scan,
    tolerance: float,
    replicas: int,
    workers: Workers,
) -> tuple[list[Row], Trials]:
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
    words = {**attributes_of(forcing), "comment": "points of the coarse scan"}
    coordinates = {
        "condition": [condition.name for condition in conditions],
        "direction": list(directions),
        "restitution": ("restitution", e, attributes_of("restitution")),
        "scan": ("scan", a, words),
        "base_acceleration": (
            ("restitution", "scan"),
            acceleration,
            attributes_of("base_acceleration"),
        ),
    }
    return xr.Dataset(data | shared(scene, ["restitution", forcing]), coordinates)


def code_of_ends(window: FoundWindow) -> int:
    """Code of a window in `ENDS`."""
    below = {None: OPEN_BELOW, UNDETERMINED: UNDETERMINED_BELOW}
    above = {None: OPEN_ABOVE, UNDETERMINED: UNDETERMINED_ABOVE}
    return below.get(window.below, 0) + above.get(window.above, 0)


def summary(windows: xr.Dataset) -> Iterator[str]:
    """Describe the windows in a line for each condition and direction, then their proofs."""
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
    if "min_proof" in windows:
        yield from _proof_lines(windows)


def _proof_lines(found: xr.Dataset) -> Iterator[str]:
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


class Edges(NamedTuple):
    """Brackets of edges, each array of shape (edge,), ordered by row and position.

    Between `low` and `high` the code changes to `code_high`.
    """

    row: Codes
    low: Array
    high: Array
    code_high: Codes


class _Brackets(NamedTuple):
    """Brackets during bisection, with the states at their near ends."""

    row: Codes
    near: Array
    far: Array
    code_near: Codes
    code_far: Codes
    state: Array

    def take(self, chosen: Any) -> _Brackets:
        return _Brackets._make(values[chosen] for values in self)

    def join(self, other: _Brackets) -> _Brackets:
        return _Brackets._make(np.concatenate(pair) for pair in zip(self, other, strict=True))


def find_edges(
    evaluate: Evaluate,
    rows: int,
    axis: Array,
    tolerance: float,
    *,
    start: Array | None = None,
    upward: bool = True,
) -> tuple[Codes, Edges]:
    """Codes (row, position) at the points of a scan, and all edges between unlike neighbours.

    `evaluate` is called with all rows and edges at once.  The axis ascends; the tolerance is the
    width of a bracket relative to its position.  With `start`, the initial states of all rows,
    states are continued from point to point, upwards or downwards, and in a bisection from the near
    end of its bracket; without it every point is evaluated independently.
    """
    codes, states = _scan(evaluate, rows, axis, start, upward)
    row, left = np.nonzero(codes[:, 1:] != codes[:, :-1])
    near, far = (left, left + 1) if upward else (left + 1, left)
    brackets = _Brackets(
        row, axis[near], axis[far], codes[row, near], codes[row, far], states[row, near]
    )
    done = _bisect(evaluate, brackets, tolerance)
    swap = done.near > done.far
    edges = Edges(
        done.row,
        np.minimum(done.near, done.far),
        np.maximum(done.near, done.far),
        np.where(swap, done.code_near, done.code_far),
    )
    order = np.lexsort((edges.low, edges.row))
    return codes, Edges._make(values[order] for values in edges)


def _scan(
    evaluate: Evaluate, rows: int, axis: Array, start: Array | None, upward: bool
) -> tuple[Codes, Array]:
    """Codes and states at all points, shape (row, position, ...)."""
    row = np.arange(rows)
    if start is None:
        nothing = np.empty((rows * axis.size, 0))
        codes, _ = evaluate(np.repeat(row, axis.size), np.tile(axis, rows), nothing)
        return codes.reshape(rows, axis.size), nothing.reshape(rows, axis.size, 0)
    codes = unwritten((rows, axis.size), np.int64)
    states = unwritten((rows, axis.size, *start.shape[1:]))
    for i in range(axis.size) if upward else range(axis.size - 1, -1, -1):
        codes[:, i], start = evaluate(row, np.full(rows, axis[i]), start)
        states[:, i] = start
    return codes, states


def _bisect(evaluate: Evaluate, brackets: _Brackets, tolerance: float) -> _Brackets:
    """Halve all brackets until they are narrow; one with a third code inside becomes two."""
    finished = brackets.take(slice(0, 0))
    while brackets.row.size:
        middle = 0.5 * (brackets.near + brackets.far)
        width = np.abs(brackets.far - brackets.near)
        narrow = width <= tolerance * np.maximum(brackets.near, brackets.far)
        narrow |= (middle == brackets.near) | (middle == brackets.far)
        finished = finished.join(brackets.take(narrow))
        brackets, middle = brackets.take(~narrow), middle[~narrow]
        if not middle.size:
            break
        code, state = evaluate(brackets.row, middle, brackets.state)
        left, moved = code != brackets.code_near, code != brackets.code_far
        beyond = brackets.take(left)._replace(far=middle[left], code_far=code[left])
        ahead = brackets.take(moved)._replace(
            near=middle[moved], code_near=code[moved], state=state[moved]
        )
        brackets = beyond.join(ahead)
    return finished


class FoundWindow(NamedTuple):
    """An interval in which the code is one of those wanted."""

    # Ends of the window, the middles of brackets; NaN where it reaches an end of the scan
    lower: float
    upper: float
    # Widths of the brackets
    lower_bracket: float
    upper_bracket: float
    # Codes beyond the ends; None where the window reaches an end of the scan
    below: int | None
    above: int | None


def windows_of_row(
    codes: Codes, edges: Edges, row: int, wanted: Collection[int]
) -> list[FoundWindow]:
    """Return the windows of one row in which the code is one of those wanted."""
    windows, outside = [], FoundWindow(np.nan, np.nan, np.nan, np.nan, None, None)
    code, window = int(codes[row, 0]), outside
    for i in np.flatnonzero(edges.row == row):
        middle, gap = float(0.5 * (edges.low[i] + edges.high[i])), edges.high[i] - edges.low[i]
        before, code = code, int(edges.code_high[i])
        if before in wanted and code not in wanted:
            windows.append(window._replace(upper=middle, upper_bracket=float(gap), above=code))
        elif before not in wanted and code in wanted:
            window = outside._replace(lower=middle, lower_bracket=float(gap), below=before)
    return [*windows, window] if code in wanted else windows


def rows_of_shape(
    scene: Scene, k: int, forcing: str, e: float, values: Array, workers: Workers
) -> tuple[NDArray[np.int64], list[FoundWindow]]:
    """Codes at values of the forcing, and windows of mode k at one restitution.

    The windows are those of all branches, which may overlap, in the order of their lower ends.
    """
    windows = _windows_of_shape(scene, k, forcing, e, values, workers)
    held = np.full(values.size, FAILS, np.int64)
    for window in windows:
        held[~(values < window.lower) & ~(values > window.upper)] = HOLDS
    return held, windows


def _windows_of_shape(
    scene: Scene, k: int, forcing: str, e: float, values: Array, workers: Workers
) -> list[FoundWindow]:
    """Windows that overlap the range of `values`."""
    one = {"restitution": np.array([e]), forcing: np.ones(1)}
    unit = float(dimensionless(scene.parameters(one), scene.duration).kick[0])
    base = base_of(*scene.mechanics)

    def holds(x: Array, kicks: Array) -> NDArray[np.bool_]:
        points = {"restitution": np.full(x.size, e), forcing: kicks / unit}
        problem = dimensionless(scene.parameters(points), scene.duration)
        out, modes = empty_fixed(x.size), np.full(x.size, k)
        phases = np.asarray(x - np.rint(x))
        workers.run(
            lambda first, last: orbits_hold(first, last, base, problem, modes, phases, out),
            x.size,
            PER_TASK,
            out,
        )
        return np.asarray(out.state == ATTRACTS)

    found: list[FoundWindow] = []  # in kicks
    for turned in (False, True) if may_push_back(scene.rebound) else (False,):
        mode = _mode(scene, k, e, turned=turned)
        for window in windows_of(scene.waveform, mode, turned=turned):
            sign = -1.0 if turned else 1.0
            found += _held(scene, window, sign, mode.need, holds)
    first, last = float(values[0]), float(values[-1])
    overlapping = [
        _scaled(window, unit, first, last)
        for window in found
        if window.upper / unit > first and window.lower / unit < last
    ]
    return sorted(overlapping, key=lambda window: np.nan_to_num(window.lower, nan=-np.inf))


def _mode(scene: Scene, k: int, e: float, *, turned: bool) -> OrbitConditions:
    """Conditions of mode k at one restitution."""
    if scene.restitution_law == CONSTANT:
        return mode_of(k, e, scene.base, turned=turned)
    one = scene.parameters({"restitution": np.array([e]), AMPLITUDE: np.ones(1)})
    problem, found = dimensionless(one, scene.duration), np.empty((2, 4))
    sign = -1.0 if turned else 1.0
    conditions(base_of(*scene.mechanics), problem, k, sign, found.ravel())
    return OrbitConditions(*found[int(moves(scene.base))].tolist())


def _scaled(window: FoundWindow, unit: float, first: float, last: float) -> FoundWindow:
    """Return a window of kicks as one of the forcing, open where it extends beyond the scan."""
    lower, upper = window.lower / unit, window.upper / unit
    low_width = window.lower_bracket / unit + 2.0 * CONVERTED * lower
    high_width = window.upper_bracket / unit + 2.0 * CONVERTED * upper
    if lower < first:
        lower, low_width, window = np.nan, np.nan, window._replace(below=None)
    if upper > last:
        upper, high_width, window = np.nan, np.nan, window._replace(above=None)
    return FoundWindow(lower, upper, low_width, high_width, window.below, window.above)


def _held(
    scene: Scene, window: LockedWindow, sign: float, need: float, holds: Holds
) -> list[FoundWindow]:
    """Parts of a window of kicks in which the particle neither lands earlier nor rests."""
    part = np.linspace(0.0, 1.0, PHASES)

    def place(part: Array) -> tuple[Array, Array]:
        x = window.from_phase + part * (window.to_phase - window.from_phase)
        if need == 0.0:
            return x, window.low + part * (window.high - window.low)
        kick = need / (sign * scene.waveform.velocity(x))
        return x, np.clip(kick, window.low, window.high)

    held = holds(*place(part))
    edges = np.flatnonzero(held[1:] != held[:-1])
    near, far, code = part[edges], part[edges + 1], held[edges]
    for _ in range(HALVINGS if edges.size else 0):
        middle = 0.5 * (near + far)
        same = holds(*place(middle)) == code
        near, far = np.where(same, middle, near), np.where(same, far, middle)
    low, high = place(near)[1], place(far)[1]
    ends: list[tuple[float, float, int | None]] = [
        (0.5 * float(a + b), float(b - a) + 1e-12 * float(b), ABSENT)
        for a, b in zip(low, high, strict=True)
    ]
    if held[0]:
        below = BEYOND.get(window.begins, REPELS)
        ends.insert(0, (window.low, 2.0 * window.low_error, below))
    if held[-1]:
        above = BEYOND.get(window.ends, REPELS)
        ends.append((window.high, 2.0 * window.high_error, above))
    return [
        FoundWindow(a, b, a_width, b_width, below, above)
        for (a, a_width, below), (b, b_width, above) in zip(ends[::2], ends[1::2], strict=True)
    ]
