"""Closed forms of particles that bounce on a base of finite mass (numpy only).

All quantities are dimensionless: times in forcing periods, phases in turns, speeds in g / (2 f), so
that gravity is 2.  Gamma is the amplitude of the acceleration of the base without particles in g,
and alpha = Gamma / pi that of its velocity; mu is the mass of one particle over that of the base,
nu the natural frequency of the mount over that of the forcing, and zeta its damping ratio.  The
base moves as it does without particles, plus a deviation D, which obeys between impacts

    D'' + 2 zeta w0 D' + w0^2 D = 0,    w0 = 2 pi nu.

An impact at the speed of approach c changes the velocity of the base by -mu (1 + e) c / (1 + mu)
and that of the particle by (1 + e) c / (1 + mu).

**Locked orbits.** A particle that lands every k periods leaves with the velocity k and lands with
-k.  Its velocity changes by 2 k, that of the base by -2 k mu, and c = 2 k (1 + mu) / (1 + e).  With
the velocity D'- of the deviation just before the impact, which earlier recoils have left,

    alpha sin(2 pi x) = c - k - D'-.

**Particles in one slot.** Two particles land close together.  To first order in mu they differ only
in that the later one meets a base that has lost 2 k mu of its velocity.  Their difference in time
and speed follows the linear map of a particle on a base of infinite mass, which has the
characteristic polynomial p(z), with a kick of -(1 + e) 2 k mu to the later particle at each
landing.  In a pattern that repeats, a Fourier component z^n of the order at landing n causes the
response

    -z k mu (1 + e)^2 / p(z),    p(z) = z^2 - (1 + e^2 - (1 + e)^2 s) z + e^2,

with s = -Gamma cos(2 pi x).  The pattern exists if these responses reproduce the assumed order.  A
fixed order (z = 1) would require -k mu / s > 0, which is impossible.  An order that reverses at
each landing (z = -1) gives the separation k mu / (s_m - s), s_m = 2 (1 + e^2) / (1 + e)^2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vibrosweep.arrays import Array
from vibrosweep.model.physical import physical

TWO_PI = 2.0 * np.pi


def mount_propagator(natural: ArrayLike, damping: ArrayLike, periods: ArrayLike) -> Array:
    """Return the propagator of the free base, exp(t [[0, 1], [-w0^2, -2 zeta w0]]).

    nu, zeta and the time t >= 0 in forcing periods broadcast.  The result has shape (..., 2, 2) and
    acts on the deviation and its velocity.
    """
    w0, zeta, t = (np.asarray(v, dtype=np.float64) for v in (natural, damping, periods))
    w0 = TWO_PI * w0
    root = np.sqrt(zeta * zeta - 1.0 + 0j)
    slow = np.exp(-w0 * t / (zeta + root))  # zeta - root without cancellation
    twice = 2.0 * w0 * t * root
    # (1 - exp(-x)) / x, which rounds to 1 at and near critical damping
    split = np.abs(twice) > 1e-20
    share = np.divide(-np.expm1(-twice), twice, out=np.ones_like(twice), where=split)
    sine = (slow * t * share).real  # of a damped oscillation of unit initial velocity
    cosine = (slow * (1.0 + np.exp(-twice)) / 2.0).real
    drag = zeta * w0 * sine
    rows = ((cosine + drag, sine), (-w0 * w0 * sine, cosine - drag))
    return np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in rows], axis=-2)


@physical
def recoil_deviation(natural: ArrayLike, damping: ArrayLike, spacing: ArrayLike = 1) -> Array:
    """Deviation of a base that loses one unit of velocity every `spacing` periods.

    Once the motion is periodic, the deviation just before a recoil is Phi (1 - Phi)^-1 (0, -1),
    with the propagator Phi over one spacing.  Without damping its velocity is 1/2 for any natural
    frequency; damping makes it smaller.

    Parameters
    ----------
    natural, damping
        Natural frequency of the mount over that of the forcing, and its damping ratio.
    spacing
        Forcing periods between two recoils.

    Returns
    -------
    numpy.ndarray
        Shape (..., 2): deviation and its velocity, per unit of velocity lost in a recoil.
        Infinite where an undamped mount swings a whole number of times between recoils.

    Raises
    ------
    ParameterError
        An argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> vs.theory.sprung.recoil_deviation(0.37, 0.0).round(6)
    array([-0.093071,  0.5     ])
    """
    phi = mount_propagator(natural, damping, spacing)
    matrix = np.eye(2) - phi
    unit = np.array([0.0, -1.0])
    determinant = matrix[..., 0, 0] * matrix[..., 1, 1] - matrix[..., 0, 1] * matrix[..., 1, 0]
    # minus the second column of the inverse, times the determinant
    after = np.stack([matrix[..., 0, 1], -matrix[..., 0, 0]], axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(after / determinant[..., np.newaxis] - unit)


@physical
def locked_acceleration_min(
    k: ArrayLike,
    restitution: ArrayLike,
    mass_ratio: ArrayLike,
    natural: ArrayLike,
    damping: ArrayLike,
    spacing: ArrayLike | None = None,
) -> Array:
    """Smallest acceleration Gamma in g at which particles can be locked to mode k.

    Without damping it is Gamma_k (1 + mu), Gamma_k = pi k (1 - e) / (1 + e), for any natural
    frequency.  With damping it is higher: recoils supply the energy that the mount dissipates, so
    that (D'- + D'+) / 2 <= 0.

    Parameters
    ----------
    k, restitution, mass_ratio, natural, damping
        Mode (forcing periods between impacts of a particle), e (0 to 1), mass of a particle over
        that of the base, natural frequency of the mount over that of the forcing, and its damping
        ratio; they broadcast.
    spacing
        Periods between two impacts on the base: k (the default) for one particle, 1 if each of the
        k slots holds one.

    Returns
    -------
    numpy.ndarray
        In units of gravity, as the arguments broadcast.

    Raises
    ------
    ParameterError
        An argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.sprung.locked_acceleration_min(1, 0.9, 0.003, 0.37, 0.05).round(6))
    0.166289
    """
    recoil = recoil_deviation(natural, damping, k if spacing is None else spacing)[..., 1]
    k, e, mu = np.asarray(k), np.asarray(restitution), np.asarray(mass_ratio)
    drive = k * (1.0 - e + 2.0 * mu) / (1.0 + e) - 2.0 * k * mu * recoil  # velocity at impacts
    return np.asarray(np.pi * drive)


@physical
def landing_phase(
    acceleration: ArrayLike,
    k: ArrayLike,
    restitution: ArrayLike,
    mass_ratio: ArrayLike,
    natural: ArrayLike,
    damping: ArrayLike,
    spacing: ArrayLike | None = None,
) -> Array:
    """Phase of landing of mode k in turns, in [1/4, 1/2]; NaN below `locked_acceleration_min`.

    The other solution, 1/2 minus this one, is unstable at mu = 0.

    Parameters
    ----------
    acceleration
        Gamma of the base without particles, in units of gravity.
    k, restitution, mass_ratio, natural, damping, spacing
        As for `locked_acceleration_min`; all broadcast.

    Returns
    -------
    numpy.ndarray
        Turns, as the arguments broadcast; NaN where the orbit does not exist.

    Raises
    ------
    ParameterError
        An argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.sprung.landing_phase(0.6, 1, 0.9, 0.003, 0.37, 0.05).round(6))
    0.455305
    """
    least = locked_acceleration_min(k, restitution, mass_ratio, natural, damping, spacing)
    gamma = np.asarray(acceleration, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore"):
        sine = np.where(least <= gamma, least / gamma, np.nan)
    return np.asarray(0.5 - np.arcsin(sine) / TWO_PI)


def steepness(k: ArrayLike, restitution: ArrayLike, acceleration: ArrayLike) -> Array:
    """Return s = -Gamma cos(2 pi x) of the orbit on a base of infinite mass."""
    e = np.asarray(restitution)
    least = np.pi * np.asarray(k) * (1.0 - e) / (1.0 + e)
    gamma = np.asarray(acceleration)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt((gamma - least) * (gamma + least)))


@physical
def reversing_separation(
    k: ArrayLike, restitution: ArrayLike, acceleration: ArrayLike, mass_ratio: ArrayLike
) -> Array:
    """Separation in periods of neighbours that reverse their order at every impact.

    It is k mu / (s_m - s), to first order in mu, for any number of particles in one slot, which
    land equally spaced.

    Parameters
    ----------
    k, restitution, acceleration, mass_ratio
        Mode (forcing periods between impacts of a particle), e (0 to 1), Gamma of the base without
        particles in units of gravity, and mass of a particle over that of the base; they broadcast.

    Returns
    -------
    numpy.ndarray
        Forcing periods, as the arguments broadcast; NaN where the mode does not exist at mu = 0 or
        is unstable there (s >= s_m).

    Raises
    ------
    ParameterError
        An argument is outside its range.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> float(vs.theory.sprung.reversing_separation(1, 0.9, 0.6, 0.003).round(6))
    0.007042
    """
    e = np.asarray(restitution)
    below = 2.0 * (1.0 + e * e) / (1.0 + e) ** 2 - steepness(k, restitution, acceleration)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(
            np.where(below > 0.0, np.asarray(k) * np.asarray(mass_ratio) / below, np.nan)
        )
