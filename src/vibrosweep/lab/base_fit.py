"""Motion of the base and restitution, fitted to contacts, where successive flights meet."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky_banded, solve_banded
from scipy.optimize import OptimizeResult, brentq, least_squares, minimize_scalar

from vibrosweep.arrays import Array, Flags, Indices
from vibrosweep.errors import TrackError
from vibrosweep.lab.ballistics import CONTACT, POWER, SHARE, Input, bend, from_range
from vibrosweep.lab.flights import (
    Fits,
    Samples,
    clear_flights,
    fit_parabolas,
    gravity_of_high_flights,
    line_variance,
    meet,
    stretches,
)
from vibrosweep.lab.regression import (
    FAR,
    FEWEST,
    STEP,
    TWO_PI,
    Law,
    Speeds,
    fits_better,
    frequencies_to_try,
    is_unphysical,
    ordinary_least_squares,
    robust_covariance,
    weakest_signal,
    widen,
)

# -----------------------------------------------------------------------------
# Contacts with the base: intersections of successive flights, wherever the base is.


class Contacts(NamedTuple):
    """Bounces between flights that are clearly resolved; arrays of shape (contact,)."""

    # before, after: the flights on both sides
    before: Fits
    after: Fits
    particle: Indices  # number of the particle
    linked: Flags  # True if the flight that begins here ends at the next contact
    # time, height: where the parabolas meet, s and m
    time: Array
    height: Array
    # arrival, departure: velocities there, m s-1
    arrival: Array
    departure: Array
    noise: float  # standard deviation of a sample, m
    gravity: float  # curvature of the parabolas, m s-2
    drag: float = 0.0  # that `without_drag` took out of the samples, s2 m-2

    @property
    def speeds(self) -> Speeds:
        """Speeds of arrival and departure, and the times."""
        return Speeds(-self.arrival, self.departure, self.time)

    def take(self, chosen: Flags) -> Contacts:
        """Return the chosen contacts; a chain ends where the next contact is left out."""
        linked = self.linked & np.append(chosen, False)[1:]
        columns = {"particle", "time", "height", "arrival", "departure"}
        return self._replace(
            before=self.before.take(chosen),
            after=self.after.take(chosen),
            linked=linked[chosen],
            **{name: getattr(self, name)[chosen] for name in columns},
        )

    def falling(self, gravity: float, drag: float) -> Contacts:
        """Return the contacts if flights fall with another gravity (m s-2), in air.

        `drag` is 1 / (terminal speed)^2 (s2 m-2).  All changes are of first order; the lines that
        were fitted to a flight are those of evenly spaced samples.
        """
        if gravity == self.gravity and drag == self.drag == 0.0:
            return self
        more, cubic = gravity - self.gravity, drag * gravity**3
        fitted = (drag - self.drag) * gravity**3
        changes = []
        for fits in (self.before, self.after):
            since, apex = self.time - fits.centre, fits.slope / gravity
            half = np.sqrt(3.0 * fits.spread / fits.number)
            last, first, here = half - apex, -half - apex, since - apex
            fifth = (np.abs(last) ** 5 - np.abs(first) ** 5) / 5.0
            sixth = (last**5 * np.abs(last) - first**5 * np.abs(first)) / 6.0
            level = fitted * fifth / (24.0 * half)
            slope = fitted * (sixth + apex * fifth) / (8.0 * half**3)
            rise = 0.5 * more * (half**2 / 3.0 - since**2)
            rise += bend(here, gravity, drag) - level - slope * since
            changes.append((rise, cubic * np.abs(here) ** 3 / 3.0 - slope - more * since))
        (low, falling), (high, rising) = changes
        later = (low - high) / (self.departure - self.arrival)
        return self._replace(
            time=self.time + later,
            height=self.height + low + self.arrival * later,
            arrival=self.arrival + falling - gravity * later,
            departure=self.departure + rising - gravity * later,
            gravity=gravity,
        )

    def earliest(self, number: int) -> Contacts:
        """Return the earliest `number` of contacts, or all if there are no more."""
        if self.time.size <= number:
            return self
        return self.take(self.time <= np.partition(self.time, number - 1)[number - 1])


class Cut(NamedTuple):
    """Tracks cut into stretches of flight, and the contacts between them."""

    contacts: Contacts
    member: Indices  # number of the stretch of each sample
    # fall, error: downward acceleration in high stretches, and its standard error, m s-2
    fall: float
    error: float


def without_drag(samples: Samples, member: Indices, gravity: float, drag: float) -> Samples:
    """Take the effect of drag, of first order, out of the samples of each stretch.

    `member` is the number of the stretch of each sample, -1 for none; `drag` is
    1 / (terminal speed)^2 (s2 m-2).  The samples are then on parabolas with the same apexes.
    """
    fits = fit_parabolas(samples, member, int(member.max()) + 1, gravity)
    apex = fits.centre + fits.slope / gravity
    since = np.where((member >= 0) & (fits.number[member] > 2.0), samples.time - apex[member], 0.0)
    return replace(samples, height=samples.height - bend(since, gravity, drag))


def find_contacts(samples: Samples, gravity: float) -> Cut:
    """Find contacts with the base; `gravity` is the acceleration of free fall (m s-2)."""
    member, noise = stretches(samples, gravity)
    member = _without_contacts(samples, member)
    start = np.flatnonzero(np.diff(np.maximum.accumulate(member), prepend=-1))
    extent = np.maximum.reduceat(samples.height, start)
    extent -= np.minimum.reduceat(samples.height, start)
    found = gravity_of_high_flights(samples, member, extent, noise)  # high stretches are not stays
    fits = fit_parabolas(samples, member, start.size, gravity)
    every = np.flatnonzero(np.diff(samples.piece[start]) == 0)
    return Cut(contacts_between(samples, member, fits, every, noise, gravity), member, *found)


def _without_contacts(samples: Samples, member: Indices) -> Indices:
    """Return the number of the stretch of each sample, -1 in stretches no longer than a contact."""
    start = np.flatnonzero(np.diff(member, prepend=-1))
    step = float(np.median(np.diff(samples.time)))
    last = np.append(start[1:], member.size) - 1
    brief = samples.time[last] - samples.time[start] + step < LONGEST_CONTACT + 1e-6 * step
    # between two flights of one piece of track
    inner = np.diff(samples.piece[start]) == 0
    brief[1:] &= inner
    brief[:-1] &= inner
    brief[[0, -1]] = False
    number = np.where(brief, -1, np.cumsum(~brief) - 1)
    return np.asarray(number[member])


def contacts_between(
    samples: Samples, member: Indices, fits: Fits, landing: Indices, noise: float, fall: float
) -> Contacts:
    """Contacts between the flights numbered `landing` and those that follow them.

    Contacts next to a flight that is not clearly resolved are left out.  `member` is the number of
    the flight of each sample, -1 for none; `noise` the standard deviation of a sample (m), `fall`
    the acceleration of flights (m s-2).
    """
    clear = clear_flights(samples, member, fits, noise, fall)
    # noise from flights alone, because residuals of a stay would inflate it
    free = fits.number[clear] - 2.0
    least = 1e-9 * float(np.ptp(samples.height))  # rounding errors
    noise = max(np.sqrt(fits.residue[clear].sum() / free.sum()), least) if free.size else noise
    landing = landing[clear[landing] & clear[landing + 1]]
    before, after = fits.take(landing), fits.take(landing + 1)
    met = meet(before, after, (before.centre + after.centre) / 2.0, fall)
    arrival = before.slope - fall * (met.time - before.centre)
    departure = arrival + met.closing
    owner = np.zeros(fits.number.size, np.intp)
    owner[member[member >= 0]] = samples.particle[member >= 0]
    linked = np.append(np.diff(landing) == 1, False)[: landing.size]
    found = Contacts(
        before, after, owner[landing], linked, met.time, met.height, arrival, departure, noise, fall
    )
    # two parts of one flight have no contact between them: their slopes hardly differ, so that
    # where they meet is not even known to a frame
    step = float(np.median(np.diff(samples.time)))
    with np.errstate(invalid="ignore"):
        return found.take((departure > arrival) & (noise * np.sqrt(met.time_variance) < step))


# -----------------------------------------------------------------------------
# Fit of the motion of the base and of the restitution to contacts with the base.
#
# At a contact at time t the parabolas of two flights meet on the base, and the velocities v before
# and v' after it obey the law of restitution relative to the base:
#
#     y = level - (S cos wt - C sin wt) / w       v' - V = -e (v - V)       V = S sin wt + C cos wt
#
# with w = 2 pi f, S = V0 cos phi, C = V0 sin phi; a trace may add harmonics to this sine.  Both
# equations are fitted together, for all contacts.  Their errors follow from those of the two
# parabolas, and contacts that share a flight are correlated; as the weights depend on the
# parameters, errors of the arrival do not bias e (Deming regression).  A base of constant level
# that kicks with A = (1 + e) V0 obeys the same equations without the oscillating term of y, which
# distinguishes the two bases.
#
# A contact of duration tau begins before the parabolas meet and ends after that, by fractions of
# tau in the ratio of the speeds, and they meet below the base.  As the acceleration of the base and
# gravity, together G, act during the contact, the ball leaves later and more slowly: those of a
# dashpot follow from the motion under a constant G, to first order the speed is less by k G tau,
# k = -2 (1 + e) log e / (pi^2 + log^2 e).  For a Hertz contact, whose duration is v^-0.2 times that
# at 1 m/s, the factors were integrated.  Laws of force differ in them by as much as a dashpot and
# Hertz do; the exponent, and the share of Hertz in these effects, are parameters.  Contact time,
# exponent, share, apparent gravity and drag have priors; heights and curvatures determine them
# further.  The restitution may scatter from bounce to bounce: its standard deviation, a
# variance component of the second equation, is the maximum-likelihood estimate.
#
# The equations of a chain of flights are those of a deterministic orbit, on which errors grow: in
# some combinations of many equations the first-order errors cancel.  Second-order terms remain,
# which a linear propagation neglects; without them such combinations would have far too large
# weights.

# Scales of the robust loss (quadratic, then logarithmic) in standard errors: first wide, to include
# the few but decisive contacts away from a locked orbit, then narrow, against outliers.
BENDS: Final = (30.0, 3.0)
OUTLIER: Final = 4.5
RIDGE: Final = 1e-9
UNDETERMINED: Final = (
    "the landings do not determine how the base moves: they are too few, or all at nearly the same "
    "phases and speeds; film the approach to the orbit, or give a trace of the base or a mark on it"
)
ROUNDS: Final = 2
MOST_STEPS: Final = 30
ACCURATE: Final = 1e-6  # relative change of chi-square at which a fit has converged
STEPS: Final = (1e-6, 1e-7, 1e-7, 1e-8)  # of e, S, C and f in finite differences
LONGEST_CONTACT: Final = 5e-3  # s
INSTANT: Final = Input(0.0, 1e-9)
SCATTERS: Final = np.append(0.0, np.geomspace(1e-4, 0.3, 24))  # trial values of the scatter of e
# Effects of G on a Hertz contact relative to those on a dashpot, less 1: a + e on the speed, and
# b - c e on the duration; those of its change: d e^2 - f on the speed; and absolute, that of its
# change on the duration, and that of the square of G on the speed
HERTZ: Final = (0.06, 0.35, 0.75, 0.245, 0.198, 0.022, 0.015)
TOGETHER: Final = (0.1, 0.041)  # times e^-1/2 on the speed, times 1/e on the duration
CURVED: Final = 0.0476  # weight of the second derivative of G, for both laws and every e
MOST_PUSH: Final = 0.7  # G tau / v; at more, a ball hardly leaves
NEGLECTED: Final = 0.25  # error of the speed after a contact, relative to v (G tau / v)^3
NEWTONS: Final = 3
# Limits of the inputs in trial steps, against overflow
FARTHEST: Final = np.array([[0.1, 1e3], [-1.0, 1.0], [-0.5, 0.5], [-3.0, 4.0], [-0.1, 0.1]])
SHORTEST: Final = 1e-8  # s, contact time below which a contact is instantaneous
SLOWEST: Final = 1e-3  # m s-1, least impact speed in the contact time
LEAST_E: Final = 0.01
ONE_SIDED: Final = 2.71  # rise of the deviance at a one-sided limit of 95 %


class Inputs(NamedTuple):
    """Priors of quantities that are the same in all flights and contacts."""

    gravity: Input  # apparent, m s-2
    drag: Input = Input(0.0)  # 1 / (terminal speed)^2, s2 m-2
    power: Input = Input(0.0)  # contact times are proportional to (impact speed)^-power
    share: Input = Input(0.0)  # of a Hertz contact, the rest a dashpot, in the effects of G
    contact: Input = INSTANT  # contact time at 1 m/s, s

    def lasting(self, contact: Input | None = None) -> Inputs:
        """Return the same with contacts of a given duration (s), by default the usual one."""
        return self._replace(power=POWER, share=SHARE, contact=contact or from_range(*CONTACT))

    @property
    def instant(self) -> Inputs:
        """The same with instantaneous impacts."""
        return self._replace(power=Input(0.0), share=Input(0.0), contact=INSTANT)

    @property
    def firm(self) -> Inputs:
        """The same without errors except that of the contact time."""
        return Inputs._make([*(Input(one.value) for one in self[:-1]), self.contact])


COUNT: Final = len(Inputs._fields)
STEPS_OF_INPUTS: Final = (1e-4, 1e-6, 1e-3, 1e-3, 1e-7)
EXACT: Final = 1e-9  # relative error of an input without one


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
        """Upper bound on the height in m above the level."""
        return sum(float(np.hypot(s, c)) / (TWO_PI * h * self.frequency) for h, s, c in self.tones)

    def motion(self, time: Array) -> tuple[Array, ...]:
        """Height above the level (m), and its first four derivatives (SI), at times in s."""
        tones = np.array(self.tones).T[:, :, np.newaxis]
        omega, sine, cosine = TWO_PI * self.frequency * tones[0], tones[1], tones[2]
        sines, cosines = np.sin(omega * time), np.cos(omega * time)
        rise = (cosine * sines - sine * cosines) / omega
        speed = sine * sines + cosine * cosines
        terms = rise, speed, -(omega**2) * rise, -(omega**2) * speed, omega**4 * rise
        return tuple(np.asarray(term.sum(axis=0)) for term in terms)

    def height(self, time: Array) -> Array:
        """Height in m above the level."""
        return self.motion(time)[0]

    def velocity(self, time: Array) -> Array:
        """Velocity in m s-1 at times in s."""
        return self.motion(time)[1]


class Trace(NamedTuple):
    """Measured values of an `Oscillation`, with their covariance and the harmonic numbers."""

    values: Array
    covariance: Array
    numbers: tuple[int, ...] = (1,)
    origin: float = 0.0  # time in s, on the clock of the trace, at which t = 0
    # gravity where it was recorded, m s-2; NaN if it has the scale of the film, as a mark has
    gravity: float = np.nan

    def since(self, origin: float) -> Trace:
        """Shift the time origin; the error of the frequency propagates to the phases."""
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
        covariance = change @ self.covariance @ change.T
        return self._replace(values=values, covariance=covariance, origin=origin)

    def filmed(self, gravity: float) -> Array:
        """Values in the scale of a film with this apparent gravity (m s-2)."""
        scale = np.full(self.values.size, 1.0 if np.isnan(self.gravity) else gravity / self.gravity)
        scale[2] = 1.0
        return scale * self.values


class BaseFit(NamedTuple):
    """Motion of a base fitted to contacts."""

    # values, covariance: restitution, S, C, f if it was free, S and C of other harmonics; then the
    # level below each particle, and the quantities of `Inputs`
    values: Array
    covariance: Array
    problem: Problem  # contacts to which it was fitted
    oscillation: Oscillation  # of these values
    # particles, levels: numbers of the particles that have contacts, and the level below each, m
    particles: NDArray[np.intp]
    levels: Array
    used: Flags  # True if a contact is not an outlier; shape (contact,)
    # misfit, freedom: reduced chi-square, and number of degrees of freedom
    misfit: float
    freedom: int
    # Squared distance of each contact in standard errors, at most `FAR`; shape (contact,)
    distance: Array
    scatter_limit: float  # upper limit (95 %) on the scatter of the restitution

    @property
    def gravity(self) -> tuple[float, float]:
        """Apparent gravity and its standard error, m s-2."""
        return float(self.values[-COUNT]), float(np.sqrt(self.covariance[-COUNT, -COUNT]))

    def lasting(self, speed: Array, time: Array) -> Array:
        """Contact times (s), at least 0, of impacts at speeds relative to the base and times."""
        half = max(float(self.values[-1]), 0.0) / 2.0
        _, _, pull, *changes = self.oscillation.motion(time + half)
        lasting, _ = self.problem.lasting(self.values, speed, self.gravity[0] + pull, *changes)
        return np.maximum(lasting, 0.0)


class Problem(NamedTuple):
    """Contacts to fit; the frequency, None if free; 1 for a moving base, 0 for a constant level."""

    contacts: Contacts
    owner: NDArray[np.intp]
    frequency: float | None
    moves: float
    trace: Trace | None
    inputs: Inputs
    # Law of restitution; a yield speed is the last parameter, after the inputs
    law: Law = Law()
    scatter: float = 0.0  # standard deviation of the restitution from bounce to bounce

    @property
    def parameters(self) -> int:
        """Number of parameters without the levels."""
        if self.trace is not None:
            return 1 + self.trace.values.size
        return 4 if self.frequency is None else 3

    def base(self, values: Array) -> Oscillation:
        """Motion of the base for given values of the parameters."""
        motion = values[1 : self.parameters]
        if self.frequency is not None:
            motion = np.append(motion, self.frequency)
        return Oscillation(motion, (1,) if self.trace is None else self.trace.numbers)

    def equations(self, values: Array) -> tuple[Array, Array, Array, Array]:
        """Residuals of height and velocity, and their errors.

        Returns the residuals, shape (contact, 2), their derivatives by the level and the slope of
        the flights before and after, per standard error, shapes (contact, 2, 2), and variances
        specific to each contact, shape (contact, 2): scatter and second-order errors.
        """
        gravity, drag, power, _, contact = self.inputs_of(values)
        c, e, base = self.contacts.falling(gravity, drag), values[0], self.base(values)
        closing, moves = c.departure - c.arrival, self.moves
        height, velocity, pull, jerk, snap = base.motion(c.time)
        shift = moves * velocity
        falls, rises = shift - c.arrival, c.departure - shift  # towards and away from the base
        fall, spare = c.gravity + moves * pull, falls - rises
        about = contact * np.maximum(falls, SLOWEST) ** -power / closing
        since, impact = 0.5 * about * spare, falls - fall * about * rises  # when flights meet
        pushes = fall + moves * jerk * since, moves * (jerk + snap * since), moves * snap
        lasting, slower = self.lasting(values, impact, *pushes)
        lasting /= closing
        later = 0.5 * fall * lasting**2 * spare
        begins, ends = later - lasting * rises, later + lasting * falls  # from where they meet
        left = c.height - values[self.parameters + self.owner] - moves * height
        left += lasting * falls * rises
        left -= 0.5 * fall * lasting**2 * (falls**3 + rises**3) / closing
        kick = moves * jerk * (falls**2 + rises**2) / 6.0 + 0.5 * fall**2 * spare
        left -= lasting**3 * spare * kick
        velocity = base.velocity(c.time + begins)
        arrives = velocity - c.arrival + c.gravity * begins
        after, q = self.law.rebound_speed(arrives, e, values[-1])
        bounce = c.departure - c.gravity * ends - base.velocity(c.time + ends) - after + slower
        turn = (1.0 + q) * (c.gravity + pull) / closing
        when = (c.noise / closing) ** 2  # variance of the contact's time
        when *= line_variance(c.before, c.time) + line_variance(c.after, c.time)
        own = np.stack([0.5 * fall**2 * when**2, 0.5 * (1.0 + q) ** 2 * when**2], axis=1)
        own[:, 1] *= jerk**2
        own[:, 1] += (self.scatter * arrives) ** 2
        own[:, 1] += (
            NEGLECTED * (fall * about * closing) ** 3 / np.maximum(falls, SLOWEST) ** 2
        ) ** 2
        parts = []
        for fits, height, by_height, by_slope in (
            (c.before, rises / closing, -turn, q),
            (c.after, falls / closing, turn, 1.0),
        ):
            own[:, 0] += height**2 * when * c.noise**2 / fits.spread
            of_level, of_slope = c.noise / np.sqrt(fits.number), c.noise / np.sqrt(fits.spread)
            since = c.time - fits.centre
            rows = [
                [height * of_level, height * since * of_slope],
                [by_height * of_level, (by_height * since + by_slope) * of_slope],
            ]
            parts.append(np.moveaxis(np.array(rows), -1, 0))
        return np.stack([left, bounce], axis=1), parts[0], parts[1], own

    def lasting(
        self, values: Array, speed: Array, fall: Array, jerk: Array, snap: Array
    ) -> tuple[Array, Array]:
        """Contact times (s), and by how much the ball is slower after contacts (m s-1).

        The arguments are impact speeds (m s-1), accelerations of the base and gravity together in
        the middle of the contacts (m s-2), and their first and second derivatives (m s-3, m s-4).
        """
        *_, power, share, contact = self.inputs_of(values)
        if abs(contact) < SHORTEST:
            return np.zeros_like(speed), np.zeros_like(speed)
        speed, e = np.maximum(speed, SLOWEST), float(np.clip(values[0], LEAST_E, 1.0))
        unit, decay = contact * speed**-power, -np.log(e)
        fall = fall + CURVED * snap * unit**2
        push, last = np.clip(fall * unit / speed, -MOST_PUSH, MOST_PUSH), np.ones_like(speed)
        for _ in range(NEWTONS + 1):
            fades, sine, cosine = np.exp(-decay * last), np.sin(np.pi * last), np.cos(np.pi * last)
            free = fades * sine / np.pi
            given = (1.0 - fades * cosine - decay * free) / (np.pi**2 + decay**2)
            rate = fades * cosine - decay * free + push * free
            longer = last - 1.0
            with np.errstate(divide="ignore", invalid="ignore"):
                last = np.clip(last - (free + push * given) / rate, 0.5, 2.0)
        slower = (e + rate) * (1.0 + share * (e + HERTZ[0])) + share * HERTZ[6] * push**2
        # a change of G during the contact, alone and together with G
        z, change = complex(-decay, np.pi), jerk * unit**2 / speed
        area = (1.0 + e) / (np.pi**2 + decay**2)
        lever = area / 2.0 - (1.0 / z**2 - e * (1.0 / z - 1.0 / z**2)).imag / np.pi
        alone = (area + 2.0 * decay * lever) * (1.0 + share * (HERTZ[3] * e**2 - HERTZ[4]))
        slower += change * (alone + TOGETHER[0] / np.sqrt(e) * push)
        longer = longer * (1.0 + share * (HERTZ[1] - HERTZ[2] * e))
        alone = lever / e + share * (HERTZ[5] - lever / e)
        longer += change * (alone + TOGETHER[1] / e * push)
        return unit * (1.0 + longer), speed * slower

    def inputs_of(self, values: Array) -> Array:
        """Return the values of the inputs, within limits."""
        return np.asarray(np.clip(values[self.place(values) :][:COUNT], *FARTHEST.T))

    def place(self, values: Array) -> int:
        """Index of the first of the `Inputs` in the values."""
        return values.size - COUNT - self.law.parameters

    def residuals(self, values: Array) -> Array:
        """Residuals in standard errors, ignoring correlations; shape (contact, 2)."""
        left, before, after, own = self.equations(values)
        variance = (before**2).sum(axis=2) + (after**2).sum(axis=2) + own
        return np.asarray(left / np.sqrt(variance))

    def inliers(self, values: Array) -> Flags:
        """Mark the contacts that are not outliers; shape (contact,)."""
        apart = np.abs(self.residuals(values))
        # where all contacts deviate, as for a restitution that depends on speed, none is an outlier
        width = np.maximum(1.4826 * np.median(apart, axis=0), 1.0)
        return np.asarray((apart < OUTLIER * width).all(axis=1))

    def distance(self, values: Array) -> Array:
        """Squared distance of each contact in standard errors, at most `FAR`."""
        return np.asarray(np.minimum((self.residuals(values) ** 2).sum(axis=1), FAR))

    def flat_residuals(self, values: Array) -> Array:
        """Residuals in standard errors, flattened, for values without the inputs at their means."""
        return self.residuals(np.append(values, [one.value for one in self.inputs])).ravel()

    def robust_fit(self, values: Array, scale: Array, bend: float) -> OptimizeResult:
        """Fit all values but the inputs, with a loss that grows slowly beyond `bend`."""
        return least_squares(
            self.flat_residuals,
            values,
            loss="cauchy",
            f_scale=bend,
            x_scale=scale,
            ftol=ACCURATE,
            max_nfev=MOST_STEPS,
        )

    def off_prior(self, values: Array) -> Array:
        """Deviations of the inputs from their prior means, in prior standard deviations."""
        known, error = np.array([(one.value, one.error or EXACT) for one in self.inputs]).T
        return np.asarray((values[self.place(values) :][:COUNT] - known) / error)

    def _factor(self, equations: Sequence[Array], used: Flags) -> tuple[Array, Array]:
        """Residuals of the `used` contacts, and the banded factor of their covariance."""
        left, before, after, own = equations
        chosen = np.flatnonzero(used)
        left, before, after = left[chosen], before[chosen], after[chosen]
        block = before @ before.transpose(0, 2, 1) + after @ after.transpose(0, 2, 1)
        block[:, [0, 1], [0, 1]] += own[chosen]
        linked = self.contacts.linked[chosen[:-1]] & (np.diff(chosen) == 1)
        following = before[1:] @ after[:-1].transpose(0, 2, 1) * linked[:, np.newaxis, np.newaxis]
        band = np.zeros((4, 2 * chosen.size))
        # a small ridge against rounding: the errors of linked flights are almost linearly dependent
        band[0] = (1.0 + RIDGE) * np.stack([block[:, 0, 0], block[:, 1, 1]], axis=1).ravel()
        band[1, 0::2] = block[:, 1, 0]
        band[1, 1:-1:2] = following[:, 0, 1]
        band[2, :-2] = np.stack([following[:, 0, 0], following[:, 1, 1]], axis=1).ravel()
        band[3, 0:-2:2] = following[:, 1, 0]
        return left.ravel(), cholesky_banded(band, lower=True)

    def with_likely_scatter(self, values: Array, used: Flags) -> tuple[Problem, float]:
        """Return the problem with the most likely scatter, and the upper limit on the scatter."""
        *equations, fixed = self._replace(scatter=0.0).equations(values)
        of_scatter = self._replace(scatter=1.0).equations(values)[-1] - fixed

        def deviance(scatter: float) -> float:
            left, factor = self._factor([*equations, fixed + scatter**2 * of_scatter], used)
            white = solve_banded((3, 0), factor, left)
            return float(white @ white + 2.0 * np.log(factor[0]).sum())

        tried = np.array([deviance(scatter) for scatter in SCATTERS])
        k = int(tried.argmin())
        ends = SCATTERS[max(k - 1, 0)], SCATTERS[min(k + 1, tried.size - 1)]
        found = minimize_scalar(deviance, bounds=ends, method="bounded", options={"xatol": 1e-6})
        best, least = (found.x, found.fun) if found.fun < tried[k] else (SCATTERS[k], tried[k])
        beyond = SCATTERS[(tried > least + ONE_SIDED) & (best < SCATTERS)]
        limit = beyond[0] if beyond.size else SCATTERS[-1]
        if beyond.size:
            limit = brentq(lambda s: deviance(s) - least - ONE_SIDED, best, limit)
        return self._replace(scatter=float(best)), float(limit)

    def whitened(self, values: Array, used: Flags, *, slopes: bool = False) -> Array:
        """Residuals whitened to unit covariance; with `slopes`, their derivatives by the levels.

        Residuals of the priors of the inputs, and of the trace, follow.
        """
        left, factor = self._factor(self.equations(values), used)
        place = self.place(values)
        levels = place - self.parameters
        right = np.zeros((left.size, levels)) if slopes else left
        if slopes:
            chosen = np.flatnonzero(used)
            right[2 * np.arange(chosen.size), self.owner[chosen]] = -1.0
        parts = [solve_banded((3, 0), factor, right)]
        parts.append(np.zeros((COUNT, levels)) if slopes else self.off_prior(values))
        if self.trace is not None:
            root = np.linalg.inv(np.linalg.cholesky(self.trace.covariance))
            motion = values[1 : self.parameters]
            off = root @ (motion - self.trace.filmed(self.inputs_of(values)[0]))
            parts.append(np.zeros((off.size, levels)) if slopes else off)
        return np.concatenate(parts)

    def derivatives(self, values: Array, used: Flags) -> Array:
        """Derivatives of `whitened` by all parameters."""
        more, place = self.parameters - len(STEPS), self.place(values)
        steps = dict(enumerate((STEPS + STEPS[1:2] * more)[: self.parameters]))
        free = [one.error > 0.0 for one in self.inputs]
        steps |= {k: step for k, step in enumerate(STEPS_OF_INPUTS, place) if free[k - place]}
        steps |= {values.size - 1: STEP} if self.law.parameters else {}
        levels, exact = self.whitened(values, used, slopes=True), np.flatnonzero(np.invert(free))
        table = np.zeros((len(levels), values.size))
        table[:, self.parameters : place] = levels
        table[2 * np.count_nonzero(used) + exact, place + exact] = 1.0 / EXACT
        here = self.whitened(values, used)
        for k, step in steps.items():
            beside = self.whitened(values + step * (np.arange(values.size) == k), used)
            table[:, k] = (beside - here) / step
        return table


def fit_base(
    contacts: Contacts,
    frequency: float,
    *,
    free: bool,
    moves: bool,
    trace: Trace | None = None,
    inputs: Inputs | None = None,
    start: tuple[Array, Array] | None = None,
) -> BaseFit:
    """Fit the motion of a base to contacts.

    The frequency (Hz) is a parameter if `free` or if there is a `trace`, a measured motion of the
    base; `inputs` are by default instantaneous impacts in vacuum.  Without `moves` the base has a
    constant level and kicks.  The fit can `start` from values of the parameters, and the level
    below each particle of the recording.  Raises a TrackError if there are fewer equations than
    parameters.
    """
    free = free or trace is not None
    inputs = inputs or Inputs(Input(contacts.gravity))
    problem, particles = _problem(contacts, None if free else frequency, moves, trace, inputs)
    traced, count = 0 if trace is None else trace.values.size, problem.parameters
    if 2 * contacts.time.size + traced < count + particles.size or not contacts.time.size:
        raise TrackError(UNDETERMINED)
    values, scale = _start(problem, frequency, particles.size)
    if start is not None:
        values[:-COUNT] = np.append(start[0], start[1][particles])
    for width in BENDS if start is None else ():
        values[:-COUNT] = problem.robust_fit(values[:-COUNT], scale[:-COUNT], width).x
    problem, found, used, limit = without_outliers(problem, values, scale, problem.inliers(values))
    values = found.x
    covariance, misfit, freedom = covariance_of_fit(found)
    return BaseFit(
        values,
        covariance,
        problem,
        problem.base(values),
        particles,
        values[count:-COUNT],
        used,
        misfit,
        freedom,
        problem.distance(values),
        limit,
    )


def _problem(
    contacts: Contacts, known: float | None, moves: bool, trace: Trace | None, inputs: Inputs
) -> tuple[Problem, NDArray[np.intp]]:
    """Return the problem with a known or free frequency, and the particles that have contacts."""
    particles, owner = np.unique(contacts.particle, return_inverse=True)
    return Problem(contacts, owner, known, float(moves), trace, inputs), particles


def without_outliers(
    problem: Problem, values: Array, scale: Array, chosen: Flags
) -> tuple[Problem, OptimizeResult, Flags, float]:
    """Fit the `chosen` contacts, then fit again without outliers.

    Returns the problem with its scatter, the last fit, flags of the contacts that it used, and the
    upper limit on the scatter.  The first fit starts at `values`, whose scale is `scale`.
    """
    for _ in range(ROUNDS):
        problem, limit = problem.with_likely_scatter(values, chosen)
        with np.errstate(over="ignore"):  # in trial steps
            found = least_squares(
                problem.whitened,
                values,
                problem.derivatives,
                x_scale=scale,
                ftol=ACCURATE,
                args=(chosen,),
                max_nfev=MOST_STEPS,
            )
        used, values, chosen = chosen, found.x, problem.inliers(found.x)
    return problem, found, used, limit


def covariance_of_fit(found: OptimizeResult) -> tuple[Array, float, int]:
    """Covariance of the parameters, reduced chi-square, and degrees of freedom."""
    freedom = found.fun.size - found.x.size
    misfit = float(2.0 * found.cost / max(freedom, 1))
    # scaled, because a noise-free trace determines some parameters far better than others
    slopes = np.asarray(found.jac)
    size = np.linalg.norm(slopes, axis=0)
    size[size == 0.0] = 1.0  # a level whose contacts are all outliers
    slopes = slopes / size
    inverse = np.linalg.pinv(slopes.T @ slopes, hermitian=True)
    scale, influences = np.outer(size, size), robust_covariance(found.fun, slopes, inverse)
    return widen(inverse / scale, misfit, freedom, influences / scale), misfit, freedom


def _start(problem: Problem, frequency: float, levels: int) -> tuple[Array, Array]:
    """Initial values of the parameters, including the frequency (Hz) if free, and their scales."""
    contacts, trace, count = problem.contacts, problem.trace, problem.parameters
    e, sine, cosine = ordinary_least_squares(contacts.speeds, frequency)  # v' = -e v + (1 + e) V
    start = [e, sine / (1.0 + e), cosine / (1.0 + e), frequency][:count]
    if trace is not None and count > len(start):
        start = [_restitution(contacts, Oscillation(trace.values, trace.numbers)), *trace.values]
    medians = [np.median(contacts.height[problem.owner == p]) for p in range(levels)]
    of_inputs = [0.01, 1e-3, 0.1, 0.1, 1e-4]
    scale = np.concatenate([np.full(count, 0.1), np.full(levels, 1e-4), of_inputs])
    if problem.frequency is None:
        scale[3] = 1e-3
    return np.array([*start, *medians, *(one.value for one in problem.inputs)]), scale


def _restitution(contacts: Contacts, base: Oscillation) -> float:
    """Restitution by ordinary least squares of v' - V = -e (v - V)."""
    velocity = base.velocity(contacts.time)
    arrival = contacts.arrival - velocity
    return float(-(contacts.departure - velocity) @ arrival / (arrival @ arrival))


