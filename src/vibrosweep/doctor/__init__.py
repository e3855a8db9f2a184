"""Checks of `vibrosweep doctor`: libraries, processor, kernels, disk and memory."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import vibrosweep.kernels  # noqa: F401  (before numba: it reads the environment)


class Finding(NamedTuple):
    """The result of one check."""

    subject: str
    state: str
    trouble: str = ""  # the trouble and its remedy; empty if there is none

    def lines(self) -> Iterator[str]:
        """Yield the finding as lines of text."""
        yield f"{self.subject:20}{self.state}"
        if self.trouble:
            yield f"{'':20}WRONG: {self.trouble}"
