"""Paths of balls in air whose contacts may last, computed impact by impact."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from vibrosweep.arrays import Array
from vibrosweep.kernels.record import Record
from vibrosweep.lab.experiment import CONTACTS, Surface

# -----------------------------------------------------------------------------
# A contact: the ball presses a spring with a damper, which the surface and gravity push as well.

# Exponent of the impact speed in the contact time of each law of force
EXPONENT: Final = dict(zip(CONTACTS, (0.0, -0.2), strict=True))
ELASTIC: Final = 1e-6  # 1 - e below which the damping of a Hertz contact follows from its limit
LEAST_RESTITUTION: Final = 0.01
SPARE: Final = 50.0  # longest time of integration, in contact times
Force = Callable[[float, float], float]
Push = Callable[[float], float]


def compress(e: float, contact: str, push: Push = lambda _: 0.0, longest: float = SPARE) -> Any:
    """Integrate a contact of unit impact speed that lasts a unit of time where nothing pushes.

    Without a push (acceleration of the ball towards the surface) the ball leaves with the speed e.
    The forces are those of a linear spring and a dashpot, or x^1.5 (1 + p x') (Hunt and Crossley
    1975, J. Appl. Mech. 42, 440).  Returns the result of `solve_ivp` for depth and its rate; its
    status is 1 if the ball left.
    """
    if contact == CONTACTS[0]:
        decay = -np.log(e)
        stiffness = np.pi**2 + decay**2
        return _integrate(lambda x, rate: 2.0 * decay * rate + stiffness * x, push, longest)
    hertz, stiffness = _hertz(e), float(_stiffness()(e))
    return _integrate(lambda x, rate: stiffness * hertz(x, rate), push, longest)


def _hertz(e: float) -> Force:
    """Return a Hertz contact whose damping p gives the restitution e, in closed form."""
    p = 1.5 * (1.0 - e)
    if p > 1.5 * ELASTIC:

        def excess(u: float) -> float:
            p = -np.expm1(u) / e
            return float(p * (1.0 + e) - np.log1p(p) + u)

        p = -np.expm1(brentq(excess, -3.0 / e, -0.1 * e * p)) / e
    return lambda x, rate: float(max(x, 0.0) ** 1.5 * (1.0 + p * rate))


@cache
def _stiffness() -> CubicSpline:
    """Stiffness of Hertz contacts that last a unit of time, as a function of e."""
    e = np.geomspace(LEAST_RESTITUTION, 1.0, 60)
    lasts = [_integrate(_hertz(float(one)), lambda _: 0.0, SPARE).t[-1] for one in e]
    return CubicSpline(e, np.array(lasts) ** 2.5)


def _integrate(force: Force, push: Push, longest: float) -> Any:
    def depth(_: float, x: Array) -> float:
        return float(x[0])

    depth.terminal, depth.direction = True, -1.0  # type: ignore[attr-defined]
    return solve_ivp(
        lambda s, x: [x[1], push(s) - force(x[0], x[1])],
        (0.0, longest),
        [0.0, 1.0],
        method="DOP853",
        events=depth,
        dense_output=True,
        rtol=1e-8,
        atol=1e-11,
    )


# -----------------------------------------------------------------------------
# A path: flights through air, and contacts between them.

SHORTEST: Final = 1e-5  # s, resolution of the search for the end of a flight
GROWTH: Final = 1.1  # ratio of its first steps
AHEAD: Final = 400  # number of equal steps that are searched at once
STAY: Final = 3.0  # a longer contact, in contact times, counts as a stay on the base
PARTS: Final = 32  # of an exposure


class LastingContact(NamedTuple):
    """A contact that lasts."""

    begin: float  # s
    speed: float  # of the impact, m s-1
    unit: float  # of time, s
    solution: Callable[[Array], Array]  # of `compress`


class Ball(NamedTuple):
    """A ball, its contacts, and the air."""

    restitution: Callable[[float], float]  # draws that of an impact at a given speed
    gravity: float
    drag: float  # 1 / (terminal speed)^2, s2 m-2
    contact: str  # law of force, one of `CONTACTS`
    contact_time: float  # at 1 m/s, s; 0: an impact is instantaneous
    # After an instantaneous impact, the ball stays if its flight would be shorter, s
    rest_flight: float

    def unit(self, speed: float) -> float:
        """Contact time (s) of an impact at a given speed."""
        return float(self.contact_time * speed ** EXPONENT[self.contact])

    def fallen(self, since: Array | float) -> Array:
        """Distance (m) below the apex at times (s) relative to it."""
        if self.drag == 0.0:
            return np.asarray(0.5 * self.gravity * np.square(since))
        x = self.drag**0.5 * self.gravity * np.asarray(since)
        rising, falling = -(np.sin(np.minimum(x, 0.0)) ** 2), np.sinh(np.maximum(x, 0.0)) ** 2
        return np.asarray((np.log1p(falling) - np.log1p(rising)) / (2.0 * self.gravity * self.drag))

    def velocity(self, since: float) -> float:
        """Velocity (m s-1) at a time (s) relative to the apex."""
        root = self.drag**0.5
        if root == 0.0:
            return -self.gravity * since
        turned = root * self.gravity * since
        return float(-(np.tan(turned) if since < 0.0 else np.tanh(turned)) / root)

    def until_apex(self, velocity: float) -> float:
        """Time (s) from a velocity (m s-1) to the apex; negative when falling."""
        root = self.drag**0.5
        if root == 0.0:
            return velocity / self.gravity
        turned = root * velocity
        return float((np.arctan(turned) if velocity > 0.0 else np.arctanh(turned)) / root) / (
            self.gravity
        )


class Path(NamedTuple):
    """Flights of one ball in chronological order; between them it is on the surface."""

    ball: Ball
    surface: Surface
    # start, end: times of lift-off and of landing, s; the end is infinite if the path ends earlier
    start: Array
    end: Array
    # apex, top: time (s) and height (m) of the apex, before or after the flight if it has none
    apex: Array
    top: Array
    contacts: Sequence[LastingContact] = ()

    def height(self, time: Array) -> Array:
        """Height in m at times in s."""
        k = np.maximum(np.searchsorted(self.start, time, side="right") - 1, 0)
        down = (time < self.start[k]) | (time > self.end[k])
        since = np.where(down, 0.0, time - self.apex[k])
        height = np.where(down, self.surface.height(time), self.top[k] - self.ball.fallen(since))
        ends = np.append(self.start, np.inf)[1:]
        for contact, stop in zip(self.contacts, ends, strict=False):
            inside = (time > contact.begin) & (time < stop)
            if inside.any():
                depth = contact.solution((time[inside] - contact.begin) / contact.unit)[0]
                height[inside] -= contact.speed * contact.unit * depth
        return np.asarray(height)

    def mean_height(self, time: Array, exposure: float) -> Array:
        """Mean height in m over an exposure (s) centred at each time."""
        parts = exposure * ((np.arange(PARTS) + 0.5) / PARTS - 0.5)
        every = self.height((time[:, np.newaxis] + parts).ravel())
        return np.asarray(every.reshape(-1, PARTS).mean(axis=1))


def path_of(
    ball: Ball, surface: Surface, start: float, velocity: float, end: float, step: float
) -> tuple[Path, Record]:
    """Compute a path from its launch to its `end` (s), and its landings, of shape (1, impact).

    `step` (s) is a small part of the period of the surface.
    """
    flights: list[tuple[float, float, float, float]] = []
    contacts: list[LastingContact] = []
    landings: list[tuple[float, float, float, bool]] = []
    time, leaves = start, velocity
    while time < end:
        up = ball.until_apex(leaves)
        top = float(surface.height(np.asarray(time)) + ball.fallen(-up))
        lands = _landing(ball, surface, time, up, top, end, step)
        flights.append((time, lands, time + up, top))
        if lands > end:
            break
        speed = float(surface.velocity(np.asarray(lands))) - ball.velocity(lands - time - up)
        speed = max(speed, 1e-9)
        e = ball.restitution(speed)
        if ball.contact_time:
            time, leaves, stays = _press(ball, surface, lands, speed, e, end, contacts)
        else:
            after = e * speed
            falls = surface.acceleration(np.asarray(lands)) < -ball.gravity
            stays = bool(2.0 * after <= ball.rest_flight * ball.gravity and not falls)
            time = _lifted(ball, surface, lands, end, step) if stays else lands
            leaves = float(surface.velocity(np.asarray(min(time, end)))) + after * (not stays)
        gone = time < end
        landings.append((lands, time if gone else np.nan, leaves if gone else np.nan, stays))
    columns = np.array(landings, np.float64).reshape(-1, 4).T[:, np.newaxis]
    record = Record(columns[0], columns[1], columns[2], columns[3] == 1.0)
    begins, ends, apex, tops = np.array(flights).T
    return Path(ball, surface, begins, ends, apex, tops, contacts), record


def _landing(
    ball: Ball, surface: Surface, time: float, up: float, top: float, end: float, step: float
) -> float:
    """Return the end (s) of a flight that begins at a time; infinite if it is after `end`."""

    def gap(since: Any) -> Any:
        return top - ball.fallen(since - up) - surface.height(time + since)

    first = np.geomspace(SHORTEST, step, int(np.log(step / SHORTEST) / np.log(GROWTH)) + 2)
    before, tried = 0.0, np.append(first, step * np.arange(2, AHEAD))
    while time + before <= end:
        below = np.flatnonzero(gap(tried) < 0.0)
        if below.size:
            k = int(below[0])
            low = tried[k - 1] if k else before
            if low == 0.0:  # shorter than the resolution
                return time + SHORTEST
            return time + float(brentq(gap, low, tried[k], xtol=1e-15))
        before = float(tried[-1])
        tried = before + step * np.arange(1, AHEAD)
    return np.inf


def _press(
    ball: Ball,
    surface: Surface,
    begin: float,
    speed: float,
    e: float,
    end: float,
    contacts: list[LastingContact],
) -> tuple[float, float, bool]:
    """Append a contact; return its end (s), the velocity (m s-1), and whether the ball stayed."""
    unit = ball.unit(speed)

    def push(since: float) -> float:
        down = ball.gravity + float(surface.acceleration(np.asarray(begin + unit * since)))
        return down * unit / speed

    run = compress(e, ball.contact, push, (end - begin) / unit + SPARE)
    contacts.append(LastingContact(begin, speed, unit, run.sol))
    time = begin + unit * float(run.t[-1]) if run.status == 1 else np.inf
    leaves = float(surface.velocity(np.asarray(min(time, end)))) - speed * float(run.y[1, -1])
    return time, leaves, bool(run.t[-1] > STAY)


def _lifted(ball: Ball, surface: Surface, time: float, end: float, step: float) -> float:
    """Return when a surface leaves a ball at rest: it falls faster than the ball would."""

    def press(t: Any) -> Any:
        return surface.acceleration(t) + ball.gravity

    tried = time + step * np.arange(int((end - time) / step) + 2)
    free = np.flatnonzero(press(tried) < 0.0)
    if not free.size:
        return np.inf
    return float(brentq(press, tried[free[0] - 1], tried[free[0]], xtol=1e-15))
