"""The landings of the moving base against a method that cannot miss one.

    python checks/first_roots.py [--flights 1000000] [--proved 0] [--seed 1] [--write]

The clearance over the base after s periods is covered from the launch on with intervals on which
its Taylor polynomial of second degree, with a bound of the third derivative, either shows that
there is no root, or that there is one and the clearance falls throughout.  An interval that is
halved down to 1e-7 of its time without an answer holds a minimum within rounding of zero, an
undecided graze: the particle may land there or fly on.  The method shares only the equation with
the kernel.

Flights: Gamma 0.01-50 and launch speeds relative to the base 1e-9-20 periods, both log-uniform,
phases uniform, over a sine and over bases of 2, 5 or 16 harmonics with normal weights and uniform
phases; lift-offs from rest; and grazes, whose parameters solve for a clearance that touches
zero, changed by a share of 1e-17 to 1e-3.  A landing of the kernel is right if it is the first root
or an undecided graze before it.  --proved N compares N with ball arithmetic as well.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numba import njit

from accuracy import bare_problem, provenance, table, write_section
from vibrosweep.kernels.bases import constants, fly
from vibrosweep.kernels.bases.moving_errors import along
from vibrosweep.kernels.impact import base_of
from vibrosweep.model.shapes import SINE, Waveform

TWO_PI = 2.0 * math.pi
EPS = 2.0**-53
# Roundings of a clearance, in units of EPS times the moduli of its terms: over a sine, and over
# harmonics, whose angles are rounded too
ROUNDINGS, OF_HARMONICS = 8.0, 16.0
NARROWEST = 1e-7  # intervals, relative to the time
LARGEST_ERROR = 1.0  # allowed, in units of the effect of roundings of the clearance's terms
MOST_GRAZES = 4  # of one flight that are recorded
CHUNK = 50_000  # flights of one task of a thread
BATCH = 1_000_000  # flights in memory
BITS = 256
MOST_LISTED = 20
NUMBERS = (2, 5, 16)  # of harmonics, for each of which a kernel is compiled


@njit(error_model="numpy", nogil=True)
def _sine(x):
    """sin(2 pi x), the phase folded exactly into an eighth of a turn about 0 or a quarter."""
    x -= np.rint(x)
    y = abs(x)
    y = 0.5 - y if y > 0.25 else y
    value = math.sin(TWO_PI * y) if y <= 0.125 else math.cos(TWO_PI * (0.25 - y))
    return math.copysign(value, x)


@njit(error_model="numpy", nogil=True)
def _cosine(x):
    return _sine(0.25 - abs(x - np.rint(x)))


@njit(error_model="numpy", nogil=True)
def _lag(s):
    """2 pi s - sin(2 pi s), by its series where the difference would cancel."""
    q = TWO_PI * s
    if q > 1.0:
        return q - _sine(s)
    term, total = q * q * q / 6.0, 0.0
    for k in range(4, 28, 2):
        total += term
        term *= -q * q / (k * (k + 1.0))
    return total


@njit(error_model="numpy", nogil=True)
def clearance(tones, alpha, x, y, s):
    """Clearance after s periods, a bound of its rounding error, and two derivatives.

    `tones` holds number, weight and phase in rad of each harmonic of the base.
    """
    value, size = 0.5 * s * (y - s), 0.5 * s * (abs(y) + s)
    slope, bend = 0.5 * y - s, -1.0
    for k in range(tones.shape[0]):
        h, c, psi = tones[k]
        begin = h * x - np.rint(h * x) + psi / TWO_PI
        sine, cosine, lag = _sine(begin), _cosine(begin), _lag(h * s)
        turned, half = _sine(h * s), _sine(0.5 * h * s)
        versine = 2.0 * half * half
        scale = alpha * c / (4.0 * math.pi * h)
        value += scale * (sine * lag - cosine * versine)
        size += abs(scale) * (abs(sine) * lag + abs(cosine) * versine)
        moved = cosine * turned - sine * versine  # sin (angle after s) - sin (angle before)
        slope -= 0.5 * alpha * c * moved
        bend -= math.pi * alpha * c * h * (cosine * (1.0 - versine) - sine * turned)
    roundings = ROUNDINGS if tones.shape[0] == 1 else OF_HARMONICS
    return value, roundings * EPS * size, slope, bend


@njit(error_model="numpy", nogil=True)
def _least(value, slope, bend, h):
    """Least value of value + slope t + bend t^2 / 2 for |t| <= h."""
    least = value - abs(slope) * h + 0.5 * bend * h * h
    if bend > 0.0 and abs(slope) < bend * h:
        least = value - 0.5 * slope * slope / bend
    return least


@njit(error_model="numpy", nogil=True)
def _polished(tones, alpha, x, y, left, right):
    """The root between `left` and `right`, where the clearance falls."""
    s = right
    for _ in range(200):
        value, _, slope, _ = clearance(tones, alpha, x, y, s)
        left, right = (s, right) if value > 0.0 else (left, s)
        step = s - value / slope
        step = step if left <= step <= right else 0.5 * (left + right)
        if step == s:
            break
        s = step
    return s


@njit(error_model="numpy", nogil=True)
def _begin(gamma, y):
    """A time before which no root lies."""
    if y > 0.0:
        return 0.5 * y / (1.0 + gamma)  # the parabola of the fastest fall lands at twice that
    # a lift-off from a sine: the clearance is at least
    # sqrt(gamma^2 - 1) pi s^3 / 3 - gamma pi^2 s^4 / 6
    return 0.01 * math.sqrt((gamma - 1.0) * (gamma + 1.0)) / (1.0 + gamma)


@njit(error_model="numpy", nogil=True)
def first_root(tones, alpha, x, y, grazes):
    """The first certain root, and the number of undecided grazes before it.

    Their intervals are put into `grazes`, shape (MOST_GRAZES, 2).  A number above MOST_GRAZES says
    that there were more than can be kept; a root of NaN, that none was found.
    """
    speed = gamma = third = 0.0
    for k in range(tones.shape[0]):
        h, c, _ = tones[k]
        speed += alpha * abs(c)
        gamma += math.pi * alpha * h * abs(c)
        third += TWO_PI * math.pi * alpha * h * h * abs(c)
    reach = y + speed
    end = 1.0 + reach + math.sqrt(reach * reach + 4.0 * speed)  # far below the lowest base
    a = _begin(gamma, y)
    width, undecided = a, 0
    while a < end:
        h = 0.5 * width
        b, middle = a + width, a + h
        value, noise, slope, bend = clearance(tones, alpha, x, y, middle)
        least = _least(value, slope, bend, h) - third * h * h * h / 6.0
        if least > noise:
            a, width = b, 1.5 * width
            continue
        falls = slope + (abs(bend) + third * h) * h < 0.0
        value, noise, _, _ = clearance(tones, alpha, x, y, b)
        if falls and value < -noise:
            return _polished(tones, alpha, x, y, a, b), undecided
        if width > NARROWEST * a:
            width = h
            continue
        if undecided > 0 and undecided <= MOST_GRAZES and grazes[undecided - 1, 1] == a:
            grazes[undecided - 1, 1] = b
        else:
            undecided += 1
            if undecided <= MOST_GRAZES:
                grazes[undecided - 1, 0], grazes[undecided - 1, 1] = a, b
        if value < -noise:
            return b, undecided
        a = b
    return np.nan, undecided


class Verdicts(NamedTuple):
    """Outcomes of flights, one entry each.

    Attributes
    ----------
    root, landing
        Periods to the first certain root, and to the kernel's landing.
    undecided
        Number of undecided grazes before the root.
    missed
        1: the kernel lands after the first root; -1: before it, and at no undecided graze.
    error
        Error of the kernel's landing, in units of the error that rounding both clearances forces;
        NaN where the landing is not the certain root.
    speed_error
        Error of its speed relative to the base, in units of `ROUNDINGS` of its terms plus the
        effect of the forced error of the landing; over harmonics of the claimed bound as well.
    """

    root: np.ndarray
    landing: np.ndarray
    undecided: np.ndarray
    missed: np.ndarray
    error: np.ndarray
    speed_error: np.ndarray


@njit(error_model="numpy", nogil=True)
def _within_rounding(tones, alpha, x, y, first, last):
    """Return whether the clearance is zero between two times, to the rounding of both methods."""
    within = True
    for k in range(65):
        value, noise, _, _ = clearance(tones, alpha, x, y, first + (last - first) * (k / 64.0))
        within &= abs(value) <= 2.0 * noise
    return within


@njit(error_model="numpy", nogil=True)
def _judge(base, problem, tones, x, y, first, last, out):
    grazes, single = np.empty((MOST_GRAZES, 2)), tones.shape[0] == 1
    jerk = np.sum(TWO_PI * math.pi * tones[:, 0] ** 2 * np.abs(tones[:, 1]))
    for i in range(first, last):
        fixed = constants(base, problem, i)
        alpha = problem.kick[i]  # restitution 0
        landing, speed = fly(fixed, x[i], y[i])
        root, undecided = first_root(tones, alpha, x[i], y[i], grazes)
        _, noise, slope, bend = clearance(tones, alpha, x[i], y[i], root)
        claimed = along(fixed, x[i], y[i], root)
        both = 2.0 * noise if single else noise + max(noise, claimed.f_error)
        forced = both / abs(slope) + 2.0 * EPS * root
        error = abs(landing - root) / forced
        steep = forced * (abs(bend) + jerk * alpha * forced) < 0.1 * abs(slope)
        at_graze = False
        for k in range(min(undecided, MOST_GRAZES)):
            room = 2.0 * (grazes[k, 1] - grazes[k, 0])
            at_graze |= grazes[k, 0] - room <= landing <= grazes[k, 1] + room
        right = steep and error <= LARGEST_ERROR
        if not (right or at_graze):
            # a root that is almost a graze, or three that almost coincide
            at_graze = _within_rounding(tones, alpha, x[i], y[i], landing, root)
            undecided = max(undecided, 1)
        out.root[i], out.landing[i] = root, landing
        out.undecided[i] = undecided
        out.missed[i] = 0 if right or at_graze else (-1 if landing < root else 1)
        out.error[i], out.speed_error[i] = np.nan, np.nan
        if right and not at_graze:
            blur = ROUNDINGS * EPS * (root + abs(y[i]) + alpha)
            if not single:
                angles = alpha * np.sum(np.abs(tones[:, 1]) * (1.0 + tones[:, 0] * root))
                blur = OF_HARMONICS * EPS * (2.0 * root + abs(y[i]) + angles) + claimed.z_error
            out.error[i] = error
            out.speed_error[i] = abs(speed + 2.0 * slope) / (blur + 2.0 * forced * abs(bend))


class Flights(NamedTuple):
    """Flights to be judged: kick, phase of launch, speed relative to the base, and waveform."""

    alpha: np.ndarray  # Gamma / pi for a sine
    x: np.ndarray
    y: np.ndarray
    waveform: Waveform = SINE

    @property
    def tones(self) -> np.ndarray:
        """Number, weight and phase in rad of each harmonic."""
        return np.array(self.waveform.tones or [(1, 1.0, 0.0)])


def wide(number: int, rng: np.random.Generator) -> Flights:
    """Gamma 0.01-50, launch speeds 1e-9-20 periods, all phases"""
    alpha = np.exp(rng.uniform(math.log(0.01), math.log(50.0), number)) / math.pi
    y = np.exp(rng.uniform(math.log(1e-9), math.log(20.0), number))
    return Flights(alpha, rng.uniform(-0.5, 0.5, number), y)


def drawn(harmonics: int, rng: np.random.Generator) -> Waveform:
    """Draw a waveform with all harmonics up to a number."""
    tones = (
        (h, float(rng.normal()), float(rng.uniform(-math.pi, math.pi)))
        for h in range(1, harmonics + 1)
    )
    return Waveform("harmonics", tuple(tones))


def shaped(number: int, rng: np.random.Generator, harmonics: int = 0) -> Flights:
    """The same over 2, 5 or 16 random harmonics"""
    flights, waveform = wide(number, rng), drawn(harmonics or int(rng.choice(NUMBERS)), rng)
    # the greatest downward acceleration is Gamma
    return flights._replace(alpha=2.0 * math.pi * flights.alpha / waveform.fall, waveform=waveform)


def lift_offs(number: int, rng: np.random.Generator) -> Flights:
    """Lift-offs from rest, Gamma 1-50"""
    alpha = np.exp(rng.uniform(0.0, math.log(50.0), number)) / math.pi
    alpha = alpha[math.pi * alpha > 1.0]
    problem = bare_problem(np.zeros(alpha.size), alpha)
    base = base_of("moving", "rest")
    x = [constants(base, problem, i).x_lift for i in range(alpha.size)]
    return Flights(alpha, np.array(x), np.zeros(alpha.size))


def touching(number: int, rng: np.random.Generator) -> Flights:
    """Clearances that almost touch zero, Gamma 1-50, speeds up to 20 periods"""
    found: list[Flights] = []
    while sum(flights.x.size for flights in found) < number:
        x = rng.uniform(-0.5, 0.5, number)
        s = np.exp(rng.uniform(math.log(1e-3), math.log(20.0), number))
        sine, cosine = np.sin(TWO_PI * x), np.cos(TWO_PI * x)
        rise = np.sin(TWO_PI * (x + s)) - sine
        fall = np.cos(TWO_PI * (x + s)) - cosine + TWO_PI * s * sine
        # both the clearance and its derivative vanish at s
        alpha = -0.5 * s * s / (0.5 * s * rise + fall / (4.0 * math.pi))
        y = 2.0 * s + alpha * rise
        bend = -1.0 - math.pi * alpha * np.cos(TWO_PI * (x + s))
        good = (alpha > 1.0 / math.pi) & (alpha < 50.0 / math.pi) & (y > 1e-9) & (y < 20.0)
        good &= bend > 0.0
        change = rng.choice([-1.0, 1.0], number) * 10.0 ** rng.uniform(-17.0, -3.0, number)
        found.append(Flights(alpha[good], x[good], (y * (1.0 + change))[good]))
    each = ([getattr(one, name) for one in found] for name in ("alpha", "x", "y"))
    return Flights(*(np.concatenate(column)[:number] for column in each))


def judge(flights: Flights, threads: int = 2) -> Verdicts:
    """Compare the kernel's landings with the first roots."""
    number = flights.x.size
    problem = bare_problem(np.zeros(number), flights.alpha)
    whole, real = np.zeros((2, number), np.int64), np.empty((4, number))
    out = Verdicts(real[0], real[1], whole[0], whole[1], real[2], real[3])
    base = base_of("moving", "rest", flights.waveform)
    with ThreadPoolExecutor(threads) as pool:
        tasks = [
            pool.submit(
                _judge, base, problem, flights.tones, flights.x, flights.y,
                first, min(first + CHUNK, number), out,
            )
            for first in range(0, number, CHUNK)
        ]  # fmt: skip
        for task in tasks:
            task.result()
    return out


