"""The study's own scheme: fixed-step RK4, with contact seen at the first step below the base.

The study does not say how a landing is found.  In the plain reading contact is tested only at
steps, so that a landing is late by up to one step and its speed too large by up to g times a step.
That error enters every impact: the scheme is of first order in the step, although RK4 itself is
exact on a parabola.

On contact the position is set to 0 and w = e |v| + A sin(2 pi f t + phi), its absolute value under
the `reflect` law.  With w <= v_rest = g tau_c / 2 the particle stays on the base until the first
step at which the kick A sin(2 pi f t + phi) alone exceeds v_rest, and leaves with it.  As the step
goes to zero this becomes the `rest` law, where the lift-off is at the crossing itself.  This needs
steps well below tau_c, and below v_rest / (2 pi f A).  With larger steps the late contact adds up
to g times a step to the speed at each impact, and a particle that should rest may bounce for ever.

In the other reading, `contact="interpolated"`, the landing is where the parabola through the step
meets the base, and the lift-off is where the kick passes v_rest in the step, as with event
location: a new step begins there, and only rounding errors remain.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from study.arrays import Array
from vibrosweep import PARAMETERS
from vibrosweep.errors import ParameterError

# Laws of rebound that the scheme knows, as the kernel takes them
REFLECT: Final = {"rest": None, "reflect": True}
# Ways to find a landing, as the kernel takes them
CONTACT: Final = {"next step": None, "interpolated": True}
HALVINGS: Final = 60  # of a step, to find a lift-off to the last bit
# Time is a count of steps times the step; beyond this the count is no longer an exact double.
MAX_STEPS = 2.0**53
# Division by zero gives infinity, as in numpy; threads run at once
compiled = njit(cache=True, error_model="numpy", nogil=True)


class Landings(NamedTuple):
    """Landings seen by the fixed-step scheme."""

    landing_time: Array  # shape (trajectory, capacity), s; NaN past the last landing
    # Shape (trajectory,); all landings up to the end, even those past the capacity
    impact_count: NDArray[np.int64]


@compiled
def _acceleration(y: float, v: float, gravity: float) -> float:
    """Right-hand side of v' = -g, in the general form that RK4 takes: a function of the state."""
    return -gravity


@compiled
def _rk4_step(y: float, v: float, gravity: float, h: float) -> tuple[float, float]:
    """One classical Runge-Kutta step of y' = v, v' = -g."""
    half = 0.5 * h
    v1 = v
    a1 = _acceleration(y, v1, gravity)
    v2 = v + half * a1
    a2 = _acceleration(y + half * v1, v2, gravity)
    v3 = v + half * a2
    a3 = _acceleration(y + half * v2, v3, gravity)
    v4 = v + h * a3
    a4 = _acceleration(y + h * v3, v4, gravity)
    sixth = h / 6.0
    return (
        y + sixth * (v1 + 2.0 * (v2 + v3) + v4),
        v + sixth * (a1 + 2.0 * (a2 + a3) + a4),
    )


@compiled
def _integrate(
    p: Array, duration: float, h: float, reflect: bool | None, landing_time: Array
) -> int:
    """Integrate one particle; fill its row of landing times and return how many there were."""
    e, amplitude, omega, phase = p[0], p[1], 2.0 * math.pi * p[2], p[3]
    gravity, y, v, rest, launch = p[4], 0.0, p[5], 0.5 * p[4] * p[6], p[7]
    found, steps, resting = 0, 0, False
    while True:
        steps += 1
        t = launch + steps * h
        if t > duration:
            return found
        if resting:
            v = amplitude * math.sin(omega * t + phase)
            resting = v <= rest
            continue
        y, v = _rk4_step(y, v, gravity, h)
        if y <= 0.0:
            if found < landing_time.size:
                landing_time[found] = t
            found += 1
            y = 0.0
            v = e * abs(v) + amplitude * math.sin(omega * t + phase)
            if reflect is not None:
                v = abs(v)
            resting = v <= rest


@compiled
def _rise(p: Array, begin: float, h: float) -> float:
    """Time in [begin, begin + h] at which the kick has risen through v_rest."""
    low, high = begin, begin + h
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if p[1] * math.sin(2.0 * math.pi * p[2] * middle + p[3]) <= 0.5 * p[4] * p[6]:
            low = middle
        else:
            high = middle
    return high


@compiled
def _interpolate(
    p: Array, duration: float, h: float, reflect: bool | None, landing_time: Array
) -> int:
    """Like `_integrate`, with landings and lift-offs located in the step."""
    e, amplitude, omega, phase = p[0], p[1], 2.0 * math.pi * p[2], p[3]
    gravity, y, v, rest, origin = p[4], 0.0, p[5], 0.5 * p[4] * p[6], p[7]
    found, steps, resting = 0, 0, False
    while True:
        begin = origin + steps * h
        if begin > duration:
            return found
        steps += 1
        if resting:
            if amplitude * math.sin(omega * (begin + h) + phase) > rest:
                origin, steps, v, resting = _rise(p, begin, h), 0, rest, False
            continue
        before, speed = y, v
        y, v = _rk4_step(y, v, gravity, h)
        if y <= 0.0:
            since = (speed + math.sqrt(speed * speed + 2.0 * gravity * before)) / gravity
            origin, steps = begin + since, 0
            if origin > duration:
                return found
            if found < landing_time.size:
                landing_time[found] = origin
            found += 1
            y, v = (
                0.0,
                e * abs(speed - gravity * since) + amplitude * math.sin(omega * origin + phase),
            )
            if reflect is not None:
                v = abs(v)
            resting = v <= rest


