"""Speed of the moving base; run with ``pytest benchmarks/test_moving.py -s``."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from numba import njit

from loops import LANES, lanes, sine_only
from methods.scenes import paper_parameters
from moving_loops import scalar_moving
from test_kernels import THREADS
from test_skips import measuring
from vibrosweep.engine.measure import batch_of, statistics
from vibrosweep.engine.workers import TRAJECTORIES_PER_TASK, Workers
from vibrosweep.kernels.advance import _step
from vibrosweep.kernels.bases import constants, fitted, leave, put
from vibrosweep.kernels.cycles import Chosen
from vibrosweep.kernels.impact import base_of
from vibrosweep.kernels.memory import LANES as LANES_OF_KERNEL
from vibrosweep.kernels.memory import ROW
from vibrosweep.kernels.statistics import KINDS, scratch
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import PARAMETERS, dimensionless, launches
from vibrosweep.model.shapes import Waveform
from vibrosweep.scene.scene import Scene

PARTICLES = 20


def shaker_parameters(realizations):
    """A laboratory's shaker: 20 Hz, Gamma 1-5, restitution 0.5-0.95."""
    rng = np.random.default_rng(1)
    given = {name: np.full(realizations, p.default) for name, p in PARAMETERS.items()}
    given["frequency"][:] = 20.0
    given["launch_velocity"][:] = 0.5
    given["restitution"] = rng.uniform(0.5, 0.95, realizations)
    velocity = rng.uniform(1.0, 5.0, realizations) * 9.81 / (2.0 * math.pi * 20.0)
    given["amplitude"] = (1.0 + given["restitution"]) * velocity
    return given


def gentle_parameters(realizations):
    """The ranges of sweeps/paper.toml, where Gamma is below 1."""
    given = paper_parameters(2 * realizations)
    gamma = 2.0 * math.pi * given["amplitude"] / (1.0 + given["restitution"]) / 9.81
    kept = np.flatnonzero(gamma < 1.0)[:realizations]
    return {name: values[kept] for name, values in given.items()}


RANGES = {
    "paper": paper_parameters, "gentle": gentle_parameters, "shaker": shaker_parameters
}  # fmt: skip


class Batch(NamedTuple):
    """Dimensionless realizations, their launches, and the scene."""

    problem: tuple
    launch: tuple
    scene: Scene


def batch(ranges, realizations, periods, base="moving"):
    parameters = RANGES[ranges](realizations)
    duration = periods / float(parameters["frequency"][0])
    scene = Scene(PARTICLES, "staggered", duration, "rest", Measures(), base=base)
    start = launches("staggered", PARTICLES, parameters["frequency"])
    return Batch(dimensionless(parameters, duration), start, scene)


def streaming(given, workers):
    """The kernel's run, and its impacts."""

    def run():
        return statistics(batch_of(given.problem, given.launch, given.scene), given.scene, workers)

    return run, int(run().landings.sum())


LENGTHS = [(20_000, 12.0), (200, 1000.0)]


