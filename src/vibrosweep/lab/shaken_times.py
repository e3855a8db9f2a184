"""Restitution and motion of a shaken base from times of impacts alone.

With the base at the height h = (C sin wt - S cos wt) / w, w = 2 pi f, three successive impacts give
the restitution of the middle one: the flights before and after it begin and end on the base, which
determines the speeds.  S, C and f are determined by the condition that all bounces have the same
restitution, up to scatter.  This is the problem of a ball on a floor with three unknown inputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
import xarray as xr
from scipy.optimize import least_squares

from vibrosweep.arrays import Array, Flags
from vibrosweep.errors import ParameterError, TrackError
from vibrosweep.lab.ballistics import given
from vibrosweep.lab.clicks import impacts_in
from vibrosweep.lab.drops import (
    QUANTILES,
    ROUGH,
    ZOOMS,
    Fit,
    Rows,
    component_variables,
    fit_components,
    largest_outlier,
    stack,
    weighted_residuals,
    without_row,
)
from vibrosweep.lab.recordings import Recording, recordings_in
from vibrosweep.lab.variables import require_parameter, require_range_of_frequencies
from vibrosweep.scene.tables import origin_of

__all__ = ["times_on_shaker"]

TWO_PI: Final = 2.0 * np.pi
FEWEST: Final = 10  # bounces
BLOCK: Final = 24  # bounces in a block of correlated errors
SCAN_SECONDS: Final = 10.0  # of a recording, used in the scan of the frequency
SCAN_BOUNCES: Final = 200
TRIED: Final = np.linspace(0.05, 0.95, 10)  # restitutions in the scan
STARTS: Final = 24  # number of starting values from the scan that are refined
ROUNDS: Final = 6
OUTLIER: Final = 4.5  # standard deviations from which a bounce is an outlier
GROSS_OUTLIER: Final = 15.0  # times the median distance, from which a bounce is excluded at first
MOST_OUTLIERS: Final = 0.2  # largest share of outliers
BELOW: Final = 0.05  # largest share of flights that may cross the base between impacts
EQUAL: Final = 8.0  # difference of log-likelihood that rules out another motion
APART: Final = (0.03, 0.002)  # differences of e and of relative frequency that make another motion
SHORTER: Final = 0.9  # share of flights shorter than those before, as over a base at rest
CHANCE: Final = 12**-0.5  # scatter of e uniformly distributed from 0 to 1, as for random times
WORST: Final = (0.1, 0.25)  # largest error of e, and relative error of the acceleration


class _Base(NamedTuple):
    """Height and velocity of the base at given times, and their derivatives by S, C and f."""

    height: Array
    velocity: Array
    acceleration: Array
    by_motion: tuple[tuple[Array, Array], ...]  # derivatives of height and velocity


def _base(t: Array, motion: Array) -> _Base:
    """Return the base for the motion S, C and f."""
    s, c, f = motion
    w = TWO_PI * f
    sine, cosine = np.sin(w * t), np.cos(w * t)
    height, velocity, turned = (
        (c * sine - s * cosine) / w,
        s * sine + c * cosine,
        s * cosine - c * sine,
    )
    by_f = ((t * velocity - height) / f, TWO_PI * t * turned)
    return _Base(height, velocity, w * turned, ((-cosine / w, sine), (sine / w, cosine), by_f))


class Triples(NamedTuple):
    """Triples of successive impacts."""

    time: Array  # (click,) s, relative to the middle of the recording
    middle: Array  # (bounce,) index of the middle click
    gravity: float
    contact: float

    def bounces(self, time: Array, motion: Array) -> tuple[Array, Array, Array]:
        """Return restitution and impact speed of each bounce, and the velocity after it.

        The motion is S, C and f.
        """
        i, up = self.middle, time[:-1] + self.contact
        length, lift, land = time[1:] - up, _base(up, motion), _base(time[1:], motion)
        rise = (land.height - lift.height) / length
        leaves = 0.5 * self.gravity * length + rise
        lands = rise - 0.5 * self.gravity * length
        speed = land.velocity[i - 1] - lands[i - 1]
        after = leaves[i] - lift.velocity[i]
        return after / speed, speed, leaves[i]

    def derivatives(self, time: Array, motion: Array) -> tuple[Array, Array]:
        """Return derivatives of the restitutions by the three clicks, and by S, C and f."""
        e, speed, _ = self.bounces(time, motion)
        i, up = self.middle, time[:-1] + self.contact
        length, lift, land = time[1:] - up, _base(up, motion), _base(time[1:], motion)
        rise, half = (land.height - lift.height) / length, 0.5 * self.gravity
        # of the mean velocity of a flight by its beginning and its end
        begin, end = (rise - lift.velocity) / length, (land.velocity - rise) / length
        arrival, departure = land.acceleration[i - 1], lift.acceleration[i]
        of_speed = (-(begin + half)[i - 1], arrival - (end - half)[i - 1], 0.0)
        of_after = (0.0, (begin - half)[i] - departure, (end + half)[i])
        by_clicks = [
            (after - e * before) / speed for before, after in zip(of_speed, of_after, strict=True)
        ]
        by_motion = []
        for (h0, v0), (h1, v1) in zip(lift.by_motion, land.by_motion, strict=True):
            climb = (h1 - h0) / length
            by_motion.append((climb[i] - v0[i] - e * (v1[i - 1] - climb[i - 1])) / speed)
        return np.stack(by_clicks, axis=1), np.stack(by_motion, axis=1)

    def share_below(self, motion: Array) -> float:
        """Return the share of flights that cross the base before their impact."""
        i, t = self.middle, self.time
        leaves = self.bounces(t, motion)[2]
        share = np.linspace(0.02, 0.98, 49)[:, None]
        up = t[i] + self.contact
        since = share * (t[i + 1] - up)
        fallen = leaves * since - 0.5 * self.gravity * since**2
        above = _base(up, motion).height + fallen - _base(up + since, motion).height
        least = self.gravity * (t[i + 1] - up) ** 2 + np.hypot(*motion[:2]) / (TWO_PI * motion[2])
        low = -1e-3 * least
        return float((above < low).any(axis=0).mean())


def _scan(triples: Triples, frequencies: Array) -> list[Array]:
    """Return starting values (e, S, C, f); S and C are linear at given e and f."""
    t, i, g = triples.time, triples.middle, triples.gravity
    early = i[(t[i] - t[0] <= SCAN_SECONDS)][:SCAN_BOUNCES]
    early = early if early.size >= FEWEST else i[:FEWEST]
    length = np.diff(t) - triples.contact
    found = []
    for part in np.array_split(frequencies, frequencies.size // 200 + 1):
        w = TWO_PI * part[:, None]
        angle = w * t[: early[-1] + 2]
        sine, cosine = np.sin(angle), np.cos(angle)
        columns = []
        for height, velocity in ((-cosine / w, sine), (sine / w, cosine)):
            rise = np.diff(height, axis=1) / length[: early[-1] + 1]
            columns.append((rise[:, early], rise[:, early - 1], velocity[:, early]))
        for e in TRIED:
            design = np.stack([a + e * b - (1.0 + e) * v for a, b, v in columns], axis=-1)
            right = -0.5 * g * (length[early] - e * length[early - 1])
            normal = np.einsum("fni,fnj->fij", design, design)
            normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(2)
            top = np.einsum("fni,n->fi", design, right)
            motion = np.linalg.solve(normal, top[..., None])[..., 0]
            off = np.abs(right - np.einsum("fni,fi->fn", design, motion))
            # a quantile, because a missed or false click affects three equations; the effect of a
            # timing error grows with the acceleration of the base
            size = g + w[:, 0] * np.hypot(*motion.T)
            misfit = np.quantile(off, 0.6, axis=1) / ((1.0 + e) * size)
            found += [(m, e, *sc, f) for m, sc, f in zip(misfit, motion, part, strict=True)]
    table = np.array(found)
    table = table[np.argsort(table[:, 0])]
    starts: list[Array] = []
    near = 2.0 * (frequencies[1] - frequencies[0]) if frequencies.size > 1 else 1.0
    for row in table[: 50 * STARTS]:
        if all(abs(row[4] - s[3]) > near or abs(row[1] - s[0]) > 0.25 for s in starts):
            starts.append(row[1:])
        if len(starts) == STARTS:
            break
    return starts


class _Start(NamedTuple):
    """A robust fit: its misfit, e, S, C and f, and the timing residual of each bounce."""

    misfit: float
    values: Array
    off: Array


def _refined(triples: Triples, start: Array, known: float | None) -> _Start:
    """Fit e, S, C and f robustly."""
    free = slice(None) if known is None else slice(3)

    def of(p: Array) -> tuple[Array, Array, Array]:
        motion = np.append(p[1:3], p[3] if known is None else known)
        by_clicks, by_motion = triples.derivatives(triples.time, motion)
        left = triples.bounces(triples.time, motion)[0] - p[0]
        return left, by_motion, 1e-4 * np.sqrt((by_clicks**2).sum(axis=1))

    def off(p: Array) -> Array:
        left, _, size = of(p)
        return left / size

    def slopes(p: Array) -> Array:
        # the derivative of the weights is neglected
        left, by_motion, size = of(p)
        return (np.column_stack([-np.ones(left.size), by_motion]) / size[:, None])[:, free]

    scale = np.array([0.1, 0.1, 0.1, 0.01])[free]
    try:
        found = least_squares(off, start[free], slopes, loss="cauchy", x_scale=scale, max_nfev=40)
    except ValueError:
        return _Start(np.inf, start, np.empty(0))
    values = found.x if known is None else np.append(found.x, known)
    left, motion = np.abs(off(found.x)), values[1:]
    speed = triples.bounces(triples.time, motion)[1]
    bad = not -0.05 < values[0] < 1.05 or motion[2] <= 0.0 or np.mean(speed <= 0.0) > BELOW
    if bad or triples.share_below(motion) > BELOW:
        return _Start(np.inf, values, left)
    # Cauchy likelihood, which is robust against outliers
    typical = max(float(np.median(left)), 1e-3)
    return _Start(float(np.log(typical + left**2 / typical).mean()), values, left)


class _Adjusted(NamedTuple):
    fit: Fit
    values: Array  # e, S, C, f
    covariance: Array
    used: Flags  # False for outliers
    slopes: Array
    rows: Rows


def _adjusted(triples: Triples, start: _Start, known: float | None, rounding: float) -> _Adjusted:
    """Fit with scatter and timing as variance components, linearized about adjusted clicks."""
    motion, time = start.values[1:].copy(), triples.time.copy()
    n, i = triples.middle.size, triples.middle
    prior = np.array([0.0, 0.0, 0.0, 0.0 if known is None else 1e12])
    # bounces next to missed or false clicks deviate strongly from the start
    gross = np.argsort(-start.off)[: int(MOST_OUTLIERS * n)]
    gross = gross[start.off[gross] > GROSS_OUTLIER * max(float(np.median(start.off)), 1e-3)]
    outliers = [(int(k) // BLOCK, int(k) % BLOCK) for k in gross]
    parts = [np.arange(a, min(a + BLOCK, n)) for a in range(0, n, BLOCK)]
    for turn in range(ROUNDS):
        e, _, _ = triples.bounces(time, motion)
        slopes, by_motion = triples.derivatives(time, motion)
        shift = (triples.time - time)[i[:, None] + [-1, 0, 1]]
        value = e + (slopes * shift).sum(axis=1)
        blocks, matrices = [], []
        for part in parts:
            clicks = np.unique(i[part, None] + [-1, 0, 1])
            matrix = np.zeros((part.size, clicks.size))
            for k in range(3):
                place = np.searchsorted(clicks, i[part] + k - 1)
                matrix[np.arange(part.size), place] = slopes[part, k]
            design = np.column_stack([np.ones(part.size), -by_motion[part]])
            timing = matrix @ matrix.T
            fixed = timing * rounding**2 / 12.0
            blocks.append((value[part], design, fixed, timing, np.ones(part.size)))
            matrices.append((clicks, matrix))
        rows = stack(blocks)
        for block, row in outliers:
            rows = without_row(rows, block, row)
        last = turn == ROUNDS - 1
        fit = fit_components(rows, prior, (True, True, False), ZOOMS if last else ROUGH)
        mean, covariance = fit.moments()
        if last:
            break
        pulled, _ = weighted_residuals(rows, fit)
        variance = fit.components[0] ** 2 + rounding**2 / 12.0
        time = triples.time.copy()
        for k, (clicks, matrix) in enumerate(matrices):
            time[clicks] -= variance * matrix.T @ pulled[k, : len(matrix)]
        limit = 0.2 * max(float(np.hypot(*motion[:2])), 1e-3)
        step = mean[1:] * min(1.0, limit / max(float(np.abs(mean[1:3]).max()), 1e-300))
        motion = motion + step
        while turn > 0 and len(outliers) + 1 <= MOST_OUTLIERS * n:
            far, block, row = largest_outlier(rows, fit)
            if far < OUTLIER:
                break
            outliers.append((block, row))
            rows = without_row(rows, block, row)
    used = np.ones(n, bool)
    used[[block * BLOCK + row for block, row in outliers]] = False
    return _Adjusted(fit, np.append(mean[0], motion + mean[1:]), covariance, used, slopes, rows)


def times_on_shaker(
    recordings: Sequence[Recording],
    *,
    frequency: float | None = None,
    frequency_range: tuple[float, float] = (1.0, 100.0),
    contact: float | None = None,
    gravity: float = 9.81,
) -> xr.Dataset:
    """Measure restitution, frequency, acceleration and phase of a shaken base from times alone.

    Parameters
    ----------
    recordings
        Times of impacts of balls on one sinusoidally moving base, on the same clock.
    frequency
        Frequency of the base in Hz; by default it is estimated.
    frequency_range
        Interval to search for the frequency, Hz.
    contact
        Contact time in s, one number; by default 0, and the effect of 1 ms is reported.
    gravity
        Gravity in m s-2.

    Returns
    -------
    xarray.Dataset
        - ``restitution``, its scatter and its bounces, as in the result of `restitution`;
        - ``frequency`` (Hz), ``base_acceleration`` (in units of gravity), ``amplitude`` (m s-1,
          (1 + e) times the peak velocity of the base) and ``phase`` (rad, at t = 0 on the clock of
          the recordings, or at the attribute ``origin`` (s) of a clock from 1970 or midnight), each
          with ``_error``;
        - ``correlation`` of restitution and acceleration;
        - ``contact_effect``: changes due to a contact time longer by 1 ms;
        - ``determined``: 0 if the orbit, such as a locked one, does not determine them; the
          attribute ``warning`` states the relation that it does determine.

    Raises
    ------
    TrackError
        There are too few impacts, or no motion of the base fits them.
    ParameterError
        A number is outside its range.

    Examples
    --------
    >>> import numpy as np
    >>> import vibrosweep as vs
    >>> shaken = dict(frequency=20.0, amplitude=0.35, restitution=0.8, base="moving")
    >>> ds = vs.simulate(**shaken, launch_velocity=0.6, duration=6.0)
    >>> times = ds.landing_time.values.ravel()
    >>> recording = vs.lab.Recording("clicks", "", times[2:40], None, None, True, True, 0.0, None)
    >>> found = vs.lab.times_on_shaker([recording])
    >>> round(float(found.frequency), 2), round(float(found.restitution), 3)
    (20.0, 0.8)
    """
    recordings = recordings_in(recordings)
    require_range_of_frequencies(frequency_range)
    require_parameter("gravity", gravity)
    if frequency is not None:
        require_parameter("frequency", frequency)
    if isinstance(contact, tuple | list):
        raise ParameterError(
            f"contact = {contact!r}: must be one number for times of impacts over a shaken base, "
            f"which do not determine it; the effect of 1 ms is reported if it is left out"
        )
    c = given("contact", contact).value if contact else 0.0
    triples, name, middle, origin = _triples(recordings, gravity, c)
    low, high = frequency_range
    span = min(float(np.ptp(triples.time)), SCAN_SECONDS)
    number = int((high - low) * 4.0 * span) + 2
    rates = np.linspace(low, high, number) if frequency is None else np.array([float(frequency)])
    locked = _warning_if_locked(triples, name)
    tried = [_refined(triples, start, frequency) for start in _scan(triples, rates)]
    start = min(tried, key=lambda one: one.misfit)
    nothing = TrackError(
        locked
        or f"{name}: no restitution and motion of a base describe the times; check the "
        f"frequency, and whether impacts are missing"
    )
    if not np.isfinite(start.misfit):
        raise nothing
    rounding = max(r.rounding for r in recordings)
    try:
        found = _adjusted(triples, start, frequency, rounding)
    except np.linalg.LinAlgError:
        raise TrackError(locked or f"{name}: the times do not determine the motion") from None
    if np.median(_spread(found)) > CHANCE:
        raise nothing
    error = float(np.sqrt(found.covariance[0, 0]))
    if not (-3.0 * error <= found.values[0] <= 1.0 + 3.0 * error and np.isfinite(error)):
        raise TrackError(
            locked
            or f"{name}: the restitution comes out as {found.values[0]:.3g} ± {error:.2g}, where 0 "
            f"to 1 is possible; check the frequency, and whether impacts are missing"
        )
    warning = locked or _ambiguous(name, tried, start)
    about = (name, middle, origin, frequency, not contact)
    return _result(triples, found, about, warning)


def _spread(found: _Adjusted) -> Array:
    """Return the standard deviation of each restitution, from scatter and timing."""
    timing, scatter, _ = found.fit.components
    return np.asarray(np.sqrt(scatter**2 + timing**2 * (found.slopes**2).sum(axis=1)))


def _ambiguous(name: str, tried: list[_Start], best: _Start) -> str:
    """Return a warning if another motion fits the times nearly as well; else an empty string."""
    for other in sorted(tried, key=lambda one: one.misfit):
        worse = (other.misfit - best.misfit) * best.off.size
        e, rate = np.abs(other.values - best.values)[[0, 3]]
        if worse < EQUAL and (e > APART[0] or rate > APART[1] * best.values[3]):
            shown = " and ".join(
                f"e = {v[0]:.3f} at {v[3]:.4g} Hz" for v in (best.values, other.values)
            )
            return f"{name}: {shown} fit the times equally; record for longer, or the transient"
    return ""


def _triples(
    recordings: Sequence[Recording], gravity: float, contact: float
) -> tuple[Triples, str, float, float]:
    """Return the impacts of all recordings, their name, and middle and origin of their times."""
    if not recordings:
        raise TrackError("no recordings were given")
    lists = [impacts_in(recording) for recording in recordings]
    name = recordings[0].name
    if any(r.height is not None for r in recordings):
        raise TrackError(f"{name}: holds tracks instead of times of impacts")
    every = np.concatenate(lists)
    if sum(max(times.size - 2, 0) for times in lists) < FEWEST:
        raise TrackError(
            f"{name}: has {every.size} times of impacts; at least {FEWEST + 2} are needed over a "
            f"base that moves"
        )
    middle = float((every.min() + every.max()) / 2.0)
    starts = np.cumsum([0, *(times.size for times in lists)])
    inner = [np.arange(a + 1, b - 1) for a, b in pairwise(starts)]
    origin = origin_of(np.sort(every))
    return Triples(every - middle, np.concatenate(inner), gravity, contact), name, middle, origin


def _warning_if_locked(triples: Triples, name: str) -> str:
    """Return a warning for an orbit of equal flights; an empty string for others."""
    t, i = triples.time, triples.middle
    length = t[i + 1] - t[i]
    if np.std(length) > 0.02 * float(length.mean()):
        return ""
    return (
        f"{name}: all flights last {length.mean():.5g} s, as on an orbit that is locked to the "
        f"base: times then fix only one relation, V (1 + e)/(1 - e) = "
        f"{triples.gravity * length.mean() / 2:.4g} m/s with the velocity V of the base at an "
        f"impact; record the approach to the orbit, or another frequency"
    )


MOTION: Final = ("frequency", "base_acceleration", "amplitude", "phase")


def _result(
    triples: Triples,
    found: _Adjusted,
    about: tuple[str, float, float, float | None, bool],
    locked: str,
) -> xr.Dataset:
    name, middle, origin, known, bare = about
    rest = _remark_on_rest(triples)
    (e, s, c, f), covariance, g = found.values, found.covariance, triples.gravity
    velocity = float(np.hypot(s, c))
    phase = np.arctan2(c, s) - TWO_PI * f * (middle - origin)
    phase = float((phase + np.pi) % TWO_PI - np.pi)
    # by e, S, C, f
    of_velocity = np.array([0.0, s / velocity, c / velocity, 0.0])
    slopes = np.array(
        [
            [0.0, 0.0, 0.0, 1.0],
            TWO_PI / g * (f * of_velocity + [0.0, 0.0, 0.0, velocity]),
            (1.0 + e) * of_velocity + [velocity, 0.0, 0.0, 0.0],
            [0.0, -c / velocity**2, s / velocity**2, -TWO_PI * (middle - origin)],
        ]
    )
    errors = np.sqrt(np.einsum("ki,ij,kj->k", slopes, covariance, slopes))
    gamma = TWO_PI * f * velocity / g
    motion = dict(zip(MOTION, map(float, (f, gamma, (1.0 + e) * velocity, phase)), strict=True))
    motion |= {f"{key}_error": float(one) for key, one in zip(MOTION, errors, strict=True)}
    quantiles = np.array([found.fit.quantile(0, q) for q in QUANTILES])
    error = float(quantiles[2] - quantiles[1]) / 2.0
    pair = np.array([[1.0, 0.0, 0.0, 0.0], slopes[1]])
    both = pair @ covariance @ pair.T
    sure = error < WORST[0] and errors[1] < WORST[1] * gamma and not locked
    relation = "" if sure or locked else _relation(name, float(e), gamma, both)
    bounce, speed, _ = triples.bounces(triples.time, found.values[1:])
    timing = found.fit.components[0]
    spread = timing * np.sqrt((found.slopes**2).sum(axis=1))
    return xr.Dataset(
        {
            "restitution": float(e),
            "restitution_error": error,
            "restitution_quantile": ("quantile", quantiles),
            "speed": float(np.median(speed)),
            **dict.fromkeys(("slope", "slope_error", "prediction_error"), np.nan),
            **motion,
            "determined": np.int8(sure),
            **component_variables(found.fit),
            "bounce_restitution": ("bounce", bounce),
            "bounce_speed": ("bounce", speed),
            "bounce_time": ("bounce", triples.time[triples.middle] + middle),
            "bounce_error": ("bounce", spread),
            "bounce_used": ("bounce", found.used.astype(np.int8)),
            "bounce_drop": ("bounce", np.zeros(bounce.size, np.int64)),
            "contact_effect": (("effect",), _contact_effect(triples, found, slopes[1])),
            "correlation": float(both[0, 1] / np.sqrt(both[0, 0] * both[1, 1])),
        },
        coords={"quantile": list(QUANTILES), "drop": [name], "effect": ["restitution", "Gamma"]},
        attrs={
            "bounces": int(found.used.sum()),
            "dependence": "constant",
            "speed_known": 1,
            "origin": origin,
            "frequency_known": int(known is not None),
            "contact_known": int(not bare),
            "warning": locked or relation,
            "remarks": "\n".join(filter(None, (_remark_on_outliers(found.used), rest))),
        },
    )


def _relation(name: str, e: float, gamma: float, both: Array) -> str:
    """State the relation that the times determine, from the covariance of e and Gamma, (2, 2)."""
    slope = both[0, 1] / both[1, 1]
    left = np.sqrt(max(both[0, 0] - slope * both[0, 1], 0.0))
    return (
        f"{name}: the orbit visits too few phases; the times fix one relation, e = {e:.4f} + "
        f"({slope:.4g}) (Gamma - {gamma:.4g}) within {left:.2g}; record the approach to it"
    )


def _remark_on_rest(triples: Triples) -> str:
    """Return a remark if nearly all flights are shorter than those before, as over a floor."""
    t, i = triples.time, triples.middle
    shorter = t[i + 1] - t[i] < t[i] - t[i - 1]
    if np.mean(shorter) < SHORTER:
        return ""
    return (
        "the flights get shorter and shorter, as over a base at rest: for its restitution use "
        "vibrosweep lab restitution, or vs.lab.restitution"
    )


def _remark_on_outliers(used: Flags) -> str:
    if used.all():
        return ""
    outliers = np.count_nonzero(~used)
    return f"{outliers} bounces are outliers and left out: missed or false clicks"


def _contact_effect(triples: Triples, found: _Adjusted, gamma: Array) -> Array:
    """Return the changes of e and of the acceleration due to contacts longer by 1 ms."""
    longer = triples._replace(contact=triples.contact + 1e-3)
    motion = found.values[1:]
    change = longer.bounces(longer.time, motion)[0] - triples.bounces(triples.time, motion)[0]
    rows, n = found.rows, change.size
    shaped = np.zeros(rows.value.shape)
    for k in range(len(shaped)):
        part = change[k * BLOCK : min((k + 1) * BLOCK, n)]
        shaped[k, : part.size] = part
    shaped *= rows.bounce
    _, inverse = weighted_residuals(rows, found.fit)
    top = np.einsum("dri,drs,ds->i", rows.design, inverse, shaped)
    normal = np.einsum("dri,drs,dsj->ij", rows.design, inverse, rows.design)
    moved = np.linalg.pinv(normal) @ top
    return np.array([moved[0], gamma @ moved])
