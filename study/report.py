"""The claims as files: one self-contained HTML page, JSON, and pictures."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from study.bases import HIGH_BOUNCE
from study.claims_page import as_html, plain
from study.texts import texts
from study.verdict import Check, Claim, Evidence, Number, Reading
from vibrosweep import sweep
from vibrosweep.errors import OutputError

ORIGIN: Final = ("source", "created", "libraries", "python", "cpu", "threads", "git_revision")


def write(
    claims: Sequence[Claim],
    directory: Path,
    origin: Mapping[str, str],
    *,
    state: Sequence[str] = (),
    pictures: bool = False,
) -> list[Path]:
    """Write the page, the JSON file and, on request, the pictures as files; return their paths.

    The directory is made if it does not exist; files of the same name are replaced; `origin` is
    the result of `provenance`, and `state` says in sentences what is not shown.  Raises an
    OutputError if something cannot be written.
    """
    contents: dict[str, bytes] = {
        "claims.html": as_html(claims, origin, state).encode(),
        "claims.json": as_json(claims, origin, state).encode(),
    }
    if pictures:
        shown = [picture for claim in claims for picture in claim.outcome.pictures]
        contents |= {f"{picture.name}.png": picture.png for picture in shown}
    return _replace_all(directory, contents)


def provenance(threads: int | None) -> dict[str, str]:
    """Program, libraries, machine and time, as a sweep on these threads records them."""
    found = sweep(threads=threads, progress=False).attrs
    return {name: str(found[name]) for name in ORIGIN if name in found}


def prepare(directory: Path) -> None:
    """Make the directory of the claims before anything is computed, or raise an OutputError."""
    with _writing(directory):
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            pass


def _replace_all(directory: Path, contents: Mapping[str, bytes]) -> list[Path]:
    """Write all files under other names and then rename them, so that none is ever incomplete."""
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
            f"directory (-o), or free this path"
        ) from error


def as_json(claims: Sequence[Claim], origin: Mapping[str, str], state: Sequence[str] = ()) -> str:
    """Return all but the figures as JSON; runs of one version differ only in the provenance."""
    words = texts()
    document = {
        **{name: words[name] for name in ("rule", "samples", "bases")},
        "state": list(state),
        "claims": [_claim_data(claim) for claim in claims],
        "provenance": dict(origin),
    }
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _claim_data(claim: Claim) -> dict[str, Any]:
    return {
        "number": claim.key,
        "source": claim.source,
        "claim": plain(claim.sentence),
        "method": plain(claim.method),
        "reason": plain(claim.reason),
        "evidence": [_evidence_data(one) for one in claim.outcome.evidence],
        "figures": [picture.name for picture in claim.outcome.pictures],
    }


def _evidence_data(evidence: Evidence) -> dict[str, Any]:
    return {
        "base": evidence.base,
        "verdict": evidence.verdict.value,
        "reason": evidence.reason,
        "readings": [_reading_data(evidence, one) for one in evidence.readings],
        "conditions": [_reading_data(evidence, one) for one in evidence.conditions],
        "numbers": [_number_data(evidence, one) for one in evidence.numbers],
        "not_computed": list(evidence.not_computed),
    }


def _reading_data(evidence: Evidence, reading: Reading) -> dict[str, Any]:
    return {
        "name": reading.name,
        "passed": reading.passed,
        "reason": reading.reason,
        "tests": [
            {
                **_number_data(evidence, one),
                "relation": one.relation,
                "bound": one.bound,
                "passed": one.passed,
            }
            for one in reading.checks
        ],
    }


def _number_data(evidence: Evidence, one: Check | Number) -> dict[str, Any]:
    """A number with base, law, ranges and null model; JSON knows no NaN and no infinity."""
    setting, value = one.setting or evidence.setting, one.value
    ends = {"value": value.value, "low": value.low, "high": value.high}
    given = {**setting.ranges, **setting.constants}
    return {
        "what": plain(one.what),
        **{name: float(end) if math.isfinite(end) else None for name, end in ends.items()},
        "units": one.units,
        "cases": value.cases,
        "base": evidence.base,
        "law": setting.law if evidence.base == HIGH_BOUNCE else None,
        "setting": setting.name,
        "range": {name: given[name] for name in given if name != "rebound"},
        "null_model": setting.null_model or None,
    }
