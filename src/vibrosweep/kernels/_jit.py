"""How kernels are compiled: every decorator and option, the disk cache, the fused multiply-add.

Which decorator a function takes:

    jit          a piece that compiled callers inline: nearly every function
    part         a large piece with several callers, which the compiler may call instead
    kernel       an entry point that Python calls; its machine code is saved on disk
    uncounted    a kernel that neither allocates memory nor returns arrays, with cheaper tuples
    uncached     another entry point for a kernel, for functions that only this process has
    generic      a declaration without code, implemented for types: of a base, a law, a shape
    implements   the implementation for one type, or for several
    uncompiled   a generic function that Python calls too rarely to be worth compiling
    intrinsic    numba's own, for single instructions of the processor: the last functions here

Every rounding of the kernels is explicit: no fast-math flag is set, and products are fused
with sums only where `fma` says so.  A scalar loop, a vector loop and plain Python therefore give
the same bits, whatever the compiler makes of them.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import inspect
import threading
from collections import namedtuple
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from types import CellType, FunctionType
from typing import Any, Final, TypeVar

import numba
import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic, overload
from numpy.typing import NDArray

from vibrosweep.errors import ParameterError
from vibrosweep.kernels._numba import HAS_CACHE, HAS_PIECES, vector_bits
from vibrosweep.model.functions import is_function, outside, plain

__all__ = ["Floats", "jit", "kernel"]

if HAS_CACHE:
    from vibrosweep.kernels._cache import KernelCache, find_caches
if HAS_PIECES:
    from vibrosweep.kernels._pieces import PieceCompiler

F = TypeVar("F", bound=Callable[..., Any])
Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
Integers = NDArray[np.int64]
Flags = NDArray[np.int8]

# Division by zero gives inf or NaN, as in numpy; Python's exception would stop vectorisation.
# Nobody calls compiled code through a C pointer.
OPTIONS = {"error_model": "numpy", "nogil": True, "no_cfunc_wrapper": True}
# Python never calls a piece of a kernel either: wrappers for that would be a quarter of all code.
OF_A_PART = OPTIONS | {"no_cpython_wrapper": True}
if HAS_PIECES:
    OF_A_PART["pipeline_class"] = PieceCompiler
OF_A_PIECE = OF_A_PART | {"forceinline": True}
# Pieces inherit this from the kernel that they are compiled for.
UNCOUNTED = OPTIONS | {"_nrt": False}


@functools.cache
def sources_digest() -> str:
    """Return a digest of all kernel sources; numba itself checks the file of the entry point only.

    The order of fields in `vibrosweep.model`, and its codes, are part of the machine code too.
    """
    digest = hashlib.sha256(numba.__version__.encode())
    kernels = Path(__file__).parent
    beside = sorted((kernels.parent / "model").glob("*.py"))
    for path in [*sorted(kernels.rglob("*.py")), *beside]:
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


cache_directory: Path | None = None
read_only_caches: tuple[Path, ...] = ()
if HAS_CACHE and not numba.config.DISABLE_JIT:
    cache_directory, read_only_caches = find_caches(sources_digest())


@contextlib.contextmanager
def _caching_in(directory: Path) -> Iterator[None]:
    """Make numba place the cache of what is decorated inside in `directory`."""
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(directory)
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


def jit(function: F) -> F:
    """Compile a piece that kernels inline; it needs no cache.

    If Python calls it directly, each process compiles it again.
    """
    return _piece(function, OF_A_PIECE)


def part(function: F) -> F:
    """Compile a piece of a kernel as `jit` does, but let the compiler decide where to inline it.

    Large pieces that are called from several places compile faster this way.
    """
    return _piece(function, OF_A_PART)


ALONE: Final = njit(**OPTIONS)
_one_thread = threading.Lock()


class Deferred:
    """A function that is declared to numba when it is first called; a run needs few of them."""

    def __init__(self, function: Any, compiler: Callable[[Any], Any] = ALONE) -> None:
        self.py_func, self._compiler, self._dispatcher = function, compiler, None
        functools.update_wrapper(self, function)

    def __call__(self, *arguments: Any) -> Any:
        return self.dispatcher(*arguments)

    @property
    def dispatcher(self) -> Any:
        """Return numba's function; the lock keeps threads from compiling it twice."""
        with _one_thread:
            self._dispatcher = self._dispatcher or self._compiler(self.py_func)
        return self._dispatcher


def overloaded(
    function: Callable[..., Any],
    call: Callable[..., Any],
    code: Callable[..., Any],
    options: dict[str, Any] = OF_A_PIECE,
) -> Any:
    """Return a function that Python calls as `call`, and whose code compiled callers include.

    `code` returns that code for given types of arguments.
    """

    @functools.wraps(function)
    def piece(*arguments: Any) -> Any:
        return call(*arguments)

    piece.py_func = function  # type: ignore[attr-defined]
    if not numba.config.DISABLE_JIT:
        overload(piece, jit_options=options, strict=False)(code)
    return piece


