"""The result of one check."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """The result of one check."""

    subject: str
    state: str
    trouble: str = ""  # the trouble and its remedy; empty if there is none

    def lines(self) -> Iterator[str]:
        """Yield the finding as lines of text."""
        yield f"{self.subject:20}{self.state}"
        if self.trouble:
            yield f"{'':20}WRONG: {self.trouble}"
