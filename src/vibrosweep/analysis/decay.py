"""How fast two particles in one slot approach each other."""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr

from vibrosweep.analysis.records import Array, per_realization, variable
from vibrosweep.analysis.requirements import require
from vibrosweep.errors import ParameterError

__all__ = ["slot_decay"]

NEEDS: Final = (
    "landing_time",
    "rested",
    "restitution",
    "amplitude",
    "frequency",
    "phase",
    "gravity",
    "contact_time",
)
# Separations in forcing periods that are fitted: below these they decay as the linearised map
# does, to a part in a thousand, and above these the rounding of a landing time is as small.
LARGEST: Final = 1e-4
SMALLEST: Final = 1e-9
FEWEST: Final = 8


def slot_decay(
    record: xr.Dataset, *, pair: tuple[int, int] = (0, 1), cycle_impacts: int = 1
) -> xr.Dataset:
    """Decay of the separation of two particles that settle in one slot, fitted and predicted.

    Near an orbit of p impacts the separations d_m seen at every p-th impact obey
    d_(m+2) = c_1 d_(m+1) + c_0 d_m, where the roots of z^2 - c_1 z - c_0 are the multipliers of
    the orbit, real or complex.  Both coefficients are fitted by least squares, each equation
    weighted by the size of its separations (Prony's method).  Beside them stand the multipliers of
    the product of the Jacobians [[1, 1], [2 pi a c, e + 2 pi a c]], c = cos(2 pi x), along the
    last p impacts.

    Parameters
    ----------
    record
        Record of every landing, as `simulate` returns it.
    pair
        Two particles, by position.
    cycle_impacts
        Impacts p in a cycle of the orbit.

    Returns
    -------
    xarray.Dataset
        Dim ``realization``: ``modulus_fitted`` and ``modulus_predicted`` of the leading
        multiplier, per cycle; ``product_fitted``, which for an orbit without rests is e^p;
        ``equations`` in the fit; ``decay_time`` (s), in which the separation falls by the factor
        e = 2.718..., and ``closing_time`` (s), in which it falls from half a forcing period to the
        contact time, both as predicted.  Dims (realization, cycle): ``separation`` (s).  NaN where
        the two do not approach each other, or where there is a rest in the last cycle.

    Raises
    ------
    DataError
        The record lacks a variable.
    ParameterError
        There is no such pair, or no such cycle.
    """
    require(record, "slot_decay", *NEEDS)
    particles = record.sizes["particle"]
    if cycle_impacts < 1:
        raise ParameterError(f"cycle_impacts = {cycle_impacts}: must be at least 1")
    if not all(0 <= i < particles for i in pair) or pair[0] == pair[1]:
        raise ParameterError(
            f"pair = {pair}: must be two different particles from 0 to {particles - 1}"
        )
    found = [_one(record, i, pair, cycle_impacts) for i in range(record.sizes["realization"])]
    numbers = np.array([f[0] for f in found])
    longest = max(f[1].size for f in found)
    separation = np.array(
        [np.pad(f[1], (0, longest - f[1].size), constant_values=np.nan) for f in found]
    )
    dims = ("realization",)
    return xr.Dataset(
        {
            "modulus_fitted": variable(
                dims, numbers[:, 0], "modulus of the leading multiplier, fitted"
            ),
            "modulus_predicted": variable(
                dims, numbers[:, 1], "modulus of the leading multiplier, from the Jacobians"
            ),
            "product_fitted": variable(dims, numbers[:, 2], "product of the multipliers, fitted"),
            "equations": variable(dims, numbers[:, 3].astype(np.int64), "separations fitted"),
            "decay_time": variable(dims, numbers[:, 4], "time of decay by the factor e", "s"),
            "closing_time": variable(
                dims, numbers[:, 5], "time from half a period to the contact time", "s"
            ),
            "separation": variable(
                ("realization", "cycle"), separation, "separation at every p-th impact", "s"
            ),
        }
    )


def _one(
    record: xr.Dataset, realization: int, pair: tuple[int, int], p: int
) -> tuple[tuple[float, ...], Array]:
    """Fit, prediction and times of one realization, and the separations in s."""
    e, amplitude, frequency, phase, gravity, contact = (
        float(per_realization(record, name)[realization]) for name in NEEDS[2:]
    )
    one = record.isel(realization=realization)
    times = one["landing_time"].values
    first, second = (times[i][np.isfinite(times[i])] for i in pair)
    separation = _separations(first, second)[::p]
    fitted, product, equations = _fit(separation * frequency)
    rested = one["rested"].values[pair[0]][: first.size][-p:].any()
    predicted = np.nan
    if first.size >= p and not rested and equations:
        turns = frequency * first[-p:] + phase / (2.0 * np.pi)
        predicted = _leading(turns, e, 2.0 * frequency * amplitude / gravity)
    periods = np.ptp(first[-p - 1 :]) if first.size > p else np.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        decay_time = -periods / np.log(predicted)
    closing = decay_time * np.log(0.5 / (frequency * contact))
    return (fitted, predicted, product, float(equations), decay_time, closing), separation


def _separations(first: Array, second: Array) -> Array:
    """Signed separations of landings that belong together at the end of the observation."""
    if not first.size or not second.size:
        return np.empty(0)
    # the landings nearest to each other there; one of the two may have landed once more
    middle = min(first[-1], second[-1])
    i, j = (int(np.argmin(np.abs(t - middle))) for t in (first, second))
    count = min(i, j) + 1
    return second[j + 1 - count : j + 1] - first[i + 1 - count : i + 1]


def _fit(d: Array) -> tuple[float, float, int]:
    """Leading modulus, product and number of equations; separations in forcing periods."""
    size = np.maximum(np.abs(d[:-1]), np.abs(d[1:]))
    # from the last separation that is too large for the linearised map on
    begin = int(np.max(np.flatnonzero(np.abs(d) > LARGEST), initial=-1)) + 1
    small = np.flatnonzero(size[begin:] < SMALLEST)
    end = begin + int(small[0]) if small.size else size.size
    rows = np.arange(begin, max(end - 1, begin))
    if rows.size < FEWEST:
        return np.nan, np.nan, 0
    weight = 1.0 / size[rows]
    columns = np.stack([d[rows + 1] * weight, d[rows] * weight], axis=1)
    (c1, c0), *_ = np.linalg.lstsq(columns, d[rows + 2] * weight, rcond=None)
    roots = np.roots([1.0, -c1, -c0])
    return float(np.max(np.abs(roots))), float(-c0), int(rows.size)


def _leading(turns: Array, e: float, a: float) -> float:
    """Modulus of the leading multiplier of the product of the Jacobians of impacts."""
    product = np.eye(2)
    for slope in 2.0 * np.pi * a * np.cos(2.0 * np.pi * turns):
        product = np.array([[1.0, 1.0], [slope, e + slope]]) @ product
    return float(np.max(np.abs(np.linalg.eigvals(product))))
