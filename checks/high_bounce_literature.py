"""Published numbers for the ball on a moving base, computed again."""

from __future__ import annotations

import numpy as np

from accuracy import table
from high_bounce_scenes import MOVING, amplitude_of, measured, settled
from vibrosweep.model.measures import Regime

TUFILLARO = "Tufillaro, Abbott and Reilly [1]"
LIFT = "Tufillaro, Abbott and Reilly [2]"
MEHTA = "closed form; the ball of Mehta and Luck [3]"
CEDDIA = "Ceddia [4]"


def cycles(e, gamma, workers, launches=1, duration=2e4):
    """Impacts, periods and rests in each launch's cycle, regime, and whether that is uncertain."""
    gamma = np.atleast_1d(gamma)
    values = {
        "restitution": np.full(gamma.size, e),
        "amplitude": amplitude_of(e, gamma),
        "contact_time": np.full(gamma.size, 1e-6),
    }
    found = measured(values, settled(launches, duration=duration), MOVING, workers)
    names = ("cycle_impacts", "cycle_periods", "cycle_rests", "regime", "cycle_uncertain")
    return np.stack([found[name] for name in names], axis=-1)


def last_that(holds, low, high, width=1e-12):
    """Largest Gamma at which a condition holds that holds at `low` and not at `high`."""
    assert holds(low)
    assert not holds(high)
    while high - low > width * high:
        middle = (low + high) / 2.0
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def inelastic(workers):
    """Ends of the steps of the completely inelastic ball, with their closed forms.

    The flight after a rest lasts n periods at sqrt(1 + (pi n)^2); from there on the ball lands
    where the base falls faster than g and leaves at once, on the orbit locked to n periods.
    Flights from x_L to -x_L, plus whole periods, end at the height at which they began and so
    last 2 Gamma sin(2 pi x_L) radians of phase: tan z = z with z = pi s, and Gamma = sqrt(1 + z^2).
    From there on the ball lands again where the base presses on it.
    """

    def signature(gamma):
        return tuple(cycles(0.0, gamma, workers)[0, 0, :3])

    def step(n):
        return lambda gamma: signature(gamma) == (1, n, 1)

    rows = []
    for n in (1, 2, 3):
        exact = np.hypot(1.0, np.pi * n)
        here = last_that(step(n), exact - 0.1, exact + 0.05)
        rows.append((f"e = 0: a flight of {n} after each rest, up to", MEHTA, exact, here))
        if n < 3:
            z = tangent_root(n)
            exact = np.hypot(1.0, z)
            here = last_that(lambda g, n=n: not step(n + 1)(g), exact - 0.02, exact + 0.02)
            rows.append(
                (f"e = 0: flights of {n} to {n + 1} after each rest, from", MEHTA, exact, here)
            )
    return [(name, source, f"{there:.6f}", f"{here:.6f}") for name, source, there, here in rows]


def tangent_root(n):
    """Root of tan z = z between n pi and (n + 1/2) pi, from z = n pi + arctan z, a contraction."""
    z = n * np.pi
    for _ in range(60):
        z = n * np.pi + np.arctan(z)
    return z


def doublings(workers):
    """Amplitudes in cm of the first two period doublings of the orbit locked to one period.

    The text names neither restitution nor frequency: 0.5, 60 Hz and 981 cm/s^2 are assumed.
    """
    per_gamma = 981.0 / (2.0 * np.pi * 60.0) ** 2  # cm

    def doubled(times):
        # 500,000 periods: orbits recur until the leading multiplier is within 1e-4 of -1
        def holds(gamma):
            found = cycles(0.5, gamma, workers, launches=8, duration=5e5)[0]
            free = found[(found[:, 2] == 0) & (found[:, 0] > 0)]
            return bool((free[:, 0] <= 2 ** (times - 1)).any())

        return holds

    rows = []
    for times, there, low, high in ((1, 0.0106, 1.5, 1.54), (2, 0.0115, 1.62, 1.68)):
        gamma = last_that(doubled(times), low, high, width=1e-6)
        name = f"e = 0.5, 60 Hz: period {2 ** (times - 1)} doubles at"
        rows.append((name, TUFILLARO, f"{there} cm", f"{gamma * per_gamma:.5f} cm"))
    return rows


def lift(workers):
    """Largest Gamma at which a ball that has come to rest stays there."""

    def stays(gamma):
        return cycles(0.5, gamma, workers)[0, 0, 3] == 0

    gamma = last_that(stays, 0.9, 1.1)
    return [(r"a ball at rest leaves the base from $\Gamma$", LIFT, "1", f"{gamma:.9f}")]


def cascade(workers):
    """Cycles without rests at e = 0.5, where orbits of one and of three periods double."""
    gamma = np.concatenate([np.linspace(1.4, 1.8, 4001), np.linspace(2.3, 2.45, 1501)])
    found = cycles(0.5, gamma, workers, launches=4)
    free = found[(found[..., 2] == 0) & (found[..., 0] > 0)]
    seen = [str(n) for n in (1, 2, 4, 8, 16, 3, 6, 12) if n in free[:, 0]]
    there = "1, 2, 4, 8, 16, 3, 6, 12"
    return [("periods of cycles without rests (here: e = 0.5)", CEDDIA, there, ", ".join(seen))]


def chaos(workers, duration=5e4, launches=100):
    """List the recurrent orbits beyond the locked ones, and the lengths of their cycles."""
    rows = []
    for e in (0.5, 0.6, 0.7, 0.75, 0.8, 0.82, 0.84, 0.9):
        cells = []
        for found in cycles(e, (2.0, 3.0, 4.0), workers, launches, duration):
            recurred = found[found[:, 0] > 0]
            cell = f"{100 * len(recurred) / launches:.0f} %"
            if recurred.size:
                kinds, counts = np.unique(recurred, axis=0, return_counts=True)
                impacts, periods, rests, _, uncertain = kinds[counts.argmax()]
                assert rests == 1
                cell += f": {impacts} in {periods}{' (?)' if uncertain else ''}"
            aperiodic = np.mean(found[:, 3] == Regime.APERIODIC)
            cells.append(f"{cell}; {100 * aperiodic:.0f} % aperiodic" if aperiodic else cell)
        rows.append((e, *cells))
    return table(("$e$", *(rf"$\Gamma = {one}$" for one in (2, 3, 4))), rows)


def literature(workers):
    """The table of published numbers and those computed here."""
    rows = [*lift(workers), *doublings(workers), *inelastic(workers), *cascade(workers)]
    return table(("what", "by", "there", "here"), rows)
