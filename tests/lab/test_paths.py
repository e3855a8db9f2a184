"""Integrated paths of balls, against closed forms and the kernels."""

import dataclasses
import math

import numpy as np
import pytest

from vibrosweep.errors import ParameterError
from vibrosweep.lab.ballistics import Input, flight_of
from vibrosweep.lab.base_fit import Contacts, Inputs, Problem
from vibrosweep.lab.experiment import (
    CONTACTS,
    LEVEL,
    Camera,
    Experiment,
    Variation,
    oscillating_surface,
)
from vibrosweep.lab.flights import Fits, meet
from vibrosweep.lab.paths import Ball, compress, path_of
from vibrosweep.lab.trials import perform_trials

G = 9.81
SCENE = {"frequency": 20.0, "phase": 0.3, "restitution": 0.7}
SCENE["amplitude"] = 1.7 * 2.5 * G / (2.0 * math.pi * SCENE["frequency"])
SURFACE = oscillating_surface(SCENE)


def ball(contact="dashpot", contact_time=0.0, drag=0.0):
    return Ball(lambda _: SCENE["restitution"], G, drag, contact, contact_time, 2.5e-5)


@pytest.mark.parametrize("contact", CONTACTS)
@pytest.mark.parametrize("e", [0.4, 0.7, 0.95, 1.0])
def test_a_contact_with_a_plane_at_rest_has_its_restitution_and_duration(contact, e):
    run = compress(e, contact)
    assert -run.y[1, -1] == pytest.approx(e, abs=1e-7)
    assert run.t[-1] == pytest.approx(1.0, abs=1e-5)


def test_a_spring_under_a_constant_push_is_elastic_and_takes_longer():
    """x = sin(pi t) / pi + (1 - cos(pi t)) push / pi^2, from 0 to 0."""
    run = compress(1.0, "dashpot", lambda _: 0.4)
    assert run.y[1, -1] == pytest.approx(-1.0, abs=1e-6)
    assert run.t[-1] == pytest.approx(2.0 - 2.0 * math.atan(math.pi / 0.4) / math.pi, abs=1e-6)


@pytest.mark.parametrize("speed", [0.3, 3.0])
def test_drag_has_its_closed_form(speed):
    drag = 1.0 / 15.0**2
    path, record = path_of(ball(drag=drag), LEVEL, 0.0, speed, 1.0, 1e-3)
    nominal = np.sqrt(np.log1p(drag * speed**2) / drag)
    _, lands, rise, fall = flight_of(np.asarray(nominal), G, drag)
    assert path.top[0] == pytest.approx(nominal**2 / (2.0 * G), rel=1e-7)
    assert record.landing_time[0, 0] == pytest.approx(rise + fall, rel=1e-7)
    assert record.rebound_velocity[0, 0] == pytest.approx(0.7 * lands, rel=1e-7)


@pytest.mark.parametrize("gamma", [0.9, 3.0])
def test_without_imperfections_the_landings_are_those_of_the_kernel(gamma):
    """Until rounding errors grow on the irregular orbit; among them are stays on the base."""
    scene = {"base": "moving", "base_acceleration": gamma, "restitution": 0.5, "particles": 2}
    plan = Experiment(**scene, repeats=1, transient=0.0, duration=1.0)
    slowest = dataclasses.replace(plan.variation, terminal_speed=1e12)
    same = Experiment(plan.scene, repeats=1, variation=slowest)
    one, other = perform_trials(plan)[0].record, perform_trials(same)[0].record
    few = (slice(None), slice(25))
    assert other.rested[few].any()
    for name in ("landing_time", "liftoff_time", "rebound_velocity", "rested"):
        np.testing.assert_allclose(getattr(other, name)[few], getattr(one, name)[few], atol=1e-9)


def test_scatter_has_its_size_and_stays_the_same_for_a_seed():
    scene = {"base": "moving", "base_acceleration": 3.0, "particles": 3, "repeats": 1}
    times = {"transient": 0.0, "duration": 2.0}
    plan = Experiment(**scene, **times, variation=Variation(scatter=0.01))
    first, again = (perform_trials(plan)[0].record for _ in range(2))
    np.testing.assert_array_equal(first.landing_time, again.landing_time)
    plain = perform_trials(Experiment(**scene, **times))[0].record
    v = first.rebound_velocity[:, 0] - plain.rebound_velocity[:, 0]
    assert 0.0 < np.abs(v).max() < 0.05


