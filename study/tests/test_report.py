"""JSON holds what the claims hold, and files are replaced as a whole."""

import json

import pytest
from matplotlib.figure import Figure

from study import report
from study.bases import HIGH_BOUNCE
from study.samples import LAWS, Setting
from study.texts import drawn
from study.verdict import Claim, Evidence, Outcome, Reading, check, number
from vibrosweep.errors import OutputError

SETTING = Setting("setting", {"amplitude": (1.0, 2.0)}, null_model="uniform phases")
ORIGIN = {"source": "vibrosweep"}


@pytest.fixture
def awkward():
    """A claim with numbers that JSON cannot hold, and a picture."""
    tests = [check("a < b", float("nan"), "at most", 1e-8, "s", SETTING)]
    evidence = Evidence(
        "moving", [Reading("x_{min}", tests)], numbers=[number("speed", float("inf"), "m s-1")]
    )
    picture = drawn("plain", "caption", Figure(figsize=(1, 1)))
    return Claim("7", "Eq. 1", "x_{min} < y^2", "method", "", Outcome([evidence], [picture]))


def test_json_holds_every_claim_and_no_nan(claims, awkward):
    document = json.loads(report.as_json([*claims, awkward], {"created": "now"}))
    assert document["provenance"] == {"created": "now"}
    assert [claim["number"] for claim in document["claims"]] == [*(c.key for c in claims), "7"]
    for claim, data in zip(claims, document["claims"], strict=False):
        for one, found in zip(claim.outcome.evidence, data["evidence"], strict=True):
            assert found["verdict"] == one.verdict.value
            for reading, shown in zip(one.readings, found["readings"], strict=True):
                assert shown["passed"] == reading.passed
                assert len(shown["tests"]) == len(reading.checks)
    last = document["claims"][-1]
    assert last["claim"] == "x_min < y^2"
    test = last["evidence"][0]["readings"][0]["tests"][0]
    assert (test["value"], test["passed"], test["setting"]) == (None, None, "setting")
    assert test["range"] == {"amplitude": [1.0, 2.0]}
    assert test["null_model"] == "uniform phases"


def test_json_names_base_law_range_and_null_model_of_every_number(claims):
    document = json.loads(report.as_json(claims, {}))
    for claim in document["claims"]:
        for one in claim["evidence"]:
            tests = [t for r in one["readings"] + one["conditions"] for t in r["tests"]]
            for each in tests + one["numbers"]:
                assert each["base"] == one["base"]
                assert (each["law"] in LAWS) == (one["base"] == HIGH_BOUNCE)
                assert each["range"]
                assert bool(each["null_model"]) == (claim["number"] == "24")


def test_files_are_replaced_as_a_whole(awkward, tmp_path):
    written = report.write([awkward], tmp_path / "new" / "place", ORIGIN, pictures=True)
    assert [path.name for path in written] == ["claims.html", "claims.json", "plain.png"]
    before = written[0].read_bytes()
    report.write([awkward], tmp_path / "new" / "place", ORIGIN)
    assert sorted(path.name for path in written[0].parent.iterdir()) == sorted(
        path.name for path in written
    )
    assert written[0].read_bytes() == before


def test_the_page_says_what_computed_it():
    origin = report.provenance(threads=2)
    assert origin["threads"] == "2"
    assert origin["source"].startswith("vibrosweep ")
    assert "numba" in origin["libraries"]
    assert {"created", "python", "cpu"} <= origin.keys()


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(OutputError, match=r"taken.*choose another directory"):
        report.prepare(tmp_path / "taken")
