"""Faulty tracks: one clear message each, and defects that are reported."""

import numpy as np
import pytest

from vibrosweep.errors import TrackError
from vibrosweep.lab.experiment import LABORATORY, Camera
from vibrosweep.lab.impacts import find_impacts
from vibrosweep.lab.tracks import find_swaps, make_tracks, remarks


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


def test_arrays_that_hold_no_tracks():
    heights = np.array([[0.1, np.nan], [0.2, np.nan], [0.1, np.nan]])
    times, numbers = [0.0, 1.0, 2.0], np.nan_to_num(heights)
    for arguments, message in (
        (([0.0, 1.0], np.full((2, 1), np.nan)), "holds no positions"),
        ((times, heights), "particle 1 has no position that is a number"),
        ((times, heights[:, 0]), "must be (frame, particle), with 3 frames"),
        ((times, numbers, ["a"]), "give each of 2 particles a unique name"),
        ((times, numbers, ["a", "a"]), "give each of 2 particles a unique name"),
        (([0.0], numbers[:1]), "holds one frame only"),
        (([0.0, 2.0, 1.0], numbers), "the times do not rise"),
        (([0.0, 1.0], [[np.inf], [0.0]]), "a height is infinite"),
        (("x", "y"), "times and heights must be numbers"),
    ):
        assert message in refusal(make_tracks, *arguments)


