"""Speed of the kernels; run with ``pytest benchmarks/test_kernels.py -s``."""

from __future__ import annotations

import re
import statistics as statistics_of
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numba import njit

from loops import LANES, bare_map, lanes, scalar_trajectories, sine_only
from methods.scenes import paper_parameters
from methods.timing import SETTLE
from processors import measured, ways
from vibrosweep.engine.landings import all_parameters as complete
from vibrosweep.engine.measure import batch_of, statistics
from vibrosweep.engine.workers import TRAJECTORIES_PER_TASK, Workers
from vibrosweep.kernels._jit import uncached
from vibrosweep.kernels.advance import Options, Share, _step, advance, memory_around
from vibrosweep.kernels.bases import constants, put
from vibrosweep.kernels.cycles import Chosen
from vibrosweep.kernels.impact import Batch, base_of
from vibrosweep.kernels.memory import LANES as LANES_OF_KERNEL
from vibrosweep.kernels.memory import ROW
from vibrosweep.kernels.statistics import KINDS, empty_statistics, scratch
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import dimensionless, launches
from vibrosweep.scene.scene import Scene

THREADS = 2
PARTICLES = 20


def scene(realizations, particles, duration, **options):
    """The ranges of sweeps/paper.toml."""
    parameters = paper_parameters(realizations)
    observation = Scene(
        particles=particles,
        launch="staggered",
        duration=duration,
        rebound="rest",
        measures=Measures(**options),
    )
    problem = dimensionless(parameters, duration, 0.0)
    return problem, launches("staggered", particles, parameters["frequency"]), observation


