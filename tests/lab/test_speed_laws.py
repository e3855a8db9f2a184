"""Restitution against the speed of impact: which law bounces allow, over both bases."""

import math

import numpy as np
import pytest

from vibrosweep.lab.estimation import estimate
from vibrosweep.lab.experiment import LABORATORY, Experiment
from vibrosweep.lab.impacts import find_impacts
from vibrosweep.lab.lines import impact_lines
from vibrosweep.lab.speed_laws import FAR, FittedLaw, Law, law_text, possible, unfitted
from vibrosweep.lab.trials import perform_trials
from vibrosweep.model.restitution_laws import PLASTIC, VISCOELASTIC, restitution_at

G, FREQUENCY = LABORATORY["gravity"], LABORATORY["frequency"]
SCENES = {
    "moving": {"restitution": 0.8, "amplitude": 1.8 * 1.5 * G / (2.0 * math.pi * FREQUENCY)},
    "level": {"restitution": 0.85, "amplitude": 0.12},
}
SPEED = {"moving": 0.3, "level": 0.2}


def found(base, law):
    """What a film of three particles tells; its restitution has this law."""
    scene = {**LABORATORY, **SCENES[base], "phase": 0.3}
    scene["base"] = "moving" if base == "moving" else "high-bounce"
    if law != "constant":
        scene |= {"restitution_law": law, "restitution_speed": SPEED[base]}
    plan = Experiment(**scene, particles=3, repeats=1, transient=0.0, duration=6.0)
    return find_impacts(perform_trials(plan)[0].tracks, frequency=FREQUENCY, motion=base)


@pytest.mark.parametrize("base", SCENES)
@pytest.mark.parametrize("law", ["constant", PLASTIC, VISCOELASTIC])
def test_bounces_tell_the_law_of_their_restitution(base, law):
    impacts = found(base, law)
    one = estimate(impacts, frequency=FREQUENCY)
    assert one.attrs["restitution_law"].split(" or ")[0] == law
    fitted = one.sel(law=law)
    e, speed = float(fitted["law_restitution"]), float(fitted["law_speed"])
    truth = SCENES[base]["restitution"]
    if law == VISCOELASTIC:  # at a speed of its choice
        truth = float(restitution_at(speed, truth, law, SPEED[base]))
    assert abs(e - truth) < 5.0 * float(fitted["law_restitution_error"]) < 0.03
    if law == PLASTIC:
        assert abs(speed - SPEED[base]) < 5.0 * float(fitted["law_speed_error"]) < 0.03
    if base == "moving":
        assert law_text(one) in "\n".join(impact_lines(impacts))


def test_laws_are_left_open_unless_most_bounces_speak_against_them():
    rng = np.random.default_rng(0)

    def fit(name, distance):
        return FittedLaw(Law(name, 1.0), 0.8, 0.01, 1.0, 0.1, np.minimum(distance, FAR))

    same = rng.chisquare(2.0, 200)
    fits = [fit("constant", same), fit(PLASTIC, same), fit(VISCOELASTIC, same + 1e-3)]
    # a parameter that gains nothing is ruled out, and what is as good is not
    assert possible(fits) == ["constant"]
    noisy = [fit("constant", same), fit(VISCOELASTIC, rng.chisquare(2.0, 200))]
    assert len(possible(noisy)) == 2
    few = same.copy()
    few[:3] += FAR
    assert len(possible([fit("constant", few), fit(VISCOELASTIC, same)])) == 2
    lost = [fit("constant", same), unfitted(Law(PLASTIC, 1.0), 200)]
    assert possible(lost) == ["constant", PLASTIC]


@pytest.mark.parametrize("law", [PLASTIC, VISCOELASTIC])
def test_derivatives_of_laws(law):
    """By speed, restitution and the logarithm of the speed of yielding, off the kink."""
    v, one, y = np.array([0.05, 0.15, 0.9, 4.0]), Law(law, 0.4), math.log(0.4)
    after, slope = one.after(v, 0.8, y)
    np.testing.assert_allclose(after, v * restitution_at(v, 0.8, law, 0.4), rtol=1e-14)
    if law == PLASTIC:
        np.testing.assert_allclose(slope, after / v * np.where(v < 0.4, 1.0, 0.75), rtol=1e-8)
        by_e, by_y = one.by_parameters(v, 0.8, y)
        np.testing.assert_allclose(by_e, after / 0.8, rtol=1e-8)
        np.testing.assert_allclose(by_y, np.where(v < 0.4, 0.0, after / 4.0), atol=1e-8)
    else:
        (by_e,) = one.by_parameters(v, 0.8, y)
        rise = v * restitution_at(v, 0.801, law, 0.4) - after
        np.testing.assert_allclose(by_e, rise / 1e-3, rtol=1e-2)
