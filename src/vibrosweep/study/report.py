"""The claims as one HTML page that needs nothing else, and as JSON."""

from __future__ import annotations

import base64
import html
import io
import json
import math
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from string import Template
from typing import Any, Final

import matplotlib as mpl

from vibrosweep.errors import OutputError
from vibrosweep.figures import style
from vibrosweep.store.provenance import provenance
from vibrosweep.study.collect import texts
from vibrosweep.study.verdict import Check, Claim, Number, Picture, Verdict

__all__ = ["as_html", "as_json", "plain", "prepare", "write"]

CLASSES: Final = {
    Verdict.HOLDS: "holds",
    Verdict.CONDITIONAL: "condition",
    Verdict.FAILS: "fails",
}
PASSED: Final = '<td class="pass">passed</td>'
MISSED: Final = '<td class="miss">missed</td>'
DOTS_PER_INCH: Final = 150
MINUS: Final = "\N{MINUS SIGN}"
# Glyphs as outlines: the page looks the same wherever it is opened; a fixed salt gives the same
# names to the same clip paths in every run.
SVG: Final[dict[Any, Any]] = {**style.RC, "svg.fonttype": "path", "svg.hashsalt": "vibrosweep"}
NO_DATE: Final = {"Date": None, "Creator": None}


def write(
    claims: Sequence[Claim], directory: Path, threads: int, *, pictures: bool = False
) -> list[Path]:
    """Write the page and the JSON file, and the pictures as files where asked for.

    Parameters
    ----------
    claims
        What was judged.
    directory
        Where to; made if it does not exist.  Files of the same name are replaced.
    threads
        Stated among the provenance.
    pictures
        Write every figure as a PNG file too.

    Returns
    -------
    list of pathlib.Path
        The files written.

    Raises
    ------
    OutputError
        The directory or a file cannot be written.
    """
    origin = {
        name: str(value) for name, value in provenance(threads).items() if name != "Conventions"
    }
    contents: dict[str, bytes] = {
        "claims.html": as_html(claims, origin).encode(),
        "claims.json": as_json(claims, origin).encode(),
    }
    if pictures:
        shown = [picture for claim in claims for picture in claim.outcome.pictures]
        contents |= {f"{picture.name}.png": _png(picture) for picture in shown}
    return _replace_all(directory, contents)


def prepare(directory: Path) -> None:
    """Make the directory that the claims go to, before anything is computed.

    Raises
    ------
    OutputError
        It cannot be made or written.
    """
    with _writing(directory):
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass


def _replace_all(directory: Path, contents: Mapping[str, bytes]) -> list[Path]:
    """Write all files under other names and then rename them: none is ever half written."""
    prepare(directory)
    with _writing(directory), tempfile.TemporaryDirectory(dir=directory, prefix=".claims-") as room:
        for name, content in contents.items():
            Path(room, name).write_bytes(content)
        return [Path(room, name).replace(directory / name) for name in contents]


@contextmanager
def _writing(directory: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"cannot write the claims into {directory} ({error.strerror}): choose another "
            f"directory with output=, or free this path"
        ) from error


def as_json(claims: Sequence[Claim], origin: Mapping[str, str]) -> str:
    """Everything but the figures; the same version gives the same text but for the provenance."""
    document = {
        "rule": texts()["rule"],
        "claims": [_claim_data(claim) for claim in claims],
        "provenance": dict(origin),
    }
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _claim_data(claim: Claim) -> dict[str, Any]:
    outcome = claim.outcome
    return {
        "number": claim.number,
        "source": claim.source,
        "claim": plain(claim.sentence),
        "method": plain(claim.method),
        "verdict": outcome.verdict.value,
        "tests_as_stated": [_test_data(test) for test in outcome.as_stated],
        "condition": claim.condition,
        "tests_under_condition": [_test_data(test) for test in outcome.conditional],
        "reason": plain(claim.reason),
        "numbers": [
            {"what": n.what, "value": _json_number(n.value), "units": n.units}
            for n in outcome.numbers
        ],
        "figures": [picture.name for picture in outcome.pictures],
    }


def _test_data(test: Check) -> dict[str, Any]:
    return {
        "what": test.what,
        "value": _json_number(test.value),
        "relation": test.relation,
        "bound": test.bound,
        "units": test.units,
        "passed": test.passed,
    }


def _json_number(value: float) -> float | None:
    """JSON knows no NaN and no infinity."""
    return value if math.isfinite(value) else None


