"""Errors of the high-bounce approximation: the same scenes over the fixed and the moving base.

    python checks/high_bounce_cost.py [--seed 1] [--only NAME] [--pictures FOLDER] [--write]

Draws the pictures of study/high-bounce.md and prints its tables; --write replaces them.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from PIL import Image

import vibrosweep as vs
from accuracy import provenance, table, write_section
from vibrosweep import simulate, theory
from vibrosweep.engine.measure import measure
from vibrosweep.engine.workers import Workers
from vibrosweep.figures import style
from vibrosweep.model.measures import Regime
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import HIGH_BOUNCE, MOVING, PARAMETERS
from vibrosweep.scene.design import open_design
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import read_spec

# Scenes that high_bounce_cost.py computes on both bases, and the regimes of their particles.

BOTH = HIGH_BOUNCE, MOVING
ROOT = Path(__file__).parents[1]
PAPER = read_spec(ROOT / "sweeps" / "paper.toml")
NAMES = ("at rest", "resting", "locked", "other")
GRAVITY = PARAMETERS["gravity"].default
SETTLED = 20_000.0  # s at 1 Hz; a locked orbit of e = 0.98 recurs within 7,500 periods
PIECE = 2000  # realizations at a time


def gamma_of(e, amplitude, frequency=1.0):
    """Largest acceleration of the base in g: A = (1 + e) V0, Gamma = 2 pi f V0 / g."""
    return 2.0 * np.pi * frequency * amplitude / ((1.0 + e) * GRAVITY)


def amplitude_of(e, gamma, frequency=1.0):
    """Kick amplitude A in m/s on a base of that acceleration."""
    return (1.0 + e) * gamma * GRAVITY / (2.0 * np.pi * frequency)


def settled(particles=20, launch="staggered", duration=SETTLED):
    """Observe orbits until they settle, and measure the last tenth of the time."""
    asked = Measures(0.9 * duration, regimes=True, lyapunov=True, per_particle=True)
    return Scene(particles, launch, duration, "rest", asked)


def measured(values, observation, base, workers):
    """Measure realizations on one base, some at a time."""
    size = values["restitution"].size
    full = {n: np.broadcast_to(values.get(n, p.default), size) for n, p in PARAMETERS.items()}
    found = []
    for start in range(0, size, PIECE):
        piece = {n: np.array(v[start : start + PIECE], float) for n, v in full.items()}
        found.append(measure(piece, replace(observation, base=base), workers))
    whole = {name: np.concatenate([part[name] for part in found]) for name in found[0]}
    assert (whole["status"] == 0).all()
    return whole


def regime_of(found):
    """Regime of each particle; orbits without recurrence are one regime, UNSETTLED."""
    return np.minimum(found["regime"], Regime.UNSETTLED)


def of_paper():
    """Restitution and amplitude of the realizations of sweeps/paper.toml."""
    return open_design(PAPER).take(0, PAPER.design.realizations)


def independent(seed, count):
    """Realizations of paper.toml's ranges with one particle each, launched at a random phase."""
    random = np.random.default_rng(seed)
    ranges = {name: (drawn.low, drawn.high) for name, drawn in PAPER.design.sampled.items()}
    ranges["phase"] = (0.0, 2.0 * np.pi)
    return {name: random.uniform(*bounds, count) for name, bounds in ranges.items()}


# Pictures of study/high-bounce.md.

REGIMES = ("at rest", "resting", "locked", "other")
TICKS = (0.03, 0.1, 0.3, 1.0, 3.0)
COLOURS = ("0.75", style.OKABE_ITO[5], style.OKABE_ITO[0], style.OKABE_ITO[1])


