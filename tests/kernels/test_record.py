"""Records of landings, and the bounds of their errors."""

import numpy as np
import pytest

from tests.cases import each_of
from vibrosweep import simulate, theory
from vibrosweep.engine.measure import measure
from vibrosweep.proof.reference.arithmetic import UndecidableError
from vibrosweep.proof.reference.trajectories import trajectory

# Published landings.

LAWS = ["rest", "reflect"]
HALF_ULP = 2.0**-53
PUBLISHED = [
    (0.125, 1, 1.144367991845056, 5.445257903944113),
    (0.125, 2, 2.254512314769442, 6.100249854183906),
    (0.125, 8, 8.374024148418671, 5.805960455572309),
    (0.0, 4, 3.245842008111699, 3.309928793279521),
    (0.0, 8, 5.468637186500151, 2.382765998128135),
]


@each_of(("launch_time", "n", "landing", "rebound"), PUBLISHED)
def test_published_impacts(launch_time, n, landing, rebound):
    found = simulate(launch_time=launch_time)[{"realization": 0, "particle": 0, "impact": n - 1}]
    assert found.landing_time.item() == pytest.approx(landing, rel=1e-12)
    assert found.rebound_velocity.item() == pytest.approx(rebound, rel=1e-12)
    assert found.liftoff_time.item() == found.landing_time.item()
    assert found.rested.item() == 0


def test_published_rest():
    found = simulate()[{"realization": 0, "particle": 0}]
    assert np.flatnonzero(found.rested)[0] == 17
    assert found.landing_time[17].item() == pytest.approx(8.845289992383421, rel=1e-12)
    assert found.liftoff_time[17].item() == pytest.approx(9.000065054584800, rel=1e-12)
    assert found.rebound_velocity[17].item() == pytest.approx(9.81 * 1e-4 / 2.0, rel=1e-15)


# Error bounds of trajectories against proved trajectories: they hold, and are often finite.

TOLERANCE = 1e-12
DYADIC = {"gravity": 2.0, "frequency": 1.0}


@pytest.fixture
def bounds(observe, workers):
    """Bounds of one particle in each realization."""

    def find(inputs, launch=0.0, **changes):
        changes = {"separation": False, "per_particle": False, "impact_budget": 2000} | changes
        scene = observe((launch,), trust=True, tolerance=TOLERANCE, **changes)
        found = measure(inputs, scene, workers)
        return (
            found["trusted_until"][:, 0],
            found["landing_time_error"],
            found["rebound_velocity_error"],
        )

    return find


@pytest.mark.parametrize("rebound", LAWS)
@pytest.mark.parametrize("launch", [0.0, -3.7])
def test_every_landing_lies_within_its_bound(
    rebound, launch, random_scenes, observe, record, bounds
):
    size, duration = 100, 12.0
    scenes = random_scenes(seed=31, size=size, contact_time=1e-2)
    until, landing_bound, speed_bound = bounds(scenes, launch, duration=duration, rebound=rebound)
    found = record(scenes, observe((launch,), duration=duration, rebound=rebound))
    bounded = trusted = 0
    for i in range(size):
        inputs = {name: float(values[i]) for name, values in scenes.items()}
        try:
            exact = trajectory(
                **inputs, launch_time=launch, duration=duration, rebound=rebound, max_impacts=2000
            )
        except UndecidableError:
            assert landing_bound[i] == np.inf
            continue
        # the bound is one of the phase; a time in seconds is rounded three times more
        rounding = 3.0 * HALF_ULP * (duration + 1.0 / inputs["frequency"])
        n = len(exact.impacts)
        landing, speed = found["landing_time"][i, 0], found["rebound_velocity"][i, 0]
        if np.isfinite(landing_bound[i]):
            bounded += n
            assert np.isnan(landing[n:]).all()
            assert np.array_equal(found["rested"][i, 0, :n], exact.rested)
            off = np.abs(landing[:n] - exact.landing_time)
            assert np.all(off <= landing_bound[i] + rounding)
            moving = ~np.isnan(exact.rebound_velocity)
            slack = speed_bound[i] + 3.0 * HALF_ULP * exact.rebound_velocity[moving]
            off = np.abs(speed[:n] - exact.rebound_velocity)[moving]
            assert np.all(off <= slack)
        if np.isfinite(until[i]):
            known = exact.landing_time <= until[i] + rounding
            trusted += known.sum()
            off = np.abs(landing[:n] - exact.landing_time)[known]
            assert np.all(off <= TOLERANCE + rounding)
    assert bounded > 1000
    assert trusted > 1000


def test_a_stable_orbit_is_known_for_ever(parameters, bounds):
    inputs = parameters(
        restitution=0.9, amplitude=1.2, launch_velocity=float(theory.locked_velocity(1))
    )
    x = float(theory.locked_phase(1, 0.9, 1.2))
    until, landing, speed = bounds(inputs, x, duration=1e6, impact_budget=2_000_000)
    # a million impacts with multipliers of 0.949: errors settle at a few roundings
    assert until == 1e6
    assert landing < 1e-13
    assert speed < 1e-12


def test_a_rest_erases_the_errors_before_it(parameters, bounds):
    # resting orbits are superstable: only the flights since the last rest can err
    inputs = parameters(restitution=0.3, amplitude=1.2, contact_time=1e-2)
    until, landing, _ = bounds(inputs, duration=2000.0, impact_budget=100_000)
    assert until == 2000.0
    assert landing < 1e-12


def test_chaos_is_known_for_a_while_only(parameters, bounds):
    inputs = parameters(restitution=0.9, amplitude=4.0)
    until, landing, speed = bounds(inputs, 0.3, duration=1000.0, rebound="reflect")
    assert 1.0 < until < 100.0
    assert landing == speed == np.inf


def test_a_tie_is_not_known(parameters, bounds):
    # the landing at t = 3 is at the end of the observation: a rounding decides whether it counts
    inputs = parameters(restitution=1.0, amplitude=0.0, launch_velocity=1.0, **DYADIC)
    until, landing, speed = bounds(inputs, duration=3.0)
    assert until == 2.0
    assert landing == speed == np.inf
    until, landing, speed = bounds(inputs, duration=3.5)
    assert until == 3.5
    assert landing < 1e-14
    assert speed < 1e-14


def test_before_the_first_landing_nothing_can_be_wrong(parameters, bounds):
    until, landing, speed = bounds(parameters(), duration=0.5)
    assert until == 0.5
    assert landing == speed == 0.0


@pytest.mark.parametrize("contact_time", [1e-323, 1e-310, 1e-307])
def test_flights_that_are_subnormal_are_not_trusted(contact_time, parameters, bounds):
    """Their rounding is absolute: whether one is above the threshold of rest cannot be known."""
    inputs = parameters(amplitude=0.0, restitution=0.7, contact_time=contact_time)
    until, landing_error, _ = bounds(inputs, impact_budget=10**6)
    assert landing_error.item() == np.inf
    assert not until.item() >= 12.0
