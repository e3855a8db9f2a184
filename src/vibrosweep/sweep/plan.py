"""How a sweep is cut into chunks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from vibrosweep.sweep.chunks import batch_size
from vibrosweep.sweep.design import Design
from vibrosweep.sweep.spec import SweepSpec

__all__ = ["Plan", "make_plan"]

BATCHES_PER_CHUNK: Final = 64


@dataclass(frozen=True)
class Plan:
    """How a sweep is cut."""

    realizations: int
    chunk: int

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.realizations // self.chunk)


def make_plan(spec: SweepSpec, design: Design, threads: int, chunk: int | None) -> Plan:
    """Plan a sweep."""
    size = chunk or BATCHES_PER_CHUNK * batch_size(spec)
    return Plan(design.realizations, min(size, design.realizations))
