"""Particles on a base of finite mass: massless particles, conserved momentum, and measures."""

import itertools

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.engine import coupled
from vibrosweep.engine.coupled import base_track, measure_coupled
from vibrosweep.engine.landings import all_parameters
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels.bases import Instant
from vibrosweep.kernels.coupled.follow import clear, landings, note, work_for
from vibrosweep.kernels.ordering import Listed
from vibrosweep.model.measures import MEASURES
from vibrosweep.model.observables import Measures
from vibrosweep.scene.scene import Scene

LAUNCHES = (0.0, 0.125, 0.3, 0.55)
MOUNT = {"mass_ratio": 0.02, "mount_frequency": 0.37, "mount_damping": 0.05}


@pytest.mark.parametrize(
    ("restitution", "gamma"),
    [(0.9, 0.4), (0.85, 0.97), (0.5, 2.5), (0.0, 2.2), (0.3, 3.7), (1.0, 0.2)],
)
def test_without_mass_particles_do_not_act_on_each_other(restitution, gamma):
    scene = {"restitution": restitution, "base_acceleration": gamma, "launch_time": list(LAUNCHES)}
    scene["ordering"] = True
    alone = vs.simulate(base="moving", duration=6.0, **scene)
    mount = {"mass_ratio": 0.0, "mount_frequency": 0.6, "mount_damping": 0.1}
    coupled = vs.simulate(base="sprung", duration=6.0, **scene, **mount)
    assert np.array_equal(alone.impact_count, coupled.impact_count)
    assert np.array_equal(alone.rested, coupled.rested)
    ordered = [v.name for v in MEASURES["ordering"].variables]
    for name in ("landing_time", "liftoff_time", "rebound_velocity", *ordered):
        # orbits that are not chaotic over six periods
        np.testing.assert_allclose(coupled[name], alone[name], rtol=0.0, atol=1e-12)


def recorded(parameters, particles=4, duration=8.0):
    """Landings, and the motion of the base."""
    scene = Scene(particles, LAUNCHES[:particles], duration, "rest", base="sprung").recorded(10**6)
    with Workers(1) as workers:
        track = base_track(parameters, scene, workers)
    found = vs.simulate(
        base="sprung",
        launch_time=list(LAUNCHES[:particles]),
        duration=duration,
        **{name: float(values[0]) for name, values in parameters.items()},
    )
    return found.isel(realization=0), track


@pytest.mark.parametrize(
    ("mu", "natural", "damping"), [(0.02, 0.37, 0.05), (0.3, 1.7, 0.0), (0.1, 0.8, 2.0)]
)
def test_each_landing_is_on_the_base_and_each_impact_keeps_momentum(mu, natural, damping):
    given = {"restitution": 0.6, "amplitude": 2.5, "mass_ratio": mu}
    given |= {"mount_frequency": natural, "mount_damping": damping}
    parameters = all_parameters({name: np.array([value]) for name, value in given.items()})
    found, track = recorded(parameters)
    g, e = 9.81, 0.6
    instants = found.landing_time.values[np.isfinite(found.landing_time.values)]
    checked = 0
    for j in range(found.sizes["particle"]):
        n = int(found.impact_count[j])
        lands, leaves = (found[k].values[j, :n] for k in ("landing_time", "liftoff_time"))
        speeds = found.rebound_velocity.values[j, :n]
        for k in range(n - 1):
            if not np.isfinite(leaves[k]):
                continue
            start, _ = track.at(np.array([leaves[k]]))
            flight = lands[k + 1] - leaves[k]
            then, after = track.at(np.array([lands[k + 1]]))
            height = start[0] + speeds[k] * flight - 0.5 * g * flight**2
            assert height == pytest.approx(then[0], abs=1e-11)
            middle = leaves[k] + flight * np.linspace(0.02, 0.98, 49)
            base, _ = track.at(middle)
            path = start[0] + speeds[k] * (middle - leaves[k]) - 0.5 * g * (middle - leaves[k]) ** 2
            assert np.all(path > base - 1e-11)
            if found.rested.values[j, k + 1] or np.sum(abs(instants - lands[k + 1]) < 1e-9) > 1:
                continue
            _, was = track.at(np.array([np.nextafter(lands[k + 1], 0.0)]))
            arrives = speeds[k] - g * flight
            new = speeds[k + 1] if leaves[k + 1] == lands[k + 1] else np.nan
            assert new - after[0] == pytest.approx(e * (was[0] - arrives), abs=1e-10)
            riding = round((mu * (new - arrives) / (was[0] - after[0]) - 1.0) / mu)
            mass = 1.0 + riding * mu  # of the base and its riders
            assert mu * new + mass * after[0] == pytest.approx(
                mu * arrives + mass * was[0], abs=1e-10
            )
            checked += riding == 0
    assert checked > 10