# -----------------------------------------------------------------------------
# Decide from the contacts of a recording whether the base moves or has a constant level.

FREQUENCIES: Final = (1.0, 100.0)
# Largest number of contacts used; more hardly change the decision.
MOST: Final = 1000
# Smallest signal-to-noise ratio for which a base is fitted; noise alone gives at most 1.
LEAST_SIGNAL: Final = 3.0
# Ratio to the smallest chi-square of rough fits from which a frequency is out of the question;
# wrong frequencies have ten times and more
WORSE: Final = 4.0


def which_base(
    contacts: Contacts, frequency: float | None, inputs: Sequence[Inputs], known: bool = False
) -> tuple[str, BaseFit | None]:
    """Fit a moving base and one at a constant level to contacts, and compare them.

    Returns ``"moving"``, ``"level"`` or ``"undetermined"``, and the fit of a moving base; None for
    contacts that do not determine the motion, such as those of a locked orbit, all at one phase.
    The frequency (Hz) is estimated if it is None; `inputs` are as in `likeliest`.
    If the base is `known` to move, that at a constant level is not tried.
    """
    few = contacts.earliest(MOST)
    if _too_few(few):
        return "undetermined", None
    free = frequency is None
    rates = frequencies_to_try(few.speeds, frequency, FREQUENCIES)
    rates = [rate for rate in rates if _signal(few, rate) >= LEAST_SIGNAL]
    if not rates:
        return "undetermined", None

    def best(moves: bool, inputs: Inputs) -> BaseFit:
        worth = _worth_a_fit(few, rates, free, moves, inputs)
        fits = [fit_base(few, rate, free=free, moves=moves, inputs=inputs) for rate in worth]
        return min(_with_scatter(*fits), key=_distance)

    moving = likeliest(inputs, lambda one: best(True, one.firm))
    if known:
        return "moving", moving
    return _preferred(*_with_scatter(moving, best(False, inputs[0].firm.instant))), moving


