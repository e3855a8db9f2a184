"""Landings that come in the order of time, one by one, against all pairs of them."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep.kernels.bases import Instant
from vibrosweep.kernels.coupled.sequence import clear, close, lacks_memory, landings, note
from vibrosweep.kernels.listing import Listed

BEGIN = 2.0  # of the window, periods


@st.composite
def scenes(draw):
    """Particles and times, in their order, and stays that end before the particle lands again.

    One particle may land far more often than another, so that equal numbers are far apart.
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
    order = clear(memory)
    for j, time, stay in zip(who, times, stays, strict=True):
        seen = time >= BEGIN
        if lacks_memory(memory, j, seen):
            return one_by_one(who, times, stays, 2 * places)
        name = float(j if seen else -1 - j)
        order = note(memory, order, Listed(0.0, time, stay, name), False, Instant(0.0, BEGIN))
    return close(memory, order, Instant(0.0, BEGIN))


@given(scenes(), st.integers(1, 5))
def test_separations_are_those_of_all_pairs(scene, places):
    who, times, stays = scene
    number = np.array([np.count_nonzero(who[:k] == who[k]) for k in range(who.size)])
    pairs = [p for p in itertools.combinations(range(who.size), 2) if who[p[0]] != who[p[1]]]
    inside = [(k, m) for k, m in pairs if times[k] >= BEGIN]
    found = one_by_one(who, times, stays, places)
    assert found.gap == min((times[m] - times[k] for k, m in inside), default=np.inf)
    equal = (times[m] - times[k] for k, m in inside if number[k] == number[m])
    assert found.same == min(equal, default=np.inf)
    ends = times + stays
    shared = any(max(times[k], times[m], BEGIN) <= min(ends[k], ends[m]) for k, m in pairs)
    assert found.shared == int(shared)
