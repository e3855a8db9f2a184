"""Private names of numba, which any version may change, and the width of vector registers.

The names are imported here, and nowhere else.  Where numba lacks one that only saves time, the
package works without it, and `vibrosweep doctor` reports the cost.
"""

from __future__ import annotations

import os
from typing import Any, Final

import numba
from llvmlite import binding

from vibrosweep.errors import VibrosweepError

__all__ = [
    "HAS_CACHE",
    "HAS_PIECES",
    "CompileResultCacheImpl",
    "CompilerBase",
    "DefaultPassBuilder",
    "FunctionCache",
    "IndexDataCacheFile",
    "JITCodeLibrary",
    "Listener",
    "LoweringPass",
    "NativeLowering",
    "UserProvidedCacheLocator",
    "lost",
    "make_function",
    "register",
    "register_pass",
    "remedy",
    "start_runtime",
    "target",
]

OLDEST, NEWEST = "0.62.0", "0.68.1"  # with which the package was tried
lost: Final[dict[str, str]] = {}  # names that this numba lacks, and what their absence costs


def remedy() -> str:
    """Return what to do about names that this numba lacks."""
    return (
        f"versions {OLDEST} to {NEWEST} were tried, this is {numba.__version__}: "
        f"python -m pip install 'numba>={OLDEST},<={NEWEST}'"
    )


def _absent(error: ImportError) -> str:
    return str(error).partition(" (")[0]  # without the path of a file


def _do_without(error: ImportError, cost: str) -> None:
    lost[_absent(error)] = cost


try:
    from numba._dynfunc import make_function
    from numba.core.codegen import JITCodeLibrary
    from numba.core.compiler import CompilerBase, DefaultPassBuilder
    from numba.core.compiler_machinery import LoweringPass, register_pass
    from numba.core.typed_passes import NativeLowering
except ImportError as error:
    _do_without(error, "kernels take longer to compile")
    HAS_PIECES = False
else:
    HAS_PIECES = True

try:
    from numba.core.caching import (
        CompileResultCacheImpl,
        FunctionCache,
        IndexDataCacheFile,
        UserProvidedCacheLocator,
    )
except ImportError as error:
    _do_without(error, "machine code is not saved, every process compiles its kernels again")
    HAS_CACHE = False
else:
    HAS_CACHE = True

try:
    from numba.core.runtime import rtsys
except ImportError as error:
    _do_without(error, "saved machine code takes longer to load")

    def start_runtime(context: Any) -> None:
        """Load all that numba can compile, and with it what counts references."""
        context.refresh()
else:
    start_runtime = rtsys.initialize

try:
    from numba.core.event import Listener, register
except ImportError as error:
    _do_without(error, "no message says that a kernel is being compiled, which takes longer")

    Listener = object

    def register(kind: str, listener: Any) -> None:
        """Call no listener."""


def target() -> tuple[str, str, str]:
    """Return the system, the processor and its features for which numba compiles.

    This is what numba itself takes from LLVM, and writes into the keys of machine code.
    """
    config, features = numba.config, binding.get_host_cpu_features()
    if not config.ENABLE_AVX:
        features.update({name: False for name in features if name.startswith("avx")})
    stated = features.flatten() if config.CPU_FEATURES is None else config.CPU_FEATURES
    processor = binding.get_host_cpu_name() if config.CPU_NAME is None else config.CPU_NAME
    return binding.get_process_triple(), processor, stated


# --- Width of vector registers --------------------------------------------------------------------
# On Intel processors with AVX-512 LLVM chooses 256 bits, because on the first of them 512 bits
# lowered the clock of the whole core.  512 bits make the streaming kernel 1.3 to 2 times as fast on
# an Emerald Rapids and 1.4 to 1.5 times on a Zen 4.  They are therefore requested on all processors
# that have them, except on that first family.


VARIABLE: Final = "VIBROSWEEP_VECTOR_BITS"
WIDTHS: Final = ("128", "256", "512")
# LLVM's names of Skylake servers and of later processors with the same core
SLOWER_WITH_512: Final = frozenset({"skylake-avx512", "cascadelake", "cooperlake", "cannonlake"})


def _set_by_environment() -> int | None:
    """Return the width that the environment sets; None where it sets none."""
    text = os.environ.get(VARIABLE, "")
    if text not in ("", *WIDTHS):
        raise VibrosweepError(
            f"{VARIABLE}={text}: the width of vector registers is one of {', '.join(WIDTHS)} bits; "
            f"unset it to leave the choice to the package"
        )
    return int(text) if text else None


SET_BITS: Final = _set_by_environment()


def vector_bits() -> int | None:
    """Return the width that is requested from the compiler; None leaves the choice to it."""
    if SET_BITS is not None:
        return SET_BITS
    _, processor, features = target()
    has_512 = "+avx512f" in features.split(",")
    return 512 if has_512 and processor not in SLOWER_WITH_512 else None
