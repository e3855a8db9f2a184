"""Streaming over the moving base: pass by pass, against whole flights one by one."""

import numpy as np
import pytest

from vibrosweep.kernels.advance import Options, advance, memory_around
from vibrosweep.kernels.bases import fitted
from vibrosweep.kernels.impact import Batch, base_of
from vibrosweep.kernels.record import Units, empty_record, record
from vibrosweep.kernels.statistics import empty_statistics
from vibrosweep.kernels.totals import scratch
from vibrosweep.model.parameters import PARAMETERS, dimensionless, launches
from vibrosweep.model.status import Status

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
    lanes = advance((0, total, 0), batch, options, False, memory, out, None, None)
    while lanes:
        span = (total, total, lanes)
        lanes = advance(span, batch, options, False, memory, out, None, None)
    return out


def same(one, other, which=slice(None)):
    names = ("totals", "at_rest", "status")
    pairs = ((getattr(one, name)[..., which], getattr(other, name)[..., which]) for name in names)
    return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def test_without_arcs_the_bits_are_the_same():
    scene, launch = problem(200, 1.0, 40.0)
    base = base_of("moving", "rest")
    less = fitted(base, scene)
    assert less.arcs is None
    assert same(streamed(base, scene, launch), streamed(less, scene, launch))
    lifting, _ = problem(200, 2.0, 40.0)
    assert fitted(base, lifting) == base


def test_passes_of_all_lanes_find_what_one_flight_after_another_finds():
    scene, launch = problem(60, 6.0, 30.0)
    base = base_of("moving", "rest")
    found = streamed(base, scene, launch)
    assert set(found.status) == {Status.COMPLETED}
    landings = empty_record(found.landings.size, int(found.landings.max()) + 1)
    units = Units(np.ones(scene.kick.size), np.ones(scene.kick.size))
    record(0, found.landings.size, Batch(base, scene, launch), units, landings)
    seen = np.isfinite(landings.landing_time)
    assert np.array_equal(seen.sum(axis=1), found.landings)
    assert np.array_equal(landings.rested.sum(axis=1), found.total("rests"))
    # all flights but the last one, which ends after the record does
    ends, starts = landings.landing_time[:, 1:], landings.liftoff_time[:, :-1]
    flown = np.nansum(ends - starts, axis=1)
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
