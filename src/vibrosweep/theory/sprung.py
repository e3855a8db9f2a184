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

**Periodic orbits.** The equations of motion between impacts are linear.  An orbit therefore solves
two equations for each impact: the flight ends on the base, and the impact obeys the law of
restitution.  The joint state consists of the deviation of the base and its velocity, then height
and speed of each particle.

Particle i lands where h = y_i - Y = 0.  The impact changes the state to z+ = r(z-, t).  A small
difference dz- from the orbit delays the impact by n dz- / c, where n is the gradient of h and
c = -dh/dt the speed of approach.  Once both motions have had the impact, their difference is

    dz+ = S dz-,    S = r_z - (f+ - r_z f- - r_t) n / c

with the saltation matrix S and the rates of change of the state, f- before and f+ after the impact.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vibrosweep.arrays import Array
from vibrosweep.errors import ParameterError
from vibrosweep.mistakes import cut
from vibrosweep.model.parameters import as_numbers, physical

__all__ = [
    "CoupledBase",
    "Cycle",
    "landing_phase",
    "locked_acceleration_min",
    "recoil_deviation",
    "reversing_separation",
    "spectral_radius",
    "staggered",
]

TWO_PI = 2.0 * np.pi
RESIDUAL = 1e-11  # largest residual of a solution in units of k^2, the size of the terms


def __dir__() -> list[str]:
    return sorted(__all__)


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
    periods = as_numbers("spacing", spacing)
    if not np.all(np.isfinite(periods) & (periods > 0.0)):
        raise ParameterError(f"spacing = {spacing!r}: must be above 0 and finite")
    phi = mount_propagator(natural, damping, periods)
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
        In units of gravity, broadcast over the arguments.

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
        Turns, broadcast over the arguments; NaN where the orbit does not exist.

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
        Forcing periods, broadcast over the arguments; NaN where the mode does not exist at mu = 0
        or is unstable there (s >= s_m).

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


class CoupledBase(NamedTuple):
    """A base of finite mass in dimensionless form, with the coefficient of restitution.

    Attributes
    ----------
    restitution
        e, 0 to 1.
    acceleration
        Gamma of the base without particles, in units of gravity.
    mass_ratio
        Mass of one particle over that of the base.
    natural, damping
        Natural frequency of the mount over that of the forcing, and its damping ratio.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> base = vs.theory.sprung.CoupledBase(0.9, 0.6, 0.003, 0.37, 0.05)
    >>> base.acceleration
    0.6
    """

    restitution: float
    acceleration: float
    mass_ratio: float
    natural: float
    damping: float

    def drive(self, time: ArrayLike) -> tuple[Array, Array, Array]:
        """Return height, velocity and acceleration of the base without particles."""
        turn = TWO_PI * np.asarray(time)
        alpha = self.acceleration / np.pi
        height = -alpha / TWO_PI * np.cos(turn)
        return height, alpha * np.sin(turn), 2.0 * self.acceleration * np.cos(turn)

    @property
    def exchange(self) -> float:
        """Change of a particle's velocity per speed of approach, (1 + e) / (1 + mu)."""
        return (1.0 + self.restitution) / (1.0 + self.mass_ratio)


class Cycle(NamedTuple):
    """An orbit that repeats after whole forcing periods.

    Attributes
    ----------
    base, periods
        The base, and the number of forcing periods after which the orbit repeats.
    particle, time
        Shape (impact,): number of the particle that lands, from 0, and time in forcing periods.
    speed, approach
        Shape (impact,): absolute speed of the particle after the impact, and speed of approach
        before it, in g / (2 f).
    deviation
        Shape (impact, 2): deviation of the base, and its velocity, just before the impact.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> base = vs.theory.sprung.CoupledBase(0.9, 0.6, 0.003, 0.37, 0.05)
    >>> orbit = vs.theory.sprung.staggered(base, 2, [0, 1])
    >>> isinstance(orbit, vs.theory.sprung.Cycle), orbit.particle.tolist()
    (True, [0, 1])
    """

    base: CoupledBase
    periods: int
    particle: NDArray[np.int64]
    time: Array
    speed: Array
    approach: Array
    deviation: Array

    @property
    def intervals(self) -> Array:
        """Periods since the previous impact of any particle; shape (impact,)."""
        return _intervals(self.time, self.periods)


def _intervals(time: Array, periods: int) -> Array:
    return np.diff(time, prepend=time[-1] - periods)


