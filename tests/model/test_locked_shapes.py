"""Windows of locked orbits of any waveform against closed forms and their definition."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep import theory
from vibrosweep.errors import ParameterError
from vibrosweep.model.locked_theory import (
    DOUBLING,
    FOLD,
    Mode,
    locked_windows,
    mode_of,
    windows_of,
)
from vibrosweep.model.shapes import SINE, Waveform

TWO = Waveform("harmonics", ((1, 1.0, 0.0), (2, 0.4, 1.1)))


def steepest(base, e):
    return 2.0 * (1.0 + e) if base == "high-bounce" else 4.0 * (1.0 + e * e) / (1.0 + e)


def test_two_tones_have_two_windows_that_overlap():
    first, second = windows_of(TWO, mode_of(1, 0.85, "high-bounce"))
    assert (first.low, first.high) == pytest.approx((0.1688, 0.2855), abs=5e-5)
    assert (second.low, second.high) == pytest.approx((0.2852, 0.6657), abs=5e-5)
    assert (first.ends, second.ends) == (FOLD, DOUBLING)


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
@pytest.mark.parametrize("e", [0.1, 0.5, 0.9])
def test_a_sine_has_the_windows_of_its_closed_form(base, e):
    for k in (1, 2, 3):
        (window,) = windows_of(SINE, mode_of(k, e, base))
        need = (1.0 - e) * k
        end = math.hypot(need, steepest(base, e) / (2.0 * math.pi))
        assert abs(window.low - need) <= window.low_error < 1e-13
        assert abs(window.high - end) <= window.high_error < 1e-11


def test_locked_orbits_of_the_parabolic_shape_are_born_at_its_corner():
    (window,) = windows_of(Waveform("parabolic"), mode_of(1, 0.7, "high-bounce"))
    assert (window.low, window.high) == pytest.approx((0.3, 0.85), abs=1e-15)
    (moving,) = windows_of(Waveform("parabolic"), mode_of(1, 0.7, "moving"))
    gammas = 2.0 * np.array([moving.low, moving.high]) / 1.7
    assert gammas == pytest.approx([2.0 * 0.3 / 1.7, 2.0 * 1.49 / 1.7**2], abs=1e-14)


@given(
    st.lists(st.tuples(st.floats(-2.0, 2.0), st.floats(-3.0, 3.0)), min_size=1, max_size=5),
    st.floats(0.0, 0.999),
    st.sampled_from(["high-bounce", "moving"]),
)
def test_the_orbit_attracts_inside_and_nowhere_else(tones, e, base):
    tones = tuple((h, c, psi) for h, (c, psi) in enumerate(tones, 1) if abs(c) > 1e-2)
    if not tones:
        return
    shape, limit = Waveform("harmonics", tones), steepest(base, e)
    x = np.linspace(0.0, 1.0, 2001)
    w, slope = shape.velocity(x), shape.slope(x)
    upwards = w > 1e-6  # where the base rises
    a = np.divide(1.0 - e, w, out=np.full_like(w, np.nan), where=upwards)
    stable = upwards & (slope < -1e-6) & (-a * slope < limit * (1.0 - 1e-6))
    windows = windows_of(shape, mode_of(1, e, base))
    inside = np.zeros(x.size, bool)
    for one in windows:
        assert 0.0 < one.low < one.high
        for shift in (0.0, 1.0, -1.0):
            within = (x + shift > one.from_phase) & (x + shift < one.to_phase)
            assert (-a[within] * slope[within] < limit * (1.0 + 1e-6)).all()
            inside |= within
    assert not (stable & ~inside).any()


def test_the_public_function_has_units_and_takes_waveforms_as_a_scene_does():
    two = {"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}
    for base in ("high-bounce", "moving"):
        known = windows_of(TWO, mode_of(1, 0.85, base))
        found = locked_windows(1, 0.85, two, frequency=2.0, gravity=8.0, base=base)
        assert [one.low for one in found] == pytest.approx([2.0 * one.low for one in known])
    (sine,) = locked_windows(2, 0.9)
    ends = [float(f(2, 0.9)) for f in (theory.amplitude_min, theory.amplitude_max)]
    assert [sine.low, sine.high] == pytest.approx(ends, rel=1e-12)
    with pytest.raises(ParameterError, match="waveform = 'square': must be"):
        locked_windows(1, 0.5, "square")
    with pytest.raises(ParameterError, match=r"restitution = 1\.5"):
        locked_windows(1, 1.5)


@given(st.floats(0.01, 0.5), st.floats(0.5, 4.0), st.floats(1e-9, 1e-4), st.floats(1e-9, 1e-4))
def test_ends_move_no_more_than_the_errors_of_their_conditions_say(need, limit, dn, dm):
    for shape in (TWO, Waveform("parabolic")):
        plain = windows_of(shape, Mode(need, limit))
        doubtful = windows_of(shape, Mode(need, limit, dn, dm))
        moved = windows_of(shape, Mode(need + dn, limit + dm))
        for one, told, other in zip(plain, doubtful, moved, strict=True):
            # a bound to first order
            assert abs(other.low - one.low) <= 1.1 * told.low_error
            if one.ends == FOLD or told.high_error < 1e-2 * one.high:
                assert abs(other.high - one.high) <= 1.1 * told.high_error
