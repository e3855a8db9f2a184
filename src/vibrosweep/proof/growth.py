"""Growth of small perturbations along a proved orbit, with an error bound for the kernel's.

The kernel's orbit differs from the proved one by no more than the dataset's bounds, and its
Jacobians differ accordingly.  A change of a Jacobian changes the growth at that impact, and turns
the direction that is carried on: both effects are followed here to first order, and doubled to
cover the higher orders.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from vibrosweep.proof.reference._flint import arb
from vibrosweep.proof.reference.motion import EPS, PeriodMap
from vibrosweep.proof.reference.results import Flight

MOST_BLOCKS: Final = 32
TURNED: Final = 1e-3  # error of the direction beyond which the first-order estimate is useless
FIRST_ORDER: Final = 2.0


class Mean(NamedTuple):
    """Mean logarithm of the growth per impact."""

    value: float
    # Standard error of the mean, from the means of blocks; None below two blocks
    standard_error: float | None
    # Bound on the errors of both, from the dataset's bounds; None where there is none
    claim: float | None


def mean_growth(
    m: PeriodMap, phases: Sequence[arb], flights: Sequence[Flight], errors: tuple[float, float]
) -> Mean:
    """Mean growth of a perturbation of the phase alone, over one or more impacts without rests.

    The phases of successive lift-offs (turns) and the flights that follow them are proved; the
    kernel's phases and speeds may be off by `errors`.
    """
    c, s, turned, logarithms, wrongs = 1.0, 0.0, 0.0, [], []
    for x, flight in zip(phases, flights, strict=True):
        carried = m.carried(x, flight, (c, s), errors)
        (ax, ay), (bx, by) = carried.along, carried.across
        along = math.hypot(ax, ay)
        if along == 0.0:
            return Mean(-math.inf, 0.0, 0.0 if turned == 0.0 else None)
        wrong = carried.wrong / along
        logarithms.append(math.log(along))
        wrongs.append(abs(ax * bx + ay * by) / along**2 * turned + wrong + 4.0 * EPS)
        turned = abs(ax * by - ay * bx) / along**2 * turned + wrong
        c, s = ax / along, (-ay if carried.turned_back else ay) / along
        if not turned <= TURNED:
            return Mean(math.nan, None, None)
    claim = FIRST_ORDER * max(wrongs) + 2.0 * len(wrongs) * EPS * max(map(abs, logarithms))
    return Mean(math.fsum(logarithms) / len(logarithms), _standard_error(logarithms), claim)


def _standard_error(logarithms: Sequence[float]) -> float | None:
    """Standard error of a mean, from the means of fewer than `MOST_BLOCKS` blocks."""
    length = 1
    while len(logarithms) // length >= MOST_BLOCKS:
        length *= 2
    blocks = len(logarithms) // length
    if blocks < 2:
        return None
    means = [math.fsum(logarithms[b * length : (b + 1) * length]) / length for b in range(blocks)]
    middle = math.fsum(means) / blocks
    return math.sqrt(math.fsum((m - middle) ** 2 for m in means) / (blocks * (blocks - 1)))
