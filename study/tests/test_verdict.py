"""The rule: every verdict can follow from made-up evidence, and only numbers decide."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from study.claims_page import brief_reason
from study.estimates import Estimate
from study.samples import Setting
from study.verdict import (
    ROOM,
    Check,
    Evidence,
    Reading,
    Verdict,
    check,
    nearly_all,
    without_exception,
)

PASSED = check("a number", 0.5, "at most", 1.0)
MISSED = check("a number", 1.5, "at most", 1.0)
OPEN = check("a number", Estimate(1.0, 0.5, 1.5), "at most", 1.0)
NUMBERS = st.floats(-1e6, 1e6)


def under(setting, one):
    return Check(one.what, one.value, one.relation, one.bound, setting=Setting(setting))


@pytest.mark.parametrize(
    ("ends", "relation", "passed"),
    [
        ((1.0, 1.0), "at most", True),
        ((1.0, 1.0 + 1e-12), "at most", None),
        ((1.0 + 1e-12, 2.0), "at most", False),
        ((1.0, 1.0), "at least", True),
        ((0.9, 1.1), "at least", None),
        ((0.5, 0.9), "at least", False),
        ((math.nan, math.nan), "at most", None),
        ((math.inf, math.inf), "at most", False),
        ((math.inf, math.inf), "at least", True),
    ],
)
def test_an_interval_is_held_against_a_bound(ends, relation, passed):
    assert Check("a number", Estimate(ends[0], *ends), relation, 1.0).passed is passed


@given(NUMBERS, NUMBERS, NUMBERS)
def test_what_is_at_most_a_bound_is_at_least_its_opposite(one, other, bound):
    low, high = sorted((one, other))
    most = Check("a number", Estimate(low, low, high), "at most", bound)
    least = Check("a number", Estimate(-low, -high, -low), "at least", -bound)
    assert most.passed is least.passed


@pytest.mark.parametrize(
    ("checks", "passed"),
    [
        ([PASSED, PASSED], True),
        ([PASSED, MISSED], False),
        ([OPEN, MISSED], False),
        ([PASSED, OPEN], None),
        ([under("a", PASSED), under("b", PASSED)], True),
        ([under("a", MISSED), under("b", MISSED)], False),
        ([under("a", PASSED), under("b", MISSED)], None),
        ([under("a", PASSED), under("b", OPEN)], None),
        # missed under both, by another test in each
        ([under("a", PASSED), under("a", MISSED), under("b", MISSED), under("b", PASSED)], False),
    ],
)
def test_a_reading_must_come_out_alike_under_every_setting(checks, passed):
    assert Reading("", checks).passed is passed


@pytest.mark.parametrize(
    ("readings", "conditions", "verdict"),
    [
        ([PASSED], [], Verdict.HOLDS),
        ([PASSED, PASSED], [MISSED], Verdict.HOLDS),
        ([PASSED, MISSED], [], Verdict.CONDITIONAL),
        ([PASSED, OPEN], [], Verdict.CONDITIONAL),
        ([MISSED], [PASSED], Verdict.CONDITIONAL),
        ([OPEN], [PASSED], Verdict.CONDITIONAL),
        ([MISSED], [], Verdict.FAILS),
        ([MISSED, MISSED], [MISSED], Verdict.FAILS),
        ([OPEN], [], Verdict.UNDECIDED),
        ([MISSED, OPEN], [], Verdict.UNDECIDED),
        ([MISSED], [OPEN], Verdict.UNDECIDED),
    ],
)
def test_the_rule(readings, conditions, verdict):
    each = [[Reading("", [one]) for one in group] for group in (readings, conditions)]
    assert Evidence("moving", *each).verdict is verdict


def test_a_setting_without_a_case_says_nothing():
    nothing = nearly_all("share", [], Setting("empty"))
    assert Reading("", [under("a", PASSED), nothing]).passed is True
    assert Reading("", [under("a", MISSED), nothing]).passed is False
    alone = Reading("", [nothing])
    assert (alone.passed, alone.reason) == (None, "no case to test under any setting")


@pytest.mark.parametrize(
    ("flags", "passed"),
    [([True] * 73, True), ([True] * 72, None), ([True] * 5000 + [False], False)],
)
def test_one_exception_refutes_a_statement_about_all_cases(flags, passed):
    """Without an exception it takes 73 cases for Wilson's interval to begin above 95 %."""
    assert without_exception("exceptions", flags).passed is passed


def test_a_verdict_that_is_open_says_why():
    few = Evidence("moving", [Reading("one", [under("a", PASSED), under("b", OPEN)])])
    assert few.reason == "one: too few data under b"
    differs = Evidence("moving", [Reading("one", [under("a", PASSED), under("b", MISSED)])])
    assert differs.reason == ("one: it differs between settings: passes under a; missed under b")
    assert Evidence("moving", [Reading("one", [PASSED])]).reason == ""


def test_settings_that_come_out_unlike_most_others_are_named():
    checks = [under("a", PASSED), under("b", MISSED), under("c", PASSED), under("d", OPEN)]
    assert Reading("one", checks).unlike == ("b",)
    assert Reading("one", checks[::2]).unlike == ()
    few, differs = (Evidence("moving", [Reading("one", each)]) for each in (checks[2:], checks))
    assert (brief_reason(few), brief_reason(differs)) == ("too few data", "settings differ (b)")


def test_flights_higher_than_a_room_are_no_usable_condition():
    """Unless the claim holds under another condition, or as stated."""
    high, low = Reading("high", [PASSED], 2.0 * ROOM), Reading("low", [PASSED], 0.5 * ROOM)
    missed = [Reading("", [MISSED])]
    assert Evidence("moving", missed, [high]).verdict is Verdict.OUTSIDE
    assert Evidence("moving", missed, [high, low]).verdict is Verdict.CONDITIONAL
    assert Evidence("moving", [Reading("", [PASSED])], [high]).verdict is Verdict.HOLDS


def test_readings_under_which_a_claim_holds_are_named():
    first, second = Reading("first", [MISSED]), Reading("second", [PASSED])
    third = Reading("third", [PASSED])
    assert Evidence("moving", [first, second], [third]).holding == (second, third)
