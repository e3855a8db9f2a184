"""The moving base as a scalar loop: the kernel's search for a landing, with the library's sine.

It follows one trajectory after the other and one flight after the other, with branches, so that
nothing is computed that a flight does not need.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

TWO_PI = 2.0 * math.pi
SLOW = 0.15  # periods; the first try for a particle that is neither chattering nor fast
LAST = 2.0**-12  # ratio of terms of a step's series below which the step ends the search
SHORT = 0.25  # ratio below which the series is better than Newton's step
BORDER = 2.0**-30  # turns before its end at which a stretch counts as ended
ULP = 2.0**-52
NOISE = 2.0**-50  # of the clearance, relative to its terms
TRIES = 20_000


@njit(nogil=True, error_model="numpy")
def _stretch(x, x_lift):
    """Return whether the base presses at phase x, and the periods until that changes."""
    x -= np.rint(x)
    presses = not abs(x) > x_lift
    to_fall = x_lift - x
    to_press = (1.0 if x > 0.0 else 0.0) - x_lift - x
    if presses and to_fall <= BORDER:
        return False, 1.0 - 2.0 * x_lift + to_fall
    if not presses and to_press <= BORDER:
        return True, 2.0 * x_lift + to_press
    return presses, to_fall if presses else to_press


@njit(nogil=True, error_model="numpy")
def _first_try(gamma, x_lift, x, y, u, cosine, fast):
    if fast:
        return u
    pull = 1.0 + gamma * cosine
    parabola = y / pull if pull > 0.0 else np.inf
    if gamma <= 1.0:
        return min(parabola, max(u, SLOW))
    if abs(x) >= x_lift:
        return (1.0 if x > 0.0 else 0.0) - x_lift - x
    return min(parabola, x_lift - x)


@njit(nogil=True, error_model="numpy")
def _next(alpha, x_lift, at, f, slope, step, newton, series, good):
    """Step within the stretch of time that the phase `at` lies in, where the clearance is f > 0."""
    f1, f2 = slope
    presses, rest = _stretch(at, x_lift)
    if presses:
        return min(step, rest) if f1 < 0.0 else rest
    across = newton
    if good:
        beyond = 1.01 * max(series, newton)
        if f1 + beyond * (max(f2, 0.0) + math.pi * math.pi * alpha * beyond) < 0.0:
            across = series
    return across if f1 < 0.0 and across < rest else rest


@njit(nogil=True, error_model="numpy")
def moving_flight(alpha, x_lift, x, y, count):
    """Duration of a flight from phase x with relative speed y, landing speed, passes so far."""
    if y < 0.0 or (y == 0.0 and not abs(x) >= x_lift):
        return 0.0, -y, count
    gamma = math.pi * alpha
    sine, cosine = math.sin(TWO_PI * x), math.cos(TWO_PI * x)
    u = y + alpha * sine
    w = math.pi * u
    fast = u > 0.0 and w * w >= gamma * (gamma + 2.0 * (1.0 + cosine))
    sure = fast or gamma <= 1.0
    s = _first_try(gamma, x_lift, x, y, u, cosine, fast)
    highest = alpha / (4.0 * math.pi)
    for _ in range(TRIES):
        count += 1
        half, whole = math.sin(math.pi * s), math.cos(math.pi * s)
        turned, versine = 2.0 * half * whole, 2.0 * half * half
        q = TWO_PI * s
        lag = q - turned
        if q < 0.5:
            z = q * q
            lag = q * z / 6.0 * (1.0 - z / 20.0 * (1.0 - z / 42.0 * (1.0 - z / 72.0 * (
                1.0 - z / 110.0 * (1.0 - z / 156.0)))))  # fmt: skip
        slowed = sine * versine - cosine * turned
        now = cosine - (cosine * versine + sine * turned)
        f = 0.5 * s * (y - s) + highest * (sine * lag - cosine * versine)
        f1 = 0.5 * y - s + 0.5 * alpha * slowed
        f2 = -1.0 - gamma * now
        f3 = TWO_PI * gamma * (sine - slowed)
        f4 = TWO_PI * TWO_PI * gamma * now
        inverse = 1.0 / f1
        newton = -f * inverse
        r = newton * inverse
        a, b, c = 0.5 * f2 * r, f3 * r * newton / 6.0, f4 * r * newton * newton / 24.0
        series = newton * (1.0 - a + (2.0 * a * a - b) - (5.0 * a * (a * a - b) + c))
        if f1 < 0.0 and (
            abs(newton) <= ULP * s
            or (abs(a) <= LAST and abs(b) <= LAST * LAST and abs(c) <= LAST * LAST * LAST)
        ):
            f5, f6 = -TWO_PI * TWO_PI * f3, -TWO_PI * TWO_PI * f4
            speed = f4 / 6.0 + series * (f5 / 24.0 + series * f6 / 120.0)
            speed = f1 + series * (f2 + series * (0.5 * f3 + series * speed))
            return s + series, -2.0 * speed, count
        good = abs(a) <= SHORT and abs(b) <= SHORT * SHORT and abs(c) <= SHORT * SHORT * SHORT
        step = series if good else (newton / (1.0 + a) if abs(a) < 0.5 else newton)
        if f <= 0.0:
            if not sure and (-f <= NOISE * s * (alpha + abs(y - s)) or f1 >= 0.0):
                return s, max(-2.0 * f1, 0.0), count
            s += step if -step < s else -0.75 * s
        elif gamma <= 1.0:
            s += min(step, 0.5) if f1 < 0.0 else min(s, 0.25)
        else:
            tried = s + _next(alpha, x_lift, x + s, f, (f1, f2), step, newton, series, good)
            if 0.5 * s * (u - s) - highest * cosine > highest:  # above every height of the base
                tried = max(tried, u - 4.0 * highest * (1.0 + cosine) / u)
            s = tried
    return np.nan, 0.0, count


@njit(nogil=True, error_model="numpy")
def scalar_moving(first, last, problem, launches, periods, times, out):
    """Follow trajectories first to last; `out`: landings, passes, sums of flights, highest apices.

    Landing times go into `times`, shape (trajectory, impact), unless it is None.
    """
    landings, passes, total, highest = out
    particles = launches.phase.shape[1]
    for lane in range(first, last):
        i, p = lane // particles, lane % particles
        e, r = problem.restitution[i], problem.rest_flight[i]
        alpha = problem.kick[i] / (1.0 + e)
        gamma = math.pi * alpha
        x_lift = math.acos(-1.0 / gamma) / TWO_PI if gamma > 1.0 else np.nan
        row = i if launches.whole.shape[0] > 1 else 0
        t = launches.whole[row, p] + launches.phase[row, p] + problem.phase[i]
        whole = np.rint(t)
        x = t - whole
        y = problem.launch_flight[i] - alpha * math.sin(TWO_PI * x)
        n, used, flown, apex = 0, 0, 0.0, -np.inf
        while True:
            s, v, used = moving_flight(alpha, x_lift, x, y, used)
            if not whole + x + s <= periods:
                break
            if n > 0:
                u = y + alpha * math.sin(TWO_PI * x)
                flown += s
                apex = max(apex, u * u - 2.0 * alpha / math.pi * math.cos(TWO_PI * x))
            if times is not None:
                if n == times.shape[1]:
                    break
                times[lane, n] = whole + x + s
            n += 1
            carry = np.rint(x + s)
            whole += carry
            x += s - carry
            y = e * v
            if not (y > r or abs(x) > x_lift):
                if not x_lift > 0.0:
                    break
                x, y = x_lift, 0.0
        landings[lane], passes[lane], total[lane], highest[lane] = n, used, flown, apex
