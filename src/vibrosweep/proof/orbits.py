"""Proofs about periodic orbits: numbers of a result of orbits, and windows of attraction.

`verify_orbits` encloses each orbit in ball arithmetic and compares all its numbers.
`prove_windows` proves ends of windows as bifurcations of orbits, and attraction between them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import xarray as xr

from vibrosweep.analysis.conditions import Locked, named
from vibrosweep.analysis.continuation import AT_CORNER, AT_YIELDING, FIX_E, Line
from vibrosweep.analysis.orbits import Plane
from vibrosweep.analysis.windows import NO_WINDOW, OPEN_END, PROVED
from vibrosweep.arrays import Array
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError, count
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
from vibrosweep.model.forcing import AMPLITUDE, FORCINGS, INPUTS
from vibrosweep.model.measures import Variable
from vibrosweep.model.restitution_laws import CONSTANT, law_in
from vibrosweep.model.shapes import SINE_NAME
from vibrosweep.proof.reference.arithmetic import Jet, arb, ctx, variables
from vibrosweep.proof.reference.closed_orbits import (
    BITS,
    EARLIER,
    NOT_ATTRACTING,
    NOT_ENCLOSED,
    RESTING,
    Bifurcation,
    ClosedOrbit,
    ProvedOrbit,
    cover,
    prove_event,
    prove_orbit,
)
from vibrosweep.proof.reference.laws import Laws, wave_of
from vibrosweep.proof.reference.motion import EPS
from vibrosweep.proof.report import Judgement, Outcome, ProofState, Report, judge
from vibrosweep.scene.scene import Scene, stored
from vibrosweep.store.reading import load_dataset
from vibrosweep.waiting import Advance

if TYPE_CHECKING:
    import xarray as xr

# Rounding error of an equation of an orbit, in units of 2^-53 of the numbers in it
ROUNDINGS: Final = 64.0
PLACES: Final = 128  # points of a flight at which its height above the base is tested
SEARCHED: Final = "it describes the search for orbits, which cannot be proved"
COMPLETE: Final = "it is not proved that there are no more orbits"
YES, NO, RESTS = 1, 0, -1
OF_LANDINGS: Final = ("impact_phase", "flight_time", "rebound_velocity", "impact_speed")
JUDGED: Final = (
    *("cycle_impacts", "cycle_periods", "admissible", "stable"),
    *("multiplier_real", "multiplier_imaginary", *OF_LANDINGS),
)
UNKNOWN: Final = {
    **dict.fromkeys(("seeds", "late_orbits"), SEARCHED),
    **dict.fromkeys(("orbit_count", "saddle_points", "other_points", "balanced"), COMPLETE),
}


def orbit_of(base: str, laws: Laws, inputs: Mapping[str, float], p: int, q: int) -> ClosedOrbit:
    """Return an orbit of p impacts in q periods, with its parameters as balls."""
    with ctx.workprec(BITS):
        given = {name: arb(value) for name, value in inputs.items()}
        law = None if laws.restitution == CONSTANT else laws.in_periods(given)
        rest, wave = given["contact_time"] * given["frequency"], wave_of(laws.waveform)
        return ClosedOrbit(base, given["restitution"], p, q, rest, wave, law, laws.turns_back)


def verify_orbits(path: Path, *, sample: int, seed: int, advance: Advance) -> Report:
    """Enclose the orbits of some realizations and judge all their numbers.

    Krawczyk's method proves that exactly one orbit is near each orbit of the file, and encloses it.
    The errors allowed are estimated from `ROUNDINGS` rounding errors in each equation.  Raises a
    ParameterError for a size or a seed that cannot be used.
    """
    sample, seed = count("sample", sample), count("seed", seed, 0)
    found = load_dataset(path)
    dims, shape = found["orbit_count"].dims, found["orbit_count"].shape
    total = math.prod(shape)
    rows = np.arange(total)
    if sample < total:
        rows = np.sort(np.random.default_rng(seed).choice(total, sample, replace=False))
    attributes = found.attrs
    laws = Laws(attributes["rebound"], law_in(attributes), stored(attributes))
    outcomes = []
    for done, row in enumerate(rows):
        place = dict(zip(dims, np.unravel_index(int(row), shape), strict=True))
        outcomes.append(_outcome(int(row), found.isel(place), attributes["base"], laws))
        advance(done + 1, rows.size)
    return Report(
        path=str(path),
        total=total,
        seed=seed,
        outcomes=outcomes,
        claimed=False,
        names=[*JUDGED, *UNKNOWN],
        unknown=UNKNOWN,
    )


def _outcome(row: int, one: xr.Dataset, base: str, laws: Laws) -> Outcome:
    """Judge the orbits of one realization."""
    inputs = {name: float(one[name]) for name in INPUTS if name in one.variables}
    judgements: list[Judgement] = []
    landings, proofs = 0, 0
    with ctx.workprec(BITS):
        kick = 2 * arb(inputs["frequency"]) * arb(inputs["amplitude"]) / arb(inputs["gravity"])
        held = np.flatnonzero(one["cycle_impacts"].values)
        for k in held:
            own = one.isel(orbit=int(k))
            p, q = int(own["cycle_impacts"]), int(own["cycle_periods"])
            times = float(own["impact_phase"][0]) + inputs["frequency"] * np.cumsum(
                [0.0, *own["flight_time"].values[: p - 1]]
            )
            orbit = orbit_of(base, laws, inputs, p, q)
            proved = prove_orbit(orbit, times.tolist(), kick)
            if proved is None:
                judgements += [Judgement(name, None, math.nan, None) for name in JUDGED]
                continue
            proofs += 1
            landings += p
            unit = inputs["gravity"] / (2.0 * inputs["frequency"])
            judged = _judged(own, orbit, proved, 1.0 / inputs["frequency"], unit)
            judgements += [
                replace(j, complaint=f"of orbit {k} {j.complaint}" if j.complaint else "")
                for j in judged
            ]
    state = ProofState.COMPARED if proofs or not held.size else ProofState.UNDECIDED
    return Outcome(row, state, landings, judgements if proofs else ())


def _judged(
    own: xr.Dataset, orbit: ClosedOrbit, proved: ProvedOrbit, period: float, unit: float
) -> Iterator[Judgement]:
    """Judge the numbers of a proved orbit; period in s, unit of speeds in m/s."""
    p, q, n = orbit.p, orbit.q, orbit.p + 1
    found, times = proved.cycle, variables(proved.box)
    size = 1.0 + q + _most(proved.box[p])
    # `offs`: errors of the equations and of the kick; `errors`: of the times and of the kick
    offs = [*[ROUNDINGS * EPS * size] * p, ROUNDINGS * EPS * _most(proved.box[p])]
    errors = [sum(s * o for s, o in zip(row, offs, strict=True)) for row in proved.slopes]
    errors.append(offs[p])

    def claim(value: Jet, beside: float = 1.0) -> float:
        moved = sum(_most(value.d[k]) * errors[k] for k in range(n))
        return float(moved + ROUNDINGS * EPS * (_most(value.v) + beside))

    yield judge("cycle_impacts", None, p, p if _primitive(orbit, proved.box) else None, 0.0)
    yield judge("cycle_periods", None, q, q, 0.0)
    for name, proof in (("admissible", _admissible(orbit, proved)), ("stable", _stable(proved))):
        held = int(own[name])
        known = proof is not None
        yield judge(name, None, held, held if proof is None else proof, 0.0 if known else None)
    for i, flight in enumerate(found.flights):
        phase = float(own["impact_phase"][i])
        turns = times[i].v - round(float(times[i].v.mid()) - phase)
        yield judge("impact_phase", None, phase, turns, errors[i] + EPS)
        lasts = (times[i + 1] if i < p - 1 else times[0] + q) - times[i]
        for name, value, scale in (
            ("flight_time", lasts, period),
            ("rebound_velocity", flight.leaves, unit),
            ("impact_speed", flight.arrives, unit),
        ):
            size_of = scale * claim(value, size)
            yield judge(name, None, float(own[name][i]), arb(scale) * value.v, size_of)
    yield from _multipliers(own, proved, claim)


def _most(value: arb) -> float:
    return float(value.abs_upper())


def _primitive(orbit: ClosedOrbit, box: list[arb]) -> bool:
    """Return whether an orbit is certainly not a shorter one, repeated several times."""
    p, q = orbit.p, orbit.q
    return all(
        any(not (box[i + d] - box[i] - arb(q * d) / p).contains(0) for i in range(p - d))
        for d in range(1, p)
        if p % d == 0 and (q * d) % p == 0
    )


def _stable(proved: ProvedOrbit) -> int | None:
    """Return whether both multipliers are inside the unit circle; None if it is not certain."""
    t, d = proved.cycle.trace.v, proved.cycle.determinant.v
    if abs(t) < 1 + d and abs(d) < 1:
        return YES
    return NO if abs(t) > 1 + d or abs(d) > 1 else None


def _admissible(orbit: ClosedOrbit, proved: ProvedOrbit) -> int | None:
    """Return whether an orbit is admissible, in the codes of the result; None if uncertain."""
    found = proved.cycle
    if any(one.after.v <= orbit.rest and one.presses > 0 for one in found.flights):
        return RESTS
    if not found.obstacle:
        return YES
    leaves = all(one.after.v > orbit.rest for one in found.flights)
    return NO if leaves and any(_lands_earlier(orbit, proved, i) for i in range(orbit.p)) else None


def _lands_earlier(orbit: ClosedOrbit, proved: ProvedOrbit, i: int) -> bool:
    """Return whether a flight is certainly below the base at one of the points tested."""
    box, flight = proved.box, proved.cycle.flights[i]
    ends = [*box[: orbit.p], box[0] + orbit.q]
    alpha, lasts = box[orbit.p] / (1 + orbit.e), ends[i + 1] - ends[i]
    level = orbit.wave.level(2 * ends[i])
    for k in range(1, PLACES):
        s = lasts * k / PLACES
        risen = orbit.wave.level(2 * (ends[i] + s)) - level
        if s * (flight.leaves.v - s) < alpha * risen:
            return True
    return False


def _multipliers(
    own: xr.Dataset, proved: ProvedOrbit, claim: Callable[[Jet, float], float]
) -> Iterator[Judgement]:
    """Judge the roots of z^2 - T z + D, the one of larger modulus first."""
    trace, determinant = proved.cycle.trace, proved.cycle.determinant
    size = math.prod(_widest(flight.step) for flight in proved.cycle.flights)
    off_t, off_d = claim(trace, size), claim(determinant, size)
    half, square = trace.v / 2, trace.v * trace.v / 4 - determinant.v
    names = ("multiplier_real", "multiplier_imaginary")
    real = square > 0 and not half.contains(0)
    if not (real or square < 0):
        yield from (Judgement(name, None, math.nan, None) for name in names)
        return
    root = abs(square).sqrt()
    off = 0.5 * off_t + (0.5 * _most(trace.v) * off_t + off_d) / float(root.abs_lower())
    if real:
        larger = half + root if half > 0 else half - root
        smaller = determinant.v / larger
        off_smaller = (off_d + _most(smaller) * off) / float(larger.abs_lower())
        exact = [(larger, arb(0), off), (smaller, arb(0), off_smaller)]
    else:
        # the conjugate with the positive imaginary part comes first
        exact = [(half, root, off), (half, -root, off)]
    for k, (*parts, claimed) in enumerate(exact):
        for name, part in zip(names, parts, strict=True):
            yield judge(name, None, float(own[name][k]), part, claimed)


def _widest(step: tuple[Jet, ...]) -> float:
    """Bound on the norm of the derivatives over a flight."""
    xx, xu, ux, uu = (_most(one.v) for one in step)
    return max(xx + xu, ux + uu)


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
    "corner_of_the_waveform_or_kink_of_the_restitution": SWITCH,
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


def _doubles(
    event: Bifurcation, forcing: str, scene: Scene, orbit: ClosedOrbit
) -> tuple[float, float]:
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
