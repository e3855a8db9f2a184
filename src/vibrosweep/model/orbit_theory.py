"""Closed forms over a base of infinite mass: orbits of any kind, and locked ones (numpy only).

Source: the locked orbits of the high-bounce map (Holmes 1982, J. Sound Vib. 84, 173), written for
a kick of velocity amplitude A on a base that stays at height zero, and of the exact model (Luck &
Mehta 1993, Phys. Rev. E 48, 3988), whose base has the velocity amplitude A / (1 + e).  All
functions broadcast.

A locked orbit of mode k lands once every k forcing periods and leaves with the speed
v = g k / (2 f), over either base.  With Gamma = 2 pi f A / ((1 + e) g), the acceleration of the
moving base in g, and s = -Gamma cos(2 pi x) at the landing, its multipliers solve

    z^2 - (1 + p - 2 (1 + p) s / s_m) z + p = 0,

    high-bounce    p = e      s_m = 1
    moving         p = e^2    s_m = 2 (1 + e^2) / (1 + e)^2 = 1 + ((1 - e) / (1 + e))^2

so that it is stable for 0 < s < s_m.  At s = s_m a multiplier passes -1.

**Lower end of the window.** At the lower end s = 0, and the particle lands and leaves at the phase
1/4.  Over a moving base, whose velocity has the amplitude alpha = Gamma / pi, the clearance of the
flight at the angle t, 2 pi times the periods since lift-off, is

    t (k - t / 2 pi) / 4 pi - (alpha / 4 pi) sin t,

which has to be positive for 0 < t < 2 pi k.  At the lower end alpha = k (1 - e) / (1 + e), so that
this is the condition

    e > e_k = max (t^2 / 2 pi - k (t - sin t)) / (k sin t + k t - t^2 / 2 pi)    over 0 < t < pi,

about 0.019 / k^2; after the first half turn t (k - t / 2 pi) is greater than k wherever sin t > 0.
At a smaller restitution the particle would meet the base during the flight.  The orbit then begins
with s > 0, at the amplitude at which its flight grazes the base, for which there is no closed form.
At e = 0 a particle rests while the base presses against it, and the orbit begins with s = 1, where
Gamma^2 = 1 + (pi k)^2.

**Any waveform.** An orbit of mode k lands where a w(x) = n, with n = (1 - e) k.  It attracts for -m
< a w'(x) < 0, with m = 2 (1 + e) in the high-bounce limit and m = 4 (1 + e^2) / (1 + e) over the
moving base.  Under the law `reflect` there is a second orbit, which is reflected at every impact,
with -w in place of w, n = (1 + e) k and m = 2 (1 - e).  Another law of restitution has other n and
m, which do not depend on the kick either.

Hence each phase x with w > 0 and w' < 0 belongs to one kick a = n / w(x), which increases with x.
A window is an interval of phases between zeros of w, of w' (a fold, where two orbits meet) and of
n w' + m w (a period doubling), which is a sum of harmonics too.  All zeros are found.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError, require_one_of
from vibrosweep.model.parameters import HIGH_BOUNCE, MOVING, physical
from vibrosweep.model.shapes import (
    HARMONICS_NAME,
    NARROW,
    PARABOLIC_NAME,
    SINE_NAME,
    TWO_PI,
    Waveform,
    given_shape,
    zeros,
)

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


# --- Locked orbits --------------------------------------------------------------------------------


def lower_end(
    k: ArrayLike, restitution: ArrayLike, frequency: ArrayLike, gravity: ArrayLike, base: str
) -> Array:
    """Return `amplitude_min`; NaN where there is no closed form."""
    e = np.asarray(restitution, dtype=np.float64)
    speed = np.asarray(gravity) * np.asarray(k) / (2.0 * np.asarray(frequency))
    begins = (1.0 - e) * speed
    if not moves(base):
        return np.asarray(begins)
    grazes = np.where(e < grazing(k), np.nan, begins)
    falling = np.hypot(1.0 / (np.pi * np.asarray(k)), 1.0) * speed
    return np.where(e == 0.0, falling, grazes)


def grazing(k: ArrayLike) -> Array:
    """Return the restitution below which there is no closed form, e_k of the module's text."""
    k = np.asarray(k, dtype=np.float64)
    turn = TWO_PI * k
    low, high = np.zeros_like(k), np.full_like(k, np.pi)
    for _ in range(HALVINGS):  # bisect for the maximum, at 1 / t - cot t = 1 / (2 pi k - t)
        t = 0.5 * (low + high)
        before = (2.0 * t * np.sin(0.5 * t) ** 2 - above_sine(t)) * (turn - t) < t * np.sin(t)
        low, high = np.where(before, t, low), np.where(before, high, t)
    below = t * t / TWO_PI - k * above_sine(t)
    return np.asarray(below / (k * np.sin(t) + t * (turn - t) / TWO_PI))


