"""Landings on a base of harmonics against a search that cannot miss one."""

import numpy as np
import pytest

import vibrosweep as vs
from shaped_roots import drawn, judge
from vibrosweep.model.shapes import Waveform

TWO_TONES = {"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}
NAMES = ("landing_time", "liftoff_time", "rebound_velocity")


def test_no_first_landing_is_missed():
    random = np.random.default_rng(7)
    found = judge(drawn(3, random), 20_000, random)
    assert not found.missed.any()
    assert found.error.max() <= 4.0
    assert found.speed_error.max() <= 4.0


def test_a_known_trajectory():
    """Of 40 digits, computed apart from this program."""
    one = vs.simulate(
        restitution=0.85, base_velocity=0.7, phase=0.3, base="moving", waveform=TWO_TONES
    )
    lands, speeds = (one[name].values[0, 0, :2] for name in ("landing_time", "rebound_velocity"))
    assert lands == pytest.approx([1.017557260259823, 2.078479057686624], abs=1e-14)
    assert speeds == pytest.approx([5.238099419590123, 5.544664747235231], abs=1e-14)


def test_one_tone_is_the_sine():
    """Up to rounding, while it has not grown; rests and lift-offs included."""
    scene = {"amplitude": [1.0, 3.0, 5.0], "launch_time": [0.2, 0.0], "base": "moving"}
    scene["restitution"] = 0.3
    sine = vs.simulate(**scene, duration=6.0)
    one = vs.simulate(**scene, duration=6.0, waveform={"harmonics": [[1, 1.0, 0.0]]})
    assert sine.rested.values.any()
    np.testing.assert_array_equal(one.impact_count, sine.impact_count)
    for name in NAMES:
        np.testing.assert_allclose(one[name].values, sine[name].values, rtol=1e-9, atol=1e-9)


def test_lanes_and_records_agree_whatever_the_threads():
    """Statistics of the vector kernel are those of the landings, which are followed one by one."""
    scene = {"waveform": TWO_TONES, "base": "moving", "restitution": 0.6, "duration": 20.0}
    swept = vs.sweep(scene | {"amplitude": [0.5, 2.0, 5.0], "particles": 3, "separation": True})
    again = vs.sweep(
        scene | {"amplitude": [0.5, 2.0, 5.0], "particles": 3, "separation": True}, threads=1
    )
    each = vs.simulate(**scene, amplitude=[0.5, 2.0, 5.0], particles=3)
    np.testing.assert_array_equal(each.impact_count.sum("particle"), swept.impact_count)
    for name in swept.data_vars:
        np.testing.assert_array_equal(swept[name].values, again[name].values)


def test_a_resting_particle_leaves_where_the_base_falls_faster_than_gravity():
    one = vs.simulate(
        waveform=TWO_TONES,
        base="moving",
        restitution=0.0,
        base_acceleration=1.5,
        launch_velocity=0.0,
        duration=4.0,
    )
    rested = one.rested.values[0, 0] == 1
    phases = one.liftoff_time.values[0, 0][rested]
    phases = phases[np.isfinite(phases)]
    assert phases.size
    of_base = Waveform("harmonics", tuple(tuple(tone) for tone in TWO_TONES["harmonics"]))
    acceleration = 1.5 * of_base.slope(phases) / of_base.fall
    assert acceleration == pytest.approx(np.full(phases.size, -1.0), abs=1e-9)
    assert (of_base.slope(phases + 1e-6) < of_base.slope(phases)).all()


def test_positions_show_the_base_as_it_moves():
    forcing = {"base": "moving", "base_velocity": 1.5, "phase": 0.4}
    one = vs.simulate(waveform=TWO_TONES, restitution=0.8, duration=6.0, **forcing)
    lands = one.landing_time.values[0, 0, :4]
    film = vs.positions(one, np.concatenate([lands, np.linspace(0.0, 6.0, 500)]))
    above = (film.height - film.base_height).values[0, 0]
    assert np.abs(above[:4]).max() < 1e-12
    assert above.min() > -1e-12


def test_measures_that_are_not_there_yet_are_refused():
    with pytest.raises(vs.errors.SpecError, match="trust"):
        vs.sweep({"waveform": TWO_TONES, "base": "moving", "trust": True})
