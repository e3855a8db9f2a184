"""Decay of the separation of two particles in one slot."""

from __future__ import annotations

from typing import Final

import numpy as np
import xarray as xr

from vibrosweep.analysis.datasets import per_realization, require, variable
from vibrosweep.analysis.records import moves, require_scene
from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.model.shapes import SINE, Waveform
from vibrosweep.scene.scene import stored
from vibrosweep.store.arranged import arranged

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
# Separations that are fitted, in forcing periods: larger ones depart from the linearised map by
# more than a part in a thousand, and smaller ones are as inexact by the rounding of landing times.
LARGEST: Final = 1e-4
SMALLEST: Final = 1e-9
FEWEST: Final = 8  # equations of a fit


def slot_decay(
    record: xr.Dataset, *, pair: tuple[int, int] = (0, 1), cycle_impacts: int = 1
) -> xr.Dataset:
    """Decay of the separation of two particles that settle in one slot, fitted and predicted.

    Near an orbit of p impacts the separations d_m seen at every p-th impact obey
    d_(m+2) = c_1 d_(m+1) + c_0 d_m, where the roots of z^2 - c_1 z - c_0 are the multipliers of
    the orbit, real or complex.  Both coefficients are fitted by least squares, each equation
    weighted by the size of its separations (Prony's method).  They are compared with the
    multipliers of the product of the Jacobians along the last p impacts:
    [[1, 1], [2 pi a c, e + 2 pi a c]], c = cos(2 pi x), over the high-bounce base; for another
    waveform w, its slope w' replaces 2 pi c.  :doc:`/model` has the Jacobian over the moving base.

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
        multiplier, per cycle; ``product_fitted``, which for an orbit without rests is e^p, or
        e^(2 p) over a moving base; ``equations`` in the fit; ``decay_time`` (s), in which the
        separation falls by the factor e = 2.718..., and ``closing_time`` (s), in which it falls
        from half a forcing period to the contact time, both as predicted.  Dims (realization,
        cycle): ``separation`` (s).  NaN where the two particles do not approach each other, or
        where there is a rest in the last cycle.

    Raises
    ------
    DataError
        The record lacks a variable.
    ParameterError
        There is no such pair, or no such cycle.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> from vibrosweep.analysis import slot_decay
    >>> found = slot_decay(vs.simulate(launch_time=[0.125, 0.13], duration=200.0))
    >>> found.modulus_predicted.values.round(3), found.modulus_fitted.values.round(3)
    (array([0.949]), array([0.949]))
    """
    record = arranged(record)
    require_scene(record, "slot_decay")
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
    named = zip(_NUMBERS.items(), numbers.T, strict=True)
    data = {name: variable(("realization",), values, *words) for (name, words), values in named}
    data["equations"] = data["equations"].astype(np.int64)
    data["separation"] = variable(
        ("realization", "cycle"), separation, "separation at every p-th impact", "s"
    )
    return xr.Dataset(data)


# Results of `_one`, with long name and unit
_NUMBERS: Final = {
    "modulus_fitted": ("modulus of the leading multiplier, fitted", "1"),
    "modulus_predicted": ("modulus of the leading multiplier, from the Jacobians", "1"),
    "product_fitted": ("product of the multipliers, fitted", "1"),
    "equations": ("separations fitted", "1"),
    "decay_time": ("time of decay by the factor e", "s"),
    "closing_time": ("time from half a period to the contact time", "s"),
}


def _one(
    record: xr.Dataset, realization: int, pair: tuple[int, int], p: int
) -> tuple[tuple[float, ...], Array]:
    """Return the numbers of `_NUMBERS` of one realization, and its separations in s."""
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
    if first.size > p and not rested and equations:
        turns = frequency * first[-p - 1 :] + phase / (2.0 * np.pi)
        a, shape = 2.0 * frequency * amplitude / gravity, stored(record.attrs)
        if moves(record):
            speed = 2.0 * frequency / gravity * one["rebound_velocity"].values[pair[0]]
            left = speed[first.size - p - 1 : first.size - 1]
            flights = zip(turns[:-1], turns[1:], left, strict=True)
            predicted = _leading([_moving_jacobian(*flight, e, a, shape) for flight in flights])
        else:
            predicted = _leading([_jacobian(x, e, a, shape) for x in turns[1:]])
    periods = np.ptp(first[-p - 1 :]) if first.size > p else np.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        decay_time = -periods / np.log(predicted)
    closing = decay_time * np.log(0.5 / (frequency * contact))
    return (fitted, predicted, product, float(equations), decay_time, closing), separation


def _separations(first: Array, second: Array) -> Array:
    """Signed separations of corresponding landings, which are counted back from the last ones."""
    if not first.size or not second.size:
        return np.empty(0)
    # start from the last landings that are nearest in time: one particle may have landed once more
    middle = min(first[-1], second[-1])
    i, j = (int(np.argmin(np.abs(t - middle))) for t in (first, second))
    count = min(i, j) + 1
    return second[j + 1 - count : j + 1] - first[i + 1 - count : i + 1]


def _fit(d: Array) -> tuple[float, float, int]:
    """Leading modulus, product and number of equations; separations in forcing periods."""
    size = np.maximum(np.abs(d[:-1]), np.abs(d[1:]))
    # the fit begins after the last separation that is too large for the linearised map
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


def _slope(x: float, a: float, shape: Waveform) -> float:
    """Derivative of the kick at phase x."""
    sine = shape == SINE
    return float(2.0 * np.pi * a * np.cos(2.0 * np.pi * x) if sine else a * shape.slope(x))


def _jacobian(x: float, e: float, a: float, shape: Waveform) -> Array:
    """Jacobian, in phase and speed, of a flight and the impact at phase x that ends it."""
    slope = _slope(x, a, shape)
    return np.array([[1.0, 1.0], [slope, e + slope]])


def _moving_jacobian(
    begin: float, end: float, u: float, e: float, a: float, shape: Waveform
) -> Array:
    """Jacobian over a moving base, for a flight of initial speed u between two phases.

    With s = end - begin and the relative speed of arrival z = 2 s - u + alpha w(end), the duration
    s has the derivatives alpha (w(begin) - w(end)) / z with respect to the phase `begin`, and s / z
    with respect to u; the next speed is e (2 s - u) + a w(end).
    """
    s, both = end - begin, np.array([begin, end])
    w = np.sin(2.0 * np.pi * both) if shape == SINE else shape.velocity(both)
    alpha = a / (1.0 + e)
    z = 2.0 * s - u + alpha * w[1]
    longer = np.array([alpha * (w[0] - w[1]) / z, s / z])
    phase = longer + np.array([1.0, 0.0])
    speed = e * (2.0 * longer - np.array([0.0, 1.0]))
    return np.stack([phase, speed + _slope(end, a, shape) * phase])


def _leading(jacobians: list[Array]) -> float:
    """Modulus of the leading multiplier of the product of the Jacobians of impacts."""
    product = np.eye(2)
    for jacobian in jacobians:
        product = jacobian @ product
    return float(np.max(np.abs(np.linalg.eigvals(product))))
