"""Windows of locked orbits under a waveform other than the sine, one for each branch.

Their ends have closed forms (`vibrosweep.model.locked_theory`), except where the particle begins to
land earlier, or to rest.  Such ends are searched at `PHASES` phases of each window and bisected.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.analysis.bisection import Window
from vibrosweep.analysis.conditions import FAILS, HOLDS
from vibrosweep.arrays import Array
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels.fixed import (
    ABSENT,
    ATTRACTS,
    REPELS,
    conditions,
    empty_fixed,
    may_push_back,
    orbits_hold,
)
from vibrosweep.kernels.impact import base_of
from vibrosweep.model.forcing import AMPLITUDE
from vibrosweep.model.locked_theory import FOLD, NONE, LockedWindow, Mode, mode_of, windows_of
from vibrosweep.model.orbit_theory import moves
from vibrosweep.model.parameters import dimensionless
from vibrosweep.model.restitution_laws import CONSTANT
from vibrosweep.scene.scene import Scene

PHASES: Final = 257
HALVINGS: Final = 45
PER_TASK: Final = 256
BEYOND: Final = {FOLD: ABSENT, NONE: None}  # code beyond an end; elsewhere the orbit repels
CONVERTED: Final = 2.0**-49  # relative error of a forcing computed from a kick

Holds = Callable[[Array, Array], NDArray[np.bool_]]  # of phases and kicks


def rows_of_shape(
    scene: Scene, k: int, forcing: str, e: float, values: Array, workers: Workers
) -> tuple[NDArray[np.int64], list[Window]]:
    """Codes at values of the forcing, and windows of mode k at one restitution.

    The windows are those of all branches, which may overlap, in the order of their lower ends.
    """
    windows = _windows(scene, k, forcing, e, values, workers)
    held = np.full(values.size, FAILS, np.int64)
    for window in windows:
        held[~(values < window.lower) & ~(values > window.upper)] = HOLDS
    return held, windows


def _windows(
    scene: Scene, k: int, forcing: str, e: float, values: Array, workers: Workers
) -> list[Window]:
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

    found: list[Window] = []  # in kicks
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


def _mode(scene: Scene, k: int, e: float, *, turned: bool) -> Mode:
    """Conditions of mode k at one restitution."""
    if scene.restitution_law == CONSTANT:
        return mode_of(k, e, scene.base, turned=turned)
    one = scene.parameters({"restitution": np.array([e]), AMPLITUDE: np.ones(1)})
    problem, found = dimensionless(one, scene.duration), np.empty((2, 4))
    sign = -1.0 if turned else 1.0
    conditions(base_of(*scene.mechanics), problem, k, sign, found.ravel())
    return Mode(*found[int(moves(scene.base))].tolist())


def _scaled(window: Window, unit: float, first: float, last: float) -> Window:
    """Return a window of kicks as one of the forcing, open where it extends beyond the scan."""
    lower, upper = window.lower / unit, window.upper / unit
    low_width = window.lower_bracket / unit + 2.0 * CONVERTED * lower
    high_width = window.upper_bracket / unit + 2.0 * CONVERTED * upper
    if lower < first:
        lower, low_width, window = np.nan, np.nan, window._replace(below=None)
    if upper > last:
        upper, high_width, window = np.nan, np.nan, window._replace(above=None)
    return Window(lower, upper, low_width, high_width, window.below, window.above)


def _held(
    scene: Scene, window: LockedWindow, sign: float, need: float, holds: Holds
) -> list[Window]:
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
        Window(a, b, a_width, b_width, below, above)
        for (a, a_width, below), (b, b_width, above) in zip(ends[::2], ends[1::2], strict=True)
    ]
