"""The summary of a sweep in a few lines for the terminal, gathered chunk by chunk."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from vibrosweep.model.measures import OF_REALIZATIONS, VARIABLES, Variable, known
from vibrosweep.model.status import Status
from vibrosweep.store.rows import read_rows, row_count, slices

# Variables that show whether a larger impact budget would change a result
SETTLING: Final = ("status", *(v.name for v in VARIABLES.values() if v.open_by_budget))


@dataclass
class _Spread:
    """Smallest, mean and largest of the finite values, and the number of infinite ones."""

    count: int = 0
    total: float = 0.0
    low: float = np.inf
    high: float = -np.inf
    infinite: dict[float, int] = field(default_factory=dict)

    def add(self, values: NDArray[Any]) -> None:
        for sign in (-np.inf, np.inf):
            if found := int(np.count_nonzero(values == sign)):
                self.infinite[sign] = self.infinite.get(sign, 0) + found
        finite = values[np.isfinite(values)]
        if finite.size:
            self.count += finite.size
            self.total += float(finite.sum())
            self.low = min(self.low, float(finite.min()))
            self.high = max(self.high, float(finite.max()))


@dataclass
class Summary:
    """Ranges, means and counts over the realizations of a sweep; add chunks in their order.

    `kept` counts realizations that an interrupted run had computed, `repaired` damaged parts that
    were computed again; `notes` are remarks on the settings of the sweep, by subject.
    """

    realizations: int = 0
    landings: int = 0
    kept: int = 0
    repaired: int = 0
    notes: Mapping[str, str] = field(default_factory=dict)
    spreads: dict[str, _Spread] = field(default_factory=dict)
    codes: dict[str, dict[int, int]] = field(default_factory=dict)

    def add(self, measured: Mapping[str, NDArray[Any]]) -> None:
        """Add the measured variables of a chunk, each of shape (realization, ...)."""
        self.realizations += measured["impact_count"].size
        counts = measured["impact_count"][known("impact_count", measured)]
        # each is below 2^53, their sum may not fit into 64 bits
        self.landings += (int((counts >> 32).sum()) << 32) + int((counts & 0xFFFFFFFF).sum())
        for name, variable in OF_REALIZATIONS.items():
            if name not in measured:
                continue
            if variable.flags:
                codes, counts = np.unique(measured[name], return_counts=True)
                totals = self.codes.setdefault(name, {})
                for code, count in zip(codes.tolist(), counts.tolist(), strict=True):
                    totals[code] = totals.get(code, 0) + count
            else:
                self.spreads.setdefault(name, _Spread()).add(measured[name][known(name, measured)])

    def lines(self) -> Iterator[str]:
        """Yield the summary as lines of a table."""
        yield f"{'':32}{'min':>12}{'mean':>12}{'max':>12}"
        for name, spread in self.spreads.items():
            yield f"{OF_REALIZATIONS[name].label:32}{self._spread(spread)}"
        for name, counts in self.codes.items():
            yield f"{name:32}{_counted(OF_REALIZATIONS[name], counts)}"
        for subject, text in self.notes.items():
            yield f"{subject:32}{text}"
        for code in sorted(self.codes.get("status", {})):
            if code != Status.COMPLETED:
                yield f"{Status(code).meaning}: {Status(code).sentence}"

    def _spread(self, spread: _Spread) -> str:
        """Write smallest, mean and largest finite value, and the number of other realizations."""
        undefined = self.realizations - spread.count - sum(spread.infinite.values())
        others = {f"{value:g}": count for value, count in sorted(spread.infinite.items())}
        words = ", ".join(
            f"{what} in {'every realization' if count == self.realizations else count}"
            for what, count in {**others, "undefined": undefined}.items()
            if count
        )
        if not spread.count:
            return f"{words:>36}"
        mean = spread.total / spread.count
        return f"{spread.low:12.5g}{mean:12.5g}{spread.high:12.5g}{words and '   '}{words}"


def _counted(variable: Variable, counts: Mapping[int, int]) -> str:
    """Write the number and the share of each code, in words."""
    meanings = dict(variable.flags)
    total = sum(counts.values())
    parts = (
        f"{meanings[code]} {count} ({count / total:.1%})" for code, count in sorted(counts.items())
    )
    return ", ".join(parts)


def unsettled(columns: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_]:
    """Mark realizations that did not complete, or lack a measure that a larger budget gives."""
    failed = columns["status"] != Status.COMPLETED
    # a realization whose landings are counted from a cycle completes, but these measures need
    # every landing
    for name in SETTLING[1:]:
        if name in columns:
            failed = failed | ~known(name, columns)
    return np.asarray(failed)


def summary_of(file: Any) -> Summary:
    """Summarise an open result file."""
    summary = Summary()
    names = [name for name in OF_REALIZATIONS if name in file.variables]
    for rows in slices(row_count(file)):
        summary.add({name: read_rows(file, name, rows) for name in names})
    return summary
