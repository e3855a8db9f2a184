"""Flights in a track whose scale is not known.

A curvature that many stretches of the track share is that of free fall.  Stretches that have it are
extended as far as their parabolas go.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrosweep.arrays import Array
from vibrosweep.errors import TrackError

LEAST_SAMPLES: Final = 5  # of a flight
SHARPNESS: Final = 0.2  # largest relative error of the curvature of a part of a flight
RESOLVED: Final = 0.06  # and of a flight: a rise of some fifteen times the noise
STEEP: Final = 8.0  # rise of an inclined floor between contacts, in their deviations
FAR: Final = 4.5  # distance of an odd sample, in standard deviations
# A contact takes at most 20 ms and as many frames
CONTACT_FRAMES: Final = 3.5


class Stretch(NamedTuple):
    """Successive samples that a parabola describes: height, slope and curvature at a centre."""

    samples: NDArray[np.intp]
    centre: float
    length: float
    terms: Array  # height, slope, curvature (positive for free fall)
    errors: Array

    def height(self, time: Array | float, curvature: float) -> Array:
        """Return heights of the parabola of this curvature."""
        since = np.asarray(time) - self.centre
        return np.asarray(self.terms[0] + self.terms[1] * since - 0.5 * curvature * since**2)


def noise_of(height: Array) -> float:
    """Return the noise of a smooth track where it moves, from third differences.

    A ball at rest is located better than one that moves.
    """
    third = np.abs(np.diff(height, 3))
    moved = np.abs(height[3:] - height[:-3])
    moving = third[moved >= 0.1 * np.quantile(moved, 0.9)] if third.size else third
    return float(1.48 * np.median(moving) / np.sqrt(20.0)) if moving.size else 0.0


def _parabolas(
    time: Array, height: Array, samples: NDArray[np.intp], noise: float
) -> list[Stretch]:
    """Fit a parabola to each row of samples."""
    t, y = time[samples], height[samples]
    centre, length = t.mean(axis=1), t[:, -1] - t[:, 0]
    # in units of the length, so that the equations are well conditioned
    since = (t - centre[:, None]) / length[:, None]
    design = np.stack([np.ones_like(since), since, -0.5 * since**2], axis=2)
    inverse = np.linalg.inv(np.einsum("wni,wnj->wij", design, design))
    unit = length[:, None] ** -np.arange(3.0)
    terms = np.einsum("wij,wnj,wn->wi", inverse, design, y) * unit
    errors = noise * np.sqrt(np.einsum("wii->wi", inverse)) * unit
    return [Stretch(*row) for row in zip(samples, centre, length, terms, errors, strict=True)]


def _windows(time: Array, height: Array, noise: float) -> list[Stretch]:
    """Return stretches of many lengths that are parabolas but for the noise, long ones first."""
    found, length = [], LEAST_SAMPLES
    while length <= time.size:
        starts = np.arange(0, time.size - length + 1, max(1, length // 4))
        for one in _parabolas(time, height, starts[:, None] + np.arange(length), noise):
            left = height[one.samples] - one.height(time[one.samples], one.terms[2])
            if (left @ left) < 1.7**2 * noise**2 * (length - 3) + 1e-300:
                found.append(one)
        length = max(length + 1, int(1.25 * length))
    return found[::-1]


def _shared_curvature(stretches: list[Stretch]) -> float:
    """Return the curvature of most stretches, by the half-sample mode; NaN for none.

    A stretch counts with its rise above its chord: a ball that is held or at rest has none.
    """
    sharp = [s for s in stretches if s.errors[2] < SHARPNESS / 2 * abs(s.terms[2])]
    if not sharp:
        return np.nan
    curvature = np.array([s.terms[2] for s in sharp])
    rise = np.abs(curvature) * np.array([s.length**2 for s in sharp]) / 8.0
    copies = np.ceil(200.0 * rise / rise.max()).astype(int) - 1 + (rise == rise.max())
    values = np.sort(np.repeat(curvature, copies))
    while values.size > 2:
        half = min((values.size + 1) // 2 + 1, values.size - 1)
        start = int(np.argmin(values[half - 1 :] - values[: values.size - half + 1]))
        values = values[start : start + half]
    return float(values.mean())


def find_flights(time: Array, height: Array, name: str) -> tuple[list[Stretch], float, float]:
    """Return flights in the order of time, their curvature, and the noise."""
    step = float(np.median(np.abs(np.diff(height)))) if height.size > 1 else 0.0
    noise = max(noise_of(height), 1e-6 * step, 1e-12 * float(np.ptp(height)))
    stretches = _windows(time, height, noise)
    curvature = _shared_curvature(stretches)
    if curvature < 0.0:
        raise TrackError(f"{name}: the ball falls upwards; heights grow the other way (--axis)")
    free = np.ones(time.size, dtype=bool)
    flights = []
    for seed in stretches:
        off = abs(seed.terms[2] - curvature)
        if (
            not free[seed.samples].all()
            or seed.errors[2] > SHARPNESS * curvature
            or off > 5.0 * seed.errors[2] + 0.05 * curvature
        ):
            continue
        grown = _grown(time, height, seed, free, noise)
        free[grown.samples] = False
        off = abs(grown.terms[2] - curvature)
        if grown.errors[2] < RESOLVED * curvature and off < 0.15 * curvature:
            flights.append(grown)
    return sorted(flights, key=lambda s: s.centre), curvature, noise


def _grown(
    time: Array, height: Array, seed: Stretch, free: NDArray[np.bool_], noise: float
) -> Stretch:
    """Extend a stretch to both sides while its parabola goes on; single odd samples are skipped."""
    now, longest = seed, float(np.median(np.diff(time))) * 8.0
    for side in (1, -1):
        skipped = 0
        place = now.samples[-1 if side > 0 else 0] + side
        while 0 <= place < time.size and free[place] and skipped < 2:
            edge = now.samples[-1 if side > 0 else 0]
            since = time[place] - now.centre
            if abs(time[place] - time[edge]) > longest:
                break
            spread = np.hypot(noise, now.errors @ np.abs([1.0, since, 0.5 * since**2]))
            if abs(height[place] - now.height(time[place], now.terms[2])) < FAR * spread:
                samples = np.sort(np.append(now.samples, place))
                (now,), skipped = _parabolas(time, height, samples[None], noise), 0
            else:
                skipped += 1
            place += side
    return now


class Contact(NamedTuple):
    """Where a flight and the next meet."""

    flight: int  # number of the flight that ends
    time: float
    height: float
    speed: float  # of arrival


def contacts_of(flights: list[Stretch], time: Array, curvature: float) -> list[Contact]:
    """Return the contacts between neighbouring flights, wherever the floor is."""
    step = float(np.median(np.diff(time)))
    found = []
    for k, (one, two) in enumerate(pairwise(flights)):
        middle = 0.5 * (one.centre + two.centre)
        up, down = (
            np.array([f.height(middle, curvature), f.terms[1] - curvature * (middle - f.centre)])
            for f in (two, one)
        )
        meeting = middle - (up[0] - down[0]) / (up[1] - down[1]) if up[1] != down[1] else np.inf
        end, start = time[one.samples[-1]], time[two.samples[0]]
        fast = -(down[1] - curvature * (meeting - middle)), up[1] - curvature * (meeting - middle)
        near = end - 2 * step < meeting < start + 2 * step
        if near and 0.0 < fast[1] < 1.1 * fast[0] and start - end < 0.02 + CONTACT_FRAMES * step:
            found.append(Contact(k, meeting, float(one.height(meeting, curvature)), fast[0]))
    return found


def chains_of(contacts: list[Contact], curvature: float, noise: float) -> list[list[int]]:
    """Return runs of flights with a contact with the floor between each and the next."""
    if not contacts:
        return []
    # a contact with a hand is at another height; a long contact crosses below the floor
    levels, speeds = (
        np.array([getattr(c, name) for c in contacts]) for name in ("height", "speed")
    )
    near_floor = np.abs(levels - np.median(levels)) < 8.0 * noise + 0.2 * speeds**2 / curvature
    chains: list[list[int]] = []
    for (k, *_), good in zip(contacts, near_floor, strict=True):
        if not good:
            continue
        if chains and chains[-1][-1] == k:
            chains[-1].append(k + 1)
        else:
            chains.append([k, k + 1])
    return chains


def slope_of_floor(contacts: list[Contact], time: Array, beside: Array, noise: float) -> float:
    """Return the slope of the line on which contacts lie; 0 unless they show one."""
    x, y = (
        np.interp([c.time for c in contacts], time, beside),
        np.array([c.height for c in contacts]),
    )
    if x.size < 3 or np.ptp(x) < 20.0 * noise:
        return 0.0
    # pairs of contacts, so that one with a hand does not decide
    one, two = np.triu_indices(x.size, 1)
    wide = np.abs(x[two] - x[one]) > 0.2 * np.ptp(x)
    slope = float(np.median((y[two] - y[one])[wide] / (x[two] - x[one])[wide]))
    left = y - slope * x
    spread = max(1.48 * float(np.median(np.abs(left - np.median(left)))), noise)
    return slope if abs(slope) * np.ptp(x) > STEEP * spread else 0.0
