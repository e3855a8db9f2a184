"""Measured motion of the base, from its track or an accelerometer, fitted with harmonics."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from vibrosweep.arrays import Array
from vibrosweep.errors import TrackError, require_one_of
from vibrosweep.lab.base_fit import Trace
from vibrosweep.lab.recordings import files_of
from vibrosweep.lab.regression import TWO_PI
from vibrosweep.lab.tracks import check_size, rate_of
from vibrosweep.lab.variables import require_name
from vibrosweep.model.shapes import HARMONICS_NAME, MOST_HARMONICS, SINE, Waveform
from vibrosweep.scene.tables import origin_of, read_content, strongest_rate
from vibrosweep.scene.traces import series_of, waves

__all__ = ["QUANTITIES", "make_trace", "read_trace"]

# -----------------------------------------------------------------------------
# Measured motion of the base, from its track or an accelerometer, fitted with harmonics.
#
# The fit consists of a constant and harmonics 1 to H of one frequency.  H, from 1 (a sine) to 16,
# and the frequency, a simple fraction of that of the strongest harmonic, minimise Schwarz's
# criterion
#
#     n ln s^2 + (2 H + 2) ln n
#
# for n values, where s^2 is the variance of the residuals, or that of rounding to the resolution
# of the trace if this is larger, because periodic rounding errors look like harmonics.

QUANTITIES: Final = ("height", "acceleration")
FEWEST: Final = 20  # values of a trace
# Largest fraction of the variance that harmonics may leave unexplained
UNEXPLAINED: Final = 0.1
FEWEST_PERIODS: Final = 2.0  # of a motion that is not a sine
CLOSE: Final = 1e-15  # relative change of the values or of the sum of squares at convergence
SAME: Final = 1e-9  # difference of two values, relative to their range, possible from rounding
LEAST: Final = 1e-30  # smallest significant change of a height (m) or acceleration (m s-2)


def read_trace(path: str | os.PathLike[str], *, column: str | None = None) -> Trace:
    """Read a measured motion of the base, from its track or from an accelerometer.

    Parameters
    ----------
    path
        A table, as text or in a workbook, with a column of times on the clock of the tracks and one
        of heights or of accelerations.  Units in the headings are used, such as ``height (mm)``
        or ``az (g)``; without them they are s, m and m s-2.
    column
        Name of the column of heights or accelerations, if several are possible.

    Returns
    -------
    Trace
        The fitted motion, for the argument `trace` of `find_impacts`: ``values`` are S, C (m s-1)
        and f (Hz), then S and C of other harmonics if the motion is not a sine; ``covariance`` is
        that of the values; ``numbers`` are the harmonic numbers h, that of the strongest first.
        The base has the velocity sum S sin 2 pi h f t + C cos 2 pi h f t, where t is relative to
        ``origin`` (s), which is 0 unless the clock starts in 1970 or at midnight.

    Raises
    ------
    TrackError
        The file cannot be read or lacks these columns, or the motion is not periodic.

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
    require_name("column", column)
    (file,) = files_of([path])
    source = str(file)
    try:
        time, values, quantity = series_of(read_content(file), source, QUANTITIES, column)
    except ValueError as error:
        raise TrackError(str(error)) from error
    return make_trace(time, values, quantity, source)