# 12.1 to 12.6 and 13 to 13.5 on an idle machine; other programs slow vectors down more
@pytest.mark.parametrize(
    ("realizations", "periods", "target"), [(20_000, 12.0, 11.5), (200, 1000.0, 12.0)]
)
def test_streaming_kernel_against_the_obvious_scalar_loop(race, realizations, periods, target):
    problem, launch, observation = scene(realizations, 20, periods)
    trajectories = realizations * 20
    out = [np.zeros(trajectories, np.int64), *(np.zeros(trajectories) for _ in range(3))]
    with Workers(THREADS) as workers:

        def scalar():
            workers.run(
                lambda a, b: scalar_trajectories(a, b, problem, launch, periods, *out),
                trajectories,
                min(TRAJECTORIES_PER_TASK, trajectories // 4),
            )

        def kernel():
            return statistics(batch_of(problem, launch, observation), observation, workers)

        impacts = int(kernel().landings.sum())
        ratio = race(kernel, scalar, work_subject=impacts, work_reference=impacts)
        # the rounding of a running time lets some chaotic transients end on another attractor
        assert abs(int(out[0].sum()) - impacts) < 0.02 * impacts
    assert ratio >= target


@pytest.mark.parametrize(
    ("kinds", "most"),
    [("restitution_noise", 3.3), ("kick_noise", 3.3), ("restitution_noise kick_noise", 5.5),
     ("drive_noise", 11.0)],
)  # fmt: skip
def test_cost_of_noise(race, kinds, most):
    """An impact with noise takes at most so many times as long as one without."""
    parameters = paper_parameters(4000)
    strengths = dict.fromkeys(kinds.split(), np.full(4000, 1e-3))
    noisy = parameters | strengths | {"noise_stream": np.arange(4000)}
    start = launches("staggered", 5, parameters["frequency"])
    _, _, still = scene(1, 5, 400.0)
    problems = [dimensionless(given, 400.0, 0.0) for given in (noisy, parameters)]
    with Workers(1) as workers:

        def followed(problem):
            return statistics(batch_of(problem, start, still), still, workers)

        impacts = [int(followed(problem).landings.sum()) for problem in problems]
        ratio = race(
            lambda: followed(problems[0]),
            lambda: followed(problems[1]),
            work_subject=impacts[0],
            work_reference=impacts[1],
        )
    assert ratio >= 1.0 / most


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
@pytest.mark.parametrize(
    ("law", "most"),
    [
        ("plastic", 1.8),
        ("power(0.2)", 3.2),
        ("points([[0.5, 0.95], [5.0, 0.85]])", 1.8),
        ("viscoelastic", 3.5),
    ],
)
def test_cost_of_a_law_of_restitution(race, base, law, most):
    """An impact by a law takes at most so many times as long as one of constant restitution."""
    parameters = paper_parameters(8000)
    plain = Scene(PARTICLES, "staggered", 12.0, "rest", Measures(), base=base)
    yielding = replace(plain, restitution_law=law)
    given = parameters | {"restitution_speed": np.full(8000, 1.0)}
    problem = dimensionless(given, 12.0, 0.0)
    start = launches("staggered", PARTICLES, parameters["frequency"])
    with Workers(1) as workers:

        def followed(scene):
            return statistics(batch_of(problem, start, scene), scene, workers)

        impacts = [int(followed(scene).landings.sum()) for scene in (yielding, plain)]
        ratio = race(
            lambda: followed(yielding),
            lambda: followed(plain),
            work_subject=impacts[0],
            work_reference=impacts[1],
        )
    assert ratio >= 1.0 / most


def test_speed_does_not_depend_on_the_place_in_memory():
    """Rows that collide in the cache would make the kernel slow at some places in memory."""
    trajectories, places, page = 10_000, 200, 4096 // 8
    problem, launch, observation = scene(trajectories // 20, 20, 12.0)
    batch = Batch(base_of("high-bounce", observation.rebound), problem, launch)
    options = Options(observation.budget)
    out = empty_statistics(trajectories)
    size = scratch().size
    memory = np.zeros(size + (places + 1) * page)
    start = (-memory.ctypes.data // 8) % page
    fastest = np.full(places, np.inf)
    for place in [0, *range(places)] * 5:
        block = memory[start + place * page :][:size]
        block[:] = 0.0
        around = memory_around(block)
        begin = time.perf_counter()
        left = advance(Share(0, trajectories, 0), batch, options, None, around, out, None, None)
        advance(Share(0, 0, left), batch, options, None, around, out, None, None)
        fastest[place] = min(fastest[place], time.perf_counter() - begin)
    slow = np.mean(fastest > 1.2 * fastest.min())
    mean = fastest.mean() / fastest.min()
    print(f"\n{places} places: {slow:.3f} are slow; on average {mean:.3f} times the fastest")
    assert slow < 0.05


def test_bare_map_against_the_sine_alone(race):
    repetitions = 40_000
    s, t = lanes(), lanes()
    work = repetitions * LANES
    ratio = race(
        lambda: bare_map(s, repetitions),
        lambda: sine_only(t, repetitions),
        work_subject=work,
        work_reference=work,
    )
    assert ratio >= 0.7


@njit(nogil=True, error_model="numpy")
def passes(s, repetitions, chosen):
    for _ in range(repetitions):
        _step(s, LANES_OF_KERNEL, chosen, np.inf, None, None, LANES_OF_KERNEL, 0)


def filled(law, flight, e, a, r):
    """Scratch memory with all lanes in flight, with the same flight time and parameters."""
    rng = np.random.default_rng(1)
    given = {"restitution": e, "amplitude": a, "contact_time": r, "gravity": 2.0, "frequency": 1.0}
    given = {name: np.array([value]) for name, value in given.items()}
    fixed = constants(base_of("high-bounce", law), dimensionless(complete(given), 1.0, 0.0), 0)
    s = scratch()
    for j in range(LANES_OF_KERNEL):
        put(fixed, s, j)
        s[ROW.X + j], s[ROW.U + j], s[ROW.N + j] = rng.uniform(-0.5, 0.5), flight, -1e12
    return s


@pytest.mark.parametrize("law", ["rest", "reflect"])
def test_speed_does_not_depend_on_how_small_flights_are(law):
    """Subnormal numbers, which cost some processors a hundred cycles each, do not occur."""
    kinds = {
        "chaotic": (1.0, 0.9, 0.7, 1e-4),
        "locked": (1.0, 0.5, 0.55, 1e-4),
        "decaying": (1.0, 0.9999, 0.0, 1e-30),
        "decaying at once": (1.0, 1e-300, 0.0, 1e-30),
        "tiny": (1e-29, 0.9, 2e-30, 1e-30),
        "at rest in every period": (1.0, 0.0, 0.7, 1e-4),
        "dead": (1e-4, 0.0, 0.0, 1e-4),
    }
    base = base_of("high-bounce", law)
    rooms = {kind: filled(law, *given) for kind, given in kinds.items()}
    times = {kind: [] for kind in kinds}
    for _ in range(15):
        for kind, memory in rooms.items():
            began = time.thread_time()
            passes(memory, 5000, Chosen(base, KINDS))
            times[kind].append(time.thread_time() - began)
    medians = {kind: statistics_of.median(values[1:]) for kind, values in times.items()}
    print("\n", {kind: round(t / medians["locked"], 3) for kind, t in medians.items()})
    assert max(medians.values()) <= 1.2 * min(medians.values())


def test_hot_loop_uses_whole_vector_registers():
    """The inner loop holds fused multiply-adds on the widest registers and calls nothing."""
    problem, launch, observation = scene(1, 8, 12.0)
    batch = Batch(base_of("high-bounce", observation.rebound), problem, launch)
    fresh: Any = uncached(advance)
    memory = memory_around(scratch())
    fresh(Share(0, 8, 0), batch, Options(102), False, memory, empty_statistics(8), None, None)
    (assembly,) = fresh.dispatcher.inspect_asm().values()
    blocks = re.split(r"^\.LBB\w+:", assembly, flags=re.MULTILINE)
    hot = max(blocks, key=lambda block: len(re.findall(r"vfn?m(?:add|sub)\w+pd", block)))
    registers = {r: len(re.findall(rf"%{r}\d", hot)) for r in ("zmm", "ymm", "xmm")}
    fused = len(re.findall(r"vfn?m(?:add|sub)\w+pd", hot))
    print(f"\nhot loop: {fused} packed fused multiply-adds, operands {registers}")
    assert fused >= 11
    assert registers["zmm"] > 0 or registers["ymm"] > 0
    assert "call" not in hot


@pytest.mark.parametrize("way", ["default", "fastest"])
def test_bare_map_against_the_ensemble_call_of_pynamicalsys(race, way):
    dynamical = pytest.importorskip("methods.dynamical")
    bare = dynamical.BareMap(THREADS)
    ratio = race(
        bare.ours,
        bare.theirs(way),
        work_subject=bare.impacts,
        work_reference=bare.their_impacts,
        settle=SETTLE,
    )
    assert ratio >= (100.0 if way == "default" else 40.0)


# The kernels against their sine, by vector width.

# The chain of dependent operations of the bare map is half as long again as that of the sine alone,
# and the number of such chains that a core has under way limits the speed: a vector half as wide
# halves the lanes in each chain, but not its length.
BARE_MAP = {"512": 1.0 / 0.75}


@pytest.mark.parametrize("way", ways())
def test_streaming_and_the_bare_map_as_multiples_of_the_sine(way):
    found = measured(way)
    print(f"\n{way} bits: {found}")
    assert found["1000 periods"] <= 6.0
    assert found["12 periods"] <= 8.0
    assert found["bare map"] <= BARE_MAP.get(way, 2.0)
