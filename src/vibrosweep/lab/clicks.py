"""Bounces from the times of impacts on a floor.

The interval between two impacts is a contact time and a flight time.  A missed click merges two
flights, a false one splits a flight; both change the ratio of successive intervals by far more than
a bounce does.  The interpretation with the fewest such events is found by dynamic programming.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError, TrackError
from vibrosweep.lab.ballistics import (
    POWER,
    BallInputs,
    Bounces,
    Input,
    derivatives,
    flight_of,
    nominal_of,
)
from vibrosweep.lab.recordings import Recording
from vibrosweep.mistakes import Value, argument

LONGEST: Final = 60.0  # s, longest typical flight, from a height of 4 km
LATEST: Final = 1e11  # s; the spacing of doubles there is 15 us
RATIOS: Final = (0.3, 1.0)  # of successive intervals, used for the first estimate of e
# Cost of a missed or false click: that of a ratio off by 3.5 standard deviations
EVENT: Final = 12.0
BREAK: Final = 30.0  # cost of starting another drop in the same list
LEAST_SPREAD: Final = 0.02  # of the logarithm of a ratio
FARTHEST: Final = 4  # largest number of successive false clicks, plus 1
MOST_EVENTS: Final = 0.4  # largest share of missed and false clicks
OTHER: Final = 1.6  # ratio of e after the fall to that of other bounces that no ball has
MISSED: Final = 2  # largest number of successive missed clicks
ROUNDS: Final = 4


class Reading(NamedTuple):
    """An interval: its first and last click, and the number of missed clicks between them."""

    first: int
    last: int
    missed: int


def typical_ratio(lists: Sequence[Array]) -> tuple[float, float]:
    """Return the median ratio of successive intervals, and the scatter of its logarithm."""
    ratios = np.concatenate([steps[1:] / steps[:-1] for steps in lists])
    ratios = ratios[(ratios > RATIOS[0]) & (ratios < RATIOS[1])]
    if not ratios.size:
        return np.nan, np.nan
    logs = np.log(ratios)
    middle = np.median(logs)
    spread = 1.48 * float(np.median(np.abs(logs - middle)))
    return float(np.exp(middle)), max(LEAST_SPREAD, 2.0 * spread)


def read_lists(lists: Sequence[Array]) -> list[list[list[Reading]]]:
    """Divide the lists of clicks of one ball into drops; no drops without a typical ratio.

    A false click changes three ratios, so that the first typical ratio may be far off; that of the
    flights found with it is better.
    """
    drops: list[list[list[Reading]]] = [[] for _ in lists]
    ratio, spread = typical_ratio([np.diff(times) for times in lists])
    for _ in range(ROUNDS):
        if not np.isfinite(ratio):
            break
        drops = [read_clicks(times, ratio, spread) for times in lists]
        flights = [
            np.array([times[r.last] - times[r.first] if not r.missed else np.nan for r in drop])
            for times, own in zip(lists, drops, strict=True)
            for drop in own
        ]
        before, (ratio, spread) = (ratio, spread), typical_ratio(flights)
        if (ratio, spread) == before:
            break
    return drops


def read_clicks(times: Array, ratio: float, spread: float) -> list[list[Reading]]:
    """Divide a list of clicks into drops of successive flights, at the lowest cost."""
    n = times.size
    series = np.cumsum(ratio ** np.arange(MISSED + 1))  # intervals in units of their first flight
    best: dict[Reading, tuple[float, Reading | None]] = {}
    by_last: list[list[Reading]] = [[] for _ in range(n)]
    ends = np.full(n, np.inf)  # lowest cost of everything before a drop that begins with this click
    ends[0] = 0.0
    previous: list[Reading | None] = [None] * n
    for j in range(n):
        for i in range(max(0, j - FARTHEST), j):
            for missed in range(MISSED + 1):
                here = Reading(i, j, missed)
                flight = (times[j] - times[i]) / series[missed]
                own = EVENT * (missed + j - i - 1)
                options: list[tuple[float, Reading | None]] = [(ends[i] + own, None)]
                for before in by_last[i]:
                    length = times[i] - times[before.first]
                    last = length * ratio**before.missed / series[before.missed]
                    off = np.log(flight / last / ratio) / spread
                    options.append((best[before][0] + own + off * off, before))
                best[here] = min(options, key=lambda option: option[0])
                by_last[j].append(here)
        if by_last[j] and j + 1 < n:
            cheapest = min(by_last[j], key=lambda reading: best[reading][0])
            ends[j + 1] = best[cheapest][0] + BREAK
            previous[j + 1] = cheapest
        if j + 1 < n and ends[j] + EVENT < ends[j + 1]:  # a false click at the beginning
            ends[j + 1], previous[j + 1] = ends[j] + EVENT, previous[j]
    drops: list[list[Reading]] = []
    # allow for false clicks at the end
    last = min(
        (r for row in by_last for r in row), key=lambda r: best[r][0] + EVENT * (n - 1 - r.last)
    )
    reading: Reading | None = last
    while reading is not None:
        drop = [reading]
        while (earlier := best[drop[-1]][1]) is not None:
            drop.append(earlier)
        drops.append(drop[::-1])
        reading = previous[drop[-1].first]
    return drops[::-1]


def impacts_in(recording: Recording) -> Array:
    """Return the sorted times of impacts without duplicates."""
    times = np.unique(recording.time[np.isfinite(recording.time)])
    if times.size and np.abs(times).max() > LATEST:
        raise TrackError(
            f"{recording.name}: a time is {times[np.abs(times).argmax()]:g} s: must be at most "
            f"{LATEST:g} s; check the column"
        )
    if times.size > 2 and (usual := float(np.median(np.diff(times)))) > LONGEST:
        raise TrackError(
            f"{recording.name}: {usual:.4g} s from impact to impact is too long for a bouncing "
            f"ball; if the times are in ms, write their unit in the heading: time (ms)"
        )
    return times


def bounces_of_clicks(
    recordings: Sequence[Recording], inputs: BallInputs
) -> tuple[list[Bounces], list[str]]:
    """Return the bounces of lists of clicks, and remarks."""
    recordings = [replace(r, time=impacts_in(r)) for r in recordings]
    drops_of: dict[int, list[list[Reading]]] = {}
    for group in dict.fromkeys(r.group for r in recordings):  # each of one ball
        own = [k for k, r in enumerate(recordings) if r.group == group and r.time.size > 2]
        if own:
            drops_of |= zip(own, read_lists([recordings[k].time for k in own]), strict=True)
    found, remarks = [], []
    for k, recording in enumerate(recordings):
        n = recording.time.size
        drops = drops_of.get(k, [])
        if inputs.drop_height and n == 2:
            drops = [[Reading(0, 1, 0)]]
        if not drops:
            what = "no interval is 0.3 to 1 times as long as the one before"
            text = f"has {n} impact times, at least 3 are needed" if n < 3 else what
            remarks.append(f"{recording.name}: no bounce; {text}")
            continue
        read = sum(1 + len(drop) for drop in drops)
        missed = sum(r.missed for drop in drops for r in drop)
        events = [f"{m} {w}" for m, w in ((missed, "missed"), (n - read, "false")) if m]
        if events:
            remarks.append(f"{recording.name}: {' and '.join(events)} of {n} clicks")
        if missed + n - read > MOST_EVENTS * n:
            remarks[-1] += ", too many to tell impacts apart: left out"
            continue
        for number, drop in enumerate(drops, start=1):
            name = recording.name if len(drops) == 1 else f"{recording.name} ({number})"
            start = inputs.drop_height is not None and not drop[0].missed
            made = _bounces(recording, drop, inputs, start, name)
            if made.restitution.size:
                found.append(made)
    if found and inputs.drop_height:
        _check_drop_height(found, inputs.drop_height.value)
    return found, remarks


def _check_drop_height(drops: list[Bounces], height: float) -> None:
    """Raise an error unless the first bounces, after the fall, resemble the others."""
    e = np.concatenate([drop.restitution for drop in drops])
    first = np.isinf(np.concatenate([drop.before for drop in drops if drop.before is not None]))
    if not first.any() or first.all():
        return
    ratio = float(np.median(e[first]) / np.median(e[~first]))
    if not 1.0 / OTHER < ratio < OTHER:
        rule = (
            f": does not agree with the flights, which fit a fall from about "
            f"{height * ratio**2:.2g} m; give it in m, or leave it out"
        )
        raise ParameterError(argument("drop_height"), Value(height), rule)


def _bounces(
    recording: Recording,
    drop: list[Reading],
    inputs: BallInputs,
    falls: bool,
    name: str,
    shift: Array | float = 0.0,
    at: Mapping[str, float] | None = None,
) -> Bounces:
    """Return the bounces between flights without missed clicks.

    Restitutions are linearized about clicks shifted by `shift` (s), and about the inputs `at`
    instead of their means.
    """
    clicks = [drop[0].first, *(reading.last for reading in drop)]
    seen = recording.time[clicks]
    whole = np.array([reading.missed == 0 for reading in drop])
    used = np.concatenate([[falls], whole[1:] & whole[:-1]])  # the bounce before each flight
    means = {
        "contact": inputs.contact,
        "contact_power": POWER,
        "drag": inputs.drag or Input(0.0),
        "gravity": inputs.gravity,
        **({"drop_height": inputs.drop_height} if inputs.drop_height else {}),
    }
    middle = float(np.median(np.diff(seen)))
    place = {key: (at or {}).get(key, one.value) for key, one in means.items()}

    def values(times: Array, **changed: float) -> tuple[Array, Array]:
        now = {**place, **changed}
        g, drag, lengths = now["gravity"], now["drag"], np.diff(times)
        # contact time scales as (impact speed)^-p
        contact = now["contact"] * (np.maximum(lengths, 1e-9) / middle) ** -now["contact_power"]
        v = nominal_of(np.maximum(lengths - contact, 0.1 * lengths), g, drag)
        fallen = np.sqrt(2.0 * g * now.get("drop_height", 1.0))
        up, down, _, _ = flight_of(np.append(fallen, v), g, drag)
        return (up[1:] / down[:-1])[used], down[:-1][used]

    about = seen + shift
    restitution, speed = values(about)
    steps = np.full(seen.size, 1e-4 * float(np.diff(about).min()))
    moved = derivatives(lambda times: values(times)[0], about, steps)
    slopes = {}
    for key, one in means.items():
        h = max(one.error, 1e-3 * one.value, 1e-5) * 0.01
        up, down = (values(about, **{key: place[key] + s})[0] for s in (h, -h))
        slopes[key] = (up - down) / (2.0 * h)
    back = sum(slopes[key] * (one.value - place[key]) for key, one in means.items())
    return Bounces(
        name=name,
        group=recording.group,
        restitution=restitution + moved @ (seen - about) + back,
        speed=speed,
        time=seen[:-1][used],
        fixed=moved @ moved.T * recording.rounding**2 / 12.0,
        timing=moved @ moved.T,
        # evaluated with an input too small by one unit, e is off by minus its derivative
        inputs={key: -slope for key, slope in slopes.items()},
        found={},
        speed_known=recording.rate_known,
        gravity=None,
        remarks=(),
        clicks=moved,
        before=np.append(np.inf, np.diff(about))[:-1][used],
        middle=middle,
        rounding=recording.rounding,
        about=partial(_bounces, recording, drop, inputs, falls, name),
    )
