"""Memory of the kernels: the rows of a block of lanes, and results not yet written."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Final, NamedTuple, TypeVar, get_type_hints

import numpy as np
from numpy.typing import DTypeLike, NDArray

from vibrosweep.errors import RunError
from vibrosweep.kernels._jit import Complexes, Flags, Floats, Integers, jit

# --- Blocks of lanes ------------------------------------------------------------------------------
# A block of lanes (trajectories) is stored in one flat array, one row per quantity.  With one array
# and constant row offsets, rather than one array per quantity, the compiler can prove that rows do
# not overlap; padding keeps the same lane of different rows out of the same set of the first-level
# cache.  The rows that every impact uses are contiguous: with other rows between them, the code was
# half as fast for one out of six placements in memory.


LANES: Final = 96
VECTOR: Final = 8
STRIDE: Final = LANES + VECTOR
OF_CONSTANTS: Final = 5  # rows that a base has for its constants
OF_PHASES: Final = 32  # rows for the lift-offs of a base that has several in a period

GOES_ON, ENDED, SPENT, RETURNED = 0.0, 1.0, 2.0, 3.0  # values of the row DONE


class LaneRows(NamedTuple):
    """First indices of the rows of the scratch memory; PHASES and CONSTANTS have several rows.

    Those from X_END on take part in every impact, as do some rows of `statistics`, which follow.
    """

    PHASES: int  # at which a base of several lift-offs begins to lift, and to press again
    LAST_SEEN: int  # of the last landing, for an observer: 1 if it is in the window, whole periods
    LAST_N: int  # and phase, time of the flight, speeds of arrival and rebound, 1 if it rests, and
    LAST_X: int  # absolute speed at lift-off
    LAST_TIME: int
    LAST_SPEED: int
    LAST_REBOUND: int
    LAST_RESTS: int
    LAST_LEFT: int
    X_ANCHOR: int  # the saved state, and the number of rests before it
    N_ANCHOR: int
    U_ANCHOR: int
    RESTS_ANCHOR: int
    NEXT_ANCHOR: int  # age at which the next anchor is saved
    N_BEGIN: int  # of the window
    X_BEGIN: int
    DONE: int  # reason why the trajectory leaves its lane
    LANE: int  # index of the trajectory
    AGE: int  # impacts so far
    STREAM: int  # of noise: stream, particle, and number of the period at which counts begin
    PARTICLE: int
    ORIGIN: int
    RESTITUTION_SIZE: int  # standard deviations
    KICK_SIZE: int
    DRIVE_SIZE: int
    RESTITUTION_DRAWN: int  # random numbers of the next impact, and of the one after it
    RESTITUTION_NEXT: int
    KICK_DRAWN: int
    KICK_NEXT: int
    DRIVE_DRAWN: int
    RESTING: int  # in a rest: number (from 1) of the period to try; -1 once one lifts; else 0
    TRIES: int  # of a search for the landing: passes so far, and the age at the last check
    AGE_SEEN: int
    COUNTS: int  # 1 if the flight is counted when it ends
    SINE: int  # sine and cosine of the phase of the lift-off
    COSINE: int
    SURE: int  # 1 if the clearance certainly has only one root
    GUESS: int  # a time near the landing
    RISE: int  # time from which the particle is above every height of the base
    NEXT: int  # the time that is tried next, negative where a flight begins
    REACHED: int  # the time s that is tried, and at that time:
    TURNED: int  # sin(2 pi s), 2 pi s - sin(2 pi s), and 1 - cos(2 pi s)
    LAG: int
    VERSINE: int
    CLEAR: int  # the clearance above the base
    CLEAR_SLOPE: int
    SINE_THEN: int
    COSINE_THEN: int
    NEWTON: int  # the terms of the series
    Q: int
    Q3: int
    Q4: int
    TIME: int  # at which it lands, or is to be tried; the speed of arrival, and whether it lands
    SPEED: int
    LANDED: int
    SCALE: int  # of speeds, where the law of restitution has one
    X_END: int
    X: int  # phase
    N: int  # whole periods, counted from the end of the window
    U: int  # speed, as the duration of the next flight
    CONSTANTS: int


ROW: Final = LaneRows(0, *((OF_PHASES + row) * STRIDE for row in range(len(LaneRows._fields) - 1)))
ROWS: Final = OF_PHASES + len(LaneRows._fields) - 2 + OF_CONSTANTS


def aligned(numbers: int) -> Floats:
    """Zeros aligned to a cache line, so that no vector crosses one."""
    memory = np.zeros(numbers + VECTOR)
    offset = (-memory.ctypes.data // memory.itemsize) % VECTOR
    return memory[offset : offset + numbers]


@jit
def find_done(s: Floats, lanes: int, places: Integers) -> int:
    """List the marked lanes; return their number."""
    done = 0
    for j in range(lanes):  # branch-free: the branch would be unpredictable
        places[done] = j
        done += 1 if s[ROW.DONE + j] != GOES_ON else 0
    return done


@jit
def close_gaps(s: Floats, lanes: int, places: Integers, fresh: int, done: int) -> int:
    """Move the last lanes into the gaps that were not refilled; return the number of lanes left."""
    for q in range(done - 1, fresh - 1, -1):  # from the last gap to the first
        lanes -= 1
        for row in range(s.size // STRIDE):
            s[row * STRIDE + places[q]] = s[row * STRIDE + lanes]
    return lanes


# --- Results --------------------------------------------------------------------------------------
# Results begin with marks of numbers that no kernel has written yet.  A result that a kernel leaves
# unwritten raises an error that names it; it is never taken from uninitialised memory.


T = TypeVar("T")

# Initial values of flags, and of other numbers: as a float64, a NaN that no arithmetic gives
FLAG: Final = -128
NUMBER: Final = 0x7FF8_0000_0BAD_F00D
DTYPE: Final[dict[Any, type]] = {
    Floats: np.float64,
    Complexes: np.complex128,
    Integers: np.int64,
    Flags: np.int8,
}


def unwritten(shape: int | tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """Allocate an array of a result: of float64, int64, complex128, or of flags as int8."""
    array = np.empty(shape, dtype)
    bits, mark = _bits(array)
    bits[...] = mark
    return array


def empty(kind: type[T], *shape: int) -> T:
    """Allocate a named tuple of results, all arrays of this shape and of the types it declares."""
    return kind(*(unwritten(shape, DTYPE[named]) for named in get_type_hints(kind).values()))


def require_written(results: Any, fields: Collection[str] = ()) -> None:
    """Raise a RunError that names a field of a named tuple with an unwritten number.

    All fields are checked unless some are named, and those of nested named tuples too.
    """
    for name in fields or results._fields:
        values = getattr(results, name)
        if hasattr(values, "_fields"):
            require_written(values)
        elif isinstance(values, np.ndarray):
            bits, mark = _bits(values)
            if np.any(bits == mark):
                raise RunError(
                    f"{type(results).__name__}.{name}: not completely written by a kernel; this is "
                    f"a fault of vibrosweep: please report it"
                )


def _bits(array: NDArray[Any]) -> tuple[NDArray[Any], int]:
    return (array.view(np.int8), FLAG) if array.itemsize == 1 else (array.view(np.int64), NUMBER)
