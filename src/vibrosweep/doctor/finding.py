"""One thing that was looked at."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

__all__ = ["Finding"]


@dataclass(frozen=True)
class Finding:
    """What was found.

    Attributes
    ----------
    subject
        What was looked at.
    state
        How it is.
    trouble
        What is wrong with it and how to mend it; empty if nothing is.
    """

    subject: str
    state: str
    trouble: str = ""

    def lines(self) -> Iterator[str]:
        """Give the finding as text."""
        yield f"{self.subject:20}{self.state}"
        if self.trouble:
            yield f"{'':20}WRONG: {self.trouble}"
