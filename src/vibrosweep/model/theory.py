"""Closed forms of the bouncing ball, on a base at height zero and on one that moves (numpy only).

Source: the locked orbits of the high-bounce map (Holmes 1982, J. Sound Vib. 84, 173), written for
a kick of velocity amplitude A on a base that stays at height zero, and of the exact model (Luck &
Mehta 1993, Phys. Rev. E 48, 3988), whose base moves with the velocity amplitude A / (1 + e).  All
functions broadcast; `base` is one of `FIXED`.

A locked orbit of mode k impacts once every k forcing periods and leaves with the speed
v = g k / (2 f), on either base.  With Gamma = 2 pi f A / ((1 + e) g), the acceleration of the
moving base in g, and s = -Gamma cos(2 pi x) at the landing, its multipliers solve

    z^2 - (1 + p - 2 (1 + p) s / s_m) z + p = 0,

    high-bounce    p = e      s_m = 1
    moving         p = e^2    s_m = 2 (1 + e^2) / (1 + e)^2 = 1 + ((1 - e) / (1 + e))^2

so that it is stable for 0 < s < s_m, where a multiplier passes -1.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibrosweep.errors import ParameterError
from vibrosweep.model.parameters import BASES

__all__ = [
    "FIXED",
    "amplitude_max",
    "amplitude_min",
    "exponent_sum",
    "flight_time_bound",
    "liftoff_flight",
    "liftoff_speed_bound",
    "locked_apex",
    "locked_height",
    "locked_phase",
    "locked_velocity",
    "multipliers",
    "recognition_periods",
    "unforced_rest_impact",
    "unforced_rest_time",
]

Array = NDArray[np.float64]
HIGH_BOUNCE, MOVING = FIXED = BASES[:2]  # bases that particles do not act on
TWO_PI = 2.0 * np.pi
HALVINGS = 60  # of a bracket of the size of what is sought, to a rounding


def _kick(amplitude: ArrayLike, frequency: ArrayLike, gravity: ArrayLike) -> Array:
    return np.asarray(2.0 * np.asarray(frequency) * np.asarray(amplitude) / np.asarray(gravity))


def _moves(base: str) -> bool:
    if base not in FIXED:
        raise ParameterError(f"base = {base!r}: must be one of {', '.join(FIXED)}")
    return base == MOVING


def _contraction(restitution: ArrayLike, base: str) -> Array:
    """Product of the multipliers of a locked orbit, p of the module's text."""
    e = np.asarray(restitution, dtype=np.float64)
    return e * e if _moves(base) else e


def _steepest(restitution: ArrayLike, base: str) -> Array:
    """Return s_m of the module's text, -Gamma cos(2 pi x) at the loss of stability."""
    e = np.asarray(restitution, dtype=np.float64)
    return 1.0 + ((1.0 - e) / (1.0 + e)) ** 2 if _moves(base) else np.ones_like(e)


def exponent_sum(restitution: ArrayLike, base: str = HIGH_BOUNCE) -> Array:
    """Sum of the Lyapunov exponents of an orbit without rests, per impact: ln e or 2 ln e.

    On a moving base an impact changes an area of phase and absolute speed by e^2 z / z', where z
    and z' are the relative speeds with which the particle left before and leaves after it; along
    an orbit the quotients cancel.
    """
    with np.errstate(divide="ignore"):
        one = np.log(np.asarray(restitution, dtype=np.float64))
    return np.asarray(2.0 * one if _moves(base) else one)


def recognition_periods(restitution: ArrayLike, k: ArrayLike = 1, base: str = HIGH_BOUNCE) -> Array:
    """Forcing periods in which an orbit locked to k periods returns bit for bit, 150 k / |ln p|.

    Both multipliers have the modulus sqrt(p) over most of the window, where p is e, or e^2 on a
    moving base.  From a distance of 1 to one rounding, 2^-53, it takes 2 * 53 ln 2 / |ln p|
    impacts, and up to twice that until the anchors of the recogniser, whose ages double, have seen
    it; none is seen before 64 impacts.  Infinite for e = 1, 0 for e = 0.
    """
    with np.errstate(divide="ignore"):
        return np.asarray(150.0 * np.asarray(k) / np.abs(exponent_sum(restitution, base)))


def locked_velocity(k: ArrayLike, frequency: ArrayLike = 1.0, gravity: ArrayLike = 9.81) -> Array:
    """Speed of the locked orbit of mode k, g k / (2 f), in m s-1."""
    return np.asarray(np.asarray(gravity) * np.asarray(k) / (2.0 * np.asarray(frequency)))


