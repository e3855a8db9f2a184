"""Landings compared with those of virtual experiments: accuracy, stated errors, flags."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import example, given, settings
from hypothesis import strategies as st

from vibrosweep.errors import TrackError
from vibrosweep.lab.experiment import LABORATORY, Camera
from vibrosweep.lab.flights import Samples, apparent_gravity
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


def thrown(durations, rests=0.0, rate=240.0, start=0.013):
    """Frames of a noise-free particle with flights after rests, and their beginnings and ends."""
    ends = start + np.cumsum(np.asarray(durations) + rests)
    begins = ends - durations
    time = np.arange(int(ends[-1] * rate) + 1) / rate
    since, left = time[:, np.newaxis] - begins, ends - time[:, np.newaxis]
    height = G / 2.0 * np.maximum(since, 0.0) * np.maximum(left, 0.0)
    return time, height.sum(axis=1), begins, ends


def test_landing_times_are_finer_than_a_frame_and_their_stated_errors_right(trial):
    """An error below a quarter of a frame, and 68 % intervals with a coverage of 60 to 76 %."""
    one = trial(particles=3, length=12.0, seed=11)
    found = find_impacts(one.tracks, frequency=20.0)
    off, error = differences(found, one.record)
    assert off.size > 400
    assert np.sqrt(np.mean(off**2)) * 240.0 < 0.25
    assert 0.60 < np.mean(np.abs(off) < error) < 0.76
    assert abs(off.mean()) < 5.0 * np.sqrt(np.mean(off**2) / off.size)
    assert found.attrs["noise"] == pytest.approx(np.hypot(1.0, 12**-0.5) * 1e-4, rel=0.03)
    assert abs(found.attrs["base"]) < 5.0 * found.attrs["base_error"]


def test_the_fit_beats_the_change_of_sign(irregular, found):
    by_sign = find_impacts(irregular.tracks, method="sign_change", motion="level")
    fit, _ = differences(found, irregular.record)
    sign, _ = differences(by_sign, irregular.record)
    assert np.sqrt(np.mean(fit**2)) < np.sqrt(np.mean(sign**2)) / 3.0
    time = by_sign["landing_time"].values
    frames = time[np.isfinite(time)] * 240.0
    np.testing.assert_allclose(frames, np.rint(frames), atol=1e-6)


@settings(max_examples=20)
@given(st.lists(st.floats(0.04, 0.2), min_size=5, max_size=12), st.integers(0, 2**32 - 1))
@example([0.16725476149106944, 0.1866946741747123, 0.125, 0.1875, 0.19921875], 0)
def test_without_noise_the_landings_are_exact(durations, seed):
    time, height, _, ends = thrown(durations)
    order = np.random.default_rng(seed).permutation(3)
    heights = np.stack([height, height, height], axis=1)[:, order]
    found = find_impacts(make_tracks(time, heights), motion="level")
    landed = found["landing_time"].values[0, : int(found["impact_count"][0])]
    # flights with a single frame before or after the landing cannot all be distinguished from stays
    np.testing.assert_allclose(landed, ends[:-1], atol=1e-8)
    np.testing.assert_allclose(
        found["rebound_height"].values[0, : landed.size - 1],
        G * np.diff(ends[:-1]) ** 2 / 8.0,
        rtol=1e-5,
    )


@pytest.mark.parametrize("more", [-0.1, 0.1])
@pytest.mark.parametrize("seed", range(3))
def test_flights_that_are_no_perfect_parabolas_are_not_cut(more, seed):
    """Long flights of a ball that comes nearer to the camera, or recedes, as it rises."""
    durations = [0.52, 0.44, 0.38, 0.32, 0.28, 0.24]
    time, height, _, ends = thrown(durations)
    noise = 3e-4 * np.random.default_rng(seed).standard_normal(time.size)
    height = height * (1.0 + more * height) + noise
    found = find_impacts(make_tracks(time, height[:, np.newaxis]), motion="level")
    landed = found["landing_time"].values[0]
    np.testing.assert_allclose(landed, ends[:-1], atol=1.0 / 240.0)


@pytest.mark.parametrize("factor", [-1.0, 1e-3, 0.3, 0.6, 1.7, 10.0])
def test_a_wrong_scale_or_axis_is_named_whatever_the_flights(factor, irregular, trial):
    """High and low flights, stays after every one, and a dropped ball."""
    stays = {**LABORATORY, "amplitude": 1.5 * 3.0 * G / (40.0 * np.pi), "restitution": 0.5}
    time, height, _, _ = thrown([0.3, 0.25, 0.21, 0.18, 0.15, 0.12])
    noise = 3e-4 * np.random.default_rng(0).standard_normal(time.size)
    dropped = make_tracks(time, (height + noise)[:, np.newaxis])
    message = "turn the axis" if factor < 0.0 else "multiply the scale by about"
    for tracks in (irregular.tracks, trial(scene=stays, length=3.0).tracks, dropped):
        with pytest.raises(TrackError, match=message):
            find_impacts(tracks.assign(height=factor * tracks["height"]), motion="level")


def test_a_stay_on_the_base_is_distinguished_from_a_bounce():
    rests = np.array([0.0, 0.0, 0.0, 0.05, 0.0, 0.0])
    time, height, begins, ends = thrown([0.08, 0.07, 0.09, 0.08, 0.08, 0.08], rests)
    noise = 2e-5 * np.random.default_rng(0).standard_normal(time.size)
    found = find_impacts(make_tracks(time, (height + noise)[:, np.newaxis]), base=0.0)
    quality = found["quality"].values[0, : int(found["impact_count"][0])]
    assert quality.tolist() == [BOUNCED, BOUNCED, STAYED, BOUNCED, BOUNCED]
    one = found.isel(particle=0, impact=2)
    assert float(one["landing_time"]) == pytest.approx(ends[2], abs=1e-3)
    assert float(one["liftoff_time"]) == pytest.approx(begins[3], abs=1e-3)


def test_frames_with_a_landing_in_their_exposure_are_left_out(trial):
    blurred = Camera(noise=0.1, whole_pixels=False, exposure=2e-3)
    one = trial(camera=blurred, seed=5)
    off, _ = differences(find_impacts(one.tracks, exposure=2e-3, frequency=20.0), one.record)
    assert np.sqrt(np.mean(off**2)) * 240.0 < 0.02


def test_gravity_shows_a_wrong_scale_which_does_not_shift_landings(trial):
    one = trial(camera=Camera(scale_error=0.05))
    found = find_impacts(one.tracks, frequency=20.0)
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


# --- Levels that differ between particles: a tilted platform or view ---

# m: up to thirty pixels; two particles are on a locked orbit with equal bounces
TILT = np.array([5e-4, -2e-3, 3e-3])


@pytest.fixture(scope="module")
def tilted(irregular):
    return irregular.tracks.assign(height=irregular.tracks["height"] + TILT)


@pytest.mark.parametrize("motion", ["detect", "level"])
def test_a_tilt_changes_the_levels_alone(found, tilted, motion):
    again = find_impacts(tilted, motion=motion, frequency=20.0)
    assert again.attrs["base_motion"] == "level"
    own = again["level"].values - TILT
    assert np.ptp(own) < 5e-5
    assert again.attrs["base"] == pytest.approx(float(again["level"].mean()))
    first, second = (one["quality"].values == BOUNCED for one in (found, again))
    assert second.sum() == pytest.approx(first.sum(), rel=0.03)
    for p in range(TILT.size):
        before = found["landing_time"].values[p, first[p]]
        after = again["landing_time"].values[p, second[p]]
        # a tenth of a frame; some low bounces are found in only one of the two
        apart = np.abs(after[:, np.newaxis] - before).min(axis=1)
        assert np.mean(apart < 0.1 / 240.0) > 0.95
    means = [np.nanmean(one["rebound_height"]) for one in (found, again)]
    assert means[1] == pytest.approx(means[0], rel=0.03)


def test_heights_by_the_method_of_the_study_are_relative_to_the_level_of_each_particle(
    irregular, tilted
):
    level, raised = (
        find_impacts(one, method="sign_change", motion="level")
        for one in (irregular.tracks, tilted)
    )
    means = [one["rebound_height"].mean("impact").values for one in (level, raised)]
    np.testing.assert_allclose(means[1], means[0], rtol=0.1)


def test_a_tilt_under_equal_bounces_is_not_taken_for_stays(trial):
    """On a locked orbit a low level and stays differ by the positions between flights alone."""
    film = trial(scene={**LABORATORY, "phase": np.pi}, particles=3, length=2.0)
    tracks = film.tracks.isel(particle=[0, 2])
    tilted = tracks.assign(height=tracks["height"] + TILT[:2])
    level, tilt = (find_impacts(one, motion="level") for one in (tracks, tilted))
    np.testing.assert_allclose(tilt["level"].values - TILT[:2], level["level"].values, atol=5e-5)
    for one in (level, tilt):
        assert (one["quality"].values == STAYED).sum() == 0
    assert int(tilt["impact_count"].sum()) == int(level["impact_count"].sum()) > 60


def test_low_flights_between_high_ones_are_found(irregular):
    """All landings are found between flights that rise by five times the noise, five frames."""
    found = find_impacts(irregular.tracks, motion="level")
    noise = found.attrs["noise"]
    record, end = irregular.record, float(irregular.tracks["time"][-1])
    missed = seen = 0
    for p in range(3):
        lands, leaves = record.landing_time[p], record.liftoff_time[p]
        inside = np.isfinite(lands) & np.isfinite(leaves) & (lands > 20.0) & (lands < end)
        lands, leaves = lands[inside], leaves[inside]
        lasts = lands[1:] - leaves[:-1]
        clear = G * lasts**2 / 8.0 > 5.0 * noise
        true = lands[1:-1][clear[:-1] & clear[1:]]
        landed = found["landing_time"].values[p]
        landed = landed[np.isfinite(landed)]
        off = np.abs(true[:, np.newaxis] - landed).min(axis=1)
        missed, seen = missed + np.sum(off > 0.5 / 240.0), seen + true.size
    assert seen > 400
    assert missed == 0


def test_levels_that_agree_are_one(found):
    assert np.ptp(found["level"].values) == 0.0
    assert found.attrs["base"] == found["level"].values[0]


def test_stays_between_equal_flights_are_not_a_low_level(trial):
    """A particle rests for a frame or two in each period; its parabolas meet below the base."""
    film = trial(scene={**LABORATORY, "phase": 1.64}, particles=5, length=2.0)
    resting = np.isfinite(film.record.landing_time) & (film.record.rested == 1)
    assert 0 < resting.any(axis=1).sum() < 5
    seen = find_impacts(film.tracks, frequency=20.0)
    assert np.ptp(seen["level"].values) == 0.0
    stays = (seen["quality"].values == STAYED).sum(axis=1)
    assert (stays[resting.any(axis=1)] > 20).all()


def test_stays_after_every_flight_do_not_lower_the_base(trial):
    """Flights of 1 mm, each followed by an equally long rest: parabolas meet 1.7 mm below."""
    scene = {**LABORATORY, "amplitude": 1.5 * 3.0 * 9.81 / (2.0 * np.pi * 20.0), "restitution": 0.5}
    film = trial(scene=scene, length=3.0)
    seen = find_impacts(film.tracks, frequency=20.0)
    assert abs(seen.attrs["base"]) < 5.0 * seen.attrs["base_error"] < 1e-4
    assert seen.attrs["noise"] == pytest.approx(np.hypot(1.0, 12.0**-0.5) * 1e-4, rel=0.1)
    landed = seen["landing_time"].values
    assert (seen["quality"].values == STAYED).sum() > 150
    off = [
        np.abs(own[np.isfinite(own)][:, np.newaxis] - true[np.isfinite(true)]).min(axis=1)
        for own, true in zip(landed, film.record.landing_time, strict=True)
    ]
    assert np.sqrt(np.mean(np.concatenate(off) ** 2)) * 240.0 < 0.25


def test_the_gravity_of_positions_in_whole_pixels_is_within_its_error():
    """Flights of five frames at one phase have few distinct curvatures, and a coarse median."""
    frames, flights = np.arange(-2, 3) / 120.0, 300
    off = []
    for seed in range(40):
        noise = 0.5 * np.random.default_rng(seed).standard_normal((flights, 5))
        height = 1e-4 * np.rint((3e-3 - 0.5 * 9.81 * frames**2) / 1e-4 + noise)
        time = frames + 0.05 * np.arange(flights)[:, np.newaxis]
        nobody = np.zeros(time.size, int)
        samples = Samples(time.ravel(), height.ravel(), nobody, nobody, nobody)
        seen, error = apparent_gravity(samples, np.repeat(np.arange(flights), 5), flights)
        off.append((seen - 9.81) / error)
    # the mean of 40 squares of normal deviates lies in this range with a probability of 99.9 %
    assert 0.4 < np.mean(np.square(off)) < 1.95


def test_a_few_flights_before_long_rests_show_their_gravity(trial):
    """Noise between the low points of a rest is not a flight, whatever its curvature."""
    scene = {**LABORATORY, "amplitude": 1.9 * 0.4 * 9.81 / (40.0 * np.pi), "phase": 1.83}
    scene["launch_velocity"] = 0.393
    film = trial(scene=scene, transient=0.0, length=6.0, seed=3)
    assert find_impacts(film.tracks, frequency=20.0).attrs["scale_off"] == 0
