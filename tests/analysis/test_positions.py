"""Positions at any times: parabolas in flight, the base during rests, NaN where unknown."""

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.errors import DataError, ParameterError

BASES = {
    "high-bounce": {},
    "moving": {"base_acceleration": 1.4},
    "sprung": {
        "base_acceleration": 1.5,
        "mass_ratio": 0.1,
        "mount_frequency": 1.6,
        "restitution": 0.3,
    },
}


def scene(base, **changed):
    """A few particles, of which some rest between flights."""
    asked = {"restitution": 0.6, "launch_time": [0.0, 0.3, 0.7], "duration": 8.0} | BASES[base]
    return vs.simulate(base=base, **{**asked, **changed})


@pytest.mark.parametrize("base", BASES)
def test_every_flight_is_a_parabola_from_landing_to_landing(base):
    record = scene(base).isel(realization=0)
    for n in range(3):
        one = record.isel(particle=n)
        begin, end = one.liftoff_time.values[:-1], one.landing_time.values[1:]
        lasts = np.isfinite(end) & (end - begin > 1e-3)
        begin, end, speed = begin[lasts], end[lasts], one.rebound_velocity.values[:-1][lasts]
        assert begin.size > 2
        share = np.array([0.0, 0.2, 0.5, 0.9])
        times = begin + share[:, np.newaxis] * (end - begin)
        found = vs.positions(record.expand_dims("realization"), times.ravel()).isel(realization=0)
        height = found.height.values[n].reshape(times.shape)
        base_height = found.base_height.values.reshape(times.shape)
        # in flight, relative to the start: v s - g s^2 / 2; before that it is on the base
        since = times[1:] - begin
        fallen = height[1:] - base_height[0]
        np.testing.assert_allclose(fallen, since * (speed - 9.81 / 2.0 * since), atol=1e-12)
        landed = vs.positions(record.expand_dims("realization"), end).isel(realization=0)
        np.testing.assert_allclose(landed.height.values[n], landed.base_height, atol=1e-12)


@pytest.mark.parametrize("base", BASES)
def test_a_particle_at_rest_follows_the_base_and_none_is_below_it(base):
    record = scene(base)
    found = vs.positions(record, np.linspace(0.0, 8.0, 4001)).isel(realization=0)
    clearance = (found.height - found.base_height).values
    one = record.isel(realization=0)
    rests = np.zeros(clearance.shape, bool)
    for n in range(3):
        mine = one.isel(particle=n)
        for begin, end in zip(
            mine.landing_time.values[mine.rested == 1],
            mine.liftoff_time.values[mine.rested == 1],
            strict=True,
        ):
            rests[n] |= (found.time.values >= begin) & ~(found.time.values >= end)
    assert np.count_nonzero(rests) > 100
    assert np.all(clearance[rests] == 0.0)
    assert np.nanmin(clearance) > -1e-12
    if base == "high-bounce":
        assert np.all(found.base_height == 0.0)


def test_the_moving_base_is_the_sine_of_the_forcing():
    times = np.linspace(0.0, 8.0, 300)
    found = vs.positions(scene("moving", frequency=2.0, phase=0.4), times)
    displacement = 1.4 * 9.81 / (4.0 * np.pi) ** 2
    expected = -displacement * np.cos(4.0 * np.pi * times + 0.4)
    np.testing.assert_allclose(found.base_height.values[0], expected, atol=1e-14)


def test_a_rest_for_good_lasts_to_the_end_and_before_its_launch_a_particle_is_nowhere():
    record = vs.simulate(base="moving", base_acceleration=0.5, launch_time=[1.0], duration=60.0)
    found = vs.positions(record, [0.5, 1.0, 60.0])
    assert np.isnan(found.height.values[0, 0, 0])
    np.testing.assert_array_equal(found.height.values[0, 0, 1:], found.base_height.values[0, 1:])


def test_positions_after_a_particle_was_given_up_are_nan():
    record = scene("moving", impact_budget=2)
    assert np.isnan(vs.positions(record, [8.0]).height).all()


def test_realizations_are_apart():
    record, times = vs.simulate(restitution=[0.7, 0.9], launch_time=[0.0, 0.125]), [0.5, 3.0, 11.0]
    found = vs.positions(record, times).isel(realization=1)
    alone = vs.positions(record.isel(realization=[1]), times)
    np.testing.assert_array_equal(alone.height.values[0], found.height.values)


def test_the_record_of_a_sweep_gives_the_same_as_the_scene(tmp_path):
    scene = {"amplitude": 1.1, "particles": 3, "duration": 8.0}
    vs.run({"record": scene}, tmp_path / "out.h5").close()
    times = np.linspace(0.0, 8.0, 100)
    with vs.open_record(tmp_path / "out.h5") as record:
        kept = vs.positions(record, times).height.values
    direct = vs.positions(
        vs.simulate(amplitude=1.1, launch_time=np.arange(3) / 3, duration=8.0), times
    )
    np.testing.assert_allclose(kept, direct.height.values, atol=1e-9)


@pytest.mark.parametrize("times", [[[0.0]], [np.nan], 1.0])
def test_times_must_be_a_list_of_finite_numbers(times):
    with pytest.raises(ParameterError, match="times"):
        vs.positions(vs.simulate(), times)


def test_times_after_the_end_of_the_record_are_refused():
    with pytest.raises(DataError, match="12 s"):
        vs.positions(vs.simulate(), [0.0, 12.1])
