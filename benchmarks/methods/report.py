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

Run time per impact and error of landing times, from one run of
`python benchmarks/work_precision.py -o docs`. [All numbers](work_precision.csv).

![Run time per impact against largest landing-time error](images/work_precision.png)

**Error**: the largest distance of any landing from the true one, over several trajectories. The
truth is proved in ball arithmetic, to {radius:.0e} s; on the long scene it is the closed form of
the locked orbit. **Run time**: wall time of a batch over its impacts, the fastest of repeated runs,
without compilation; slow methods get fewer trajectories.

Run on {when} on {cpu} with {threads} threads; the load of the machine was {load[0]:.1f} before and
{load[1]:.1f} at the end of {minutes:.0f} minutes. {source}, Python {python}, {versions}.{missing}

## Methods

| method | threads | |
|---|---|---|
| **kernel** | {threads} and 1 | the streaming kernel, which keeps statistics; \
its landings are those of the recording kernel, \
after a check that both follow the same orbits |
| **kernel, every landing** | {threads} | as `vibrosweep.simulate` does it, in two passes |
| **kernel, state** | {threads} | count and phase as carried, \
before they become one double |
| **naive map** | {threads} | a scalar numba loop with a running time and the library's sine |
| **RK4** | {threads} | the study's scheme, `vibrosweep.study.rk4`, compiled by numba |
| **SciPy** | 1 | `solve_ivp`, RK45, one call per flight, landing as a terminal event |
| **heyoka.py** | 1 | Taylor series compiled by LLVM, landing as a terminal event. \
Flights start 1e-300 m above the base, and the cooldown is 0, as events near the start are \
missed otherwise; one still missed is sought with half the step |
| **diffrax** | 1 | Tsit5, landing as an event with Newton's method, `jit` and `vmap` |

SciPy and diffrax start the clock of each flight at its lift-off, which favours them.
"""

READING = """\
## What limits each method

- A flight of the map is a parabola, which SciPy, heyoka and diffrax integrate exactly at any
  tolerance: what is left is rounding, most of it in the running time.
- On the long scene the kernel's landing times are as accurate as a double that holds 1e6 s.
- In the resting scene RK4 needs a step well below the contact time of 1e-4 s.
- In the chaotic scene any error grows within a few impacts; at their finest settings all methods
  agree with the truth to {agree:.2g} s. With {short} impacts each, filling and emptying the
  kernel's lanes costs more than the impacts do.
- Left out for their run time: on the long scene RK4 below 1e-4 s, SciPy past its first 10 000
  landings, and all but the finest tolerance of SciPy, heyoka and diffrax.
"""


MOVING = """\
## On the moving base

![The same on the moving base](images/work_precision_moving.png)

All methods integrate height and velocity relative to the base, with tolerances that matter here:
SciPy takes DOP853 and diffrax Dopri8, their methods of highest order. **scalar loop** ({threads}
threads) is the kernel's search as a scalar numba loop with the library's sine. After a rest SciPy,
heyoka and diffrax begin 1e-5 rad of phase later, because they find no event where neither speed nor
acceleration is left.

Each method against the kernel on as many threads, at its finest setting; the last column is its
error at its coarsest. Errors of a large part of a period mean a lost orbit or a missed event. The
kernel's search cannot miss a landing ([accuracy](accuracy.md)).

| scene | method | setting | threads | time over kernel's | error (s) | kernel's | coarsest |
|---|---|---|---|---|---|---|---|
{rows}
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
        _introduction(missing, radius, threads, load, minutes),
        _scenes(),
        _ratios(points),
        _others(points),
        _order(points),
        _long(points),
        _reading(points),
        _moving(points),
    ]
    return "\n".join(parts)


