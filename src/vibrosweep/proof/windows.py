"""Ends of windows proved as bifurcations of orbits, and attraction proved between them."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
import xarray as xr

from vibrosweep.analysis.conditions import Locked, named
from vibrosweep.analysis.continuation import AT_CORNER, AT_YIELDING, Line
from vibrosweep.analysis.line_equations import FIX_E
from vibrosweep.analysis.orbit_lines import Plane
from vibrosweep.analysis.window_codes import NO_WINDOW, OPEN_END, PROVED
from vibrosweep.arrays import Array
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.bifurcations import (
    BORN,
    CORNER,
    DOUBLING,
    GRAZE,
    LANDING,
    REST,
    SADDLE_NODE,
    YIELD,
)
from vibrosweep.model.forcing import AMPLITUDE, FORCINGS
from vibrosweep.model.measures import Variable
from vibrosweep.model.shapes import SINE_NAME
from vibrosweep.proof.closed_orbits import orbit_of
from vibrosweep.proof.reference._flint import arb, ctx
from vibrosweep.proof.reference.closed import (
    BITS,
    NOT_ATTRACTING,
    NOT_ENCLOSED,
    Event,
    cover,
    prove_event,
)
from vibrosweep.proof.reference.laws import Laws
from vibrosweep.proof.reference.orbit_equations import EARLIER, RESTING, Orbit
from vibrosweep.scene.scene import Scene

NO_ORBIT, TOUCHES, UNPROVED, ELSEWHERE, FORCING, SWITCH = range(3, 9)
UNBOUNDED: Final = 6
# Codes by their meanings
ENDS: Final = {
    "no_window": NO_WINDOW,
    "proved": PROVED,
    "open": OPEN_END,
    "not_an_end_of_one_orbit": NO_ORBIT,
    "touches_base_or_rests": TOUCHES,
    "not_enclosed": UNPROVED,
    "not_in_the_bracket": ELSEWHERE,
    "waveform_needs_amplitude_or_base_velocity": FORCING,
    "corner_of_the_waveform_or_yielding": SWITCH,
}
INSIDE: Final = {
    "no_window": NO_WINDOW,
    "proved": PROVED,
    **{EARLIER: 2, RESTING: 3, NOT_ENCLOSED: 4, NOT_ATTRACTING: 5},
    "ends_not_proved": UNBOUNDED,
}
# Forcings whose ratio to the kick is the same for all waveforms
OF_ANY_SHAPE: Final = (AMPLITUDE, "base_velocity")
POINTS: Final = 10_000  # of a branch in each direction
MULTIPLIER: Final = {SADDLE_NODE: 1, DOUBLING: -1}
# Codes of the other events that end a branch
LEAVES: Final = {GRAZE: TOUCHES, LANDING: TOUCHES, REST: TOUCHES, CORNER: SWITCH, YIELD: SWITCH}


class _Proof(NamedTuple):
    """Proof of a window: codes, and enclosures of both ends as doubles."""

    lower: int = NO_WINDOW
    upper: int = NO_WINDOW
    inside: int = NO_WINDOW
    # low and high of the lower end, and of the upper one
    low: tuple[float, float] = (math.nan, math.nan)
    high: tuple[float, float] = (math.nan, math.nan)


def prove_windows(found: xr.Dataset, scene: Scene) -> xr.Dataset:
    """Add proofs to windows: of each end, and of the attraction between both.

    An end of ``locked(k)`` is the root of the equations of the orbit and of its multiplier, 1 or
    -1, enclosed by Krawczyk's method in ball arithmetic; parameters are taken as exact doubles.
    The inside is proved if pieces of the branch cover it, and along each of them the orbit exists,
    is admissible, and has both multipliers inside the unit circle.

    Raises a MissingFlintError without python-flint.
    """
    dims = ("condition", "direction", "restitution", "window")
    shape = tuple(found.sizes[dim] for dim in dims)
    proofs = np.empty(shape, object)
    with Workers(1) as workers:
        for place in np.ndindex(*shape):
            one = found.isel(dict(zip(dims, place, strict=True)))
            proofs[place] = _prove(one, scene, found["scan"].values, workers)
    forcing = FORCINGS[str(found.attrs["forcing"])]
    data: dict[str, Any] = {}
    for name, field, meanings, words in (
        ("min_proof", "lower", ENDS, "proof of the lower end"),
        ("max_proof", "upper", ENDS, "proof of the upper end"),
        ("inside_proof", "inside", INSIDE, "proof of the attraction between both ends"),
    ):
        codes = np.array([getattr(p, field) for p in proofs.ravel()], np.int8).reshape(shape)
        flags = tuple((code, meaning) for meaning, code in meanings.items())
        variable = Variable(name, dims, "int8", "1", words, flags=flags)
        data[name] = (dims, codes, variable.attributes)
    for name, field in (("min", "low"), ("max", "high")):
        for k, side in enumerate(("low", "high")):
            values = np.array([getattr(p, field)[k] for p in proofs.ravel()]).reshape(shape)
            which = "lower" if name == "min" else "upper"
            words = f"{side} end of the enclosure of the {which} end"
            attrs = {"units": forcing.units, "long_name": words, "comment": "NaN if not enclosed"}
            data[f"{forcing.symbol}_{name}_{side}"] = (dims, values, attrs)
    return found.assign(data)


def _prove(one: xr.Dataset, scene: Scene, scan: Array, workers: Workers) -> _Proof:
    """Prove one window."""
    if int(one["window_ends"]) == NO_WINDOW:
        return _Proof()
    k = _mode(one)
    if not k:
        return _Proof(NO_ORBIT, NO_ORBIT, UNBOUNDED)
    forcing, e = str(one.attrs["forcing"]), float(one["restitution"])
    if scene.waveform.name != SINE_NAME and forcing not in OF_ANY_SHAPE:
        return _Proof(FORCING, FORCING, UNBOUNDED)
    symbol = FORCINGS[forcing].symbol
    ends = [float(one[f"{symbol}_{name}"]) for name in ("min", "max")]
    widths = [float(one[f"{symbol}_{name}_bracket"]) for name in ("min", "max")]
    known = [v if np.isfinite(v) else b for v, b in zip(ends, scan[[0, -1]], strict=True)]
    plane = Plane(scene, forcing, np.array([e]), scan[[0, -1]], POINTS)
    line, row = _branch(plane, np.array([0.5 * sum(known) * plane.scale]), k, workers)
    if line is None:
        return _Proof(UNPROVED, UNPROVED, UNBOUNDED)
    with ctx.workprec(BITS):
        laws = Laws(scene.rebound, scene.restitution_law, scene.waveform)
        orbit = orbit_of(scene.base, laws, {**scene.inputs, "restitution": e}, 1, k)
    sides = sorted((_side(line, row, step) for step in (-1, 1)), key=lambda s: line.z[s[0], -1])
    codes, boxes, events = [OPEN_END] * 2, [(math.nan, math.nan)] * 2, []
    # the last column, the drive, becomes the kick
    points = line.z[:, [0, -1]] * [1.0, 1.0 + e if plane.relative else 1.0]
    for i, (at, met) in enumerate(sides):
        if not np.isfinite(ends[i]):
            continue
        guess = points[at].tolist()
        proved = prove_event(orbit, MULTIPLIER[met], guess) if met in MULTIPLIER else None
        codes[i] = LEAVES.get(met, UNPROVED)
        if proved:
            boxes[i] = low, high = _doubles(proved, forcing, scene, orbit)
            near = low - 0.5 * widths[i] <= ends[i] <= high + 0.5 * widths[i]
            codes[i] = PROVED if near else ELSEWHERE
            events.append(proved)
    within = UNBOUNDED
    if {*codes} <= {PROVED, OPEN_END}:
        first, last = sorted(at for at, _ in sides)
        within = INSIDE[cover(orbit, points[first : last + 1].tolist(), events) or "proved"]
    return _Proof(codes[0], codes[1], within, boxes[0], boxes[1])


def _mode(one: xr.Dataset) -> int:
    """Return the mode of the locked orbit of a condition; 0 for any other condition."""
    try:
        condition = named(str(one["condition"].values))
    except ParameterError:  # a condition of the user
        return 0
    return condition.k if isinstance(condition, Locked) else 0


def _branch(plane: Plane, drive: Array, k: int, workers: Workers) -> tuple[Line | None, int]:
    """Branch of the orbit that attracts in the middle of a window, and its point there."""
    for p, q, z in plane.orbits(plane.restitution, drive, (1, k), workers)[0]:
        if (p, q) == (1, k):
            line = plane.follow(z, 1, k, FIX_E)
            row = int(np.argmin(np.abs(line.z - z).max(axis=1)))
            if abs(line.trace[row]) < 1.0 + line.determinant[row] < 2.0:
                return line, row
    return None, 0


def _side(line: Line, row: int, step: int) -> tuple[int, int]:
    """Last point of the attracting part of a branch, and the kind of event there."""
    at = row
    for at in range(row, line.z.shape[0] if step > 0 else -1, step):
        for event in line.events:
            ends = event.kind not in (CORNER, YIELD, BORN)
            if ends and np.array_equal(event.z, line.z[at]):
                return at, event.kind
    lost = line.ends[step > 0]
    return at, {AT_CORNER: CORNER, AT_YIELDING: YIELD}.get(lost, BORN)


def _doubles(event: Event, forcing: str, scene: Scene, orbit: Orbit) -> tuple[float, float]:
    """Enclosure of a forcing by doubles, from that of the kick."""
    with ctx.workprec(BITS):
        f, g = arb(scene.inputs["frequency"]), arb(scene.inputs["gravity"])
        amplitude = event.box[-1] * g / (2 * f)
        velocity, omega = amplitude / (1 + orbit.e), 2 * arb.pi() * f
        value = {
            "amplitude": amplitude,
            "base_velocity": velocity,
            "base_displacement": velocity / omega,
            "base_acceleration": velocity * omega / g,
        }[forcing]
        # a conversion to a double rounds by less than one unit in the last place
        low, high = float(value.lower()), float(value.upper())
    return math.nextafter(low, -math.inf), math.nextafter(high, math.inf)
