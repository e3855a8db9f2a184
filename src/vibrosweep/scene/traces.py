"""What is measured of a base or a ball: the waveform of a trace, points of a restitution.

Harmonics are fitted to the trace of a base by least squares.

The model of the trace is a mean, a trend and harmonics of one frequency f,

    y(t) = m + n t + sum A_h cos(2 pi h f t) + B_h sin(2 pi h f t).

f minimizes the sum of squared residuals.  The highest peak of the spectrum
may be any of the harmonics: the search starts at the peak divided by 1, 2, ... up to their number,
and refines f by successive parabolic interpolation.  Differentiating a
height, or integrating an acceleration, term by term gives the harmonics of the velocity.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

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

__all__ = ["series_of", "waves"]

OF_POINTS: Final = ("speed", "restitution")  # columns of a table of points
AT_REST: Final = 0.02  # deviation from 1 of a mean that is taken for 1 g
FEWEST_PERIODS: Final = 2.0
LEAST_SHARE: Final = 0.5  # of the variance that the harmonics must explain
DRIFT: Final = 0.05  # largest drift in one period, relative to the range
AS_GOOD: Final = 1.05  # residual, relative to the least one, up to which a fit is as good as any


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
    frequency, terms, share = _fitted(time - middle, values, traced.harmonics)
    terms = _moved(terms, frequency, middle - origin_of(time))
    rates = TWO_PI * frequency * np.arange(1, traced.harmonics + 1)  # rad/s
    cosines, sines = terms
    # velocity: sum of in_phase sin(rate t) + quadrature cos(rate t)
    if traced.column == "height":
        in_phase, quadrature = -rates * cosines, rates * sines
    else:
        in_phase, quadrature = cosines / rates, -sines / rates
    weights, phases = np.hypot(in_phase, quadrature), np.arctan2(quadrature, in_phase)
    pairs = zip(weights.tolist(), phases.tolist(), strict=True)
    tones = [(k + 1, *pair) for k, pair in enumerate(pairs)]
    raw = Waveform(HARMONICS_NAME, tuple(tones))
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


def _moved(terms: Array, frequency: float, since: float) -> Array:
    """Refer cosines and sines to the instant 0 instead of `since` (s)."""
    turns = np.arange(1, terms.shape[1] + 1) * (frequency * since)
    angle = TWO_PI * (turns - np.rint(turns))
    cosines, sines = terms
    return np.stack(
        [
            cosines * np.cos(angle) - sines * np.sin(angle),
            sines * np.cos(angle) + cosines * np.sin(angle),
        ]
    )


def _fitted(time: Array, values: Array, harmonics: int) -> tuple[float, Array, float]:
    """Return frequency (Hz), coefficients of cosines and sines, and their share of the variance."""
    span = float(time[-1] - time[0])
    total = _least_squares(time, values, 1.0, 0)[0]
    if not total > 1e-24 * float(np.sum(values * values)):
        raise ValueError("the trace shows no motion")
    peak = _peak(time, values)
    trials = [peak / k for k in range(1, harmonics + 1) if peak * span / k >= 0.75]
    trials = [_refined(time, values, f, harmonics, span) for f in trials or [1.0 / span]]
    residuals = [_least_squares(time, values, f, harmonics)[0] for f in trials]
    least = min(residuals) + 1e-20 * total
    frequency = next(f for f, r in zip(trials, residuals, strict=True) if r <= AS_GOOD * least)
    residual, solution = _least_squares(time, values, frequency, harmonics)
    share = 1.0 - residual / total
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
    if time.size < 2.0 * (2 * harmonics + 1) or time.size / periods < 2 * harmonics + 1:
        raise ValueError(
            f"the trace has {time.size / periods:.3g} points in a period, too few for {harmonics} "
            f"harmonics: take fewer harmonics"
        )
    drift = abs(float(solution[1])) / frequency
    if drift > DRIFT * float(np.ptp(values - solution[1] * time)):
        raise ValueError(
            f"the trace has a mean velocity: it drifts by {drift:.3g} in a period, more than "
            f"{100 * DRIFT:g} % of its range"
        )
    return frequency, np.stack([solution[2::2], solution[3::2]]), share


def waves(time: Array, frequency: float, harmonics: int) -> Array:
    """Return cosine and sine of each harmonic of a frequency (Hz), shape (time, 2 harmonics)."""
    columns = []
    for h in range(1, harmonics + 1):
        turns = h * frequency * time
        angle = TWO_PI * (turns - np.rint(turns))
        columns += [np.cos(angle), np.sin(angle)]
    return np.stack(columns, axis=1) if columns else np.empty((time.size, 0))


def _peak(time: Array, values: Array) -> float:
    """Return the frequency of the highest peak of the spectrum."""
    line = values - np.polyval(np.polyfit(time, values, 1), time)
    window = 0.5 - 0.5 * np.cos(TWO_PI * (time - time[0]) / (time[-1] - time[0]))
    return strongest_rate(time, line * window, padding=8)


def _refined(time: Array, values: Array, f: float, harmonics: int, span: float) -> float:
    """Return the frequency near f with the least residual."""
    step = 0.2 / span / harmonics
    for _ in range(60):
        low, middle, high = (
            _least_squares(time, values, trial, harmonics)[0] for trial in (f - step, f, f + step)
        )
        bend = low - 2.0 * middle + high
        move = 0.5 * step * (low - high) / bend if bend > 0.0 else math.copysign(step, low - high)
        f += min(max(move, -step), step)
        step = max(0.3 * step, 2.0 * abs(move)) if abs(move) < step else step
        if abs(move) <= 1e-13 * f or step <= 1e-9 / span:
            break
    return abs(f)


def _least_squares(time: Array, values: Array, f: float, harmonics: int) -> tuple[float, Array]:
    """Fit mean, trend and harmonics; return the sum of squared residuals and the coefficients."""
    design = np.column_stack([np.ones_like(time), time, waves(time, f, harmonics)])
    solution = np.linalg.lstsq(design, values, rcond=None)[0]
    residual = values - design @ solution
    return float(np.sum(residual * residual)), np.asarray(solution, np.float64)


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
