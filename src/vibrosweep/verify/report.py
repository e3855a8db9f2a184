"""What a verification found: per variable, per realization, and as a table."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

import numpy as np

from vibrosweep.verify.judgement import Judgement
from vibrosweep.verify.sample import VARIABLES

__all__ = ["Outcome", "Report", "State", "VariableReport"]

COMPLAINTS_SHOWN: Final = 20


class State(Enum):
    """How far a realization could be compared; the value is a sentence about several."""

    COMPARED = "compared"
    NO_CLAIM = "claim nothing: rounding may have changed a decision"
    NOT_COMPLETED = "were not completed by the run, as their status says"
    TOO_LONG = "were left out: more landings than --max-landings, raise it to include them"
    UNDECIDED = "could not be decided by the reference (an exact tie, or too chaotic)"


@dataclass(frozen=True)
class Outcome:
    """What became of one realization."""

    realization: int
    state: State
    landings: int = 0
    judgements: Sequence[Judgement] = ()


@dataclass
class VariableReport:
    """All comparisons of one variable.

    Attributes
    ----------
    errors, claims, digits
        Of each number compared; digits only where they are defined.
    outside
        Realizations with a number outside its claim.
    undecided
        Realizations with a number about which nothing is claimed.
    """

    errors: list[float] = field(default_factory=list)
    claims: list[float] = field(default_factory=list)
    digits: list[float] = field(default_factory=list)
    outside: set[int] = field(default_factory=set)
    undecided: set[int] = field(default_factory=set)

    def add(self, realization: int, judgement: Judgement) -> None:
        """Add one comparison."""
        if judgement.complaint:
            self.outside.add(realization)
        if judgement.claim is None:
            if not judgement.complaint:
                self.undecided.add(realization)
            return
        self.errors.append(judgement.error)
        self.claims.append(judgement.claim)
        if judgement.digits is not None:
            self.digits.append(judgement.digits)

    def line(self, name: str) -> str:
        """Row of the table."""
        variable = VARIABLES[name]
        exact = bool(variable.flags) or variable.dtype == "int64"
        label = name if variable.units == "1" else f"{name} ({variable.units})"
        known = [error for error in self.errors if not math.isnan(error)]
        cells = [
            f"{max(known):.3g}" if known else "-",
            f"{float(np.median(known)):.3g}" if known else "-",
            "exact" if exact else f"{max(self.claims):.3g}" if self.claims else "-",
            f"{min(self.digits):.1f}" if self.digits else "-",
            f"{float(np.median(self.digits)):.1f}" if self.digits else "-",
        ]
        numbers = "".join(f"{cell:>11}" for cell in cells)
        return f"{label:34}{len(self.errors):>8}{numbers}{len(self.outside):>9}" + (
            f"{len(self.undecided):>10}"
        )


@dataclass(frozen=True)
class Report:
    """Result of `vibrosweep.verify.verify`.

    Attributes
    ----------
    path
        The dataset.
    total
        Number of its realizations.
    seed
        Seed with which realizations were drawn.
    outcomes
        Of each realization drawn.
    claimed
        Whether the dataset states its claims; else they were computed anew.
    """

    path: str
    total: int
    seed: int
    outcomes: Sequence[Outcome]
    claimed: bool

    @property
    def passed(self) -> bool:
        """Whether no number lies outside the error claimed for it."""
        return not any(self.complaints())

    def count(self, state: State) -> int:
        """Return the number of realizations in a state."""
        return sum(outcome.state is state for outcome in self.outcomes)

    def variables(self) -> Mapping[str, VariableReport]:
        """Comparisons of each variable that the dataset holds and that was compared."""
        reports: dict[str, VariableReport] = {}
        for outcome in self.outcomes:
            for judgement in outcome.judgements:
                report = reports.setdefault(judgement.variable, VariableReport())
                report.add(outcome.realization, judgement)
        return {name: reports[name] for name in VARIABLES if name in reports}

    def complaints(self) -> Iterator[str]:
        """Give a sentence for each number outside its claim."""
        for outcome in self.outcomes:
            for j in outcome.judgements:
                if j.complaint:
                    of = "" if j.particle is None else f", particle {j.particle}"
                    yield f"realization {outcome.realization}{of}: {j.variable} {j.complaint}"

    def lines(self) -> Iterator[str]:
        """Give the report as text."""
        landings = sum(outcome.landings for outcome in self.outcomes)
        yield (
            f"{self.path}: {len(self.outcomes)} of {self.total} realizations, drawn with seed "
            f"{self.seed}; {self.count(State.COMPARED)} compared, {landings} landings proved"
        )
        if not self.claimed:
            yield "the dataset holds no bounds of its errors: they were computed anew"
        for state in State:
            if state is not State.COMPARED and self.count(state):
                yield f"{self.count(state)} {state.value}"
        reports = self.variables()
        if reports:
            heads = ("largest", "median", "largest", "least", "median")
            yield f"{'':34}{'numbers':>8}{''.join(f'{h:>11}' for h in heads)}{'':>9}{'un-':>10}"
            heads = ("error", "error", "claim", "digits", "digits")
            yield f"{'':42}{''.join(f'{h:>11}' for h in heads)}{'outside':>9}{'decided':>10}"
        for name, report in reports.items():
            yield report.line(name)
        yield from self._verdict()

    def _verdict(self) -> Iterator[str]:
        complaints = list(self.complaints())
        yield from complaints[:COMPLAINTS_SHOWN]
        if len(complaints) > COMPLAINTS_SHOWN:
            yield f"... and {len(complaints) - COMPLAINTS_SHOWN} more"
        if complaints:
            yield f"FAILED: {len(complaints)} numbers are outside the error claimed for them"
        elif self.count(State.COMPARED):
            yield "passed: every number compared is within the error claimed for it"
        else:
            yield "nothing was compared"
