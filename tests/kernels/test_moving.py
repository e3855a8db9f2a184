"""Streaming over the moving base in passes, against whole flights followed one by one."""

import numpy as np
import pytest
from numba import njit

from vibrosweep.engine.landings import recorded
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels.advance import Options, Share, advance, memory_around
from vibrosweep.kernels.bases import constants, fitted
from vibrosweep.kernels.impact import Batch, base_of, impact, launch, launch_speed
from vibrosweep.kernels.record import Units
from vibrosweep.kernels.statistics import empty_statistics, scratch
from vibrosweep.model.measures import Status
from vibrosweep.model.parameters import PARAMETERS, dimensionless, launches
from vibrosweep.scene.scene import Scene

PARTICLES = 5


def problem(size, most, periods, seed=1, **fixed):
    """Realizations with accelerations of the base up to `most`."""
    draw = np.random.default_rng(seed)
    restitution = fixed.get("restitution", draw.uniform(0.0, 1.0, size))
    given = {name: np.full(size, p.default) for name, p in PARAMETERS.items()}
    given["restitution"] = restitution
    acceleration = draw.uniform(0.0, most, size)
    given["amplitude"] = (1.0 + restitution) * acceleration * 9.81 / (2.0 * np.pi)
    given["contact_time"] = 10.0 ** draw.uniform(-6.0, -2.0, size)
    return dimensionless(given, periods), launches("staggered", PARTICLES, given["frequency"])


def streamed(base, scene, launch, budget=600_000):
    total = scene.kick.size * PARTICLES
    out, memory = empty_statistics(total), memory_around(scratch())
    batch = Batch(base, scene, launch)
    options = Options(budget)
    lanes = advance(Share(0, total, 0), batch, options, None, memory, out, None, None)
    while lanes:
        share = Share(total, total, lanes)
        lanes = advance(share, batch, options, None, memory, out, None, None)
    return out


def same(one, other, which=slice(None)):
    names = ("totals", "at_rest", "status")
    pairs = ((getattr(one, name)[..., which], getattr(other, name)[..., which]) for name in names)
    return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


@njit(error_model="numpy")
def followed(batch, landing, lift_off, rests):
    """Times of landings and lift-offs in periods, one impact after the other."""
    problem, particles = batch.problem, batch.launches.whole.shape[1]
    for t in range(rests.size):
        i, p = t // particles, t % particles
        fixed = constants(batch.base, problem, i)
        n, x = launch(batch.launches, i, p, problem.phase[i])
        u = launch_speed(fixed, problem, i, x)
        for k in range(landing.shape[1]):
            hit = impact(fixed, n, x, u)
            if not hit.n - problem.end_count[i] <= problem.end_phase[i] - hit.x:
                break
            landing[t, k] = hit.n + hit.x
            rests[t] += 0 if hit.leaves else 1
            n, x, u = hit.n_off, hit.x_off, hit.u
            if n == np.inf:
                break
            lift_off[t, k] = n + x


def one_by_one(batch, capacity):
    size = batch.problem.kick.size * PARTICLES
    landing, lift_off = (np.full((size, capacity), np.nan) for _ in range(2))
    rests = np.zeros(size, np.int64)
    followed(batch, landing, lift_off, rests)
    return landing, lift_off, rests


@pytest.mark.parametrize("name", ["high-bounce", "moving"])
def test_a_record_equals_impacts_that_are_followed_one_by_one(name):
    """There are more trajectories than lanes in a block, and some have too little room."""
    scene, starts = problem(60, 6.0, 30.0)
    base = base_of(name, "rest")
    landing, lift_off, rests = one_by_one(Batch(base, scene, starts), 3000)
    room = np.isfinite(landing).sum(axis=1)
    room[::7] //= 3
    ones = np.ones(scene.kick.size)
    like = Scene(particles=PARTICLES, base=name, duration=30.0).recorded()
    with Workers(2) as workers:
        found, each = recorded(scene, starts, like, workers, Units(ones, ones), room)
    kept = np.arange(3000) < room[:, np.newaxis]
    phase = np.repeat(scene.phase, PARTICLES)[:, np.newaxis]
    assert found.landing_time == pytest.approx((landing - phase)[kept], rel=1e-15, abs=1e-15)
    assert found.liftoff_time == pytest.approx(
        (lift_off - phase)[kept], rel=1e-15, abs=1e-15, nan_ok=True
    )
    assert np.array_equal(each.landings, np.isfinite(landing).sum(axis=1))
    assert np.array_equal(each.total("rests"), rests)


def test_without_arcs_the_bits_are_the_same():
    scene, launch = problem(200, 1.0, 40.0)
    base = base_of("moving", "rest")
    less = fitted(base, scene)
    assert less.arcs is None
    assert same(streamed(base, scene, launch), streamed(less, scene, launch))
    lifting, _ = problem(200, 2.0, 40.0)
    assert fitted(base, lifting) == base


def test_passes_over_all_lanes_equal_flights_that_are_followed_one_by_one():
    scene, starts = problem(60, 6.0, 30.0)
    base = base_of("moving", "rest")
    found = streamed(base, scene, starts)
    assert set(found.status) == {Status.COMPLETED}
    landing, lift_off, rests = one_by_one(Batch(base, scene, starts), int(found.landings.max()) + 1)
    seen = np.isfinite(landing)
    assert np.array_equal(seen.sum(axis=1), found.landings)
    assert np.array_equal(rests, found.total("rests"))
    # all flights but the last one, which ends after the record does
    flown = np.nansum(landing[:, 1:] - lift_off[:, :-1], axis=1)
    assert np.all(found.total("flight_sum") >= flown - 1e-11)
    stays = found.at_rest == 1  # no flight follows
    assert found.total("flight_sum")[stays] == pytest.approx(flown[stays], rel=1e-12, abs=1e-13)


@pytest.mark.parametrize("budget", [6, 12, 24])
def test_a_budget_cuts_off_after_so_many_impacts(budget):
    scene, launch = problem(60, 4.0, 25.0, seed=3)
    base = base_of("moving", "rest")
    whole, cut = streamed(base, scene, launch), streamed(base, scene, launch, budget)
    over = whole.landings > budget
    assert np.array_equal(cut.status == Status.BUDGET_EXCEEDED, over)
    assert np.all(cut.landings[over] == budget)
    assert same(whole, cut, ~over)


def test_accelerations_beyond_all_shakers_get_a_status():
    scene, launch = problem(4, 1e12, 10.0, restitution=np.full(4, 0.5))
    found = streamed(base_of("moving", "rest"), scene, launch)
    assert set(found.status) == {Status.NON_FINITE}
