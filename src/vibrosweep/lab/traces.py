"""Measured motion of the base, from its track or an accelerometer, fitted by harmonics.

The trace is a constant and harmonics 1 to H of one frequency.  H, from 1 (a sine) to 16, and the
frequency among simple fractions of that of the sine, make Schwarz's information criterion

    n ln(residual / n) + (2 H + 2) ln n

of n values least; the residual is never taken below that of values rounded to the resolution of the
trace, whose steps repeat with the motion and look like harmonics.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular
from scipy.signal import periodogram

from vibrosweep.arrays import Array
from vibrosweep.errors import TrackError, require_one_of
from vibrosweep.lab.oscillation import Trace
from vibrosweep.lab.regression import TWO_PI
from vibrosweep.lab.tracks import check_size, rate_of
from vibrosweep.model.shapes import MOST_HARMONICS
from vibrosweep.scene.traces import waves

__all__ = ["QUANTITIES", "make_trace", "read_trace"]

QUANTITIES: Final = ("height", "acceleration")
FEWEST: Final = 20
# Largest share of the variance that harmonics may leave unexplained.
UNEXPLAINED: Final = 0.1
FEWEST_PERIODS: Final = 2.0  # of a motion that is no sine
STEPS: Final = 20  # most steps towards the frequency
CLOSE: Final = 1e-10  # last step, in periods over the length of the trace
SAME: Final = 1e-9  # difference of two values, relative to their range, that is rounding
LEAST: Final = 1e-30  # least change of a height (m) or acceleration (m s-2) that counts


def read_trace(path: str | os.PathLike[str]) -> Trace:
    """Read a measured motion of the base, from its track or from an accelerometer.

    Parameters
    ----------
    path
        A CSV file with the columns ``time`` (s, on the clock of the tracks) and ``height`` (m) or
        ``acceleration`` (m s-2).

    Returns
    -------
    Trace
        The fitted motion, for the argument `trace` of `find_impacts`: ``values`` S, C (m s-1) and f
        (Hz), and of a motion that is no sine S and C of other harmonics; their ``covariance``; and
        the ``numbers`` h of the harmonics, that of the strongest first.  The base has the velocity
        sum S sin 2 pi h f t + C cos 2 pi h f t.

    Raises
    ------
    TrackError
        The file cannot be read, has other columns, or does not repeat.

    Examples
    --------
    >>> import tempfile, numpy as np, pandas as pd, vibrosweep as vs
    >>> time = np.arange(0.0, 2.0, 1e-3)
    >>> shaken = pd.DataFrame({"time": time, "acceleration": 4.0 * np.sin(40.0 * np.pi * time)})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     shaken.to_csv(f"{folder}/base.csv", index=False)
    ...     sine, cosine, frequency = vs.lab.read_trace(f"{folder}/base.csv").values
    >>> round(float(frequency), 6)
    20.0
    """
    import pandas as pd

    source = str(Path(path))
    try:
        table = pd.read_csv(path)
    except OSError as error:
        raise TrackError(f"{source}: cannot be read ({error.strerror})") from error
    except (ValueError, UnicodeDecodeError) as error:
        raise TrackError(f"{source}: is no table of values ({error})") from error
    found = [name for name in QUANTITIES if name in table.columns]
    if "time" not in table.columns or len(found) != 1:
        raise TrackError(
            f"{source}: has the columns {', '.join(map(str, table.columns))}; must have time and "
            f"one of {', '.join(QUANTITIES)}"
        )
    numbers = table[["time", found[0]]].apply(pd.to_numeric, errors="coerce").dropna()
    return make_trace(numbers["time"], numbers[found[0]], found[0], source)


def make_trace(
    time: ArrayLike, values: ArrayLike, quantity: str, source: str = "the trace"
) -> Trace:
    """Fit harmonics and a constant to the measured height (m) or acceleration (m s-2) of a base.

    Times (s) rise, at a nearly steady rate; `quantity` is one of `QUANTITIES`, `source` a name in
    messages.  Raises a TrackError where there are too few values, the times do not rise, or no
    harmonics describe them.
    """
    when, measured = (np.asarray(v, dtype=np.float64) for v in (time, values))
    require_one_of("quantity", quantity, QUANTITIES, TrackError)
    if when.size < FEWEST or not (np.diff(when) > 0.0).all() or not np.isfinite(measured).all():
        raise TrackError(
            f"{source}: must hold at least {FEWEST} finite values at rising times, but has "
            f"{when.size}"
        )
    sampled = rate_of(when, source)
    check_size(quantity, measured, source)
    if not np.ptp(measured) > LEAST:
        raise TrackError(
            f"{source}: the {quantity} does not change: leave the trace out, and say that the base "
            f"stays at its level"
        )
    rates, power = periodogram(measured - measured.mean(), sampled)
    first = float(rates[1:][np.argmax(power[1:])])
    middle = float(when.mean())  # the errors of phase and frequency are then almost independent
    first, harmonics = _chosen(when - middle, measured, first, sampled)
    fit = _fit(when - middle, measured, first, harmonics)
    if fit.rate * np.ptp(when) < 1.0:  # a part of a period also fits a drift, for example
        raise TrackError(
            f"{source}: the {quantity} goes through no whole period of a sine: check the columns, "
            f"take a longer trace, or leave it out and let the landings tell"
        )
    if not fit.variance < UNEXPLAINED * measured.var():
        raise TrackError(
            f"{source}: {'a sine leaves' if harmonics == 1 else f'{harmonics} harmonics leave'} "
            f"{100.0 * fit.variance / measured.var():.0f} % of the variance of the {quantity}; at "
            f"most {100.0 * UNEXPLAINED:.0f} % is taken for noise. Only a base whose motion "
            f"repeats can be used: check the columns, or leave the trace out and let the "
            f"landings tell"
        )
    return _velocities(fit, middle, quantity)


def trace_of_mark(tracks: xr.Dataset, exposure: float) -> Trace:
    """Fit harmonics to the ``base_height`` of tracks, the mean over an exposure (s) at each frame.

    Raises the errors of `make_trace`.
    """
    height = tracks["base_height"].values
    seen, source = np.isfinite(height), f"{tracks.attrs['source']}, the mark on the base"
    one = make_trace(tracks["time"].values[seen], height[seen], "height", source)
    left = np.sinc(np.repeat(one.numbers, 2) * one.values[2] * exposure)  # of each harmonic
    left = np.insert(left, 2, 1.0)
    return Trace(one.values / left, one.covariance / np.outer(left, left), one.numbers)


class _Fit(NamedTuple):
    """Harmonics fitted to a trace."""

    rate: float  # Hz
    coefficients: Array  # of the constant, then of cosine and sine of each harmonic
    slopes: Array  # derivatives of the fitted values by these and by the frequency
    parts: Array  # of the values along the same waves, made orthonormal one after the other
    variance: float  # of the residuals


def _fit(since: Array, measured: Array, rate: float, harmonics: int) -> _Fit:
    """Fit harmonics of a frequency near `rate` by steps of Gauss and Newton."""
    numbers = np.arange(1, harmonics + 1)
    for _ in range(STEPS):
        design = np.column_stack([np.ones_like(since), waves(since, rate, harmonics)])
        # they are nearly orthogonal, so that their normal equations lose no digits
        root = np.linalg.cholesky(_products(design, design))
        parts = solve_triangular(root, _products(design, measured), lower=True)
        found = solve_triangular(root.T, parts)
        turned = np.column_stack([numbers * found[2::2], -numbers * found[1::2]]).ravel()
        # of the fitted values by the frequency; einsum, unlike BLAS, starts no threads
        slope = TWO_PI * since * np.einsum("nk,k->n", design[:, 1:], turned)
        along = solve_triangular(root, _products(design, slope), lower=True)
        change = float((slope @ measured - along @ parts) / (slope @ slope - along @ along))
        if not abs(change) * np.ptp(since) > CLOSE or not rate + change > 0.0:
            break
        rate += change
    left = measured - np.einsum("nk,k->n", design, found)
    freedom = since.size - 2 * harmonics - 2
    slopes = np.column_stack([design, slope])
    return _Fit(rate, found, slopes, parts, float(left @ left / freedom))


def _chosen(since: Array, measured: Array, first: float, sampled: float) -> tuple[float, int]:
    """Frequency near which the motion repeats, and number of its harmonics.

    `first` is the frequency of the strongest one, `sampled` the number of values per second.
    """
    number, span = since.size, float(np.ptp(since))
    measured = measured - measured.mean()
    steps = np.diff(np.unique(measured))
    floor = float(steps[steps > SAME * np.ptp(measured)].min()) ** 2 / 12.0
    trials = [(_schwarz(_fit(since, measured, first, 1).variance, floor, number, 1), first, 1)]
    for part in range(1, MOST_HARMONICS + 1):
        rate = first / part
        # as many harmonics as there are values in a period, less one
        most = min(MOST_HARMONICS, int((sampled / rate - 1.0) / 2.0), (number - 3) // 4)
        if most < max(part, 2) or rate * span < FEWEST_PERIODS:
            continue
        one = _fit(since, measured, rate, most)
        held = np.cumsum(one.parts**2)
        for harmonics in range(max(part, 2), most + 1):
            residual = measured @ measured - held[2 * harmonics]
            variance = float(residual) / (number - 2 * harmonics - 2)
            trials.append((_schwarz(variance, floor, number, harmonics), one.rate, harmonics))
    _, rate, harmonics = min(trials)
    return rate, harmonics


def _products(columns: Array, others: Array) -> Array:
    """Products of columns with columns, by pieces so short that BLAS starts no threads."""
    pieces = len(columns) // 250 + 1
    pairs = zip(np.array_split(columns, pieces), np.array_split(others, pieces), strict=True)
    return np.asarray(sum(piece.T @ other for piece, other in pairs))


def _schwarz(variance: float, floor: float, number: int, harmonics: int) -> float:
    """Schwarz's criterion of a fit that leaves a variance of the residuals."""
    return float(number * np.log(max(variance, floor)) + (2 * harmonics + 2) * np.log(number))


