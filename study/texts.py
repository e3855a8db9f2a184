"""The words of the page, from ``texts.toml``."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

from matplotlib.figure import Figure

from study.verdict import Picture


def texts() -> dict[str, Any]:
    """The words of the page; each text is one line."""
    found = tomllib.loads(files("study").joinpath("texts.toml").read_text(encoding="utf-8"))
    claims, captions = found.pop("claim"), found.pop("caption")
    return {
        **_in_one_line(found),
        "claims": {key: _in_one_line(words) for key, words in claims.items()},
        "captions": _in_one_line(captions),
    }


def pictures(figures: Mapping[str, Figure]) -> list[Picture]:
    """Figures by file name, with their captions."""
    captions = texts()["captions"]
    return [Picture(name, captions[name], figure) for name, figure in figures.items()]


def _in_one_line(words: Mapping[str, Any]) -> dict[str, Any]:
    """Texts in one line each; what is no text stays."""
    return {k: " ".join(v.split()) if isinstance(v, str) else v for k, v in words.items()}