def _piece(function: F, options: dict[str, Any]) -> F:
    if numba.config.DISABLE_JIT:
        return as_python(function)
    return overloaded(function, Deferred(function), lambda *_: function, options)  # type: ignore[no-any-return]


def kernel(function: F, directory: Path | None = None) -> F:
    """Compile an entry point; its machine code is saved on disk, one set for each set of sources.

    Another `directory` can be given for it.
    """
    return _cached(function, OPTIONS, directory)


def uncounted(function: F) -> F:
    """Compile an entry point that neither allocates memory nor returns arrays.

    References to arrays then need not be counted.  Numba counts them with an atomic operation
    wherever an array is taken out of a tuple, which can cost more than the arithmetic.
    """
    return _cached(function, UNCOUNTED)


def _cached(function: F, options: dict[str, Any], directory: Path | None = None) -> F:
    if numba.config.DISABLE_JIT:
        return as_python(function)

    def compiler(function: F) -> Any:
        dispatcher = njit(**options)(function)
        written = directory or cache_directory
        kept = () if written is None else (written,)
        if HAS_CACHE and (directories := (*kept, *read_only_caches)):
            with _caching_in(directories[0]):
                # as njit(cache=True) sets numba's own
                dispatcher._cache = KernelCache(function, directories[1:])
        return dispatcher

    return Deferred(function, compiler)  # type: ignore[return-value]


def uncached(function: F) -> F:
    """Return an entry point without disk cache, for functions that only this process has."""
    if numba.config.DISABLE_JIT:
        return function
    return Deferred(function.py_func, njit(**OPTIONS))  # type: ignore[attr-defined,return-value]


_implementations: dict[Any, dict[type, Any]] = {}


def generic(declared: F) -> F:
    """Turn a declaration without code into a function chosen by the type of its first argument.

    If that argument has a field `base`, the type of that field decides.  `implements` gives the
    code for a kind of named tuple; compiled callers choose when they are compiled, others when they
    call.
    """

    def implementation(kind: type) -> Any:
        try:
            return _implementations[piece][kind]
        except KeyError:
            raise TypeError(
                f"{declared.__name__} has no implementation for {kind.__name__}"
            ) from None

    def call(first: Any, *others: Any) -> Any:
        chooses = first.base if "base" in getattr(first, "_fields", ()) else first
        return implementation(type(chooses))(first, *others)

    def code(first: Any, *others: Any) -> Any:
        if "base" in getattr(first, "fields", ()):
            first = first[first.fields.index("base")]
        return inspect.unwrap(implementation(getattr(first, "instance_class", type(first))))

    piece: F = overloaded(declared, call, code)
    _implementations[piece] = {}
    return piece


def implements(function: F, *kinds: type) -> Callable[[F], F]:
    """Compile the code of a generic function for kinds of named tuples.

    A formula that is given as a lambda gets the name of a function, such as `ratio_constant`.
    """
    name = "_".join([function.__name__, *(kind.__name__.lower() for kind in kinds)])

    def keep(implementation: Any) -> Any:
        if implementation.__name__ == "<lambda>":
            code = implementation.__code__.replace(co_name=name, co_qualname=name)
            implementation.__code__, implementation.__name__ = code, name
        _implementations[function].update(dict.fromkeys(kinds, jit(implementation)))
        return implementation

    return keep


def uncompiled(function: F) -> F:
    """Return a generic function as plain Python, for calls too few to be worth compiling."""

    @functools.wraps(function)
    def call(first: Any, *others: Any) -> Any:
        return inspect.unwrap(_implementations[function][type(first)])(first, *others)

    return call  # type: ignore[return-value]


def _fma_exact(a: float, b: float, c: float) -> float:
    """A * b + c rounded once, in plain Python, for runs with the compiler switched off."""
    try:
        exact = float(Fraction(float(a)) * Fraction(float(b)) + Fraction(float(c)))
    except (OverflowError, ValueError):  # an infinity or a NaN takes part
        exact = float(a) * float(b) + float(c)
    return np.float64(exact)


@intrinsic
def _fma_instruction(typingctx: Any, a: Any, b: Any, c: Any) -> Any:
    """A * b + c rounded once, as the processor's instruction."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.fma(*args)

    return types.float64(types.float64, types.float64, types.float64), codegen


fma: Callable[[float, float, float], float] = (
    _fma_exact if numba.config.DISABLE_JIT else _fma_instruction
)


@intrinsic
def _prefetch_instruction(typingctx: Any, array: Any, i: Any) -> Any:
    """Begin to load the cache line of array[i] for writing; a contiguous array of one dimension."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        byte, flag = ir.IntType(8).as_pointer(), ir.IntType(32)
        place = builder.bitcast(builder.gep(data, [args[1]]), byte)
        kind = ir.FunctionType(ir.VoidType(), [byte, flag, flag, flag])
        fetch = builder.module.declare_intrinsic("llvm.prefetch", [byte], kind)
        builder.call(fetch, [place, flag(1), flag(3), flag(1)])  # to write, keep, data
        return context.get_dummy_value()

    return types.void(array, types.intp), codegen