def _introduction(
    missing: list[str], radius: float, threads: int, load: tuple[float, float], minutes: float
) -> str:
    packages = [*PACKAGES, *(p for name, ps in OPTIONAL.items() if name not in missing for p in ps)]
    source = provenance(threads)
    return INTRODUCTION.format(
        radius=radius,
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
## Scenes

1 Hz, launched at {SCENES[0].parameters["launch_velocity"]:g} m/s.

| scene | e | A (m/s) | base, law | launched between (s) | landings up to (s) |
|---|---|---|---|---|---|
{rows}
"""


def _scene_row(scene: Scene) -> str:
    p = scene.parameters
    law = "moving" if scene.base == "moving" else f"high-bounce, `{scene.rebound}`"
    return (
        f"| {scene.title} | {p['restitution']:g} | {p['amplitude']:g} | {law} | "
        f"{scene.span[0]:g} and {scene.span[1]:g} | {scene.duration:g} |"
    )


def _of(points: list[Point], scene: str, method: str) -> list[Point]:
    """Points of a method on all its threads, coarsest setting first."""
    found = [p for p in points if (p.scene, p.method) == (scene, method)]
    most = max(p.threads for p in found)
    return [p for p in found if p.threads == most]


def _ratios(points: list[Point]) -> str:
    (kernel,) = _of(points, "locked", compiled.KERNEL)
    (kept,) = _of(points, "locked", compiled.KERNEL_RECORD)
    rk4 = _of(points, "locked", compiled.RK4)
    coarse, fine = rk4[0], rk4[-1]
    off = fine.error / kernel.error
    cheap = coarse.ns_per_impact / kernel.ns_per_impact
    period = coarse.step * cheap
    rows = "\n".join(_ratio_row(p, kernel) for p in (kernel, kept, *rk4))
    return f"""\
## Kernel against RK4 on the locked scene

{kernel.threads} threads each.

| | step | ns per impact | largest error (s) | time over kernel's | error over kernel's |
|---|---|---|---|---|---|
{rows}

At the kernel's error RK4, of first order, would need steps of {fine.step / off:.1g} s, too short
for times of 200 s in double precision. In the kernel's time it could make one step of
{period:.2g} s per impact, longer than the flight. Against the kernel that records every landing,
the ratios of time are {coarse.ns_per_impact / kept.ns_per_impact:.2g} to \
{fine.ns_per_impact / kept.ns_per_impact:.2g}.
"""


def _ratio_row(p: Point, kernel: Point) -> str:
    step = p.setting if p.method == compiled.RK4 else "-"
    return (
        f"| {p.method} | {step} | {p.ns_per_impact:.3g} | {p.error:.2e} | "
        f"{p.ns_per_impact / kernel.ns_per_impact:.3g} | {p.error / kernel.error:.2g} |"
    )


def _others(points: list[Point]) -> str:
    locked = {(p.method, p.threads): p for p in reversed(points) if p.scene == "locked"}
    rows = []
    for (method, threads), p in reversed(locked.items()):
        if method not in (compiled.KERNEL, compiled.KERNEL_STATE, compiled.RK4):
            kernel = locked[compiled.KERNEL, threads]
            rows.append(
                f"| {method} | {p.setting} | {threads} | "
                f"{p.ns_per_impact / kernel.ns_per_impact:.2g} | {p.error / kernel.error:.2g} |"
            )
    table = "\n".join(rows)
    return f"""\
## The other methods on the locked scene

Each against the kernel on as many threads, at its first setting.

| | setting | threads | time over kernel's | error over kernel's |
|---|---|---|---|---|
{table}
"""


def _order(points: list[Point]) -> str:
    rk4 = _of(points, "locked", compiled.RK4)
    steps = np.log10([p.step for p in rk4])
    errors = np.log10([p.error for p in rk4])
    fitted = np.polyfit(steps, errors, 1)[0]
    between = ", ".join(f"{order:.2f}" for order in np.diff(errors) / np.diff(steps))
    return f"""\
## Order of RK4 in its step

Observed on the locked scene: **{fitted:.2f}** over all steps; {between} from each step to the next
finer one. The scheme is exact on a parabola, but sees contact late by up to one step h, with the
speed too large by up to g h, as would any integrator of higher order.
"""


def _long(points: list[Point]) -> str:
    (scene,) = (scene for scene in SCENES if scene.key == "long")
    (kernel,) = _of(points, "long", compiled.KERNEL)
    (state,) = _of(points, "long", compiled.KERNEL_STATE)
    (naive,) = _of(points, "long", compiled.NAIVE)
    forced = forced_phase_error(scene)
    return f"""\
## A locked orbit over 10^6 impacts

| | largest phase error (turns) |
|---|---|
| kernel, phase as it is carried | {state.error:.2e} |
| kernel, rounded to one double of time | {kernel.error:.2e} |
| naive map, running double t | {naive.error:.2e} |

Rounding phase and flight time once per impact can by itself force an error of up to {forced:.1e}
turns on this orbit; the kernel's exceeds that by {max(0.0, state.error - forced):.1g} turns.
"""


def _reading(points: list[Point]) -> str:
    finest = {p.method: p for p in points if p.scene == "chaotic"}
    kernel = finest[compiled.KERNEL]
    return READING.format(
        agree=max(p.error for p in finest.values()),
        short=round(kernel.impacts / kernel.trajectories),
    )


def _moving(points: list[Point]) -> str:
    rows = []
    for scene in MOVING_SCENES:
        here = [p for p in points if p.scene == scene.key]
        kernels = {p.threads: p for p in here if p.method == compiled.KERNEL}
        others = dict.fromkeys(p.method for p in here)
        title = scene.title  # on the first row of the scene
        for method in others:
            if method in (compiled.KERNEL, compiled.KERNEL_STATE):
                continue
            found = _of(points, scene.key, method)
            kernel, fine = kernels[found[-1].threads], found[-1]
            coarse = f"{found[0].error:.1e}" if len(found) > 1 else "-"
            rows.append(
                f"| {title} | {method} | {fine.setting} | {fine.threads} | "
                f"{fine.ns_per_impact / kernel.ns_per_impact:.3g} | {fine.error:.1e} | "
                f"{kernel.error:.1e} | {coarse} |"
            )
            title = ""
    (scalar, *_) = _of(points, MOVING_SCENES[0].key, moving.SCALAR)
    return MOVING.format(threads=scalar.threads, rows="\n".join(rows))
