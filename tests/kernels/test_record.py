"""Recorded landings against trajectories with proved error bounds.

Each rounding of the kernel is bounded and carried along the recorded orbit by the product of the
Jacobians that follow it: a landing may be off by the sum of that, and is compared as long as the
sum is small (the orbit's own instability then decides the horizon) and decides no branch.
"""

import numpy as np
import pytest

from vibrosweep import simulate
from vibrosweep.reference.ball import UndecidableError, trajectory
from vibrosweep.scene import dimensionless

LAWS = ["rest", "reflect"]
LANDINGS = 64
HALF_ULP = 2.0**-53
SINE_ERROR = 2.4e-16  # see test_sine.py
LARGEST = 1e-7  # turns; squared, it is below a rounding
SECOND_ORDER = 1.0 + 1e-4
TIMES = (0.0, 0.3371, -7.25)

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


def compare(found, exact, problem, i, p, gravity, frequency, reflect):
    """Compare landings one by one; return how many were, and how many rests among them."""
    e, a, r = problem.restitution[i], problem.kick[i], problem.rest_flight[i]
    x_lift, unit = problem.liftoff_phase[i], gravity / (2.0 * frequency)
    land, leave, speed, rested = (
        found[name][i, p] for name in ("landing_time", "liftoff_time", "rebound_velocity", "rested")
    )
    u = problem.launch_flight[i]
    errors = Errors(4.0 * HALF_ULP, 2.0 * HALF_ULP * u)
    rests = 0
    for n, impact in enumerate(exact.impacts):
        errors.carry(np.array([[1.0, 1.0], [0.0, 1.0]]))
        errors.add(HALF_ULP / 2.0, 0.0)
        off, _ = errors.bounds()
        if off > LARGEST or abs(exact.landing_time[n] - exact_end(problem, i, frequency)) < 1e-9:
            return n, rests
        time = np.abs(exact.landing_time[n]) * 3.0 * HALF_ULP + 3.0 * HALF_ULP / frequency
        assert abs(land[n] - exact.landing_time[n]) <= off / frequency + time

        angle = 2.0 * np.pi * float(impact.phase)
        slope, w = 2.0 * np.pi * a * np.cos(angle), e * u + a * np.sin(angle)
        errors.carry(np.array([[1.0, 0.0], [slope, e]]))
        sine = SINE_ERROR + 3.0 * HALF_ULP * abs(np.sin(angle))
        errors.add(0.0, a * (sine + 20.0 * off**2) + HALF_ULP * abs(w) + 1e-300)
        if reflect and w < 0.0:
            errors.carry(np.diag([1.0, -1.0]))
            w = -w
        off, u_off = errors.bounds()
        if abs(w - r) <= u_off + 4.0 * HALF_ULP * (r + abs(w)):
            return n, rests
        assert rested[n] == impact.rested
        if not impact.rested:
            assert leave[n] == land[n]
            u = float(impact.flight)
            allowed = u_off * unit + 3.0 * HALF_ULP * exact.rebound_velocity[n]
            assert abs(speed[n] - exact.rebound_velocity[n]) <= allowed
            continue
        rests += 1
        if impact.liftoff_time is None:
            assert np.isnan(leave[n])
            assert np.isnan(speed[n])
            return n + 1, rests
        ratio = r / a
        rise = 8.0 * HALF_ULP * (ratio / np.sqrt(1.0 - ratio**2) + 1.0)
        if abs(float(impact.phase) - x_lift) <= off + rise:
            return n, rests
        time = exact.liftoff_time[n] * 3.0 * HALF_ULP
        assert abs(leave[n] - exact.liftoff_time[n]) <= (rise + 3.0 * HALF_ULP) / frequency + abs(
            time
        )
        assert speed[n] == pytest.approx(exact.rebound_velocity[n], rel=4.0 * HALF_ULP)
        u = r
        errors = Errors(rise, HALF_ULP * r)
    if exact.status == 0:
        assert np.isnan(land[len(exact.impacts) :]).all()
    return len(exact.impacts), rests


def exact_end(problem, i, frequency):
    return (problem.end_count[i] + problem.end_phase[i] - problem.phase[i]) / frequency


@pytest.mark.parametrize("rebound", LAWS)
def test_random_scenes_follow_the_proved_trajectories(rebound, random_scenes):
    size, duration = 120, 30.0
    scenes = random_scenes(seed=3, size=size)
    problem = dimensionless(scenes, duration)
    found = simulate(
        **scenes, launch_time=TIMES, duration=duration, rebound=rebound, impact_budget=LANDINGS
    )
    found = {name: values.values for name, values in found.items()}
    compared = rests = 0
    for i in range(size):
        scene = {name: float(values[i]) for name, values in scenes.items()}
        for p, launch_time in enumerate(TIMES):
            try:
                exact = trajectory(
                    **scene,
                    launch_time=launch_time,
                    duration=duration,
                    rebound=rebound,
                    max_impacts=LANDINGS,
                )
            except UndecidableError:
                continue
            landings = compare(
                found,
                exact,
                problem,
                i,
                p,
                scene["gravity"],
                scene["frequency"],
                rebound == "reflect",
            )
            compared, rests = compared + landings[0], rests + landings[1]
    assert compared > 15_000
    assert rests > 500
