"""The motion of a base of finite mass, against the flights and the momentum of a record."""

import numpy as np
import pytest

from vibrosweep import simulate
from vibrosweep.analysis.records import arrival_speeds, base_motion
from vibrosweep.errors import DataError

SCENE = {
    "base": "sprung",
    "mount_frequency": 1.6,
    "restitution": 0.6,
    "base_acceleration": 1.5,
    "launch_time": np.arange(4) / 4.0,
    "contact_time": 1e-2,
    "duration": 6.0,
}


@pytest.fixture(scope="module")
def one():
    return simulate(mass_ratio=0.1, **SCENE).isel(realization=0)


def lift_offs(one):
    """Instants and speeds at which the flights that end with each landing begin."""
    launch = one.launch_time.values[:, np.newaxis]
    speed = np.full_like(launch, float(one.launch_velocity))
    return (
        np.concatenate([launch, one.liftoff_time.values[:, :-1]], axis=1),
        np.concatenate([speed, one.rebound_velocity.values[:, :-1]], axis=1),
    )


def test_every_flight_begins_and_ends_on_the_base(one):
    base, landing = base_motion(one, "test"), one.landing_time.values
    begin, speed = lift_offs(one)
    time = landing - begin
    fallen = base.height(begin) + (speed - float(one.gravity) / 2.0 * time) * time
    assert np.isfinite(fallen).sum() > 30
    np.testing.assert_allclose(fallen, base.height(landing), rtol=0, atol=1e-13)


def test_momentum_is_conserved_and_restitution_is_that_of_the_scene(one):
    base, v = base_motion(one, "test"), -arrival_speeds(one, "test")
    after, rested = one.rebound_velocity.values, one.rested.values == 1
    # where others ride it, the base may have another mass
    alone = np.isfinite(v) & (one.landing_time.values < np.min(one.liftoff_time.values[rested]))
    alone &= ~rested
    assert alone.sum() > 10
    with np.errstate(invalid="ignore"):
        then = base.velocity(one.landing_time.values)
        before = then + 0.1 * (after - v)
    np.testing.assert_allclose((after - then)[alone], (0.6 * (before - v))[alone], atol=1e-12)


def test_the_reach_of_the_base_is_that_of_its_samples(one):
    base = base_motion(one, "test")
    assert base.reach == np.max(np.abs(base.height(np.linspace(0.0, 6.0, 386))))
    assert base.reach != base.displacement


def test_massless_particles_do_not_change_the_motion_of_the_base():
    one = simulate(mass_ratio=0.0, **SCENE).isel(realization=0)
    base, times = base_motion(one, "test"), np.linspace(-1.0, 7.0, 200)
    angle = 2.0 * np.pi * times
    np.testing.assert_allclose(base.height(times), -base.displacement * np.cos(angle), atol=1e-14)
    np.testing.assert_allclose(base.velocity(times), base.speed * np.sin(angle), atol=1e-13)


def test_a_record_without_some_of_the_particles_is_refused(one):
    with pytest.raises(DataError, match=r"^crossings: "):
        base_motion(one.isel(particle=[0, 2]), "crossings")