prefetch: Callable[[NDArray[Any], int], None] = (
    (lambda array, i: None) if numba.config.DISABLE_JIT else _prefetch_instruction
)


@intrinsic
def _wide_vector_registers(typingctx: Any) -> Any:
    """Request vectors of `vector_bits` in the loops of the function that this is called in.

    Call it in the function that holds the loop: LLVM vectorises a loop before it inlines the
    function.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        bits = vector_bits()
        if bits is not None:  # `set.add`, because llvmlite itself does not know this attribute
            set.add(builder.function.attributes, f'"prefer-vector-width"="{bits}"')
        return context.get_dummy_value()

    return types.void(), codegen


wide_vectors: Callable[[], None] = (
    (lambda: None) if numba.config.DISABLE_JIT else _wide_vector_registers
)


# --- Kernels as plain Python ----------------------------------------------------------------------


def as_python(function: F) -> F:
    """Make plain Python divide by zero as machine code does, silently to an infinity or NaN.

    Numpy's floats do so, whereas Python's raise an exception; floats in arguments and results are
    therefore turned into numpy's.
    """

    @functools.wraps(function)
    def plain(*arguments: Any) -> Any:
        with np.errstate(all="ignore"):
            return _of_numpy(function(*map(_of_numpy, arguments)))

    return plain  # type: ignore[return-value]


def _of_numpy(value: Any) -> Any:
    """Turn a float, or the floats in a tuple, into numpy's."""
    if isinstance(value, float):
        return np.float64(value)
    if isinstance(value, tuple):
        items = map(_of_numpy, value)
        return type(value)(*items) if hasattr(value, "_fields") else tuple(items)
    return value


# --- Functions from outside the package -----------------------------------------------------------


def compiled_anew(
    function: Any, compiler: Callable[[Any], Any], done: dict[Any, Any] | None = None
) -> Any:
    """Compile a function from outside the package together with those that it calls.

    Their earlier machine code may hold old values of the numbers that they use, and may have been
    compiled with other options.  `done` holds the functions that have been compiled.
    """
    function, done = plain(function), {} if done is None else done
    if function not in done:
        names, code = dict(function.__globals__), function.__code__
        cells = {name: CellType() for name in code.co_freevars}
        enclosed, defaults = tuple(cells.values()), function.__defaults__
        fresh = FunctionType(code, names, function.__name__, defaults, enclosed)
        fresh.__kwdefaults__ = function.__kwdefaults__
        done[function] = compiler(fresh)
        for name, value in outside(function).items():
            anew = compiled_anew(value, compiler, done) if is_function(value) else value
            if name in cells:
                cells[name].cell_contents = anew
            else:
                names[name] = anew
    return done[function]


def require_compilable(
    function: Any, takes: tuple[Any, ...], compiler: Callable[[Any], Any], whose: str, *, real: bool
) -> None:
    """Raise a ParameterError if numba cannot compile a function for the types that it `takes`.

    If `real`, it must return a real number.
    """
    if numba.config.DISABLE_JIT:
        return
    tried = compiled_anew(function, compiler)
    try:
        tried.compile(takes)
    except Exception as error:  # the exceptions of numba have no common base
        reason = next(filter(str.strip, [*str(error).splitlines()[1:], str(error)])).strip()
        remedy = "call it as plain Python to find the mistake"
        raise ParameterError(f"{whose}: numba cannot compile it: {reason}; {remedy}") from error
    returned = tried.nopython_signatures[0].return_type
    if real and not isinstance(returned, types.Integer | types.Float | types.Boolean):
        raise ParameterError(f"{whose} returns {returned}; it must be a real number")


# --- Kinds ----------------------------------------------------------------------------------------
# Saved machine code is identified by the names of types.  The type of code from outside the package
# has a digest of that code in its name, so that machine code of an earlier version never runs.


def kind_named(name: str) -> type:
    """Return the type ``Kind_<name>``, a new one where there is none yet."""
    name = f"Kind_{name}"
    if name not in globals():
        globals()[name] = namedtuple(name, (), module=__name__)
    found: type = globals()[name]
    return found


def __getattr__(name: str) -> type:
    """Return a type that machine code on disk names; another process may have declared it."""
    if name.startswith("Kind_"):
        return kind_named(name.removeprefix("Kind_"))
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