def test_stamps_are_rounded():
    scene = {"base": "moving", "base_acceleration": 3.0, "particles": 1, "repeats": 1}
    plan = Experiment(**scene, transient=0.0, duration=1.0, camera=Camera(rounding=1e-3))
    time = perform_trials(plan)[0].tracks["time"].values
    np.testing.assert_allclose(time, np.round(time, 3), atol=1e-12)
    assert time.size == 240


@pytest.mark.parametrize("base", ["high-bounce", "sprung"])
def test_integrated_contacts_need_a_moving_base(base):
    mount = {"mass_ratio": 0.01, "mount_frequency": 7.0} if base == "sprung" else {}
    with pytest.raises(ParameterError, match='need base = "moving"'):
        Experiment(base=base, **mount, variation=Variation(contact_time=1e-3))


@pytest.mark.parametrize("contact_time", [1e-6, -1.0, 0.2])
def test_contact_times_outside_their_range_are_refused(contact_time):
    with pytest.raises(ParameterError, match="contact_time = "):
        Variation(contact_time=contact_time)


@pytest.mark.parametrize("contact", CONTACTS)
@pytest.mark.parametrize(
    ("contact_time", "frequency"), [(2e-4, 20.0), (1e-3, 20.0), (2e-3, 20.0), (2e-3, 38.0)]
)
def test_the_equations_of_the_estimator_hold_on_integrated_paths(contact, contact_time, frequency):
    """Heights to a micrometre, speeds to 1 mm/s, a hundredth of the effect of a long contact."""
    drag, end, gamma = 1e-3, 3.0, 2.5 if frequency == 20.0 else 3.7
    size = gamma * G / (2.0 * math.pi * frequency)
    surface = oscillating_surface(SCENE | {"frequency": frequency, "amplitude": 1.7 * size})
    path, _ = path_of(ball(contact, contact_time, drag), surface, 0.0, 0.3, end, 2.5e-4)
    lasts = path.end - path.start
    stays = path.start[1:] - path.end[:-1]
    k = np.flatnonzero(
        (lasts[:-1] > 0.01) & (lasts[1:] > 0.01) & np.isfinite(lasts[1:]) & (stays < 5e-3)
    )

    def fits(k):
        """Parabolas fitted to many even samples of each flight."""
        centre, half = (path.start[k] + path.end[k]) / 2.0, lasts[k] / 2.0
        since = half[:, np.newaxis] * np.linspace(-1.0, 1.0, 401)
        height = path.height((centre[:, np.newaxis] + since).ravel()).reshape(since.shape)
        straight = height + 0.5 * G * since**2
        spread = (since**2).sum(axis=1)
        slope = (since * straight).sum(axis=1) / spread
        number = np.full(k.size, 401.0)
        return Fits(number, centre, spread, straight.mean(axis=1), slope, 0.0 * number)

    before, after = fits(k), fits(k + 1)
    met = meet(before, after, path.end[k], G)
    arrival = before.slope - G * (met.time - before.centre)
    owner = np.zeros(k.size, np.intp)
    contacts = Contacts(
        *(before, after, owner, owner > 0, met.time, met.height, arrival, arrival + met.closing),
        *(1e-5, G),
    )
    problem = Problem(contacts, owner, frequency, 1.0, None, Inputs(Input(G)))
    law = (0.2, 1.0) if contact == "hertz" else (0.0, 0.0)
    motion = size * math.cos(0.3), size * math.sin(0.3)
    values = np.array([0.7, *motion, 0.0, G, drag, *law, contact_time])
    left, *_ = problem.equations(values)
    assert k.size > 15
    assert np.sqrt(np.mean(left[:, 0] ** 2)) < 1e-6
    assert np.sqrt(np.mean(left[:, 1] ** 2)) < 1e-3
