"""Landings in the order of time: separations and order."""

import itertools
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import vibrosweep as vs
from study.records import order_of_landings
from tests.cases import each_of
from vibrosweep.engine.measure import measure
from vibrosweep.kernels.bases import Instant
from vibrosweep.kernels.coupled.realizations import clear, close, lacks_memory, note
from vibrosweep.kernels.coupled.realizations import landings as landings_sequence
from vibrosweep.kernels.ordering import HARMONICS as HARMONICS_SEQUENCE
from vibrosweep.kernels.ordering import Listed, empty_orders, write_order
from vibrosweep.kernels.separation import (
    FARTHEST,
    NARROWEST,
    ORDERED,
    closest,
    put_in_order,
    workspace,
)

# Separations against all pairs of recorded landings.

LAWS = ["rest", "reflect"]


def all_pairs(found, i, contact_time, begin):
    """Smallest separations of realization i, and longest time together on the base, by brute force.

    Returns dt_min, dt_min_same_index and the longest overlap of two stays in the window, which is
    negative by how far two stays miss each other.
    """
    landing, liftoff = found["landing_time"][i], found["liftoff_time"][i]
    who, number = np.nonzero(~np.isnan(landing))
    start, leave = landing[who, number], liftoff[who, number]
    leave = np.fmax(np.where(np.isnan(leave), np.inf, leave), start + contact_time)
    inside = start >= begin
    apart = np.abs(start[:, np.newaxis] - start)
    other = (who[:, np.newaxis] != who) & inside[:, np.newaxis] & inside
    same = other & (number[:, np.newaxis] == number)
    until = np.minimum(leave[:, np.newaxis], leave)
    since = np.maximum(np.maximum(start[:, np.newaxis], start), begin)
    return (
        np.min(apart, where=other, initial=np.inf),
        np.min(apart, where=same, initial=np.inf),
        np.max(until - since, where=who[:, np.newaxis] != who, initial=-np.inf),
    )


def all_particles(found, i, contact_time, begin):
    """The same by bisection in the landings of each pair of particles, for many landings."""
    landing, liftoff = found["landing_time"][i], found["liftoff_time"][i]
    gap = same = np.inf
    together = -np.inf
    for p, q in combinations(range(landing.shape[0]), 2):
        for one, other in ((p, q), (q, p)):
            a, b = (landing[j][~np.isnan(landing[j])] for j in (one, other))
            leave = liftoff[one][: a.size]
            leave = np.fmax(np.where(np.isnan(leave), np.inf, leave), a + contact_time)
            before = np.searchsorted(a, b, side="right") - 1
            b, before = b[before >= 0], before[before >= 0]
            until = np.append(liftoff[other][~np.isnan(liftoff[other])], np.inf)[: b.size]
            until = np.fmax(until, b + contact_time)
            if b.size:
                since = np.maximum(b, begin)
                together = max(together, (np.minimum(leave[before], until) - since).max())
            near = (a[before] >= begin) & (b >= begin)
            gap = min(gap, (b - a[before])[near].min(initial=np.inf))
        both = (landing[p] >= begin) & (landing[q] >= begin)
        same = min(same, np.abs(landing[p] - landing[q])[both].min(initial=np.inf))
    return gap, same, together


def check(inputs, scene, workers, record, brute=all_pairs):
    """Compare the measures with all pairs, and return them."""
    measured = measure(inputs, scene, workers)
    found = record(inputs, scene)
    for i in range(measured["dt_min"].size):
        contact_time, frequency = inputs["contact_time"][i], inputs["frequency"][i]
        gap, same, together = brute(found, i, contact_time, scene.measures.transient)
        # a recorded time is a sum of whole periods and a phase, divided by the frequency
        latest = max(np.nanmax(np.abs(found["landing_time"][i]), initial=0), scene.duration)
        rounding = 4.0 * np.spacing(latest) + 4e-16 / frequency
        assert measured["status"][i] == 0
        for name, expected in (("dt_min", gap), ("dt_min_same_index", same)):
            if np.isinf(expected):
                assert np.isnan(measured[name][i])
            else:
                assert measured[name][i] == pytest.approx(expected, rel=0, abs=rounding)
        if abs(together) > rounding:  # else rounding decides
            assert measured["base_shared"][i] == (together > 0.0)
            assert measured["collision_free"][i] == (together < 0.0)
    return measured


