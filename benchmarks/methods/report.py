"""The page that goes with the figure: what was run, the numbers, and what they say."""

from __future__ import annotations

from datetime import UTC, datetime
from importlib.metadata import version

import numpy as np

from methods import compiled, moving
from methods.scenes import MOVING_SCENES, SCENES, Point, Scene
from methods.truth import forced_phase_error
from vibrosweep.store.provenance import provenance

PACKAGES = ("numpy", "numba", "scipy", "python-flint")
OPTIONAL = {"heyoka": ("heyoka",), "diffrax": ("diffrax", "optimistix", "jax")}

INTRODUCTION = """\
# Work and precision

From one run of `python benchmarks/work_precision.py -o docs`. [All numbers](work_precision.csv).

![Run time per impact against largest landing-time error](images/work_precision.png)

**Error**: the largest of any landing, against a truth proved in ball arithmetic to
{radius:.0e} s (on the long scene: the closed form of the locked orbit). **Run time**: wall time of
a batch over its impacts, the fastest of repeated runs, without compilation.

- **kernel**: keeps statistics; **every landing**: as `vs.simulate`; **state**: count and phase as
  carried, before they become one double.
- **naive map**: a scalar numba loop with a running time and the library's sine.
- **RK4**: the study's fixed step, compiled by numba.
- **SciPy** (`solve_ivp`, RK45), **heyoka.py** (Taylor series), **diffrax** (Tsit5, `jit`, `vmap`):
  landings as terminal events, one thread. For heyoka.py flights start 1e-300 m above the base, as
  it misses events near the start.
"""

READING = """\
- SciPy, heyoka.py and diffrax integrate parabolas exactly at any tolerance: what is left is
  rounding, most of it in the running time.
- RK4, as any integrator with fixed steps, sees contact late by up to one step: observed order
  {order:.2f}. At the kernel's error it would need steps of {step:.1g} s.
- Over 10^6 impacts on a locked orbit the phase as the kernel carries it is off by at most
  {state:.1e} turns (rounding at each impact can force {forced:.1e}), the naive map by {naive:.1e}.
- In the chaotic scene all methods at their finest settings agree with the truth to {agree:.2g} s.
- Left out on the long scene: RK4 below 1e-4 s, SciPy past its first 10 000 landings, all but the
  finest tolerance of SciPy, heyoka.py and diffrax.
"""

MOVING = """\
## On the moving base

![The same on the moving base](images/work_precision_moving.png)

Tolerances matter here: SciPy takes DOP853 and diffrax Dopri8, their methods of highest order.
**scalar loop** ({threads} threads) is the kernel's search as a scalar numba loop with the library's
sine. After a rest the integrators begin 1e-5 rad later, because they find no event where neither
speed nor acceleration is left. Each method is at its finest setting; the last column is its error
at its coarsest. Errors of a large part of a period mean a lost orbit or a missed event.

| scene | method | setting | time over kernel's | error (s) | kernel's | coarsest |
|---|---|---|---|---|---|---|
{rows}
"""

ORIGIN = """\
*{when}, {cpu}, {threads} threads, load {load[0]:.1f} before and {load[1]:.1f} at the end of \
{minutes:.0f} minutes; {source}, Python {python}, {versions}.{missing}*
"""


def report(
    points: list[Point],
    missing: list[str],
    radius: float,
    threads: int,
    load: tuple[float, float],
    minutes: float,
) -> str:
    """The whole page, in Markdown."""
    parts = [
        INTRODUCTION.format(radius=radius),
        _scenes(),
        _locked(points),
        _reading(points),
        _moving(points),
        _origin(missing, threads, load, minutes),
    ]
    return "\n".join(parts)


def _origin(missing: list[str], threads: int, load: tuple[float, float], minutes: float) -> str:
    packages = [*PACKAGES, *(p for name, ps in OPTIONAL.items() if name not in missing for p in ps)]
    source = provenance(threads)
    return ORIGIN.format(
        when=datetime.now(UTC).date().isoformat(),
        cpu=source["cpu"],
        source=source["source"],
        python=source["python"],
        versions=", ".join(f"{name} {version(name)}" for name in packages),
        threads=threads,
        load=load,
        minutes=minutes,
        missing=f" Not installed, therefore absent: {', '.join(missing)}." if missing else "",
    )