def _kick(amplitude: ArrayLike, frequency: ArrayLike, gravity: ArrayLike) -> Array:
    return np.asarray(2.0 * np.asarray(frequency) * np.asarray(amplitude) / np.asarray(gravity))


def _steepest(restitution: ArrayLike, base: str) -> Array:
    """Return s_m of the module's text, -Gamma cos(2 pi x) at the loss of stability."""
    e = np.asarray(restitution, dtype=np.float64)
    return 1.0 + ((1.0 - e) / (1.0 + e)) ** 2 if moves(base) else np.ones_like(e)


@physical
def locked_velocity(k: ArrayLike, frequency: ArrayLike = 1.0, gravity: ArrayLike = 9.81) -> Array:
    """Speed of the locked orbit of mode k, g k / (2 f), in m s-1.

    Parameters
    ----------
    k, frequency, gravity
        Mode (forcing periods between impacts), f (Hz) and g (m s-2); they broadcast.

    Returns
    -------
    numpy.ndarray
        m s-1, broadcast over the arguments.

    Raises
    ------
    ParameterError
        An argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.locked_velocity(1))
    4.905
    """
    return np.asarray(np.asarray(gravity) * np.asarray(k) / (2.0 * np.asarray(frequency)))


@physical
def locked_height(k: ArrayLike, frequency: ArrayLike = 1.0, gravity: ArrayLike = 9.81) -> Array:
    """Rebound height of the locked orbit of mode k, g k^2 / (8 f^2), in m.

    Neither the restitution nor the amplitude enters: this is the plateau of heights.  On a moving
    base it is the height above the point of lift-off; see `locked_apex`.

    Parameters
    ----------
    k, frequency, gravity
        Mode (forcing periods between impacts), f (Hz) and g (m s-2); they broadcast.

    Returns
    -------
    numpy.ndarray
        m, broadcast over the arguments.

    Raises
    ------
    ParameterError
        An argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.locked_height(1))
    1.22625
    """
    return np.asarray(np.asarray(gravity) * np.asarray(k) ** 2 / (8.0 * np.asarray(frequency) ** 2))