@each_of("rebound", LAWS)
@each_of("transient", [0.0, 1.7])
@each_of("particles", [1, 2, 3, 8, 31])
def test_staggered_launches(rebound, transient, particles, random_scenes, observe, workers, record):
    inputs = random_scenes(seed=particles, size=24, contact_time=1e-2)
    scene = observe(particles=particles, duration=3.0, transient=transient, rebound=rebound)
    measured = check(inputs, scene, workers, record)
    if particles > 2:
        assert set(measured["base_shared"]) == {0, 1}


@each_of("rebound", LAWS)
@each_of("transient", [0.0, 1.1])
@each_of("particles", [4, 130, 200])
def test_listed_launches_before_and_inside_the_window(
    rebound, transient, particles, random_scenes, observe, workers, record
):
    launch = np.random.default_rng(particles).uniform(-2.0, 1.9, particles)
    inputs = random_scenes(seed=40 + particles, size=3, contact_time=3e-3, launch_velocity=3.0)
    scene = observe(launch, duration=2.0, transient=transient, rebound=rebound)
    check(inputs, scene, workers, record)


@pytest.mark.parametrize("launch", ["staggered", (0.0, 0.3, 0.3, 0.9)])
@pytest.mark.parametrize("transient", [0.0, 5.0])
def test_over_the_moving_base(launch, transient, random_scenes, observe, workers, record):
    inputs = random_scenes(seed=47, size=60, contact_time=1e-3, frequency=1.0)
    scene = observe(launch, particles=4, base="moving", transient=transient)
    measured = check(inputs, scene, workers, record)
    assert {0, 1} == set(measured["base_shared"].tolist())


@pytest.mark.parametrize("rebound", LAWS)
def test_long_contacts_are_shared(rebound, random_scenes, observe, workers, record):
    # stays of 0.3 s, longer than most flights and than some periods
    inputs = random_scenes(seed=51, size=30, contact_time=0.3)
    launch = [0.0, 0.1, 0.35, -0.6]
    scene = observe(launch, duration=4.0, transient=1.3, rebound=rebound)
    check(inputs, scene, workers, record)


@pytest.mark.parametrize("rebound", LAWS)
@pytest.mark.parametrize("transient", [0.0, 2.0])
def test_equal_launches_share_every_landing(
    rebound, transient, random_scenes, observe, workers, record
):
    inputs = random_scenes(seed=52, size=30, contact_time=1e-3, launch_velocity=2.0)
    launch = [0.1, 0.4, 0.1, 0.1, -0.3]
    scene = observe(launch, duration=3.0, transient=transient, rebound=rebound)
    measured = check(inputs, scene, workers, record)
    landed = measured["particle_impact_count"][:, 0] > 0
    assert landed.sum() > 15
    assert np.all(measured["dt_min"][landed] == 0.0)
    assert np.all(measured["dt_min_same_index"][landed] == 0.0)
    assert np.all(measured["base_shared"][landed] == 1)


@each_of("transient", [0.0, 20.3])
@each_of(
    "launch",
    [
        np.zeros(17),  # all coincide
        np.linspace(0.0, 1e-7, 17),
        np.random.default_rng(2).uniform(-3.0, 3.0, 17),
    ],
)
def test_chatter_that_overflows_a_slab(launch, transient, parameters, observe, workers, record):
    # At e = 0.98 and so short a contact each particle bounces a thousand times before it rests.
    # The list of 4096 landings overflows, and slabs are halved until their landings fit.
    inputs = parameters(
        restitution=0.98,
        amplitude=[0.0, 1e-12],
        contact_time=1e-9,
        gravity=2.0,
        launch_velocity=0.5,
    )
    scene = observe(launch, duration=40.0, transient=transient)
    found = record(inputs, scene)
    assert found["impact_count"].sum(axis=1).min() > 4 * 4096
    measured = check(inputs, scene, workers, record, all_particles)
    assert measured["base_shared"].tolist() == [1, 1]


def test_chatter_of_many_particles(parameters, observe, workers, record):
    inputs = parameters(restitution=0.9, amplitude=0.0, contact_time=1e-9)
    launch = 1e-3 * np.random.default_rng(3).uniform(0.0, 1.0, 60)
    scene = observe(launch, duration=20.0)
    measured = check(inputs, scene, workers, record, all_particles)
    assert measured["impact_count"] > 60 * 190