def locked_height(k: ArrayLike, frequency: ArrayLike = 1.0, gravity: ArrayLike = 9.81) -> Array:
    """Rebound height of the locked orbit of mode k, g k^2 / (8 f^2), in m.

    Neither the restitution nor the amplitude enters: this is the plateau of heights.  On a moving
    base it is the height above the point of lift-off; see `locked_apex`.
    """
    return np.asarray(np.asarray(gravity) * np.asarray(k) ** 2 / (8.0 * np.asarray(frequency) ** 2))


def locked_apex(
    k: ArrayLike,
    restitution: ArrayLike,
    amplitude: ArrayLike,
    frequency: ArrayLike = 1.0,
    gravity: ArrayLike = 9.81,
) -> Array:
    """Highest point of the locked orbit above the mean level of a moving base, in m.

    The particle leaves at the height -B cos(2 pi x) of the base, which is above its mean level on
    the stable branch, and rises by `locked_height`.  With B = Gamma g / (2 pi f)^2 the apex is

        g / (8 f^2) (k^2 + 2 s / pi^2),    s = -Gamma cos(2 pi x) = sqrt(Gamma^2 - Gamma_k^2).

    NaN below A_min.
    """
    e = np.asarray(restitution, dtype=np.float64)
    a_cosine = _kick_cosine(k, e, amplitude, frequency, gravity)
    above = -2.0 * a_cosine / (np.pi * (1.0 + e))
    unit = locked_height(1, frequency, gravity)
    return np.asarray(unit * (np.asarray(k) ** 2 + above))


