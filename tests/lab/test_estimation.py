"""Parameters from landings: within their errors if the orbit determines them, else a warning."""

import math

import numpy as np
import pytest

from vibrosweep.errors import DataError, ParameterError, TrackError
from vibrosweep.lab.compare import compare_tracks
from vibrosweep.lab.estimation import bounces_of, estimate, fit_phase
from vibrosweep.lab.experiment import LABORATORY, Camera, Experiment
from vibrosweep.lab.impacts import find_impacts
from vibrosweep.lab.lines import impact_lines, table_lines
from vibrosweep.lab.regression import FAR, FittedLaw, Law, failed_fit, law_text, possible_laws
from vibrosweep.lab.trials import perform_trials
from vibrosweep.model.restitution_laws import PLASTIC, VISCOELASTIC, restitution_at

IRREGULAR = {**LABORATORY, "amplitude": 0.12, "restitution": 0.85}
TRUTH = {"restitution": 0.85, "amplitude": 0.12, "phase": 0.0, "frequency": 20.0}


@pytest.fixture(scope="module")
def recordings(trial):
    return [find_impacts(trial(seed=seed).tracks, motion="level") for seed in range(6)]


@pytest.fixture(scope="module")
def estimates(recordings):
    return {
        known: [estimate(one, frequency=known, frequency_range=(8.0, 35.0)) for one in recordings]
        for known in (20.0, None)
    }


@pytest.mark.parametrize("known", [20.0, None])
def test_estimates_agree_with_the_truth_within_their_errors(estimates, known):
    """Deviations in standard errors: their mean square is that of normal deviates, 1."""
    found = estimates[known]
    names = found[0]["parameter"].values
    truth = np.array([TRUTH[str(name)] for name in names])
    off = np.array([(one["estimate"] - truth) / one["error"] for one in found])
    assert names.size == (3 if known else 4)
    assert all(int(one["determined"]) for one in found)
    # of 6 squares the mean lies between 0.06 and 3.4 with a probability of 99.7 %
    mean_square = (off**2).mean(axis=0)
    assert ((mean_square > 0.06) & (mean_square < 3.4)).all()
    assert (found[0]["error"].values[:3] < [0.005, 0.001, 0.02]).all()


def test_errors_on_both_sides_do_not_bias_the_restitution(recordings, estimates):
    """Ordinary least squares is off by many standard errors, the adjustment is not."""
    plain = []
    for one in recordings:
        arrive, leave, time = bounces_of(one).speeds()
        angle = 2.0 * np.pi * 20.0 * time
        design = np.stack([arrive, np.sin(angle), np.cos(angle)], axis=1)
        plain.append(np.linalg.lstsq(design, leave, rcond=None)[0][0])
    adjusted = [float(one["estimate"][0]) for one in estimates[20.0]]
    spread = np.std(adjusted) / np.sqrt(len(adjusted))
    assert abs(np.mean(plain) - 0.85) > 4.0 * spread  # 6 for twice as many recordings
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
        estimate(
            find_impacts(trial(particles=1, length=0.4).tracks, motion="level"), frequency=20.0
        )


def test_bounces_join_three_neighbouring_instants(recordings):
    bounces = bounces_of(recordings[0])
    arrive, leave, time = bounces.speeds()
    assert (np.diff(bounces.instant)[bounces.middle] > 0.0).all()
    assert (arrive > 0.0).all()
    assert (leave > 0.0).all()
    residual = leave - 0.85 * arrive - 0.12 * np.sin(2.0 * np.pi * 20.0 * time)
    assert np.sqrt(np.mean(residual**2)) < 0.01


# --- Dependence of restitution on impact speed: the favoured law over both bases ---

G, FREQUENCY = LABORATORY["gravity"], LABORATORY["frequency"]
SCENES = {
    "moving": {"restitution": 0.8, "amplitude": 1.8 * 1.5 * G / (2.0 * math.pi * FREQUENCY)},
    "level": {"restitution": 0.85, "amplitude": 0.12},
}
SPEED = {"moving": 0.3, "level": 0.2}


def film(base, law, seed=0):
    """A film of three particles with a given law of restitution."""
    scene = {**LABORATORY, **SCENES[base], "phase": 0.3}
    scene["base"] = "moving" if base == "moving" else "high-bounce"
    if law != "constant":
        scene |= {"restitution_law": law, "restitution_speed": SPEED[base]}
    plan = Experiment(**scene, particles=3, repeats=1, transient=0.0, duration=4.5, seed=seed)
    return perform_trials(plan)[0].tracks


@pytest.mark.parametrize(
    ("base", "law"),
    [
        ("moving", "constant"),
        ("moving", PLASTIC),
        pytest.param("moving", VISCOELASTIC, marks=pytest.mark.weekly),
        ("level", "constant"),
        ("level", VISCOELASTIC),
    ],
)
def test_bounces_determine_the_law_of_their_restitution(base, law):
    impacts = find_impacts(film(base, law), frequency=FREQUENCY, motion=base)
    one = estimate(impacts, frequency=FREQUENCY)
    assert one.attrs["restitution_law"].split(" or ")[0] == law
    fitted = one.sel(law=law)
    e, speed = float(fitted["law_restitution"]), float(fitted["law_speed"])
    truth = SCENES[base]["restitution"]
    if law == VISCOELASTIC:  # at the speed that the fit chose
        truth = float(restitution_at(speed, truth, law, SPEED[base]))
    assert abs(e - truth) < 5.0 * float(fitted["law_restitution_error"]) < 0.03
    if law == PLASTIC:
        assert abs(speed - SPEED[base]) < 5.0 * float(fitted["law_speed_error"]) < 0.03
    # all parameters are those of the law; those of a constant restitution would be biased
    values = {**SCENES[base], "phase": 0.3, "restitution_speed": SPEED[base], "restitution": truth}
    if base == "moving":  # A = (1 + e) V0
        values["amplitude"] *= (1.0 + truth) / (1.0 + SCENES[base]["restitution"])
    assert ("restitution_speed" in one["parameter"]) == (law == PLASTIC)
    for name in one["parameter"].values:
        own = one.sel(parameter=name)
        assert abs(float(own["estimate"]) - values[name]) < 5.0 * float(own["error"])
    if base == "moving":
        assert law_text(one) in "\n".join(impact_lines(impacts))


