"""Widths of vectors; hot loops become vector code on every kind of processor."""

import os
import subprocess
import sys

import numba
import pytest
from llvmlite import binding

from vibrosweep.errors import VibrosweepError
from vibrosweep.kernels import _numba
from vibrosweep.kernels.impact import KIND_OF

compiles = pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")


@pytest.mark.parametrize(
    ("processor", "features", "bits"),
    [
        ("sapphirerapids", "+avx2,+avx512f,+fma", 512),
        ("znver4", "+avx512f", 512),
        ("znver3", "+avx2,-avx512f,+fma", None),
        ("skylake-avx512", "+avx512f", None),
        ("cascadelake", "+avx512f", None),
        ("neoverse-n1", "+neon", None),
    ],
)
def test_the_width_by_processor(monkeypatch, processor, features, bits):
    monkeypatch.setattr(_numba, "target", lambda: ("system", processor, features))
    monkeypatch.setattr(_numba, "SET_BITS", None)
    assert _numba.vector_bits() == bits
    monkeypatch.setattr(_numba, "SET_BITS", 256)
    assert _numba.vector_bits() == 256


@pytest.mark.parametrize(("text", "bits"), [("", None), ("128", 128), ("512", 512)])
def test_the_width_from_the_environment(monkeypatch, text, bits):
    monkeypatch.setenv(_numba.VARIABLE, text)
    assert _numba._set_by_environment() == bits


def test_a_width_that_does_not_exist_is_refused(monkeypatch):
    monkeypatch.setenv(_numba.VARIABLE, "1024")
    with pytest.raises(VibrosweepError, match=r"VIBROSWEEP_VECTOR_BITS=1024.*128, 256, 512 bits"):
        _numba._set_by_environment()


STEP = """
import re, sys
from numba import njit, typeof, types
from vibrosweep.kernels._jit import OPTIONS
from vibrosweep.kernels.advance import _step
from vibrosweep.kernels.impact import base_of
from vibrosweep.kernels.cycles import Chosen
from vibrosweep.kernels.statistics import KINDS
chosen = typeof(Chosen(base_of("BASE", "rest"), KINDS))
none = types.none
integer = types.int64
signature = (types.float64[::1], integer, chosen, types.float64, none, none, integer, integer)
# without references there is nothing for numba to remove before loops become vector code
step = njit(signature, _nrt=False, **OPTIONS)(_step.__wrapped__)
"""


def hot_loop(show, base, **environment):
    """Text that a fresh process prints about the kernels' hottest loop, compiled for a base."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_", "VIBROSWEEP_"))}
    done = subprocess.run(
        [sys.executable, "-c", STEP.replace("BASE", base) + show],
        env=inherited | environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


SHOW = r"""
(assembly,) = step.inspect_asm().values()
blocks = re.split(r"^\.LBB\w+:", assembly, flags=re.MULTILINE)
packed = [re.findall(r"vfn?m(?:add|sub)\w+pd.*%([xyz]mm)", block) for block in blocks]
masked = re.findall(r"\tvmaskmovp[ds]\t%[xy]mm.*\)$", assembly, flags=re.MULTILINE)
print(len(masked), *max(packed, key=len))
"""
AVX2 = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma,+bmi,+bmi2,+sse4.2"}


@compiles
@pytest.mark.parametrize(
    ("base", "bits", "register", "feature"),
    [
        pytest.param("high-bounce", 128, "xmm", "avx2", marks=pytest.mark.weekly),
        ("moving", 256, "ymm", "avx2"),
        ("moving", 512, "zmm", "avx512f"),
    ],
)
def test_the_hot_loop_uses_registers_of_the_width_that_is_asked_for(base, bits, register, feature):
    """There are no masked stores, which are slow on AMD processors with AVX2."""
    if not binding.get_host_cpu_features().get(feature):
        pytest.skip(f"this processor has no {feature}")
    environment = {"VIBROSWEEP_VECTOR_BITS": str(bits)} | (AVX2 if feature == "avx2" else {})
    masked, *registers = hot_loop(SHOW, base, **environment).split()
    assert len(registers) >= 11
    assert set(registers) == {register}
    assert masked == "0"


# numba's code before any optimisation, compiled for a plain ARMv8
ON_ARM = """
from llvmlite import binding
(text,) = step.inspect_llvm().values()
text = re.sub(r"^target (triple|datalayout).*$", "", text, flags=re.MULTILINE)
assert "x double>" not in text
binding.initialize_all_targets()
binding.initialize_all_asmprinters()
triple = "aarch64-unknown-linux-gnu"
arm = binding.Target.from_triple(triple).create_target_machine(cpu="generic", opt=3)
module = binding.parse_assembly(text)
module.triple, module.data_layout = triple, str(arm.target_data)
options = binding.create_pipeline_tuning_options(speed_level=3)
options.loop_vectorization = True
passes = binding.create_pass_builder(arm, options)
passes.getModulePassManager().run(module, passes)
print(arm.emit_assembly(module))
"""


@compiles
@pytest.mark.parametrize(
    "base",
    ["moving", *(pytest.param(b, marks=pytest.mark.weekly) for b in KIND_OF if b != "moving")],
)
def test_the_hot_loop_becomes_vector_code_on_arm(base):
    plain = {"NUMBA_OPT": "0", "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    try:
        assembly = hot_loop(ON_ARM, base, **plain)
    except AssertionError as error:
        if "No available targets" in str(error):
            pytest.skip("this LLVM has no code for ARM")
        raise
    # a packed fused multiply-add for each `fma` of the source, and no call of a library
    packed = [line for line in assembly.splitlines() if "\tfmla\t" in line and ".2d" in line]
    assert len(packed) >= 10
    assert "\tbl\tfma" not in assembly
