"""The claims as one self-contained HTML page."""

from __future__ import annotations

import base64
import html
import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from string import Template
from typing import Final

from study.bases import HIGH_BOUNCE, MOVING, SPRUNG
from study.estimates import Estimate
from study.texts import texts
from study.verdict import (
    ANY_BASE,
    Check,
    Claim,
    Evidence,
    Number,
    Picture,
    Reading,
    Verdict,
)

BASES: Final = {
    HIGH_BOUNCE: "study's equations",
    MOVING: "moving base",
    SPRUNG: "base of finite mass",
}
CLASSES: Final = {
    Verdict.HOLDS: "holds",
    Verdict.CONDITIONAL: "condition",
    Verdict.OUTSIDE: "outside",
    Verdict.FAILS: "fails",
    Verdict.UNDECIDED: "open",
}
MARKS: Final = {True: ("holds", "passed"), False: ("fails", "missed"), None: ("open", "open")}
NO_VERDICT: Final = "<small>not computed</small>"
KINDS: Final = {
    "drive_noise": "noise of the drive",
    "kick_noise": "noise of the kick",
    "restitution_noise": "noise of the restitution",
}
# heights of flights, which the list of tests gives
AT_HEIGHT: Final = re.compile(r" \(at 1 Hz, flights .*?\)")
MINUS: Final = "\N{MINUS SIGN}"


def as_html(claims: Sequence[Claim], origin: Mapping[str, str], state: Sequence[str] = ()) -> str:
    """The page, with its style and figures inside; `state` says what it does not show."""
    words = texts()
    page = files("study")
    template = Template(page.joinpath("page.html").read_text(encoding="utf-8"))
    shown = in_order(claims)
    return template.substitute(
        style=page.joinpath("page.css").read_text(encoding="utf-8"),
        **{name: marked_up(words[name]) for name in ("rule", "samples", "bases", "reply")},
        state="".join(f'<p class="state">{html.escape(line)}</p>' for line in state),
        short="".join(f"<p>{marked_up(text)}</p>" for text in (words["summary"], words["lesson"])),
        counts="".join(f"<li>{line}</li>" for line in _counts(shown)),
        heads="".join(f"<th>{html.escape(name)}</th>" for name in BASES.values()),
        summary="\n".join(_summary_row(claim) for claim in shown),
        claims="\n".join(_section(claim) for claim in shown),
        origin="\n".join(
            f"<dt>{html.escape(name.replace('_', ' '))}</dt><dd>{html.escape(value)}</dd>"
            for name, value in origin.items()
        ),
    )


def in_order(claims: Sequence[Claim]) -> list[Claim]:
    """Claims about the dynamics first, then those about apparatus and scheme."""
    return sorted(claims, key=lambda claim: claim.incidental)


def _counts(claims: Sequence[Claim]) -> Iterator[str]:
    """How many of the claims about the dynamics get each verdict, for every base."""
    for base, name in BASES.items():
        found = Counter(
            one.verdict
            for claim in claims
            if not claim.incidental
            for one in claim.outcome.evidence
            if one.base == base
        )
        each = [
            f"{n} {_in_number(verdict.value, n)}" for verdict in Verdict if (n := found[verdict])
        ]
        if each:
            yield f"<b>{name.capitalize()}</b>, {found.total()} claims: {', '.join(each)}."


def _in_number(verb: str, number: int) -> str:
    return verb if number == 1 else verb.replace("holds", "hold").replace("fails", "fail")


def plain(text: str) -> str:
    """A text without the braces of its subscripts and superscripts."""
    return re.sub(r"([_^])\{([^}]*)\}", r"\1\2", text)


def marked_up(text: str) -> str:
    """HTML of a text: x_y and x_{yz} become subscripts, x^2 and x^{yz} superscripts."""
    safe = html.escape(text).replace("tau_c", "τ_c")
    safe = re.sub(r"\b(dt|A|v)_(min|max|rest)\b", r"\1_{\2}", safe)
    for sign, tag, before in (("_", "sub", r"(\w)"), (r"\^", "sup", r"(\w|\))")):
        safe = re.sub(rf"{before}{sign}(\w)(?!\w)", rf"\1<{tag}>\2</{tag}>", safe)
        safe = re.sub(rf"{sign}\{{([^}}]*)\}}", rf"<{tag}>\1</{tag}>", safe)
    return safe.replace("t_∞", "t<sub>∞</sub>")


