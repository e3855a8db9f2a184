"""Growth of small perturbations along a proved orbit, with an error bound for the kernel's.

The kernel's orbit is within the dataset's bounds of the proved one, and so are its Jacobians.  A
change of a Jacobian changes the growth at that impact, and turns the direction that is carried on:
both are followed here to first order, and doubled for what that leaves out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from vibrosweep.proof.reference._flint import arb
from vibrosweep.proof.reference.high_bounce import PeriodMap
from vibrosweep.proof.reference.results import Impact
from vibrosweep.proof.sample import Realization
from vibrosweep.proof.tolerances import EPS, Bounds

__all__ = ["Mean", "mean_growth"]

MOST_BLOCKS: Final = 32
TURNED: Final = 1e-3  # error of the direction beyond which the first-order estimate is useless
FIRST_ORDER: Final = 2.0


class Mean(NamedTuple):
    """Mean growth per impact.

    Attributes
    ----------
    value
        The mean logarithm.
    standard_error
        Its standard error from the means of blocks; None below two blocks.
    claim
        Bound of the error of either by the dataset's bounds; None where there is none.
    """

    value: float
    standard_error: float | None
    claim: float | None


def mean_growth(
    realization: Realization, bounds: Bounds, impacts: Sequence[Impact], flights: Sequence[arb]
) -> Mean:
    """Mean growth of a change of phase alone through impacts without rests, at least one.

    Parameters
    ----------
    realization
        The realization.
    bounds
        Bounds of the errors of the kernel's landings.
    impacts
        Proved, one after the other.
    flights
        The flight before each of them, forcing periods.
    """
    m = PeriodMap.of(realization.parameters, realization.rebound)
    frequency = realization.parameters["frequency"]
    phase_error = bounds.landing_time * frequency + 4.0 * EPS
    s_error, f_error = m.slope_errors(phase_error, bounds.flight_error(realization))
    s_error += 16.0 * math.pi * EPS * float(m.a)  # both computations round
    c, s, turned, logarithms, errors = 1.0, 0.0, 0.0, [], []
    for impact, flight in zip(impacts, flights, strict=True):
        k, f = (float(slope) for slope in m.slopes(impact.phase, flight))
        ax, ay = c + s, k * c + (f + k) * s
        bx, by = c - s, (f + k) * c - k * s
        along = math.hypot(ax, ay)
        if along == 0.0:
            return Mean(-math.inf, 0.0, 0.0 if turned == 0.0 else None)
        wrong = abs(c + s) * s_error + abs(s) * f_error
        wrong = (wrong + 32.0 * EPS * (2.0 + f + 2.0 * abs(k))) / along
        logarithms.append(math.log(along))
        errors.append(abs(ax * bx + ay * by) / along**2 * turned + wrong + 4.0 * EPS)
        turned = abs(ax * by - ay * bx) / along**2 * turned + wrong
        pushed = m.speed(impact.phase, flight) < 0
        c, s = ax / along, (-ay if pushed else ay) / along  # then the law turns it back
        if turned > TURNED:
            return Mean(math.nan, None, None)
    claim = FIRST_ORDER * max(errors) + 2.0 * len(errors) * EPS * max(map(abs, logarithms))
    return Mean(math.fsum(logarithms) / len(logarithms), _standard_error(logarithms), claim)


def _standard_error(logarithms: Sequence[float]) -> float | None:
    """Standard error of a mean by the means of blocks, of the shortest length with few enough."""
    length = 1
    while len(logarithms) // length >= MOST_BLOCKS:
        length *= 2
    blocks = len(logarithms) // length
    if blocks < 2:
        return None
    means = [math.fsum(logarithms[b * length : (b + 1) * length]) / length for b in range(blocks)]
    middle = math.fsum(means) / blocks
    return math.sqrt(math.fsum((m - middle) ** 2 for m in means) / (blocks * (blocks - 1)))
