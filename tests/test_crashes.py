"""The quick part of the campaign of power cuts; checks/crashes.py is the whole of it."""

import pytest

import crashes
from vibrosweep.store import disk

SHORT = [name for name in crashes.SCENARIOS if name != "200 chunks"]


@pytest.mark.parametrize("name", SHORT)
def test_the_same_command_goes_on_after_a_power_cut(tmp_path, name):
    findings = crashes.campaign(tmp_path / "disk", crashes.SCENARIOS[name], 12, seed=5)
    assert findings.states == 12
    assert findings.failures == 0
    assert (findings.finished > 0) is (name != "one chunk")


@pytest.mark.parametrize("lost", ["bytes", "names"])
def test_the_campaign_notices_data_that_are_not_flushed(tmp_path, monkeypatch, lost):
    if lost == "bytes":  # as if the run had not asked for it
        monkeypatch.setattr(crashes.Recorder, "_flushes", lambda self, descriptor: None)
    else:
        monkeypatch.setattr(disk, "flush_directory", lambda path: None)
    findings = crashes.campaign(tmp_path / "disk", crashes.SCENARIOS["3 chunks"], 15, seed=1)
    assert findings.lost > 0
