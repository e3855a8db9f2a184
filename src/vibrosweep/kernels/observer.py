"""Observers of every landing, such as a user's function.

The loop over the lanes stores the last landing of each lane in additional rows, without a branch; a
second loop then calls the observer for lanes that have landed in the window.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numba
from numba import njit, types

from vibrosweep.kernels._jit import OPTIONS, Floats, generic, implements, jit
from vibrosweep.kernels.anew import compiled_anew, require_compilable
from vibrosweep.kernels.bases import Base
from vibrosweep.kernels.lanes import ROW, ROWS, STRIDE
from vibrosweep.kernels.statistics import KINDS, declare
from vibrosweep.kernels.totals import scratch
from vibrosweep.model.observables import Landing, Observable


@generic
def note(observer: Any, s: Floats, j: int, landing: Landing, n: float, seen: bool) -> None:
    """Note a landing of lane j, after n whole periods, and whether it is in the window."""


@generic
def observe(observer: Any, s: Floats, lanes: int, base: Base) -> None:
    """Call the observer for those of the first lanes that have just landed in the window."""


class Observer(NamedTuple):
    """A compiled function, and the totals of trajectories, of shape (trajectory, total)."""

    function: Callable[[Any, Any], None]
    totals: Floats
    initial: float  # value with which totals begin


class Noted(NamedTuple):
    """First indices of the rows of the last landing of each lane, behind all other rows."""

    PHASE: int
    TIME: int
    ARRIVAL: int
    REBOUND: int
    RESTS: int
    SEEN: int


BEHIND: Final = ROWS + 3 * len(KINDS) + 1  # an observer takes no other statistics
NOTED: Final = Noted(*((BEHIND + row) * STRIDE for row in range(len(Noted._fields))))


def observer_scratch() -> Floats:
    """Scratch memory of `vibrosweep.kernels.totals.scratch`, with the rows of a landing."""
    return scratch(KINDS, len(Noted._fields))


@implements(note, Observer)
def note_for_function(
    observer: Observer, s: Floats, j: int, landing: Landing, n: float, seen: bool
) -> None:
    s[NOTED.PHASE + j], s[NOTED.TIME + j] = landing.phase, landing.flight_time
    s[NOTED.ARRIVAL + j], s[NOTED.REBOUND + j] = landing.arrival, landing.rebound
    s[NOTED.RESTS + j] = 1.0 if landing.rests else 0.0
    s[NOTED.SEEN + j] = 1.0 if seen else 0.0


@implements(observe, Observer)
def call_function(observer: Observer, s: Floats, lanes: int, base: Base) -> None:
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


# A user's function behaves as in plain Python: its exceptions are raised.
OF_A_USER: Final = OPTIONS | {"error_model": "python", "boundscheck": True}

_compiled: dict[tuple[str, str], Any] = {}  # by code of observables, and how landings combine


def compiled(observable: Observable) -> Any:
    """Compile an observable's function, once in a process.

    Returns the compiled function if it changes totals; an index out of range then raises an
    IndexError.  For a function that returns a number of a landing, returns the marker of its
    statistic.  Raises a ParameterError if numba cannot compile it.
    """
    key = observable.code, observable.landings
    if key not in _compiled:
        _require_compilable(observable)
        _compiled[key] = _made(observable)
    return _compiled[key]


def _made(observable: Observable) -> Any:
    if observable.landings:
        # numba keeps machine code by the names of types: this one changes with the function
        name = f"{observable.name}_{observable.landings}_{observable.code}"
        return declare(name, compiled_anew(observable.function, jit), observable.landings)
    if numba.config.DISABLE_JIT:
        return observable.function
    return compiled_anew(observable.function, njit(**OF_A_USER))


def _require_compilable(observable: Observable) -> None:
    landing = numba.typeof(Landing(0.0, 0.0, 0.0, 0.0, False))
    takes = (landing,) if observable.landings else (types.float64[::1], landing)
    require_compilable(
        observable.function,
        takes,
        njit(**OF_A_USER),
        f"observable {observable.name!r}: its function",
        real=bool(observable.landings),
    )
