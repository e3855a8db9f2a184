"""Width of the vector registers of hot loops.

On Intel processors with AVX-512 LLVM chooses 256 bits, because on the first of them 512 bits
lowered the clock of the whole core.  512 bits make the streaming kernel 1.3 to 2 times as fast on
an Emerald Rapids and 1.4 to 1.5 times on a Zen 4.  They are therefore requested on all processors
that have them, except on that first family.
"""

from __future__ import annotations

import os
from typing import Final

from vibrosweep.errors import VibrosweepError
from vibrosweep.kernels._numba import target

VARIABLE: Final = "VIBROSWEEP_VECTOR_BITS"
WIDTHS: Final = ("128", "256", "512")
# LLVM's names of Skylake servers and of what followed with the same core
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
