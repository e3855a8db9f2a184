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

# SHA-256 of all measured numbers, computed on an AMD Zen 5; no library function takes part.
HASHES = {
    "high-bounce": "60a221e7ac75d93955b8879e389c94bb33f727a8db0c0c3bd611c3f1ef0e180b",
    "moving": "f49b4e5fed8bfe74086fa68d1e993830a0753f2d3cc49f5047ab73afd15ec05b",
    "sprung": "b66fb9ef61846efe2514802b417fb43dc1208956b2757589709041189f2ef210",
    "noise": "2329ba5f33602431b2a0634146914f8c2bd70dd07694ac1c807569c4ac1f6f08",
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
OF_NOISE = {
    "restitution_noise": 0.05,
    "kick_noise": 0.1,
    "drive_noise": 0.4,
    "duration": 15.0,
    "lyapunov": False,
}
OTHERS = {
    "moving": {"base": "moving"},
    "sprung": {"base": "sprung", **OF_MOUNT},
    "noise": OF_NOISE,
}
WIDTHS = {"128": "fma", "256": "avx2", "512": "avx512f"}


def of_scene(name):
    """Hash of all that a sweep measures; zeros and NaN have no sign."""
    result = vs.sweep(**SCENE | OTHERS.get(name, {}))
    digest = hashlib.sha256()
    for name in sorted(result.data_vars):
        values = result[name].values
        if values.dtype.kind == "f":
            values = np.where(np.isnan(values), np.nan, values + 0.0)
        digest.update(name.encode() + values.tobytes())
    return digest.hexdigest()


def of_width(bits, name):
    """Hash of a scene with registers of so many bits, from another process; None if there are none.

    The vectors that kernels use are chosen when the package is imported.
    """
    if not binding.get_host_cpu_features().get(WIDTHS[bits]):
        return None
    done = subprocess.run(
        [sys.executable, "-c", f"from test_same_bits import of_scene; print(of_scene({name!r}))"],
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


@pytest.mark.parametrize("name", HASHES)
def test_the_hashes_of_this_processor(name):
    assert of_scene(name) == HASHES[name]


@pytest.mark.weekly
@pytest.mark.skipif(config.DISABLE_JIT, reason="plain Python has no vector registers")
def test_the_hash_of_the_narrowest_width():
    # it compiles everything anew; this file as a script compares every scene at every width
    found = of_width("128", "noise")
    if found is None:
        pytest.skip(f"this processor has no {WIDTHS['128']}")
    assert found == HASHES["noise"]


if __name__ == "__main__":
    different = 0
    for bits, name in itertools.product(WIDTHS, HASHES):
        found = of_width(bits, name)
        different += found not in (None, HASHES[name])
        said = {None: "this processor has none", HASHES[name]: "as stored"}.get(found, "DIFFERENT")
        print(f"{name} at {bits} bits: {said}")
    sys.exit(1 if different else 0)
