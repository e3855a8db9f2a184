"""Closed forms for orbits of any kind: exponents, bounds, rests (numpy only)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vibrosweep.arrays import Array
from vibrosweep.errors import require_one_of
from vibrosweep.model.parameters import HIGH_BOUNCE, MOVING, physical

FIXED = HIGH_BOUNCE, MOVING  # bases without recoil
HALVINGS = 60  # of a bracket about as wide as the root, down to rounding


def moves(base: str) -> bool:
    """Return whether a base of `FIXED` moves; a ParameterError for any other base."""
    require_one_of("base", base, FIXED)
    return base == MOVING


@physical
def exponent_sum(restitution: ArrayLike, base: str = HIGH_BOUNCE) -> Array:
    """Sum of the Lyapunov exponents of an orbit without rests, per impact: ln e or 2 ln e.

    Over a moving base an impact multiplies an area of phase and absolute speed by e^2 z / z', where
    z and z' are the relative speeds of the lift-offs before and after it; along an orbit the
    quotients cancel.

    Parameters
    ----------
    restitution
        Coefficient of restitution e, 0 to 1.
    base
        ``"high-bounce"`` or ``"moving"``.

    Returns
    -------
    numpy.ndarray
        Sum per impact.

    Raises
    ------
    ParameterError
        The base is not one of the two, or an argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.exponent_sum(0.9).round(6))
    -0.105361
    """
    with np.errstate(divide="ignore"):
        logarithm = np.log(np.asarray(restitution, dtype=np.float64))
    return np.asarray(2.0 * logarithm if moves(base) else logarithm)


@physical
def recognition_periods(restitution: ArrayLike, k: ArrayLike = 1, base: str = HIGH_BOUNCE) -> Array:
    """Forcing periods until an orbit locked to k periods is seen to return bit for bit.

    The number is ``150 k / |ln p|``.  Both multipliers have the modulus sqrt(p) over most of the
    window, where p is e, or e^2 over a moving base.  A distance of 1 shrinks to one rounding,
    2^-53, within ``2 * 53 ln 2 / |ln p|`` impacts.  Recognition takes up to twice as long, because
    the ages at which states are stored for comparison double, from 64 impacts on.  Infinite for
    e = 1, 0 for e = 0.

    Parameters
    ----------
    restitution, k
        Coefficient e (0 to 1) and mode (forcing periods between impacts); they broadcast.
    base
        ``"high-bounce"`` or ``"moving"``.

    Returns
    -------
    numpy.ndarray
        Forcing periods, broadcast over the arguments.

    Raises
    ------
    ParameterError
        The base is not one of the two, or an argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.recognition_periods(0.9).round(6))
    1423.683237
    """
    with np.errstate(divide="ignore"):
        return np.asarray(150.0 * np.asarray(k) / np.abs(exponent_sum(restitution, base)))


@physical
def liftoff_speed_bound(
    launch_speed: ArrayLike, kick: ArrayLike, restitution: ArrayLike, base: str = HIGH_BOUNCE
) -> Array:
    """Bound of the absolute speed of every lift-off, in g / (2 f); infinite at e = 1.

    High-bounce: max(u0, a / (1 - e)), because e u + a does not exceed this bound if u does not.

    Moving: max(u0, (1 + 3 e) alpha / (1 - e)), alpha = a / (1 + e).  A flight of s periods from
    phase x with speed u lands where

        s (s - u) = alpha / (2 pi) (cos 2 pi (x + s) - cos 2 pi x) <= alpha s,

    because the slope of cos 2 pi x is at most 2 pi.  Hence s <= u + alpha.  The speed of arrival is
    v = 2 s - u <= u + 2 alpha, and the next speed e v + (1 + e) alpha sin 2 pi x' is at most
    e u + (1 + 3 e) alpha, which does not exceed the bound.  A particle that lands at once leaves
    with at most (1 + e) alpha, and one that rested with at most alpha.

    Parameters
    ----------
    launch_speed
        Speed of the launch u0, in g / (2 f).
    kick
        a = 2 f A / g.
    restitution
        Coefficient of restitution e, 0 to 1.
    base
        ``"high-bounce"`` or ``"moving"``.

    Returns
    -------
    numpy.ndarray
        Bound in g / (2 f), in the broadcast shape of the arguments.

    Raises
    ------
    ParameterError
        The base is not one of the two, or an argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.liftoff_speed_bound(1.0, 0.2, 0.9).round(6))
    2.0
    """
    e, a = np.asarray(restitution, dtype=np.float64), np.asarray(kick, dtype=np.float64)
    gain = a * ((1.0 + 3.0 * e) / (1.0 + e)) if moves(base) else a
    with np.errstate(divide="ignore", invalid="ignore"):
        limit = np.where(a == 0.0, 0.0, gain / (1.0 - e))
    return np.maximum(np.asarray(launch_speed, dtype=np.float64), limit)


@physical
def flight_time_bound(
    launch_speed: ArrayLike, kick: ArrayLike, restitution: ArrayLike, base: str = HIGH_BOUNCE
) -> Array:
    """Bound of every flight time in forcing periods; infinite at e = 1.

    The bound is `liftoff_speed_bound`, plus alpha over a moving base.

    Parameters
    ----------
    launch_speed
        Speed of the launch u0, in g / (2 f).
    kick
        a = 2 f A / g.
    restitution
        Coefficient of restitution e, 0 to 1.
    base
        ``"high-bounce"`` or ``"moving"``.

    Returns
    -------
    numpy.ndarray
        Forcing periods, in the broadcast shape of the arguments.

    Raises
    ------
    ParameterError
        The base is not one of the two, or an argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.flight_time_bound(1.0, 0.2, 0.9).round(6))
    2.0
    """
    e, a = np.asarray(restitution, dtype=np.float64), np.asarray(kick, dtype=np.float64)
    extra = a / (1.0 + e) if moves(base) else 0.0
    return np.asarray(liftoff_speed_bound(launch_speed, a, e, base) + extra)


def above_sine(x: Array) -> Array:
    """Return x - sin x for x >= 0, to a few roundings; below 2 by the series."""
    term = total = x**3 / 6.0
    for n in range(4, 24, 2):
        term = -term * x * x / (n * (n + 1))
        total = total + term
    return np.where(x < 2.0, total, x - np.sin(x))


@physical
def liftoff_flight(acceleration: ArrayLike) -> Array:
    """First flight after a rest on a moving base, in forcing periods; NaN for Gamma <= 1.

    The particle leaves without relative speed, at the phase at which the downward acceleration of
    the base exceeds g.  It lands after the angle q = 2 pi s for which

        sqrt(Gamma^2 - 1) = h(q) = (q^2 / 2 + cos q - 1) / (q - sin q).

    The restitution does not enter.  With t = q / 2 the derivative of h is
    4 (t cos t - sin t)^2 / (q - sin q)^2 >= 0, so that there is one solution, which is found by
    bisection.  Where t = tan t the particle lands without relative speed.

    Parameters
    ----------
    acceleration
        Gamma, the amplitude of the base's acceleration in g.

    Returns
    -------
    numpy.ndarray
        Forcing periods, in the shape of `acceleration`.

    Raises
    ------
    ParameterError
        An argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.liftoff_flight(3.296908).round(6))
    1.0
    """
    gamma = np.asarray(acceleration, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        needed = np.sqrt((gamma - 1.0) * (gamma + 1.0))
        low, high = np.zeros_like(needed), 4.0 * needed  # h(q) >= q / 4
        for _ in range(HALVINGS):
            q = 0.5 * (low + high)
            t = 0.5 * q
            # q^2 / 2 + cos q - 1 = 2 (t - sin t) (t + sin t)
            short = 2.0 * above_sine(t) * (t + np.sin(t)) < needed * above_sine(q)
            low, high = np.where(short, q, low), np.where(short, high, q)
    return np.asarray(np.where(gamma > 1.0, 0.5 * (low + high), np.nan) / (2.0 * np.pi))


@physical
def unforced_rest_impact(
    launch_flight: ArrayLike, restitution: ArrayLike, rest_flight: ArrayLike
) -> Array:
    """Count the landings until a particle without excitation comes to rest for good.

    The number is the first n >= 1 with e^n u0 <= r, where u0 and r are flight times in any common
    unit, such as forcing periods.  Infinite where e = 1 and u0 > r.

    Parameters
    ----------
    launch_flight
        First flight u0, in forcing periods.
    restitution
        Coefficient of restitution e, 0 to 1.
    rest_flight
        Contact time r, in the same unit.

    Returns
    -------
    numpy.ndarray
        Number of landings, in the broadcast shape of the arguments.

    Raises
    ------
    ParameterError
        An argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.unforced_rest_impact(1.0, 0.5, 0.1))
    4.0
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


