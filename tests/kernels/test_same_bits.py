"""The same bits on every processor: stored hashes, for each width of vector registers."""

import hashlib
import itertools
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
# One base at each width, since all of it is compiled anew; `python tests/kernels/test_same_bits.py`
# compares every base at every width.
TAKEN = {"128": "high-bounce", "256": "moving", "512": "high-bounce"}


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


def of_width(bits, base):
    """Hash of a base with registers of so many bits, in a process of its own; None where none are.

    The vectors that kernels use are chosen when the package is imported.
    """
    if not binding.get_host_cpu_features().get(WIDTHS[bits]):
        return None
    done = subprocess.run(
        [sys.executable, "-c", f"from test_same_bits import of_base; print(of_base({base!r}))"],
        env={
            **os.environ,
            "VIBROSWEEP_VECTOR_BITS": bits,
            "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path]),
        },
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


@pytest.mark.parametrize("base", HASHES)
def test_the_hashes_of_this_processor(base):
    assert of_base(base) == HASHES[base]


@pytest.mark.skipif(config.DISABLE_JIT, reason="plain Python has no vector registers")
@pytest.mark.parametrize("bits", WIDTHS)
def test_the_hashes_of_each_width(bits):
    base = TAKEN[bits]
    found = of_width(bits, base)
    if found is None:
        pytest.skip(f"this processor has no {WIDTHS[bits]}")
    assert found == HASHES[base]


if __name__ == "__main__":
    different = 0
    for bits, base in itertools.product(WIDTHS, HASHES):
        found = of_width(bits, base)
        different += found not in (None, HASHES[base])
        said = {None: "this processor has none", HASHES[base]: "as stored"}.get(found, "DIFFERENT")
        print(f"{base} at {bits} bits: {said}")
    sys.exit(1 if different else 0)
