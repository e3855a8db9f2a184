"""Result of a verification: judgements of stored numbers, and the report as a table."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Final

import numpy as np

from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.measures import RECORD as OF_RECORD
from vibrosweep.model.measures import VARIABLES
from vibrosweep.proof.reference.arithmetic import Proved


@dataclass(frozen=True)
class Judgement:
    """Result of the comparison for one stored number."""

    variable: str  # its name
    particle: int | None  # number of the particle; None for a number of the whole realization
    # Distance from the proved value; NaN where both are undefined, infinite where one is
    error: float
    claim: float | None  # largest error that the dataset allows; None where it claims nothing
    # Certified decimal digits, from the sum of the claim and the reference's radius, relative to
    # the value; 0 where the sum exceeds it.  None for exact, zero or undefined values.
    digits: float | None = None
    # Description of the failure; empty if the number is within its claim or nothing is claimed
    complaint: str = ""


def judge(
    variable: str, particle: int | None, stored: float, proved: Proved, claim: float | None
) -> Judgement:
    """Compare a stored number with its proved value, and its error with the claim."""
    least = error = math.inf
    digits = None
    if proved is None:
        least = error = math.nan if math.isnan(stored) else math.inf
    elif isinstance(proved, int | float):
        if not math.isnan(stored):
            least = error = 0.0 if stored == proved else abs(stored - proved)
    elif math.isfinite(stored):
        distance = proved - stored
        least, error = float(distance.abs_lower()), float(distance.abs_upper())
        size, bound = float(proved.abs_lower()), (claim or 0.0) + float(proved.rad())
        if claim is not None and size > 0.0 and bound > 0.0:
            digits = max(0.0, -math.log10(bound / size))
    complaint = ""
    if claim is not None and least > claim:
        known = "undefined" if proved is None else f"{float(proved)!r}"
        complaint = f"is {stored!r}, proved {known}: off by {error:.3g}, claimed {claim:.3g}"
    return Judgement(variable, particle, error, claim, digits, complaint)


# Variables of the record share names with those of the sweep, but not dimensions
RECORDED: Final = {f"record/{name}": variable for name, variable in OF_RECORD.items()}
ALL: Final = {**VARIABLES, **RECORDED}
UNITS: Final = {
    **dict.fromkeys(("launch_time", "duration", "transient"), "s"),
    **{name: parameter.units for name, parameter in INPUTS.items()},
}
DATASET: Final = "dataset"
RECORD: Final = "record"
UNCLAIMED: Final = "nothing is claimed where rounding may decide, or no proof was found"

# Relative change of the parameters of coupled particles: its effects are estimates of their errors
CHANGE: Final = 2.0**-44
COMPLAINTS_SHOWN: Final = 20


class ProofState(Enum):
    """Reasons why a realization could or could not be compared, in the words of the report."""

    COMPARED = "proved"
    NO_CLAIM = "without a claim: rounding may have changed a decision"
    NOT_COMPLETED = "not completed by the run, as the status says"
    TOO_LONG = "left out: too many landings; raise --max-landings"
    UNDECIDED = "undecided by the reference: an exact tie, or too chaotic"


@dataclass(frozen=True)
class Outcome:
    """Outcome for one realization, or (None) for the record of every landing.

    `deviation`: largest error of the landings that this version finds, and its estimate, s;
    `estimated`: names of observables whose claims are estimates.
    """

    realization: int | None
    state: ProofState
    landings: int = 0
    judgements: Sequence[Judgement] = ()
    deviation: tuple[float, float] | None = None
    estimated: Sequence[str] = ()

    @property
    def place(self) -> str:
        """Place in the dataset, in words."""
        return RECORD if self.realization is None else f"realization {self.realization}"


@dataclass
class VariableReport:
    """All comparisons of one variable."""

    # errors, claims, digits: of each number compared; digits only where they are defined
    errors: list[float] = field(default_factory=list)
    claims: list[float] = field(default_factory=list)
    digits: list[float] = field(default_factory=list)
    # Places with a number outside its claim: realizations, or the record
    outside: set[str] = field(default_factory=set)
    # Places with a number about which nothing is claimed
    undecided: set[str] = field(default_factory=set)
    compared: set[str] = field(default_factory=set)  # places with a number that was compared

    def add(self, place: str, judgement: Judgement) -> None:
        """Add one comparison."""
        if judgement.complaint:
            self.outside.add(place)
        if judgement.claim is None:
            if not judgement.complaint:
                self.undecided.add(place)
            return
        self.compared.add(place)
        self.errors.append(judgement.error)
        self.claims.append(judgement.claim)
        if judgement.digits is not None:
            self.digits.append(judgement.digits)

    def facts(self) -> dict[str, float | None]:
        """Return the comparisons of the variable as numbers by name."""
        known = [error for error in self.errors if not math.isnan(error)]
        return {
            "places": len(self.compared),
            "numbers": len(self.errors),
            "largest_error": max(known, default=None),
            "largest_claim": max(self.claims, default=None),
            "least_digits": min(self.digits, default=None),
            "outside": len(self.outside),
            "undecided": len(self.undecided),
        }

    def line(self, name: str, places: int) -> str:
        """Row of the table for a variable that could be compared in `places` places."""
        variable = ALL.get(name)
        exact = variable is not None and (bool(variable.flags) or variable.dtype == "int64")
        units = UNITS.get(name.removeprefix("record/"), "1")
        label = name if units == "1" else f"{name} ({units})"
        if variable is not None:
            label = name.removesuffix(variable.name) + variable.label
        known = [error for error in self.errors if not math.isnan(error)]
        cells = [
            f"{len(self.compared)}/{places}",
            f"{len(self.errors)}",
            f"{max(known):.3g}" if known else "-",
            f"{float(np.median(known)):.3g}" if known else "-",
            "exact" if exact else f"{max(self.claims):.3g}" if self.claims else "-",
            f"{min(self.digits):.1f}" if self.digits else "-",
            f"{float(np.median(self.digits)):.1f}" if self.digits else "-",
            f"{len(self.outside)}",
            f"{len(self.undecided)}",
        ]
        return _row(label, cells)


def _row(label: str, cells: Sequence[str]) -> str:
    return f"{label:36}" + "".join(f"{cell:>11}" for cell in cells)


@dataclass(frozen=True)
class Report:
    """Result of `vibrosweep.proof.verifying.verify`."""

    path: str
    total: int  # number of its realizations
    seed: int  # seed with which realizations were drawn
    outcomes: Sequence[Outcome]  # of each realization drawn, then of the record where there is one
    claimed: bool  # True if the dataset holds error bounds; else they were computed again
    names: Sequence[str]  # every variable of the dataset
    unknown: Mapping[str, str]  # reason why a variable cannot be compared at all, by name
    # Comparisons of the shared coordinates with the sweep file, and judgements of the axes
    coordinates: Sequence[Judgement] = ()
    coupled: bool = False  # True if the base couples the particles: then errors are estimated
    estimated: Sequence[str] = ()  # names of observables whose claims are estimates

    @property
    def passed(self) -> bool:
        """True if every number is within the error claimed for it."""
        return not any(self.complaints())

    def count(self, state: ProofState) -> int:
        """Return the number of realizations in a state."""
        return sum(o.state is state for o in self.outcomes if o.realization is not None)

    def variables(self) -> Mapping[str, VariableReport]:
        """Comparisons of each variable of the dataset that was judged."""
        reports: dict[str, VariableReport] = {}
        for place, judgement in self._judgements():
            reports.setdefault(judgement.variable, VariableReport()).add(place, judgement)
        return {name: reports[name] for name in self.names if name in reports}

    def not_compared(self) -> Mapping[str, str]:
        """Variables of the dataset without a compared number, and the reasons."""
        reports = self.variables()
        return {
            name: self._reason(name)
            for name in self.names
            if name not in reports or not (reports[name].compared or reports[name].outside)
        }

    def _reason(self, name: str) -> str:
        if name in self.unknown:
            return self.unknown[name]
        of_record = name.startswith(f"{RECORD}/")
        states = [o.state for o in self.outcomes if (o.realization is None) == of_record]
        why = dict.fromkeys(state.value for state in states if state is not ProofState.COMPARED)
        if ProofState.COMPARED in states:
            why[UNCLAIMED] = None
        return "; ".join(why)

    def _judgements(self) -> Iterator[tuple[str, Judgement]]:
        """Yield every judgement with its place."""
        yield from ((DATASET, judgement) for judgement in self.coordinates)
        for outcome in self.outcomes:
            yield from ((outcome.place, judgement) for judgement in outcome.judgements)

    def complaints(self) -> Iterator[str]:
        """Yield a sentence for each number outside its claim."""
        for place, j in self._judgements():
            if j.complaint:
                particle = "" if j.particle is None else f", particle {j.particle}"
                yield f"{place}{particle}: {j.variable} {j.complaint}"

    def lines(self) -> Iterator[str]:
        """Yield the report as lines of text."""
        landings = sum(outcome.landings for outcome in self.outcomes)
        drawn = sum(self.count(state) for state in ProofState)
        yield (
            f"{self.path}: {drawn} of {self.total} realizations, drawn with seed {self.seed}; "
            f"{self.count(ProofState.COMPARED)} proved, {landings} landings"
        )
        if self.coupled:
            yield from self._estimates()
        elif not self.claimed:
            yield "the dataset holds no error bounds: they were computed again"
        for name in self.estimated:
            yield (
                f"{name}: its function cannot be evaluated on balls: claims are estimates, "
                f"changes of the function by the errors of each landing"
            )
        for state in ProofState:
            if state is not ProofState.COMPARED and self.count(state):
                yield f"{self.count(state)} {state.value}"
        for outcome in self.outcomes:
            if outcome.realization is None:
                yield f"the record of every landing: {outcome.state.value}"
        yield _row(
            "",
            ("compared", "numbers", "largest", "median", "largest", "least", "median", "", "un-"),
        )
        heads = ("in", "", "error", "error", "claim", "digits", "digits", "outside", "decided")
        yield _row("", heads)
        left_out = self.not_compared()
        for name, report in self.variables().items():
            if name not in left_out:
                once = {DATASET, RECORD} & (report.compared | report.outside)
                yield report.line(name, 1 if once else drawn)
        for name, reason in left_out.items():
            yield f"not compared: {name}: {reason}"
        yield from self._verdict()

    def facts(self) -> dict[str, Any]:
        """Return the report as numbers and texts by name."""
        left_out = self.not_compared()
        return {
            "file": self.path,
            "passed": self.passed,
            "realizations": self.total,
            "seed": self.seed,
            "drawn": {state.name.lower(): self.count(state) for state in ProofState},
            "landings": sum(outcome.landings for outcome in self.outcomes),
            "variables": {
                name: report.facts()
                for name, report in self.variables().items()
                if name not in left_out
            },
            "not_compared": left_out,
            "complaints": [*self.complaints()],
        }

    def _estimates(self) -> Iterator[str]:
        """Describe the estimates over a sprung base, and the largest errors that were found."""
        yield (
            "no error bounds are proved for coupled particles: claims are estimates, "
            f"the effects of relative changes of the parameters by {CHANGE:.2g}"
        )
        found = [o.deviation for o in self.outcomes if o.deviation is not None]
        found = [pair for pair in found if pair[1] > 0.0]  # without a landing there is no estimate
        if found:
            largest = max(error for error, _ in found)
            share = max(error / estimate for error, estimate in found)
            yield (
                f"largest error of a recomputed landing: {largest:.3g} s, "
                f"and at most {share:.2g} times its estimate"
            )

    def _verdict(self) -> Iterator[str]:
        complaints = list(self.complaints())
        yield from complaints[:COMPLAINTS_SHOWN]
        if len(complaints) > COMPLAINTS_SHOWN:
            yield f"... and {len(complaints) - COMPLAINTS_SHOWN} more"
        left_out = len(self.not_compared())
        total = f"{len(self.names) - left_out} of {len(self.names)} variables"
        if complaints:
            outside = dict.fromkeys(j.variable for _, j in self._judgements() if j.complaint)
            yield (
                f"FAILED: {len(complaints)} numbers are outside the error claimed for them: "
                f"{', '.join(outside)}"
            )
        elif any(outcome.state is ProofState.COMPARED for outcome in self.outcomes):
            yield f"passed: every number compared is within the error claimed for it; {total}"
        else:
            yield f"nothing was proved; {total} agree with the sweep file and with each other"