@physical
def unforced_rest_time(
    launch_velocity: ArrayLike,
    restitution: ArrayLike,
    contact_time: ArrayLike,
    gravity: ArrayLike = 9.81,
) -> Array:
    """Time in s from launch until a particle without excitation comes to rest for good.

    The flights last (2 v0 / g) e^j for j = 0 ... n - 1; their sum tends to
    (2 v0 / g) / (1 - e) as the contact time goes to zero.

    Parameters
    ----------
    launch_velocity
        v0 (m s-1).
    restitution
        Coefficient of restitution e, 0 to 1.
    contact_time
        tau_c (s).
    gravity
        g (m s-2).

    Returns
    -------
    numpy.ndarray
        Time in s, in the broadcast shape of the arguments.

    Raises
    ------
    ParameterError
        An argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.unforced_rest_time(5.0, 0.9, 1e-4).round(6))
    10.192721
    """
    first = 2.0 * np.asarray(launch_velocity, dtype=np.float64) / np.asarray(gravity)
    e = np.asarray(restitution, dtype=np.float64)
    n = unforced_rest_impact(first, e, contact_time)
    with np.errstate(invalid="ignore", divide="ignore"):
        # 1 - e^n without cancellation where e is next to 1
        total = first * -np.expm1(n * np.log1p(e - 1.0)) / (1.0 - e)
    return np.asarray(np.where(e == 1.0, np.where(n == 1.0, first, np.inf), total))
