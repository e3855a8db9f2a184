"""Comparison with prediction, and the sources of its errors."""

import re

import numpy as np
import pytest
import xarray as xr

from vibrosweep.errors import DataError, ParameterError, TrackError
from vibrosweep.lab.compare import (
    READINGS,
    comparable,
    compare_tracks,
    draw_parameters,
    first_flights,
    measured_means,
    predict,
    prediction_errors,
    scene_of,
)
from vibrosweep.lab.estimation import estimate
from vibrosweep.lab.experiment import LABORATORY
from vibrosweep.lab.impacts import BOUNCED, STAYED, agreement, find_impacts, phases, quantities
from vibrosweep.lab.lines import table_lines
from vibrosweep.model.shapes import SINE
from vibrosweep.theory import locked_height

IRREGULAR = {**LABORATORY, "amplitude": 0.12, "restitution": 0.85}
KNOWN = {"frequency": 20.0, "restitution": 0.9, "amplitude": 0.06, "contact_time": 2.5e-5}


@pytest.fixture(scope="module")
def regular(locked):
    """The comparison of a locked orbit."""
    return compare_tracks(locked.tracks, **KNOWN, threads=1)


def test_a_locked_orbit_is_measured_and_predicted_at_its_closed_form(regular):
    """H_1 = g / (8 f^2) and the forcing period, independent of restitution and amplitude."""
    table = regular
    assert table["case"].values.tolist() == ["N=1"]
    assert all(variable.attrs for variable in table.data_vars.values())  # units, meanings
    height = float(locked_height(1, 20.0))
    for name in ("measured", "predicted"):
        np.testing.assert_allclose(table[name].values[0], [height, 0.05], rtol=2e-3)
    assert (table["error"].sel(reading="ensemble") < 0.2).all()
    assert float(table["compared"][0]) == 1.0


def test_the_camera_explains_the_errors_it_makes(locked, regular):
    """For single flights, whose errors are means over many draws of the noise."""
    by_sign = compare_tracks(locked.tracks, method="sign_change", **KNOWN, threads=1)
    for row in (regular.isel(case=0), by_sign.isel(case=0)):
        error = row["error"].sel(reading="flight", quantity="height")
        explained = np.hypot(row["frames"], row["pixels"]).sel(reading="flight", quantity="height")
        assert float(explained) == pytest.approx(float(error), rel=0.2)


def test_estimated_parameters_predict_what_was_measured(irregular):
    table = compare_tracks(irregular.tracks, frequency=20.0, draws=8, threads=1)
    assert float(table["restitution"][0]) == pytest.approx(0.85, abs=0.005)
    assert (table["error"].sel(reading="ensemble") < 1.0).all()
    assert (table["parameters"] > 0.0).all()


def test_irregular_motion_is_reported_and_compared_by_distributions(trial, regular):
    """Single flights cannot be predicted, but their distribution is close to the true one."""
    known = {**KNOWN, "restitution": 0.85, "amplitude": 0.2}
    film = trial(scene={**IRREGULAR, "amplitude": 0.2}, particles=2)
    table = compare_tracks(film.tracks, **known, threads=1)
    assert float(table["irregular"][0]) > 0.5
    assert (table["distribution_distance"] < table["distribution_chance"]).all()
    assert float(table["distribution_chance"][0]) < 0.3
    text = "\n".join(table_lines(table))
    assert "is irregular" in text
    assert not re.search(r"N=2 height: .*flight", text)
    assert float(regular["irregular"][0]) == 0.0
    text = "\n".join(table_lines(regular))
    assert "irregular" not in text
    assert re.search(r"N=1 height: .*flight", text)


def test_errors_of_the_camera_are_unknown_if_the_prediction_cannot_be_measured(irregular):
    """The particles of this prediction come to rest after a few flights."""
    known = {**KNOWN, "restitution": 0.2, "amplitude": 0.03}
    table = compare_tracks(irregular.tracks, **known, threads=1)
    assert "the errors of the camera are not known: the predicted motion" in table.attrs["warning"]
    assert np.isnan(table[["frames", "pixels"]].to_array()).all()
    assert (table["error"] > 50.0).all()


