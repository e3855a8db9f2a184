"""The result of one check."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """The result of one check."""

    subject: str  # what was checked
    state: str  # the state that was found
    trouble: str = ""  # what is wrong and how to fix it; empty if nothing is

    def lines(self) -> Iterator[str]:
        """Give the finding as text."""
        yield f"{self.subject:20}{self.state}"
        if self.trouble:
            yield f"{'':20}WRONG: {self.trouble}"