def locked_phase(
    k: ArrayLike,
    restitution: ArrayLike,
    amplitude: ArrayLike,
    frequency: ArrayLike = 1.0,
    gravity: ArrayLike = 9.81,
) -> Array:
    """Phase of impact in turns of the stable branch, in [1/4, 1/2]; NaN below A_min.

    sin(2 pi x) = (1 - e) k / a with cos(2 pi x) < 0, on either base: a flight of whole periods
    ends at the height at which it began, so that the motion of the base does not enter.
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
    """Smallest amplitude in m s-1 at which mode k exists, (1 - e) g k / (2 f).

    It is the same on either base: Gamma_k = pi k (1 - e) / (1 + e).  On a moving base a particle
    that is hardly reflected, e < 0.0205 for k = 1 and less for more periods, would meet the base
    sooner than after k periods close to this amplitude.
    """
    return np.asarray((1.0 - np.asarray(restitution)) * locked_velocity(k, frequency, gravity))


def amplitude_max(
    k: ArrayLike,
    restitution: ArrayLike,
    frequency: ArrayLike = 1.0,
    gravity: ArrayLike = 9.81,
    base: str = HIGH_BOUNCE,
) -> Array:
    """Amplitude in m s-1 up to which mode k is stable: a^2 = ((1 - e) k)^2 + ((1 + e) s_m / pi)^2.

    There a multiplier passes -1 and the orbit doubles its period.  In g that is
    Gamma^2 = Gamma_k^2 + s_m^2.
    """
    e = np.asarray(restitution, dtype=np.float64)
    a = np.hypot((1.0 - e) * np.asarray(k), (1.0 + e) * _steepest(e, base) / np.pi)
    return np.asarray(a * np.asarray(gravity) / (2.0 * np.asarray(frequency)))


def _kick_cosine(
    k: ArrayLike, e: Array, amplitude: ArrayLike, frequency: ArrayLike, gravity: ArrayLike
) -> Array:
    """Return a cos(2 pi x) < 0 of the stable branch, without passing through the phase."""
    a = _kick(amplitude, frequency, gravity)
    need = (1.0 - e) * np.asarray(k)
    with np.errstate(invalid="ignore"):
        return np.asarray(-np.sqrt((a - need) * (a + need)))


def multipliers(
    k: ArrayLike,
    restitution: ArrayLike,
    amplitude: ArrayLike,
    frequency: ArrayLike = 1.0,
    gravity: ArrayLike = 9.81,
    base: str = HIGH_BOUNCE,
) -> NDArray[np.complex128]:
    """Floquet multipliers of the stable branch of mode k; their product is e, or e^2.

    Roots of lambda^2 - (1 + p - 2 (1 + p) s / s_m) lambda + p = 0, see the module.

    Returns
    -------
    numpy.ndarray
        Complex, with a last axis of length 2; NaN below A_min.
    """
    e = np.asarray(restitution, dtype=np.float64)
    p = _contraction(e, base)
    slope = _kick_cosine(k, e, amplitude, frequency, gravity) * TWO_PI / (1.0 + e)
    trace = (1.0 + p) * (1.0 + slope / _steepest(e, base))
    with np.errstate(invalid="ignore"):
        root = np.sqrt((trace * trace - 4.0 * p).astype(np.complex128))
    # the larger one without cancellation, the smaller one from the product
    larger = np.asarray((trace + np.where(trace < 0.0, -root, root)) / 2.0)
    divisible = ~np.isnan(larger) & (larger != 0.0)
    smaller = np.divide(p, larger, out=np.asarray(0.0 * larger), where=divisible)
    return np.stack([larger, smaller], axis=-1)


def liftoff_speed_bound(
    launch_speed: ArrayLike, kick: ArrayLike, restitution: ArrayLike, base: str = HIGH_BOUNCE
) -> Array:
    """Bound of the absolute speed of every lift-off, in g / (2 f); infinite at e = 1.

    High-bounce: max(u0, a / (1 - e)), for e u + a is at most that where u is.

    Moving: max(u0, (1 + 3 e) alpha / (1 - e)), alpha = a / (1 + e).  A flight of s periods from
    phase x with speed u lands where

        s (s - u) = alpha / (2 pi) (cos 2 pi (x + s) - cos 2 pi x) <= alpha s,

    because a cosine is no steeper than 2 pi per turn.  Hence s <= u + alpha; the speed of arrival
    is v = 2 s - u <= u + 2 alpha, and the next speed e v + (1 + e) alpha sin 2 pi x' is at most
    e u + (1 + 3 e) alpha, which keeps to the bound.  A particle that lands at once leaves with at
    most (1 + e) alpha, and one that rested with at most alpha.
    """
    e, a = np.asarray(restitution, dtype=np.float64), np.asarray(kick, dtype=np.float64)
    fed = a * ((1.0 + 3.0 * e) / (1.0 + e)) if _moves(base) else a
    with np.errstate(divide="ignore", invalid="ignore"):
        fed = np.where(a == 0.0, 0.0, fed / (1.0 - e))
    return np.maximum(np.asarray(launch_speed, dtype=np.float64), fed)


def flight_time_bound(
    launch_speed: ArrayLike, kick: ArrayLike, restitution: ArrayLike, base: str = HIGH_BOUNCE
) -> Array:
    """Bound of every flight time in forcing periods; infinite at e = 1.

    That of the speed of lift-off, `liftoff_speed_bound`, and on a moving base alpha more.
    """
    e, a = np.asarray(restitution, dtype=np.float64), np.asarray(kick, dtype=np.float64)
    longer = a / (1.0 + e) if _moves(base) else 0.0
    return np.asarray(liftoff_speed_bound(launch_speed, a, e, base) + longer)


def _above_sine(x: Array) -> Array:
    """Return x - sin x for x >= 0, to a few roundings; below 2 by the series."""
    term = total = x**3 / 6.0
    for n in range(4, 24, 2):
        term = -term * x * x / (n * (n + 1))
        total = total + term
    return np.where(x < 2.0, total, x - np.sin(x))


def liftoff_flight(acceleration: ArrayLike) -> Array:
    """First flight after a rest on a moving base, in forcing periods; NaN for Gamma <= 1.

    The particle leaves at the phase at which the base begins to fall faster than it, without
    relative speed.  After the angle q = 2 pi s it is on the base again where

        sqrt(Gamma^2 - 1) = h(q) = (q^2 / 2 + cos q - 1) / (q - sin q).

    The restitution does not enter.  With t = q / 2 the derivative of h is
    4 (t cos t - sin t)^2 / (q - sin q)^2 >= 0: there is one such angle, which is bisected.  Where
    t = tan t the particle lands without relative speed.

    Parameters
    ----------
    acceleration
        Gamma, the amplitude of the base's acceleration in g.
    """
    gamma = np.asarray(acceleration, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        needed = np.sqrt((gamma - 1.0) * (gamma + 1.0))
        low, high = np.zeros_like(needed), 4.0 * needed  # h(q) >= q / 4
        for _ in range(HALVINGS):
            q = 0.5 * (low + high)
            t = 0.5 * q
            # q^2 / 2 + cos q - 1 = 2 (t - sin t) (t + sin t)
            short = 2.0 * _above_sine(t) * (t + np.sin(t)) < needed * _above_sine(q)
            low, high = np.where(short, q, low), np.where(short, high, q)
    return np.asarray(np.where(gamma > 1.0, 0.5 * (low + high), np.nan) / TWO_PI)


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
