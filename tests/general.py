"""What tests run in place of the engine's own choice, so that less is compiled.

Without a window, without cycles, or without lift-offs the engine takes machine code of its own,
which gives the same bits.  Over the high-bounce base, with constant restitution, a sine and no
noise, the tests use all of it; elsewhere that which serves every case.  Pieces of kernels that a
test in `tests/kernels` calls run as plain Python, which gives the same bits as well.
`tests/kernels/test_machine_code.py` and `tests/kernels/test_bases.py` compare them.
"""

from functools import cache, wraps

import numba
import numpy as np

from vibrosweep.engine import measure
from vibrosweep.kernels import _jit
from vibrosweep.kernels._jit import as_python
from vibrosweep.kernels.bases.high_bounce import HighBounce
from vibrosweep.kernels.cycles import CYCLE, empty_rests
from vibrosweep.kernels.restitution import Rest

FITTED, ADVANCE, CALL = measure.fitted, measure.advance, _jit.Deferred.__call__
USUAL = HighBounce, *map(type, HighBounce(Rest()))  # types, since empty tuples are all equal


@wraps(ADVANCE)
def advance(share, batch, options, window, memory, found, cycles, rests):
    """Follow a share as the engine's own function does, with a window and with cycles."""
    if options.observer is None and (type(batch.base), *map(type, batch.base)) != USUAL:
        window = 1
        if cycles is None and batch.problem.noise is None:
            cycles, rests = np.empty((len(CYCLE), found.status.size)), empty_rests(found.kinds)
            options = options._replace(patience=np.inf, all_cycles=0)  # none is looked for
    return ADVANCE(share, batch, options, window, memory, found, cycles, rests)


def fitted(base, problem):
    """Return the base with all code that any realizations need."""
    return base


plain = cache(as_python)


def call(function, *arguments):
    """Call a piece of a kernel in plain Python, and a kernel as it is."""
    if function._compiler is _jit.ALONE:
        return plain(function.py_func)(*arguments)
    return CALL(function, *arguments)


def evaluate(intrinsic, *arguments):
    """Do what an instruction does of which there is no function."""
    return _jit._fma_exact(*arguments) if intrinsic is _jit.fma else None


def in_tests():
    """Take general machine code in this process."""
    measure.advance, measure.fitted = advance, fitted


def plain_pieces(monkeypatch):
    """Call pieces of kernels in plain Python."""
    if not numba.config.DISABLE_JIT:
        monkeypatch.setattr(_jit.Deferred, "__call__", call)
        monkeypatch.setattr(type(_jit.fma), "__call__", evaluate)


def as_the_engine_chooses(monkeypatch):
    """Take special machine code and compiled pieces again until the test ends."""
    monkeypatch.setattr(measure, "advance", ADVANCE)
    monkeypatch.setattr(measure, "fitted", FITTED)
    monkeypatch.setattr(_jit.Deferred, "__call__", CALL)