@pytest.mark.parametrize("transient", [0.0, 1.0])
def test_two_ways_of_brute_force_agree(transient, random_scenes, observe, record):
    inputs = random_scenes(seed=60, size=20, contact_time=1e-2)
    scene = observe((0.0, 0.2, -1.3, 0.21, 0.7), duration=4.0)
    found = record(inputs, scene)
    for i in range(20):
        pairs, particles = (
            brute(found, i, 1e-2, transient) for brute in (all_pairs, all_particles)
        )
        assert pairs[:2] == particles[:2]
        assert (pairs[2] > 0.0) == (particles[2] > 0.0)


def test_crowds_beyond_the_shortest_slab_are_undetermined(parameters, observe, workers):
    # flights shrink below 2^-53 periods; more of them land at one instant than the list can hold
    inputs = parameters(restitution=0.9999, amplitude=0.0, contact_time=1e-18, launch_velocity=1e-6)
    measured = measure(inputs, observe((0.0, 0.5), duration=1.0, ordering=True), workers)
    assert measured["impact_count"] > 200_000
    assert measured["status"] == 0
    assert measured["base_shared"] == measured["collision_free"] == -1
    assert np.isnan(measured["dt_min"])
    assert np.isnan(measured["dt_min_same_index"])
    assert measured["order_changes"] == -1


# gravity 2 and frequency 1: speeds are flight times.  Without restitution a particle that lands
# at a phase of -1/4 rests until the phase is 0.0008.
DYADIC = {
    "gravity": 2.0,
    "frequency": 1.0,
    "launch_velocity": 1.0,
    "restitution": 0.0,
    "amplitude": 1.0,
    "contact_time": 0.005,
}
RESTS = 0.75  # launch that lands at 1.75 and rests until 2.0008


@each_of(
    ("launch", "transient", "duration", "shared"),
    [
        ((RESTS, 0.9), 1.8, 1.95, 1),  # lands on an occupant who came before the window
        ((RESTS, 0.9), 1.8, 1.85, 0),  # the window ends before that
        ((RESTS, 1.5), 1.8, 2.4, 0),  # lands when the occupant has left
        ((RESTS, RESTS - 0.125), 1.8, 1.85, 1),  # two occupants, no landing
        ((RESTS, 0.0), 1.8, 1.85, 0),  # an occupant alone
        ((RESTS,), 1.8, 1.85, 0),
        ((0.25, 0.254), 0.5, 1.5, 1),  # bounce within a contact time of each other
        ((0.25, 0.256), 0.5, 1.5, 0),
        ((0.25, 0.254), 1.2545, 1.5, 1),  # the first stay lasts until 1.255
        ((0.25, 0.254), 1.2555, 1.5, 0),
    ],
)
def test_occupants_at_the_beginning_of_the_window(
    launch, transient, duration, shared, parameters, observe, workers, record
):
    scene = observe(launch, transient=transient, duration=duration)
    measured = check(parameters(**DYADIC), scene, workers, record)
    assert measured["base_shared"] == shared


@each_of("order", [(0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)])
def test_an_occupant_is_no_landing_between_two_others(order, parameters, observe, workers):
    # a landing exactly at the beginning of the window, one soon after, and an occupant
    times = (0.875, RESTS, 0.9375)
    scene = observe([times[j] for j in order], transient=1.875, duration=1.95)
    measured = measure(parameters(**DYADIC), scene, workers)
    assert measured["impact_count"] == 2
    assert measured["dt_min"] == measured["dt_min_same_index"] == 0.0625
    assert measured["base_shared"] == 1


@pytest.mark.parametrize("middle", [1.5, 3.5, 1.0, 2.0])
def test_a_pair_astride_the_end_of_a_slab(middle, parameters, observe, workers):
    # the first slab ends at a phase of 1/2 after the first landing, later ones mostly do too
    h = 2.0**-13
    launch = (0.0, middle - h - 1.0, middle + h - 1.0)
    inputs = parameters(**(DYADIC | {"amplitude": 0.0, "contact_time": 2.0**-11}))
    measured = measure(inputs, observe(launch, duration=9.0), workers)
    if middle != 1.0:
        assert measured["dt_min"] == measured["dt_min_same_index"] == 2.0 * h
    assert measured["base_shared"] == 1