@pytest.mark.parametrize(("realizations", "periods"), LENGTHS)
@pytest.mark.parametrize(("ranges", "target"), [("paper", 12.0), ("shaker", 8.0)])
def test_streaming_against_the_same_search_as_a_scalar_loop(
    race, ranges, target, realizations, periods
):
    given = batch(ranges, realizations, periods)
    trajectories = realizations * PARTICLES
    out = (*np.zeros((2, trajectories), np.int64), *np.zeros((2, trajectories)))
    with Workers(THREADS) as workers:

        def scalar():
            workers.run(
                lambda a, b: scalar_moving(
                    a, b, given.problem, given.launch, periods, None, out
                ),
                trajectories,
                min(TRAJECTORIES_PER_TASK, trajectories // 4),
            )  # fmt: skip

        kernel, impacts = streaming(given, workers)
        scalar()
        scalar_impacts = int(out[0].sum())
        ratio = race(kernel, scalar, work_subject=impacts, work_reference=scalar_impacts, rounds=5)
    # the rounding of one impact may decide when a particle comes to rest for good
    assert abs(scalar_impacts - impacts) < 0.1 * impacts
    assert ratio >= target


@pytest.mark.parametrize(("realizations", "periods"), LENGTHS)
@pytest.mark.parametrize(("ranges", "most"), [("gentle", 5.0), ("shaker", 10.0)])
def test_an_impact_of_the_moving_base_against_one_of_the_high_bounce_base(
    race, ranges, most, realizations, periods
):
    with Workers(THREADS) as workers:
        moving, impacts = streaming(batch(ranges, realizations, periods), workers)
        bounce, bounces = streaming(batch(ranges, realizations, periods, "high-bounce"), workers)
        ratio = race(moving, bounce, work_subject=impacts, work_reference=bounces)
    assert ratio >= 1.0 / most


@njit(nogil=True, error_model="numpy")
def passes(s, repetitions, chosen):
    for _ in range(repetitions):
        _step(s, LANES_OF_KERNEL, chosen, np.inf, None, None, LANES_OF_KERNEL, 0)


def filled(ranges):
    """Scratch memory with a launch in every lane, and no end of the observation."""
    problem, s = dimensionless(RANGES[ranges](LANES_OF_KERNEL), 1.0), scratch()
    base = fitted(base_of("moving", "rest"), problem)
    rng = np.random.default_rng(1)
    for j in range(LANES_OF_KERNEL):
        fixed = constants(base, problem, j)
        x = rng.uniform(-0.5, 0.5)
        u = leave(fixed, x, float(problem.launch_flight[j]))
        put(fixed, s, j)
        s[ROW.X + j], s[ROW.U + j], s[ROW.N + j], s[ROW.AGE + j] = x, u, -1e12, 0.0
    return base, s


@pytest.mark.parametrize("ranges", ["gentle", "shaker"])
def test_a_pass_against_the_sine_alone(race, ranges, record_property):
    """Measure a pass in units of a sine, and the number of passes of an impact."""
    repetitions, t = 2000, lanes()
    base, s = filled(ranges)
    for made in (30, 500, repetitions):
        before = s[ROW.AGE : ROW.AGE + LANES_OF_KERNEL].copy()
        passes(s, made, Chosen(base, KINDS))
        impacts = s[ROW.AGE : ROW.AGE + LANES_OF_KERNEL] - before
        alive = impacts > 0.0  # some are at rest for good
        each = made * np.count_nonzero(alive) / impacts.sum()
        moving = np.mean(alive)
        print(f"\n{each:.2f} passes per impact over {made}, {moving:.2f} of the lanes in motion")
    record_property("passes_per_impact", each)
    race(
        lambda: passes(s, repetitions, Chosen(base, KINDS)),
        lambda: sine_only(t, repetitions),
        work_subject=repetitions * LANES_OF_KERNEL,
        work_reference=repetitions * LANES,
    )
    assert each < 3.0


def test_a_million_periods_against_a_thousand(race):
    """Every orbit of these realizations recurs, or rests for good."""
    parameters = gentle_parameters(200)
    with Workers(THREADS) as workers:
        late, early = (
            measuring(parameters, workers, duration=periods, base="moving")
            for periods in (1e6, 1e3)
        )
        assert race(late, early) >= 1.0 / 3.0


@pytest.mark.parametrize("key", ["moving-locked", "moving-resting", "moving-chaotic"])
def test_streaming_against_heyoka_with_events(key, record_property):
    """Compare times per impact; heyoka is too slow for a race."""
    taylor = pytest.importorskip("methods.taylor")
    from methods import compiled
    from methods.finals import read_references
    from methods.scenes import SCENES

    (scene,) = (scene for scene in SCENES if scene.key == key)
    scene = replace(scene, tolerances=scene.tolerances[-1:])
    sizes = [reference.landings for reference in read_references()[key]]
    (peer,) = taylor.heyoka_events(scene, sizes, 1)
    with Workers(THREADS) as workers:
        run = compiled.streaming(scene, workers)
        impacts = run()
        seconds = math.inf
        for _ in range(9):
            began = time.perf_counter()
            run()
            seconds = min(seconds, time.perf_counter() - began)
    ratio = peer.ns_per_impact / (1e9 * seconds / impacts)
    print(f"\n{key}: {ratio:.0f} times the speed of heyoka")
    assert ratio >= 200.0


# Cost of waveforms.

TONES = {
    2: ((1, 1.0, 0.0), (2, 0.4, 1.1)),
    8: ((1, 1.0, 0.0), *((h, 0.3 / h**2, 0.7 * h) for h in range(2, 9))),
}


@pytest.mark.parametrize(
    ("base", "tones", "most"),
    # measured on a busy machine: 1.6 and 2.2, 1.6 and 2.6
    [("high-bounce", 2, 2.0), ("high-bounce", 8, 2.8), ("moving", 2, 2.0), ("moving", 8, 3.0)],
)
def test_an_impact_under_harmonics_against_one_under_the_sine(race, base, tones, most):
    """Both have the same ranges; the numbers of impacts differ, and each time is per impact."""
    sine = batch("paper", 8000, 12.0, base)
    shape = Waveform("harmonics", TONES[tones])
    shaped = sine._replace(scene=replace(sine.scene, waveform=shape))
    with Workers(1) as workers:
        subject, impacts = streaming(shaped, workers)
        reference, others = streaming(sine, workers)
        ratio = race(subject, reference, work_subject=impacts, work_reference=others)
    assert ratio >= 1.0 / most
