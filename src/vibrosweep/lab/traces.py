"""Measured motion of the base, from its track or an accelerometer, fitted by an oscillation."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.signal import periodogram

from vibrosweep.errors import TrackError
from vibrosweep.lab.oscillation import Trace
from vibrosweep.lab.regression import TURN
from vibrosweep.lab.tracks import check_size, rate_of

__all__ = ["QUANTITIES", "make_trace", "read_trace"]

QUANTITIES: Final = ("height", "acceleration")
FEWEST: Final = 20
# Largest share of the variance that a sine may leave unexplained.
NO_SINE: Final = 0.1
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
        The fitted sine, for the argument `trace` of `find_impacts`: ``values`` S, C (m s-1) and f
        (Hz), shape (3,), and their ``covariance``, shape (3, 3); the base has the velocity
        S sin 2 pi f t + C cos 2 pi f t.

    Raises
    ------
    TrackError
        The file cannot be read, has other columns, or holds no sine.

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
    """Fit a sine and a constant to the measured height (m) or acceleration (m s-2) of a base.

    Times (s) rise, at a nearly steady rate; `quantity` is one of `QUANTITIES`, `source` a name in
    messages.  Raises a TrackError where there are too few values, the times do not rise, or no sine
    describes them.
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

    def design(rate: float) -> np.ndarray:
        angle = TURN * rate * (when - middle)
        return np.stack([np.sin(angle), np.cos(angle), np.ones_like(angle)], axis=1)

    def left(values: np.ndarray) -> np.ndarray:
        return np.asarray(design(float(values[3])) @ values[:3] - measured)

    start = np.append(np.linalg.lstsq(design(first), measured, rcond=None)[0], first)
    scale = np.append(np.full(3, np.ptp(measured)), 0.1 / np.ptp(when))
    found = least_squares(left, start, x_scale=scale, xtol=1e-14)
    variance = 2.0 * found.cost / (when.size - 4)
    periods = float(found.x[3]) * float(np.ptp(when))
    if periods < 1.0:  # a part of a period also fits a drift, for example
        raise TrackError(
            f"{source}: the {quantity} goes through no whole period of a sine: check the columns, "
            f"take a longer trace, or leave it out and let the landings tell"
        )
    if not variance < NO_SINE * measured.var():
        raise TrackError(
            f"{source}: a sine leaves {100.0 * variance / measured.var():.0f} % of the variance of "
            f"the {quantity}; at most {100.0 * NO_SINE:.0f} % is taken for noise. Only a base that "
            f"moves as a sine can be used: check the columns, or leave the trace out and let the "
            f"landings tell"
        )
    slopes = np.asarray(found.jac)
    covariance = variance * np.linalg.inv(slopes.T @ slopes)
    p, q, _, rate = found.x
    omega = TURN * rate
    # y = p sin + q cos has V = w (p cos - q sin); a = p sin + q cos has V = (-p cos + q sin) / w
    sign, power_of = (-1.0, 1.0) if quantity == "height" else (1.0, -1.0)
    size = sign * omega**power_of
    turned = TURN * middle * rate
    cosine, sine = np.cos(turned), np.sin(turned)
    centred = size * np.array([q, -p])  # S and C on the clock that is zero in the middle
    turn = np.array([[cosine, sine], [-sine, cosine]])
    change = np.zeros((3, 4))
    change[:2, :2] = size * turn @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    turning = np.array([[-sine, cosine], [-cosine, -sine]]) @ centred
    change[:2, 3] = TURN * middle * turning + turn @ centred * power_of / rate
    change[2, 3] = 1.0
    return Trace(np.append(turn @ centred, rate), change @ covariance @ change.T)