def _before(particle: NDArray[np.int64], periods: int) -> tuple[NDArray[np.intp], Array]:
    """Return the index of the same particle's previous impact, and the shift of its time."""
    index, shift = np.empty(particle.size, dtype=np.intp), np.zeros(particle.size)
    for i in np.unique(particle):
        impacts = np.flatnonzero(particle == i)
        index[impacts] = np.roll(impacts, 1)
        shift[impacts[0]] = periods
    return index, shift


def _follow(unknown: Array, base: CoupledBase, particle: NDArray[np.int64], periods: int) -> Cycle:
    """Follow the deviation of the base through impacts with assumed times and speeds."""
    time, speed, end = np.split(unknown, [particle.size, 2 * particle.size])
    index, shift = _before(particle, periods)
    arrival = speed[index] - 2.0 * (time - time[index] + shift)
    velocity = base.drive(time)[1]
    free = mount_propagator(base.natural, base.damping, _intervals(time, periods))
    deviation, approach = np.empty((particle.size, 2)), np.empty(particle.size)
    for j in range(particle.size):
        deviation[j] = free[j] @ end
        approach[j] = velocity[j] + deviation[j, 1] - arrival[j]
        end = after(base, deviation[j], approach[j])
    return Cycle(base, periods, particle, time, speed, approach, deviation)


def after(base: CoupledBase, deviation: Array, approach: float) -> Array:
    """Return the deviation of the base just after an impact."""
    recoil = np.array([0.0, base.mass_ratio * base.exchange * approach])
    return np.asarray(deviation - recoil)


def _residual(
    unknown: Array, base: CoupledBase, particle: NDArray[np.int64], periods: int
) -> Array:
    """Return the residuals of each flight, each impact and the return of the base."""
    found = _follow(unknown, base, particle, periods)
    index, shift = _before(particle, periods)
    flight = found.time - found.time[index] + shift
    height = base.drive(found.time)[0] + found.deviation[:, 0]
    v = found.speed[index]
    miss = height[index] + (v - flight) * flight - height
    change = (v - 2.0 * flight) + base.exchange * found.approach - found.speed
    end = after(base, found.deviation[-1], float(found.approach[-1]))
    return np.concatenate([miss, change, end - unknown[-2:]])


def find_cycle(
    base: CoupledBase, k: int, time: ArrayLike, particle: ArrayLike, periods: int
) -> Cycle:
    """Find an orbit close to a guess, on which every particle flies for about k periods.

    The guess consists of the increasing times of the impacts in periods, and the number of the
    particle that lands, from 0; both have shape (impact,).  The orbit repeats after `periods`, a
    multiple of k.  It solves the equations of motion at these impacts only: a particle might
    meet the base in between.  Raises a ParameterError if there is no solution near the guess.
    """
    from scipy.optimize import root

    guess, numbers = np.asarray(time, dtype=np.float64), np.asarray(particle, dtype=np.int64)
    speeds = np.full(numbers.size, float(k))
    start = np.concatenate([guess, speeds, [0.0, -k * base.mass_ratio]])
    solution = root(_residual, start, args=(base, numbers, periods), tol=1e-13).x
    found = _follow(solution, base, numbers, periods)
    miss = np.abs(_residual(solution, base, numbers, periods)).max()
    real = (found.intervals > 0.0).all() and (found.approach > 0.0).all()
    if not (real and miss <= RESIDUAL * k * k):
        raise ParameterError(
            f"{base}: found no orbit of k = {k} with these impacts; begin with a better guess"
        )
    return found


