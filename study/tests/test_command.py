"""``python -m study``: what it writes and prints, how it resumes, and what it refuses."""

import json

import pytest

from study import __main__ as command
from study import campaign, collect
from study.verdict import ANY_BASE, Evidence, Outcome, Reading, Verdict, check


class Judges:
    """Claims that need no computation; those judged are counted, and one may be stopped."""

    def __init__(self):
        self.judged, self.stops = [], None

    def of(self, key):
        def test(plan):
            if key == self.stops:
                raise KeyboardInterrupt
            self.judged.append(key)
            passed = Reading("as it is", [check("a number", 0.5, "at most", 1.0)])
            return Outcome([Evidence(ANY_BASE, [passed])])

        return test


@pytest.fixture
def claims(monkeypatch):
    made = Judges()
    keys = ("1", "2", "4a", "4b", "9")
    monkeypatch.setattr(collect, "TESTS", {key: made.of(key) for key in keys})
    return made


def shown(directory):
    """Numbers of the claims on the page, and the sentences above them."""
    document = json.loads((directory / "claims.json").read_text(encoding="utf-8"))
    page = (directory / "claims.html").read_text(encoding="utf-8")
    numbers = [claim["number"] for claim in document["claims"]]
    assert all(f'id="claim-{number}"' in page for number in numbers)
    assert all(sentence in page for sentence in document["state"])
    return numbers, " ".join(document["state"])


def test_it_says_how_long_it_takes_and_then_judges_and_writes(claims, tmp_path, capsys):
    assert command.main(["-o", str(tmp_path), "--threads", "1"]) == 0
    first, second, *others = capsys.readouterr().out.splitlines()
    assert first.startswith("4 claims of 4, from ")
    assert "s of processor time" in second
    assert any(Verdict.HOLDS.value in line for line in others)
    assert json.loads((tmp_path / "claims.json").read_text())["provenance"]["threads"] == "1"
    for name in ("claims.html", "claims.json"):
        assert str(tmp_path / name) in others
    assert shown(tmp_path)[0] == ["1", "2", "4a", "4b", "9"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["claims.html", "claims.json"]


@pytest.mark.parametrize("full", [True, False])
def test_quick_samples_are_said_on_the_page_and_have_a_directory_of_their_own(
    claims, full, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert command.main(["--full"] if full else []) == 0
    _, state = shown(tmp_path / ("claims" if full else "claims-quick"))
    assert ("Quick samples" in state) != full


def test_claims_are_chosen_by_their_numbers(claims, tmp_path):
    assert command.main(["-o", str(tmp_path), "--claims", "9", "4"]) == 0
    assert claims.judged == ["4a", "4b", "9"]
    numbers, state = shown(tmp_path)
    assert numbers == claims.judged
    assert "2 claims of 4 were selected" in state


def test_the_page_grows_and_a_stopped_campaign_goes_on(claims, tmp_path, capsys):
    claims.stops = "4a"
    assert command.main(["-o", str(tmp_path)]) == 130
    assert "the same command resumes" in capsys.readouterr().err
    numbers, state = shown(tmp_path)
    assert numbers == ["1", "2"]
    assert "2 of 4 claims are decided so far" in state
    claims.stops = None
    assert command.main(["-o", str(tmp_path), "--threads", "1"]) == 0
    assert "2 are decided, 2 are left" in capsys.readouterr().out
    assert claims.judged == ["1", "2", "4a", "4b", "9"]
    assert shown(tmp_path)[0] == claims.judged
    assert not (tmp_path / ".decided").exists()


def test_other_samples_or_another_program_do_not_go_on(claims, tmp_path, monkeypatch):
    claims.stops = "2"
    command.main(["-o", str(tmp_path)])
    assert command.main(["-o", str(tmp_path), "--full"]) == 130
    assert claims.judged == ["1", "1"]
    monkeypatch.setattr(campaign.Campaign, "mark", b"another version of the program")
    assert command.main(["-o", str(tmp_path)]) == 130
    assert claims.judged == ["1", "1", "1"]


def test_a_kept_claim_that_is_cut_off_is_judged_again(claims, tmp_path):
    claims.stops = "2"
    command.main(["-o", str(tmp_path)])
    (kept,) = (tmp_path / ".decided").iterdir()
    kept.write_bytes(kept.read_bytes()[:-5])
    claims.stops = None
    assert command.main(["-o", str(tmp_path)]) == 0
    assert claims.judged == ["1", "1", "2", "4a", "4b", "9"]


def test_a_claim_that_does_not_exist_is_refused(claims, tmp_path, capsys):
    assert command.main(["-o", str(tmp_path), "--claims", "2", "77"]) == 2
    assert "there is no claim 77; claims are 1 to 9" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_a_directory_that_is_a_circle_of_links(claims, tmp_path, capsys):
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    assert command.main(["-o", str(loop)]) == 2
    assert str(loop) in capsys.readouterr().err


def test_zero_threads_are_refused(claims, tmp_path, capsys):
    assert command.main(["-o", str(tmp_path), "--threads", "0"]) == 2
    assert "threads = 0" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_an_interruption_before_the_first_claim_writes_nothing(claims, tmp_path):
    claims.stops = "1"
    assert command.main(["-o", str(tmp_path)]) == 130
    assert not any(tmp_path.iterdir())
