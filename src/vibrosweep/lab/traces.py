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
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares
from scipy.signal import periodogram

from vibrosweep.arrays import Array
from vibrosweep.errors import TrackError
from vibrosweep.lab.oscillation import Trace
from vibrosweep.lab.regression import TURN
from vibrosweep.lab.tracks import check_size, rate_of
from vibrosweep.model.shapes import MOST_HARMONICS

__all__ = ["QUANTITIES", "make_trace", "read_trace"]

QUANTITIES: Final = ("height", "acceleration")
FEWEST: Final = 20
# Largest share of the variance that harmonics may leave unexplained.
UNEXPLAINED: Final = 0.1
FEWEST_PERIODS: Final = 2.0  # of a motion that is no sine
STEPS: Final = 3  # towards the frequency, each of which squares its error
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
    if quantity not in QUANTITIES:
        raise TrackError(f"quantity = {quantity!r}: must be one of {', '.join(QUANTITIES)}")
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
    fitted, slopes, variance = _fit(when - middle, measured, first, harmonics)
    periods = float(fitted[3]) * float(np.ptp(when))
    if periods < 1.0:  # a part of a period also fits a drift, for example
        raise TrackError(
            f"{source}: the {quantity} goes through no whole period of a sine: check the columns, "
            f"take a longer trace, or leave it out and let the landings tell"
        )
    if not variance < UNEXPLAINED * measured.var():
        raise TrackError(
            f"{source}: {'a sine leaves' if harmonics == 1 else f'{harmonics} harmonics leave'} "
            f"{100.0 * variance / measured.var():.0f} % of the variance of the {quantity}; at most "
            f"{100.0 * UNEXPLAINED:.0f} % is taken for noise. Only a base whose motion repeats can "
            f"be used: check the columns, or leave the trace out and let the landings tell"
        )
    covariance = np.asarray(variance * np.linalg.inv(slopes.T @ slopes))
    return _velocities(fitted, covariance, middle, quantity)


def _design(since: Array, rate: float, harmonics: int) -> Array:
    """Sine, cosine and constant, then sines and cosines of the other harmonics."""
    angle = TURN * rate * since
    others = [wave(h * angle) for h in range(2, harmonics + 1) for wave in (np.sin, np.cos)]
    return np.stack([np.sin(angle), np.cos(angle), np.ones_like(angle), *others], axis=1)


def _fit(since: Array, measured: Array, first: float, harmonics: int) -> tuple[Array, Array, float]:
    """Coefficients of the `_design`, with the frequency after the constant.

    Also returns the derivatives of the residuals by them, and the variance of the residuals.
    """

    def left(values: Array) -> Array:
        waves = _design(since, float(values[3]), harmonics)
        return np.asarray(waves @ np.delete(values, 3) - measured)

    start = np.linalg.lstsq(_design(since, first, harmonics), measured, rcond=None)[0]
    scale = np.full(start.size + 1, np.ptp(measured))
    scale[3] = 0.1 / np.ptp(since)
    found = least_squares(left, np.insert(start, 3, first), x_scale=scale, xtol=1e-14)
    return found.x, np.asarray(found.jac), float(2.0 * found.cost / (since.size - scale.size))


