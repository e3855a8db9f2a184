"""Fit of the motion of the base and of the restitution to contacts with the base.

At a contact at time t the parabolas of two flights meet on the base, and the velocities v before
and v' after it obey the law of restitution relative to the base:

    y = level - (S cos wt - C sin wt) / w       v' - V = -e (v - V)       V = S sin wt + C cos wt

with w = 2 pi f, S = V0 cos phi, C = V0 sin phi; a trace may add harmonics to this sine.  Both
equations are fitted together, for all contacts.  Their errors follow from those of the two
parabolas, and contacts that share a flight are correlated; as the weights depend on the parameters,
errors of the arrival do not bias e (Deming regression).  A base of constant level that kicks with
A = (1 + e) V0 obeys the same equations without the oscillating term of y, which distinguishes the
two bases.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded, solve_banded
from scipy.optimize import OptimizeResult, least_squares

from vibrosweep.arrays import Array, Flags
from vibrosweep.errors import TrackError
from vibrosweep.lab.contacts import Contacts
from vibrosweep.lab.regression import TWO_PI, ordinary_least_squares, spread_of_influences, widen
from vibrosweep.lab.speed_laws import FAR, STEP, Law

# Scales of the robust loss (quadratic, then logarithmic) in standard errors: first wide, to keep
# the few but decisive contacts off a locked orbit, then narrow, against outliers.
BENDS: Final = (30.0, 3.0)
OUTLIER: Final = 4.5
RIDGE: Final = 1e-9
UNDETERMINED: Final = (
    "the landings do not determine how the base moves: they are too few, or all at nearly the same "
    "phases and speeds; film the approach to the orbit, or give a trace of the base or a mark on it"
)
ROUNDS: Final = 2
MOST_STEPS: Final = 30
STEPS: Final = (1e-6, 1e-7, 1e-7, 1e-8)  # of e, S, C and f in finite differences


class Oscillation(NamedTuple):
    """Motion of a base about its level.

    The values are S, C (m s-1) and f (Hz), then S and C of other harmonics; `numbers` are the
    harmonic numbers in this order.
    """

    values: Array
    numbers: tuple[int, ...] = (1,)

    @property
    def frequency(self) -> float:
        """Frequency of the motion in Hz."""
        return float(self.values[2])

    @property
    def tones(self) -> list[tuple[int, float, float]]:
        """Number, S and C of each harmonic."""
        pairs = np.delete(self.values, 2).reshape(-1, 2)
        return [(h, float(s), float(c)) for h, (s, c) in zip(self.numbers, pairs, strict=True)]

    @property
    def reach(self) -> float:
        """Upper bound of the height in m above the level."""
        return sum(float(np.hypot(s, c)) / (TWO_PI * h * self.frequency) for h, s, c in self.tones)

    def velocity(self, time: Array) -> Array:
        """Velocity in m s-1 at instants in s."""
        angle = TWO_PI * self.frequency * time
        return np.asarray(
            sum(s * np.sin(h * angle) + c * np.cos(h * angle) for h, s, c in self.tones)
        )

    def height(self, time: Array) -> Array:
        """Height in m above the level."""
        return np.asarray(sum(rise for _, rise in self._heights(time)))

    def acceleration(self, time: Array) -> Array:
        """Acceleration in m s-2."""
        return np.asarray(sum(-(omega**2) * rise for omega, rise in self._heights(time)))

    def _heights(self, time: Array) -> Iterator[tuple[float, Array]]:
        """Angular frequency (rad s-1) and height (m) of each harmonic."""
        angle = TWO_PI * self.frequency * time
        for h, s, c in self.tones:
            omega = TWO_PI * self.frequency * h
            yield omega, (c * np.sin(h * angle) - s * np.cos(h * angle)) / omega


class Trace(NamedTuple):
    """Measured values of an `Oscillation`, with their covariance and the harmonic numbers."""

    values: Array
    covariance: Array
    numbers: tuple[int, ...] = (1,)
    origin: float = 0.0  # instant in s, on the clock of the trace, at which t = 0

    def since(self, origin: float) -> Trace:
        """Count t from another instant of the clock; phases take the error of the frequency."""
        later = origin - self.origin
        if later == 0.0:
            return self
        values, change = self.values.copy(), np.eye(self.values.size)
        for k, h in enumerate(self.numbers):
            row = [0, 1] if k == 0 else [2 * k + 1, 2 * k + 2]
            rate = TWO_PI * h * later
            angle = rate * self.values[2]
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            values[row] = s, c = turn @ self.values[row]
            change[np.ix_(row, row)] = turn
            change[row, 2] = -rate * c, rate * s
        return Trace(values, change @ self.covariance @ change.T, self.numbers, origin)


class BaseFit(NamedTuple):
    """Motion of a base, fitted to contacts."""

    # values, covariance: restitution, S, C, f if it was free, S and C of other harmonics; then the
    # level below each particle
    values: Array
    covariance: Array
    problem: Problem  # contacts to which it was fitted
    oscillation: Oscillation  # of these values
    # particles, levels: numbers of the particles that have contacts, and the level below each, m
    particles: NDArray[np.intp]
    levels: Array
    kept: Flags  # True if a contact is not an outlier; shape (contact,)
    # misfit, freedom: chi-square per degree of freedom, and number of degrees of freedom
    misfit: float
    freedom: int
    # Squared distance of each contact in standard errors, at most `FAR`; shape (contact,)
    distance: Array


class Problem(NamedTuple):
    """Contacts to fit; the frequency, None if free; 1 for a moving base, 0 for one at a level."""

    contacts: Contacts
    owner: NDArray[np.intp]
    frequency: float | None
    moves: float
    trace: Trace | None
    # Law of restitution; a speed of yielding is the last parameter, after the levels
    law: Law = Law()

    @property
    def parameters(self) -> int:
        """Number of parameters without the levels."""
        if self.trace is not None:
            return 1 + self.trace.values.size
        return 4 if self.frequency is None else 3

    def base(self, values: Array) -> Oscillation:
        """Motion of the base among the values of the parameters."""
        motion = values[1 : self.parameters]
        if self.frequency is not None:
            motion = np.append(motion, self.frequency)
        return Oscillation(motion, (1,) if self.trace is None else self.trace.numbers)

    def equations(self, values: Array) -> tuple[Array, Array, Array]:
        """Residuals of height and velocity, and their derivatives by the errors of both flights.

        Shapes are (contact, 2) and (contact, 2, 2): by level and slope, per standard error.
        """
        c, e, base = self.contacts, values[0], self.base(values)
        velocity, moves = base.velocity(c.time), self.moves
        left = c.height - values[self.parameters + self.owner] - moves * base.height(c.time)
        after, q = self.law.rebound_speed(velocity - c.arrival, e, values[-1])
        bounce = c.departure - velocity - after
        closing = c.departure - c.arrival
        turn = (1.0 + q) * (c.gravity + base.acceleration(c.time)) / closing
        parts = []
        for fits, height, by_height, by_slope in (
            (c.before, (c.departure - moves * velocity) / closing, -turn, q),
            (c.after, (moves * velocity - c.arrival) / closing, turn, 1.0),
        ):
            of_level, of_slope = c.noise / np.sqrt(fits.number), c.noise / np.sqrt(fits.spread)
            since = c.time - fits.centre
            rows = [
                [height * of_level, height * since * of_slope],
                [by_height * of_level, (by_height * since + by_slope) * of_slope],
            ]
            parts.append(np.moveaxis(np.array(rows), -1, 0))
        return np.stack([left, bounce], axis=1), parts[0], parts[1]

    def residuals(self, values: Array) -> Array:
        """Residuals in standard errors, ignoring correlations; shape (contact, 2)."""
        left, before, after = self.equations(values)
        return np.asarray(left / np.sqrt((before**2).sum(axis=2) + (after**2).sum(axis=2)))

    def inliers(self, values: Array) -> Flags:
        """Mark the contacts that are not outliers; shape (contact,)."""
        apart = np.abs(self.residuals(values))
        # if all contacts deviate, as with a restitution that depends on speed, none is an outlier
        width = np.maximum(1.4826 * np.median(apart, axis=0), 1.0)
        return np.asarray((apart < OUTLIER * width).all(axis=1))

    def distance(self, values: Array) -> Array:
        """Squared distance of each contact in standard errors, at most `FAR`."""
        return np.asarray(np.minimum((self.residuals(values) ** 2).sum(axis=1), FAR))

    def flat_residuals(self, values: Array) -> Array:
        """Residuals in standard errors, flattened."""
        return self.residuals(values).ravel()

    def whitened(self, values: Array, kept: Flags, *, slopes: bool = False) -> Array:
        """Residuals whitened to unit covariance; with `slopes`, their derivatives by the levels."""
        left, before, after = self.equations(values)
        chosen = np.flatnonzero(kept)
        left, before, after = left[chosen], before[chosen], after[chosen]
        block = before @ before.transpose(0, 2, 1) + after @ after.transpose(0, 2, 1)
        linked = self.contacts.linked[chosen[:-1]] & (np.diff(chosen) == 1)
        following = before[1:] @ after[:-1].transpose(0, 2, 1) * linked[:, np.newaxis, np.newaxis]
        band = np.zeros((4, 2 * chosen.size))
        # a small ridge against rounding: the errors of linked flights are nearly dependent
        band[0] = (1.0 + RIDGE) * np.stack([block[:, 0, 0], block[:, 1, 1]], axis=1).ravel()
        band[1, 0::2] = block[:, 1, 0]
        band[1, 1:-1:2] = following[:, 0, 1]
        band[2, :-2] = np.stack([following[:, 0, 0], following[:, 1, 1]], axis=1).ravel()
        band[3, 0:-2:2] = following[:, 1, 0]
        levels = values.size - self.parameters - self.law.parameters
        right = np.zeros((2 * chosen.size, levels)) if slopes else left.ravel()
        if slopes:
            right[2 * np.arange(chosen.size), self.owner[chosen]] = -1.0
        solved = solve_banded((3, 0), cholesky_banded(band, lower=True), right)
        if self.trace is None:
            return np.asarray(solved)
        root = np.linalg.inv(np.linalg.cholesky(self.trace.covariance))
        if slopes:
            return np.concatenate([solved, np.zeros((self.trace.values.size, levels))])
        motion = values[1 : self.parameters]
        return np.concatenate([solved, root @ (motion - self.trace.values)])

    def derivatives(self, values: Array, kept: Flags) -> Array:
        """Derivatives of `whitened` by all parameters."""
        more = self.parameters - len(STEPS)
        steps = dict(enumerate((STEPS + STEPS[1:2] * more)[: self.parameters]))
        steps |= {values.size - 1: STEP} if self.law.parameters else {}
        columns = []
        for k, step in steps.items():
            ends = [values + sign * step * (np.arange(values.size) == k) for sign in (1.0, -1.0)]
            up, down = (self.whitened(end, kept) for end in ends)
            columns.append((up - down) / (2.0 * step))
        levels = self.whitened(values, kept, slopes=True)
        return np.column_stack([*columns[: self.parameters], levels, *columns[self.parameters :]])


def fit_base(
    contacts: Contacts, frequency: float, *, free: bool, moves: bool, trace: Trace | None = None
) -> BaseFit:
    """Fit the motion of a base to contacts.

    The frequency (Hz) is a parameter if `free` or if there is a `trace`, a measured motion of the
    base.  Without `moves` the base has a constant level and kicks.  Raises a TrackError if there
    are fewer equations than parameters.
    """
    particles, owner = np.unique(contacts.particle, return_inverse=True)
    free = free or trace is not None
    problem = Problem(contacts, owner, None if free else frequency, float(moves), trace)
    known, count = 0 if trace is None else trace.values.size, problem.parameters
    if 2 * contacts.time.size + known < count + particles.size or not contacts.time.size:
        raise TrackError(UNDETERMINED)
    values, scale = _start(problem, frequency, particles.size)
    for bend in BENDS:
        values = least_squares(
            problem.flat_residuals,
            values,
            loss="cauchy",
            f_scale=bend,
            x_scale=scale,
            max_nfev=MOST_STEPS,
        ).x
    found, kept = without_outliers(problem, values, scale, problem.inliers(values))
    values = found.x
    covariance, misfit, freedom = covariance_of_fit(found)
    return BaseFit(
        values,
        covariance,
        problem,
        problem.base(values),
        particles,
        values[count:],
        kept,
        misfit,
        freedom,
        problem.distance(values),
    )


def without_outliers(
    problem: Problem, values: Array, scale: Array, kept: Flags
) -> tuple[OptimizeResult, Flags]:
    """Fit the contacts that are `kept`, then fit again without outliers.

    Returns the last fit, and flags of the contacts that it used.  The first fit begins at `values`,
    whose scale is `scale`.
    """
    for _ in range(ROUNDS):
        found = least_squares(
            problem.whitened,
            values,
            problem.derivatives,
            x_scale=scale,
            args=(kept,),
            max_nfev=MOST_STEPS,
        )
        used, values, kept = kept, found.x, problem.inliers(found.x)
    return found, used


def covariance_of_fit(found: OptimizeResult) -> tuple[Array, float, int]:
    """Covariance of the parameters, chi-square per degree of freedom, and degrees of freedom."""
    freedom = found.fun.size - found.x.size
    misfit = float(2.0 * found.cost / max(freedom, 1))
    # scaled, because a trace without noise determines some parameters far better than others
    slopes = np.asarray(found.jac)
    size = np.linalg.norm(slopes, axis=0)
    size[size == 0.0] = 1.0  # a level whose contacts are all outliers
    slopes = slopes / size
    inverse = np.linalg.pinv(slopes.T @ slopes, hermitian=True)
    scale, influences = np.outer(size, size), spread_of_influences(found.fun, slopes, inverse)
    return widen(inverse / scale, misfit, freedom, influences / scale), misfit, freedom


def _start(problem: Problem, frequency: float, levels: int) -> tuple[Array, Array]:
    """First values of the parameters, among them the frequency (Hz) if free, and their scales."""
    contacts, trace, count = problem.contacts, problem.trace, problem.parameters
    e, sine, cosine = ordinary_least_squares(contacts.speeds, frequency)  # v' = -e v + (1 + e) V
    start = [e, sine / (1.0 + e), cosine / (1.0 + e), frequency][:count]
    if trace is not None and count > len(start):
        start = [_restitution(contacts, Oscillation(trace.values, trace.numbers)), *trace.values]
    medians = [np.median(contacts.height[problem.owner == p]) for p in range(levels)]
    scale = np.concatenate([np.full(count, 0.1), np.full(levels, 1e-4)])
    if problem.frequency is None:
        scale[3] = 1e-3
    return np.array([*start, *medians]), scale


def _restitution(contacts: Contacts, base: Oscillation) -> float:
    """Restitution by ordinary least squares of v' - V = -e (v - V)."""
    velocity = base.velocity(contacts.time)
    arrival = contacts.arrival - velocity
    return float(-(contacts.departure - velocity) @ arrival / (arrival @ arrival))
