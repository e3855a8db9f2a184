"""Separations and order of landings, taken one by one in order of time, against all pairs."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep.kernels.bases import Instant
from vibrosweep.kernels.coupled.follow import clear, close, lacks_memory, landings, note
from vibrosweep.kernels.ordering import HARMONICS, Listed, empty_orders, write_order

BEGIN = 2.0  # of the window, periods
LATE = 3.0  # beginning of its last period


@st.composite
def scenes(draw):
    """Particles and times, in their order, and stays that end before the particle lands again.

    One particle may land far more often than another, so that equal impact numbers are far apart.
    """
    particles = draw(st.integers(1, 4))
    share = np.array(draw(st.lists(st.sampled_from([1, 3, 30]), min_size=4, max_size=4)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    size = draw(st.integers(0, 60))
    who = rng.choice(particles, size, p=(share / share[:particles].sum())[:particles])
    ticks = draw(st.sampled_from([2**3, 2**8, 2**20]))
    times = np.sort(rng.integers(0, ticks, size)) * (2.0 * BEGIN / ticks)
    stays = rng.choice([2.0**-7, 0.25, 2.0], size)  # all sums are exact
    for j in range(particles):
        own = np.flatnonzero(who == j)
        stays[own[:-1]] = np.minimum(stays[own[:-1]], np.diff(times[own]))
    return who, times, stays


def one_by_one(who, times, stays, places):
    """Note all landings, with as much memory of numbers as is needed."""
    memory = landings(4, places)
    noted = clear(memory)
    for j, time, stay in zip(who, times, stays, strict=True):
        seen = time >= BEGIN
        if lacks_memory(memory, j, seen):
            return one_by_one(who, times, stays, 2 * places)
        name = float(j if seen else -1 - j)
        landing = Listed(0.0, time, stay, name)
        noted = note(memory, noted, landing, time >= LATE, Instant(0.0, BEGIN))
    return close(memory, noted, Instant(0.0, BEGIN)), memory.turns


@given(scenes(), st.integers(1, 5))
def test_separations_and_order_are_those_of_all_pairs(scene, places):
    who, times, stays = scene
    number = np.array([np.count_nonzero(who[:k] == who[k]) for k in range(who.size)])
    pairs = [p for p in itertools.combinations(range(who.size), 2) if who[p[0]] != who[p[1]]]
    inside = [(k, m) for k, m in pairs if times[k] >= BEGIN]
    found, turns = one_by_one(who, times, stays, places)
    assert found.gap == min((times[m] - times[k] for k, m in inside), default=np.inf)
    equal = (times[m] - times[k] for k, m in inside if number[k] == number[m])
    assert found.same == min(equal, default=np.inf)
    ends = times + stays
    shared = any(max(times[k], times[m], BEGIN) <= min(ends[k], ends[m]) for k, m in pairs)
    assert found.shared == int(shared)
    out = empty_orders(1)
    write_order(out, 0, turns, found.order, True)
    assert out.changes[0] == sum(
        time >= BEGIN and j in who[:k] and j != longest_ago(who[:k])
        for k, (j, time) in enumerate(zip(who, times, strict=True))
    )
    late = (times[1:] >= LATE) & (np.diff(who) != 0)
    gaps = np.diff(times)[late]
    assert out.gap_median[0] == np.median(gaps) if gaps.size else np.isnan(out.gap_median[0])
    assert out.gap_least[0] == gaps.min() if gaps.size else np.isnan(out.gap_least[0])
    last = [times[who == j].max() for j in set(who)]
    for h, harmonic in enumerate(HARMONICS):
        mean = np.exp(2j * np.pi * harmonic * np.array(last)).mean() if last else np.nan
        assert out.phases[h, 0] == pytest.approx(abs(mean), abs=1e-14, nan_ok=True)


def longest_ago(who):
    """Return the particle whose last landing was longest ago."""
    return min(set(who), key=lambda j: np.flatnonzero(who == j).max())


def test_the_order_of_landings_that_are_not_all_known_is_undetermined():
    found, turns = one_by_one(np.array([0, 1]), np.array([2.5, 3.5]), np.zeros(2), 2)
    out = empty_orders(1)
    write_order(out, 0, turns, found.order, False)
    assert out.changes[0] == -1
    assert np.isnan([*out.gap_median, *out.gap_least, *out.phases[:, 0]]).all()