def measured(observation, threads=1, **given):
    parameters = all_parameters({name: np.asarray(values) for name, values in given.items()})
    with Workers(threads) as workers:
        return measure_coupled(parameters, observation, workers)


def test_statistics_are_those_of_the_landings():
    rng = np.random.default_rng(5)
    given = {
        "restitution": rng.uniform(0.3, 0.95, 6),
        "amplitude": rng.uniform(0.5, 9.0, 6),
        "mass_ratio": np.full(6, 0.03),
        "mount_frequency": rng.uniform(0.2, 2.0, 6),
        "mount_damping": np.full(6, 0.05),
    }
    asked = Measures(separation=True, per_particle=True, ordering=True, transient=2.0)
    found = measured(Scene(4, LAUNCHES, 7.0, "rest", asked, base="sprung"), **given)
    record = vs.simulate(base="sprung", launch_time=list(LAUNCHES), duration=7.0, **given)
    for i in range(6):
        one = record.isel(realization=i)
        seen = one.landing_time.values >= 2.0
        assert np.array_equal(found["particle_impact_count"][i], seen.sum(axis=1))
        assert found["rest_count"][i] == (one.rested.values[seen] == 1).sum()
        times = [(t, j) for j in range(4) for t in one.landing_time.values[j][seen[j]]]
        gaps = [abs(s - t) for (s, a), (t, b) in itertools.combinations(times, 2) if a != b]
        assert found["dt_min"][i] == pytest.approx(min(gaps), abs=1e-13)
        same = [
            abs(one.landing_time.values[a, k] - one.landing_time.values[b, k])
            for a, b in itertools.combinations(range(4), 2)
            for k in range(one.sizes["impact"])
            if seen[a, k] and seen[b, k]
        ]
        assert found["dt_min_same_index"][i] == pytest.approx(min(same), abs=1e-13)
        last = np.array([np.nanmax(one.landing_time.values[j]) for j in range(4)])
        phase = np.exp(2j * np.pi * last).mean()
        assert found["order_1"][i] == pytest.approx(abs(phase), abs=1e-12)


@pytest.mark.parametrize("k", [1, 2])
def test_two_particles_in_one_slot_reverse_their_order_at_every_impact(k):
    e, gamma, mu = 0.9, 0.6, 0.001
    a = gamma * (1.0 + e) / np.pi  # 2 f A / g
    phase = 0.5 - np.arcsin((1.0 - e) * k / a) / (2.0 * np.pi)
    found = vs.simulate(
        base="sprung",
        restitution=e,
        base_acceleration=gamma,
        launch_velocity=9.81 * k / 2.0,
        launch_time=[phase, phase + 1e-3],
        duration=300.0,
        mass_ratio=mu,
        mount_frequency=0.37,
        mount_damping=0.05,
    ).isel(realization=0)
    n = int(found.impact_count.min())
    apart = (found.landing_time[0, :n] - found.landing_time[1, :n]).values[-10:]
    assert np.all(apart[1:] * apart[:-1] < 0.0)
    s_m, s = 2.0 * (1.0 + e * e) / (1.0 + e) ** 2, -gamma * np.cos(2.0 * np.pi * phase)
    assert np.abs(apart) == pytest.approx(k * mu / (s_m - s), rel=0.01)  # to first order in mu


def test_results_depend_neither_on_threads_nor_on_the_batch():
    rng = np.random.default_rng(3)
    given = {"restitution": rng.uniform(0.5, 0.95, 40), "amplitude": rng.uniform(0.5, 4.0, 40)}
    given |= {name: np.full(40, value) for name, value in MOUNT.items()}
    asked = Measures(separation=True, per_particle=True, ordering=True)
    scene = Scene(3, "staggered", 5.0, "rest", asked, base="sprung")
    whole = measured(scene, threads=2, **given)
    halves = [
        measured(scene, **{n: v[part] for n, v in given.items()})
        for part in (slice(0, 13), slice(13, 40))
    ]
    for name, values in whole.items():
        parts = np.concatenate([half[name] for half in halves])
        assert np.array_equal(values, parts, equal_nan=values.dtype.kind == "f"), name


def test_particles_at_rest_together_rest_for_good():
    scene = Scene(2, (0.0, 0.4), 60.0, "rest", Measures(ordering=True), base="sprung")
    given = {"restitution": [0.4], "amplitude": [0.4]} | {n: [v] for n, v in MOUNT.items()}
    found = measured(scene, **given)
    assert found["at_rest_count"] == 2
    assert found["status"] == 0


def test_a_realization_without_budget_or_finite_numbers_gets_a_status():
    scene = Scene(2, (0.0, 0.4), 60.0, "rest", Measures(impact_budget=6), base="sprung")
    mount = {n: [v] * 2 for n, v in MOUNT.items()}
    given = {"restitution": [0.9, 0.9], "amplitude": [1.2, 1e25]} | mount
    assert measured(scene, **given)["status"].tolist() == [1, 2]


