"""Reading machine code."""

import numba
import pytest
from llvmlite import binding

from vibrosweep.kernels.machine_code import MachineCode, inspect_sine, read_assembly


@pytest.mark.parametrize(
    ("assembly", "expected"),
    [
        ("\tvfmadd213pd\t%zmm3, %zmm1, %zmm2\n\tvfmadd231sd\t%xmm1, %xmm2, %xmm3", (512, True)),
        ("\tvfnmadd213pd\t(%rax), %ymm1, %ymm2", (256, True)),
        ("\tvfmsub213pd\t%xmm3, %xmm1, %xmm2", (128, True)),
        ("\tvfmadd231sd\t%xmm1, %xmm2, %xmm3", (64, True)),
        ("\tmovabsq\t$fma, %rbp\n\tcallq\t*%rbp", (64, False)),
        ("\tcallq\tfma@PLT", (64, False)),
        ("\tfmla\tv3.2d, v1.2d, v2.2d", (128, True)),
        ("\tfmadd\td0, d1, d2, d3", (64, True)),
        ("\tbl\tfma", (64, False)),
    ],
)
def test_registers_in_assembly(assembly, expected):
    assert read_assembly(assembly) == MachineCode(*expected)


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
def test_the_sine_uses_the_instructions_of_this_processor():
    code = inspect_sine()
    features = binding.get_host_cpu_features()
    assert code.fused == bool(features.get("fma") or features.get("neon"))
    widest = max(
        w
        for w, name in ((512, "avx512f"), (256, "avx2"), (128, "neon"), (64, "64bit"))
        if features.get(name) or w == 64
    )
    assert code.vector_bits <= widest
    assert code.vector_bits > 64 or not code.fused
