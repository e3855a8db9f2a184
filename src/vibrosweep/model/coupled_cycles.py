"""Periodic orbits of particles on a base of finite mass, and their Floquet multipliers.

The equations of motion between impacts are linear.  An orbit therefore solves two equations for
each impact: the flight ends on the base, and the impact obeys the law of restitution.  Units are
those of `vibrosweep.model.coupled_theory`.  The joint state consists of the deviation of the base
and its velocity, then height and speed of each particle.

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
from vibrosweep.model.coupled_theory import landing_phase, mount_propagator, recoil_deviation
from vibrosweep.model.physical import as_numbers

TWO_PI = 2.0 * np.pi
RESIDUAL = 1e-11  # largest residual of a solution in units of k^2, the size of the terms


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
