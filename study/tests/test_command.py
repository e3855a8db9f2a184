"""``python -m study``: what it writes and prints, and what it refuses."""

import json

import pytest

from study import __main__ as command
from study import collect
from study.verdict import ANY_BASE, Evidence, Outcome, Reading, Verdict, check


@pytest.fixture
def one_claim(monkeypatch):
    """A claim that needs no computation."""
    passed = Reading("as it is", [check("a number", 0.5, "at most", 1.0)])
    outcome = Outcome([Evidence(ANY_BASE, [passed])])
    monkeypatch.setattr(collect, "TESTS", {"1": lambda plan: outcome})


def test_it_judges_and_writes(one_claim, tmp_path, capsys):
    assert command.main(["-o", str(tmp_path), "--threads", "1"]) == 0
    printed = capsys.readouterr().out
    assert Verdict.HOLDS.value in printed
    document = json.loads((tmp_path / "claims.json").read_text(encoding="utf-8"))
    assert [claim["number"] for claim in document["claims"]] == ["1"]
    assert document["provenance"]["threads"] == "1"
    for name in ("claims.html", "claims.json"):
        assert str(tmp_path / name) in printed


def test_a_directory_that_is_a_circle_of_links(one_claim, tmp_path, capsys):
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    assert command.main(["-o", str(loop)]) == 2
    assert str(loop) in capsys.readouterr().err


def test_zero_threads_are_refused(one_claim, tmp_path, capsys):
    assert command.main(["-o", str(tmp_path), "--threads", "0"]) == 2
    assert "threads = 0" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_an_interruption_writes_nothing(monkeypatch, tmp_path, capsys):
    def interrupted(plan):
        raise KeyboardInterrupt

    monkeypatch.setattr(collect, "TESTS", {"1": interrupted})
    assert command.main(["-o", str(tmp_path)]) == 130
    assert "nothing was written" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())