def _badge(verdict: Verdict) -> str:
    return f'<span class="badge {CLASSES[verdict]}">{verdict.value}</span>'


def brief_reason(evidence: Evidence) -> str:
    """Reason why a claim cannot be judged, with the settings that differ from most others."""
    if evidence.verdict is not Verdict.UNDECIDED:
        return ""
    readings = (*evidence.readings, *evidence.conditions)
    unlike = dict.fromkeys(name for one in readings for name in one.unlike)
    return f"settings differ ({' / '.join(unlike)})" if unlike else "too few data"


def _summary_row(claim: Claim) -> str:
    found = {
        one.base: f"{_badge(one.verdict)} <small>{marked_up(brief_reason(one))}</small>"
        for one in claim.outcome.evidence
    }
    if ANY_BASE in found:
        cells = f'<td colspan="{len(BASES)}" data-base="no base enters">{found[ANY_BASE]}</td>'
    else:
        cells = "".join(
            f'<td data-base="{html.escape(name)}">{found.get(base, NO_VERDICT)}</td>'
            for base, name in BASES.items()
        )
    link = f'<a href="#claim-{claim.key}">{claim.key}</a>'
    kind = ' class="incidental"' if claim.incidental else ""
    return f'<tr{kind}><th scope="row">{link} {marked_up(claim.sentence)}</th>{cells}</tr>'


def _section(claim: Claim) -> str:
    found = {one.base for one in claim.outcome.evidence}
    absent = (
        [] if ANY_BASE in found else [name for base, name in BASES.items() if base not in found]
    )
    if absent:
        why = f": {marked_up(claim.absent)}" if claim.absent else ""
        absent = [f"<li>Not computed on the {html.escape(' and the '.join(absent))}{why}.</li>"]
    holds = "; or ".join(dict.fromkeys(AT_HEIGHT.sub("", one) for one in claim.conditions))
    return "\n".join(
        [
            f'<section class="claim" id="claim-{claim.key}">',
            f"<h2><span>{claim.key}</span> {marked_up(claim.sentence)}</h2>",
            f'<p class="source">{html.escape(claim.source)}</p>',
            f'<ul class="verdicts">{"".join([*_verdicts(claim), *absent])}</ul>',
            *([f"<p><b>Holds if</b> {marked_up(holds)}.</p>"] if holds else []),
            f"<p><b>Why.</b> {marked_up(claim.reason)}</p>",
            *(_figure(picture) for picture in claim.outcome.pictures),
            "<details><summary>How it was tested, and all numbers</summary>",
            f"<p>{marked_up(claim.method)}</p>",
            *(_evidence(one) for one in claim.outcome.evidence),
            "</details>",
            "</section>",
        ]
    )


def _verdicts(claim: Claim) -> Iterator[str]:
    """The verdict on each base, with the number that decides it; a test is named once."""
    named = ""
    for evidence in claim.outcome.evidence:
        test = evidence.decisive
        found = _estimate(test.value, test.units)
        what = f"{test.what} {test.relation} {test.bound}"
        bound = quantity(test.bound, test.units)
        whole = f"{marked_up(test.what)} {found}, {test.relation} {bound} required"
        why = marked_up(brief_reason(evidence))
        shown = why or (f"here {found}" if what == named else whole)
        named = named if why else what
        base = BASES.get(evidence.base, "any base").capitalize()
        badge = _badge(evidence.verdict)
        yield f"<li>{html.escape(base)}: {badge} <small>{shown}</small></li>"