@pytest.mark.parametrize("frequency", [FREQUENCY, None])
def test_a_law_is_found_where_no_constant_restitution_describes_the_bounces(frequency):
    one = estimate(
        find_impacts(film("level", PLASTIC, seed=1), motion="level"), frequency=frequency
    )
    assert one.attrs["restitution_law"] == PLASTIC
    truth = {**SCENES["level"], "phase": 0.3, "frequency": FREQUENCY, "restitution_speed": 0.2}
    for name in one["parameter"].values:
        own = one.sel(parameter=name)
        assert abs(float(own["estimate"]) - truth[name]) < 5.0 * float(own["error"])


def test_a_recording_is_compared_with_the_law_of_its_bounces_or_a_given_one():
    """With a constant restitution the error of the height would be 39 %."""
    tracks = film("level", VISCOELASTIC, seed=2).isel(particle=[0, 1])
    other = {"frequency": FREQUENCY, "contact_time": LABORATORY["contact_time"], "threads": 1}
    table = compare_tracks(tracks, motion="level", draws=4, **other)
    known = {**SCENES["level"], "restitution_speed": SPEED["level"], **other}
    given = compare_tracks(tracks, restitution_law=VISCOELASTIC, motion="level", **known)
    for one in (table, given):
        assert one.attrs["restitution_law"] == VISCOELASTIC
        assert (one["error"].sel(reading="ensemble") < 1.0).all()
        assert "restitution_law viscoelastic" in table_lines(one)
    assert float(given["restitution_speed"][0]) == SPEED["level"]


@pytest.mark.parametrize(
    ("known", "message"),
    [
        ({"restitution_law": "elastic"}, "restitution_law = 'elastic': must be one of constant"),
        (
            {"restitution_law": PLASTIC},
            'restitution_speed: is missing; restitution_law = "plastic"',
        ),
        ({"restitution_speed": 0.2}, "restitution_speed: .* write restitution_law = "),
        ({"restitution_law": PLASTIC, "restitution_speed": 0.2}, "needs the restitution; give"),
        (
            {"restitution_law": VISCOELASTIC, "restitution_speed": 0.2, "restitution": 0.4},
            "restitution: 0.4 is out of range",
        ),
        ({"restitution_law": PLASTIC, "restitution_speed": -1.0}, "restitution_speed = -1.0: must"),
    ],
)
def test_impossible_laws_are_refused(irregular, known, message):
    with pytest.raises(ParameterError, match=message):
        compare_tracks(irregular.tracks, **known)


def test_laws_are_ruled_out_only_by_most_of_the_bounces():
    rng = np.random.default_rng(0)

    def fit(name, distance):
        far = np.minimum(distance, FAR)
        return FittedLaw(Law(name, 1.0), np.array([0.8]), np.eye(1), 1.0, 9, 200, far)

    same = rng.chisquare(2.0, 200)
    fits = [fit("constant", same), fit(PLASTIC, same), fit(VISCOELASTIC, same + 1e-3)]
    # a law is ruled out if it fits worse, or if its additional parameter does not help
    assert possible_laws(fits) == ["constant"]
    noisy = [fit("constant", same), fit(VISCOELASTIC, rng.chisquare(2.0, 200))]
    assert len(possible_laws(noisy)) == 2
    few = same.copy()
    few[:3] += FAR
    assert len(possible_laws([fit("constant", few), fit(VISCOELASTIC, same)])) == 2
    lost = [fit("constant", same), failed_fit(Law(PLASTIC, 1.0), 200)]
    assert possible_laws(lost) == ["constant", PLASTIC]


@pytest.mark.parametrize("law", [PLASTIC, VISCOELASTIC])
def test_derivatives_of_laws(law):
    """Derivatives by speed, restitution and the logarithm of the yield speed, off the kink."""
    v, fitted, y = np.array([0.05, 0.15, 0.9, 4.0]), Law(law, 0.4), math.log(0.4)
    after, slope = fitted.rebound_speed(v, 0.8, y)
    np.testing.assert_allclose(after, v * restitution_at(v, 0.8, law, 0.4), rtol=1e-14)
    if law == PLASTIC:
        np.testing.assert_allclose(slope, after / v * np.where(v < 0.4, 1.0, 0.75), rtol=1e-8)
        by_e, by_y = fitted.derivatives(v, 0.8, y)
        np.testing.assert_allclose(by_e, after / 0.8, rtol=1e-8)
        np.testing.assert_allclose(by_y, np.where(v < 0.4, 0.0, after / 4.0), atol=1e-8)
    else:
        (by_e,) = fitted.derivatives(v, 0.8, y)
        rise = v * restitution_at(v, 0.801, law, 0.4) - after
        np.testing.assert_allclose(by_e, rise / 1e-3, rtol=1e-2)
