"""Shapes of the motion of the base: their sizes against dense samples and closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep import theory
from vibrosweep.errors import ParameterError
from vibrosweep.model.forcing import completed
from vibrosweep.model.shapes import SINE, Waveform, zeros

TURNS = np.linspace(-0.5, 0.5, 20001)
TWO_TONES = Waveform("harmonics", ((1, 1.0, 0.0), (2, 0.4, 1.1)))


@st.composite
def waveforms(draw):
    numbers = draw(st.sets(st.integers(1, 16), min_size=1, max_size=8))
    weight, phase = st.floats(0.05, 1.0), st.floats(-3.0, 3.0)
    return Waveform("harmonics", tuple((h, draw(weight), draw(phase)) for h in sorted(numbers)))


@pytest.mark.parametrize("one", [SINE, Waveform("parabolic"), TWO_TONES], ids=lambda one: one.name)
def test_velocity_is_the_derivative_of_the_height_and_both_have_mean_zero(one):
    x, step = np.array([-0.41, -0.2, 0.07, 0.33]), 1e-6
    for whole, derivative in ((one.height, one.velocity), (one.velocity, one.slope)):
        rise = (whole(x + step) - whole(x - step)) / (2.0 * step)
        assert derivative(x) == pytest.approx(rise, abs=1e-7)
        assert abs(whole(TURNS[:-1]).mean()) < 1e-12


@given(waveforms())
def test_sizes_are_those_of_dense_samples(one):
    size = one.sum_of(3) * (TURNS[1] - TURNS[0]) ** 2
    assert one.highest == pytest.approx(one.velocity(TURNS).max(), abs=size)
    assert one.fall == pytest.approx(-one.slope(TURNS).min(), abs=one.sum_of(3) * 1e-8)
    spread = np.ptp(one.height(TURNS))
    assert 2.0 / one.per_displacement == pytest.approx(spread, abs=size)


@given(waveforms(), st.sampled_from(["velocity", "slope"]))
def test_no_zero_is_missed(one, name):
    derivative, order = getattr(one, name), ["velocity", "slope"].index(name)
    found = zeros(one, order)
    signs = np.sign(derivative(TURNS[:-1] + 1e-9))
    assert found.size >= np.count_nonzero(signs != np.roll(signs, 1))
    assert np.abs(derivative(found)).max() < 1e-9 * one.sum_of(order + 1)


def test_one_harmonic_is_the_sine():
    one = Waveform("harmonics", ((1, 1.0, 0.0),))
    for name in ("highest", "per_displacement", "fall"):
        assert getattr(one, name) == pytest.approx(getattr(SINE, name), rel=1e-14)


@given(st.floats(-1e6, 1e6))
def test_whole_turns_of_a_phase_cost_no_digits(phase):
    one = Waveform("harmonics", ((3, 1.0, phase),))
    assert float(one.velocity(0.0)) == pytest.approx(math.sin(phase), abs=2e-15)
    assert float(one.height(0.0)) * 6.0 * math.pi == pytest.approx(-math.cos(phase), abs=2e-15)


def test_upward_and_downward_acceleration_differ():
    two = Waveform("harmonics", ((1, 1.0, 0.0), (2, 0.4, 0.0)))
    upward = two.slope(TURNS).max()
    assert upward == pytest.approx(2.0 * np.pi * 1.8, rel=1e-9)
    assert two.fall < upward / 1.5


@pytest.mark.parametrize("one", [SINE, Waveform("parabolic"), TWO_TONES], ids=lambda one: one.name)
@pytest.mark.parametrize("name", ["base_velocity", "base_displacement", "base_acceleration"])
def test_each_forcing_gives_the_amplitude_from_which_it_follows(one, name):
    shared = {"restitution": 0.8, "frequency": 3.0, "gravity": 9.81}
    velocity = 0.7
    value = {
        "base_velocity": velocity,
        "base_displacement": velocity / 3.0 * np.ptp(one.height(TURNS)) / 2.0,
        "base_acceleration": -velocity * 3.0 * one.slope(TURNS).min() / 9.81,
    }[name]
    given = {key: np.array([number]) for key, number in (shared | {name: value}).items()}
    found = completed(given, one)
    assert found["amplitude"][0] == pytest.approx(1.8 * velocity, rel=1e-6)
    again = completed({**given, name: given[name]}, one)["base_acceleration"][0]
    assert again == pytest.approx(-velocity * 3.0 * one.slope(TURNS).min() / 9.81, rel=1e-6)


@given(waveforms(), st.floats(-3.0, 3.0))
def test_the_public_motion_of_the_base_is_that_of_the_sum(one, x):
    velocity, height = theory.base_motion(x, {"harmonics": [list(tone) for tone in one.tones]})
    angles = [(h, c, 2.0 * math.pi * h * x + psi) for h, c, psi in one.tones]
    assert velocity == pytest.approx(sum(c * math.sin(a) for _, c, a in angles), abs=1e-12)
    level = -sum(c * math.cos(a) / (2.0 * math.pi * h) for h, c, a in angles)
    assert height == pytest.approx(level, abs=1e-12)
    with pytest.raises(ParameterError, match="waveform = 'square'"):
        theory.base_motion(x, "square")
