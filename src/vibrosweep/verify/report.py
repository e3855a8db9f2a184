"""What a verification found: per variable, per realization, and as a table."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Final

import numpy as np

from vibrosweep.verify.judgement import Judgement
from vibrosweep.verify.reading import VARIABLES
from vibrosweep.verify.record import RECORDED

__all__ = ["Outcome", "Report", "State", "VariableReport"]

ALL: Final = {**VARIABLES, **RECORDED}

COMPLAINTS_SHOWN: Final = 20


class State(Enum):
    """How far a realization could be compared; the value is what the report says of it."""

    COMPARED = "compared"
    NO_CLAIM = "without a claim: rounding may have changed a decision"
    NOT_COMPLETED = "not completed by the run, as the status says"
    TOO_LONG = "left out: too many landings; raise --max-landings"
    UNDECIDED = "undecided by the reference: an exact tie, or too chaotic"


@dataclass(frozen=True)
class Outcome:
    """What became of one realization, or (None) of the record of every landing."""

    realization: int | None
    state: State
    landings: int = 0
    judgements: Sequence[Judgement] = ()

    @property
    def place(self) -> str:
        """Where in the dataset it is, in words."""
        return "record" if self.realization is None else f"realization {self.realization}"


@dataclass
class VariableReport:
    """All comparisons of one variable.

    Attributes
    ----------
    errors, claims, digits
        Of each number compared; digits only where they are defined.
    outside
        Places with a number outside its claim: realizations, or the record.
    undecided
        Places with a number about which nothing is claimed.
    """

    errors: list[float] = field(default_factory=list)
    claims: list[float] = field(default_factory=list)
    digits: list[float] = field(default_factory=list)
    outside: set[str] = field(default_factory=set)
    undecided: set[str] = field(default_factory=set)

    def add(self, place: str, judgement: Judgement) -> None:
        """Add one comparison."""
        if judgement.complaint:
            self.outside.add(place)
        if judgement.claim is None:
            if not judgement.complaint:
                self.undecided.add(place)
            return
        self.errors.append(judgement.error)
        self.claims.append(judgement.claim)
        if judgement.digits is not None:
            self.digits.append(judgement.digits)

    def line(self, name: str) -> str:
        """Row of the table."""
        variable = ALL[name]
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
        Of each realization drawn, then of the record where there is one.
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
        return sum(o.state is state for o in self.outcomes if o.realization is not None)

    def variables(self) -> Mapping[str, VariableReport]:
        """Comparisons of each variable that the dataset holds and that was compared."""
        reports: dict[str, VariableReport] = {}
        for outcome in self.outcomes:
            for judgement in outcome.judgements:
                report = reports.setdefault(judgement.variable, VariableReport())
                report.add(outcome.place, judgement)
        return {name: reports[name] for name in ALL if name in reports}

    def complaints(self) -> Iterator[str]:
        """Give a sentence for each number outside its claim."""
        for outcome in self.outcomes:
            for j in outcome.judgements:
                if j.complaint:
                    of = "" if j.particle is None else f", particle {j.particle}"
                    yield f"{outcome.place}{of}: {j.variable} {j.complaint}"

    def lines(self) -> Iterator[str]:
        """Give the report as text."""
        landings = sum(outcome.landings for outcome in self.outcomes)
        drawn = sum(self.count(state) for state in State)
        yield (
            f"{self.path}: {drawn} of {self.total} realizations, drawn with seed {self.seed}; "
            f"{self.count(State.COMPARED)} compared, {landings} landings proved"
        )
        if not self.claimed:
            yield "the dataset holds no bounds of its errors: they were computed anew"
        for state in State:
            if state is not State.COMPARED and self.count(state):
                yield f"{self.count(state)} {state.value}"
        for outcome in self.outcomes:
            if outcome.realization is None:
                yield f"the record of every landing: {outcome.state.value}"
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
        elif any(outcome.state is State.COMPARED for outcome in self.outcomes):
            yield "passed: every number compared is within the error claimed for it"
        else:
            yield "nothing was compared"
