"""Bunching and staggering of particles on a base of finite mass.

    python checks/ordering.py [--only NAME] [--pictures FOLDER] [--write]

Draws the pictures of study/ordering.md and prints its tables in full; --write replaces them by
short ones.
"""

from __future__ import annotations

import argparse
import itertools
import time
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from PIL import Image

from accuracy import provenance, table, write_section
from one_slot import pair_gaps, pattern, pattern_orbit
from vibrosweep import simulate
from vibrosweep.errors import ParameterError
from vibrosweep.figures import style
from vibrosweep.theory import sprung as coupled_theory
from vibrosweep.theory.sprung import CoupledBase, spectral_radius, staggered, steepness

# Scenes that ordering.py computes with the engine, and the outcomes of their particles.

E, GAMMA, GRAVITY = 0.9, 0.6, 9.81
STAGGERED, BUNCHED, OTHER, UNLOCKED, DEAD = range(5)
WINDOW = 40.0  # periods at the end in which an outcome is judged
CONTACT_TIME = 1e-2  # s; the shorter, the longer particles chatter before they rest
NEAR = 0.3  # periods by which flights of a bunch may differ from their mode


def scene(launch, mass_ratio, natural, damping, k=2, duration=400.0):
    """Every landing, times in periods; mass_ratio and natural are arrays over realizations."""
    return simulate(
        base="sprung",
        restitution=E,
        base_acceleration=GAMMA,
        launch_velocity=k * GRAVITY / 2.0,
        launch_time=np.asarray(launch),
        mass_ratio=np.asarray(mass_ratio),
        mount_frequency=np.asarray(natural),
        mount_damping=damping,
        contact_time=CONTACT_TIME,
        duration=duration,
    )


def phase_of(k, mass_ratio=0.0, natural=0.37, damping=0.05):
    """Phase of landing of a single particle in mode k."""
    return float(coupled_theory.landing_phase(GAMMA, k, E, mass_ratio, natural, damping))


def modes(landings):
    """Mode in which each particle is locked at the end; 0 if it is in none, -1 if it lands no more.

    Returns
    -------
    mode, last
        Shape (realization, particle): mode, and time of the last landing.
    """
    times, rested = landings["landing_time"].values, landings["rested"].values
    late = times > float(landings["duration"]) - WINDOW
    last = np.nanmax(np.where(late, times, -np.inf), axis=-1)
    flights = np.where(late[..., :-1], np.diff(times, axis=-1), np.nan)
    count = np.maximum(np.isfinite(flights).sum(axis=-1), 1)
    mode = np.rint(np.nansum(flights, axis=-1) / count)
    off = np.abs(flights - mode[..., np.newaxis])
    held = ~(off > NEAR).any(axis=-1) & ~(late & (rested == 1)).any(axis=-1) & (mode > 0)
    return np.where(np.isfinite(last), np.where(held, mode, 0), -1), last


def outcomes(landings, k=2):
    """Final state of the particles of each realization; shape (realization,).

    Staggered: all in mode k, equally many in each slot; bunched: all in one slot.
    """
    mode, last = modes(landings)
    middle = phase_of(k) - 0.5  # a slot begins half a period before the landings
    slot = np.floor(np.where(np.isfinite(last), last, 0.0) - middle) % k
    found = np.full(mode.shape[0], UNLOCKED)
    found[(mode == -1).all(axis=1)] = DEAD
    found[(mode > 0).all(axis=1)] = OTHER
    in_mode = (mode == k).all(axis=1)
    even = (np.array([(slot == one).sum(axis=1) for one in range(k)]) == slot.shape[1] / k).all(
        axis=0
    )
    found[in_mode & even] = STAGGERED
    found[in_mode & (slot == slot[:, :1]).all(axis=1)] = BUNCHED
    return found


# Pictures of study/ordering.md.

KINDS = ("staggered", "bunched", "other modes", "not locked", "at rest")
OF_KIND = (style.OKABE_ITO[0], style.OKABE_ITO[1], style.OKABE_ITO[5], "0.85", "0.45")


@mpl.rc_context(style.RC)
def draw_stability(natural, load, panels):
    """Spectral radius of staggered orbits over natural frequency and mass, with resonances."""
    figure = Figure(figsize=(style.PAGE, 5.0), layout="constrained")
    grid = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, (k, particles, damping, values, tips) in zip(grid.flat, panels, strict=True):
        drawn = axes.pcolormesh(
            natural, load, values, cmap="RdBu_r", vmin=0.9, vmax=1.1, rasterized=True
        )
        axes.contour(natural, load, values, [1.0], colors="k", linewidths=0.8)
        axes.plot(tips, np.full(tips.shape, load[0]), "^", color="k", markersize=5, clip_on=False)
        many = "one particle" if particles == 1 else f"{particles} particles in {k} slots"
        axes.set_title(f"{many}, $k = {k}$, $\\zeta = {damping:g}$")
        axes.set(xscale="log", yscale="log")
    for axes in grid[1]:
        axes.set_xlabel("natural frequency of the mount $f_0/f$")
    for axes in grid[:, 0]:
        axes.set_ylabel("mass of all particles $N\\mu$")
    bar = figure.colorbar(drawn, ax=grid, extend="both")
    bar.set_label("spectral radius per period")
    return figure