@compiled
def rk4_range(
    parameters: Array,
    duration: float,
    h: float,
    reflect: bool | None,
    located: bool | None,
    out: Landings,
    start: int,
    stop: int,
) -> None:
    """Integrate the trajectories `start` to `stop` - 1 into their own rows of `out`.

    It releases the GIL, so threads may share one batch by disjoint ranges.  Parameters have the
    shape (trajectory, 8): the seven of `vibrosweep.PARAMETERS` in their order, then the launch
    time; `duration` and step `h` in s.  `reflect` is None for the `rest` law, and `located` None if
    a landing is seen at the next step: both are chosen at compile time.  `out` is filled with NaN
    beforehand.
    """
    for i in range(start, stop):
        row = out.landing_time[i]
        if located is None:
            out.impact_count[i] = _integrate(parameters[i], duration, h, reflect, row)
        else:
            out.impact_count[i] = _interpolate(parameters[i], duration, h, reflect, row)


def rk4(
    *,
    restitution: ArrayLike,
    amplitude: ArrayLike,
    frequency: ArrayLike,
    phase: ArrayLike,
    gravity: ArrayLike,
    launch_velocity: ArrayLike,
    contact_time: ArrayLike,
    launch_time: ArrayLike,
    duration: float,
    step: float,
    rebound: str = "rest",
    contact: str = "next step",
    capacity: int = 1000,
    threads: int = 1,
) -> Landings:
    """Landing times by the study's fixed-step scheme.

    Physical parameters are scalars or arrays of shape (trajectory,), which broadcast; `duration`
    and `step` in s.  A `contact` is seen at the ``"next step"``, or is ``"interpolated"`` within
    the step.  Of each trajectory `capacity` landings are stored; the result does not depend on the
    threads that share the trajectories.  Raises a ParameterError that names an argument outside its
    range.
    """
    values = {
        "restitution": restitution,
        "amplitude": amplitude,
        "frequency": frequency,
        "phase": phase,
        "gravity": gravity,
        "launch_velocity": launch_velocity,
        "contact_time": contact_time,
        "launch_time": launch_time,
    }
    parameters = _table(values)
    _check(parameters, duration, step, threads)
    _check_choices({"rebound": (rebound, REFLECT), "contact": (contact, CONTACT)}, capacity)
    n = len(parameters)
    out = Landings(np.full((n, capacity), np.nan), np.zeros(n, np.int64))
    laws = REFLECT[rebound], CONTACT[contact]
    edges = np.linspace(0, n, threads + 1).astype(int)

    def work(start: int, stop: int) -> None:
        rk4_range(parameters, float(duration), float(step), *laws, out, start, stop)

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, edges[:-1], edges[1:]))
    return out


def _table(values: dict[str, ArrayLike]) -> Array:
    """One row per trajectory, one column per parameter."""
    arrays = [np.atleast_1d(np.asarray(value, dtype=np.float64)) for value in values.values()]
    for name, array in zip(values, arrays, strict=True):
        if name in PARAMETERS and not np.all(PARAMETERS[name].accepts(array)):
            raise ParameterError(f"{name}: must be {PARAMETERS[name].allowed}")
        if array.ndim > 1 or not np.all(np.isfinite(array)):
            raise ParameterError(f"{name}: must be a finite number or a 1-D array of such")
    return np.stack(np.broadcast_arrays(*arrays), axis=-1)


def _check(parameters: Array, duration: float, step: float, threads: int) -> None:
    if not math.isfinite(duration):
        raise ParameterError(f"duration = {duration!r}: must be any finite number (s)")
    if not (step > 0.0 and math.isfinite(step)):
        raise ParameterError(f"step = {step!r}: must be finite and greater than 0 s")
    if threads < 1:
        raise ParameterError(f"threads = {threads!r}: must be at least 1")
    if parameters.size and (duration - np.min(parameters[:, 7])) / step > MAX_STEPS:
        raise ParameterError(f"step = {step!r}: more than 2**53 steps; use a larger one")


def _check_choices(given: Mapping[str, tuple[str, Mapping[str, object]]], capacity: int) -> None:
    for name, (value, choices) in given.items():
        if value not in choices:
            raise ParameterError(f"{name} = {value!r}: must be one of {', '.join(choices)}")
    if capacity < 1:
        raise ParameterError(f"capacity = {capacity!r}: must be at least 1")