def test_a_budget_of_just_the_landings_in_the_window_is_enough():
    """Flights that end after the window are followed to their landing, which is not counted."""
    scene = {"restitution": [0.9], "amplitude": [1.2]} | {n: [v] for n, v in MOUNT.items()}
    landed = vs.simulate(base="sprung", launch_time=[0.0, 0.4], duration=8.0, **scene)
    sixth, seventh = landed.landing_time.values[0, 0, 5:7]
    asked = Measures(per_particle=True, impact_budget=6)
    for end, status in ((0.5 * (sixth + seventh), 0), (seventh + 1e-3, 1)):
        watched = Scene(2, (0.0, 0.4), end, "rest", asked, base="sprung")
        found = measured(watched, **scene)
        assert found["particle_impact_count"].max() == 6
        assert found["status"] == status


def test_results_do_not_depend_on_the_initial_memory_for_impact_numbers(monkeypatch):
    given = {"restitution": np.array([0.3, 0.9]), "amplitude": np.array([3.0, 0.8])}
    given |= {name: np.full(2, value) for name, value in MOUNT.items()}
    asked = Measures(separation=True, per_particle=True, ordering=True)
    scene = Scene(3, (0.0, 2.0, 3.5), 8.0, "rest", asked, base="sprung")
    found = measured(scene, **given)
    asked_for = []

    def small(particles):
        asked_for.append(particles)
        return work_for(particles)._replace(landings=landings(particles, 1))

    monkeypatch.setattr(coupled, "work_for", small)
    again = measured(scene, **given)
    assert asked_for
    for name, values in found.items():
        assert values.tobytes() == again[name].tobytes(), name


def test_a_separation_of_equal_numbers_once_unknown_stays_unknown():
    memory = landings(2, 1)
    noted = clear(memory)
    for time, who in ((0.1, 0), (0.2, 0), (0.3, 1), (0.4, 1)):
        # the first landing of particle 1 meets a memory in which that of particle 0 is lost
        landing = Listed(0.0, time, 1e-4, float(who))
        noted = note(memory, noted, landing, False, Instant(0.0, 0.0))
    assert memory.numbered[1, 0] == 0.4
    assert np.isnan(noted.same)


def test_a_stiff_overdamped_mount_moves_nearly_as_its_foot():
    """The recoil decays in 1e-6 periods, which steps along a ride need not resolve."""
    scene = {
        "restitution": [0.0, 0.6],
        "base_acceleration": [1.5, 2.0],
        "launch_time": list(LAUNCHES),
    }
    mount = {"mass_ratio": 1e-3, "mount_frequency": 1e3, "mount_damping": 100.0}
    found = vs.simulate(base="sprung", duration=3.0, **scene, **mount)
    assert np.all(found.status == 0)
    foot = vs.simulate(base="moving", duration=3.0, **scene)
    first = {"impact": slice(0, 3)}
    np.testing.assert_allclose(
        found.landing_time.isel(first), foot.landing_time.isel(first), rtol=0.0, atol=0.01
    )


def test_a_mount_too_stiff_to_be_followed_is_given_up():
    """Steps along a ride resolve the free motion of the mount, which takes 1e-13 periods here."""
    found = vs.simulate(
        base="sprung",
        mass_ratio=1e-3,
        mount_frequency=1e9,
        mount_damping=1e3,
        restitution=0.0,
        launch_time=list(LAUNCHES),
        duration=3.0,
    )
    assert np.all(found.status != 0)


def test_no_landing_after_the_end_is_counted():
    # a landing 0.002 s after the end, found from a time before it
    found = vs.simulate(
        base="sprung",
        restitution=0.8471255169228993,
        amplitude=2.8406517595636323,
        phase=-0.17214200890901177,
        contact_time=0.01,
        mass_ratio=0.3868652278147594,
        mount_frequency=0.28496882145491936,
        mount_damping=1.0604476434834353,
        launch_time=[j / 10 for j in range(10)],
        duration=3.0,
    )
    assert float(found.landing_time.max()) <= 3.0


@pytest.mark.parametrize("mass_ratio", [0.0, 0.01])
def test_a_launch_that_lands_at_once_is_highest_where_it_begins(mass_ratio):
    """The base rises faster than the particle, and carries it from its launch on."""
    found = vs.sweep(
        base="sprung",
        mass_ratio=mass_ratio,
        mount_frequency=0.4,
        amplitude=0.1,
        restitution=0.0,
        launch_velocity=0.01,
        launch=[1.0 / 3.0],
        duration=3.0,
    )
    height = -0.1 / (2.0 * np.pi) * np.cos(2.0 * np.pi / 3.0)
    assert float(found.flight_height_max.squeeze()) == pytest.approx(height, rel=1e-12)
