"""What a camera sees: closed forms of parabolas and of their means over an exposure."""

import numpy as np
import pytest

from vibrosweep.lab.camera import Camera, Motion, film

G = 9.81


@pytest.fixture
def motion():
    start = np.array([0.0, 0.1, 0.35])  # the particle rests between the second and the third
    velocity = np.array([0.1 * G / 2.0, 0.15 * G / 2.0, 0.2 * G / 2.0])
    return Motion(start, start + 2.0 * velocity / G, velocity, G)


def test_heights_are_parabolas_and_zero_while_resting(motion):
    time = np.array([0.0, 0.05, 0.1, 0.175, 0.3, 0.45, 9.0])
    top = [G * t * t / 8.0 for t in (0.1, 0.15, 0.2)]
    expected = [0.0, top[0], 0.0, top[1], 0.0, top[2], 0.0]
    np.testing.assert_allclose(motion.height(time), expected, atol=1e-15)


def test_the_mean_over_an_exposure_is_that_of_a_fine_sum(motion):
    time, exposure, parts = np.linspace(0.02, 0.5, 49), 0.02, 20_000
    inside = (np.arange(parts) + 0.5) / parts - 0.5
    fine = motion.height((time[:, np.newaxis] + exposure * inside).ravel()).reshape(49, -1)
    # the midpoint rule meets kinks: its error is of the order of speed * step
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
