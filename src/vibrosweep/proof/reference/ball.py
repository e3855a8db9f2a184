"""Trajectories with proved error bounds, in ball arithmetic (python-flint's `arb`).

Parameters are taken as the exact doubles that they are.  The precision is doubled until every
branch is certain and every result is narrower than asked: the results are theorems about those
doubles, up to the correctness of FLINT.  The rules of the branches:

* A landing at t' counts if and only if t' <= duration.
* High-bounce base: a flight lasts 2 v / g.  With w = e v + A sin(2 pi f t' + phi), or its absolute
  value under the `reflect` law, the particle rests if and only if w <= v_rest = g tau_c / 2; else
  it leaves at once with v' = w.
* On this base a resting particle lifts off, with v' = v_rest, at the first t >= t' at which the
  kick A sin(2 pi f t + phi) rises through v_rest.  If A <= v_rest it never does.
* Moving base, of velocity A / (1 + e) sin(2 pi f t + phi): a flight ends at the first point where
  it meets the base, at once if it begins slower than the base, or as fast while the base presses
  the particle, 1 + Gamma cos(2 pi f t + phi) > 0.  After a landing with the relative speed z the
  particle leaves with e z; it rests if and only if e z <= v_rest and the base presses it.
* On this base a resting particle lifts off, with the velocity of the base, when the base begins to
  fall faster than gravity, cos(2 pi f t + phi) = -1 / Gamma and falling.  If Gamma <= 1 it never
  does.
* With noise, e v becomes (e + sigma_e xi) v, with the factor limited to [0, 1], plus
  (1 + e) sigma_V xi; over the moving base the modulus of this sum is taken.  In each forcing period
  A becomes A (1 + sigma_A xi).  A particle rests if and only if w <= v_rest; it leaves with v_rest,
  or over the moving base with the velocity of the base, as soon as the base alone lifts it.
* For another shape w of the motion, w replaces the sine, and its derivative the cosine; a particle
  is lifted at the next of possibly several phases.
* A particle that never lifts off again is at rest for good, and its trajectory ends.  A lift-off is
  reported with its landing even where it is later than the duration.

A comparison of equal numbers can be certain only if both are exact.  That is the case without
excitation (A = 0), for A against v_rest, and as long as every landing falls on a zero or a peak of
the sine.  Any other tie that involves a sine raises `UndecidableError`.

python-flint keeps its working precision in one place for the whole process, and it is set here: use
processes, not threads, to compute several trajectories at once.
"""

from __future__ import annotations

from fractions import Fraction
from functools import partial

from vibrosweep.model.parameters import NOISE
from vibrosweep.model.restitution_laws import CONSTANT
from vibrosweep.model.shapes import SINE, Waveform
from vibrosweep.proof.reference.bases import REFERENCE_OF
from vibrosweep.proof.reference.decisions import decided, first_precision
from vibrosweep.proof.reference.laws import Laws
from vibrosweep.proof.reference.motion import Deviates, Problem
from vibrosweep.proof.reference.orbit import attempt
from vibrosweep.proof.reference.results import Trajectory


def trajectory(
    *,
    launch_time: float | Fraction,
    duration: float | Fraction,
    base: str = "high-bounce",
    rebound: str = "rest",
    restitution_law: str = CONSTANT,
    waveform: Waveform = SINE,
    deviates: Deviates | None = None,
    max_impacts: int = 100_000,
    digits: int = 20,
    max_bits: int = 1 << 17,
    **parameters: float,
) -> Trajectory:
    """Every landing of one particle, with proved error bounds.

    The dimensionless trajectory (e, a, r, x0, u0) over some periods is the physical one with
    restitution e, amplitude a, frequency 1, phase 0, gravity 2, launch_velocity u0, contact_time r,
    launch_time x0 and duration in periods: velocities are then flight times.

    Parameters are all of `vibrosweep.model.parameters.PARAMETERS`, `restitution_speed` under a law
    that has one, and the strengths of noise, which also needs the deviates of the particle.  All
    are taken as exact; they come from a scene that was checked, and are not checked again.

    Landings at t <= duration (s) count; a `Fraction` gives a time exactly.  Radii are at most
    10**-digits times the larger of a velocity and v_rest, the larger of a time and the contact
    time, or one turn for a phase.

    Raises an UndecidableError where a decision stays uncertain at `max_bits`: a tie, or an orbit
    that loses more digits.
    """
    problem = Problem(
        dict.fromkeys(NOISE, 0.0) | {name: float(value) for name, value in parameters.items()},
        Fraction(launch_time),
        Fraction(duration),
        Laws(rebound, restitution_law, waveform),
        max_impacts,
        digits,
        deviates,
    )
    attempt_at = partial(attempt, problem, REFERENCE_OF[base].motion)
    return decided(attempt_at, first_precision(digits), max_bits)