def test_particles_at_rest_for_good_share_the_base(parameters, observe, workers, record):
    inputs = parameters(amplitude=[0.0, 1e-5], restitution=0.5)
    for transient in (0.0, 6.0):
        scene = observe((0.0, 0.3), duration=20.0, transient=transient)
        measured = check(inputs, scene, workers, record)
        assert measured["at_rest_count"].tolist() == [2, 2]
        assert measured["base_shared"].tolist() == [1, 1]
        assert np.isnan(measured["dt_min"]).all() == (transient > 0.0)


def test_a_late_end_costs_nothing_when_all_rest_for_good(parameters, observe, workers):
    inputs = parameters(amplitude=0.0, restitution=0.5)
    early, late = (
        measure(inputs, observe((0.0, 0.3), duration=duration, ordering=True), workers)
        for duration in (20.0, 1e15)
    )
    for name in ("dt_min", "dt_min_same_index", "base_shared", "impact_count", "order_changes"):
        assert early[name] == late[name]


@pytest.mark.parametrize("launch", [(0.0,), (0.0, 50.0), (50.0, 51.0)])
def test_without_a_pair_there_is_no_separation(launch, parameters, observe, workers):
    measured = measure(parameters(), observe(launch), workers)
    assert np.isnan(measured["dt_min"])
    assert np.isnan(measured["dt_min_same_index"])
    assert measured["base_shared"] == 0
    assert measured["collision_free"] == 1


def test_late_separations_are_as_accurate_as_early_ones(parameters, observe, workers):
    inputs = parameters(restitution=0.9, amplitude=1.2, frequency=1.25)
    launch = np.array([0.0, 0.125, 0.3125, 0.5])
    early, late = (
        measure(
            inputs,
            observe(launch + start, transient=start + 1.0, duration=start + 9.0),
            workers,
        )
        for start in (0.0, 8e8)  # 1e9 periods
    )
    assert 0.0 < early["dt_min"] < 1e-2
    for name in ("dt_min", "dt_min_same_index", "base_shared", "impact_count"):
        assert early[name] == late[name]


# Smallest gaps in a list of landings, against all pairs.


def listed(whole, phase, who):
    """A list that holds these landings, and room for cells."""
    work = workspace(len(who))
    work.listed[:ORDERED, : len(who)] = whole, phase, np.zeros(len(who)), who
    return work.listed, work.cells


def all_pairs_ordering(whole, phase, who):
    apart = np.abs(np.subtract.outer(whole, whole) + np.subtract.outer(phase, phase))
    inside = (who >= 0)[:, None] & (who >= 0) & ~np.eye(len(who), dtype=bool)
    return np.min(apart, where=inside, initial=np.inf)


@st.composite
def landings(draw):
    """Landings, each of another particle, alone, in clusters and at the same instant."""
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    number = draw(st.integers(2, 200))
    centres = rng.uniform(-0.5, 0.5, draw(st.integers(1, number)))
    width = 10.0 ** -draw(st.integers(0, 17))
    phase = rng.choice(centres, number) + width * rng.uniform(-0.5, 0.5, number)
    phase = np.clip(phase, -0.5, 0.5)
    whole = -1e6 + np.round(rng.uniform(0, draw(st.sampled_from([0.0, 2.0, 300.0])), number))
    early = rng.random(number) < draw(st.sampled_from([0.0, 0.0, 0.5, 1.0]))
    who = np.where(early, -1 - np.arange(number), np.arange(number))
    return whole, phase, who


@given(landings(), st.floats(-14.0, 1.0))
def test_the_closest_of_landings_that_are_not_in_order(given_landings, exponent):
    whole, phase, who = given_landings
    gap = 10.0**exponent
    found = closest(*listed(whole, phase, who), len(who), gap)
    if gap < NARROWEST:
        assert np.isnan(found)
    else:
        assert found == min(gap, all_pairs_ordering(whole, phase, who))


@pytest.mark.parametrize("gap", [np.inf, 0.0, NARROWEST / 2])
def test_gaps_that_only_sorted_landings_can_give_are_nan(gap):
    phase = np.linspace(-0.4, 0.4, 9)
    assert np.isnan(closest(*listed(np.zeros(9), phase, np.arange(9)), 9, gap))


def test_the_gap_of_landings_that_are_too_far_apart_is_nan():
    whole = np.array([0.0, FARTHEST + 1.0])
    assert np.isnan(closest(*listed(whole, np.zeros(2), np.arange(2)), 2, 0.1))


