"""A claim, the numbers it is tested by, and the one rule by which they give a verdict.

The words of the rule and of the claims stand in ``texts.toml``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Literal

from matplotlib.figure import Figure

__all__ = ["Check", "Claim", "Number", "Outcome", "Picture", "Relation", "Verdict"]

Relation = Literal["at most", "at least"]


class Verdict(Enum):
    """What the numbers say."""

    HOLDS = "holds"
    CONDITIONAL = "holds under a stated condition"
    FAILS = "fails"


@dataclass(frozen=True)
class Number:
    """A computed number that informs, but is not part of a test."""

    what: str
    value: float
    units: str = "1"


@dataclass(frozen=True)
class Check:
    """A computed number and the bound that it is held against.

    Attributes
    ----------
    what
        What the number is, in words.
    value
        As computed.
    relation
        ``"at most"`` or ``"at least"``.
    bound
        In the same unit.
    units
        As in CF; ``"1"`` for a pure number.
    """

    what: str
    value: float
    relation: Relation
    bound: float
    units: str = "1"

    @property
    def passed(self) -> bool:
        """Whether the number is on the right side of its bound; NaN is on neither."""
        if math.isnan(self.value):
            return False
        return self.value <= self.bound if self.relation == "at most" else self.value >= self.bound


@dataclass(frozen=True)
class Picture:
    """A figure with its name in files, and what is to be seen on it."""

    name: str
    caption: str
    figure: Figure


@dataclass(frozen=True)
class Outcome:
    """What was computed for one claim.

    Attributes
    ----------
    as_stated
        Tests of the claim as the study states it, at least one.
    conditional
        Tests under the condition that the text of the claim states.
    numbers
        What else was computed.
    pictures
        Figures.
    """

    as_stated: Sequence[Check]
    conditional: Sequence[Check] = ()
    numbers: Sequence[Number] = ()
    pictures: Sequence[Picture] = ()

    @property
    def verdict(self) -> Verdict:
        """The verdict, by the rule that the page states."""
        if all(test.passed for test in self.as_stated):
            return Verdict.HOLDS
        if self.conditional and all(test.passed for test in self.conditional):
            return Verdict.CONDITIONAL
        return Verdict.FAILS


@dataclass(frozen=True)
class Claim:
    """One claim of the study: its words, and what was computed.

    Attributes
    ----------
    number, source
        Number in the list of claims; section, equation or figure of the study.
    sentence
        The claim.
    method
        How it was tested.
    condition
        Under which it was tested again; empty if it was not.
    reason
        The physics behind the outcome.
    outcome
        What was computed.
    """

    number: int
    source: str
    sentence: str
    method: str
    condition: str
    reason: str
    outcome: Outcome
