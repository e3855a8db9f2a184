"""Records of landings, and the bounds of their errors."""

import numpy as np
import pytest

from tests.cases import each_of
from vibrosweep import simulate, theory
from vibrosweep.engine.measure import measure
from vibrosweep.model.measures import Status
from vibrosweep.model.parameters import dimensionless
from vibrosweep.proof.reference.arithmetic import UndecidableError
from vibrosweep.proof.reference.trajectories import trajectory

# Recorded landings against trajectories with proved error bounds.
#
# Each rounding of the kernel is bounded and carried along the recorded orbit by the product of the
# Jacobians that follow it.  A landing may be off by the sum of these errors; it is compared as long
# as the sum is small (the orbit's own instability decides how long) and changes no decision.

LAWS = ["rest", "reflect"]
LANDINGS = 64
HALF_ULP = 2.0**-53
SINE_ERROR = 2.4e-16  # see test_sine.py
LARGEST = 1e-7  # turns; squared, it is below a rounding
SECOND_ORDER = 1.0 + 1e-4
TIMES = [0.0, 0.3371, -7.25]
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


class Errors:
    """Bounds of the errors of phase and flight time, as they grow along an orbit."""

    def __init__(self, x, u):
        self.images = np.empty((0, 2, 2))  # of a unit error at each rounding, by columns
        self.sizes = np.empty((0, 2))
        self.add(x, u)

    def add(self, x, u):
        self.images = np.concatenate([self.images, np.eye(2)[np.newaxis]])
        self.sizes = np.concatenate([self.sizes, [[x, u]]])

    def carry(self, jacobian):
        self.images = jacobian @ self.images

    def bounds(self):
        return np.einsum("jik,jk->i", np.abs(self.images), self.sizes) * SECOND_ORDER


class Scene:
    """Dimensionless parameters of one realization, and the errors of its impacts and rests."""

    def __init__(self, problem, i, frequency, gravity, duration, reflect):
        self.e, self.a, self.r = (
            float(values[i]) for values in (problem.restitution, problem.kick, problem.rest_flight)
        )
        self.u0, self.x_lift = float(problem.launch_flight[i]), float(problem.liftoff_phase[i])
        self.frequency, self.unit = frequency, gravity / (2.0 * frequency)
        self.duration, self.reflect = duration, reflect

    def rounding(self, time):
        """Rounding error of a recorded time: a sum of periods and a phase, over the frequency."""
        return 3.0 * HALF_ULP * (abs(time) + 1.0 / self.frequency)

    def lift_error(self):
        """Error of the phase of lift-off, asin(r / a) / 2 pi."""
        ratio = self.r / self.a
        return 8.0 * HALF_ULP * (ratio / np.sqrt(1.0 - ratio**2) + 1.0)

    def impact(self, errors, phase, u):
        """Carry the errors through an impact; return the flight time that would follow."""
        off, _ = errors.bounds()
        sine, cosine = np.sin(2.0 * np.pi * phase), np.cos(2.0 * np.pi * phase)
        w = self.e * u + self.a * sine
        errors.carry(np.array([[1.0, 0.0], [2.0 * np.pi * self.a * cosine, self.e]]))
        kick = self.a * (SINE_ERROR + 3.0 * HALF_ULP * abs(sine) + 20.0 * off**2)
        errors.add(0.0, kick + HALF_ULP * abs(w) + 1e-300)
        if self.reflect and w < 0.0:
            errors.carry(np.diag([1.0, -1.0]))
            w = -w
        return w


def compare(land, leave, speed, rested, exact, scene):
    """Compare landings one by one as far as decisions are certain; count them, and the rests."""
    u, rests = scene.u0, 0
    errors = Errors(4.0 * HALF_ULP, 2.0 * HALF_ULP * u)
    for n, impact in enumerate(exact.impacts):
        errors.carry(np.array([[1.0, 1.0], [0.0, 1.0]]))
        errors.add(HALF_ULP / 2.0, 0.0)
        off, _ = errors.bounds()
        time = exact.landing_time[n]
        if off > LARGEST or abs(time - scene.duration) < off / scene.frequency + 1e-12:
            return n, rests
        assert abs(land[n] - time) <= off / scene.frequency + scene.rounding(time)

        w = scene.impact(errors, float(impact.phase), u)
        _, u_off = errors.bounds()
        if abs(w - scene.r) <= u_off + 4.0 * HALF_ULP * (scene.r + abs(w)):
            return n, rests
        assert rested[n] == impact.rested
        if not impact.rested:
            u, v = float(impact.flight.speed), exact.rebound_velocity[n]
            assert leave[n] == land[n]
            assert abs(speed[n] - v) <= u_off * scene.unit + 3.0 * HALF_ULP * v
            continue
        rests += 1
        if impact.liftoff_time is None:
            assert np.isnan(leave[n])
            assert np.isnan(speed[n])
            return n + 1, rests
        rise = scene.lift_error()
        if abs(float(impact.phase) - scene.x_lift) <= off + rise:
            return n, rests
        time = exact.liftoff_time[n]
        assert abs(leave[n] - time) <= rise / scene.frequency + scene.rounding(time)
        assert speed[n] == pytest.approx(exact.rebound_velocity[n], rel=4.0 * HALF_ULP)
        # a rest erases earlier errors
        u, errors = scene.r, Errors(rise, HALF_ULP * scene.r)
    if exact.status == Status.COMPLETED:
        assert np.isnan(land[len(exact.impacts) :]).all()
    return len(exact.impacts), rests


@pytest.mark.parametrize("rebound", LAWS)
def test_random_scenes_follow_the_proved_trajectories(rebound, random_scenes):
    size, duration = 120, 30.0
    scenes = random_scenes(seed=3, size=size)
    problem = dimensionless(scenes, duration)
    ends = {"duration": duration, "rebound": rebound}
    found = simulate(**scenes, **ends, launch_time=TIMES, impact_budget=LANDINGS)
    names = ("landing_time", "liftoff_time", "rebound_velocity", "rested")
    recorded = [found[name].values for name in names]
    compared = rests = 0
    for i in range(size):
        given = {name: float(values[i]) for name, values in scenes.items()}
        scene = Scene(
            problem, i, given["frequency"], given["gravity"], duration, rebound == "reflect"
        )
        for p, launch_time in enumerate(TIMES):
            try:
                exact = trajectory(**given, **ends, launch_time=launch_time, max_impacts=LANDINGS)
            except UndecidableError:
                continue
            landings = compare(*(values[i, p] for values in recorded), exact, scene)
            compared, rests = compared + landings[0], rests + landings[1]
    assert compared > 15_000
    assert rests > 500


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
