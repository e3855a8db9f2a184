"""The kernels: threads that run them, machine code that is made of them, and where it is kept."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Final

import numba
from llvmlite import binding

from vibrosweep.doctor.finding import Finding
from vibrosweep.kernels import _jit
from vibrosweep.kernels._cache import variants
from vibrosweep.kernels.advance import advance

__all__ = ["kernel_cache", "threads", "vector_registers"]

# Modules of numba that hold a threading layer, and files of OpenMP libraries.
LAYERS: Final = {"tbbpool": "TBB", "omppool": "OpenMP", "workqueue": "workqueue"}
OPENMP: Final = re.compile(r"lib(?:gomp|iomp5|omp)\b[^/\s]*")


def threads() -> Finding:
    """Look at what runs the kernels in parallel, as it is loaded in this process."""
    if numba.config.DISABLE_JIT:
        return Finding("threads", "kernels run as plain Python", _unset("NUMBA_DISABLE_JIT"))
    own = "Python threads around kernels that release the interpreter"
    layers = [name for module, name in LAYERS.items() if f"numba.np.ufunc.{module}" in sys.modules]
    state = f"{own}; {_loaded('threading layer of numba', layers)}; "
    state += _loaded("OpenMP library", _openmp())
    if advance.targetoptions["nogil"]:  # type: ignore[attr-defined]
        return Finding("threads", state)
    return Finding("threads", state, "the kernels hold the interpreter: install the package again")


def _loaded(kind: str, found: list[str]) -> str:
    return f"{kind} loaded, not used: {', '.join(found)}" if found else f"no {kind} is loaded"


def _openmp() -> list[str]:
    """OpenMP libraries in the memory of this process, where the system shows it."""
    try:
        return sorted(set(OPENMP.findall(Path("/proc/self/maps").read_text(encoding="utf-8"))))
    except OSError:
        return []


def vector_registers() -> Finding:
    """Look at the machine code of the kernels' hottest part, compiled now."""
    subject = "vector registers"
    if numba.config.DISABLE_JIT:
        return Finding(subject, "none: nothing is compiled", _unset("NUMBA_DISABLE_JIT"))
    from vibrosweep.kernels.machine_code import inspect_sine
    from vibrosweep.kernels.vectors import VARIABLE, vector_bits

    code, processor = inspect_sine(), binding.get_host_cpu_name()
    fused = "fused multiply-add by instruction" if code.fused else "no fused multiply-add"
    state = f"{code.vector_bits} bits, {fused}, in a loop of the sine compiled for {processor}"
    if numba.config.CPU_NAME:
        state += f" as {numba.config.CPU_NAME}"
    asked = vector_bits()
    asked_for = "the compiler's choice" if asked is None else f"{asked} bits asked for"
    state += f"; {asked_for}, {VARIABLE} sets another"
    if code.fused and code.vector_bits > 64:
        return Finding(subject, state)
    return Finding(subject, state, f"results are right, but slow to come: {_slow()}")


def _slow() -> str:
    """Say why machine code is scalar."""
    if numba.config.OPT != 3:
        return _unset("NUMBA_OPT")
    if numba.config.CPU_NAME or numba.config.CPU_FEATURES:
        return _unset("NUMBA_CPU_NAME and NUMBA_CPU_FEATURES")
    return "this processor has no fused multiply-add; use one that has (x86-64-v3, or AArch64)"


def _unset(variable: str) -> str:
    return f"the environment turns the compiler's work off: unset {variable}"


def kernel_cache() -> Finding:
    """Look at the machine code on disk that these very sources have."""
    subject, directory = "kernel cache", _jit.cache_directory
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
        state += "; the next run compiles what it needs, vibrosweep warmup all there is"
    if found.damaged:
        return Finding(subject, state, f"{found.damaged} are damaged: delete {directory}")
    return Finding(subject, state)