def likeliest(inputs: Sequence[Inputs], fit: Callable[[Inputs], BaseFit]) -> BaseFit:
    """Return the fit with the first of the `inputs`, or another that is significantly better.

    By default contacts that last come second, because bounces too low to be seen look like them.
    """
    best, *others = map(fit, inputs)
    for other in others:
        better, worse = _with_scatter(other, best)
        if not _is_wrong(other) and (
            _is_wrong(best) or fits_better(better.distance, worse.distance)
        ):
            best = other
    return best


def _worth_a_fit(
    contacts: Contacts, rates: list[float], free: bool, moves: bool, inputs: Inputs
) -> list[float]:
    """Return the frequencies (Hz) whose rough fits are not far worse than the best."""
    costs = []
    for rate in rates:
        problem, particles = _problem(contacts, None if free else rate, moves, None, inputs)
        values, scale = (one[:-COUNT] for one in _start(problem, rate, particles.size))
        costs.append(problem.robust_fit(values, scale, BENDS[0]).cost)
    return [rate for rate, cost in zip(rates, costs, strict=True) if cost <= WORSE * min(costs)]


def moves(moving: BaseFit) -> bool:
    """Return whether a moving base fits its contacts better than one at a constant level."""
    contacts, free = moving.problem.contacts, moving.problem.frequency is None
    if _too_few(contacts):
        return False
    rate = moving.oscillation.frequency
    level = fit_base(contacts, rate, free=free, moves=False, inputs=moving.problem.inputs.instant)
    return _preferred(*_with_scatter(moving, level)) == "moving"