def test_a_prediction_without_a_flight_is_refused(irregular):
    known = {**KNOWN, "restitution": 0.0, "amplitude": 0.0}
    with pytest.raises(ParameterError, match="none of the particles makes a whole flight"):
        compare_tracks(irregular.tracks, **known, threads=1)


def test_errors_by_hand(found):
    means = measured_means(found, np.array([True, True, False]))
    assert np.isnan(means["height"][2])
    foretold = {q: 1.1 * values for q, values in means.items()}
    made = prediction_errors(found, foretold, np.array([True, True, False]))
    for q in ("height", "period"):
        for reading in ("ensemble", "particle", "worst"):
            assert made[q][reading] == pytest.approx(10.0)
    nothing = prediction_errors(found, foretold, np.zeros(3, bool))
    assert np.isnan([nothing["height"][reading] for reading in READINGS]).all()


def test_prediction_starts_with_the_first_flight_of_each_particle(irregular, found, workers):
    """At the true parameters the means are those of the true record."""
    scene = scene_of(found, "rest", SINE, "constant")
    sets, shapes, refused = draw_parameters(IRREGULAR, scene, None, 0)
    foretold = predict(found, sets, shapes, scene, workers)
    among = comparable(found)
    assert refused == 0
    assert among.any()
    means = measured_means(found, among)
    np.testing.assert_allclose(foretold["period"][0][among], means["period"][among], rtol=0.01)


def test_a_particle_that_never_flew_is_not_launched(found, workers):
    """It would be launched at t = 0 with speed zero, without errors of the camera."""
    still = found.copy(deep=True)
    still["flight_time"][1] = np.nan
    scene = scene_of(found, "rest", SINE, "constant")
    sets, shapes, _ = draw_parameters(IRREGULAR, scene, None, 0)
    flights = first_flights(still, sets)
    assert flights.particle.tolist() == [0, 2]
    assert flights.sets["phase"].size == 2
    foretold = predict(still, sets, shapes, scene, workers)
    assert np.isnan(foretold["height"][0]).tolist() == [False, True, False]


def test_unphysical_draws_are_replaced_or_refused(found):
    scene = scene_of(found, "rest", SINE, "constant")
    estimated = estimate(found, frequency=20.0)
    sets, _, refused = draw_parameters(LABORATORY, scene, estimated, 50)
    assert sets["restitution"].size == 51
    assert refused == 0
    assert np.std(sets["restitution"][1:]) == pytest.approx(float(estimated["error"][0]), rel=0.3)
    edge = estimated.copy(deep=True)
    edge["estimate"][0] = 1.0 - float(estimated["error"][0])  # 16 % of the draws exceed 1
    sets, _, refused = draw_parameters(LABORATORY, scene, edge, 50)
    assert 1 <= refused <= 25
    assert (sets["restitution"] <= 1.0).all()
    edge["estimate"][0] = 1.01
    with pytest.raises(
        ParameterError, match=r"restitution is estimated as 1\.01: must be at least"
    ):
        draw_parameters(LABORATORY, scene, edge, 50)


def test_recordings_that_cannot_be_compared_are_refused(locked, trial):
    for known, message in (
        ({"frequency": 20.0}, "does not determine restitution and amplitude"),
        ({"restitution": 0.9}, "restitution is given alone"),
        ({"restitution": 0.9, "amplitude": 0.06}, "the frequency is missing"),
    ):
        with pytest.raises(ParameterError, match=message):
            compare_tracks(locked.tracks, motion="level", **known)
    resting = trial(particles=1, scene={**LABORATORY, "amplitude": 0.12, "restitution": 0.8})
    with pytest.raises(TrackError, match="nothing can be compared"):
        compare_tracks(resting.tracks, **{**KNOWN, "restitution": 0.8})


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"draws": 1}, ParameterError, "draws = 1:"),
        ({"method": "parabola"}, TrackError, "method = 'parabola':"),
        ({"rebound": "stick"}, ParameterError, "rebound = 'stick':"),
        ({"motion": "up"}, TrackError, "motion = 'up':"),
        ({"exposure": 2.0}, TrackError, r"exposure = 2\.0:"),
        ({"frequency": -1.0}, ParameterError, r"frequency = -1\.0:"),
        ({"gravity": 0.0}, ParameterError, r"gravity = 0\.0:"),
        ({"contact": 1e-3}, TrackError, "which counts over a moving base only"),
    ],
)
def test_impossible_options_are_refused(locked, change, error, message):
    with pytest.raises(error, match=message):
        compare_tracks(locked.tracks, **(KNOWN | change))


