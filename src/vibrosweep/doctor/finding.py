"""The result of one check."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """The result of one check.

    Attributes
    ----------
    subject
        What was checked.
    state
        The state that was found.
    trouble
        What is wrong and how to fix it; empty if nothing is.
    """

    subject: str
    state: str
    trouble: str = ""

    def lines(self) -> Iterator[str]:
        """Give the finding as text."""
        yield f"{self.subject:20}{self.state}"
        if self.trouble:
            yield f"{'':20}WRONG: {self.trouble}"
