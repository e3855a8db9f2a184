"""A user's function of every landing, called beside the loop over the lanes.

The loop notes what it needs of a landing in rows of its own, and stays free of branches; a second
one calls the function for those lanes that have landed in the window.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numba
from numba import njit

from vibrosweep.errors import ParameterError
from vibrosweep.kernels._jit import OPTIONS, Floats, jit
from vibrosweep.kernels.lanes import ROW, STRIDE, aligned
from vibrosweep.kernels.statistics import OF_LANE
from vibrosweep.model.observables import Landing, Observable


class Observer(NamedTuple):
    """A compiled function, and the totals of trajectories, of shape (trajectory, total)."""

    function: Callable[[Any, Any], None]
    totals: Floats


class Noted(NamedTuple):
    """Where the rows begin, behind all others, that hold the last landing of each lane."""

    PHASE: int
    TIME: int
    ARRIVAL: int
    REBOUND: int
    RESTS: int
    SEEN: int


NOTED: Final = Noted(*((OF_LANE + row) * STRIDE for row in range(len(Noted._fields))))


def observing_scratch() -> Floats:
    """Scratch memory of `vibrosweep.kernels.statistics.scratch`, with the rows of a landing."""
    return aligned((OF_LANE + len(Noted._fields)) * STRIDE)


@jit
def note(s: Floats, j: int, landing: Landing, seen: bool) -> None:
    """Note a landing of lane j, and whether it is in the window."""
    s[NOTED.PHASE + j], s[NOTED.TIME + j] = landing.phase, landing.flight_time
    s[NOTED.ARRIVAL + j], s[NOTED.REBOUND + j] = landing.arrival, landing.rebound
    s[NOTED.RESTS + j] = 1.0 if landing.rests else 0.0
    s[NOTED.SEEN + j] = 1.0 if seen else 0.0


@jit
def observe(s: Floats, lanes: int, observer: Observer) -> None:
    """Call the function for those of the first lanes that have just landed in the window."""
    for j in range(lanes):
        if s[NOTED.SEEN + j] > 0.0:
            landing = Landing(
                s[NOTED.PHASE + j],
                s[NOTED.TIME + j],
                s[NOTED.ARRIVAL + j],
                s[NOTED.REBOUND + j],
                s[NOTED.RESTS + j] > 0.0,
            )
            observer.function(observer.totals[int(s[ROW.LANE + j])], landing)


_compiled: dict[str, Callable[[Any, Any], None]] = {}  # by the `code` of observables


def compiled(observable: Observable) -> Callable[[Any, Any], None]:
    """Compile an observable's function, once in a process.

    An index beyond its totals raises an IndexError instead of spoiling memory; a ParameterError
    tells that numba cannot compile it.
    """
    if numba.config.DISABLE_JIT:
        return observable.function
    if observable.code in _compiled:
        return _compiled[observable.code]
    function = njit(**OPTIONS, boundscheck=True)(observable.function)
    try:
        function.compile((numba.float64[::1], numba.typeof(Landing(0.0, 0.0, 0.0, 0.0, False))))
    except numba.core.errors.NumbaError as error:
        reason = next(filter(str.strip, [*str(error).splitlines()[1:], str(error)])).strip()
        raise ParameterError(
            f"observable {observable.name!r}: numba cannot compile its function: {reason}; "
            f"call it as plain Python with np.zeros({observable.width}) and a vibrosweep.Landing "
            f"to look for the mistake"
        ) from error
    _compiled[observable.code] = function
    return function  # type: ignore[no-any-return]
