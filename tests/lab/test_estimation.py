"""Parameters from landings: within their errors if the orbit determines them, else a warning."""

import numpy as np
import pytest

from vibrosweep.errors import DataError, ParameterError, TrackError
from vibrosweep.lab.estimation import bounces_of, estimate, fit_phase
from vibrosweep.lab.experiment import LABORATORY, Camera
from vibrosweep.lab.impacts import find_impacts

IRREGULAR = {**LABORATORY, "amplitude": 0.12, "restitution": 0.85}
TRUTH = {"restitution": 0.85, "amplitude": 0.12, "phase": 0.0, "frequency": 20.0}


@pytest.fixture(scope="module")
def recordings(trial):
    return [find_impacts(trial(seed=seed).tracks, motion="level") for seed in range(12)]


@pytest.mark.parametrize("known", [20.0, None])
def test_estimates_agree_with_the_truth_within_their_errors(recordings, known):
    """Deviations in standard errors: their mean square is that of normal deviates, 1."""
    found = [estimate(one, frequency=known, frequency_range=(8.0, 35.0)) for one in recordings]
    names = found[0]["parameter"].values
    truth = np.array([TRUTH[str(name)] for name in names])
    off = np.array([(one["estimate"] - truth) / one["error"] for one in found])
    assert names.size == (3 if known else 4)
    assert all(int(one["determined"]) for one in found)
    # of 12 squares the mean lies between 0.2 and 2.5 with a probability of 99.6 %
    mean_square = (off**2).mean(axis=0)
    assert ((mean_square > 0.2) & (mean_square < 2.5)).all()
    assert (found[0]["error"].values[:3] < [0.005, 0.001, 0.02]).all()


def test_errors_on_both_sides_do_not_bias_the_restitution(recordings):
    """Ordinary least squares is off by many standard errors, the adjustment is not."""
    plain = []
    for one in recordings:
        arrive, leave, time = bounces_of(one).speeds()
        angle = 2.0 * np.pi * 20.0 * time
        design = np.stack([arrive, np.sin(angle), np.cos(angle)], axis=1)
        plain.append(np.linalg.lstsq(design, leave, rcond=None)[0][0])
    adjusted = [float(estimate(one, frequency=20.0)["estimate"][0]) for one in recordings]
    spread = np.std(adjusted) / np.sqrt(len(adjusted))
    assert abs(np.mean(plain) - 0.85) > 5.0 * spread
    assert abs(np.mean(adjusted) - 0.85) < 3.0 * spread


@pytest.mark.parametrize("known", [20.0, None])
def test_a_locked_orbit_determines_nothing_and_gives_a_warning(locked, known):
    """Nor an unknown frequency: its multiples fit the bounces equally well."""
    found = estimate(find_impacts(locked.tracks), frequency=known)
    assert int(found["determined"]) == 0
    assert "does not determine restitution and amplitude" in found.attrs["warning"]
    for name in ("estimate", "error", "covariance", "misfit"):
        assert np.isnan(found[name].values).all()
    np.testing.assert_equal(float(found["frequency_used"]), known or np.nan)


def test_equations_that_noise_alone_determines_are_not_solved(found):
    """Bounces at one phase and speed up to timing errors: the system is singular."""
    same = found.copy(deep=True)
    for name in ("landing_time", "liftoff_time"):
        same[name] = found[name] * 0.0 + 0.05 * (1.0 + np.arange(found.sizes["impact"]))
    same["flight_time"] = found["flight_time"] * 0.0 + 0.05
    same["quality"] = found["quality"] * 0
    estimated = estimate(same)
    assert int(estimated["determined"]) == 0
    assert np.isnan(estimated["estimate"].values).all()


def test_the_phase_of_a_locked_orbit_is_that_of_the_stable_branch(locked):
    found = find_impacts(locked.tracks)
    phase = fit_phase(found, restitution=0.9, amplitude=0.06, frequency=20.0)
    turns = (phase - np.pi) / (2.0 * np.pi)
    assert abs(turns - round(turns)) < 0.005


def test_a_multiple_of_the_frequency_is_not_mistaken_for_it(trial):
    """By ordinary least squares three times the frequency fits these bounces best."""
    film = trial(
        scene=IRREGULAR | {"phase": -0.3077},
        camera=Camera(noise=0.5),
        transient=5.0,
        length=6.0,
        seed=9502,
    )
    found = estimate(find_impacts(film.tracks, motion="level"))
    own = found.sel(parameter="frequency")
    assert abs(float(own["estimate"]) - 20.0) < 5.0 * float(own["error"])
    assert float(found["misfit"]) < 1.5


def test_bounces_that_no_parameters_describe_are_refused(recordings):
    """Landings with errors of 5 ms, a tenth of a flight and many stated errors."""
    one = recordings[0].copy(deep=True)
    wrong = 5e-3 * np.random.default_rng(0).standard_normal(one["landing_time"].shape)
    for name in ("landing_time", "liftoff_time"):
        one[name] = one[name] + wrong
    with pytest.raises(TrackError, match="no restitution and forcing describe the bounces"):
        estimate(one, frequency=20.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"frequency": 0.0}, r"frequency = 0\.0:"),
        ({"frequency": np.nan}, "frequency = nan:"),
        ({"frequency_range": (30.0, 10.0)}, "must rise, in Hz"),
        ({"frequency_range": (0.0, 10.0)}, r"frequency_range = 0\.0:"),
    ],
)
def test_impossible_frequencies_are_refused(found, options, message):
    with pytest.raises(ParameterError, match=message):
        estimate(found, **options)


def test_landings_that_were_not_found_are_refused(irregular):
    with pytest.raises(DataError, match="estimate takes the result of find_impacts"):
        estimate(irregular.tracks)


def test_too_few_bounces_are_refused(trial):
    with pytest.raises(TrackError, match="at least 10 are needed"):
        estimate(find_impacts(trial(particles=1, length=0.4).tracks), frequency=20.0)


def test_bounces_join_three_neighbouring_instants(recordings):
    bounces = bounces_of(recordings[0])
    arrive, leave, time = bounces.speeds()
    assert (np.diff(bounces.instant)[bounces.middle] > 0.0).all()
    assert (arrive > 0.0).all()
    assert (leave > 0.0).all()
    residual = leave - 0.85 * arrive - 0.12 * np.sin(2.0 * np.pi * 20.0 * time)
    assert np.sqrt(np.mean(residual**2)) < 0.01
