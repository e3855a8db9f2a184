"""The quick part of the campaign of interruptions; checks/resumes.py is the whole of it."""

import numpy as np
import pytest

import resumes
from vibrosweep.runs import driver as run


def test_interrupted_and_changed_sweeps_are_refused_or_come_out_the_same(tmp_path):
    findings = resumes.campaign(tmp_path, 5, seed=3)
    assert findings.failures == 0
    assert findings.resumes > 5
    assert findings.refused > 2


def test_the_campaign_notices_a_wrong_resume(tmp_path, monkeypatch):
    monkeypatch.setattr("vibrosweep.runs.driver.differences", lambda before, now: [])
    findings = resumes.campaign(tmp_path, 3, seed=3)
    assert findings.wrongly_taken + findings.harmed > 0


@pytest.mark.parametrize("seed", range(40))
def test_the_identity_changes_exactly_if_the_change_must_be_refused(seed):
    rng = np.random.default_rng(seed)
    tables = resumes.random_tables(rng)
    other, key = resumes.changed(tables, rng)
    before, now = (resumes.parse_spec(resumes.text_of(t)) for t in (tables, other))
    assert (run.identity(before) == run.identity(now)) is (key == "")