def _evidence(evidence: Evidence) -> str:
    name = BASES.get(evidence.base, "any base").capitalize()
    parts = [f"<h3>{html.escape(name)}</h3>"]
    if evidence.reason:
        parts.append(f'<p class="reason">{marked_up(evidence.reason)}</p>')
    parts += [
        f'<p class="reason">Not computed: {html.escape(in_words(one))}</p>'
        for one in evidence.not_computed
    ]
    for title, readings in (("read as", evidence.readings), ("condition", evidence.conditions)):
        parts += [_reading(title, one) for one in readings]
    if evidence.numbers:
        items = "".join(f"<li>{_number(one)}</li>" for one in evidence.numbers)
        parts.append(f"<p>Further numbers:</p><ul>{items}</ul>")
    return "\n".join(parts)


def in_words(refusal: str) -> str:
    """A refusal of the package, without the names of its keywords."""
    key, _, rest = refusal.partition(": ")
    why = rest.rpartition(": ")[2].partition(";")[0]
    return f"{KINDS.get(key, key)}, because {why}"


def _reading(title: str, reading: Reading) -> str:
    mark, word = MARKS[reading.passed]
    tests: dict[str, list[Check]] = {}
    for one in reading.checks:
        tests.setdefault(one.what + one.relation, []).append(one)
    items = "".join(f"<li>{_test(each)}</li>" for each in tests.values())
    return (
        f'<div class="reading"><p><span class="mark {mark}">{word}</span> '
        f"<i>{title}:</i> {marked_up(reading.name)}</p><ul>{items}</ul></div>"
    )


def _test(checks: Sequence[Check]) -> str:
    """One test in a line: in the first setting, with its range over the others."""
    first = checks[0]
    text = (
        f"{marked_up(first.what)}: <b>{_estimate(first.value, first.units)}</b>{_of(first.value)}, "
        f"bound {first.relation} {quantity(first.bound, first.units)}"
    )
    others = [
        f"{marked_up(one.setting.name if one.setting else '')}: "
        f"{quantity(one.value.value, one.units, 3) if one.value.cases != 0 else 'no case'}"
        for one in checks[1:]
    ]
    return f"{text}<br><small>{'; '.join(others)}</small>" if others else text


def _of(value: Estimate) -> str:
    return f" of {value.cases}" if value.cases else ""


def _number(one: Number) -> str:
    return f"{marked_up(one.what)}: <b>{_estimate(one.value, one.units)}</b>"


def _estimate(estimate: Estimate, units: str) -> str:
    if estimate.low == estimate.high or math.isnan(estimate.low):
        return quantity(estimate.value, units)
    low, high = (quantity(end, "1", 3) for end in (estimate.low, estimate.high))
    if math.isinf(estimate.high):
        return quantity(estimate.value, units)
    if math.isnan(estimate.value):
        return f"between {low} and {quantity(estimate.high, units, 3)}"
    return f"{quantity(estimate.value, units, 3)} ({low} to {high})"


def quantity(value: float, units: str, digits: int = 4) -> str:
    """A number with its unit, as HTML, with powers of ten written out."""
    if not math.isfinite(value):
        return "not defined" if math.isnan(value) else "infinite"
    text = f"{value:.{digits}g}"
    if abs(value) >= 1000 and float(value).is_integer() and abs(value) < 1e6:
        text = f"{value:.0f}"
    if "e" in text:
        mantissa, exponent = text.split("e")
        factor = "" if mantissa == "1" else f"{mantissa} \N{MULTIPLICATION SIGN} "
        text = f"{factor}10<sup>{int(exponent)}</sup>"
    text = text.replace("-", MINUS)
    unit = re.sub(r"(?<=[a-z])(-?\d)", r"<sup>\1</sup>", html.escape(units)).replace("-", MINUS)
    return text if units == "1" else f"{text} {unit}"


def _figure(picture: Picture) -> str:
    data = base64.b64encode(picture.svg.encode()).decode()
    return (
        f'<figure><img alt="{html.escape(picture.caption)}" '
        f'src="data:image/svg+xml;base64,{data}">'
        f"<figcaption>{marked_up(picture.caption)}</figcaption></figure>"
    )
