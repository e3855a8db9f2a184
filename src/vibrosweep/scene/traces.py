"""What is measured of a base or a ball: the waveform of a trace, points of a restitution.

Harmonics are fitted to the trace of a base by least squares.

The model of the trace is a mean, a trend and harmonics of one frequency f,

    y(t) = m + n t + sum A_h cos(2 pi h f t) + B_h sin(2 pi h f t).

The highest peak of the spectrum may be any of the harmonics: the fits start at the peak divided by
1, 2, ... up to their number.  Differentiating a height, or integrating an acceleration, term by
term gives the harmonics of the velocity.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import least_squares

from vibrosweep.arrays import Array
from vibrosweep.mistakes import escaped
from vibrosweep.model.restitution_laws import Points, points_of
from vibrosweep.model.shapes import HARMONICS_NAME, TWO_PI, FittedTrace, Waveform, zeros
from vibrosweep.scene.design import factor
from vibrosweep.scene.scene import Traced
from vibrosweep.scene.tables import (
    MISSING,
    acceleration_factor,
    cells_of,
    even_times,
    length_factor,
    origin_of,
    read_content,
    rounding_of,
    strongest_rate,
    time_factor,
)

__all__ = ["FittedHarmonics", "columns_of", "fit_harmonics", "series_of", "without_trend"]

OF_POINTS: Final = ("speed", "restitution")  # columns of a table of points
AT_REST: Final = 0.02  # deviation from 1 of a mean that is taken for 1 g
FEWEST_PERIODS: Final = 2.0
LEAST_SHARE: Final = 0.5  # of the variance that the harmonics must explain
DRIFT: Final = 0.05  # largest drift in one period, relative to the range
AS_GOOD: Final = 1.05  # residual, relative to the least one, up to which a fit is as good as any
CLOSE: Final = 1e-15  # relative change of the values or of the sum of squares at convergence


def measured(traced: Traced, folder: Path) -> tuple[Waveform, float, float]:
    """Read a trace and fit its harmonics; return the waveform, f (Hz) and V0 (m s-1).

    A ValueError says why the trace cannot be used.
    """
    path = folder / traced.trace
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ValueError(
            f"the trace {path} cannot be read: {error.strerror}{escaped(path)}"
        ) from error
    time, values, _ = series_of(content, "the trace", (traced.column,))
    if time.size < 8:
        raise ValueError(f"the trace has {time.size} lines; at least 8 are needed")
    # about the middle, and on the clock of the trace unless that counts from 1970
    middle = float(time[0] + time[-1]) / 2.0
    fit, share = _fitted(time - middle, values, traced.harmonics)
    terms, _ = fit.of_velocity(middle - origin_of(time), traced.column)
    pairs = terms[:-1].reshape(-1, 2)
    weights, phases = np.hypot(*pairs.T), np.arctan2(pairs[:, 1], pairs[:, 0])
    tones = [
        (k, *tone) for k, tone in enumerate(zip(weights.tolist(), phases.tolist(), strict=True), 1)
    ]
    frequency, raw = float(terms[-1]), Waveform(HARMONICS_NAME, tuple(tones))
    velocity = float(np.abs(raw.velocity(zeros(raw, 1))).max())
    scaled = tuple((k, w / velocity, p) for k, w, p in tones)
    digest = hashlib.blake2b(content, digest_size=8).hexdigest()
    trace = FittedTrace(traced.trace, traced.column, digest, round(share, 6))
    return Waveform(HARMONICS_NAME, scaled, trace), frequency, velocity


def series_of(
    content: bytes, source: str, quantities: Sequence[str], column: str | None = None
) -> tuple[Array, Array, str]:
    """Return rising times (s), values in SI units and their quantity from the table of a trace.

    The quantity is one of `quantities`; lines in which a value is missing are left out.  A
    ValueError says why there are none.
    """
    tables = cells_of(content, source)
    found = []
    for table in tables:
        heads = table.headings
        clock = next((k for k, h in enumerate(heads) if h.role == "time"), None)
        wanted = [
            k for k, h in enumerate(heads) if (h.means(column) if column else h.role in quantities)
        ]
        found += [(table, clock, k) for k in wanted if clock not in (None, k)]
    if len(found) != 1:
        names = "; ".join(table.names for table in tables)
        several = "has several columns that may be meant" if found else "has no column"
        needed = column or " or ".join(quantities)
        raise ValueError(
            f'{source} {several} of time and "{needed}" (columns found: {names}); name the column'
        )
    ((table, clock, place),) = found
    head, clock_head = table.headings[place], table.headings[clock]
    time, values = table.numbers(clock), table.numbers(place)
    if (back := np.flatnonzero(np.diff(time) <= 0.0)).size:
        line = table.lines[back[0] + 1]
        raise ValueError(f"the time in line {line} of {source} is not after the one before")
    factor = time_factor(clock_head.unit)
    by_unit = "acceleration" if head.unit == "g" or not length_factor(head.unit) else "height"
    quantity = head.role if head.role in quantities else by_unit
    size = (acceleration_factor if quantity == "acceleration" else length_factor)(head.unit)
    if factor is None or size is None or quantity not in quantities:
        wrong = clock_head if factor is None else head
        raise ValueError(
            f'{source}: column "{wrong.text}" is in {wrong.unit!r}; give times in s or ms, '
            f"heights in m, cm or mm, accelerations in m s-2 or g"
        )
    kept = np.isfinite(time) & np.isfinite(values)
    time, values = time[kept], values[kept]
    unstated = quantity == "acceleration" and not head.unit and values.size > 0
    if unstated and abs(abs(float(values.mean())) - 1.0) < AT_REST:
        raise ValueError(
            f'{source}: column "{head.text}" has the mean {values.mean():.3g}, as an accelerometer '
            f"that states multiples of g; write its unit in the heading, "
            f'"{head.text} (g)" or "{head.text} (m/s2)"'
        )
    step = rounding_of(c for c in table.column(clock) if c.lower() not in MISSING)
    time = even_times(time * factor[0] / factor[1], step * factor[0] / factor[1])[0]
    return time, values * size[0] / size[1], quantity


class FittedHarmonics(NamedTuple):
    """Mean, trend and harmonics fitted to a trace."""

    # values, covariance: mean, trend (per s), cosine and sine of each harmonic, and the frequency
    # (Hz), with times relative to the middle of the trace
    values: Array
    covariance: Array
    variance: float  # of the residuals

    def of_velocity(self, middle: float, quantity: str) -> tuple[Array, Array]:
        """Return sine and cosine of each harmonic of the velocity, then f, and their covariance.

        `middle` is the instant (s) to which the times of the fit are relative; `quantity` is what
        was fitted, ``"height"`` or ``"acceleration"``.
        """
        pairs, rate = self.values[2:-1].reshape(-1, 2), float(self.values[-1])
        values, change = np.zeros(pairs.size + 1), np.zeros((pairs.size + 1, pairs.size + 3))
        # y = c cos + s sin has V = w (s cos - c sin); a = c cos + s sin has V = (c sin - s cos) / w
        sign, power = (-1.0, 1.0) if quantity == "height" else (1.0, -1.0)
        for k, pair in enumerate(pairs):
            h, row = k + 1, slice(2 * k, 2 * k + 2)
            size, turns = sign * (TWO_PI * rate * h) ** power, h * rate * middle
            angle = TWO_PI * (turns - np.rint(turns))
            cosine, sine = np.cos(angle), np.sin(angle)
            turn = size * np.array([[cosine, -sine], [-sine, -cosine]])
            turning = size * np.array([[-sine, -cosine], [-cosine, sine]])
            values[row] = turn @ pair
            change[row, 2 + 2 * k : 4 + 2 * k] = turn
            change[row, -1] = TWO_PI * middle * h * turning @ pair + values[row] * power / rate
        values[-1], change[-1, -1] = rate, 1.0
        return values, change @ self.covariance @ change.T


def columns_of(time: Array, frequency: float, harmonics: int) -> Array:
    """Columns of a linear fit: mean, trend, cosine and sine of each harmonic of `frequency`, Hz."""
    columns = [np.ones_like(time), time]
    for h in range(1, harmonics + 1):
        turns = h * frequency * time
        angle = TWO_PI * (turns - np.rint(turns))
        columns += [np.cos(angle), np.sin(angle)]
    return np.stack(columns, axis=1)


def fit_harmonics(time: Array, values: Array, frequency: float, harmonics: int) -> FittedHarmonics:
    """Fit mean, trend and harmonics of a frequency near a given one (Hz) by least squares.

    Times (s) are relative to the middle, which makes the errors of phase and frequency almost
    uncorrelated.
    """
    numbers = np.arange(1, harmonics + 1)

    def off(p: Array) -> Array:
        return np.asarray(columns_of(time, p[-1], harmonics) @ p[:-1] - values)

    def slopes(p: Array) -> Array:
        columns = columns_of(time, p[-1], harmonics)
        turned = np.column_stack([numbers * p[3:-1:2], -numbers * p[2:-1:2]]).ravel()
        return np.column_stack([columns, TWO_PI * time * (columns[:, 2:] @ turned)])

    first = np.linalg.lstsq(columns_of(time, frequency, harmonics), values, rcond=None)[0]
    found = least_squares(
        off, [*first, frequency], slopes, method="lm", ftol=CLOSE, xtol=CLOSE, gtol=CLOSE
    )
    variance = 2.0 * found.cost / (time.size - found.x.size)
    jacobian = np.asarray(found.jac)
    return FittedHarmonics(
        found.x, variance * np.linalg.inv(jacobian.T @ jacobian), float(variance)
    )


def without_trend(time: Array, values: Array) -> Array:
    """Subtract the straight line that fits the values."""
    return np.asarray(values - np.polyval(np.polyfit(time, values, 1), time))


def _fitted(time: Array, values: Array, harmonics: int) -> tuple[FittedHarmonics, float]:
    """Return the fit at the best frequency, and the share of the variance that it explains."""
    span = float(time[-1] - time[0])
    line = without_trend(time, values)
    if not line @ line > 1e-24 * float(values @ values):
        raise ValueError("the trace shows no motion")
    window = 0.5 - 0.5 * np.cos(TWO_PI * (time - time[0]) / span)
    peak = strongest_rate(time, line * window, padding=8)
    few = f"too few for {harmonics} harmonics: take fewer harmonics"
    if time.size < 2 * (2 * harmonics + 1):
        raise ValueError(f"the trace has {time.size} points, {few}")
    trials = [peak / k for k in range(1, harmonics + 1) if peak * span / k >= 0.75]
    fits = [fit_harmonics(time, values, f, harmonics) for f in trials or [1.0 / span]]
    variance = float(line @ line) / time.size
    least = min(fit.variance for fit in fits) + 1e-20 * variance
    fit = next(fit for fit in fits if fit.variance <= AS_GOOD * least)
    frequency = float(fit.values[-1])
    share = 1.0 - fit.variance * (time.size - fit.values.size) / float(line @ line)
    periods = span * frequency
    if periods < FEWEST_PERIODS:
        raise ValueError(
            f"the trace covers {periods:.2g} periods; at least {FEWEST_PERIODS:g} are needed to "
            f"know its period"
        )
    if share < LEAST_SHARE:
        raise ValueError(
            f"the trace has no period: harmonics of {frequency:.6g} Hz explain "
            f"{100.0 * share:.3g} % of its variance"
        )
    if time.size / periods < 2 * harmonics + 1:
        raise ValueError(f"the trace has {time.size / periods:.3g} points in a period, {few}")
    drift = abs(float(fit.values[1])) / frequency
    if drift > DRIFT * float(np.ptp(values - fit.values[1] * time)):
        raise ValueError(
            f"the trace has a mean velocity: it drifts by {drift:.3g} in a period, more than "
            f"{100 * DRIFT:g} % of its range"
        )
    return fit, share


def points_in(path: Path) -> Points:
    """Read the columns of speed, in m/s unless the heading has a unit, and of restitution.

    A ValueError says why the table cannot be used.
    """
    for table in cells_of(read_content(path), str(path)):
        places = [
            [k for k, heading in enumerate(table.headings) if heading.means(column)]
            for column in OF_POINTS
        ]
        if all(len(place) == 1 for place in places):
            break
    else:
        raise ValueError(
            f"{path}: must have one column speed (m/s) and one column restitution (columns found: "
            f"{table.names})"
        )
    (speed,), (restitution,) = places
    unit = table.headings[speed].unit
    scale = factor(unit, "m s-1") if unit else (1.0, 1.0)
    if scale is None:
        raise ValueError(f"{path}: the unit {unit!r} of the speed is not known; give it in m/s")
    speeds = table.numbers(speed) * scale[0] / scale[1]
    try:
        return points_of(np.column_stack([speeds, table.numbers(restitution)]).tolist())
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