@mpl.rc_context(style.RC)
def draw_attractors(natural, load, maps, edge):
    """Commonest outcome over natural frequency and mass, with the limit of linear stability."""
    figure = Figure(figsize=(style.PAGE, 3.0), layout="constrained")
    panels = figure.subplots(1, len(maps), sharex=True, sharey=True)
    codes = {"cmap": ListedColormap(OF_KIND), "norm": BoundaryNorm(np.arange(6) - 0.5, 5)}
    for axes, (words, kinds) in zip(panels, maps.items(), strict=True):
        drawn = axes.pcolormesh(natural, load, kinds, rasterized=True, **codes)
        axes.contour(natural, load, np.nan_to_num(edge, nan=9.0), [1.0], colors="k", linewidths=0.8)
        axes.set(xscale="log", yscale="log", title=words)
        axes.set_xlabel("natural frequency $f_0/f$")
    panels[0].set_ylabel("mass of both particles $2\\mu$")
    figure.colorbar(drawn, ax=panels, ticks=range(5)).ax.set_yticklabels(KINDS)
    return figure


@mpl.rc_context(style.RC)
def draw_phases(cases, times, slot):
    """Phase of every landing against time, one panel for each case; colours by slot of launch."""
    figure = Figure(figsize=(style.PAGE, 5.6), layout="constrained")
    panels = figure.subplots(len(cases), 1, sharex=True, sharey=True)
    for axes, (load, natural), landings in zip(panels, cases, times, strict=True):
        for own, place in zip(landings, slot, strict=True):
            colour = style.OKABE_ITO[place]
            axes.plot(own, own % 1.0, ".", markersize=2.0, color=colour, rasterized=True)
        axes.set_title(f"$N\\mu = {load:g}$, $f_0/f = {natural:g}$")
        axes.set_ylim(0.15, 0.65)
    figure.supylabel("phase of landing (turns)", fontsize=9.0)
    panels[-1].set_xlabel("time (forcing periods)")
    return figure


# Tables and pictures.

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "study" / "ordering.md"
IMAGES = ROOT / "study" / "images"
LARGEST = 0.3  # mass of all particles in units of that of the base
BANDS = (1e-3, 1e-2, 3e-2, 1e-1, LARGEST)
PIECE = 150  # realizations at a time
COLOURS = 256  # of a picture
LOAD, FREQUENCY, DAMPING = r"$N\mu$", r"$f_0/f$", r"$\zeta$"  # in heads of tables
ORBIT = ("$k$", "particles", DAMPING)


def percent(share):
    return f"{100 * share:.0f} %"


def keep(figure, name, options):
    """Write a picture with few colours, which makes it smaller."""
    path = options.pictures / f"{name}.png"
    figure.savefig(path, dpi=150)
    Image.open(path).convert("RGB").quantize(COLOURS).save(path, optimize=True)


def turn(k):
    """Angle of the multipliers of mode k on a base of infinite mass, in turns."""
    cosine = (1.0 + E * E - (1.0 + E) ** 2 * steepness(k, E, GAMMA)) / (2.0 * E)
    return np.arccos(cosine) / (2.0 * np.pi)


