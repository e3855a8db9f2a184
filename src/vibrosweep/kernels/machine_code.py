"""What the compiler makes of the kernels on this processor."""

from __future__ import annotations

import re
from typing import NamedTuple

from numba import njit

from vibrosweep.kernels._jit import OPTIONS, Floats, wide_vectors
from vibrosweep.kernels.sine import sin_turns

__all__ = ["MachineCode", "inspect_sine", "read_assembly"]


class MachineCode(NamedTuple):
    """What the machine code of a loop uses.

    Attributes
    ----------
    vector_bits
        Width of its widest registers that hold several doubles; 64 where it holds single ones.
    fused
        Whether products and sums are fused by an instruction, and not by a call of a function.
    """

    vector_bits: int
    fused: bool


def inspect_sine() -> MachineCode:
    """Compile a loop over the sine of the kernels, their hottest part, and read its machine code.

    Machine code that was loaded from the disk cannot be read as text: this loop is compiled anew,
    with the options of the kernels, in 0.4 s.
    """
    loop = njit("void(float64[::1], float64[::1])", **OPTIONS)(_sines)
    (assembly,) = loop.inspect_asm().values()
    return read_assembly(assembly)


def read_assembly(assembly: str) -> MachineCode:
    """Find out what a text of assembly uses, of x86-64 or of AArch64."""
    packed = re.findall(r"\bvfn?m(?:add|sub)\w+pd\b.*%([xyz])mm", assembly)
    if packed:
        return MachineCode({"x": 128, "y": 256, "z": 512}[max(packed)], fused=True)
    if re.search(r"\bfml[as]\s+(v\d+\.2d|z\d+\.d)", assembly):
        return MachineCode(128, fused=True)
    calls_fma = re.search(r"(?<![\w.])_?fma\b", assembly)
    return MachineCode(64, fused=calls_fma is None)


def _sines(x: Floats, out: Floats) -> None:
    wide_vectors()
    for i in range(x.size):
        out[i] = sin_turns(x[i])