@pytest.mark.parametrize(
    ("factor", "remedy", "motion"),
    [
        (1e3, "0.001", "level"),
        (1e-3, "1e+03", "detect"),
        (1.5, "0.6", "detect"),
        (0.25, "4", "level"),
    ],
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


def test_flights_of_all_heights_upside_down():
    """Upside down, the cusps of unequal flights scatter too much to contradict gravity."""
    rng = np.random.default_rng(1)
    ends = np.cumsum(rng.uniform(0.03, 0.3, 60))  # s, of flights over a base at rest
    time = np.arange(0.0, ends[-2], 1.0 / 240.0)
    flight = np.searchsorted(ends, time)
    start = np.r_[0.0, ends][flight]
    height = 9.81 / 2.0 * (time - start) * (ends[flight] - time)
    height += 1e-4 * rng.standard_normal(time.size)
    message = refusal(find_impacts, make_tracks(time, -height[:, np.newaxis]))
    assert "heights grow downwards" in message
    tracks = make_tracks(time, height[:, np.newaxis])
    assert np.isfinite(find_impacts(tracks, motion="level").landing_time).any()


def test_a_base_above_the_track(sound):
    tracks = make_tracks(*sound)
    assert "the base at 1 m lies above the whole track" in refusal(find_impacts, tracks, base=1.0)
    middle = float(tracks["height"].quantile(0.7))
    message = refusal(find_impacts, tracks, base=middle)
    assert "above half of the positions" in message


def test_flights_of_too_few_frames(trial):
    fast = {**LABORATORY, "frequency": 35.0, "amplitude": 1.2 / 35.0, "launch_velocity": 5 / 35.0}
    fast["phase"] = np.pi
    film = trial(scene=fast, particles=1, camera=Camera(frame_rate=80.0, noise=0.1))
    message = refusal(find_impacts, film.tracks)
    assert "film faster where flights last fewer than five frames" in message
    # 3.4 frames, most of them three in a flight, are enough
    film = trial(scene=fast, particles=1, camera=Camera(frame_rate=120.0, noise=0.1))
    found = find_impacts(film.tracks).isel(particle=0)
    true = film.record.landing_time[0]
    true = true[(true > film.tracks["time"].values[2]) & (true < film.tracks["time"].values[-3])]
    assert abs(int(found["impact_count"]) - true.size) <= 2
    landed = found["landing_time"].values
    off = np.abs(landed[:, np.newaxis] - true).min(axis=1)
    assert 0.6 < np.mean(off < found["landing_time_error"].values) < 0.85


def test_particles_that_do_not_bounce():
    time = np.arange(1000) / 240.0
    noise = 1e-4 * np.random.default_rng(0).standard_normal((1000, 1))
    assert refusal(find_impacts, make_tracks(time, noise))
    assert refusal(find_impacts, make_tracks(time, np.zeros((1000, 1))))
    assert refusal(find_impacts, make_tracks(time[:6], np.linspace(0, 1, 6)[:, np.newaxis]))


# --- Defects are reported for each particle, and no flight spans them ---


def changed(tracks, change):
    copy = tracks.copy(deep=True)
    change(copy["height"].values)
    return copy


def test_gaps_lost_frames_and_a_particle_that_leaves(irregular, found):
    def spoil(height):
        height[500:540, 0] = np.nan
        height[700, 0] = np.nan
        height[1500:, 1] = np.nan
        height[:300, 2] = np.nan

    seen = find_impacts(changed(irregular.tracks, spoil), motion="level")
    assert seen["frames_lost"].values.tolist() == [41, 0, 0]
    assert seen["gaps"].values.tolist() == [1, 0, 0]
    lines = "\n".join(remarks(seen))
    time = irregular.tracks["time"].values
    assert "particle 0: 41 of its frames lost; 1 gaps too long for finding a landing" in lines
    assert f"particle 1: leaves the view at {time[1499]:.3f} s" in lines
    assert f"particle 2: comes into view at {time[300]:.3f} s" in lines
    landed = seen["landing_time"].values
    assert not ((landed[0] > time[499]) & (landed[0] < time[540])).any()
    assert np.nanmax(landed[1]) < time[1500]
    assert np.nanmin(landed[2]) > time[299]
    # nor is there a flight across the gap
    over = (seen["liftoff_time"].values[0] < time[500]) & (seen["flight_time"].values[0] > 0.1)
    assert not over.any()


def exchangeable(height):
    """Frames with particles 0 and 1 in flight, 20 times the noise apart, away from landings."""
    low = np.minimum(height[:, 0], height[:, 1])
    flying = np.minimum.reduce([low[:-4], low[1:-3], low[2:-2], low[3:-1]]) > 5e-4
    apart = np.abs(height[:, 0] - height[:, 1])[2:-2] > 2e-3
    return 2 + np.flatnonzero(flying & apart)


def test_exchanged_names_are_found_if_both_particles_are_in_flight(irregular):
    """Nothing is found if no names were exchanged."""
    time, height = irregular.tracks["time"].values, irregular.tracks["height"].values
    assert find_swaps(time, height, 1.04e-4, 0.0, 9.81) == []
    rng = np.random.default_rng(0)
    tried = rng.choice(exchangeable(height), 40, replace=False)
    hits = 0
    for frame in tried:
        swapped = height.copy()
        swapped[frame:, :2] = height[frame:, 1::-1]
        hits += find_swaps(time, swapped, 1.04e-4, 0.0, 9.81) == [(frame, 0, 1)]
    assert hits >= 37  # two tests at three standard deviations, each with 99.7 %


def test_no_landing_is_sought_across_an_exchange(irregular):
    height = irregular.tracks["height"].values
    frame = int(exchangeable(height)[20])

    def spoil(height):
        height[frame:, :2] = height[frame:, 1::-1].copy()

    seen = find_impacts(changed(irregular.tracks, spoil), motion="level")
    assert seen["swaps"].values.tolist() == [1, 1, 0]
    assert sum("exchanges its name" in line for line in remarks(seen)) == 2
    when = irregular.tracks["time"].values[frame]
    for p in (0, 1):
        one = seen.isel(particle=p)
        ends = one["liftoff_time"].values + one["flight_time"].values
        assert not ((one["liftoff_time"].values < when - 0.005) & (ends > when + 0.005)).any()


def test_lost_frames_cost_no_landings(trial):
    complete = find_impacts(trial(seed=3).tracks, motion="level")
    thinned = find_impacts(trial(seed=3, camera=Camera(dropped=0.05)).tracks, motion="level")
    assert int(thinned["impact_count"].sum()) == pytest.approx(
        int(complete["impact_count"].sum()), rel=0.03
    )
