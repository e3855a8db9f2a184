"""Orbits that trajectories settle on, as `vibrosweep.kernels.settle` finds them."""

from __future__ import annotations

from typing import NamedTuple

from vibrosweep.kernels._jit import Complexes, Flags, Floats, Integers
from vibrosweep.kernels.unwritten import empty


class Orbits(NamedTuple):
    """Orbits that trajectories settle on, each array of shape (trajectory,)."""

    regime: Flags  # `vibrosweep.model.status.Regime`
    # impacts, periods, rests: impacts, forcing periods and rests in one cycle; 0 where no
    # recurrence was found
    impacts: Integers
    periods: Integers
    rests: Integers
    # 1 where rounding may have changed a decision along the cycle, 0 where it cannot have, -1 where
    # there is no cycle
    uncertain: Flags
    # Time in forcing periods from which on the orbit is known to repeat, of one with rests that of
    # the first lift-off from rest; NaN if it is not
    since: Floats
    # whole, phase, flight: a state from which the orbit can be continued: whole periods and phase
    # of a lift-off, and its speed relative to the base, in units of g / (2 f), which over a base at
    # rest is the duration of the flight that follows.  On a cycle, the representative: the state
    # with the smallest speed, which is the same for all particles on one orbit, up to rounding.  At
    # rest for good, the last landing, with a speed of 0.  NaN if the trajectory was not simulated.
    whole: Floats
    phase: Floats
    flight: Floats
    # The leading multiplier of the cycle, 0 if it has a rest; NaN where there is no cycle
    multiplier: Complexes
    # largest, largest_error: largest Lyapunov exponent per impact, and the standard error of its
    # mean, or the rounding error to first order where multipliers give it; -inf with error 0 of a
    # cycle with a rest, and at rest for good; NaN where the window sees one rest and no cycle is
    # closed.  The error is infinite where the cycle is uncertain.
    largest: Floats
    largest_error: Floats
    # total, total_error: sum of both exponents per impact, from the areas of the frames that are
    # carried along, and the bound of its rounding error; -inf with error 0 also without restitution
    total: Floats
    total_error: Floats


def empty_orbits(trajectories: int) -> Orbits:
    """Allocate the orbits of a batch."""
    return empty(Orbits, trajectories)