def _velocities(fit: _Fit, middle: float, quantity: str) -> Trace:
    """Harmonics of the velocity on the clock of the trace, from those of the quantity.

    The clock of the fit is zero in the `middle`.
    """
    pairs, rate = fit.coefficients[1:].reshape(-1, 2), fit.rate
    # y = c cos + s sin has V = w (s cos - c sin); a = c cos + s sin has V = (c sin - s cos) / w
    sign, power_of = (-1.0, 1.0) if quantity == "height" else (1.0, -1.0)
    sizes = np.hypot(*pairs.T) * np.arange(1.0, len(pairs) + 1.0) ** power_of
    strongest = int(sizes.argmax())
    order = [strongest, *(k for k in range(len(pairs)) if k != strongest)]
    values, change = np.zeros(pairs.size), np.zeros((pairs.size, pairs.size + 2))
    for place, k in enumerate(order):
        h, row = k + 1, slice(2 * place, 2 * place + 2)
        size = sign * (TWO_PI * rate * h) ** power_of
        turned = TWO_PI * middle * rate * h
        cosine, sine = np.cos(turned), np.sin(turned)
        turn = size * np.array([[cosine, -sine], [-sine, -cosine]])  # to S and C
        turning = size * np.array([[-sine, -cosine], [-cosine, sine]])
        values[row] = turn @ pairs[k]
        change[row, 1 + 2 * k : 3 + 2 * k] = turn
        change[row, -1] = TWO_PI * middle * h * turning @ pairs[k] + values[row] * power_of / rate
    values = np.insert(values, 2, rate)
    change = np.insert(change, 2, np.eye(pairs.size + 2)[-1], axis=0)
    covariance = fit.variance * np.linalg.inv(_products(fit.slopes, fit.slopes))
    return Trace(values, change @ covariance @ change.T, tuple(k + 1 for k in order))
