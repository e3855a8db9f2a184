"""Bounces as equations between landing times, which a camera measures.

Gravity is known, so that the speeds before and after the bounce at t are
v = g (t - previous lift-off) / 2 and v' = g (next landing - t) / 2, and the map of a bounce

    v' = e v + S sin(2 pi f t) + C cos(2 pi f t),      S = A cos phi,   C = A sin phi

involves three neighbouring instants, which all have errors.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded, solve_banded, solveh_banded
from scipy.sparse import csr_array, diags_array

from vibrosweep.arrays import Array
from vibrosweep.lab.impacts import BOUNCED, DOUBTFUL
from vibrosweep.lab.regression import Speeds

# Half bandwidth of the covariance of the equations: a bounce shares an instant with the second
# bounce after it, and the errors of neighbouring instants are correlated.
BAND = 3


@dataclass(frozen=True)
class Bounces:
    """Instants of landing and lift-off in order, with the indices of the bounces."""

    # Landings and lift-offs of all particles, s; a bounce is one instant, a stay is two
    instant: Array
    # variance, covariance: of each instant, and of each with the next, s^2; shapes (instant,) and
    # (instant - 1,)
    variance: Array
    covariance: Array
    # Index in `instant` of each bounce, shape (bounce,): the instant before it is the lift-off that
    # began its flight, the one after it the next landing
    middle: NDArray[np.intp]
    gravity: float  # m s-2

    def speeds(self, instant: Array | None = None) -> Speeds:
        """Return time and speeds of each bounce, from other instants if these are given."""
        t = self.instant if instant is None else instant
        half, i = self.gravity / 2.0, self.middle
        return Speeds(half * (t[i] - t[i - 1]), half * (t[i + 1] - t[i]), t[i])

    def jacobian(self, before: Array, at: Array, after: Array) -> csr_array:
        """Derivatives of the equations by the instants, shape (bounce, instant).

        The arguments are the derivatives of each equation by the instant before its bounce, by the
        instant of the bounce, and by the one after it.
        """
        columns = self.middle[:, np.newaxis] + np.array([-1, 0, 1])
        entries = np.stack([before, at, after], axis=1).ravel()
        starts = np.arange(0, entries.size + 1, 3)
        shape = (self.middle.size, self.instant.size)
        return csr_array((entries, columns.ravel(), starts), shape=shape)

    @property
    def errors(self) -> csr_array:
        """Covariance of the instants, s^2."""
        diagonals = [self.covariance, self.variance, self.covariance]
        return diags_array(diagonals, offsets=[-1, 0, 1]).tocsr()  # type: ignore[arg-type]


def bounces_of(impacts: xr.Dataset) -> Bounces:
    """Gather the bounces of a result of `find_impacts` that have a whole flight on either side."""
    landed = np.arange(impacts.sizes["impact"]) < impacts["impact_count"].values[:, np.newaxis]

    def column(name: str) -> Array:
        return np.asarray(impacts[name].values[landed])

    quality, instants = column("quality"), ("landing_time", "liftoff_time")
    bounced = quality == BOUNCED
    # landing and lift-off are one instant at a bounce, two at a stay on the base
    single = np.stack([np.ones_like(bounced), ~bounced], axis=1)
    instant = np.stack([column(name) for name in instants], axis=1)
    error = np.stack([column(f"{name}_error") for name in instants], axis=1)
    link = np.nan_to_num(column("next_covariance"))
    link = np.stack([np.where(bounced, link, 0.0), link], axis=1)
    # the flight after the last landing of a particle is not seen
    seen = np.isfinite(column("flight_time"))
    sound = (quality != DOUBTFUL) & np.isfinite(instant[:, 0])
    whole = bounced & seen & np.append(sound, False)[1:]
    whole &= np.append(False, seen & sound)[:-1]
    return Bounces(
        instant[single],
        error[single] ** 2,
        link[single][:-1],
        np.cumsum(single)[::2][whole] - 1,
        impacts.attrs["gravity"],
    )


def solve(matrix: csr_array, right: Array) -> Array:
    """Solve a system whose symmetric positive definite matrix has the half bandwidth `BAND`."""
    return np.asarray(solveh_banded(_band(matrix), right, lower=True))


def whiten(matrix: csr_array, right: Array) -> Array:
    """Transform columns to independent ones of variance 1; `matrix` is their covariance."""
    factor = cholesky_banded(_band(matrix), lower=True)
    return np.asarray(solve_banded((len(factor) - 1, 0), factor, right))


def _band(matrix: csr_array) -> Array:
    size = matrix.shape[0]
    band = np.zeros((BAND + 1, size))
    for k in range(min(BAND + 1, size)):
        band[k, : size - k] = matrix.diagonal(-k)
    return band