def make_trace(
    time: ArrayLike, values: ArrayLike, quantity: str, source: str = "the trace"
) -> Trace:
    """Fit harmonics and a constant to the measured height (m) or acceleration (m s-2) of a base.

    Times (s) increase at a nearly constant rate; `quantity` is one of `QUANTITIES`, `source` a name
    in messages.  Raises a TrackError if there are too few values, if times do not increase, or if
    no harmonics fit the values.
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
            f"{source}: the {quantity} does not change: leave the trace out, and choose a base at "
            f"a constant level"
        )
    strongest = strongest_rate(when, measured - measured.mean())
    origin = origin_of(when)
    when = when - origin
    middle = float(when.mean())  # makes the errors of phase and frequency almost uncorrelated
    rate, harmonics = _choose_harmonics(when - middle, measured, strongest, sampled)
    fit = _fit(when - middle, measured, rate, harmonics)
    if fit.values[-1] * np.ptp(when) < 1.0:  # less than a period may be a drift
        raise TrackError(
            f"{source}: the {quantity} contains no whole period of a sine: check the columns, "
            f"take a longer trace, or leave it out and let the landings determine the motion"
        )
    if not fit.variance < UNEXPLAINED * measured.var():
        raise TrackError(
            f"{source}: {'a sine leaves' if harmonics == 1 else f'{harmonics} harmonics leave'} "
            f"{100.0 * fit.variance / measured.var():.0f} % of the variance of the {quantity}; at "
            f"most {100.0 * UNEXPLAINED:.0f} % is taken for noise. Only a periodic "
            f"motion can be used: check the columns, or leave the trace out and let the "
            f"landings determine the motion"
        )
    return _velocities(fit, middle, quantity)._replace(origin=origin)


def trace_of_mark(tracks: xr.Dataset, exposure: float) -> Trace:
    """Fit harmonics to the ``base_height`` of tracks, corrected for the exposure time (s).

    Raises the errors of `make_trace`.
    """
    height = tracks["base_height"].values
    seen, source = np.isfinite(height), f"{tracks.attrs['source']}, the mark on the base"
    mean = make_trace(tracks["time"].values[seen], height[seen], "height", source)
    # attenuation by averaging over the exposure
    share = np.sinc(np.repeat(mean.numbers, 2) * mean.values[2] * exposure)
    share = np.insert(share, 2, 1.0)
    return mean._replace(
        values=mean.values / share, covariance=mean.covariance / np.outer(share, share)
    )


class _Fit(NamedTuple):
    """Harmonics fitted to a trace."""

    # values, covariance: the constant, coefficients of cosine and sine of each harmonic, and the
    # frequency (Hz)
    values: Array
    covariance: Array
    variance: float  # variance of the residuals


def _design(since: Array, rate: float, harmonics: int) -> Array:
    """Columns of a linear fit: a constant, cosine and sine of each harmonic of `rate` (Hz)."""
    return np.column_stack([np.ones_like(since), waves(since, rate, harmonics)])


def _fit(since: Array, measured: Array, rate: float, harmonics: int) -> _Fit:
    """Fit harmonics with a fundamental frequency near `rate` (Hz)."""
    numbers = np.arange(1, harmonics + 1)

    def residuals(values: Array) -> Array:
        return np.asarray(_design(since, values[-1], harmonics) @ values[:-1] - measured)

    def slopes(values: Array) -> Array:
        columns = _design(since, values[-1], harmonics)
        turned = np.column_stack([numbers * values[2:-1:2], -numbers * values[1:-1:2]]).ravel()
        return np.column_stack([columns, TWO_PI * since * (columns[:, 1:] @ turned)])

    first = np.linalg.lstsq(_design(since, rate, harmonics), measured, rcond=None)[0]
    found = least_squares(
        residuals, [*first, rate], slopes, method="lm", ftol=CLOSE, xtol=CLOSE, gtol=CLOSE
    )
    variance = 2.0 * found.cost / (since.size - found.x.size)
    jacobian = np.asarray(found.jac)
    covariance = variance * np.linalg.inv(jacobian.T @ jacobian)
    return _Fit(found.x, covariance, float(variance))


def _choose_harmonics(
    since: Array, measured: Array, strongest: float, sampled: float
) -> tuple[float, int]:
    """Choose an approximate fundamental frequency, and the number of harmonics.

    `strongest` is the frequency of the strongest harmonic, `sampled` the values per second.
    """
    number, span = since.size, float(np.ptp(since))
    measured = measured - measured.mean()
    steps = np.diff(np.unique(measured))
    floor = float(steps[steps > SAME * np.ptp(measured)].min()) ** 2 / 12.0
    sine = _fit(since, measured, strongest, 1)
    trials = [(_schwarz(sine.variance, floor, number, 1), strongest, 1)]
    for part in range(1, MOST_HARMONICS + 1):
        rate = strongest / part
        # fewer coefficients, two per harmonic, than values per period
        most = min(MOST_HARMONICS, int((sampled / rate - 1.0) / 2.0), (number - 3) // 4)
        if most < max(part, 2) or rate * span < FEWEST_PERIODS:
            continue
        rate = float(_fit(since, measured, rate, most).values[-1])
        # squared components along the columns, orthonormalised in this order
        axes = np.linalg.qr(_design(since, rate, most))[0]
        held = np.cumsum((axes.T @ measured) ** 2)
        for harmonics in range(max(part, 2), most + 1):
            residual = measured @ measured - held[2 * harmonics]
            variance = float(residual) / (number - 2 * harmonics - 2)
            trials.append((_schwarz(variance, floor, number, harmonics), rate, harmonics))
    _, rate, harmonics = min(trials)
    return rate, harmonics


def _schwarz(variance: float, floor: float, number: int, harmonics: int) -> float:
    """Schwarz's criterion of a fit; the variance of its residuals is at least `floor`."""
    return float(number * np.log(max(variance, floor)) + (2 * harmonics + 2) * np.log(number))


