"""Verify periodic orbits: enclose each in ball arithmetic and compare all its numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.restitution_laws import CONSTANT, law_in
from vibrosweep.proof.judgement import Judgement, judge
from vibrosweep.proof.reference._flint import arb, ctx
from vibrosweep.proof.reference.closed import BITS, Proved, prove_orbit
from vibrosweep.proof.reference.jets import Jet, variables
from vibrosweep.proof.reference.laws import Laws
from vibrosweep.proof.reference.motion import EPS
from vibrosweep.proof.reference.orbit_equations import Orbit
from vibrosweep.proof.reference.waves import wave_of
from vibrosweep.proof.verification import Outcome, Report, State
from vibrosweep.runs.driver import count
from vibrosweep.runs.progress import Advance
from vibrosweep.scene.scene import stored
from vibrosweep.store.kinds import load_dataset

if TYPE_CHECKING:
    import xarray as xr

# Rounding error of an equation of an orbit, in units of 2^-53 of the numbers in it
ROUNDINGS: Final = 64.0
PLACES: Final = 128  # points of a flight at which its height above the base is tested
SEARCHED: Final = "it describes the search for orbits, which cannot be proved"
COMPLETE: Final = "it is not proved that there are no more orbits"
YES, NO, RESTS = 1, 0, -1
OF_LANDINGS: Final = ("impact_phase", "flight_time", "rebound_velocity", "arrival_velocity")
JUDGED: Final = (
    *("cycle_impacts", "cycle_periods", "admissible", "stable"),
    *("multiplier_real", "multiplier_imaginary", *OF_LANDINGS),
)
UNKNOWN: Final = {
    **dict.fromkeys(("seeds", "late_orbits"), SEARCHED),
    **dict.fromkeys(("orbit_count", "saddle_points", "other_points", "balanced"), COMPLETE),
}


def orbit_of(base: str, laws: Laws, inputs: Mapping[str, float], p: int, q: int) -> Orbit:
    """Return an orbit of p impacts in q periods, with its parameters as balls."""
    with ctx.workprec(BITS):
        given = {name: arb(value) for name, value in inputs.items()}
        law = None if laws.restitution == CONSTANT else laws.in_periods(given)
        rest, wave = given["contact_time"] * given["frequency"], wave_of(laws.waveform)
        return Orbit(base, given["restitution"], p, q, rest, wave, law, laws.turns_back)


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
    state = State.COMPARED if proofs or not held.size else State.UNDECIDED
    return Outcome(row, state, landings, judgements if proofs else ())


def _judged(
    own: xr.Dataset, orbit: Orbit, proved: Proved, period: float, unit: float
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
            ("arrival_velocity", flight.arrives, unit),
        ):
            size_of = scale * claim(value, size)
            yield judge(name, None, float(own[name][i]), arb(scale) * value.v, size_of)
    yield from _multipliers(own, proved, claim)


def _most(value: arb) -> float:
    return float(value.abs_upper())


def _primitive(orbit: Orbit, box: list[arb]) -> bool:
    """Return whether an orbit is certainly not a shorter one, repeated several times."""
    p, q = orbit.p, orbit.q
    return all(
        any(not (box[i + d] - box[i] - arb(q * d) / p).contains(0) for i in range(p - d))
        for d in range(1, p)
        if p % d == 0 and (q * d) % p == 0
    )


def _stable(proved: Proved) -> int | None:
    """Return whether both multipliers are inside the unit circle; None if it is not certain."""
    t, d = proved.cycle.trace.v, proved.cycle.determinant.v
    if abs(t) < 1 + d and abs(d) < 1:
        return YES
    return NO if abs(t) > 1 + d or abs(d) > 1 else None


def _admissible(orbit: Orbit, proved: Proved) -> int | None:
    """Return whether an orbit is admissible, in the codes of the result; None if uncertain."""
    found = proved.cycle
    if any(one.after.v <= orbit.rest and one.presses > 0 for one in found.flights):
        return RESTS
    if not found.obstacle:
        return YES
    leaves = all(one.after.v > orbit.rest for one in found.flights)
    return NO if leaves and any(_lands_earlier(orbit, proved, i) for i in range(orbit.p)) else None


def _lands_earlier(orbit: Orbit, proved: Proved, i: int) -> bool:
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
    own: xr.Dataset, proved: Proved, claim: Callable[[Jet, float], float]
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