@given(landings(), st.floats(0.0, 400.0))
def test_any_cells_give_the_order_of_time(given_landings, span):
    whole, phase, who = given_landings
    landings_listed, cells = listed(whole, phase, who)
    put_in_order(landings_listed, cells, len(who), whole[0], phase[0], span)
    ordered = landings_listed[ORDERED:, : len(who)]
    assert sorted(ordered[3]) == sorted(who)
    assert np.all(np.diff(ordered[0]) + np.diff(ordered[1]) >= 0.0)
    for values, original in zip(ordered[:2], (whole, phase), strict=True):
        place = np.argsort(who)
        assert np.array_equal(values[np.argsort(ordered[3])], original[place])


# Order of the landings of independent particles, from recorded landings by plain code.

HARMONICS = {"order_1": 1, "order_2": 2, "order_3": 3, "order_half": 1 / 2, "order_third": 1 / 3}
LAUNCH = (0.0, 0.2, 0.2, 0.7)  # two particles coincide from the beginning


def plain(times, frequency, begin, end):
    """Order of landings at these times, shape (particle, impact), between begin and end."""
    landings = sorted((t, p) for p, own in enumerate(times) for t in own[~np.isnan(own)])
    last, changes = {}, 0
    for number, (time, particle) in enumerate(landings):
        waits = particle in last and last[particle] > min(last.values())
        changes += waits and time >= begin
        last[particle] = number
    late = max(begin, end - 1.0 / frequency)
    gaps = [b[0] - a[0] for a, b in pairwise(landings) if a[1] != b[1] and b[0] >= late]
    turns = frequency * np.array([landings[number][0] for number in last.values()])
    found = {name: abs(np.exp(2j * np.pi * h * turns).mean()) for name, h in HARMONICS.items()}
    found |= {"gap_median": np.median(gaps), "gap_min": min(gaps)} if gaps else {}
    return found | {"order_changes": changes}


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
@pytest.mark.parametrize("transient", [0.0, 3.1])
def test_order_is_that_of_the_recorded_landings(
    base, transient, parameters, observe, workers, record
):
    rng = np.random.default_rng(3)
    drawn = {"restitution": rng.uniform(0.3, 0.95, 30), "amplitude": rng.uniform(0.3, 4.0, 30)}
    drawn["frequency"] = rng.uniform(0.8, 1.2, 30)
    given = parameters(**{name: np.tile(values, 2) for name, values in drawn.items()})
    scene = observe(LAUNCH, duration=7.0, transient=transient, base=base, ordering=True)
    found, landed = measure(given, scene, workers), record(given, scene)["landing_time"]
    for i in range(60):  # the second half equals the first and is not computed
        for name, value in plain(landed[i], given["frequency"][i], transient, 7.0).items():
            assert found[name][i] == pytest.approx(value, rel=0.0, abs=1e-12), name
    assert found["order_changes"].max() > 20


def test_particles_that_keep_their_order_keep_their_sequence():
    found = vs.simulate(
        base="moving",
        restitution=0.9,
        base_acceleration=np.linspace(0.2, 0.7, 20),
        launch_velocity=9.81,  # into the slots of mode 2
        launch_time=[0.4, 1.42],
        duration=40.0,
        transient=20.0,
        ordering=True,
    )
    kept = found.order_changes.values == 0
    assert 0 < kept.sum() < 20
    assert not order_of_landings(found, since=20.0).sequence_changes.values[kept].any()


def test_the_order_is_unknown_beyond_the_impact_budget(parameters, observe, workers):
    # the cycle is counted to the end, and landings are not followed that far
    given = parameters(restitution=0.5, amplitude=5.1, launch_velocity=9.81)
    scene = observe((0.3, 1.3), duration=1e5, ordering=True, impact_budget=1000, base="moving")
    found = measure(given, scene, workers)
    assert found["status"] == 0
    assert found["impact_count"] > 10_000
    assert found["order_changes"] == -1
    assert np.isnan([found[name] for name in (*HARMONICS, "gap_median", "gap_min")]).all()


# Separations and order of landings, taken one by one in order of time, against all pairs.

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
    memory = landings_sequence(4, places)
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
    for h, harmonic in enumerate(HARMONICS_SEQUENCE):
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
