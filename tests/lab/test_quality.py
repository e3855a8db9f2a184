"""Defects of tracks are reported for each particle, and no flight spans them."""

import numpy as np
import pytest

from vibrosweep.lab.impacts import find_impacts
from vibrosweep.lab.tracks import find_swaps, remarks


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

    seen = find_impacts(changed(irregular.tracks, spoil))
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

    seen = find_impacts(changed(irregular.tracks, spoil))
    assert seen["swaps"].values.tolist() == [1, 1, 0]
    assert sum("exchanges its name" in line for line in remarks(seen)) == 2
    when = irregular.tracks["time"].values[frame]
    for p in (0, 1):
        one = seen.isel(particle=p)
        ends = one["liftoff_time"].values + one["flight_time"].values
        assert not ((one["liftoff_time"].values < when - 0.005) & (ends > when + 0.005)).any()


def test_lost_frames_cost_no_landings(trial):
    from vibrosweep.lab.experiment import Camera

    complete = find_impacts(trial(seed=3).tracks)
    thinned = find_impacts(trial(seed=3, camera=Camera(dropped=0.05)).tracks)
    assert int(thinned["impact_count"].sum()) == pytest.approx(
        int(complete["impact_count"].sum()), rel=0.03
    )
