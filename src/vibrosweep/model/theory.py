"""Closed forms of the vibro-impact map (numpy only).

Source: the locked orbits of the high-bounce map (Holmes 1982, J. Sound Vib. 84, 173), written for
a kick of velocity amplitude A on a base that stays at height zero.  All functions broadcast.

A locked orbit of mode k impacts once every k forcing periods with speed v = g k / (2 f).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "amplitude_max",
    "amplitude_min",
    "flight_time_bound",
    "locked_height",
    "locked_phase",
    "locked_velocity",
    "multipliers",
    "recognition_periods",
    "unforced_rest_impact",
    "unforced_rest_time",
]

Array = NDArray[np.float64]
TWO_PI = 2.0 * np.pi


def _kick(amplitude: ArrayLike, frequency: ArrayLike, gravity: ArrayLike) -> Array:
    return np.asarray(2.0 * np.asarray(frequency) * np.asarray(amplitude) / np.asarray(gravity))


def recognition_periods(restitution: ArrayLike, k: ArrayLike = 1) -> Array:
    """Forcing periods in which an orbit locked to k periods returns bit for bit, 150 k / |ln e|.

    Both multipliers have the modulus sqrt(e) over most of the window.  From a distance of 1 to one
    rounding, 2^-53, it takes 2 * 53 ln 2 / |ln e| impacts, and up to twice that until the anchors
    of the recogniser, whose ages double, have seen it.  Infinite for e = 1, 0 for e = 0.
    """
    with np.errstate(divide="ignore"):
        return np.asarray(150.0 * np.asarray(k) / np.abs(np.log(np.asarray(restitution))))


def locked_velocity(k: ArrayLike, frequency: ArrayLike = 1.0, gravity: ArrayLike = 9.81) -> Array:
    """Speed of the locked orbit of mode k, g k / (2 f), in m s-1."""
    return np.asarray(np.asarray(gravity) * np.asarray(k) / (2.0 * np.asarray(frequency)))


def locked_height(k: ArrayLike, frequency: ArrayLike = 1.0, gravity: ArrayLike = 9.81) -> Array:
    """Rebound height of the locked orbit of mode k, g k^2 / (8 f^2), in m.

    Neither the restitution nor the amplitude enters: this is the plateau of heights.
    """
    return np.asarray(np.asarray(gravity) * np.asarray(k) ** 2 / (8.0 * np.asarray(frequency) ** 2))


def locked_phase(
    k: ArrayLike,
    restitution: ArrayLike,
    amplitude: ArrayLike,
    frequency: ArrayLike = 1.0,
    gravity: ArrayLike = 9.81,
) -> Array:
    """Phase of impact in turns of the stable branch, in [1/4, 1/2]; NaN below A_min.

    sin(2 pi x) = (1 - e) k / a with cos(2 pi x) < 0.
    """
    a = _kick(amplitude, frequency, gravity)
    need = (1.0 - np.asarray(restitution)) * np.asarray(k)
    with np.errstate(invalid="ignore", divide="ignore"):
        sine = np.where(need <= a, need / a, np.nan)
    return np.asarray(0.5 - np.arcsin(sine) / TWO_PI)


def amplitude_min(
    k: ArrayLike,
    restitution: ArrayLike,
    frequency: ArrayLike = 1.0,
    gravity: ArrayLike = 9.81,
) -> Array:
    """Smallest amplitude in m s-1 at which mode k exists, (1 - e) g k / (2 f)."""
    return np.asarray((1.0 - np.asarray(restitution)) * locked_velocity(k, frequency, gravity))


def amplitude_max(
    k: ArrayLike,
    restitution: ArrayLike,
    frequency: ArrayLike = 1.0,
    gravity: ArrayLike = 9.81,
) -> Array:
    """Amplitude in m s-1 up to which mode k is stable: a^2 = ((1 - e) k)^2 + ((1 + e) / pi)^2.

    There a multiplier passes -1 and the orbit doubles its period.
    """
    e = np.asarray(restitution, dtype=np.float64)
    a = np.hypot((1.0 - e) * np.asarray(k), (1.0 + e) / np.pi)
    return np.asarray(a * np.asarray(gravity) / (2.0 * np.asarray(frequency)))


def multipliers(
    k: ArrayLike,
    restitution: ArrayLike,
    amplitude: ArrayLike,
    frequency: ArrayLike = 1.0,
    gravity: ArrayLike = 9.81,
) -> NDArray[np.complex128]:
    """Floquet multipliers of the stable branch of mode k; their product is the restitution.

    Roots of lambda^2 - (1 + e + 2 pi a cos 2 pi x) lambda + e = 0.

    Returns
    -------
    numpy.ndarray
        Complex, with a last axis of length 2; NaN below A_min.
    """
    e = np.asarray(restitution, dtype=np.float64)
    a = _kick(amplitude, frequency, gravity)
    need = (1.0 - e) * np.asarray(k)
    with np.errstate(invalid="ignore"):
        # a cos(2 pi x) < 0 on the stable branch, without passing through the phase
        a_cosine = -np.sqrt((a - need) * (a + need))
    trace = np.asarray(1.0 + e + TWO_PI * a_cosine)
    root = np.sqrt((trace * trace - 4.0 * e).astype(np.complex128))
    # the larger one without cancellation, the smaller one from the product
    larger = np.asarray((trace + np.where(trace < 0.0, -root, root)) / 2.0)
    divisible = ~np.isnan(larger) & (larger != 0.0)
    smaller = np.divide(e, larger, out=np.asarray(0.0 * larger), where=divisible)
    return np.stack([larger, smaller], axis=-1)


def flight_time_bound(launch_flight: ArrayLike, kick: ArrayLike, restitution: ArrayLike) -> Array:
    """Bound of every flight time in forcing periods, max(u0, a / (1 - e)); infinite at e = 1."""
    with np.errstate(divide="ignore", invalid="ignore"):
        fed = np.asarray(kick) / (1.0 - np.asarray(restitution, dtype=np.float64))
    fed = np.where(np.asarray(kick) == 0.0, 0.0, fed)
    return np.maximum(np.asarray(launch_flight, dtype=np.float64), fed)


def unforced_rest_impact(
    launch_flight: ArrayLike, restitution: ArrayLike, rest_flight: ArrayLike
) -> Array:
    """Count the landings until a particle without excitation comes to rest for good.

    The first n >= 1 with e^n u0 <= r, where u0 and r are flight times in forcing periods (any
    common unit serves).  Infinite where e = 1 and u0 > r.
    """
    u0 = np.asarray(launch_flight, dtype=np.float64)
    e = np.asarray(restitution, dtype=np.float64)
    r = np.asarray(rest_flight, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        n = np.ceil(np.log(r / u0) / np.log(e))
        # a quotient of logarithms that should be whole may round to either side
        n = np.where(e ** (n - 1.0) * u0 <= r, n - 1.0, n)
        n = np.where(e**n * u0 > r, n + 1.0, n)
        n = np.where(e == 1.0, np.inf, n)
        n = np.where((e == 0.0) | (e * u0 <= r), 1.0, n)
    return np.asarray(n)


def unforced_rest_time(
    launch_velocity: ArrayLike,
    restitution: ArrayLike,
    contact_time: ArrayLike,
    gravity: ArrayLike = 9.81,
) -> Array:
    """Time in s from launch until a particle without excitation comes to rest for good.

    The flights last (2 v0 / g) e^j for j = 0 ... n - 1; their sum tends to
    (2 v0 / g) / (1 - e) as the contact time goes to zero.
    """
    first = 2.0 * np.asarray(launch_velocity, dtype=np.float64) / np.asarray(gravity)
    e = np.asarray(restitution, dtype=np.float64)
    n = unforced_rest_impact(first, e, contact_time)
    with np.errstate(invalid="ignore", divide="ignore"):
        # 1 - e^n without cancellation where e is next to 1
        total = first * -np.expm1(n * np.log1p(e - 1.0)) / (1.0 - e)
    return np.asarray(np.where(e == 1.0, np.where(n == 1.0, first, np.inf), total))
