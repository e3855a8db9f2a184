"""Closed forms of locked orbits, in the high-bounce limit and over the moving base (numpy only).

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
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.model.orbit_theory import moves
from vibrosweep.model.parameters import HIGH_BOUNCE
from vibrosweep.model.physical import physical
from vibrosweep.model.window_begin import grazing, lower_end

TWO_PI = 2.0 * np.pi


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
        m s-1, as the arguments broadcast.

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
        m, as the arguments broadcast.

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
        m, as the arguments broadcast; NaN for Gamma < Gamma_k.

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
        Turns, as the arguments broadcast; NaN below A_min.

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
        m s-1, as the arguments broadcast.

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
        m s-1, as the arguments broadcast.

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
        Complex, with a last axis of length 2 after the shape of the arguments broadcast; NaN for
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