def radius(load, natural, damping, k, particles):
    """Spectral radius of evenly spaced particles of total mass `load`; NaN if there is no orbit."""
    base = CoupledBase(E, GAMMA, load / particles, natural, damping)
    try:
        return spectral_radius(staggered(base, k, np.arange(0, k, k // particles)))
    except ParameterError:
        return np.nan


def largest_stable(natural, damping, k, particles):
    """Mass of all particles up to which the staggered orbit is stable, to a relative 1e-4."""
    loads = np.geomspace(1e-4, LARGEST, 60)
    found = (radius(load, natural, damping, k, particles) for load in loads)
    first = next((i for i, one in enumerate(found) if not one <= 1.0), None)
    if first is None:
        return LARGEST
    low, high = loads[max(first - 1, 0)], loads[first]
    while high > 1.0001 * low:
        middle = np.sqrt(low * high)
        stable = radius(middle, natural, damping, k, particles) <= 1.0
        low, high = (middle, high) if stable else (low, middle)
    return low


def short(rows, options, chosen):
    """All rows, or, for the page, those that are chosen."""
    return [row for row in rows if chosen(row)] if options.write else rows


def resonances(options):
    """First loss of stability of the staggered orbits, compared with the rule of resonance."""
    rows = []
    cases = ((1, 1, 0.05), (2, 1, 0.05), (2, 2, 0.05), (2, 2, 0.02), (3, 3, 0.05))
    for k, particles, damping in cases:
        for n in range(3):
            rule = (n + turn(k)) / k
            near = rule + np.linspace(-0.04, 0.04, 17) / k
            stable = [largest_stable(one, damping, k, particles) for one in near]
            least = int(np.argmin(stable))
            found = (f"{rule:.3f}", f"{near[least]:.3f}", f"{stable[least]:.4f}")
            rows.append((k, particles, damping, *found))
    head = (*ORBIT, f"{FREQUENCY} by the rule", f"{FREQUENCY} found", f"stable up to {LOAD}")
    return table(head, short(rows, options, lambda row: row[0] == row[1] < 3))


def stability(options):
    """Picture of where staggered orbits exist and attract."""
    natural, load = np.geomspace(0.05, 4.0, 200), np.geomspace(1e-3, LARGEST, 80)
    panels, rows = [], []
    for k, particles, damping in ((1, 1, 0.05), (2, 1, 0.05), (2, 2, 0.05), (2, 2, 0.5)):
        values = np.array([[radius(m, f, damping, k, particles) for f in natural] for m in load])
        exists, attracts = np.isfinite(values).mean(), (values < 1.0).mean()
        rows.append((k, particles, damping, percent(exists), percent(attracts / exists)))
        tips = (np.arange(9) + turn(k)) / k
        panels.append((k, particles, damping, values, tips[tips < natural[-1]]))
    keep(draw_stability(natural, load, panels), "ordering_stability", options)
    return table((*ORBIT, "orbit exists", "of these, attracts"), rows)


PATTERNS = {"two": [[0, 1], [1, 0]], "three": [[1, 0], [0, 1], [1, 0]]}


def exact_gaps(k, mass_ratio, rank):
    """Gaps of a pattern of two particles to first order and on the exact orbit, and its radius."""
    base = CoupledBase(E, GAMMA, mass_ratio, 0.37, 0.05)
    first = np.abs(np.diff(pattern(base, k, rank), axis=1))[:, 0]
    cycle = pattern_orbit(base, k, rank)
    return np.sort(first), pair_gaps(cycle), spectral_radius(cycle)


def separations(options):
    """Gaps of two particles in one slot: first order, exact orbits, and simulated orbits."""
    rows, launches = [], np.geomspace(5e-4, 0.2, 24)
    for k in (1, 2):
        mass_ratios = np.array([1e-4, 1e-3, 1e-2])
        seen = {}
        for apart in launches:
            launch = phase_of(k) + np.array([0.0, apart])
            times = scene(launch, mass_ratios, 0.37, 0.05, k, 600.0 * k)["landing_time"].values
            for mu, pair in zip(mass_ratios, times, strict=True):
                landed = np.isfinite(pair).all(axis=0)
                seen.setdefault(mu, []).append(np.abs(pair[1] - pair[0])[landed][-6:])
        for mu, (name, rank) in itertools.product(mass_ratios, PATTERNS.items()):
            first, exact, radius_of = exact_gaps(k, mu, rank)
            repeated = np.sort(np.tile(exact, 6 // exact.size))
            off = [np.abs(np.sort(gaps) - repeated).max() for gaps in seen[mu]]
            hits = [one for one in off if one < 0.05 * exact[0]]
            worst = f"{max(hits):.0e}" if hits else "not reached"
            words = (", ".join(f"{g:.5f}" for g in gaps) for gaps in (first, exact))
            share = f"{len(hits)} of {len(off)}"
            rows.append((k, f"{mu:g}", name, *words, f"{radius_of:.3f}", worst, share))
    head = (
        "$k$",
        r"$\mu$",
        "pattern of",
        "gaps, first order",
        "gaps, exact orbit",
        "spectral radius",
        "simulated: off by",
        "launches",
    )
    return table(head, short(rows, options, lambda row: row[1] != "0.0001"))


def settle(launch, load, natural, damping=0.05):
    """Outcome over a grid of mass and natural frequency, some realizations at a time."""
    found, particles = [], len(launch)
    for start in range(0, load.size, PIECE):
        piece = slice(start, start + PIECE)
        mass_ratio = load[piece] / particles
        landings = scene(launch, mass_ratio, natural[piece], damping, duration=250.0)
        found.append(outcomes(landings))
    return np.concatenate(found)


def attractors(options):
    """Final states of two particles of mode 2, from different slots, one slot and anywhere."""
    natural, load = np.geomspace(0.1, 3.0, 32), np.geomspace(1e-3, LARGEST, 20)
    grid = [axis.ravel() for axis in np.meshgrid(natural, load)]
    x = phase_of(2)
    random = np.random.default_rng(1).uniform(0.0, 2.0, (3, 2))
    starts = {
        "launched into different slots": [(x + 0.02, x + 0.99)],
        "launched into one slot": [(x, x + 0.02)],
        "launched anywhere": list(np.sort(random, axis=1)),
    }
    maps, rows = {}, []
    for words, launches in starts.items():
        each = np.array([settle(launch, grid[1], grid[0]) for launch in launches])
        counts = np.array([(each == kind).sum(axis=0) for kind in range(5)])
        maps[words] = counts.argmax(axis=0).reshape(load.size, natural.size)
        for low, high in itertools.pairwise(BANDS):
            inside = (grid[1] >= low) & (grid[1] < high)
            shares = counts[:, inside].sum(axis=1) / (inside.sum() * len(launches))
            rows.append((words, f"{low:g} to {high:g}", *(percent(share) for share in shares)))
    edge = np.array([[radius(m, f, 0.05, 2, 2) for f in natural] for m in load])
    keep(draw_attractors(natural, load, maps, edge), "ordering_attractors", options)
    head = ("two particles", LOAD, *KINDS)
    return table(head, rows)


def crowds(options):
    """Count realizations of more particles and other dampings that stay as they were launched."""
    axes = np.geomspace(0.1, 3.0, 20), np.geomspace(1e-3, LARGEST, 12)
    natural, load = (axis.ravel() for axis in np.meshgrid(*axes))
    rows = []
    for kind, particles, damping in itertools.product(
        (STAGGERED, BUNCHED), (2, 6, 20), (0.01, 0.05, 0.2, 0.8)
    ):
        slot = np.arange(particles) % 2 if kind == STAGGERED else 0
        launch = phase_of(2) + np.linspace(-0.03, 0.03, particles) + slot
        stays = settle(launch, load, natural, damping) == kind
        shares = (
            percent(stays[(load >= low) & (load < high)].mean())
            for low, high in itertools.pairwise(BANDS)
        )
        rows.append((KINDS[kind], particles, damping, *shares))
    bands = (f"{LOAD} {low:g} to {high:g}" for low, high in itertools.pairwise(BANDS))
    rows = short(rows, options, lambda row: row[1] != 6 and row[2] in (0.05, 0.8))
    return table(("launched and stays", "$N$", DAMPING, *bands), rows)


def phases(options):
    """Picture of the phase of every landing against time, three particles in each of two slots."""
    cases = ((0.0, 0.37), (0.012, 0.37), (0.03, 0.37), (0.03, 0.62))
    slot = np.arange(6) % 2
    launch = phase_of(2) + slot + 0.03 * (np.arange(6) - 2.5)
    rows, times = [], []
    for load, natural in cases:
        one = scene(launch, [load / 6], natural, 0.05, duration=300.0)
        times.append(one["landing_time"].values[0])
        mode, _ = modes(one)
        late = np.sort(times[-1][times[-1] > 298.0])
        spread = np.ptp(late[(late % 2.0) < 1.0]) if (mode == 2).all() else np.nan
        counts = (np.count_nonzero(mode == k) for k in (2, 1, 0, -1))
        width = "" if np.isnan(spread) else f"{spread:.3f}"
        rows.append((f"{load:g}", natural, *counts, width))
    keep(draw_phases(cases, times, slot), "ordering_phases", options)
    head = (LOAD, FREQUENCY, "locked to 2", "to 1", "not locked", "at rest", "width of a bunch")
    return table(head, rows)


SECTIONS = {
    "separations": separations,
    "stability": stability,
    "resonances": resonances,
    "attractors": attractors,
    "crowds": crowds,
    "phases": phases,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--only", choices=SECTIONS, help="one table")
    parser.add_argument("--pictures", type=Path, default=IMAGES, help="where pictures go")
    parser.add_argument("--write", action="store_true", help="write the tables into the page")
    options = parser.parse_args()
    for name in [options.only] if options.only else SECTIONS:
        began = time.perf_counter()
        text = SECTIONS[name](options)
        text += f"\n\n{provenance(time.perf_counter() - began, None)}"
        write_section(name, text, PAGE) if options.write else print(text, "\n", flush=True)


if __name__ == "__main__":
    main()
