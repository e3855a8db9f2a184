"""The page stands alone, is valid and says what the numbers say; JSON holds the same."""

import json
import re
import tomllib
from html.parser import HTMLParser
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from vibrosweep.errors import OutputError
from vibrosweep.study import report
from vibrosweep.study.verdict import Check, Claim, Number, Outcome, Picture

VOID = {"meta", "img", "br", "link"}


class Reader(HTMLParser):
    """Collects ids and links, and insists that every element is closed in order."""

    def __init__(self):
        super().__init__()
        self.open, self.ids, self.sources, self.links = [], [], [], []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.ids += [given["id"]] if "id" in given else []
        self.sources += [given["src"]] if "src" in given else []
        self.links += [given["href"]] if "href" in given else []
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture
def awkward():
    """A claim whose texts hold what HTML must escape, and numbers that JSON cannot hold."""
    outcome = Outcome(
        as_stated=[Check("a < b & 'c'", float("nan"), "at most", 1e-8, "s")],
        numbers=[Number("speed <v>", float("inf"), "m s-1"), Number("small", -1.5e-7)],
        pictures=[Picture("plain", 'with "quotes" & <tags>', Figure(figsize=(1, 1)))],
    )
    return Claim(7, "Eq. <1>", "x_{min} < y^2 & z", "method", "", "reason", outcome)


def test_the_page_is_well_formed_and_needs_nothing_else(page):
    checker = Reader()
    checker.feed(page)
    assert checker.open == []
    assert len(set(checker.ids)) == len(checker.ids)
    assert all(source.startswith("data:image/svg+xml;base64,") for source in checker.sources)
    assert {link.removeprefix("#") for link in checker.links} == set(checker.ids)
    assert not re.search(r"url\(|@import|<script|<link", page)
    assert "$" not in re.sub(r'src="[^"]*"', "", page)


def test_the_page_shows_every_verdict_and_number(claims, page):
    for claim in claims:
        section = page.split(f'id="claim-{claim.number}"')[1].split("</section>")[0]
        assert f">{claim.outcome.verdict.value}</span>" in section
        tests = (*claim.outcome.as_stated, *claim.outcome.conditional)
        assert section.count('"pass"') == sum(test.passed for test in tests)
        assert section.count('"miss"') == sum(not test.passed for test in tests)
        assert section.count("<figure") == len(claim.outcome.pictures)


def test_texts_are_escaped(awkward):
    page = report.as_html([awkward], {"cpu": "<b>"})
    checker = Reader()
    checker.feed(page)
    assert checker.open == []
    assert "x<sub>min</sub> &lt; y<sup>2</sup> &amp; z" in page
    assert "a &lt; b &amp; &#x27;c&#x27;" in page
    assert 'alt="with &quot;quotes&quot; &amp; &lt;tags&gt;"' in page
    assert "not defined" in page
    assert "<dd>&lt;b&gt;</dd>" in page


@pytest.mark.parametrize(
    ("value", "units", "shown"),
    [
        (0.0, "1", "0"),
        (1.22625, "m", "1.2263 m"),
        (-2.5, "m s-1", "\N{MINUS SIGN}2.5 m s<sup>\N{MINUS SIGN}1</sup>"),
        (1e-8, "s", "10<sup>\N{MINUS SIGN}8</sup> s"),
        (3.25e7, "1", "3.25 \N{MULTIPLICATION SIGN} 10<sup>7</sup>"),
        (float("inf"), "s", "infinite"),
    ],
)
def test_numbers_are_written_for_people(value, units, shown):
    assert report.quantity(value, units) == shown


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("dt_min < tau_c", "dt<sub>min</sub> &lt; τ<sub>c</sub>"),
        ("2v_0/g", "2v<sub>0</sub>/g"),
        ("(1 - t/t_∞)^2", "(1 - t/t<sub>∞</sub>)<sup>2</sup>"),
        ("10^{-6} of base_shared", "10<sup>-6</sup> of base_shared"),
    ],
)
def test_marks_become_subscripts_and_superscripts(text, shown):
    assert report.marked_up(text) == shown


def test_json_holds_every_claim_and_no_nan(claims, awkward):
    document = json.loads(report.as_json([*claims, awkward], {"created": "now"}))
    assert document["provenance"] == {"created": "now"}
    assert [claim["number"] for claim in document["claims"]] == [*range(1, 14), 7]
    for claim, data in zip(claims, document["claims"], strict=False):
        assert data["verdict"] == claim.outcome.verdict.value
        found = [test["value"] for test in data["tests_as_stated"]]
        assert found == [test.value for test in claim.outcome.as_stated]
    last = document["claims"][-1]
    assert last["tests_as_stated"][0]["value"] is None
    assert last["tests_as_stated"][0]["passed"] is False
    assert last["claim"] == "x_min < y^2 & z"


def test_files_are_replaced_as_a_whole(awkward, tmp_path):
    written = report.write([awkward], tmp_path / "new" / "place", 1, pictures=True)
    assert [path.name for path in written] == ["claims.html", "claims.json", "plain.png"]
    before = written[0].read_bytes()
    report.write([awkward], tmp_path / "new" / "place", 1)
    assert sorted(path.name for path in written[0].parent.iterdir()) == sorted(
        path.name for path in written
    )
    without_time = re.compile(rb"<dt>created</dt><dd>[^<]*")
    assert without_time.sub(b"", written[0].read_bytes()) == without_time.sub(b"", before)


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "taken").write_text("")
    with pytest.raises(OutputError, match=r"taken.*choose another directory with output="):
        report.prepare(tmp_path / "taken")


def test_what_is_drawn_at_random_names_its_ranges_and_whose_they_are():
    """The study states none: no share over random realizations may read as if it did."""
    texts = tomllib.loads((Path(report.__file__).with_name("texts.toml")).read_text("utf-8"))
    methods = [c["method"] for c in texts["claim"].values() if " random re" in c["method"]]
    assert len(methods) == 5
    for method in methods:
        words = " ".join(method.split())
        assert "0.80 to 0.98" in words
        assert "this package's range" in words
        assert "the study states none" in words
