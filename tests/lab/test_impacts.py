"""Landings compared with those of virtual experiments: accuracy, stated errors, flags."""

from itertools import pairwise

import numpy as np
import pytest
import xarray as xr
from hypothesis import example, given, settings
from hypothesis import strategies as st

from vibrosweep.errors import TrackError
from vibrosweep.lab.experiment import Camera
from vibrosweep.lab.impacts import BOUNCED, DOUBTFUL, STAYED, find_impacts
from vibrosweep.lab.tracks import make_tracks

G = 9.81


def differences(impacts, record, quality=BOUNCED):
    """Landing times minus the nearest true ones, s, and their standard errors."""
    off, error = [], []
    for p in range(impacts.sizes["particle"]):
        chosen = impacts["quality"].values[p] == quality
        time = impacts["landing_time"].values[p, chosen]
        true = record.landing_time[p][np.isfinite(record.landing_time[p])]
        place = np.clip(np.searchsorted(true, time), 1, true.size - 1)
        before, after = time - true[place - 1], time - true[place]
        off.append(np.where(np.abs(before) < np.abs(after), before, after))
        error.append(impacts["landing_time_error"].values[p, chosen])
    return np.concatenate(off), np.concatenate(error)


def thrown(durations, rate=240.0, start=0.013):
    """Frames of a noise-free particle with given flight times."""
    edges = start + np.concatenate([[0.0], np.cumsum(durations)])
    time = np.arange(int(edges[-1] * rate) + 1) / rate
    height = np.zeros_like(time)
    for first, last in pairwise(edges):
        inside = (time >= first) & (time <= last)
        height[inside] = G / 2.0 * (time[inside] - first) * (last - time[inside])
    return time, height, edges


def test_landing_times_are_finer_than_a_frame_and_their_stated_errors_right(trial):
    """An error below a quarter of a frame, and 68 % intervals with a coverage of 60 to 76 %."""
    one = trial(particles=3, length=25.0, seed=11)
    found = find_impacts(one.tracks)
    off, error = differences(found, one.record)
    assert off.size > 1000
    assert np.sqrt(np.mean(off**2)) * 240.0 < 0.25
    assert 0.60 < np.mean(np.abs(off) < error) < 0.76
    assert abs(off.mean()) < 5.0 * np.sqrt(np.mean(off**2) / off.size)
    assert found.attrs["noise"] == pytest.approx(np.hypot(1.0, 12**-0.5) * 1e-4, rel=0.03)
    assert abs(found.attrs["base"]) < 5.0 * found.attrs["base_error"]


def test_the_fit_beats_the_change_of_sign(irregular, found):
    by_sign = find_impacts(irregular.tracks, method="sign_change")
    fit, _ = differences(found, irregular.record)
    sign, _ = differences(by_sign, irregular.record)
    assert np.sqrt(np.mean(fit**2)) < np.sqrt(np.mean(sign**2)) / 3.0
    time = by_sign["landing_time"].values
    frames = time[np.isfinite(time)] * 240.0
    np.testing.assert_allclose(frames, np.rint(frames), atol=1e-6)


@settings(max_examples=25)
@given(st.lists(st.floats(0.04, 0.2), min_size=5, max_size=12), st.integers(0, 2**32 - 1))
@example([0.16725476149106944, 0.1866946741747123, 0.125, 0.1875, 0.19921875], 0)
def test_without_noise_the_landings_are_exact(durations, seed):
    time, height, edges = thrown(durations)
    order = np.random.default_rng(seed).permutation(3)
    heights = np.stack([height, height, height], axis=1)[:, order]
    found = find_impacts(make_tracks(time, heights))
    landed = found["landing_time"].values[0, : int(found["impact_count"][0])]
    # flights with a single frame before or after the landing cannot all be distinguished from stays
    np.testing.assert_allclose(landed, edges[1:-1], atol=1e-8)
    np.testing.assert_allclose(
        found["rebound_height"].values[0, : landed.size - 1],
        G * np.diff(edges[1:-1]) ** 2 / 8.0,
        rtol=1e-5,
    )


