"""The words of the page, from ``texts.toml``."""

from __future__ import annotations

import io
import tomllib
from collections.abc import Mapping
from importlib.resources import files
from typing import Any, Final

import matplotlib as mpl
from matplotlib.figure import Figure

from study.verdict import Picture
from vibrosweep.figures import style

# Glyphs as outlines: the page looks the same wherever it is opened; a fixed salt gives the same
# names to the same clip paths in every run.
SVG: Final[dict[Any, Any]] = {**style.RC, "svg.fonttype": "path", "svg.hashsalt": "vibrosweep"}
NO_DATE: Final[dict[str, Any]] = {"Date": None, "Creator": None}
DOTS_PER_INCH: Final = 150


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
    """Figures by file name, drawn, with their captions."""
    captions = texts()["captions"]
    return [drawn(name, captions[name], figure) for name, figure in figures.items()]


def drawn(name: str, caption: str, figure: Figure) -> Picture:
    """Draw a figure for the page and as a file."""
    with io.StringIO() as text, io.BytesIO() as data, mpl.rc_context(SVG):
        figure.savefig(text, format="svg", metadata=NO_DATE)
        figure.savefig(data, format="png", dpi=DOTS_PER_INCH, metadata={"Software": None})
        return Picture(name, caption, text.getvalue(), data.getvalue())


def _in_one_line(words: Mapping[str, Any]) -> dict[str, Any]:
    """Texts in one line each; what is no text stays."""
    return {k: " ".join(v.split()) if isinstance(v, str) else v for k, v in words.items()}