def _velocities(fit: _Fit, middle: float, quantity: str) -> Trace:
    """Convert the harmonics of the quantity to those of the velocity, on the clock of the trace.

    Times of the fit are relative to the `middle` of the trace (s).
    """
    pairs, rate = fit.values[1:-1].reshape(-1, 2), float(fit.values[-1])
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
    return Trace(values, change @ fit.covariance @ change.T, tuple(k + 1 for k in order))


# -----------------------------------------------------------------------------
# Amplitudes and phases of the harmonics of a base, from the coefficients of sine and cosine.
#
# The harmonic with the largest velocity has the weight 1 and the phase 0: V0 and phi are its
# amplitude and phase, as for a pure sine.

STEP: Final = 1e-5  # step of weights and phases in finite differences


def polar(
    values: Array, covariance: Array, numbers: Sequence[int] = (1,)
) -> tuple[Array, Array, Waveform]:
    """Transform e, S, C, f, ... and covariance to e, V0, phi, f, ...; return the waveform too.

    Without other harmonics f may be missing.  S and C of each of the other `numbers` follow f, and
    are transformed to the weight and the phase psi of that harmonic.
    """
    s, c = values[1:3]
    amplitude = float(np.hypot(s, c))
    change = np.eye(values.size)
    change[1, 1:3] = s / amplitude, c / amplitude
    change[2, 1:3] = np.array([-c / amplitude**2, s / amplitude**2]) / numbers[0]
    plain = values.copy()
    plain[1:3] = amplitude, np.arctan2(c, s) / numbers[0]
    tones = [(numbers[0], 1.0, 0.0)]
    for k, h in enumerate(numbers[1:]):
        s, c = values[4 + 2 * k : 6 + 2 * k]
        size, pair = float(np.hypot(s, c)), slice(4 + 2 * k, 6 + 2 * k)
        psi = float(np.arctan2(c, s) - h * plain[2])
        psi -= 2.0 * np.pi * np.rint(psi / (2.0 * np.pi))
        change[pair, pair] = (
            np.array([[s / amplitude, c / amplitude], [-c / size, s / size]]) / size
        )
        change[pair.start, 1:3] = -size / amplitude**2 * change[1, 1:3]
        change[pair.start + 1, 1:3] = -h * change[2, 1:3]
        plain[pair] = size / amplitude, psi
        tones.append((h, float(plain[pair.start]), psi))
    shape = SINE if len(tones) == 1 and numbers[0] == 1 else _waveform(tones)
    return plain, change @ covariance @ change.T, shape


def _waveform(tones: Sequence[tuple[int, float, float]]) -> Waveform:
    return Waveform(HARMONICS_NAME, tuple(sorted(tones)))


def with_values(shape: Waveform, values: Mapping[str, float]) -> Waveform:
    """Return the waveform with other weights and phases, named as in `names_of`."""
    tones = [
        (h, values.get(f"weight_{h}", weight), values.get(f"phase_{h}", psi))
        for h, weight, psi in shape.tones
    ]
    return _waveform(tones) if tones else shape


def names_of(numbers: Sequence[int]) -> list[str]:
    """Names of the weights and phases of all harmonics but the first, the strongest."""
    return [f"{name}_{h}" for h in numbers[1:] for name in ("weight", "phase")]


def slopes_of_sizes(shape: Waveform, numbers: Sequence[int]) -> Array:
    """Derivatives of ln(B f / V0) and ln(Gamma g / (f V0)) by the parameters of `names_of`."""

    def sizes(waveform: Waveform) -> Array:
        return np.log([1.0 / waveform.per_displacement, waveform.fall])

    values = {f"weight_{h}": weight for h, weight, _ in shape.tones}
    values |= {f"phase_{h}": psi for h, _, psi in shape.tones}
    columns = []
    for name in names_of(numbers):
        up, down = (sizes(with_values(shape, {name: values[name] + s})) for s in (STEP, -STEP))
        columns.append((up - down) / (2.0 * STEP))
    return np.array(columns).reshape(-1, 2).T
