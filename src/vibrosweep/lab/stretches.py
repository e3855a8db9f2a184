"""Cut tracks into stretches of free flight, without the height of the base.

The function y + g t^2 / 2 of a particle is a straight line in flight, bends upwards on the base and
has a kink at a bounce.  The cut into straight lines that minimises chi-square plus a fixed penalty
for each line is found exactly (optimal partitioning, Jackson et al. 2005, IEEE Signal Process.
Lett. 12, 105).
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.special import chdtri

from vibrosweep.arrays import Flags, Indices
from vibrosweep.kernels._jit import Floats, kernel
from vibrosweep.lab.flights import Fits, curvatures, fit_parabolas
from vibrosweep.lab.segments import Samples, rough_noise

# Penalty of a line in units of chi-square, with which noise adds one cut in hundreds of flights
PRICE: Final = 25.0
# Standard deviations by which chi-square may exceed its mean for a stretch to be a line
BENT: Final = 6.0
ROUNDS: Final = 3
LOW: Final = 0.25  # quantile of the residuals of stretches from which the noise is estimated
# Standard errors by which the acceleration of a flight may differ from gravity, and by which
# gravity must differ from zero, the acceleration of a stay on a base at rest
FALLS: Final = 3.5
SEEN: Final = 5.0


@kernel
def _partition(
    time: Floats, height: Floats, variance: float, gravity: float, starts: Flags
) -> None:
    """Mark the samples at which the lines of the best partition begin."""
    begin = np.empty(time.size, np.int64)  # of the last line in the best partition up to a sample
    cost = np.full(time.size + 1, np.inf)
    cost[0] = 0.0
    for last in range(time.size):
        # the sums are over a line that grows backwards, so that no large numbers cancel
        count, mean_t, mean_z, tt, tz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for first in range(last, -1, -1):
            since = time[first] - time[last]
            z = height[first] - height[last] + 0.5 * gravity * since * since
            count += 1.0
            off_t, off_z = since - mean_t, z - mean_z
            mean_t += off_t / count
            mean_z += off_z / count
            tt += off_t * (since - mean_t)
            tz += off_t * (z - mean_z)
            zz += off_z * (z - mean_z)
            free = count - 2.0
            residue = max(zz - tz * tz / tt, 0.0) / variance if free > 0.0 else 0.0
            if free > 0.0 and residue > free + BENT * math.sqrt(2.0 * free) + PRICE:
                break
            total = cost[first] + residue + PRICE
            if total < cost[last + 1]:
                cost[last + 1] = total
                begin[last] = first
    k = time.size
    while k > 0:
        k = begin[k - 1]
        starts[k] = True


def stretches(samples: Samples, gravity: float) -> tuple[Indices, float]:
    """Cut each piece of track into lines.

    Returns the number of the stretch of each sample, rising, and the standard deviation of a sample
    in m, from the residuals of the lines.
    """
    noise = max(rough_noise(samples), 1e-9 * float(np.ptp(samples.height)))
    member = np.zeros(samples.time.size, np.intp)
    for _ in range(ROUNDS):
        starts = np.zeros(samples.time.size, bool)
        for begin, end in pairwise(samples.bounds):
            piece = slice(begin, end)
            time, height = samples.time[piece], samples.height[piece]
            _partition(time, height, noise**2, gravity, starts[piece])
        member = np.cumsum(starts) - 1
        fits = fit_parabolas(samples, member, int(member[-1]) + 1, gravity)
        free = fits.number - 2.0
        long = free > 1.0
        if not long.any():
            break
        # a low quantile, because stretches that are not lines have large residuals
        ratio = fits.residue[long] / chdtri(free[long], 1.0 - LOW)
        found = math.sqrt(float(np.quantile(ratio, LOW)))
        noise = max(found, 1e-9 * float(np.ptp(samples.height)))
    return member, noise


def clear_flights(
    samples: Samples, member: Indices, fits: Fits, noise: float, fall: float
) -> Flags:
    """Mark the stretches that fall as flights do and stays do not; shape (stretch,).

    `member` is that of `stretches`, `noise` the standard deviation of a sample (m), `fall` the
    acceleration of free flight (m s-2).
    """
    acceleration, weight = curvatures(samples, member, fits.number.size)
    with np.errstate(invalid="ignore", divide="ignore"):
        error = noise / np.sqrt(weight)
    return np.asarray((np.abs(acceleration - fall) < FALLS * error) & (fall > SEEN * error))