@physical
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

    At a very small restitution this orbit begins at a larger amplitude, see `amplitude_min`.

    Parameters
    ----------
    k, restitution, amplitude, frequency, gravity
        Mode (forcing periods between impacts), e (0 to 1), A of the kick (m s-1), f (Hz) and g (m
        s-2); they broadcast.

    Returns
    -------
    numpy.ndarray
        m, broadcast over the arguments; NaN for Gamma < Gamma_k.

    Raises
    ------
    ParameterError
        An argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.locked_apex(1, 0.9, 1.2).round(6))
    1.317988
    """
    e = np.asarray(restitution, dtype=np.float64)
    a_cosine = _kick_cosine(k, e, amplitude, frequency, gravity)
    above = -2.0 * a_cosine / (np.pi * (1.0 + e))
    unit = locked_height(1, frequency, gravity)
    return np.asarray(unit * (np.asarray(k) ** 2 + above))


@physical
def locked_phase(
    k: ArrayLike,
    restitution: ArrayLike,
    amplitude: ArrayLike,
    frequency: ArrayLike = 1.0,
    gravity: ArrayLike = 9.81,
) -> Array:
    """Phase of impact in turns of the stable branch, in [1/4, 1/2]; NaN below A_min.

    sin(2 pi x) = (1 - e) k / a with cos(2 pi x) < 0, over either base: a flight of whole periods
    ends at the height at which it began, so that the height of the base does not enter.

    Parameters
    ----------
    k, restitution, amplitude, frequency, gravity
        Mode (forcing periods between impacts), e (0 to 1), A of the kick (m s-1), f (Hz) and g (m
        s-2); they broadcast.

    Returns
    -------
    numpy.ndarray
        Turns, broadcast over the arguments; NaN below A_min.

    Raises
    ------
    ParameterError
        An argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.locked_phase(1, 0.9, 1.2).round(6))
    0.432982
    """
    a = _kick(amplitude, frequency, gravity)
    need = (1.0 - np.asarray(restitution)) * np.asarray(k)
    with np.errstate(invalid="ignore", divide="ignore"):
        sine = np.where(need <= a, need / a, np.nan)
    return np.asarray(0.5 - np.arcsin(sine) / TWO_PI)


@physical
def amplitude_min(
    k: ArrayLike,
    restitution: ArrayLike,
    frequency: ArrayLike = 1.0,
    gravity: ArrayLike = 9.81,
    base: str = HIGH_BOUNCE,
) -> Array:
    """Smallest amplitude in m s-1 at which mode k exists, (1 - e) g k / (2 f).

    It is the same over a moving base, Gamma_k = pi k (1 - e) / (1 + e), unless the restitution is
    very small.  At e = 0 the orbit begins at Gamma = sqrt(1 + (pi k)^2).  For e between 0 and
    0.020458, 0.004833, 0.002127 (k = 1, 2, 3) it begins where its flight grazes the base, for which
    there is no closed form.

    Parameters
    ----------
    k, restitution, frequency, gravity
        Mode (forcing periods between impacts), e (0 to 1), f (Hz) and g (m s-2); they broadcast.
    base
        ``"high-bounce"`` or ``"moving"``.

    Returns
    -------
    numpy.ndarray
        m s-1, broadcast over the arguments.

    Raises
    ------
    ParameterError
        The base is not one of the two, an argument is outside its range, or there is no closed form
        at this restitution.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.amplitude_min(1, 0.9).round(6))
    0.4905
    """
    begins = lower_end(k, restitution, frequency, gravity, base)
    if np.isnan(begins).any():
        at = np.broadcast_arrays(begins, restitution, k)
        e, mode = (values[np.isnan(begins)][0] for values in at[1:])
        raise ParameterError(
            f"restitution = {e:g}: over a moving base the orbit of mode {mode:g} begins where its "
            f"flight grazes the base, for which there is no closed form; take 0, or at least "
            f"{math.ceil(1e6 * grazing(mode)) / 1e6:.6f}, or find it by vibrosweep.windows"
        )
    return begins


@physical
def amplitude_max(
    k: ArrayLike,
    restitution: ArrayLike,
    frequency: ArrayLike = 1.0,
    gravity: ArrayLike = 9.81,
    base: str = HIGH_BOUNCE,
) -> Array:
    """Amplitude in m s-1 up to which mode k is stable: a^2 = ((1 - e) k)^2 + ((1 + e) s_m / pi)^2.

    There a multiplier passes -1 and the orbit doubles its period.  The acceleration in g is then
    given by Gamma^2 = Gamma_k^2 + s_m^2.

    Parameters
    ----------
    k, restitution, frequency, gravity
        Mode (forcing periods between impacts), e (0 to 1), f (Hz) and g (m s-2); they broadcast.
    base
        ``"high-bounce"`` or ``"moving"``.

    Returns
    -------
    numpy.ndarray
        m s-1, broadcast over the arguments.

    Raises
    ------
    ParameterError
        The base is not one of the two, or an argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.amplitude_max(1, 0.9).round(6))
    3.006767
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


@physical
def multipliers(
    k: ArrayLike,
    restitution: ArrayLike,
    amplitude: ArrayLike,
    frequency: ArrayLike = 1.0,
    gravity: ArrayLike = 9.81,
    base: str = HIGH_BOUNCE,
) -> NDArray[np.complex128]:
    """Floquet multipliers of the stable branch of mode k; their product is e, or e^2.

    Roots of lambda^2 - (1 + p - 2 (1 + p) s / s_m) lambda + p = 0, p their product.

    Parameters
    ----------
    k, restitution, amplitude, frequency, gravity
        Mode (forcing periods between impacts), e (0 to 1), A of the kick (m s-1), f (Hz) and g (m
        s-2); they broadcast.
    base
        ``"high-bounce"`` or ``"moving"``.

    Returns
    -------
    numpy.ndarray
        Complex, with a last axis of length 2 after the broadcast shape of the arguments; NaN for
        A < (1 - e) g k / (2 f).  Over a moving base the orbit begins at a larger amplitude where
        the restitution is very small, see `amplitude_min`.

    Raises
    ------
    ParameterError
        The base is not one of the two, or an argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> abs(vs.theory.multipliers(1, 0.9, 1.2)).round(6)
    array([0.948683, 0.948683])
    """
    e = np.asarray(restitution, dtype=np.float64)
    p = e * e if moves(base) else e
    slope = _kick_cosine(k, e, amplitude, frequency, gravity) * TWO_PI / (1.0 + e)
    trace = (1.0 + p) * (1.0 + slope / _steepest(e, base))
    with np.errstate(invalid="ignore"):
        root = np.sqrt((trace * trace - 4.0 * p).astype(np.complex128))
    # the larger one without cancellation, the smaller one from the product
    larger = np.asarray((trace + np.where(trace < 0.0, -root, root)) / 2.0)
    divisible = ~np.isnan(larger) & (larger != 0.0)
    smaller = np.divide(p, larger, out=np.asarray(0.0 * larger), where=divisible)
    return np.stack([larger, smaller], axis=-1)


