"""The outcomes of all claims, computed once."""

import pytest

from vibrosweep.study import claims_on_laboratory, collect, report


@pytest.fixture(scope="session", autouse=True)
def small_experiment():
    """The virtual experiment of claim 13 as small as it can be: it has tests of its own."""
    with pytest.MonkeyPatch.context() as patch:
        small = {"cases": {"A": 1, "B": 5}, "repeats": 1, "duration": 2.0, "transient": 2.0}
        patch.setattr(claims_on_laboratory, "SIZE", small)
        yield


@pytest.fixture(scope="session")
def claims(small_experiment):
    return collect.judge_all(threads=2)


@pytest.fixture(scope="session")
def outcomes(claims):
    return {claim.number: claim.outcome for claim in claims}


@pytest.fixture(scope="session")
def page(claims):
    return report.as_html(claims, {"source": "vibrosweep"})
