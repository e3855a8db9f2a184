"""Skips do not change results: each is compared with following everything."""

import dataclasses
import math

import numpy as np
import pytest

from tests.cases import each_of
from vibrosweep.engine.landings import record_landings
from vibrosweep.engine.measure import measure, measure_all
from vibrosweep.engine.workers import Workers
from vibrosweep.model.measures import Regime, Status
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import PARAMETERS, Periods
from vibrosweep.scene.scene import Scene

LAWS = ["rest", "reflect"]


def observed(duration, particles, launch="staggered", rebound="rest", **keys):
    asked = {"separation": True, "per_particle": True, "regimes": True}
    return Scene(particles, launch, duration, rebound, Measures(**(asked | keys)))


def drawn(seed, size, **given_):
    rng = np.random.default_rng(seed)
    ranges = {"restitution": (0.3, 0.98), "amplitude": (0.1, 3.5), "phase": (-3.0, 3.0)}
    values = {name: rng.uniform(*bounds, size) for name, bounds in ranges.items()}
    return {
        name: np.full(size, given_.get(name, values.get(name, p.default)), float)
        for name, p in PARAMETERS.items()
    }


def both(parameters, scene):
    """Measures with everything skipped that can be, and with everything followed."""
    with Workers(2) as workers:
        return [
            measure(parameters, dataclasses.replace(scene, skip=skip), workers)
            for skip in (True, False)
        ]


def work(parameters, scene, *, skip=True):
    """Sizes of the tasks that are handed to threads, in their order: first all trajectories."""
    sizes = []

    class Counting(Workers):
        def stream(self, begin, total, periods):
            sizes.append(total)
            super().stream(begin, total, periods)

        def run(self, task, total, size, *results):
            sizes.append(total)
            super().run(task, total, size, *results)

    with Counting(1) as workers:
        measure(parameters, dataclasses.replace(scene, skip=skip), workers)
    return sizes


def assert_same(skipped, followed, *, rtol, rounded=("mean",)):
    """Bit for bit, apart from means, whose sums are added in another order."""
    assert skipped.keys() == followed.keys()
    for name, values in followed.items():
        if name.endswith(rounded):
            np.testing.assert_allclose(skipped[name], values, rtol=rtol, err_msg=name)
        else:
            np.testing.assert_array_equal(skipped[name], values, err_msg=name)


