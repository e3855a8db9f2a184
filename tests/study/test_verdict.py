"""The rule: every verdict comes out, and only from the numbers."""

from dataclasses import replace

import pytest

from vibrosweep.study.verdict import Check, Outcome, Verdict

PASSED = Check("a number", 0.5, "at most", 1.0)
MISSED = Check("a number", 1.5, "at most", 1.0)


@pytest.mark.parametrize(
    ("value", "relation", "passed"),
    [
        (1.0, "at most", True),
        (1.0 + 1e-12, "at most", False),
        (1.0, "at least", True),
        (1.0 - 1e-12, "at least", False),
        (float("nan"), "at most", False),
        (float("nan"), "at least", False),
        (float("inf"), "at most", False),
        (float("inf"), "at least", True),
    ],
)
def test_a_number_is_held_against_its_bound(value, relation, passed):
    assert Check("a number", value, relation, 1.0).passed is passed


@pytest.mark.parametrize(
    ("as_stated", "conditional", "verdict"),
    [
        ([PASSED], [], Verdict.HOLDS),
        ([PASSED, PASSED], [MISSED], Verdict.HOLDS),
        ([MISSED], [], Verdict.FAILS),
        ([PASSED, MISSED], [PASSED], Verdict.CONDITIONAL),
        ([MISSED], [PASSED, MISSED], Verdict.FAILS),
    ],
)
def test_the_rule(as_stated, conditional, verdict):
    assert Outcome(as_stated, conditional).verdict is verdict


def moved(test, passed):
    """The same test with its number on the side of the bound that is asked for."""
    sign = 1.0 if (test.relation == "at most") is passed else -1.0
    return replace(test, value=test.bound - sign * (1.0 + abs(test.bound)))


def test_every_claim_would_turn_with_its_numbers(outcomes):
    for outcome in outcomes.values():
        good, bad = ([moved(t, p) for t in outcome.as_stated] for p in (True, False))
        assert replace(outcome, as_stated=good).verdict is Verdict.HOLDS
        for i in range(len(good)):
            one_bad = [*good[:i], bad[i], *good[i + 1 :]]
            conditional = [moved(t, True) for t in outcome.conditional]
            turned = replace(outcome, as_stated=one_bad, conditional=conditional).verdict
            assert turned is (Verdict.CONDITIONAL if conditional else Verdict.FAILS)
            worse = [moved(t, False) for t in outcome.conditional]
            assert replace(outcome, as_stated=one_bad, conditional=worse).verdict is Verdict.FAILS
