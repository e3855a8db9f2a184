"""What tests run in place of the engine's own choice, so that less is compiled.

Without a window, without cycles, or without lift-offs the engine takes machine code of its own,
which gives the same bits.  Over the high-bounce base, with constant restitution, a sine, no noise
and the statistics of every sweep, the tests use all of it; elsewhere that which serves every case.
Noise of some kinds is computed by the machine code of all kinds, with strengths of 0; landings are
the same to the bit, and means add the same numbers in other partial sums.
Kernels of the scenes in `PLAIN` run as plain Python, which gives the same bits, and so do pieces of
kernels that a test in `tests/kernels` calls.  `tests/kernels/test_machine_code.py` and
`tests/kernels/test_bases.py` compare them; `python -m pytest --machine-code` compiles everything.
"""

import threading
from functools import wraps

import numba
import numpy as np

from vibrosweep.analysis import conditions
from vibrosweep.engine import landings, measure
from vibrosweep.kernels import _jit
from vibrosweep.kernels.bases.high_bounce import HighBounce
from vibrosweep.kernels.bases.moving import Moving, MovingHarmonics, MovingParabolic
from vibrosweep.kernels.coupled.realizations import Coupled
from vibrosweep.kernels.cycles import CYCLE, empty_rests
from vibrosweep.kernels.restitution import Rest
from vibrosweep.kernels.statistics import KINDS, KINDS_COUPLED
from vibrosweep.model.parameters import Mounts

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


class Here(threading.local):
    """Whether this thread is inside of a kernel that runs as plain Python."""

    inside = False


here, PIECES = Here(), []  # tests in `tests/kernels` put an item into the list
one_rounding = numba.njit(lambda a, b, c: _jit.fma(a, b, c))


CLOSED = {"find_closed", "correct", "put_values", "describe"}
FIXED = {"find_fixed", "end_errors", "conditions", "orbits_hold"}
EVERYTHING = {"record", "sweep", "observe", "separate", "find_order", "settle", "trust"}
# By the types of a scene, what runs as plain Python
PLAIN = {
    "Reflect": {"find_order", "shortest_flights"},
    "Plastic": FIXED | CLOSED,
    "Viscoelastic": FIXED | {"observe", "record"},
    "Points": EVERYTHING | FIXED | CLOSED,
    "Kind": EVERYTHING - {"record"},  # a law from outside the package
    "Harmonics": FIXED | CLOSED - {"find_closed"} | {"settle"},
    "MovingHarmonics": (EVERYTHING | FIXED | CLOSED) - {"record"},
    "MovingParabolic": EVERYTHING | FIXED | CLOSED,
    "Parabolic": EVERYTHING | FIXED | CLOSED,
    "Noise": {"settle", "trust"},
}
# Of scenes with both, everything
TOGETHER = {"Reflect", "Noise"}, {"Moving", "Plastic"}
# The same over a base of finite mass
PLAIN_JOINTLY = {"Plastic": {"record", "sweep"}, "Mounts": {"observe"}}


def asked(function, arguments):
    """Return what a kernel computes, and of which scene."""
    name, scene = function.py_func.__name__, arguments
    for argument in arguments:
        base = getattr(argument, "base", argument)
        if isinstance(base, HighBounce | Moving | MovingHarmonics | MovingParabolic):
            scene = base
        elif isinstance(argument, Coupled):
            scene = argument.mounts
    if name == "advance":
        options, found = arguments[2], arguments[5]
        more = len(found.kinds) > len(KINDS)
        name = "record" if options.observer is not None else "observe" if more else "sweep"
    elif name == "advance_coupled":
        more = len(arguments[5].realizations.kinds) > len(KINDS_COUPLED)
        name = "observe" if more else "sweep"
    return name, scene


def compiled(function, arguments):
    """Return whether tests run a kernel, or a piece of one, as machine code."""
    if function._compiler is _jit.ALONE:
        return not PIECES
    name, scene = asked(function, arguments)
    rules = PLAIN_JOINTLY if isinstance(scene, Mounts) else PLAIN
    kinds = {type(one).__name__.partition("_")[0] for one in (scene, *scene)}
    if PLAIN and any(kinds >= both for both in TOGETHER):
        return False
    return not any(name in rules.get(kind, ()) for kind in kinds)


def plain(function, *arguments):
    """Call a function with the floats of numpy, which divide by zero as machine code does."""
    result = function.py_func(*[np.float64(a) if type(a) is float else a for a in arguments])
    if isinstance(result, tuple):
        return _jit._of_numpy(result)
    return np.float64(result) if type(result) is float else result


def call(function, *arguments):
    """Call a kernel or a piece of one as machine code or as plain Python."""
    if here.inside:
        return plain(function, *arguments)
    if compiled(function, arguments):
        return CALL(function, *arguments)
    here.inside = True
    try:
        with np.errstate(all="ignore"):
            return plain(function, *arguments)
    finally:
        here.inside = False


def evaluate(intrinsic, *arguments):
    """Do what an instruction does of which there is no function."""
    return np.float64(one_rounding(*arguments)) if intrinsic is _jit.fma else None


def in_tests(machine_code=False):
    """Take general machine code in this process, and plain Python for rare scenes.

    With `machine_code`, take what the engine chooses, apart from pieces that a test calls.
    """
    if machine_code:
        PLAIN.clear()
        PLAIN_JOINTLY.clear()
    else:
        measure.advance, measure.fitted = advance, fitted
        measure.batch_of = landings.batch_of = conditions.batch_of = batch_of
    if not numba.config.DISABLE_JIT:
        _jit.Deferred.__call__, type(_jit.fma).__call__ = call, evaluate


def everything_plain(monkeypatch):
    """Compile nothing until the test ends."""
    monkeypatch.setattr(f"{__name__}.compiled", lambda function, arguments: False)


def as_the_engine_chooses(monkeypatch):
    """Take special machine code and compiled pieces again until the test ends."""
    monkeypatch.setattr(measure, "advance", ADVANCE)
    monkeypatch.setattr(measure, "fitted", FITTED)
    for module in (measure, landings, conditions):
        monkeypatch.setattr(module, "batch_of", BATCH_OF)
    monkeypatch.setattr(_jit.Deferred, "__call__", CALL)