@each_of("rebound", LAWS)
@each_of("transient", [0.0, 321.4])
@each_of("particles", [2, 5, 20])
def test_orbits_that_recur(rebound, transient, particles):
    scene = observed(1500.0, particles, rebound=rebound, transient=transient)
    skipped, followed = both(drawn(11, 120 // particles), scene)
    recurrent = skipped["cycle_impacts"] > 0
    assert recurrent.mean() > 0.2
    # following adds up to 10^5 terms, each time with a rounding of half a unit
    assert_same(skipped, followed, rtol=1e-11)


@pytest.mark.parametrize("particles", [2, 6])
def test_orbits_of_different_pace(particles):
    # resting orbits of hundreds of impacts beside locked ones: at the beginning of the window
    # their impact numbers differ by a factor of hundreds
    launch = tuple(np.random.default_rng(5).uniform(0.0, 3.0, particles))
    scene = observed(700.0, particles, launch=launch, transient=400.0)
    parameters = drawn(12, 60, restitution=np.random.default_rng(6).uniform(0.7, 0.9, 60))
    skipped, followed = both(parameters, scene)
    regime = skipped["regime"]
    mixed = (regime == Regime.LOCKED).any(axis=1) & (regime == Regime.RESTING).any(axis=1)
    assert mixed.sum() >= 3
    assert_same(skipped, followed, rtol=1e-11)


def test_sums_are_closer_to_the_exact_ones_than_those_of_following():
    parameters = drawn(13, 6, restitution=0.85, phase=0.0)
    scene = observed(4000.0, 4, separation=False)
    skipped, followed = both(parameters, scene)
    with Workers(1) as workers:
        everything = scene.with_measures(transient=-math.inf)
        record = record_landings(parameters, everything, workers)
    flights = 2.0 * record["rebound_velocity"] / 9.81
    exact = np.array(
        [[math.fsum(p[~np.isnan(p)]) / np.sum(~np.isnan(p)) for p in r] for r in flights]
    )
    name = "particle_flight_time_mean"
    np.testing.assert_allclose(skipped[name], exact, rtol=1e-12)
    errors = [np.abs(found[name] - exact).max() for found in (skipped, followed)]
    assert errors[0] <= errors[1]


def test_a_late_end_costs_no_impact():
    # so short a budget ends every trajectory that is followed
    parameters = drawn(14, 30, restitution=np.random.default_rng(1).uniform(0.3, 0.8, 30))
    scene = observed(1e9, 3, impact_budget=20_000)
    skipped, followed = both(parameters, scene)
    assert np.all(followed["status"] == 1)
    assert np.mean(skipped["status"] == 0) > 0.9
    known = (skipped["status"] == 0) & ~np.isnan(skipped["dt_min"])
    assert known.mean() > 0.9
    earlier = both(parameters, dataclasses.replace(scene, duration=6000.0))[0]
    for name in ("dt_min", "base_shared", "regime", "rebound_height_max"):
        np.testing.assert_array_equal(skipped[name][known], earlier[name][known], err_msg=name)


def test_problems_with_launches_of_their_own_are_not_confused():
    # the same launch times are other phases at another frequency
    parameters = drawn(16, 2, restitution=0.8, amplitude=1.0, phase=0.0)
    parameters["frequency"] = np.array([1.0, 2.0])
    parameters["gravity"] = np.array([9.81, 19.62])
    parameters["contact_time"] = np.array([2e-4, 1e-4])
    scene = observed(5.0, 2, launch=(0.0, 0.3))
    assert_same(*both(parameters, scene), rtol=0.0)


def test_realizations_without_excitation_have_the_separations_of_their_landings():
    """Particles settle on a base at rest; gaps are compared with those of all landings."""
    rng = np.random.default_rng(18)
    parameters = drawn(18, 40, amplitude=0.0, contact_time=0.01, restitution=0.5)
    parameters["restitution"] = 1.0 - 10.0 ** rng.uniform(-6.0, -0.3, 40)
    scene = observed(12.0, 2, launch=(0.0, 0.8))
    skipped, followed = both(parameters, scene)
    assert_same(skipped, followed, rtol=1e-11)
    with Workers(1) as workers:
        everything = scene.with_measures(transient=-math.inf)
        landing = record_landings(parameters, everything, workers)["landing_time"]
    for i, (one, other) in enumerate(landing):
        gap = np.nanmin(np.abs(one[:, np.newaxis] - other))
        np.testing.assert_allclose(skipped["dt_min"][i], gap, rtol=0.0, atol=1e-14)


def test_particles_that_rounding_merges_are_distinguished_from_those_that_meet():
    """Table 1: launched 1 ms apart they approach by sqrt(e) per impact, and never rest."""
    parameters = drawn(20, 1, restitution=0.9, amplitude=1.2, phase=0.0)
    soon, late = (
        both(parameters, observed(duration, 2, launch=(0.3, 0.301)))[0]
        for duration in (200.0, 2000.0)
    )
    assert late["rest_count"].item() == 0
    assert soon["dt_min"].item() > 0.0
    assert soon["dt_min_resolved"].item() == 1
    assert late["dt_min"].item() == 0.0
    assert late["dt_min_resolved"].item() == 0
    alone = both(parameters, observed(200.0, 1))[0]
    assert alone["dt_min_resolved"].item() == -1


def test_one_particle_has_no_separations():
    parameters = drawn(19, 5)
    skipped, _ = both(parameters, observed(20.0, 1))
    without = work(parameters, observed(20.0, 1, separation=False))
    assert work(parameters, observed(20.0, 1)) == without
    assert len(work(parameters, observed(20.0, 2))) == len(without) + 1
    assert np.all(np.isnan(skipped["dt_min"]))
    assert np.all(skipped["base_shared"] == 0)
    assert np.all(skipped["collision_free"] == 1)


@each_of(
    ("base", "rebound"), [("high-bounce", "rest"), ("high-bounce", "reflect"), ("moving", "rest")]
)
@each_of("late", [False, True])
def test_every_landing_is_counted_once_in_any_number_of_periods(base, rebound, late):
    """Orbits whose cycles divide a common period land as often in each; 2^53 cannot be counted."""
    common, early = 5040, 2**14
    parameters = drawn(3, 400)

    def counts(periods, transient=0):
        scene = observed(Periods(float(periods)), 1, [0.43], rebound, separation=False)
        scene = dataclasses.replace(scene, base=base)
        scene = scene.with_measures(transient=Periods(float(transient)))
        with Workers(2) as workers:
            return measure_all(parameters, scene, workers)

    first, second = (counts(early + k * common) for k in range(2))
    few, cycle = first["impact_count"], first["cycle_periods"].ravel()
    each = second["impact_count"] - few
    repeats = (cycle > 0) & (common % np.maximum(cycle, 1) == 0)
    assert repeats.sum() > 100
    for power in (40, 46, 49, 50):
        times = 2**power // common
        before = times // 2 if late else 0
        found = counts(early + times * common, (early + before * common) if late else 0)
        expected = (0 if late else few.astype(object)) + (times - before) * each.astype(object)
        counted = expected < 2**53
        right = np.where(counted, expected, -1)
        assert (found["impact_count"] == right)[repeats].all()
        assert ((found["status"] == Status.REFUSED) == ~counted)[repeats].all()
        lost = repeats & ~counted
        assert np.isnan(found["flight_time_mean"][lost]).all()
        assert (found["rest_count"][lost] == -1).all()
        assert late or power < 50 or lost.any()


def test_a_sum_over_particles_that_is_too_large_is_refused():
    """Each particle lands fewer than 2^53 times, all of them together more often."""
    parameters = {name: values[:1] for name, values in drawn(3, 1, amplitude=0.6).items()}
    with Workers(2) as workers:
        one, many = (
            measure_all(parameters, observed(Periods(2.0**46), n, separation=False), workers)
            for n in (1, 1000)
        )
    assert one["status"] == Status.COMPLETED
    assert 0 < one["impact_count"] < 2**53
    assert (many["status"], many["impact_count"]) == (Status.REFUSED, -1)
    assert (many["particle_status"] == Status.REFUSED).all()
    assert (many["particle_impact_count"] == -1).all()
