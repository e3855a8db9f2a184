"""Definitions of measures against plain code: all pairs, in doubles, on random landings."""

import itertools
import math

import numpy as np
import pytest
from flint import arb

from vibrosweep.model.measures import Status
from vibrosweep.model.observables import Measures
from vibrosweep.proof.measures import prove_measures
from vibrosweep.proof.reference.motion import Flight, Impact, Trajectory
from vibrosweep.proof.sampling import Realization
from vibrosweep.scene.scene import Scene

PARAMETERS = {
    "restitution": 0.9,
    "amplitude": 1.2,
    "frequency": 1.0,
    "phase": 0.0,
    "gravity": 9.81,
    "launch_velocity": 5.0,
    "contact_time": 0.03,
}


def scene(particles, transient=0.0):
    measures, launch = Measures(transient=transient), tuple(j / particles for j in range(particles))
    made = Scene(particles=particles, launch=launch, duration=10.0, measures=measures)
    return Realization(made, PARAMETERS)


def flight(velocity):
    periods = 2.0 * velocity / 9.81
    return Flight(arb(periods), arb(velocity**2 / 2.0 / 9.81), arb(periods), None)


LAUNCH = flight(5.0)


def trajectory(rng, landings, at_rest):
    """Random landings; every other one is followed by a stay, the last one for good on request."""
    times = np.sort(rng.uniform(0.0, 10.0, landings))
    stays = np.diff(times, append=10.5) * rng.uniform(0.0, 1.0, landings)
    impacts = []
    for n, (time, stay) in enumerate(zip(times.tolist(), stays.tolist(), strict=True)):
        for_good = at_rest and n == landings - 1
        rested = for_good or n % 2 == 0
        velocity = float(rng.uniform(0.0, 6.0))
        impacts.append(
            Impact(
                landing_time=arb(time),
                liftoff_time=None if for_good else arb(time + stay * rested),
                rebound_velocity=None if for_good else arb(velocity),
                rested=rested,
                count=0,
                phase=arb(0),
                flight=None if for_good else flight(velocity),
                arrival=arb(1),
            )
        )
    return Trajectory(LAUNCH, tuple(impacts), at_rest, Status.COMPLETED, 128)


def stays_of(trajectories):
    for particle, t in enumerate(trajectories):
        for number, impact in enumerate(t.impacts):
            land = float(impact.landing_time)
            leave = math.inf if impact.liftoff_time is None else float(impact.liftoff_time)
            yield particle, number, land, max(leave, land + PARAMETERS["contact_time"]), impact


def expected(trajectories, begin):
    stays = list(stays_of(trajectories))
    seen = [s for s in stays if s[2] >= begin]
    pairs = [(a, b) for a, b in itertools.combinations(seen, 2) if a[0] != b[0]]
    gaps = [abs(a[2] - b[2]) for a, b in pairs]
    same = [abs(a[2] - b[2]) for a, b in pairs if a[1] == b[1]]
    overlaps = [
        min(a[3], b[3]) - max(a[2], b[2], begin)
        for a, b in itertools.combinations([s for s in stays if s[3] >= begin], 2)
        if a[0] != b[0]
    ]
    speeds = [float(s[4].rebound_velocity) for s in seen if s[4].rebound_velocity is not None]
    return {
        "impact_count": len(seen),
        "rest_count": sum(s[4].rested for s in seen),
        "at_rest_count": sum(t.at_rest for t in trajectories),
        "rebound_height_mean": np.mean(np.square(speeds)) / 2 / 9.81 if speeds else None,
        "rebound_height_max": max(speeds) ** 2 / 2 / 9.81 if speeds else None,
        "flight_time_mean": 2 * np.mean(speeds) / 9.81 if speeds else None,
        "dt_min": min(gaps, default=None),
        "dt_min_same_index": min(same, default=None),
        "base_shared": int(max(overlaps, default=-1.0) >= 0.0),
        "collision_free": int(max(overlaps, default=-1.0) < 0.0),
    }, max(overlaps, default=None)


def agree(proved, plain):
    if plain is None:
        return proved is None
    return proved is not None and math.isclose(float(proved), plain, rel_tol=1e-9, abs_tol=1e-12)


@pytest.mark.parametrize("transient", [0.0, 4.0])
@pytest.mark.parametrize("seed", range(60))
def test_definitions(seed, transient):
    rng = np.random.default_rng(seed)
    particles, most = int(rng.integers(1, 6)), int(rng.integers(1, 8))
    trajectories = [
        trajectory(rng, int(rng.integers(0, most + 1)), bool(rng.random() < 0.3 and most > 3))
        for _ in range(particles)
    ]
    found = prove_measures(scene(particles, transient), trajectories)
    plain, overlap = expected(trajectories, transient or -math.inf)
    for name, value in plain.items():
        assert agree(found.values[name], value), name
    assert agree(found.overlap, overlap)
    for particle, t in enumerate(trajectories):
        own, _ = expected([t], transient or -math.inf)
        for name in ("impact_count", "rest_count", "rebound_height_mean", "flight_time_mean"):
            assert agree(found.values[f"particle_{name}"][particle], own[name])


def test_launch_counts_for_the_height_only_inside_the_window():
    rng = np.random.default_rng(1)
    launched = 25.0 / (2.0 * 9.81)
    low = trajectory(rng, 3, False)
    for transient, counts in ((0.0, True), (0.5, True), (0.51, False)):
        heights = prove_measures(scene(2, transient), [low, low]).values
        own = heights["rebound_height_max"]
        top = max(float(own), launched) if counts else float(own)
        assert float(heights["flight_height_max"]) == pytest.approx(top, rel=1e-15)


def test_no_landing_at_all():
    nothing = Trajectory(LAUNCH, (), False, Status.COMPLETED, 128)
    values = prove_measures(scene(2), [nothing, nothing]).values
    undefined = {"rebound_height_mean", "rebound_height_max", "flight_time_mean", "dt_min"}
    assert {n for n in undefined if values[n] is None} == undefined
    assert values["impact_count"] == values["base_shared"] == 0
    assert float(values["flight_height_max"]) == pytest.approx(25.0 / (2.0 * 9.81))


def test_squares_beyond_doubles_are_not_finite():
    fast = Impact(arb(1), arb(1), arb(1e200), False, 1, arb(0), flight(1e100), arb(1e100))
    values = prove_measures(
        scene(1), [Trajectory(LAUNCH, (fast,), False, Status.COMPLETED, 128)]
    ).values
    assert values["status"] == Status.NON_FINITE
