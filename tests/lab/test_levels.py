"""Levels that differ below particles, over a base that stays: a tilted platform or view."""

import numpy as np
import pytest

from vibrosweep.lab.experiment import LABORATORY
from vibrosweep.lab.impacts import BOUNCED, STAYED, find_impacts

# m: up to thirty pixels; two particles are on a locked orbit, all bounces of which are alike
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
        # a tenth of a frame; some low bounces are seen in one of the two only
        apart = np.abs(after[:, np.newaxis] - before).min(axis=1)
        assert np.mean(apart < 0.1 / 240.0) > 0.95
    means = [np.nanmean(one["rebound_height"]) for one in (found, again)]
    assert means[1] == pytest.approx(means[0], rel=0.03)


def test_heights_by_the_study_s_method_are_above_the_own_level(irregular, tilted):
    level, raised = (find_impacts(one, method="sign_change") for one in (irregular.tracks, tilted))
    means = [one["rebound_height"].mean("impact").values for one in (level, raised)]
    np.testing.assert_allclose(means[1], means[0], rtol=0.1)


def test_levels_that_agree_are_one(found):
    assert np.ptp(found["level"].values) == 0.0
    assert found.attrs["base"] == found["level"].values[0]


def test_stays_between_flights_that_are_all_alike_are_no_low_level(trial):
    """A particle that rests once in each period, for a frame or two: its parabolas meet below."""
    film = trial(scene={**LABORATORY, "phase": 1.64}, particles=5, duration=2.0)
    resting = np.isfinite(film.record.landing_time) & (film.record.rested == 1)
    assert 0 < resting.any(axis=1).sum() < 5
    seen = find_impacts(film.tracks)
    assert np.ptp(seen["level"].values) == 0.0
    stays = (seen["quality"].values == STAYED).sum(axis=1)
    assert (stays[resting.any(axis=1)] > 20).all()
