"""Every claim is computed from the map: known numbers, and verdicts that turn with the physics."""

import math

import pytest
import xarray as xr

from vibrosweep.model import theory
from vibrosweep.study import (
    claims_on_energy,
    claims_on_heights,
    claims_on_laboratory,
    claims_on_order,
    claims_on_scheme,
    collect,
)
from vibrosweep.study.report import as_json
from vibrosweep.study.verdict import Verdict


def value(outcome, words):
    """The one number or test of an outcome whose description contains the words."""
    everything = [*outcome.as_stated, *outcome.conditional, *outcome.numbers]
    found = {one.what: one.value for one in everything if words in one.what}
    assert len(found) == 1, found
    return next(iter(found.values()))


def test_all_thirteen_are_there_with_their_words(claims):
    assert [claim.number for claim in claims] == list(range(1, 14))
    for claim in claims:
        assert claim.sentence
        assert claim.method
        assert claim.reason
        assert bool(claim.condition) == bool(claim.outcome.conditional)
        assert claim.outcome.as_stated


def test_every_number_is_a_number(outcomes):
    for outcome in outcomes.values():
        for one in (*outcome.as_stated, *outcome.conditional, *outcome.numbers):
            assert math.isfinite(one.value), one.what


def test_closed_forms_are_met(outcomes):
    rest = theory.unforced_rest_time(5.0, 0.9, 1e-4)
    assert value(outcomes[1], "time at rest at e = 0.9") == float(rest)
    assert value(outcomes[6], "decay per impact at Table 1, measured") == pytest.approx(
        math.sqrt(0.9), rel=1e-4
    )
    assert value(outcomes[6], "full multipliers agree") == 1.0
    fitted, exact = (
        value(outcomes[10], words) for words in ("Table 1, fitted", "same from the multipliers")
    )
    assert math.log(fitted) == pytest.approx(math.log(exact), rel=0.01)
    assert value(outcomes[5], "against the closed form") < 1e-8
    # a separation falls from half a period to tau_c by sqrt(e) per impact, once a period
    closing = math.log(0.5 / 1e-4) / -math.log(math.sqrt(0.9))
    assert value(outcomes[10], "a slot closes") == pytest.approx(closing, rel=1e-5)


def test_the_scheme_is_of_first_order(outcomes):
    assert value(outcomes[12], "order of convergence") == pytest.approx(1.0, abs=0.1)


def test_a_single_particle_is_ordered_and_alone(monkeypatch):
    monkeypatch.setattr(claims_on_order, "POPULATIONS", (1,))
    assert claims_on_order.bounded_and_ordered(1).verdict is Verdict.HOLDS


def test_heights_hardly_depend_on_a_narrow_range(monkeypatch):
    ranges = claims_on_heights.SAMPLE_RANGES | {"restitution": (0.9, 0.905)}
    monkeypatch.setattr(claims_on_heights, "SAMPLE_RANGES", ranges)
    assert claims_on_heights.plateau(1).verdict is Verdict.HOLDS


def test_an_orbit_that_is_not_settled_is_out_of_balance(monkeypatch):
    monkeypatch.setattr(claims_on_energy, "SETTLED", 3.0)
    assert claims_on_energy.balance(1).verdict is Verdict.FAILS


def test_a_coarse_step_fails_even_on_a_locked_orbit(monkeypatch):
    steps = (4e-2, 2e-2)
    monkeypatch.setattr(claims_on_scheme, "STEPS", steps)
    monkeypatch.setattr(claims_on_scheme, "SHOWN", steps)
    monkeypatch.setattr(claims_on_scheme, "STEP", steps[0])
    assert claims_on_scheme.step_of_one_millisecond(1).verdict is Verdict.FAILS


def test_the_same_whatever_the_number_of_threads(claims):
    assert as_json(collect.judge_all(threads=1), {}) == as_json(claims, {})


def experiment(height, period, grows):
    """A virtual experiment of one setting in two cases."""
    dims = ("trial", "method", "reading")
    flags = {
        f"{q}_{what}": (dims, [[[f]]])
        for q in ("height", "period")
        for what, f in (("grows", grows), ("in_band", False))
    }
    study = xr.Dataset(
        {
            "height_error": ((*dims, "case"), [[[height]]]),
            "period_error": ((*dims, "case"), [[[period]]]),
            "compared": 1.0,
        }
    )
    return study, xr.Dataset(flags)


@pytest.mark.parametrize(
    ("height", "period", "grows", "verdict"),
    [
        ([1.0, 7.9], [0.5, 3.0], True, Verdict.HOLDS),
        ([1.0, 7.9], [0.5, 3.0], False, Verdict.FAILS),
        ([1.0, 8.1], [0.5, 3.0], True, Verdict.FAILS),
        ([1.0, math.nan], [0.5, 3.0], True, Verdict.FAILS),
    ],
)
def test_the_virtual_experiment_decides_claim_13(height, period, grows, verdict):
    assert claims_on_laboratory.judged(*experiment(height, period, grows)).verdict is verdict


def test_one_setting_among_others_is_a_condition():
    both = [experiment([1.0, 7.0], [1.0, 2.0], grows) for grows in (True, False)]
    study, bands = (xr.concat(parts, "trial", data_vars="all") for parts in zip(*both, strict=True))
    assert claims_on_laboratory.judged(study, bands).verdict is Verdict.CONDITIONAL
