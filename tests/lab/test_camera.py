"""Filmed heights: closed forms for parabolas and their means over an exposure."""

import numpy as np
import pytest

from vibrosweep.lab.experiment import LEVEL, Camera, Motion, film, oscillating_surface

G = 9.81


SCENE = {"restitution": 0.9, "amplitude": 0.06, "frequency": 20.0, "phase": 0.3}


@pytest.fixture
def motion():
    start = np.array([0.0, 0.1, 0.35])  # the particle rests between the second and the third
    velocity = np.array([0.1 * G / 2.0, 0.15 * G / 2.0, 0.2 * G / 2.0])
    return Motion(start, start + 2.0 * velocity / G, velocity, np.zeros(3), G, LEVEL)


@pytest.fixture
def on_a_moving_base():
    """A flight, a stay, and a flight that does not end."""
    surface, start, end = oscillating_surface(SCENE), np.array([0.0, 0.35]), np.array([0.2, np.inf])
    rise = surface.height(start)
    fallen = surface.height(end[:1])[0] - rise[0]
    velocity = np.array([fallen / 0.2 + 0.1 * G, 0.7])
    return Motion(start, end, velocity, rise, G, surface)


def test_heights_are_parabolas_and_zero_while_resting(motion):
    time = np.array([0.0, 0.05, 0.1, 0.175, 0.3, 0.45, 9.0])
    top = [G * t * t / 8.0 for t in (0.1, 0.15, 0.2)]
    expected = [0.0, top[0], 0.0, top[1], 0.0, top[2], 0.0]
    np.testing.assert_allclose(motion.height(time), expected, atol=1e-15)


def test_a_moving_base_carries_what_rests_on_it(on_a_moving_base):
    time = np.array([-0.01, 0.1, 0.25, 0.3, 0.4])
    size = 0.06 / (1.9 * 2.0 * np.pi * 20.0)
    base = -size * np.cos(2.0 * np.pi * 20.0 * time + 0.3)
    found = on_a_moving_base.height(time)
    np.testing.assert_allclose(found[[0, 2, 3]], base[[0, 2, 3]], atol=1e-15)
    assert found[1] == pytest.approx(on_a_moving_base.apex[0], abs=1e-5)
    # without a jump at the landing
    np.testing.assert_allclose(
        *on_a_moving_base.height(np.array([0.2 - 1e-9, 0.2 + 1e-9])), atol=1e-8
    )


@pytest.mark.parametrize("which", ["motion", "on_a_moving_base"])
def test_the_mean_over_an_exposure_agrees_with_the_midpoint_rule(which, request):
    motion = request.getfixturevalue(which)
    time, exposure, parts = np.linspace(0.02, 0.5, 49), 0.02, 20_000
    inside = (np.arange(parts) + 0.5) / parts - 0.5
    fine = motion.height((time[:, np.newaxis] + exposure * inside).ravel()).reshape(49, -1)
    # because of kinks the error of the midpoint rule is of order speed * step
    np.testing.assert_allclose(motion.mean_height(time, exposure), fine.mean(axis=1), atol=1e-9)


def test_pixels_noise_scale_and_lost_frames():
    true = np.full((20_000, 2), 1.234e-3)
    rng = np.random.default_rng(0)
    plain = film(true, Camera(pixel=1e-4, noise=0.0), rng)
    assert set(np.unique(plain.round(12))) == {1.2e-3}
    scaled = film(true, Camera(noise=0.0, whole_pixels=False, scale_error=0.1), rng)
    np.testing.assert_allclose(scaled, 1.1 * true)
    noisy = film(true, Camera(pixel=1e-4, noise=2.0, whole_pixels=False, dropped=0.25), rng)
    lost = np.isnan(noisy)
    assert (lost[:, 0] == lost[:, 1]).all()
    assert lost[:, 0].mean() == pytest.approx(0.25, abs=0.02)
    assert np.nanstd(noisy) == pytest.approx(2e-4, rel=0.02)
