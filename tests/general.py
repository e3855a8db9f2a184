"""What tests run in place of the engine's own choice, so that less is compiled.

Without a window, without cycles, or without lift-offs the engine takes machine code of its own,
which gives the same bits.  Over the high-bounce base, with constant restitution, a sine, no noise
and the statistics of every sweep, the tests use all of it; elsewhere that which serves every case.
Noise of some kinds is computed by the machine code of all kinds, with strengths of 0; landings are
the same to the bit, and means add the same numbers in other partial sums.
Pieces of kernels that a test in `tests/kernels` calls run as plain Python, which gives the same
bits.  `tests/kernels/test_machine_code.py` and `tests/kernels/test_bases.py` compare them.
"""

from functools import cache, wraps

import numba
import numpy as np

from vibrosweep.analysis import conditions
from vibrosweep.engine import landings, measure
from vibrosweep.kernels import _jit
from vibrosweep.kernels._jit import as_python
from vibrosweep.kernels.bases.high_bounce import HighBounce
from vibrosweep.kernels.cycles import CYCLE, empty_rests
from vibrosweep.kernels.restitution import Rest
from vibrosweep.kernels.statistics import KINDS

FITTED, ADVANCE, CALL = measure.fitted, measure.advance, _jit.Deferred.__call__
BATCH_OF = measure.batch_of
USUAL = HighBounce, *map(type, HighBounce(Rest()))  # types, since empty tuples are all equal


@wraps(ADVANCE)
def advance(share, batch, options, window, memory, found, cycles, rests):
    """Follow a share as the engine's own function does, with a window and with cycles."""
    usual = (type(batch.base), *map(type, batch.base)) == USUAL and len(found.kinds) == len(KINDS)
    if options.observer is None and not usual:
        window = 1
        if cycles is None and batch.problem.noise is None:
            cycles, rests = np.empty((len(CYCLE), found.status.size)), empty_rests(found.kinds)
            options = options._replace(patience=np.inf, all_cycles=0)  # none is looked for
    return ADVANCE(share, batch, options, window, memory, found, cycles, rests)


def batch_of(problem, launch, scene):
    """Return a batch whose noise has all kinds that the base allows, some of strength 0."""
    if problem.noise is not None:
        none = np.zeros(problem.kick.size)
        kinds = ("restitution", "kick", *["drive"] * (scene.base == "high-bounce"))
        added = {kind: none for kind in kinds if getattr(problem.noise, kind) is None}
        problem = problem._replace(noise=problem.noise._replace(**added))
    return BATCH_OF(problem, launch, scene)


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
    measure.batch_of = landings.batch_of = conditions.batch_of = batch_of


def plain_pieces(monkeypatch):
    """Call pieces of kernels in plain Python."""
    if not numba.config.DISABLE_JIT:
        monkeypatch.setattr(_jit.Deferred, "__call__", call)
        monkeypatch.setattr(type(_jit.fma), "__call__", evaluate)


def as_the_engine_chooses(monkeypatch):
    """Take special machine code and compiled pieces again until the test ends."""
    monkeypatch.setattr(measure, "advance", ADVANCE)
    monkeypatch.setattr(measure, "fitted", FITTED)
    for module in (measure, landings, conditions):
        monkeypatch.setattr(module, "batch_of", BATCH_OF)
    monkeypatch.setattr(_jit.Deferred, "__call__", CALL)
