"""Waveforms from a measured motion of the base, as harmonics by least squares.

The trace is a mean, a trend and harmonics of one frequency f,

    y(t) = m + n t + sum A_h cos(2 pi h f t) + B_h sin(2 pi h f t).

f minimizes the sum of squares of the residual: the highest peak of the spectrum, or a simple
fraction of it, is refined by Newton's method on a parabola through three trials (successive
parabolic interpolation).  The harmonics of the velocity follow by differentiating a height, or
integrating an acceleration, term by term.
"""

from __future__ import annotations

import csv
import hashlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.model.shapes import HARMONICS_NAME, TWO_PI, Trace, Waveform, zeros

COLUMNS: Final = ("height", "acceleration")
FEWEST_PERIODS: Final = 2.0
HELD: Final = 0.5  # least share of the variance that harmonics of a period must hold
DRIFT: Final = 0.05  # largest drift in one period, relative to the range
FRACTIONS: Final = 6  # simple fractions of the highest peak that may be the frequency
AS_GOOD: Final = 1.05  # residual relative to the least, of a fit that is as good


@dataclass(frozen=True)
class Traced:
    """A waveform that is asked for as a trace."""

    trace: str
    column: str
    harmonics: int


@dataclass(frozen=True)
class Measured:
    """A waveform from a trace."""

    waveform: Waveform
    frequency: float  # Hz
    velocity: float  # V0, m s-1


def measured(asked: Traced, folder: Path) -> Measured:
    """Read a trace and fit its harmonics; a ValueError says why it cannot be used."""
    path = folder / asked.trace
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ValueError(f"the trace {path} cannot be read: {error.strerror}") from error
    time, values = _columns(content, asked.column)
    frequency, terms, held = _fitted(time, values, asked.harmonics)
    h = TWO_PI * frequency * np.arange(1, asked.harmonics + 1)
    cosines, sines = terms
    if asked.column == "height":
        along, across = -h * cosines, h * sines
    else:
        along, across = cosines / h, -sines / h
    weights, phases = np.hypot(along, across), np.arctan2(across, along)
    pairs = zip(weights.tolist(), phases.tolist(), strict=True)
    tones = [(k + 1, *pair) for k, pair in enumerate(pairs)]
    raw = Waveform(HARMONICS_NAME, tuple(tones))
    velocity = float(np.abs(raw.velocity(zeros(raw, 1))).max())
    scaled = tuple((k, w / velocity, p) for k, w, p in tones)
    digest = hashlib.blake2b(content, digest_size=8).hexdigest()
    trace = Trace(asked.trace, asked.column, digest, round(held, 6))
    return Measured(Waveform(HARMONICS_NAME, scaled, trace), frequency, velocity)


def _columns(content: bytes, column: str) -> tuple[Array, Array]:
    """Times in s, from the trace, and the column."""
    try:
        rows = list(csv.reader(content.decode("utf-8-sig").splitlines()))
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError("the trace is not a table of comma-separated values in UTF-8") from error
    names = [name.strip() for name in rows[0]] if rows else []
    for needed in ("time", column):
        if needed not in names:
            found = ", ".join(names) or "none"
            raise ValueError(f'the trace has no column "{needed}" (columns found: {found})')
    places = [names.index("time"), names.index(column)]
    numbers = np.empty((len(rows) - 1, 2))
    for k, row in enumerate(rows[1:]):
        try:
            numbers[k] = [float(row[place]) for place in places]
        except (IndexError, ValueError) as error:
            raise ValueError(f"the trace has no two numbers in line {k + 2}") from error
    time, values = numbers.T
    if not np.isfinite(numbers).all():
        line = int(np.flatnonzero(~np.isfinite(numbers).all(axis=1))[0]) + 2
        raise ValueError(f"the trace has a number that is not finite in line {line}")
    if time.size < 8 or not np.all(np.diff(time) > 0.0):
        raise ValueError("the trace needs eight or more lines whose times grow")
    return time, values


def _fitted(time: Array, values: Array, harmonics: int) -> tuple[float, Array, float]:
    """Frequency in Hz, coefficients of cosines and sines, and the share that they hold."""
    span = float(time[-1] - time[0])
    total = _left(time, values, 1.0, 0)[0]
    if not total > 1e-24 * float(np.sum(values * values)):
        raise ValueError("the trace does not move")
    peak = _peak(time, values)
    trials = [peak / k for k in range(1, FRACTIONS + 1) if peak * span / k >= 0.75]
    trials = [_refined(time, values, f, harmonics, span) for f in trials or [1.0 / span]]
    squares = [_left(time, values, f, harmonics)[0] for f in trials]
    least = min(squares) + 1e-20 * total
    frequency = next(f for f, left in zip(trials, squares, strict=True) if left <= AS_GOOD * least)
    left, solution = _left(time, values, frequency, harmonics)
    held = 1.0 - left / total
    periods = span * frequency
    if periods < FEWEST_PERIODS:
        raise ValueError(
            f"the trace covers {periods:.2g} periods; at least {FEWEST_PERIODS:g} must be there, "
            f"by which its period is known"
        )
    if held < HELD:
        raise ValueError(
            f"the trace has no period: harmonics of {frequency:.6g} Hz hold {100.0 * held:.3g} % "
            f"of it"
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
    return frequency, np.stack([solution[2::2], solution[3::2]]), held


def _peak(time: Array, values: Array) -> float:
    """Frequency of the highest peak of the spectrum."""
    even = np.linspace(time[0], time[-1], time.size)
    line = np.interp(even, time, values)
    line -= np.polyval(np.polyfit(even - even[0], line, 1), even - even[0])
    padded = 8 * time.size
    power = np.abs(np.fft.rfft(line * np.hanning(line.size), padded)) ** 2
    k = int(np.argmax(power[1:])) + 1
    return k * (time.size - 1) / (padded * float(time[-1] - time[0]))


def _refined(time: Array, values: Array, f: float, harmonics: int, span: float) -> float:
    """Frequency near f with the least residual."""
    step = 0.2 / span / harmonics
    for _ in range(60):
        squares = [_left(time, values, trial, harmonics)[0] for trial in (f - step, f, f + step)]
        low, middle, high = squares
        bend = low - 2.0 * middle + high
        move = 0.5 * step * (low - high) / bend if bend > 0.0 else math.copysign(step, low - high)
        f += min(max(move, -step), step)
        step = max(0.3 * step, 2.0 * abs(move)) if abs(move) < step else step
        if abs(move) <= 1e-13 * f or step <= 1e-9 / span:
            break
    return abs(f)


def _left(time: Array, values: Array, f: float, harmonics: int) -> tuple[float, Array]:
    """Sum of squares of the residual of mean, trend and harmonics, and their coefficients."""
    columns = [np.ones_like(time), time]
    for h in range(1, harmonics + 1):
        turns = h * f * time
        angle = TWO_PI * (turns - np.rint(turns))
        columns += [np.cos(angle), np.sin(angle)]
    design = np.stack(columns, axis=1)
    solution = np.linalg.lstsq(design, values, rcond=None)[0]
    rest = values - design @ solution
    return float(np.sum(rest * rest)), np.asarray(solution, np.float64)
