"""Checks of the kernels: machine code, and the cache on disk."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numba
from numba.core.registry import cpu_target

from vibrosweep.doctor import Finding
from vibrosweep.kernels._cache import variants
from vibrosweep.kernels._jit import cache_directory
from vibrosweep.kernels.vectors import VARIABLE, vector_bits

# Processor features by LLVM's names: the bits of their vectors; those with fused multiply-add.
WIDTHS: Final = {"avx": 256, "avx2": 256, "avx512f": 512, "neon": 128}
FUSED: Final = ("fma", "neon")


def vector_registers() -> Finding:
    """Check the instruction set that numba compiles for, which the environment can change."""
    subject = "vector registers"
    if numba.config.DISABLE_JIT:
        return Finding(subject, "none: nothing is compiled", _unset("NUMBA_DISABLE_JIT"))
    _, processor, stated = cpu_target.target_context.codegen().magic_tuple()
    features = re.findall(r"\+([\w.-]+)", stated)
    fused = any(name in features for name in FUSED)
    # without the instruction each fused multiply-add is a function call, which is never vectorised
    bits = max((WIDTHS[name] for name in features if name in WIDTHS), default=64) if fused else 64
    words = "fused multiply-add by instruction" if fused else "no fused multiply-add"
    requested = vector_bits()
    choice = "the compiler's choice" if requested is None else f"{requested} bits requested"
    state = (
        f"{min(bits, requested or bits)} bits, {words}, compiled for {processor}; {choice}, which "
        f"{VARIABLE} changes"
    )
    if fused and numba.config.OPT == 3:
        return Finding(subject, state)
    return Finding(subject, state, f"results are correct, but slow: {_reason_for_scalar_code()}")


def _reason_for_scalar_code() -> str:
    if numba.config.OPT != 3:
        return _unset("NUMBA_OPT")
    if numba.config.CPU_NAME or numba.config.CPU_FEATURES:
        return _unset("NUMBA_CPU_NAME and NUMBA_CPU_FEATURES")
    return "this processor has no fused multiply-add; use one that has (x86-64-v3, or AArch64)"


def _unset(variable: str) -> str:
    return f"the environment switches the compiler's optimisation off: unset {variable}"


def kernel_cache(directory: Path | None = cache_directory) -> Finding:
    """Check the machine code of exactly these sources that is cached on disk."""
    subject = "kernel cache"
    if numba.config.DISABLE_JIT:
        return Finding(subject, "not used: nothing is compiled")
    if directory is None:
        advice = "set NUMBA_CACHE_DIR to a directory that can be written"
        return Finding(subject, "none", f"each run compiles the kernels again: {advice}")
    found = variants(directory)
    size = sum(file.stat().st_size for file in directory.rglob("*") if file.is_file())
    state = f"{found.usable} compiled variants of these sources for this processor"
    if found.foreign:
        state += f", {found.foreign} for others"
    state += f", {size / 2**20:.1f} MiB in {directory}, which can be written"
    if found.usable == 0:
        state += "; a run compiles the variants that it needs, vibrosweep warmup all of them"
    if found.damaged:
        trouble = (
            f"damaged or missing files: {found.damaged}; they are not used, vibrosweep warmup "
            f"writes them again, or delete {directory}"
        )
        return Finding(subject, state, trouble)
    return Finding(subject, state)
