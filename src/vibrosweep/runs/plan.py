"""The plan of a sweep: its chunks and its cost."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError, VibrosweepError
from vibrosweep.mistakes import CHUNK
from vibrosweep.runs.chunks import batch_size, bytes_per_realization
from vibrosweep.runs.pilot import UNKNOWN, Cost, explore
from vibrosweep.scene.realizations import Realizations, chosen, open_design
from vibrosweep.scene.sweep import Sweep
from vibrosweep.system import physical_memory

# A killed run loses at most the chunk that it was computing; a shorter sweep is one chunk
SECONDS_PER_CHUNK: Final = 10.0
# A chunk is held in memory until it is written, which limits it when realizations are quick
BYTES_PER_CHUNK: Final = 1 << 26
CHUNKS_IF_UNKNOWN: Final = 100
# Measured with all measures and 20 particles; similar for more particles, 680 for one
BYTES_PER_TRAJECTORY: Final = 370
# Time that a run may spend on planning, unless the sweep is obviously short
SECONDS_TO_PLAN: Final = 0.5


@dataclass(frozen=True)
class Plan:
    """The chunks of a sweep and their cost."""

    design: Realizations
    chunk: int  # realizations in a chunk
    cost: Cost  # mean cost of a realization
    opening: float  # seconds to open the design

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.design.realizations // self.chunk)


def make_plan(
    spec: Sweep,
    workers: Workers,
    chunk: int | None = None,
    *,
    rows: Sequence[int] = (),
    at_least: int = 1,
    seconds: float = SECONDS_TO_PLAN,
    enough: float = SECONDS_PER_CHUNK / 4,
) -> Plan:
    """Cut a sweep into chunks of some seconds of work, or of `chunk` realizations.

    `rows` are the indices of the realizations to compute, or all of them if empty.  `at_least` is
    the smallest number of chunks, unless there are fewer realizations; `seconds` and `enough` are
    those of `pilot.explore`.  Raises a ParameterError if a chunk does not fit into memory, and a
    TableError or SpecError if the design cannot be opened.
    """
    began = time.perf_counter()
    design = open_design(spec)
    design = chosen(design, rows) if rows else design
    opening = time.perf_counter() - began
    _require_memory(spec, design, min(chunk or 1, design.realizations))
    try:
        cost = explore(spec, design, workers, seconds, enough)
    except VibrosweepError:
        raise
    except Exception:  # a failure here will occur again in its chunk and be reported there
        cost = UNKNOWN
    size = design.realizations
    if chunk is not None:
        size = chunk
    elif not cost.known:
        size = min(batch_size(spec), -(-design.realizations // CHUNKS_IF_UNKNOWN))
    elif cost.seconds * size > SECONDS_PER_CHUNK or at_least > 1:
        size = min(
            int(SECONDS_PER_CHUNK / cost.seconds),
            BYTES_PER_CHUNK // bytes_per_realization(spec, design),
            design.realizations // at_least,
        )
        size -= size % batch_size(spec) if size > batch_size(spec) else 0
    return Plan(design, max(1, min(size, design.realizations)), cost, opening)


def refined(spec: Sweep, plan: Plan, workers: Workers, seconds: float) -> Plan:
    """Estimate the cost of a plan again, in this time, and leave its chunks as they are."""
    if not plan.cost.known:
        return plan
    cost = explore(spec, plan.design, workers, seconds)
    return replace(plan, cost=replace(cost, start=plan.cost.start, loaded=plan.cost.loaded))


def _require_memory(spec: Sweep, design: Realizations, chunk: int) -> None:
    """Raise a ParameterError if a chunk needs more than half of the memory."""
    batch = min(batch_size(spec), chunk)
    needed = BYTES_PER_TRAJECTORY * batch * spec.scene.particles
    needed += 2 * chunk * bytes_per_realization(spec, design)
    available = physical_memory()
    if needed > available / 2:
        raise ParameterError(
            f"a chunk of {chunk} realizations of {spec.scene.particles} particles needs about "
            f"{needed / 2**30:.3g} GiB of this machine's {available / 2**30:.3g} GiB: lower ",
            CHUNK,
            " where it was given, or take fewer particles",
        )