def as_html(claims: Sequence[Claim], origin: Mapping[str, str]) -> str:
    """The page, with its style and figures inside."""
    words = texts()
    page = files("vibrosweep.study")
    template = Template(page.joinpath("page.html").read_text(encoding="utf-8"))
    counts = [sum(c.outcome.verdict is verdict for c in claims) for verdict in Verdict]
    return template.substitute(
        style=page.joinpath("page.css").read_text(encoding="utf-8"),
        rule=marked_up(words["rule"]),
        model=marked_up(words["model"]),
        tally="\n".join(
            f'<li class="{CLASSES[verdict]}">{verdict.value}: <strong>{count}</strong></li>'
            for verdict, count in zip(Verdict, counts, strict=True)
            if count
        ),
        summary="\n".join(_summary_row(claim) for claim in claims),
        claims="\n".join(_section(claim) for claim in claims),
        origin="\n".join(
            f"<dt>{html.escape(name.replace('_', ' '))}</dt><dd>{html.escape(value)}</dd>"
            for name, value in origin.items()
        ),
    )


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


def _summary_row(claim: Claim) -> str:
    return (
        f'<tr><td class="number"><a href="#claim-{claim.number}">{claim.number}</a></td>'
        f"<td>{marked_up(claim.sentence)}</td><td>{_badge(claim.outcome.verdict)}</td></tr>"
    )


def _section(claim: Claim) -> str:
    outcome = claim.outcome
    parts = [
        f'<section class="claim" id="claim-{claim.number}">',
        f"<header><h2><span>{claim.number}</span> {marked_up(claim.sentence)}</h2>",
        f'<p class="source">{html.escape(claim.source)} {_badge(outcome.verdict)}</p></header>',
        f"<p><b>Tested.</b> {marked_up(claim.method)}</p>",
    ]
    parts.append(_tests("As stated", outcome.as_stated))
    if outcome.conditional:
        parts.append(_tests(f"Condition: {claim.condition}", outcome.conditional))
    parts.append(f"<p><b>Why.</b> {marked_up(claim.reason)}</p>")
    if outcome.numbers:
        parts.append(_numbers(outcome.numbers))
    parts += [_figure(picture) for picture in outcome.pictures]
    return "\n".join([*parts, "</section>"])


def _tests(title: str, tests: Sequence[Check]) -> str:
    rows = "\n".join(
        f"<tr>{PASSED if t.passed else MISSED}"
        f'<td>{marked_up(t.what)}</td><td class="value">{quantity(t.value, t.units)}</td>'
        f'<td class="value">{t.relation} {quantity(t.bound, t.units)}</td></tr>'
        for t in tests
    )
    return (
        f'<h3 class="tests">{marked_up(title)}</h3><div class="scroll" tabindex="0"><table>'
        f"<thead><tr><th>test</th><th>number</th><th>computed</th><th>bound</th></tr></thead>"
        f"<tbody>{rows}</tbody></table></div>"
    )


def _numbers(numbers: Sequence[Number]) -> str:
    rows = "\n".join(
        f'<tr><td>{marked_up(n.what)}</td><td class="value">{quantity(n.value, n.units)}</td></tr>'
        for n in numbers
    )
    return (
        f"<details open><summary>Further numbers</summary>"
        f'<div class="scroll" tabindex="0"><table><tbody>{rows}</tbody></table></div></details>'
    )


def quantity(value: float, units: str) -> str:
    """A number with its unit, as HTML: five digits, powers of ten written out."""
    if not math.isfinite(value):
        return "not defined" if math.isnan(value) else "infinite"
    text = f"{value:.5g}"
    if "e" in text:
        digits, exponent = text.split("e")
        factor = "" if digits == "1" else f"{digits} \N{MULTIPLICATION SIGN} "
        text = f"{factor}10<sup>{int(exponent)}</sup>"
    text = text.replace("-", MINUS)
    unit = re.sub(r"(?<=[a-z])(-?\d)", r"<sup>\1</sup>", html.escape(units)).replace("-", MINUS)
    return text if units == "1" else f"{text} {unit}"


def _figure(picture: Picture) -> str:
    with io.StringIO() as text, mpl.rc_context(SVG):
        picture.figure.savefig(text, format="svg", metadata=dict(NO_DATE))
        data = base64.b64encode(text.getvalue().encode()).decode()
    caption = marked_up(picture.caption)
    wide = ' class="wide"' if picture.figure.get_figwidth() > style.MEDIUM else ""
    return (
        f'<figure{wide}><div class="scroll" tabindex="0"><img alt="{html.escape(picture.caption)}" '
        f'src="data:image/svg+xml;base64,{data}"></div><figcaption>{caption}</figcaption></figure>'
    )


def _png(picture: Picture) -> bytes:
    with io.BytesIO() as data, mpl.rc_context(style.RC):
        picture.figure.savefig(data, format="png", dpi=DOTS_PER_INCH, metadata={"Software": None})
        return data.getvalue()
