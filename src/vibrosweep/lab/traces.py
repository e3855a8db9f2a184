"""Measured motion of the base, from its track or an accelerometer, fitted with harmonics."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from vibrosweep.arrays import Array
from vibrosweep.errors import TrackError, require_one_of
from vibrosweep.lab.base_fit import Trace
from vibrosweep.lab.recordings import files_of
from vibrosweep.lab.tracks import check_size, rate_of
from vibrosweep.lab.variables import KNOWN, require_name, require_parameter, with_units
from vibrosweep.model.shapes import HARMONICS_NAME, MOST_HARMONICS, SINE, Waveform
from vibrosweep.scene.tables import origin_of, read_content, strongest_rate
from vibrosweep.scene.traces import columns_of, fit_harmonics, series_of, without_trend

__all__ = ["QUANTITIES", "base_motion", "make_trace", "read_trace"]

# -----------------------------------------------------------------------------
# Measured motion of the base, from its track or an accelerometer, fitted with harmonics.
#
# The fit consists of mean, trend and harmonics 1 to H of one frequency.  H, from 1 (a sine) to 16,
# and the frequency, a simple fraction of that of the strongest harmonic, minimise Schwarz's
# criterion
#
#     n ln s^2 + (2 H + 3) ln n
#
# for n values, where s^2 is the variance of the residuals, or that of rounding to the resolution
# of the trace if this is larger, because periodic rounding errors look like harmonics.

QUANTITIES: Final = ("height", "acceleration")
FEWEST: Final = 20  # values of a trace
# Largest fraction of the variance that harmonics may leave unexplained
UNEXPLAINED: Final = 0.1
FEWEST_PERIODS: Final = 2.0  # of a motion that is not a sine
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
    """Fit harmonics, mean and trend to the measured height (m) or acceleration (m s-2) of a base.

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
    origin = origin_of(when)
    middle = float((when - origin).mean())
    since = when - origin - middle
    moved = without_trend(since, measured)
    drifts = TrackError(
        f"{source}: the {quantity} contains no whole period of a sine: check the columns, "
        f"take a longer trace, or leave it out and let the landings determine the motion"
    )
    if np.ptp(moved) < SAME * np.ptp(measured):
        raise drifts
    tone = strongest_rate(since, moved)
    rate, harmonics = _choose_harmonics(since, measured - measured.mean(), tone, sampled)
    fit = fit_harmonics(since, measured, rate, harmonics)
    if fit.values[-1] * np.ptp(since) < 1.0:
        raise drifts
    if not fit.variance < UNEXPLAINED * moved.var():
        raise TrackError(
            f"{source}: {'a sine leaves' if harmonics == 1 else f'{harmonics} harmonics leave'} "
            f"{100.0 * fit.variance / moved.var():.0f} % of the variance of the {quantity}; at "
            f"most {100.0 * UNEXPLAINED:.0f} % is taken for noise. Only a periodic "
            f"motion can be used: check the columns, or leave the trace out and let the "
            f"landings determine the motion"
        )
    values, covariance = fit.of_velocity(middle, quantity)
    pairs = values[:-1].reshape(-1, 2)
    # the strongest harmonic first, then the frequency
    strongest = int(np.hypot(*pairs.T).argmax())
    others = [k for k in range(harmonics) if k != strongest]
    order = np.array(
        [2 * strongest, 2 * strongest + 1, -1, *(2 * k + i for k in others for i in (0, 1))]
    )
    numbers = tuple(k + 1 for k in (strongest, *others))
    return Trace(values[order], covariance[np.ix_(order, order)], numbers, origin)


def base_motion(trace: Trace, *, gravity: float = 9.81) -> xr.Dataset:
    """Return frequency, size and phase of a measured motion of the base, with standard errors.

    Parameters
    ----------
    trace
        Result of `read_trace`.
    gravity
        Gravity in m s-2, the unit of ``base_acceleration``.

    Returns
    -------
    xarray.Dataset
        - ``estimate``, ``error``, ``covariance``, dims (parameter, other): of the peak velocity
          ``base_velocity`` (m s-1) and the ``phase`` (rad) of the strongest harmonic, of the
          ``frequency`` (Hz), and of ``weight_h`` and ``phase_h`` (rad) of each other harmonic h
          relative to the strongest; the attribute ``waveform`` is the key of that name in a sweep
          file.  Phases are those at the `origin` of the trace;
        - ``base_displacement`` (m) and ``base_acceleration`` (in units of gravity) with their
          errors, the peak values of the whole motion.

    Raises
    ------
    ParameterError
        Gravity is outside its range.
    TrackError
        The argument is no trace.

    Examples
    --------
    >>> import numpy as np, vibrosweep as vs
    >>> from vibrosweep.lab.traces import make_trace
    >>> time = np.arange(0.0, 2.0, 1e-3)
    >>> trace = make_trace(time, 4.0 * np.sin(40.0 * np.pi * time), "acceleration")
    >>> round(float(vs.lab.base_motion(trace).base_acceleration), 4)
    0.4077
    """
    require_parameter("gravity", gravity)
    if not isinstance(trace, Trace):
        raise TrackError(f"trace = {trace!r}: must be one that read_trace returned")
    # without restitution
    count = trace.values.size + 1
    covariance = np.zeros((count, count))
    covariance[1:, 1:] = trace.covariance
    plain, spread, shape = polar(np.insert(trace.values, 0, 0.0), covariance, trace.numbers)
    names = ["base_velocity", "phase", "frequency", *names_of(trace.numbers)]
    sizes = sizes_of(plain, spread, shape, trace.numbers, gravity)
    return parameters_dataset(names, plain[1:], spread[1:, 1:], sizes, shape)