def staggered(base: CoupledBase, k: int, slots: ArrayLike) -> Cycle:
    """Find the orbit of mode k with one particle in each of the given slots, 0 to k - 1.

    The orbit has a closed form if the slots are evenly spaced; otherwise the equations of motion
    are solved numerically.

    Parameters
    ----------
    base
        The base.
    k
        Mode: forcing periods between two impacts of a particle.
    slots
        Different numbers from 0 to k - 1: the period in which each particle lands.

    Returns
    -------
    Cycle
        The orbit, its impacts in the order of time.

    Raises
    ------
    ParameterError
        A slot is not one of mode k or is given twice, or there is no such orbit.

    Examples
    --------
    >>> import vibrosweep as vs
    >>> base = vs.theory.sprung.CoupledBase(0.9, 0.6, 0.003, 0.37, 0.05)
    >>> vs.theory.sprung.staggered(base, 1, [0]).time.round(6)
    array([0.455305])
    """
    if not isinstance(base, CoupledBase):
        raise ParameterError(f"base = {cut(repr(base))}: must be a CoupledBase")
    mode, given = as_numbers("k", k), as_numbers("slots", slots)
    if mode.ndim or not (mode >= 1.0 and mode == np.floor(mode)):
        raise ParameterError(f"k = {cut(repr(k))}: must be a whole number, at least 1")
    whole = given.ndim == 1 and given.size > 0 and (given == np.floor(given)).all()
    if not whole or given.min() < 0 or given.max() >= k or np.unique(given).size < given.size:
        raise ParameterError(
            f"slots = {cut(repr(slots))}: must be different numbers from 0 to {k - 1}"
        )
    taken = np.sort(given.astype(np.int64))
    e, gamma, mu, natural, damping = base
    gaps = np.diff(taken, append=taken[0] + k)
    evenly = bool((gaps == gaps[0]).all())
    spacing = int(gaps[0]) if evenly else k
    time = landing_phase(gamma, k, e, mu, natural, damping, spacing) + taken
    if np.isnan(time).any():
        raise ParameterError(f"{base}: no particle can be locked to k = {k}")
    particle = np.arange(taken.size)
    if not evenly:
        return find_cycle(base, k, time, particle, k)
    speed, approach = np.full(time.shape, float(k)), np.full(time.shape, 2.0 * k / base.exchange)
    deviation = 2.0 * k * mu * recoil_deviation(natural, damping, spacing)
    return Cycle(base, k, particle, time, speed, approach, np.tile(deviation, (taken.size, 1)))


def _flight(base: CoupledBase, particles: int, interval: float) -> Array:
    """Return the tangent map of the motion between two impacts."""
    tangent = np.eye(2 + 2 * particles)
    tangent[:2, :2] = mount_propagator(base.natural, base.damping, interval)
    height = 2 * np.arange(1, particles + 1)
    tangent[height, height + 1] = interval
    return tangent


def _saltation(cycle: Cycle, j: int, particles: int) -> Array:
    """Return the tangent map of impact j, S of the module's text."""
    base, c = cycle.base, cycle.approach[j]
    share, mu, w0 = base.exchange, base.mass_ratio, TWO_PI * base.natural
    y = 2 + 2 * cycle.particle[j]
    v = y + 1
    d, d_velocity = cycle.deviation[j]
    pull = base.drive(cycle.time[j])[2] - w0 * (2.0 * base.damping * d_velocity + w0 * d)
    jump = np.eye(2 + 2 * particles)
    jump[v, [v, 1]] += -share, share
    jump[1, [v, 1]] += mu * share, -mu * share
    excess = np.zeros(2 + 2 * particles)  # f+ - r_z f- - r_t
    excess[[0, y]] = -mu * share * c, share * c
    excess[v] = -share * (pull + 2.0)
    excess[1] = mu * share * (pull + 2.0 + 2.0 * base.damping * w0 * c)
    jump[:, y] -= excess / c
    jump[:, 0] += excess / c
    return jump


def monodromy(cycle: Cycle) -> Array:
    """Return the tangent map of one cycle, which begins and ends just after the last impact.

    Shape (2 + 2 particles, 2 + 2 particles); its eigenvalues are the Floquet multipliers.
    """
    particles = int(cycle.particle.max()) + 1
    product = np.eye(2 + 2 * particles)
    for j, interval in enumerate(cycle.intervals):
        flown = _flight(cycle.base, particles, float(interval)) @ product
        product = _saltation(cycle, j, particles) @ flown
    return product


def spectral_radius(cycle: Cycle) -> float:
    """Largest modulus of a Floquet multiplier, per forcing period; below 1 the orbit attracts.

    Parameters
    ----------
    cycle
        An orbit, as `staggered` finds it.

    Returns
    -------
    float
        The modulus to the power 1 / (periods of the cycle).

    Examples
    --------
    >>> import vibrosweep as vs
    >>> base = vs.theory.sprung.CoupledBase(0.9, 0.6, 0.003, 0.37, 0.05)
    >>> orbit = vs.theory.sprung.staggered(base, 1, [0])
    >>> round(vs.theory.sprung.spectral_radius(orbit), 6)
    0.899238
    """
    if not isinstance(cycle, Cycle):
        raise ParameterError(f"cycle = {cut(repr(cycle))}: must be a Cycle of staggered")
    largest = np.abs(np.linalg.eigvals(monodromy(cycle))).max()
    return float(largest ** (1.0 / cycle.periods))