@mpl.rc_context(style.RC)
def draw_plane(e, gamma, common, agreement):
    """Commonest regime on each base, and two shares of launches that agree on both bases."""
    figure = Figure(figsize=(style.PAGE, 5.2), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    codes = {"cmap": ListedColormap(COLOURS), "norm": BoundaryNorm(np.arange(5) - 0.5, 4)}
    q = (1.0 - e) / (1.0 + e)
    for axes, values, steepest, title in zip(
        panels[0], common, (1.0, 1.0 + q * q), ("fixed base", "moving base"), strict=True
    ):
        kinds = axes.pcolormesh(e, gamma, values, rasterized=True, **codes)
        axes.plot(e, np.hypot(np.pi * q, steepest), "k--", path_effects=style.halo())
        axes.set_title(f"commonest regime, {title}")
    titles = ("the same regime", "the same, at rest and resting as one")
    for axes, share, title in zip(panels[1], agreement, titles, strict=True):
        shares = axes.pcolormesh(
            e,
            gamma,
            100.0 * share,
            cmap=style.SEQUENTIAL_MAP,
            vmin=0.0,
            vmax=100.0,
            rasterized=True,
        )
        axes.set_title(title)
    figure.colorbar(kinds, ax=panels[0], ticks=range(4)).ax.set_yticklabels(NAMES)
    figure.colorbar(shares, ax=panels[1]).set_label("launches (%)")
    for axes in panels.flat:
        axes.plot(e, np.pi * q, "k-", path_effects=style.halo())
        axes.set(yscale="log", xlim=(e[0], e[-1]), ylim=(gamma[0], gamma[-1]))
        axes.set_yticks(TICKS, [f"{tick:g}" for tick in TICKS])
        axes.minorticks_off()
    for axes in panels[1]:
        axes.set_xlabel("restitution $e$")
    for axes in panels[:, 0]:
        axes.set_ylabel("acceleration of the base $\\Gamma$ (g)")
    return figure


@mpl.rc_context(style.RC)
def draw_limit(gammas, curves):
    """Difference of landing times between the bases against Gamma, with its first order."""
    figure = Figure(figsize=(style.MEDIUM, 3.2), layout="constrained")
    axes = figure.add_subplot()
    for (u, off), colour in zip(curves.items(), style.colours(len(curves)), strict=True):
        axes.loglog(gammas, off[:, 0], "o", markersize=3, color=colour, label=f"$u_0 = {u:g}$")
        axes.loglog(gammas, off[:, -1], "s", markersize=3, color=colour, fillstyle="none")
        axes.loglog(gammas, gammas / (np.sqrt(2.0) * np.pi**2 * u), "-", color=colour)
    axes.set_xlabel("acceleration of the base $\\Gamma$ (g)")
    axes.set_ylabel("difference of landing times\n(rms, forcing periods)")
    style.head(axes, "first landing (dots), fourth (squares), first order (lines)", 3)
    return figure


@mpl.rc_context(style.RC)
def draw_staircase(gammas, flights, marks):
    """Length of every flight of the completely inelastic ball on its attractor against Gamma."""
    figure = Figure(figsize=(style.PAGE, 3.2), layout="constrained")
    axes = figure.add_subplot()
    for (words, values), lines in zip(marks.items(), ("--", "-.", ":"), strict=True):
        axes.vlines(values, 0.0, 4.0, colors=style.GREY, linestyles=lines, lw=0.7, label=words)
    across = np.broadcast_to(gammas[:, np.newaxis], flights.shape)
    axes.plot(across, flights, ".", markersize=0.8, color=style.OKABE_ITO[0], rasterized=True)
    axes.set(xlim=(gammas[0], gammas[-1]), ylim=(0.0, 3.5))
    axes.set_xlabel("acceleration of the base $\\Gamma$ (g)")
    axes.set_ylabel("length of a flight\n(forcing periods)")
    style.head(axes, "completely inelastic ball, $e = 0$")
    return figure


# Published numbers for the ball on a moving base, computed again.

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


# The same scenes on both bases.

PAGE = ROOT / "study" / "high-bounce.md"
IMAGES = ROOT / "study" / "images"
COUNT = 20_000


def wilson(hits, trials, z=1.959964):
    """Share with its 95 % interval by Wilson's score, in per cent."""
    share, per = hits / trials, z * z / trials
    middle = (share + per / 2.0) / (1.0 + per)
    half = np.sqrt(share * (1.0 - share) * per + per * per / 4.0) / (1.0 + per)
    return f"{100 * share:.1f} % ({100 * (middle - half):.1f} to {100 * (middle + half):.1f})"


def keep(figure, name, options):
    """Write a picture with 64 colours, which are enough and make it a third as large."""
    path = options.pictures / f"{name}.png"
    figure.savefig(path, dpi=150)
    Image.open(path).convert("RGB").quantize(64).save(path, optimize=True)


def percent(share):
    return f"{100 * share:.1f} %"


def regimes(workers, options):
    """Regimes over the ranges of paper.toml on both bases."""
    drawn = independent(options.seed, COUNT)

    def both(values, observation):
        return [regime_of(measured(values, observation, base, workers)).ravel() for base in BOTH]

    early = both(drawn, settled(1, (0.0,), 1000.0))
    found, paper = both(drawn, settled(1, (0.0,))), both(of_paper(), settled())

    def differ(pair):
        return pair[0] != pair[1]

    def sticking_as_one(pair):
        return differ([np.maximum(kind, Regime.RESTING) for kind in pair])

    def line(name, judge):
        return name, wilson(np.count_nonzero(judge(found)), COUNT), percent(np.mean(judge(paper)))

    shares = table(
        ("share of particles", "independent", "`paper.toml`"),
        [
            line("in another regime", differ),
            line("the same, resting and at rest counted as one", sticking_as_one),
            line("locked, fixed base", lambda pair: pair[0] == Regime.LOCKED),
            line("locked, moving base", lambda pair: pair[1] == Regime.LOCKED),
        ],
    )
    crossed = np.zeros((4, 4), int)
    np.add.at(crossed, tuple(found), 1)
    share = 100.0 * crossed / COUNT
    rows = [
        (f"**{name}**", *(f"{s:.1f}" for s in row), f"{row.sum():.1f}")
        for name, row in zip(NAMES, share, strict=True)
    ]
    rows.append(("all", *(f"{s:.1f}" for s in share.sum(axis=0)), "100.0"))
    matrix = table(("fixed base \\ moving base, %", *NAMES, "all"), rows)
    return (
        f"{shares}\n\n{matrix}\n\nIndependent: {COUNT:,} realizations (seed {options.seed}) with "
        "one particle each, launched at a random phase, with 95 % intervals by Wilson's score; the "
        "matrix is theirs. "
        f"`paper.toml`: its 200 realizations (seed {PAPER.design.seed}) with twenty particles "
        f"each, which are not independent. After {SETTLED:,.0f} periods; *other*: no recurrence "
        f"was found.\n\n"
        f"After 1,000 periods {percent(np.mean(early[0] == Regime.UNSETTLED))} have not recurred "
        f"on the fixed base and {percent(np.mean(early[1] == Regime.UNSETTLED))} on the moving "
        f"one; with those, {wilson(np.count_nonzero(differ(early)), COUNT)} are in another regime."
    )


def apart(left, right):
    """Landing at which two trajectories are first further apart than 0.01 s, counted from 1."""
    both = min(left.shape[-1], right.shape[-1])
    off = ~(np.abs(left[..., :both] - right[..., :both]) <= 0.01)  # NaN where one has ended
    return np.where(off.any(axis=-1), off.argmax(axis=-1) + 1, both + 1)


def short(workers, _options):
    """Measures of paper.toml over its own 12 s on both bases."""
    drawn = of_paper()
    found = [
        measured(drawn, PAPER.scene.with_measures(trust=False), base, workers) for base in BOTH
    ]
    launch = np.arange(PAPER.scene.particles) / PAPER.scene.particles
    times = [
        simulate(**drawn, launch_time=launch, duration=PAPER.scene.duration, base=base)[
            "landing_time"
        ].values
        for base in BOTH
    ]
    first = np.abs(times[0][..., 0] - times[1][..., 0])
    parted = apart(*times)

    def line(name, pick, show):
        return name, *(show(pick(one)) for one in found)

    rows = [
        line(
            "median of the maximum rebound height (m)",
            lambda one: np.median(one["rebound_height_max"]),
            "{:.3f}".format,
        ),
        line(
            "median of the mean flight time (s)",
            lambda one: np.median(one["flight_time_mean"]),
            "{:.3f}".format,
        ),
        line(
            "landings with a rest",
            lambda one: one["rest_count"].sum() / one["impact_count"].sum(),
            percent,
        ),
        line(
            "realizations without collision",
            lambda one: np.mean(one["collision_free"] == 1),
            percent,
        ),
        line(
            "dt_min below the resolution", lambda one: np.mean(one["dt_min_resolved"] == 0), percent
        ),
        line(
            "median of dt_min elsewhere (s)",
            lambda one: np.median(one["dt_min"][one["dt_min_resolved"] == 1]),
            "{:.1e}".format,
        ),
    ]
    text = table(("`paper.toml`, 12 s", "fixed base", "moving base"), rows)
    return (
        f"{text}\n\nThe first landings differ by {1e3 * np.median(first):.1f} ms in the median and "
        f"by {1e3 * first.max():.0f} ms at most (a period is 1 s). Half of the 4,000 trajectories "
        f"are more than 10 ms apart by landing {np.median(parted):.0f}, nine tenths by landing "
        f"{np.quantile(parted, 0.9):.0f}."
    )


def plane(workers, options, size=72):
    """Regimes over restitution and Gamma on both bases: draws the picture, returns a table."""
    e, gamma = np.meshgrid(np.linspace(0.30, 0.98, size), np.geomspace(0.03, 6.0, size))
    drawn = {"restitution": e.ravel(), "amplitude": amplitude_of(e, gamma).ravel()}
    found = [measured(drawn, settled(duration=5000.0), base, workers) for base in BOTH]
    kinds = [regime_of(one) for one in found]
    pairs = (kinds, [np.maximum(kind, Regime.RESTING) for kind in kinds])
    agreement = [np.mean(one == other, axis=1).reshape(e.shape) for one, other in pairs]
    common = [
        np.stack([np.count_nonzero(kind == r, axis=1) for r in range(4)])
        .argmax(axis=0)
        .reshape(e.shape)
        for kind in kinds
    ]
    keep(draw_plane(e[0], gamma[:, 0], common, agreement), "high_bounce_plane", options)
    bands = [(0.03, 0.1), (0.1, 0.3), (0.3, 1.0), (1.0, 2.0), (2.0, 6.0)]
    rows = []
    for low, high in bands:
        inside = ((gamma >= low) & (gamma < high)).ravel()
        pair = [kind[inside] for kind in kinds]
        cells = [percent(np.mean(pair[0] == pair[1]))]
        for regime in range(4):
            mine = pair[0] == regime
            cells.append(
                f"{percent(np.mean(pair[1][mine] == regime))} of {percent(mine.mean())}"
                if mine.any()
                else "none"
            )
        rows.append((f"{low:g} to {high:g}", *cells))
    return table((r"$\Gamma$", "same regime", *(f"{n} on both" for n in NAMES)), rows)


def orbit_of(e, amplitude, base, workers):
    """Phase, height and exponents of the orbit locked to one period, for a launch that locks."""
    drawn = {"restitution": np.array([e]), "amplitude": np.array([amplitude])}
    found = measured(drawn, settled(200), base, workers)
    finds = (found["cycle_impacts"][0] == 1) & (found["regime"][0] == Regime.LOCKED)
    launch = int(np.flatnonzero(finds)[0])
    landings = simulate(**drawn, launch_time=launch / 200, duration=3000.0, base=base)
    names = ("particle_rebound_height_mean", "lyapunov_largest", "lyapunov_sum")
    phase = landings["landing_time"].values[0, 0, -1] % 1.0
    return phase, *(found[name][0, launch] for name in names)


def locked(workers, _options):
    """The orbit locked to one period on both bases, in the middle of its window."""
    rows = []
    for e in (0.5, 0.7, 0.8, 0.9, 0.95):
        q = (1.0 - e) / (1.0 + e)
        gamma = (np.pi * q + np.hypot(np.pi * q, 1.0)) / 2.0
        amplitude = amplitude_of(e, gamma)
        both = [orbit_of(e, amplitude, base, workers) for base in BOTH]
        assert abs(both[1][1] / theory.locked_apex(1, e, amplitude) - 1.0) < 1e-12
        cells = (f"{still:.5f}, {moving:.5f}" for still, moving in zip(*both, strict=True))
        rows.append((e, f"{gamma:.4f}", *cells))
    head = (
        "$e$",
        r"$\Gamma$",
        "phase (turns)",
        "height (m)",
        "largest exponent",
        "sum of exponents",
    )
    return table(head, rows) + "\n\nIn each cell: fixed base, moving base. 1 Hz."


def windows(workers, _options):
    """Ends of the window of mode 1 by bisection, compared with their closed forms."""
    e = np.array([0.0, 0.05, 0.3, 0.5, 0.7, 0.9, 0.99])
    rows = [[f"{one:g}"] for one in e]
    for base in BOTH:
        scan = np.linspace(0.005, 15.0, 200)
        found = vs.windows(
            restitution=e, amplitude=scan, conditions=["locked(1)"], base=base, threads=2
        )
        one = found.isel(condition=0, direction=0, window=0)
        exact = {
            "A_min": theory.amplitude_min(1, e, base=base),
            "A_max": theory.amplitude_max(1, e, base=base),
        }
        for end, there in exact.items():
            for row, here, known, r in zip(rows, one[end].values, there, e, strict=True):
                row.append(f"{gamma_of(r, here):.9f}")
                assert abs(here / known - 1.0) < 1e-8
    head = ("e", *(f"{end}, {name} base" for name in ("fixed", "moving") for end in ("from", "to")))
    return table(head, rows)


def limit(workers, _options):
    """Convergence of the flights over both bases as Gamma goes to zero."""
    gammas = 10.0 ** np.arange(-4.0, 0.1, 0.25)
    phases = (np.arange(64) + 0.5) / 64
    e, curves = 0.9, {}
    for u in (1.5, 4.5, 10.5):
        common = {
            "restitution": e,
            "launch_velocity": u * GRAVITY / 2.0,
            "launch_time": phases,
            "duration": 5.0 * u,
        }
        times = [
            simulate(amplitude=amplitude_of(e, gammas), base=base, **common)["landing_time"].values[
                ..., :4
            ]
            for base in BOTH
        ]
        curves[u] = np.sqrt(np.mean((times[0] - times[1]) ** 2, axis=1))
    return gammas, curves


def limit_table(workers, options):
    gammas, curves = limit(workers, options)
    keep(draw_limit(gammas, curves), "high_bounce_limit", options)
    rows = []
    for u, off in curves.items():
        order = np.log(off[4] / off[0]) / np.log(gammas[4] / gammas[0])
        predicted = gammas[4] / (np.sqrt(2.0) * np.pi**2 * u)
        rows.append((u, f"{off[4, 0]:.4e}", f"{predicted:.4e}", *(f"{o:.4f}" for o in order)))
    head = (
        "u",
        rf"rms, $\Gamma = {gammas[4]:g}$",
        "first order",
        *(f"order, landing {n}" for n in range(1, 5)),
    )
    return table(head, rows)


def published(workers, options):
    """Published numbers, and the picture of the flights of the completely inelastic ball."""
    gamma = np.linspace(0.9, 10.5, 1921)
    orbit = simulate(
        restitution=0.0,
        amplitude=amplitude_of(0.0, gamma),
        contact_time=1e-6,
        launch_time=0.01,
        duration=260.0,
        base=MOVING,
    )
    landing, left = (orbit[n].values[:, 0] for n in ("landing_time", "liftoff_time"))
    flights = np.where(left[:, :-1] > 200.0, landing[:, 1:] - left[:, :-1], np.nan)
    n = np.arange(1, 4)
    marks = {
        r"$\sqrt{1 + \pi^2 n^2}$": np.hypot(1.0, np.pi * n),
        r"$\sqrt{4 + \pi^2 n^2}$": np.hypot(2.0, np.pi * n),
        r"$\sqrt{1 + z^2}$, $\tan z = z$": np.hypot(1.0, [tangent_root(one) for one in n]),
    }
    keep(draw_staircase(gamma, flights, marks), "inelastic_staircase", options)
    return literature(workers)


SECTIONS = {
    "regimes": regimes,
    "short": short,
    "plane": plane,
    "locked": locked,
    "windows": windows,
    "limit": limit_table,
    "chaos": lambda workers, _options: chaos(workers),
    "literature": published,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=1, help="of the random realizations (1)")
    parser.add_argument("--only", choices=SECTIONS, help="one table")
    parser.add_argument("--pictures", type=Path, default=IMAGES, help="where pictures go")
    parser.add_argument("--write", action="store_true", help="write the tables into the page")
    options = parser.parse_args()
    with Workers(2) as workers:
        for name in [options.only] if options.only else SECTIONS:
            began = time.perf_counter()
            text = SECTIONS[name](workers, options)
            text += f"\n\n{provenance(time.perf_counter() - began, None)}"
            write_section(name, text, PAGE) if options.write else print(text, "\n")


if __name__ == "__main__":
    main()