def proved(flights: Flights, chosen: np.ndarray) -> tuple[int, float]:
    """Number of the kernel's landings that ball arithmetic refutes, and the largest error.

    The error is in units of the error that rounding the clearance forces, as in `Verdicts`.
    """
    from proved_pieces import first_landing

    verdicts = judge(Flights(*(column[chosen] for column in flights[:3])))
    wrong, largest = 0, 0.0
    for k, i in enumerate(chosen):
        if verdicts.undecided[k]:
            continue
        alpha, x, y = (float(column[i]) for column in flights[:3])
        time, _ = first_landing(0.0, alpha, x, y, BITS)
        _, noise, slope, _ = clearance(flights.tones, alpha, x, y, float(time))
        error = abs(float(time - float(verdicts.landing[k])))
        error /= 2.0 * noise / abs(slope) + 2.0 * EPS * float(time)
        wrong += not error <= LARGEST_ERROR
        largest = max(largest, error)
    return wrong, largest


class Campaign(NamedTuple):
    """Outcome for one kind of flights: its row, its grazes, and the number of failures."""

    row: list[str]
    undecided: list[tuple[float, ...]]
    wrong: int


def campaign(
    draw: Callable[[int, np.random.Generator], Flights],
    flights: int,
    proofs: int,
    seed: int,
    batch: int = BATCH,
) -> Campaign:
    """Judge a number of flights, so many at a time; some are also proved."""
    rng = np.random.default_rng(seed)
    number, missed, early, named = 0, 0, 0, []
    largest = [0.0, 0.0]
    left = flights
    while left > 0:
        given = draw(min(left, batch), rng)
        left -= min(left, batch)
        found = judge(given)
        number += given.x.size
        missed += int(np.count_nonzero(found.missed > 0))
        early += int(np.count_nonzero(found.missed < 0))
        named += [
            (math.pi * float(given.alpha[i]), *(float(v[i]) for v in (*given[1:3], *found[:2])))
            for i in np.flatnonzero(found.undecided)
        ]
        errors = (found.error, found.speed_error)
        largest = [max(a, float(np.nanmax(b))) for a, b in zip(largest, errors, strict=True)]
    refuted, error = (0, 0.0) if proofs == 0 else proved(given, np.arange(given.x.size)[:proofs])
    checked = f"{min(proofs, given.x.size):,}" if proofs else "-"
    row = [draw.__doc__, f"{number:,}", str(missed + early), f"{len(named):,}",
           *(f"{v:.2f}" for v in largest), checked, str(refuted), f"{error:.2f}"]  # fmt: skip
    rough = sum(not value <= LARGEST_ERROR for value in largest)
    return Campaign(row, named, missed + early + refuted + rough)