def _chosen(since: Array, measured: Array, first: float, sampled: float) -> tuple[float, int]:
    """Frequency near which the motion repeats, and number of its harmonics.

    `first` is the frequency of the strongest one, `sampled` the number of values per second.
    """
    number, span = since.size, float(np.ptp(since))
    measured = measured - measured.mean()
    steps = np.diff(np.unique(measured))
    floor = float(steps[steps > SAME * np.ptp(measured)].min()) ** 2 / 12.0
    trials = [(_schwarz(_fit(since, measured, first, 1)[2], floor, number, 1), first, 1)]
    for part in range(1, MOST_HARMONICS + 1):
        rate = first / part
        # as many harmonics as there are values in a period, less one
        most = min(MOST_HARMONICS, int((sampled / rate - 1.0) / 2.0), (number - 3) // 4)
        if most < max(part, 2) or rate * span < FEWEST_PERIODS:
            continue
        rate, parts = _refined(since, measured, rate, most)
        held = np.cumsum(parts**2)
        for harmonics in range(max(part, 2), most + 1):
            residual = measured @ measured - held[2 * harmonics]
            variance = float(residual) / (number - 2 * harmonics - 2)
            trials.append((_schwarz(variance, floor, number, harmonics), rate, harmonics))
    _, rate, harmonics = min(trials)
    return rate, harmonics


def _refined(since: Array, measured: Array, rate: float, harmonics: int) -> tuple[float, Array]:
    """Frequency that leaves the least residual, by steps of Gauss and Newton from a near one.

    Also returns the parts of the values along the waves of the `_design`, made orthonormal one
    after the other.
    """
    for turn in range(STEPS + 1):
        waves = _design(since, rate, harmonics)
        # they are nearly orthogonal, so that their normal equations lose no digits
        root = np.linalg.cholesky(_products(waves, waves))
        parts = solve_triangular(root, _products(waves, measured), lower=True)
        if turn < STEPS:
            pairs = np.delete(solve_triangular(root.T, parts), 2).reshape(-1, 2)
            angle = TURN * rate * since
            slope = np.zeros_like(since)  # of the fitted values by the frequency
            for h, (p, q) in enumerate(pairs, 1):
                slope += TURN * h * since * (p * np.cos(h * angle) - q * np.sin(h * angle))
            along = solve_triangular(root, _products(waves, slope), lower=True)
            free = slope @ slope - along @ along
            rate += float(slope @ measured - along @ parts) / float(free)
    return rate, parts


def _products(waves: Array, others: Array) -> Array:
    """Products of columns with columns, by pieces so short that BLAS starts no threads."""
    pieces = len(waves) // 250 + 1
    pairs = zip(np.array_split(waves, pieces), np.array_split(others, pieces), strict=True)
    return np.asarray(sum(piece.T @ other for piece, other in pairs))


def _schwarz(variance: float, floor: float, number: int, harmonics: int) -> float:
    """Schwarz's criterion of a fit that leaves a variance of the residuals."""
    return float(number * np.log(max(variance, floor)) + (2 * harmonics + 2) * np.log(number))


def _velocities(fitted: Array, covariance: Array, middle: float, quantity: str) -> Trace:
    """Harmonics of the velocity on the clock of the trace, from those of the quantity.

    `fitted` and its covariance are those of `_fit`, on a clock that is zero in the `middle`.
    """
    rate = float(fitted[3])
    pairs = np.delete(fitted, [2, 3]).reshape(-1, 2)
    # y = p sin + q cos has V = w (p cos - q sin); a = p sin + q cos has V = (-p cos + q sin) / w
    sign, power_of = (-1.0, 1.0) if quantity == "height" else (1.0, -1.0)
    values, change = np.zeros(fitted.size - 1), np.zeros((fitted.size - 1, fitted.size))
    sizes = np.hypot(*pairs.T) * np.arange(1.0, len(pairs) + 1.0) ** power_of
    strongest = int(sizes.argmax())
    order = [strongest, *(k for k in range(len(pairs)) if k != strongest)]
    for place, k in enumerate(order):
        h = k + 1
        size = sign * (TURN * rate * h) ** power_of
        turned = TURN * middle * rate * h
        cosine, sine = np.cos(turned), np.sin(turned)
        centred = size * np.array([pairs[k][1], -pairs[k][0]])  # S and C on the centred clock
        turn = np.array([[cosine, sine], [-sine, cosine]])
        turning = np.array([[-sine, cosine], [-cosine, -sine]]) @ centred
        row = slice(2 * place + (place > 0), 2 * place + (place > 0) + 2)
        column = slice(2 * k + 2 * (k > 0), 2 * k + 2 * (k > 0) + 2)
        values[row] = turn @ centred
        change[row, column] = size * turn @ np.array([[0.0, 1.0], [-1.0, 0.0]])
        change[row, 3] = TURN * middle * h * turning + turn @ centred * power_of / rate
    values[2], change[2, 3] = rate, 1.0
    return Trace(values, change @ covariance @ change.T, tuple(k + 1 for k in order))