FOLD: Final = "fold"  # two orbits meet, or one begins at a corner of the velocity
DOUBLING: Final = "doubling"
NONE: Final = "none"  # the window has no end there
EPS: Final = 2.0**-52


class LockedWindow(NamedTuple):
    """A window of one branch of an orbit: kicks a in forcing periods, phases in turns.

    In results of `locked_windows`, amplitudes A in m s-1 stand in place of kicks.
    """

    low: float  # kick at the lower end
    high: float  # kick at the upper end; infinite if there is none
    low_error: float  # bound on the error of `low`
    high_error: float  # bound on the error of `high`
    from_phase: float  # phase of the landings at the lower end
    to_phase: float  # phase of the landings at the upper end
    begins: str  # kind of the lower end
    ends: str  # kind of the upper end


class OrbitConditions(NamedTuple):
    """Conditions of an orbit, with bounds on their errors apart from a few roundings."""

    need: float  # n of the module's text
    limit: float  # m of the module's text
    need_error: float = 0.0
    limit_error: float = 0.0


def mode_of(k: float, e: float, base: str, *, turned: bool = False) -> OrbitConditions:
    """Return the conditions of mode k under a constant restitution.

    `turned` selects the orbit that is reflected at every impact.
    """
    if turned:
        return OrbitConditions((1.0 + e) * k, 2.0 * (1.0 - e))
    return OrbitConditions(
        (1.0 - e) * k, 4.0 * (1.0 + e * e) / (1.0 + e) if moves(base) else 2.0 * (1.0 + e)
    )


@physical
def locked_windows(
    k: float,
    restitution: float,
    waveform: str | Mapping[str, Any] = SINE_NAME,
    frequency: float = 1.0,
    gravity: float = 9.81,
    base: str = HIGH_BOUNCE,
) -> list[LockedWindow]:
    """Windows of amplitudes in which orbits of mode k exist and attract, under any waveform.

    If V0 w(x) is the velocity of the base, an orbit lands where A w(x) = (1 - e) g k / (2 f).  It
    attracts while its multipliers are inside the unit circle.  A mode has one window for each
    branch of its orbits; windows may overlap.

    Parameters
    ----------
    k, restitution, frequency, gravity
        Mode (forcing periods between impacts), e (0 to 1, constant), f (Hz) and g (m s-2).
    waveform
        ``"sine"``, ``"parabolic"``, or ``{"harmonics": [[number, weight, phase in rad], ...]}``.
    base
        ``"high-bounce"`` or ``"moving"``.  Over a moving base a window may end earlier, where the
        flight grazes the base: `vibrosweep.windows` finds such ends.

    Returns
    -------
    list of LockedWindow
        Windows in the order of their lower ends, each a named tuple: ends ``low``, ``high`` and
        bounds on their errors ``low_error``, ``high_error`` (m s-1); phases of the landings there
        ``from_phase``, ``to_phase`` (turns); kinds of ends ``begins``, ``ends``: ``"fold"``,
        ``"doubling"`` or ``"none"``.

    Raises
    ------
    ParameterError
        The base or the waveform is not one of these, or an argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> two = {"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}
    >>> for window in vs.theory.locked_windows(1, 0.85, two, gravity=2.0):
    ...     print(round(window.low, 4), round(window.high, 4), window.ends)
    0.1688 0.2855 fold
    0.2852 0.6657 doubling
    """
    unit = gravity / (2.0 * frequency)
    return [
        window._replace(
            low=unit * window.low,
            high=unit * window.high,
            low_error=unit * window.low_error + 4.0 * EPS * unit * window.low,
            high_error=unit * window.high_error + 4.0 * EPS * unit * window.high,
        )
        for window in windows_of(given_shape(waveform), mode_of(k, restitution, base))
    ]


