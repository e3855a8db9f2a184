"""Samples: the same for the same seed, in the ranges, seed after seed."""

import numpy as np
import pytest

from study import samples
from study.bases import FIXED, HIGH_BOUNCE, MOVING, SPRUNG
from study.estimates import share
from study.samples import (
    ANY_PHASE,
    FIRST,
    LAWS,
    TABLE_1,
    Plan,
    by_seed,
    irregular,
    laws,
    measured,
    records,
    settings_of,
)


@pytest.mark.parametrize("base", [*FIXED, SPRUNG])
def test_settings_are_three_ranges_and_contact_times_over_a_factor_of_ten(base):
    settings = settings_of(base)
    assert settings[0] is FIRST
    assert len({one.name for one in settings}) == len(settings)
    assert len({tuple(one.ranges.values()) for one in settings}) == 3
    contact = [one.constants["contact_time"] for one in settings if "contact_time" in one.constants]
    assert max(contact) / min(contact) == pytest.approx(10.0)
    masses = [one.constants["mass_ratio"] for one in settings if "mass_ratio" in one.constants]
    assert bool(masses) == (base == SPRUNG)
    assert {one.law for one in settings} == ({*LAWS} if base == HIGH_BOUNCE else {"rest"})


def test_a_setting_says_what_is_drawn_and_what_is_not():
    """Under each law, with other ranges and constants; no parameter has both."""
    rest, reflect = laws(HIGH_BOUNCE, FIRST)
    assert (rest.law, reflect.law) == LAWS
    assert reflect.drawn(Plan(seeds=1, realizations=2))["rebound"] == "reflect"
    assert laws(MOVING) == (TABLE_1,)
    fixed = FIRST.over(phase=ANY_PHASE).with_constants(amplitude=1.0)
    assert {*fixed.ranges} == {"restitution", "phase"}
    assert fixed.constants == {"amplitude": 1.0}


def test_a_seed_draws_the_same_whatever_the_other_seeds():
    both, second = (
        FIRST.over(phase=ANY_PHASE).drawn(Plan(first_seed=first, seeds=seeds, realizations=10))
        for first, seeds in ((4, 2), (5, 1))
    )
    for name, values in both.items():
        np.testing.assert_array_equal(by_seed(Plan(seeds=2), values)[1], second[name])
        low, high = {**FIRST.ranges, "phase": ANY_PHASE}[name]
        assert np.all((low <= values) & (values <= high))


def test_records_hold_all_that_is_drawn_in_its_order(monkeypatch):
    monkeypatch.setattr(samples, "TOGETHER", 4)
    plan = Plan(seeds=2, realizations=3)
    drawn = FIRST.drawn(plan)
    each = list(records(plan, MOVING, drawn, launch_time=0.0, duration=3.0))
    found = np.concatenate([one["restitution"].values for one in each])
    np.testing.assert_array_equal(found, drawn["restitution"])
    assert each[0].attrs["base"] == MOVING


@pytest.mark.parametrize(("window", "known"), [(40.0, False), (2000.0, True)])
def test_a_window_too_short_for_exponents_gives_no_share_of_irregular_motion(window, known):
    """At e = 0.9 and 3 g over a moving base a flight takes a period or more."""
    found = measured(
        Plan(threads=1),
        MOVING,
        {"restitution": np.full(4, 0.9), "phase": np.linspace(0.1, 0.8, 4)},
        base_acceleration=3.0,
        amplitude=None,
        particles=1,
        duration=100.0 + window,
        transient=100.0,
        regimes=True,
        lyapunov=True,
        per_particle=True,
    )
    estimate = share(*irregular(found))
    assert (estimate.value > 0.5) if known else np.isnan(estimate.value)
    assert estimate.high > 0.9
