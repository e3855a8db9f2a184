"""Closed forms of particles that bounce on a base of finite mass (numpy only).

Everything is in the dimensionless form: times in forcing periods, phases in turns, speeds in
g / (2 f), so that gravity is 2.  Gamma is the acceleration of the base without particles in g, and
alpha = Gamma / pi its velocity; mu the mass of one particle over that of the base, nu the natural
frequency of the mount over that of the forcing, zeta its damping ratio.  The base moves as without
particles plus a deviation D, which between impacts is free,

    D'' + 2 zeta w0 D' + w0^2 D = 0,    w0 = 2 pi nu,

and which each impact of a particle, approaching with the speed c, changes in velocity by
-mu (1 + e) c / (1 + mu) while the particle's changes by (1 + e) c / (1 + mu).

**Locked.** A particle that lands every k periods leaves with the speed k and lands with -k, so that
its velocity changes by 2 k, that of the base by -2 k mu, and c = 2 k (1 + mu) / (1 + e).  With the
deviation D'- just before the impact, which the earlier recoils have left,

    alpha sin(2 pi x) = c - k - D'-.

**Two in one slot.** To first order in mu the later of two particles that land close together meets
a base that has lost 2 k mu of its speed, and nothing else tells the two apart: their difference in
time and speed follows the linear map of a particle on a base of infinite mass, whose
characteristic polynomial is p(z), driven by a kick of -(1 + e) 2 k mu to the later one.  In a
pattern that repeats, each Fourier component z of the order of landing, z^n being its value at
landing n, has the response

    -z k mu (1 + e)^2 / p(z),    p(z) = z^2 - (1 + e^2 - (1 + e)^2 s) z + e^2,

s = -Gamma cos(2 pi x).  The pattern exists if the landings that follow come in the order that was
assumed.  A fixed order (z = 1) would need -k mu / s > 0 and is impossible; an order that reverses
each time (z = -1) gives k mu / (s_m - s), s_m = 2 (1 + e^2) / (1 + e)^2.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.model.physical import physical

TWO_PI = 2.0 * np.pi


def mount_propagator(natural: ArrayLike, damping: ArrayLike, periods: ArrayLike) -> Array:
    """Propagator of the free base, exp(t [[0, 1], [-w0^2, -2 zeta w0]]), for any damping.

    nu, zeta and the time t >= 0 in forcing periods broadcast; (..., 2, 2), of the deviation and its
    velocity.
    """
    w0, zeta, t = (np.asarray(v, dtype=np.float64) for v in (natural, damping, periods))
    w0 = TWO_PI * w0
    root = np.sqrt(zeta * zeta - 1.0 + 0j)
    slow = np.exp(-w0 * t / (zeta + root))  # zeta - root without cancellation
    twice = 2.0 * w0 * t * root
    # (1 - exp(-x)) / x, which is 1 at critical damping and, to a rounding, close to it
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

    Just before a recoil, when it has become periodic, it is Phi (1 - Phi)^-1 (0, -1), with the
    propagator Phi over one spacing.  Without damping its velocity is 1/2, whatever the natural
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
        Shape (..., 2): deviation and its velocity, per unit of velocity that a recoil takes.
        Infinite where the mount is undamped and swings a whole number of times between recoils.

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
    kept = np.eye(2) - phi
    unit = np.array([0.0, -1.0])
    determinant = kept[..., 0, 0] * kept[..., 1, 1] - kept[..., 0, 1] * kept[..., 1, 0]
    # the inverse of a matrix of 2 x 2, column by column: its second column times -1
    after = np.stack([kept[..., 0, 1], -kept[..., 0, 0]], axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(after / determinant[..., np.newaxis] - unit)


def _needed_velocity(
    k: ArrayLike, restitution: ArrayLike, mass_ratio: ArrayLike, recoil_velocity: ArrayLike
) -> Array:
    """Velocity that the drive gives the base at an impact of a locked orbit."""
    k, e, mu = np.asarray(k), np.asarray(restitution), np.asarray(mass_ratio)
    return np.asarray(k * (1.0 - e + 2.0 * mu) / (1.0 + e) - 2.0 * k * mu * recoil_velocity)


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

    Without damping it is Gamma_k (1 + mu), Gamma_k = pi k (1 - e) / (1 + e), whatever the natural
    frequency; with damping it is higher, because a dissipated energy can only have come from the
    recoil: (D'- + D'+) / 2 <= 0.

    Parameters
    ----------
    k, restitution, mass_ratio, natural, damping
        Mode (forcing periods between impacts of a particle), e (0 to 1), mass of a particle over
        that of the base, natural frequency of the mount over that of the forcing, and its damping
        ratio; they broadcast.
    spacing
        Periods between two impacts on the base: k (the default) for one particle, 1 where each of
        the k slots holds one.

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
    velocity = recoil_deviation(natural, damping, k if spacing is None else spacing)[..., 1]
    return np.asarray(np.pi * _needed_velocity(k, restitution, mass_ratio, velocity))


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
        As of `locked_acceleration_min`; all broadcast.

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


def volume_contraction(
    impacts: ArrayLike,
    periods: ArrayLike,
    restitution: ArrayLike,
    natural: ArrayLike,
    damping: ArrayLike,
) -> Array:
    """Factor by which volumes of the joint state shrink, e^(2 n) exp(-2 zeta w0 t).

    An impact turns the relative height and the relative velocity into -e times themselves, to first
    order, and leaves the motion of the common centre of mass as it is; between impacts only the
    mount dissipates.  The numbers of particles and their masses do not enter.
    """
    e, w0 = np.asarray(restitution), TWO_PI * np.asarray(natural)
    lost = np.exp(-2.0 * np.asarray(damping) * w0 * np.asarray(periods))
    return np.asarray(e ** (2.0 * np.asarray(impacts)) * lost)


def _steepness(k: ArrayLike, restitution: ArrayLike, acceleration: ArrayLike) -> Array:
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

    k mu / (s_m - s), to first order in mu and for any number of particles in one slot, which land
    equally spaced.

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
    below = 2.0 * (1.0 + e * e) / (1.0 + e) ** 2 - _steepness(k, restitution, acceleration)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(
            np.where(below > 0.0, np.asarray(k) * np.asarray(mass_ratio) / below, np.nan)
        )


def bunch(
    k: int, restitution: float, acceleration: float, mass_ratio: float, rank: ArrayLike
) -> Array | None:
    """Landing times of particles in one slot that repeat a given sequence of orders.

    To first order in the mass ratio, see the module; in periods, from the mean of the particles at
    that landing.  `rank`, of the same shape (landing, particle), gives the number of particles that
    land before each particle at each landing of the repeated sequence.  None where the landings
    that follow do not come in the assumed order, or mode k is not stable at mu = 0: there is no
    such pattern.  Raises a ParameterError where a row of `rank` is no permutation of the particles.
    """
    order = np.asarray(rank)
    particles = np.arange(order.shape[1])
    if not (np.sort(order, axis=1) == particles).all():
        raise ParameterError(f"rank: each landing ranks the particles 0 to {particles[-1]} once")
    if np.isnan(reversing_separation(k, restitution, acceleration, mass_ratio)):
        return None
    e, s = restitution, float(_steepness(k, restitution, acceleration))
    z = np.exp(2j * np.pi * np.fft.fftfreq(order.shape[0]))
    polynomial = z * z - (1.0 + e * e - (1.0 + e) ** 2 * s) * z + e * e
    answer = -z * k * mass_ratio * (1.0 + e) ** 2 / polynomial
    spectrum = np.fft.fft(order - particles.mean(), axis=0)
    apart = np.fft.ifft(answer[:, np.newaxis] * spectrum, axis=0).real
    follows = np.argsort(np.argsort(apart, axis=1), axis=1)
    return apart if np.array_equal(follows, order) else None


def impact_damper(
    gap: float, amplitude: float, restitution: float, mass_ratio: float, natural: float
) -> list[tuple[float, float]]:
    """Impact damper: a particle between two walls of an undamped oscillator, two impacts per cycle.

    The system of Masri and Caughey (1966), J. Appl. Mech. 33, 586, without dash-pot; the formula is
    derived from its symmetry.  The oscillator of mass 1 would swing with the amplitude B without
    the particle of mass mu, which flies freely between walls that are d apart.  Half a period after
    an impact everything has changed its sign.  With the particle's speed u, momentum and
    restitution give the velocity of the oscillator -u (1 - e + 2 mu) / (1 + e) before an impact at
    the wall ahead.  Its free part, z- = -R z+ with z+ - z- = (0, 2 mu u) and R its rotation in half
    a period, is -(mu u / w0) tan(w0 T / 4) in position and -mu u in velocity; and the particle
    travels 2 X + d = u T / 2.  Hence the driven part has, at an impact,

        position  u p - d / 2,    p = T / 4 + (mu / w0) tan(w0 T / 4)
        velocity  -u q,           q = (1 - e) (1 + mu) / (1 + e)

    and (u p - d / 2)^2 + (u q T / 2 pi)^2 = B^2 gives u.

    Gap d and amplitude B are in one unit of length, the natural frequency over that of the forcing,
    T = 1.  Returns (u, phase) of each solution with u > 0, none to two: speed of the particle in
    units of length per period, and phase in turns of the impact at the wall ahead, where the driven
    part is B sin(2 pi phase).
    """
    w0 = TWO_PI * natural
    p = 0.25 + mass_ratio / w0 * np.tan(0.25 * w0)
    q = (1.0 - restitution) * (1.0 + mass_ratio) / (1.0 + restitution)
    speeds = np.roots([p * p + (q / TWO_PI) ** 2, -gap * p, 0.25 * gap * gap - amplitude**2])
    return [
        (float(u), float(np.arctan2(u * p - 0.5 * gap, -u * q / TWO_PI) / TWO_PI))
        for u in np.sort(speeds)
        if np.isreal(u) and u > 0.0
    ]
