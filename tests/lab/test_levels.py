"""Levels that differ between particles over a base at rest: a tilted platform or view."""

import numpy as np
import pytest

from vibrosweep.lab.experiment import LABORATORY
from vibrosweep.lab.flights import Samples, apparent_gravity
from vibrosweep.lab.impacts import BOUNCED, STAYED, find_impacts

# m: up to thirty pixels; two particles are on a locked orbit with equal bounces
TILT = np.array([5e-4, -2e-3, 3e-3])


@pytest.fixture(scope="module")
def tilted(irregular):
    return irregular.tracks.assign(height=irregular.tracks["height"] + TILT)


@pytest.mark.parametrize("motion", ["detect", "level"])
def test_a_tilt_changes_the_levels_alone(found, tilted, motion):
    again = find_impacts(tilted, motion=motion)
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
    level, raised = (find_impacts(one, method="sign_change") for one in (irregular.tracks, tilted))
    means = [one["rebound_height"].mean("impact").values for one in (level, raised)]
    np.testing.assert_allclose(means[1], means[0], rtol=0.1)


def test_levels_that_agree_are_one(found):
    assert np.ptp(found["level"].values) == 0.0
    assert found.attrs["base"] == found["level"].values[0]


def test_stays_between_equal_flights_are_not_a_low_level(trial):
    """A particle rests for a frame or two in each period; its parabolas meet below the base."""
    film = trial(scene={**LABORATORY, "phase": 1.64}, particles=5, length=2.0)
    resting = np.isfinite(film.record.landing_time) & (film.record.rested == 1)
    assert 0 < resting.any(axis=1).sum() < 5
    seen = find_impacts(film.tracks)
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