def sizes_of(
    plain: Array,
    covariance: Array,
    shape: Waveform,
    numbers: Sequence[int],
    gravity: float,
    frequency: float = np.nan,
) -> dict[str, tuple[float, str, str]]:
    """Peak displacement and acceleration of a base, with their standard errors.

    The first three arguments are a result of `polar`, with the `frequency` (Hz) if it is not
    among the values.
    """
    velocity, free = plain[1], plain.size > 3
    rate = plain[3] if free else frequency
    # relative derivatives of displacement and acceleration, V0 / w and w V0 / g for a sine
    relative = np.zeros((2, plain.size))
    relative[:, 1] = 1.0 / velocity
    if free:
        relative[:, 3] = -1.0 / rate, 1.0 / rate
        relative[:, 4 : 2 + 2 * len(numbers)] = slopes_of_sizes(shape, numbers)
    size = velocity * np.array([1.0 / (shape.per_displacement * rate), shape.fall * rate / gravity])
    error = size * np.sqrt(np.einsum("ki,ij,kj->k", relative, covariance, relative))
    return {
        "base_displacement": (size[0], "m", "peak displacement of the base"),
        "base_displacement_error": (error[0], "m", "its standard error"),
        "base_acceleration": (size[1], "1", "peak acceleration in units of gravity"),
        "base_acceleration_error": (error[1], "1", "its standard error"),
    }


def parameters_dataset(
    names: list[str],
    values: Array,
    covariance: Array,
    about: Mapping[str, tuple[Any, str, str]],
    shape: Waveform,
) -> xr.Dataset:
    """Make a dataset of parameters with their covariance, and of other numbers."""
    units = [KNOWN[name].units if name in KNOWN else OF_BASE[name.split("_")[0]] for name in names]
    error = np.sqrt(np.diag(covariance))
    return xr.Dataset(
        {
            "estimate": ("parameter", values, {"long_name": "estimate"}),
            "error": ("parameter", error, {"long_name": "standard error"}),
            "covariance": (("parameter", "other"), covariance, {"long_name": "covariance"}),
            **with_units((), about),
        },
        coords={"parameter": names, "other": names, "units": ("parameter", units)},
        attrs={"waveform": shape.text},
    )


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


def _choose_harmonics(
    since: Array, measured: Array, strongest: float, sampled: float
) -> tuple[float, int]:
    """Choose an approximate fundamental frequency, and the number of harmonics.

    The mean of `measured` is 0; `strongest` is the frequency of the strongest harmonic, `sampled`
    the values per second.
    """
    number, span = since.size, float(np.ptp(since))
    steps = np.diff(np.unique(measured))
    floor = float(steps[steps > SAME * np.ptp(measured)].min()) ** 2 / 12.0
    sine = fit_harmonics(since, measured, strongest, 1)
    trials = [(_schwarz(sine.variance, floor, number, 1), strongest, 1)]
    for part in range(1, MOST_HARMONICS + 1):
        rate = strongest / part
        # fewer coefficients, two per harmonic, than values per period
        most = min(MOST_HARMONICS, int((sampled / rate - 1.0) / 2.0), (number - 3) // 4)
        if most < max(part, 2) or rate * span < FEWEST_PERIODS:
            continue
        rate = float(fit_harmonics(since, measured, rate, most).values[-1])
        # squared components along the columns, orthonormalised in this order
        axes = np.linalg.qr(columns_of(since, rate, most))[0]
        held = np.cumsum((axes.T @ measured) ** 2)
        for harmonics in range(max(part, 2), most + 1):
            residual = measured @ measured - held[2 * harmonics + 1]
            variance = float(residual) / (number - 2 * harmonics - 3)
            trials.append((_schwarz(variance, floor, number, harmonics), rate, harmonics))
    _, rate, harmonics = min(trials)
    return rate, harmonics


def _schwarz(variance: float, floor: float, number: int, harmonics: int) -> float:
    """Schwarz's criterion of a fit; the variance of its residuals is at least `floor`."""
    return float(number * np.log(max(variance, floor)) + (2 * harmonics + 3) * np.log(number))


# -----------------------------------------------------------------------------
# Amplitudes and phases of the harmonics of a base, from the coefficients of sine and cosine.
#
# The harmonic with the largest velocity has the weight 1 and the phase 0: V0 and phi are its
# amplitude and phase, as for a pure sine.

OF_BASE: Final = {"base": "m s-1", "weight": "1", "phase": "rad"}  # units, by the first word
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
