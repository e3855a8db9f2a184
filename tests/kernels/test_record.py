"""Recorded landings against trajectories with proved error bounds.

Each rounding of the kernel is bounded and carried along the recorded orbit by the product of the
Jacobians that follow it.  A landing may be off by the sum of these errors; it is compared as long
as the sum is small (the orbit's own instability decides how long) and changes no decision.
"""

import numpy as np
import pytest

from vibrosweep import simulate
from vibrosweep.model.measures import Status
from vibrosweep.model.parameters import dimensionless
from vibrosweep.proof.reference.arithmetic import UndecidableError
from vibrosweep.proof.reference.trajectories import trajectory

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


@pytest.mark.parametrize(("launch_time", "n", "landing", "rebound"), PUBLISHED)
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
