"""What an index shows of the package: addresses, and a README whose links work there."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

PICTURE = re.compile(r"!\[([^\]]*)\]\(([^)]+)\)\n?")
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((?!https?:|#)([^)]+)\)")


class Hook(MetadataHookInterface):
    """Sets `urls` and `readme` from the addresses in pyproject.toml."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set the two fields."""
        named = ("source", "documentation", "changelog", "issues")
        metadata["urls"] = {
            name.title(): self.config[name] for name in named if self.config.get(name)
        }
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {
            "content-type": "text/markdown",
            "text": described(text, self.config.get("files", "")),
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