HEAD = ("flights", "number", "wrong", "undecided", "largest error", "of the speed", "proved",
        "refuted", "largest error, proved")  # fmt: skip
SHORT = (0, 1, 2, 3, 4, 6, 7)  # columns of the report


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--flights", type=int, default=1_000_000, help="a tenth of each other kind")
    parser.add_argument("--proved", type=int, default=0, metavar="N", help="in ball arithmetic")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--list", metavar="CSV", help="where to name all undecided grazes")
    parser.add_argument("--write", action="store_true", help="write the table into the report")
    options = parser.parse_args()
    began = time.perf_counter()
    few, proofs = options.flights // 10, options.proved // 10
    kinds = [
        campaign(wide, options.flights, options.proved - proofs, options.seed),
        # not proved: the double next to a lift-off may be one at which the base still presses
        campaign(lift_offs, few, 0, options.seed),
        campaign(touching, few, proofs, options.seed),
        campaign(shaped, few, 0, options.seed, batch=max(1, few // 20)),
    ]
    undecided = [flight for kind in kinds for flight in kind.undecided]
    head = "Gamma,phase,speed,first certain root,landing"
    if options.list:
        np.savetxt(options.list, undecided, "%.17g", ",", header=head, comments="")
    made = provenance(time.perf_counter() - began, options.seed)
    print(table(HEAD, [kind.row for kind in kinds]), f"\n\n{made}\n\nundecided ({head}):")
    print("\n".join(str(flight) for flight in undecided[:MOST_LISTED]))
    if options.write:
        short = [[row[k] for k in SHORT] for row in (HEAD, *(kind.row for kind in kinds))]
        write_section("first roots", f"{table(short[0], short[1:])}\n\n{made}")
    return 1 if any(kind.wrong for kind in kinds) else 0


if __name__ == "__main__":
    raise SystemExit(main())