def test_a_stay_on_the_base_is_distinguished_from_a_bounce():
    time, height, edges = thrown([0.08, 0.07, 0.09, 0.08, 0.08, 0.08])
    pause = 0.05
    later = np.where(time > edges[3], time + pause, time)
    frames = np.arange(int(later[-1] * 240.0)) / 240.0
    seen = np.interp(frames, later, height)
    between = (frames > edges[3]) & (frames < edges[3] + pause)
    seen[between] = 0.0
    keep = np.array([not edges[3] - 1 / 240 < f < edges[3] + pause + 1 / 240 for f in frames])
    seen[~keep & ~between] = np.nan  # interpolated across the landing itself
    after = frames >= edges[3] + pause
    seen[after & keep] = [
        G / 2.0 * max((f - a) * (b - f) for a, b in pairwise(edges + pause) if a <= f <= b)
        for f in frames[after & keep]
    ]
    before = (frames < edges[3]) & keep & (frames > edges[0])
    seen[before] = [
        G / 2.0 * max((f - a) * (b - f) for a, b in pairwise(edges) if a <= f <= b)
        for f in frames[before]
    ]
    noise = 2e-5 * np.random.default_rng(0).standard_normal(seen.size)
    found = find_impacts(make_tracks(frames, (seen + noise)[:, np.newaxis]), base=0.0)
    quality = found["quality"].values[0, : int(found["impact_count"][0])]
    assert quality.tolist() == [BOUNCED, BOUNCED, STAYED, BOUNCED, BOUNCED]
    one = found.isel(particle=0, impact=2)
    assert float(one["landing_time"]) == pytest.approx(edges[3], abs=1e-3)
    assert float(one["liftoff_time"]) == pytest.approx(edges[3] + pause, abs=1e-3)


def test_frames_with_a_landing_in_their_exposure_are_left_out(trial):
    blurred = Camera(noise=0.1, whole_pixels=False, exposure=2e-3)
    one = trial(camera=blurred, seed=5)
    off, _ = differences(find_impacts(one.tracks, exposure=2e-3), one.record)
    assert np.sqrt(np.mean(off**2)) * 240.0 < 0.02


def test_gravity_shows_a_wrong_scale_which_does_not_shift_landings(trial):
    one = trial(camera=Camera(scale_error=0.05))
    found = find_impacts(one.tracks)
    assert found.attrs["scale_off"] == 1
    shown = found.attrs["apparent_gravity"] / found.attrs["gravity"]
    assert shown == pytest.approx(1.05, abs=0.01)
    off, error = differences(found, one.record)
    assert 0.60 < np.mean(np.abs(off) < error) < 0.76


def test_flight_times_speeds_and_heights_are_consistent(found):
    seen = np.isfinite(found["flight_time"].values)
    p, k = np.nonzero(seen)
    lasted = found["landing_time"].values[p, k + 1] - found["liftoff_time"].values[p, k]
    np.testing.assert_allclose(found["flight_time"].values[p, k], lasted, atol=1e-12)
    speed = found["impact_speed"].values[seen]
    np.testing.assert_allclose(speed, G * lasted / 2.0)
    good = (found["quality"].values[p, k] == BOUNCED) & (
        found["quality"].values[p, k + 1] == BOUNCED
    )
    high, error = (found[n].values[p, k][good] for n in ("rebound_height", "rebound_height_error"))
    # the same height from the flight time; its error is that of two landings, below 0.4 ms
    assert np.median(np.abs(high - speed[good] ** 2 / (2.0 * G)) / error) < 3.0


def test_attributes_of_the_result(found):
    assert set(found.dims) == {"particle", "impact"}
    for name in ("landing_time", "flight_time"):
        assert found[name].attrs["units"] == "s"
    assert found["quality"].attrs["flag_values"].tolist() == [-1, BOUNCED, STAYED, DOUBTFUL]
    assert isinstance(found, xr.Dataset)


@pytest.mark.parametrize("method", ["fit", "sign_change"])
def test_a_track_without_a_landing_is_refused(method):
    """One flight, whole or cut off: there is no number to report."""
    time = np.arange(0.0, 0.3, 0.005)
    tracks = make_tracks(time, 0.5 - 4.905 * (time[:, np.newaxis] - 0.1) ** 2)
    with pytest.raises(TrackError, match="no landing is seen"):
        find_impacts(tracks, method=method)