def windows_of(
    waveform: Waveform, mode: OrbitConditions, *, turned: bool = False
) -> list[LockedWindow]:
    """Return the windows of an orbit, one for each branch and interval of phases.

    The end of a window at a graze, over the moving base, is not searched for.
    """
    need, limit, need_error, limit_error = mode
    sign = -1.0 if turned else 1.0
    if waveform.name == PARABOLIC_NAME:  # w falls with the slope -4 from 1, at a corner, to 0
        if need >= 0.25 * limit:
            return []
        x = -0.25 if turned else 0.25
        y, error = x + 0.25 * (1.0 - 4.0 * need / limit), 4.0 * EPS
        high = 0.25 * limit
        low_error, high_error = error * need + need_error, error * high + 0.25 * limit_error
        return [LockedWindow(need, high, low_error, high_error, x, y, FOLD, DOUBLING)]
    tones = tuple((h, sign * c, psi) for h, c, psi in waveform.harmonics)
    w = Waveform(HARMONICS_NAME, tones)
    if need == 0.0:  # the orbit lands at a zero of w for any kick
        falls = [(float(x), -float(w.slope(x))) for x in zeros(w, 0) if w.slope(x) < 0.0]
        off = 64.0 * EPS * w.sum_of(1)
        return sorted(
            LockedWindow(0.0, limit / s, 0.0, off * limit / s**2, x, x, NONE, DOUBLING)
            for x, s in falls
        )
    mixed = _mixed(w, need, limit)
    kinds = {NONE: zeros(w, 0), FOLD: zeros(w, 1), DOUBLING: zeros(mixed, 0)}
    ends = sorted((float(x), kind) for kind, phases in kinds.items() for x in phases)
    found = []
    for (x, begins), (y, finishes) in pairwise([*ends, (ends[0][0] + 1.0, ends[0][1])]):
        middle = 0.5 * (x + y)
        if w.velocity(middle) > 0.0 > w.slope(middle) and mixed.velocity(middle) > 0.0:
            low, low_error = _kick_at(w, mixed, mode, x, begins)
            high, high_error = _kick_at(w, mixed, mode, y, finishes)
            found.append(LockedWindow(low, high, low_error, high_error, x, y, begins, finishes))
    return sorted(found)


def _kick_at(
    w: Waveform, mixed: Waveform, mode: OrbitConditions, x: float, kind: str
) -> tuple[float, float]:
    """Return the kick of the orbit at an end of a window, at phase x, and a bound on its error."""
    value, slope = float(w.velocity(x)), float(w.slope(x))
    # error of the phase: roundings of the function that vanishes there, over its slope
    function, order = (w, 1) if kind == FOLD else (mixed, 0)
    steep = abs(float(function.derivative(x, order + 1)))
    off = 64.0 * EPS * function.sum_of(order) / steep if steep > 0.0 else NARROW
    change = abs(slope) * off + w.sum_of(2) * off * off
    error = (change + 64.0 * EPS * w.sum_of(0)) / value + 8.0 * EPS
    return mode.need / value, mode.need / value * error + _error_of_conditions(w, mode, x, kind)


def _error_of_conditions(w: Waveform, mode: OrbitConditions, x: float, kind: str) -> float:
    """Return a bound on the error of a kick that errors of the conditions cause.

    At a fold the phase does not depend on the conditions.  At a period doubling, K w = n and
    K w' = -m determine both the kick K and the phase: dK (w'^2 - w w'') = -w' dm - w'' dn.
    """
    value, slope = float(w.velocity(x)), float(w.slope(x))
    if kind != DOUBLING or mode.need_error == mode.limit_error == 0.0:
        return mode.need_error / value
    bend = float(w.derivative(x, 2))
    steep = abs(slope) * mode.limit_error + abs(bend) * mode.need_error
    return steep / abs(slope * slope - value * bend)


def _mixed(w: Waveform, need: float, limit: float) -> Waveform:
    """Return the sum need w' + limit w as harmonics."""
    tones = []
    for h, c, psi in w.tones:
        in_phase, quadrature = limit * c, need * TWO_PI * h * c
        tones.append((h, math.hypot(in_phase, quadrature), psi + math.atan2(quadrature, in_phase)))
    return Waveform(HARMONICS_NAME, tuple(tones))
