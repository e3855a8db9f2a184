"""Memory for the points of a line of orbits, and for the events on the way."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibrosweep.kernels._jit import Flags, Floats, Integers
from vibrosweep.kernels.unwritten import require_written, unwritten


class Line(NamedTuple):
    """Points of one line in their order, and events on the way."""

    ends: Integers  # number of points, of events, and why the line ends
    z: Floats  # (point, p + 2)
    trace: Floats
    determinant: Floats
    admissible: Flags
    speed: Floats  # (point, p), absolute, at each lift-off
    kind: Integers  # (event,)
    at: Floats  # (event, p + 2)


def empty_line(points: int, p: int) -> Line:
    """Allocate memory for so many points and events."""
    return Line(
        ends=unwritten(3, np.int64),
        z=unwritten((points, p + 2)),
        trace=unwritten(points),
        determinant=unwritten(points),
        admissible=unwritten(points, np.int8),
        speed=unwritten((points, p)),
        kind=unwritten(points, np.int64),
        at=unwritten((points, p + 2)),
    )


def written(out: Line) -> Line:
    """Return the points and events that a line holds; a RunError where one was not written."""
    count, events = int(out.ends[0]), int(out.ends[1])
    points = {name: getattr(out, name)[:count].copy() for name in Line._fields[1:6]}
    kept = out._replace(**points, kind=out.kind[:events].copy(), at=out.at[:events].copy())
    require_written(kept)
    return kept