def _with_scatter(*fits: BaseFit) -> list[BaseFit]:
    """Return fits with distances of their contacts for the same scatter, the smallest.

    A large scatter would hide the residuals of a worse fit.
    """
    scatter = min(fit.problem.scatter for fit in fits)
    return [
        fit._replace(distance=fit.problem._replace(scatter=scatter).distance(fit.values))
        for fit in fits
    ]


def _too_few(contacts: Contacts) -> bool:
    return bool(contacts.time.size < FEWEST + np.unique(contacts.particle).size)


def _preferred(moving: BaseFit, level: BaseFit) -> str:
    """Return the base that fits the same contacts significantly better, by Vuong's test.

    Both models have the same number of parameters, and they are not nested.  A base that
    implies an unphysical restitution is never preferred.
    """
    for favoured, better, worse in (("moving", moving, level), ("level", level, moving)):
        if fits_better(better.distance, worse.distance):
            return "undetermined" if _is_wrong(better) else favoured
    return "undetermined"


def _is_wrong(fit: BaseFit) -> bool:
    return is_unphysical(fit.values, fit.covariance)


def _distance(fit: BaseFit) -> tuple[bool, float]:
    return _is_wrong(fit), float(fit.distance.sum())


def _signal(contacts: Contacts, frequency: float) -> float:
    """Compute the `weakest_signal` of contacts, whose speeds are slopes of parabolas."""
    time, before, speeds = contacts.time, contacts.before, contacts.speeds
    closing = contacts.departure - contacts.arrival
    when = line_variance(before, time) + line_variance(contacts.after, time)
    speed_variance, time_variance = contacts.noise**2 * np.stack(
        [1.0 / before.spread, when / closing**2]
    )
    kick = ordinary_least_squares(speeds, frequency)[1:]
    return weakest_signal(speeds, frequency, kick, speed_variance, time_variance)
