"""A user's function of every landing, called beside the loop over the lanes.

The loop notes what it needs of a landing in rows of its own, and stays free of branches; a second
one calls the function for those lanes that have landed in the window.
"""

from __future__ import annotations

from collections.abc import Callable
from types import CellType, FunctionType
from typing import Any, Final, NamedTuple

import numba
from numba import njit

from vibrosweep.errors import ParameterError
from vibrosweep.kernels._jit import OPTIONS, Floats, jit
from vibrosweep.kernels.lanes import ROW, STRIDE, aligned
from vibrosweep.kernels.statistics import OF_LANE
from vibrosweep.model.functions import is_own, outside, plain
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


# A user's function does what it does in plain Python: what that raises is raised.
OF_A_USER: Final = OPTIONS | {"error_model": "python", "boundscheck": True}

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
    function = _compiled_anew(observable.function, {})
    try:
        function.compile((numba.float64[::1], numba.typeof(Landing(0.0, 0.0, 0.0, 0.0, False))))
    except Exception as error:  # not all that numba raises has one base
        reason = next(filter(str.strip, [*str(error).splitlines()[1:], str(error)])).strip()
        raise ParameterError(
            f"observable {observable.name!r}: numba cannot compile its function: {reason}; "
            f"call it as plain Python with np.zeros({observable.width}) and a vibrosweep.Landing "
            f"to look for the mistake"
        ) from error
    _compiled[observable.code] = function
    return function  # type: ignore[no-any-return]


def _compiled_anew(function: Any, done: dict[Any, Any]) -> Any:
    """Compile a function together with those that it calls.

    What numba has compiled of them before may hold earlier values of the numbers that they use, and
    does not check indices.
    """
    if function not in done:
        names, code = dict(function.__globals__), function.__code__
        cells = {name: CellType() for name in code.co_freevars}
        enclosed, given = tuple(cells.values()), function.__defaults__
        fresh = FunctionType(code, names, function.__name__, given, enclosed)
        fresh.__kwdefaults__ = function.__kwdefaults__
        done[function] = njit(**OF_A_USER)(fresh)
        for name, value in outside(function).items():
            own = _compiled_anew(plain(value), done) if is_own(value) else value
            if name in cells:
                cells[name].cell_contents = own
            else:
                names[name] = own
    return done[function]
