"""The page on work and precision: the problems, the methods, the numbers and conclusions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from accuracy import table
from methods import compiled
from methods.finals import Reference, Row
from methods.flights import SCIPY
from methods.scenes import SCENES, Scene

PAGE = """\
# Work and precision

Nine fixed problems: the map, the moving base, the base of finite mass, two tones, noise. Three
steps of `python benchmarks/work_precision.py`, each of which reads only what the one before stored:

1. `prove`: the time of the last landing of each particle up to the end, proved in ball arithmetic,
   with 34 digits, off by {radius} s at most (`benchmarks/references.csv`).
2. `time`: the times that each method finds for these landings, and its processor time; each row
   names processor, date, settings, threads, precision and versions (`benchmarks/finals.csv`).
3. `compare`: the differences between the two, in exact arithmetic; it writes this page and
   [all rows](work_precision.csv).

![Processor time per landing against the error of the last landing](images/work_precision.png)

**Error**: the largest error of the particles' last landings. **Processor time**: of one
thread, per landing; the median of runs that fill a second, without compilation, on a machine that
had other work. Nothing is skipped (`skip = false`).

- **kernel**: keeps statistics only; **every landing**: keeps all landings, as `vs.simulate` does.
- **naive map**, **scalar loop**: plain numba with a running time and the library's sine. Where the
  base moves, the loop searches for one landing after the other.
- **RK4**: the study's fixed step, compiled by numba.
- **SciPy** (`solve_ivp`), **heyoka.py** (Taylor series), **diffrax** (`jit`, `vmap`): landings as
  terminal events. In heyoka.py and diffrax flights start 1e-300 m above the base, because an event
  needs a change of sign. After a rest on the moving base the integrators begin 1e-5 rad later,
  because they find no landing from a state without relative speed and acceleration.

| problem | e | A (m/s) | base, law | launched between (s) | particles |
|---|---|---|---|---|---|
{scenes}

On the base of finite mass the mass ratio is {mass_ratio:g}, the mount's frequency
{mount_frequency:g} Hz and its damping ratio {mount_damping:g}; {realizations} realizations are
timed. The launches were chosen so that no particle rests there: the program for SciPy omits rests.
The tones are `[[1, 1.0, 0.0], [2, 0.4, 1.1]]`. The noise is `kick_noise = {kick_noise:g}` (m/s) of
seed 0 and stream 0. Its deviates are stored with the references: the kernel draws them itself,
the other methods are given them.

{absent}

## Each method at its finest setting

{finest}

- Over a base at rest integrators step along parabolas exactly at any tolerance: only
  rounding remains, most of it in the running time. Where the base moves, tolerances count. Errors
  of a large part of a period mean a lost orbit; "missed": fewer landings were found than there are.
- RK4, like any integrator with fixed steps, sees contact late by up to one step: its observed order
  is {order:.2f} on the locked problem.
- A rest erases the errors before it: where particles rest, the error of the last landing makes all
  methods look better than they are.

*{origin}*
"""

ABSENT = """\
Without a row, because the programs used here do not support them: {gaps}.
The program for heyoka.py follows one particle over a base without recoil; the compiled loop of
diffrax takes the sine only, and no random numbers."""


def report(rows: Sequence[Row], references: Mapping[str, Sequence[Reference]]) -> str:
    """The whole page, in Markdown."""
    sprung, noise = (scene for scene in SCENES if scene.key in ("sprung", "noise"))
    return PAGE.format(
        **{**sprung.parameters, **noise.parameters},
        realizations=sprung.realizations,
        radius=max((r.radius for kept in references.values() for r in kept), key=float),
        scenes="\n".join(_scene_row(scene) for scene in SCENES),
        absent=_absent(rows),
        finest=_finest(rows),
        order=_order(rows),
        origin=_origin(rows),
    )


def _scene_row(scene: Scene) -> str:
    p = scene.parameters
    base = f"{scene.base}, `{scene.rebound}`"
    return (
        f"| {scene.title} | {p['restitution']:g} | {p['amplitude']:g} | {base} | "
        f"{scene.span[0]:g} and {scene.span[1]:g} | {scene.proved} |"
    )


def _absent(rows: Sequence[Row]) -> str:
    """Say which integrators are missing from which problems."""
    gaps = []
    for method in (SCIPY, "heyoka.py", "diffrax"):
        there = {row["scene"] for row in rows if row["method"] == method}
        gone = [scene.title for scene in SCENES if scene.key not in there]
        titles = [title.partition(",")[0].lower() for title in gone]
        gaps += [f"{method} ({', '.join(titles)})"] if titles else []
    return ABSENT.format(gaps="; ".join(gaps))


def _finest(rows: Sequence[Row]) -> str:
    lines = []
    for scene in SCENES:
        here = [row for row in rows if row["scene"] == scene.key]
        (kernel,) = (row for row in here if row["method"] == compiled.KERNEL)
        title = scene.title  # on the first row of the scene
        for method in dict.fromkeys(row["method"] for row in here):
            *coarser, fine = (row for row in here if row["method"] == method)
            ratio = float(fine["ns_per_impact"]) / float(kernel["ns_per_impact"])
            errors = [_error(fine), _error(coarser[0]) if coarser else "-"]
            time = f"{float(fine['ns_per_impact']):.3g}"
            lines.append([title, method, fine["setting"], time, f"{ratio:.3g}", *errors])
            title = ""
    head = [
        "problem",
        "method",
        "setting",
        "ns per landing",
        "over kernel's",
        "error (s)",
        "coarsest",
    ]
    return table(head, lines)


def _error(row: Row) -> str:
    error = float(row["last_landing_error_s"])
    return f"{error:.1e}" if np.isfinite(error) else "missed"


def _order(rows: Sequence[Row]) -> float:
    rk4 = [row for row in rows if (row["scene"], row["method"]) == ("locked", compiled.RK4)]
    steps = [float(row["setting"].split()[1]) for row in rk4]
    errors = [float(row["last_landing_error_s"]) for row in rk4]
    return float(np.polyfit(np.log10(steps), np.log10(errors), 1)[0])


def _origin(rows: Sequence[Row]) -> str:
    """Processors and dates, and the versions of all methods."""
    by_place: dict[tuple[str, str], dict[str, None]] = {}
    for row in rows:
        versions = by_place.setdefault((row["date"], row["processor"]), {})
        versions.update(dict.fromkeys(row["versions"].split(", ")))
    return "; ".join(
        f"{date}, {cpu}, one thread: {', '.join(versions)}"
        for (date, cpu), versions in by_place.items()
    )
