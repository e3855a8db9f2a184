"""The page stands alone, is valid, and says what the numbers say."""

from html.parser import HTMLParser

import pytest
from matplotlib.figure import Figure

from study import claims_page
from study.estimates import Estimate
from study.samples import FIRST, RANGES, Setting
from study.texts import drawn, texts
from study.verdict import (
    ANY_BASE,
    Check,
    Claim,
    Evidence,
    Outcome,
    Reading,
    check,
)

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


def made_up(checks, base="moving", pictures=()):
    outcome = Outcome([Evidence(base, [Reading("read so", checks)])], pictures)
    return Claim("7", "Eq. <1>", "x_{min} < y^2 & z", "method", "", outcome)


def test_a_verdict_that_depends_on_no_base_spans_all_columns():
    row = claims_page.as_html([made_up([check("a", 1.0, "at most", 2.0)], ANY_BASE)], {})
    assert 'colspan="3"' in row


def test_texts_are_escaped():
    picture = drawn("plain", 'with "quotes" & <tags>', Figure(figsize=(1, 1)))
    claim = made_up([check("a < b & 'c'", float("nan"), "at most", 1e-8, "s")], pictures=[picture])
    made = claims_page.as_html([claim], {"cpu": "<b>"})
    checker = Reader()
    checker.feed(made)
    assert checker.open == []
    assert "x<sub>min</sub> &lt; y<sup>2</sup> &amp; z" in made
    assert "a &lt; b &amp; &#x27;c&#x27;" in made
    assert 'alt="with &quot;quotes&quot; &amp; &lt;tags&gt;"' in made
    assert "not defined" in made
    assert "<dd>&lt;b&gt;</dd>" in made


def test_a_test_names_every_setting():
    values = {"first": (0.5, 0.4, 0.6), "second": (0.2,) * 3, "third": (0.3,) * 3}
    nothing = Estimate(float("nan"), float("nan"), float("nan"), 0)
    checks = [
        *(
            Check("share", Estimate(*v), "at least", 0.9, setting=Setting(s))
            for s, v in values.items()
        ),
        Check("share", nothing, "at least", 0.9, setting=Setting("fourth")),
    ]
    made = claims_page.as_html([made_up(checks)], {})
    assert (
        "share: <b>0.5 (0.4 to 0.6)</b>, bound at least 0.9<br>"
        "<small>second: 0.2; third: 0.3; fourth: no case</small>" in made
    )


@pytest.mark.parametrize(
    ("value", "units", "shown"),
    [
        (0.0, "1", "0"),
        (1.22625, "m", "1.226 m"),
        (14000.0, "1", "14000"),
        (-2.5, "m s-1", "\N{MINUS SIGN}2.5 m s<sup>\N{MINUS SIGN}1</sup>"),
        (1e-8, "s", "10<sup>\N{MINUS SIGN}8</sup> s"),
        (3.25e7, "1", "3.25 \N{MULTIPLICATION SIGN} 10<sup>7</sup>"),
        (float("inf"), "s", "infinite"),
    ],
)
def test_numbers_are_written_for_people(value, units, shown):
    assert claims_page.quantity(value, units) == shown


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
    assert claims_page.marked_up(text) == shown


def test_the_ranges_of_samples_are_named_and_said_to_be_this_packages():
    """The study states no ranges: no share over random realizations may read as if it did."""
    words = texts()["samples"]
    (low, high), (least, most) = RANGES.values()
    assert f"e from {low:.2f} to {high:.2f} and A from {least} to {most} m/s" in words
    assert FIRST.name == f"e {low:.2f} to {high:.2f}, A {least} to {most} m/s"
    assert "This package takes" in words
    assert "does not say in which ranges" in words
