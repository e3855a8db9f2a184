"""Faulty tracks: one clear message each."""

import numpy as np
import pytest

from vibrosweep.errors import TrackError
from vibrosweep.lab.experiment import LABORATORY, Camera
from vibrosweep.lab.impacts import find_impacts
from vibrosweep.lab.tracks import make_tracks, table_to_tracks


@pytest.fixture(scope="module")
def sound(irregular):
    """Times (s) and heights (m) of a valid recording."""
    return irregular.tracks["time"].values, irregular.tracks["height"].values


def refusal(call, *arguments, **options):
    with pytest.raises(TrackError) as caught:
        call(*arguments, **options)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_no_positions():
    assert "holds no positions" in refusal(table_to_tracks, [], [], [])
    assert "holds no positions" in refusal(make_tracks, [0.0, 1.0], np.full((2, 1), np.nan))


def test_a_particle_that_is_never_seen_and_shapes_and_names_that_differ():
    heights = np.array([[0.1, np.nan], [0.2, np.nan], [0.1, np.nan]])
    assert "particle 1 has no position" in refusal(make_tracks, [0.0, 1.0, 2.0], heights)
    assert "must be (frame, particle), with 3 frames" in refusal(
        make_tracks, [0.0, 1.0, 2.0], heights[:, 0]
    )
    for names in (["a"], ["a", "a"]):
        message = refusal(make_tracks, [0.0, 1.0, 2.0], np.nan_to_num(heights), names)
        assert "give each of 2 particles a unique name" in message


def test_one_frame():
    assert "holds one frame only" in refusal(table_to_tracks, [0.0, 0.0], [1, 2], [0.1, 0.2])


def test_times_that_are_missing_fall_back_or_appear_twice():
    times = [0.0, np.nan, 0.2]
    assert "row 2 has no time" in refusal(table_to_tracks, times, [1, 1, 1], [0.1, 0.2, 0.3])
    message = refusal(table_to_tracks, [0.0, 0.2, 0.1], [7, 7, 7], [0.1, 0.2, 0.3])
    assert "particle 7 goes back in time, from 0.2 s to 0.1 s" in message
    message = refusal(table_to_tracks, [0.0, 0.1, 0.1, 0.1], [7, 7, 7, 8], [0.1, 0.2, 0.3, 0.3])
    assert "particle 7 has two positions at 0.1 s" in message
    assert "give particles different names" in message


def test_heights_that_are_no_numbers():
    nan = float("nan")
    message = refusal(table_to_tracks, [0.0, 0.1, 0.0, 0.1], [1, 1, 2, 2], [0.1, 0.2, nan, nan])
    assert "particle 2 has no position that is a number" in message
    assert "a height is infinite" in refusal(make_tracks, [0.0, 1.0], [[np.inf], [0.0]])


@pytest.mark.parametrize("motion", ["level", "detect"])
@pytest.mark.parametrize(
    ("factor", "remedy"),
    [(1000.0, "0.001"), (0.001, "1e+03"), (2.0, "0.5"), (1.5, "0.6"), (0.6, "1.7"), (0.25, "4")],
)
def test_wrong_units_and_scales(sound, factor, remedy, motion):
    time, height = sound
    message = refusal(find_impacts, make_tracks(time, factor * height), motion=motion)
    assert "instead of 9.81 m s-2" in message
    assert f"multiply the scale by about {remedy}" in message


def test_times_in_milliseconds(sound):
    time, height = sound
    assert "correct the frame rate" in refusal(find_impacts, make_tracks(1000.0 * time, height))


def test_a_height_axis_that_points_down(sound):
    time, height = sound
    message = refusal(find_impacts, make_tracks(time, -height))
    assert "heights grow downwards" in message
    assert message.endswith("turn the axis")


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_flights_of_all_heights_upside_down(seed):
    """Upside down, the cusps of unequal flights scatter too much to contradict gravity."""
    rng = np.random.default_rng(seed)
    ends = np.cumsum(rng.uniform(0.03, 0.3, 60))  # s, of flights over a base at rest
    time = np.arange(0.0, ends[-2], 1.0 / 240.0)
    flight = np.searchsorted(ends, time)
    start = np.r_[0.0, ends][flight]
    height = 9.81 / 2.0 * (time - start) * (ends[flight] - time)
    height += 1e-4 * rng.standard_normal(time.size)
    message = refusal(find_impacts, make_tracks(time, -height[:, np.newaxis]))
    assert "heights grow downwards" in message
    assert np.isfinite(find_impacts(make_tracks(time, height[:, np.newaxis])).landing_time).any()


def test_a_base_above_the_track(sound):
    tracks = make_tracks(*sound)
    assert "the base at 1 m lies above the whole track" in refusal(find_impacts, tracks, base=1.0)
    middle = float(tracks["height"].quantile(0.7))
    message = refusal(find_impacts, tracks, base=middle)
    assert "above half of the positions" in message


def test_flights_of_too_few_frames(trial):
    fast = {**LABORATORY, "frequency": 35.0, "amplitude": 1.2 / 35.0, "launch_velocity": 5 / 35.0}
    fast["phase"] = np.pi
    slow_camera = Camera(frame_rate=120.0, noise=0.1)
    message = refusal(find_impacts, trial(scene=fast, particles=1, camera=slow_camera).tracks)
    assert "film faster where flights last fewer than five frames" in message


def test_particles_that_do_not_bounce():
    time = np.arange(1000) / 240.0
    noise = 1e-4 * np.random.default_rng(0).standard_normal((1000, 1))
    assert refusal(find_impacts, make_tracks(time, noise))
    assert refusal(find_impacts, make_tracks(time, np.zeros((1000, 1))))
    assert refusal(find_impacts, make_tracks(time[:6], np.linspace(0, 1, 6)[:, np.newaxis]))