@pytest.mark.parametrize("recordings", ["x", 5, [5], None, [], [xr.Dataset()]])
def test_nothing_to_compare(recordings):
    with pytest.raises(TrackError, match=r"recordings: must be tracks|no recording to compare"):
        compare_tracks(recordings, **KNOWN)


def test_what_is_no_measurement_is_refused():
    for wrong in (xr.Dataset({"flight_time": 0.5}), "x", None):
        with pytest.raises(DataError, match=r"takes|is not a dataset"):
            quantities(wrong)
        with pytest.raises(DataError, match=r"takes|is not a dataset"):
            agreement([wrong])
        with pytest.raises(DataError, match=r"takes|is not a dataset"):
            estimate(wrong)
        with pytest.raises(DataError, match=r"takes|is not a dataset"):
            comparable(wrong)


def test_quantities_of_a_locked_orbit(locked):
    impacts = find_impacts(locked.tracks)
    one = quantities(impacts, frequency=20.0, phase=np.pi)
    # one of the 199 bounces is by chance four standard errors from one, and taken for a stay
    assert float(one["flight_time"]) == pytest.approx(0.05, rel=2e-4)
    assert float(one["phase_lock"]) > 0.99
    # the locked phase of Table 1, scaled to 20 Hz
    assert float(one["impact_phase"]) == pytest.approx(0.4329824, abs=0.01)
    assert np.isnan(float(one["dt_min"]))
    assert np.nanmax(phases(impacts, 20.0)) < 1.0


def test_dt_min_is_that_of_the_closest_pair_unless_its_error_is_larger(found):
    apart = found.copy(deep=True)
    apart["landing_time"] = found["landing_time"] + 3e-4 * (found["particle"] + 0.1) ** 2
    known = np.isin(found["quality"].values, [BOUNCED, STAYED])
    times = [t[k] for t, k in zip(apart["landing_time"].values, known, strict=True)]
    best = np.inf
    for i in range(3):
        for j in range(i):
            best = min(best, np.abs(times[i][:, np.newaxis] - times[j]).min())
    assert best > 0.0
    for error, expected in ((0.1, best), (1.0, np.nan)):
        apart["landing_time_error"] = xr.full_like(found["landing_time"], error * best)
        np.testing.assert_equal(float(quantities(apart)["dt_min"]), expected)


def test_agreement_over_repeats_is_judged_at_eight_per_cent(found):
    one = quantities(found, frequency=20.0)
    other = one.copy(deep=True)
    other["flight_time"] = one["flight_time"] * 1.05
    other["rebound_height_max"] = one["rebound_height_max"] * 1.3
    other["impact_phase"] = (one["impact_phase"] + 0.98) % 1.0
    judged = agreement([one, other])
    first = judged.sel(quantity="flight_time")
    # two values a and 1.05 a: sd = 0.05 a / sqrt 2, mean 1.025 a
    assert float(first["variation"]) == pytest.approx(0.05 / 2**0.5 / 1.025)
    assert int(first["accepted"]) == 1
    assert int(judged["accepted"].sel(quantity="rebound_height_max")) == 0
    assert float(judged["sd"].sel(quantity="impact_phase")) == pytest.approx(
        0.02 / 2**0.5, rel=1e-6
    )
    assert int(judged["accepted"].sel(quantity="impact_phase")) == -1
