"""Text of a sweep file with given tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vibrosweep.mistakes import toml
from vibrosweep.scene.keys import SECTIONS


def text_of(data: Mapping[str, Any]) -> str:
    """Return the text of a sweep file that holds a title and tables."""
    lines = [f"title = {toml(data['title'])}"]
    for section in SECTIONS:
        if section in data:
            lines += [f"[{section}]", *(f"{key} = {toml(v)}" for key, v in data[section].items())]
    return "\n".join(lines) + "\n"
