"""Statistics of trajectories combined into those of their realizations."""

from __future__ import annotations

from vibrosweep.kernels._jit import kernel
from vibrosweep.kernels.statistics import Statistics

__all__ = ["combine"]


@kernel
def combine(first: int, last: int, particles: int, each: Statistics, out: Statistics) -> None:
    """Combine the particles of realizations first ... last - 1, in a fixed order.

    Parameters
    ----------
    first, last
        Range of realizations.
    particles
        Trajectories per realization.
    each : vibrosweep.kernels.statistics.Statistics
        Of the trajectories; realization i owns i * particles ... (i + 1) * particles - 1.
    out : vibrosweep.kernels.statistics.Statistics
        Of the realizations: sums, the largest maximum, the number of particles at rest for good
        and the worst status.
    """
    for i in range(first, last):
        landings, rests, at_rest, status = 0, 0, 0, 0
        total, squares, largest = 0.0, 0.0, 0.0
        for t in range(i * particles, (i + 1) * particles):
            landings += each.landings[t]
            rests += each.rests[t]
            at_rest += each.at_rest[t]
            total += each.flight_sum[t]
            squares += each.flight_squares[t]
            largest = max(largest, each.flight_max[t])
            status = max(status, each.status[t])
        out.landings[i] = landings
        out.rests[i] = rests
        out.at_rest[i] = at_rest
        out.flight_sum[i] = total
        out.flight_squares[i] = squares
        out.flight_max[i] = largest
        out.status[i] = status
