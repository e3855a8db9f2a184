"""How a sweep is cut into chunks, and what it will cost."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from vibrosweep.engine.landings import physical_memory
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError, VibrosweepError
from vibrosweep.run.chunks import batch_size
from vibrosweep.run.pilot import UNKNOWN, Cost, explore
from vibrosweep.spec.design import Design, chosen, open_design
from vibrosweep.spec.sweep import SweepSpec

__all__ = ["Plan", "bytes_per_realization", "make_plan"]

# A chunk is what a run that is killed loses at most; a sweep that is shorter is not cut.
SECONDS_PER_CHUNK: Final = 10.0
# A chunk of quick realizations is held in memory and written at once.
BYTES_PER_CHUNK: Final = 1 << 26
CHUNKS_IF_UNKNOWN: Final = 100
# Measured with all measures and 20 particles; about the same for more, 680 for one.
BYTES_PER_TRAJECTORY: Final = 370
# Time that a run may spend on planning a sweep which is not obviously short.
SECONDS_TO_PLAN: Final = 0.5


@dataclass(frozen=True)
class Plan:
    """How a sweep is cut.

    Attributes
    ----------
    design
        The realizations.
    chunk
        Realizations in a chunk.
    cost
        What a realization costs.
    opening
        Seconds to open the design.
    """

    design: Design
    chunk: int
    cost: Cost
    opening: float

    @property
    def chunks(self) -> int:
        """Number of chunks."""
        return -(-self.design.realizations // self.chunk)


def make_plan(
    spec: SweepSpec,
    workers: Workers,
    chunk: int | None = None,
    *,
    rows: Sequence[int] = (),
    at_least: int = 1,
    seconds: float = SECONDS_TO_PLAN,
    enough: float = SECONDS_PER_CHUNK / 4,
) -> Plan:
    """Cut a sweep into chunks of some seconds of work.

    Parameters
    ----------
    spec
        The sweep.
    workers
        Threads that compute a chunk.
    chunk
        Realizations in a chunk, where the user gave it.
    rows
        Indices of the realizations to compute, where not all are.
    at_least
        Number of chunks that are wanted, as far as there are realizations.
    seconds, enough
        As for `pilot.explore`.

    Raises
    ------
    ParameterError
        What is held in memory at a time does not fit.
    TableError, SpecError
        The design cannot be opened.
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
    except Exception:  # what fails in the sample fails in its chunk, and is reported there
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


def _require_memory(spec: SweepSpec, design: Design, chunk: int) -> None:
    """Refuse what no half of the memory holds, before anything is computed."""
    batch = min(batch_size(spec), chunk)
    needed = BYTES_PER_TRAJECTORY * batch * spec.particles
    needed += 2 * chunk * bytes_per_realization(spec, design)
    available = physical_memory()
    if needed > available / 2:
        raise ParameterError(
            f"a chunk of {chunk} realizations of {spec.particles} particles needs about "
            f"{needed / 2**30:.3g} GiB of this machine's {available / 2**30:.3g} GiB: lower "
            f"chunk= where it was given, or take fewer particles"
        )


def bytes_per_realization(spec: SweepSpec, design: Design) -> int:
    """Bytes of a realization's results in memory and in parts."""
    sizes = {"realization": 1, "particle": spec.particles}
    measured = sum(
        np.dtype(v.dtype).itemsize * int(np.prod([sizes[d] for d in v.dims]))
        for v in spec.measures.variables
    )
    return 8 * len(design.sampled) + measured
