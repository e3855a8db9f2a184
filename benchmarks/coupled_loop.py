"""Base of finite mass as a scalar loop, which finds all next landings again after each event.

It follows one realization after the other and one event after the other, with one running time and
the library's sine and exponential.  The search for a landing starts at the present time, with steps
that cannot pass the first root: the clearance falls no faster than its slope and the largest
acceleration of the base allow.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

TWO_PI = 2.0 * math.pi
ULP = 2.0**-52
TRIES = 10_000
SHORTEST = 2.0**-40  # periods; a step that is taken where clearance and speed are 0
WAITING, FLYING, RIDING = 0, 1, 2


@njit(nogil=True, error_model="numpy")
def forced(alpha, mu, w, zeta, riders):
    """Steady motion level + p cos(2 pi t) + q sin(2 pi t) of the base under a number of riders."""
    load = riders * mu
    stiff, drag = w * w - (1.0 + load) * TWO_PI**2, 2.0 * zeta * w * TWO_PI
    a = -alpha / TWO_PI
    bare = w * w - TWO_PI**2
    if load == 0.0 or a == 0.0:
        p, q = a, 0.0
    else:
        norm = stiff * stiff + drag * drag
        p, q = a * (bare * stiff + drag * drag) / norm, a * drag * (bare - stiff) / norm
    return -2.0 * load / (w * w) if load > 0.0 else 0.0, p, q


@njit(nogil=True, error_model="numpy")
def free(w, zeta, mass, d, v, s):
    """Deviation from the steady motion, and its velocity, s periods later."""
    b, k = zeta * w / mass, w * w / mass
    turns = k - b * b
    if turns > 0.0:
        rate = math.sqrt(turns)
        decay = math.exp(-b * s)
        even, odd = decay * math.cos(rate * s), decay * math.sin(rate * s) / rate
    elif turns == 0.0:
        even = math.exp(-b * s)
        odd = s * even
    else:
        rate = math.sqrt(-turns)
        slow, fast = math.exp(-k / (b + rate) * s), math.exp(-(b + rate) * s)
        even, odd = 0.5 * (slow + fast), 0.5 * (slow - fast) / rate
    return d * (even + b * odd) + v * odd, v * (even - b * odd) - k * d * odd


@njit(nogil=True, error_model="numpy")
def base(motion, t, s):
    """Height, velocity and acceleration of the base at t + s."""
    w, zeta, mass, level, p, q, d, v = motion
    x, y = free(w, zeta, mass, d, v, s)
    cosine, sine = math.cos(TWO_PI * (t + s)), math.sin(TWO_PI * (t + s))
    return (
        level + p * cosine + q * sine + x,
        TWO_PI * (q * cosine - p * sine) + y,
        -(TWO_PI**2) * (p * cosine + q * sine) - (2.0 * zeta * w * y + w * w * x) / mass,
    )


@njit(nogil=True, error_model="numpy")
def advance(s, f, slope, curvature):
    """Step from s, not past a root of a function with this value, slope and largest curvature."""
    root = math.sqrt(slope * slope + 2.0 * curvature * max(f, 0.0))
    if slope < 0.0:
        return s + 2.0 * max(f, 0.0) / (root - slope)
    return s + max((slope + root) / curvature, SHORTEST)


@njit(nogil=True, error_model="numpy")
def next_landing(motion, energy, t, y, u, s, end):
    """Time of the first landing from t + s to `end`, for height y and velocity u at t; else inf."""
    w, zeta, mass, level, p, q, _, _ = motion
    reach, own = math.hypot(p, q), w / math.sqrt(mass)
    curvature = 2.0 + TWO_PI**2 * reach + (2.0 * zeta * w / mass + own) * energy
    above = y - level - reach - (energy / own if energy > 0.0 else 0.0)
    falls = u * u + 4.0 * above
    if falls > 0.0 and (above > 0.0 or u > 0.0):  # down to the largest height of the base
        s = max(s, 0.5 * (u + math.sqrt(falls)))
    for _ in range(TRIES):
        if not t + s <= end:
            break
        height, speed, _ = base(motion, t, s)
        f, slope = y + (u - s) * s - height, u - 2.0 * s - speed
        before, s = s, advance(s, f, slope, curvature)
        if slope < 0.0 and s - before <= ULP * (t + s):
            return t + s
    return np.inf


@njit(nogil=True, error_model="numpy")
def press(motion, energy, t, s):
    """Acceleration with which the base presses at t + s, its rate, and a bound of its curvature."""
    w, zeta, mass, _, p, q, d, v = motion
    drag, own = 2.0 * zeta * w / mass, w / math.sqrt(mass)
    x, y = free(w, zeta, mass, d, v, s)
    z = -drag * y - own * own * x
    cosine, sine = math.cos(TWO_PI * (t + s)), math.sin(TWO_PI * (t + s))
    return (
        2.0 - TWO_PI**2 * (p * cosine + q * sine) + z,
        TWO_PI**3 * (p * sine - q * cosine) - drag * z - own * own * y,
        TWO_PI**4 * math.hypot(p, q) + (drag * (drag + own) + own * own) * (drag + own) * energy,
    )


@njit(nogil=True, error_model="numpy")
def next_release(motion, energy, t, end):
    """Time at which the base begins to fall faster than g, so that riders leave; else inf."""
    s = 0.0
    for _ in range(TRIES):
        if not t + s <= end:
            break
        f, slope, curvature = press(motion, energy, t, s)
        before, s = s, advance(s, f, slope, curvature)
        if slope < 0.0 and s - before <= ULP * (t + s):
            return t + s
    return np.inf


@njit(nogil=True, error_model="numpy")
def motion_from(alpha, mu, w, zeta, riders, t, height, rate):
    """Motion of the base with this height and velocity at t, and its free energy as a speed."""
    mass = 1.0 + riders * mu
    level, p, q = forced(alpha, mu, w, zeta, riders)
    cosine, sine = math.cos(TWO_PI * t), math.sin(TWO_PI * t)
    d = height - level - p * cosine - q * sine
    v = rate - TWO_PI * (q * cosine - p * sine)
    return (w, zeta, mass, level, p, q, d, v), math.hypot(v, w / math.sqrt(mass) * d)


@njit(nogil=True, error_model="numpy")
def release_riders(place, balls, height, rate, now):
    """Let all particles that ride the base fly with its velocity."""
    for j in range(place.size):
        if place[j] == RIDING:
            place[j] = FLYING
            balls[0, j], balls[1, j], balls[2, j] = height, rate, now


@njit(nogil=True, error_model="numpy")
def scalar_coupled(first, last, problem, mounts, launches, periods, times, out):
    """Follow realizations first to last; `out` receives the number of landings of each particle.

    Landing times go into `times`, shape (realization, particle, impact), unless it is None.
    """
    size = out.shape[1]
    place, due, balls = np.empty(size, np.int64), np.empty(size), np.empty((3, size))
    for i in range(first, last):
        e, r, mu = problem.restitution[i], problem.rest_flight[i], mounts.mass_ratio[i]
        alpha, w, zeta = problem.kick[i] / (1.0 + e), TWO_PI * mounts.natural[i], mounts.damping[i]
        row = i if launches.whole.shape[0] > 1 else 0
        place[:] = WAITING
        due[:] = launches.whole[row] + launches.phase[row] + problem.phase[i]
        end, t, riders, release = problem.phase[i] + periods, due.min(), 0, np.inf
        start = -alpha / TWO_PI * math.cos(TWO_PI * t), alpha * math.sin(TWO_PI * t)
        motion, energy = motion_from(alpha, mu, w, zeta, 0, t, start[0], start[1])
        while True:
            j = np.argmin(due)
            now = min(due[j], release)
            if not now <= end:
                break
            height, rate, pull = base(motion, t, now - t)
            if release <= due[j]:
                release_riders(place, balls, height, rate, now)
                riders = 0
            else:
                waits = place[j] == WAITING
                u = problem.launch_flight[i] if waits else balls[1, j] - 2.0 * (now - balls[2, j])
                lands = not waits or u <= rate
                c = max(rate - u, 0.0)
                place[j] = FLYING
                if lands:
                    if times is not None and out[i, j] < times.shape[2]:
                        times[i, j, out[i, j]] = now - problem.phase[i]
                    out[i, j] += 1
                mass = 1.0 + riders * mu
                common = (mass * rate + mu * u) / (mass + mu)
                pressing = pull + 2.0 * zeta * w * (rate - common) / mass + 2.0
                if lands and e * c <= r and pressing > 0.0:
                    rate = common
                    place[j] = RIDING
                    riders += 1
                elif lands:
                    if riders > 0 and mu * (1.0 + e) * c / (1.0 + mu) > r:
                        release_riders(place, balls, height, rate, now)
                        riders, mass = 0, 1.0
                    given = (1.0 + e) * c / (mass + mu)
                    u += mass * given
                    rate -= mu * given
                balls[0, j], balls[1, j], balls[2, j] = height, u, now
            t = now
            motion, energy = motion_from(alpha, mu, w, zeta, riders, t, height, rate)
            gap = 0.0
            if now == release:  # the base falls away from its riders for at least this time
                _, jerk, snap = press(motion, energy, t, 0.0)
                gap = max(-2.0 * jerk / snap, 0.0)
            release = next_release(motion, energy, t, end) if riders > 0 else np.inf
            for j in range(size):
                if place[j] == FLYING:
                    flown = t - balls[2, j]
                    y = balls[0, j] + (balls[1, j] - flown) * flown
                    first = gap if flown == 0.0 else 0.0
                    u = balls[1, j] - 2.0 * flown
                    due[j] = next_landing(motion, energy, t, y, u, first, end)
                elif place[j] == RIDING:
                    due[j] = np.inf
