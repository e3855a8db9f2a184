"""The result of one check."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """The result of one check."""

    subject: str  # the subject of the check
    state: str  # the state that was found
    trouble: str = ""  # the trouble and its remedy; empty if there is none

    def lines(self) -> Iterator[str]:
        """Give the finding as text."""
        yield f"{self.subject:20}{self.state}"
        if self.trouble:
            yield f"{'':20}WRONG: {self.trouble}"
