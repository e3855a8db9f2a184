"""What an index shows of the package: names, addresses, and a README whose links work there."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

PICTURE = re.compile(r"!\[([^\]]*)\]\(([^)]+)\)\n?")
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((?!https?:|#)([^)]+)\)")


class Hook(MetadataHookInterface):
    """Sets `authors`, `urls` and `readme` from MAINTAINERS.toml."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set the three fields."""
        root = Path(self.root)
        given = tomllib.loads((root / "MAINTAINERS.toml").read_text(encoding="utf-8"))
        addresses = given["addresses"]
        metadata["authors"] = [
            {key: one[key] for key in ("name", "email") if one.get(key)} for one in given["authors"]
        ]
        named = ("source", "documentation", "changelog", "issues")
        metadata["urls"] = {name.title(): addresses[name] for name in named if addresses.get(name)}
        text = (root / "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {
            "content-type": "text/markdown",
            "text": described(text, addresses.get("files", "")),
        }


def described(readme: str, files: str) -> str:
    """Return the README with links to files of the repository that work elsewhere.

    Parameters
    ----------
    readme
        Its text.
    files
        Address below which the files can be read.  If empty, pictures are left out, and of links
        the text remains.
    """
    if not files:
        return LINK.sub(r"\1", PICTURE.sub("", readme))
    base = files.rstrip("/")
    return LINK.sub(rf"[\1]({base}/\2)", PICTURE.sub(rf"![\1]({base}/\2)\n", readme))