def _scenes() -> str:
    rows = "\n".join(_scene_row(scene) for scene in (*SCENES, *MOVING_SCENES))
    return f"""\
Scenes, at 1 Hz, launched at {SCENES[0].parameters["launch_velocity"]:g} m/s:

| scene | e | A (m/s) | base, law | launched between (s) |
|---|---|---|---|---|
{rows}
"""


def _scene_row(scene: Scene) -> str:
    p = scene.parameters
    law = "moving" if scene.base == "moving" else f"high-bounce, `{scene.rebound}`"
    return (
        f"| {scene.title} | {p['restitution']:g} | {p['amplitude']:g} | {law} | "
        f"{scene.span[0]:g} and {scene.span[1]:g} |"
    )


def _of(points: list[Point], scene: str, method: str) -> list[Point]:
    """Points of a method on all its threads, coarsest setting first."""
    found = [p for p in points if (p.scene, p.method) == (scene, method)]
    most = max(p.threads for p in found)
    return [p for p in found if p.threads == most]


def _locked(points: list[Point]) -> str:
    kernels = {p.threads: p for p in points if (p.scene, p.method) == ("locked", compiled.KERNEL)}
    rows = []
    for method in dict.fromkeys(p.method for p in points if p.scene == "locked"):
        found = _of(points, "locked", method)
        if method != compiled.KERNEL_STATE:
            shown = found if method == compiled.RK4 else found[:1]
            rows += [_ratio_row(p, kernels[p.threads]) for p in shown]
    table = "\n".join(rows)
    return f"""\
## On the locked scene

Each method at its first setting, RK4 at every step; times also over the kernel's on as many
threads:

| | setting | ns per impact | over kernel's | error (s) |
|---|---|---|---|---|
{table}
"""


def _ratio_row(p: Point, kernel: Point) -> str:
    return (
        f"| {p.method} | {p.setting} | {p.ns_per_impact:.3g} | "
        f"{p.ns_per_impact / kernel.ns_per_impact:.2g} | {p.error:.1e} |"
    )


def _reading(points: list[Point]) -> str:
    (kernel,) = _of(points, "locked", compiled.KERNEL)
    rk4 = _of(points, "locked", compiled.RK4)
    steps, errors = (np.log10([getattr(p, name) for p in rk4]) for name in ("step", "error"))
    (scene,) = (scene for scene in SCENES if scene.key == "long")
    (state,) = _of(points, "long", compiled.KERNEL_STATE)
    (naive,) = _of(points, "long", compiled.NAIVE)
    finest = {p.method: p.error for p in points if p.scene == "chaotic"}
    return READING.format(
        order=np.polyfit(steps, errors, 1)[0],
        step=rk4[-1].step * kernel.error / rk4[-1].error,
        state=state.error,
        forced=forced_phase_error(scene),
        naive=naive.error,
        agree=max(finest.values()),
    )


def _moving(points: list[Point]) -> str:
    rows = []
    for scene in MOVING_SCENES:
        here = [p for p in points if p.scene == scene.key]
        kernels = {p.threads: p for p in here if p.method == compiled.KERNEL}
        title = scene.title  # on the first row of the scene
        for method in dict.fromkeys(p.method for p in here):
            if method in (compiled.KERNEL, compiled.KERNEL_STATE, compiled.KERNEL_RECORD):
                continue
            found = _of(points, scene.key, method)
            kernel, fine = kernels[found[-1].threads], found[-1]
            coarse = f"{found[0].error:.1e}" if len(found) > 1 else "-"
            rows.append(
                f"| {title} | {method} | {fine.setting} | "
                f"{fine.ns_per_impact / kernel.ns_per_impact:.3g} | {fine.error:.1e} | "
                f"{kernel.error:.1e} | {coarse} |"
            )
            title = ""
    (scalar, *_) = _of(points, MOVING_SCENES[0].key, moving.SCALAR)
    return MOVING.format(threads=scalar.threads, rows="\n".join(rows))
