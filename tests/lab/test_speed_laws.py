"""Dependence of restitution on impact speed: the favoured law over both bases."""

import math

import numpy as np
import pytest

from vibrosweep.errors import ParameterError
from vibrosweep.lab.compare import compare_tracks
from vibrosweep.lab.estimation import estimate
from vibrosweep.lab.experiment import LABORATORY, Experiment
from vibrosweep.lab.impacts import find_impacts
from vibrosweep.lab.lines import impact_lines, table_lines
from vibrosweep.lab.regression import FAR, FittedLaw, Law, failed_fit, law_text, possible_laws
from vibrosweep.lab.trials import perform_trials
from vibrosweep.model.restitution_laws import PLASTIC, VISCOELASTIC, restitution_at

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
    plan = Experiment(**scene, particles=3, repeats=1, transient=0.0, duration=6.0, seed=seed)
    return perform_trials(plan)[0].tracks


@pytest.mark.parametrize("base", SCENES)
@pytest.mark.parametrize("law", ["constant", PLASTIC, VISCOELASTIC])
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
    tracks = film("level", VISCOELASTIC, seed=2)
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
