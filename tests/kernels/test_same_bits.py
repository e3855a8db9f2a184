"""The same bits on every processor: stored hashes, for each width of vector registers."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from llvmlite import binding
from numba import config

import vibrosweep as vs

# SHA-256 of every measured number, as it was on an AMD Zen 5; no function of a library takes part.
HASHES = {
    "high-bounce": "60a221e7ac75d93955b8879e389c94bb33f727a8db0c0c3bd611c3f1ef0e180b",
    "moving": "f49b4e5fed8bfe74086fa68d1e993830a0753f2d3cc49f5047ab73afd15ec05b",
    "sprung": "b66fb9ef61846efe2514802b417fb43dc1208956b2757589709041189f2ef210",
}
SCENE = {
    "restitution": [0.0, 0.3, 0.55, 0.7, 0.8, 0.85, 0.9, 0.95],
    "amplitude": [0.0, 0.4, 0.9, 1.7, 2.6, 3.5],
    "frequency": 1.3,
    "phase": 0.7,
    "particles": 4,
    "duration": 40.0,
    "lyapunov": True,
    "per_particle": True,
}
OF_MOUNT = {
    "mass_ratio": 0.05,
    "mount_frequency": 3.0,
    "restitution": [0.3, 0.8, 0.9],
    "duration": 8.0,
    "lyapunov": False,
    "joint": True,
}
WIDTHS = {"128": "fma", "256": "avx2", "512": "avx512f"}
SHOW = """
from test_same_bits import of_base
for base in ("high-bounce", "moving"):
    print(of_base(base))
"""


def of_base(base):
    """Hash of all that a sweep measures; zeros and NaN have no sign."""
    scene = SCENE | (OF_MOUNT if base == "sprung" else {})
    result = vs.sweep(base=base, **scene)
    digest = hashlib.sha256()
    for name in sorted(result.data_vars):
        values = result[name].values
        if values.dtype.kind == "f":
            values = np.where(np.isnan(values), np.nan, values + 0.0)
        digest.update(name.encode() + values.tobytes())
    return digest.hexdigest()


def test_the_base_of_finite_mass():
    assert of_base("sprung") == HASHES["sprung"]


@pytest.mark.skipif(config.DISABLE_JIT, reason="plain Python has no vector registers")
@pytest.mark.parametrize("bits", WIDTHS)
def test_the_hashes_of_each_width(bits):
    if not binding.get_host_cpu_features().get(WIDTHS[bits]):
        pytest.skip(f"this processor has no {WIDTHS[bits]}")
    path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    done = subprocess.run(
        [sys.executable, "-c", SHOW],
        env={**os.environ, "VIBROSWEEP_VECTOR_BITS": bits, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split() == [HASHES["high-bounce"], HASHES["moving"]]
