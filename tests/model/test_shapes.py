"""Waveforms and laws of restitution."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vibrosweep as vs
from tests.cases import each_of
from vibrosweep import theory
from vibrosweep.errors import ParameterError, SpecError, TableError
from vibrosweep.model.forcing import completed
from vibrosweep.model.orbit_theory import (
    DOUBLING,
    FOLD,
    OrbitConditions,
    locked_windows,
    mode_of,
    windows_of,
)
from vibrosweep.model.restitution_laws import RESTITUTION_LAWS, range_mistake
from vibrosweep.model.shapes import SINE, Waveform, zeros
from vibrosweep.scene.sweep import keyword_spec, parse_spec

# Shapes of the motion of the base: their sizes against dense samples and closed forms.

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


@settings(max_examples=40)
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


@each_of("one", [SINE, Waveform("parabolic"), TWO_TONES])
@each_of("name", ["base_velocity", "base_displacement", "base_acceleration"])
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


# Windows of locked orbits of any waveform against closed forms and their definition.

TWO = Waveform("harmonics", ((1, 1.0, 0.0), (2, 0.4, 1.1)))


def steepest(base, e):
    return 2.0 * (1.0 + e) if base == "high-bounce" else 4.0 * (1.0 + e * e) / (1.0 + e)


def test_two_tones_have_two_windows_that_overlap():
    first, second = windows_of(TWO, mode_of(1, 0.85, "high-bounce"))
    assert (first.low, first.high) == pytest.approx((0.1688, 0.2855), abs=5e-5)
    assert (second.low, second.high) == pytest.approx((0.2852, 0.6657), abs=5e-5)
    assert (first.ends, second.ends) == (FOLD, DOUBLING)


@each_of("base", ["high-bounce", "moving"])
@each_of("e", [0.1, 0.5, 0.9])
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


@settings(max_examples=40)
@given(st.floats(0.01, 0.5), st.floats(0.5, 4.0), st.floats(1e-9, 1e-4), st.floats(1e-9, 1e-4))
def test_ends_move_no_more_than_the_errors_of_their_conditions_say(need, limit, dn, dm):
    for shape in (TWO, Waveform("parabolic")):
        plain = windows_of(shape, OrbitConditions(need, limit))
        doubtful = windows_of(shape, OrbitConditions(need, limit, dn, dm))
        moved = windows_of(shape, OrbitConditions(need + dn, limit + dm))
        for one, told, other in zip(plain, doubtful, moved, strict=True):
            # a bound to first order
            assert abs(other.low - one.low) <= 1.1 * told.low_error
            if one.ends == FOLD or told.high_error < 1e-2 * one.high:
                assert abs(other.high - one.high) <= 1.1 * told.high_error


# Laws of restitution of a scene: what is refused, and the public closed form.

VISCOELASTIC = {"restitution_law": "viscoelastic", "restitution_speed": 1.0}


@each_of(
    ("given", "said"),
    [
        ({"restitution_law": "plastic"}, 'restitution_speed: is missing; restitution_law = "plas'),
        (
            {"restitution_speed": 1.0},
            "restitution_speed: belongs to a law that depends on the",
        ),
        ({"restitution_law": "plastic", "restitution_speed": 0.0}, "is out of range: the speed of"),
        ({"restitution_law": "plastic", "restitution_speed": -1.0}, "restitution_speed = -1.0"),
        ({"restitution_law": "elastic", "restitution_speed": 1.0}, 'must be "constant", "plastic"'),
        ({**VISCOELASTIC, "restitution": 0.45}, "restitution: 0.45 is out of range: with rest"),
        (
            {**VISCOELASTIC, "restitution": (0.3, 0.9), "realizations": 3},
            "restitution: 0.3 is out of range",
        ),
    ],
)
def test_one_clear_message_for_each_mistake(given, said):
    with pytest.raises(SpecError) as caught:
        keyword_spec(given)
    assert str(caught.value).count("restitution_speed: ") <= 1
    assert said in str(caught.value)


def test_arrays_and_tables_are_checked_too():
    with pytest.raises(ParameterError, match=r"restitution: 0\.3 "):
        vs.simulate(restitution=[0.8, 0.3], **VISCOELASTIC)
    table = {"restitution": [0.8, 0.2], "amplitude": [1.0, 1.0]}
    with pytest.raises(TableError, match=r"restitution: 0\.2 "):
        vs.sweep(design=table, duration=1.0, **VISCOELASTIC)
    with pytest.raises(TableError, match='"restitution_speed" is missing'):
        vs.sweep(design=table, duration=1.0, restitution_law="plastic")


def test_the_speed_of_a_law_may_be_a_column_or_sampled():
    table = {"restitution": [0.8, 0.9], "amplitude": [1.0, 1.0], "restitution_speed": [0.1, 10.0]}
    found = vs.sweep(design=table, duration=3.0, restitution_law="plastic")
    alone = vs.sweep(
        restitution=0.8,
        amplitude=1.0,
        restitution_law="plastic",
        restitution_speed=0.1,
        duration=3.0,
    )
    assert found.attrs["restitution_law"] == "plastic"
    assert found.rebound_height_max[0] == alone.rebound_height_max[0]
    below = vs.sweep(restitution=0.9, amplitude=1.0, duration=3.0)
    assert found.rebound_height_max[1] == below.rebound_height_max[0]


def test_a_record_may_have_another_law():
    spec = parse_spec("""
        title = "two laws"
        [scene]
        restitution_law = "plastic"
        restitution_speed = 0.5
        [record]
        restitution_law = "constant"
    """)
    assert spec.record.restitution_law == "constant"
    assert "restitution_speed" not in spec.record.inputs


def test_closed_form_of_the_ratio():
    at = vs.theory.restitution_at
    v = np.array([0.01, 0.1, 1.0, 10.0, 100.0])
    expected = [0.9128211014984023, 0.8666193534358562, 0.8, 0.7089391881188506, 0.5937733048132544]
    np.testing.assert_allclose(at(v, 0.8, "viscoelastic", 1.0), expected, rtol=4e-16)
    np.testing.assert_allclose(at([0.5, 16.0], 0.8, "plastic", 1.0), [0.8, 0.4], rtol=1e-15)
    assert at([1.0, 2.0], 0.8).tolist() == [0.8, 0.8]
    with pytest.raises(ParameterError, match=r"^law = "):
        at(1.0, 0.8, "elastic")
    with pytest.raises(ParameterError, match="restitution_speed: is missing"):
        at(1.0, 0.8, "plastic")
    assert not any(range_mistake(law, np.array([0.46])) for law in RESTITUTION_LAWS)


def test_the_return_map_holds_the_kick_of_a_law():
    record = vs.simulate(**VISCOELASTIC, restitution=0.8, launch_time=[0.0, 0.125])
    points = vs.analysis.return_map(record)
    assert float(abs(points.kick.where(points.rested == 0)).max()) <= 1.2 * (1.0 + 1e-12)
