"""The outcomes of all claims from a small campaign, computed once."""

import pytest

from study import claims_on_laboratory, claims_on_robustness, claims_page, collect
from study.bases import FIXED
from study.disturbances import DRIVE, OWN, WAVEFORM, disturbances
from study.samples import Plan

# The base of finite mass has tests of its own
SMALL = {"seeds": 3, "realizations": 8, "bases": FIXED}


@pytest.fixture(scope="session", autouse=True)
def small_campaign():
    """Few disturbances, one experiment."""
    with pytest.MonkeyPatch.context() as patch:
        size = claims_on_laboratory.SIZE
        small = {"cases": {"A": 1, "B": 5}, "imperfections": size["imperfections"][:1]}
        patch.setattr(claims_on_laboratory, "SIZE", size | small)
        patch.setattr(claims_on_robustness, "disturbances", few_disturbances)
        patch.setattr(claims_on_robustness, "LONG", 100.0)
        yield


def few_disturbances(*orbit):
    """One disturbance of each kind that a test compares: all of them take a minute to compile."""
    every = disturbances(*orbit)
    chosen = {OWN[1]: "5 %", DRIVE: "5 %", WAVEFORM: "parabolic"}
    return {kind: {name: every[kind][name]} for kind, name in chosen.items()}


@pytest.fixture(scope="session")
def claims(small_campaign):
    return list(collect.judge_all(Plan(threads=2, **SMALL)))


@pytest.fixture(scope="session")
def outcomes(claims):
    return {claim.key: claim.outcome for claim in claims}


@pytest.fixture(scope="session")
def shown(claims):
    return claims_page.as_html(claims, {"source": "vibrosweep"})
