"""A design is one function and one registration: in memory, in files, in plans and in `verify`."""

import numpy as np
import pytest

import vibrosweep as vs
from tests.extension.log_uniform import log_uniform
from vibrosweep.proof.verifying import verify
from vibrosweep.runs.chunks import identity
from vibrosweep.scene.sweep import keyword_spec

SWEEP = {
    "restitution": (0.8, 0.98),
    "amplitude": (0.01, 10.0),
    "design": "log-uniform",
    "realizations": 200,
    "seed": 4,
    "duration": 3.0,
}
MOUNT = {"mass_ratio": 0.01, "mount_frequency": 2.0}


@pytest.mark.parametrize("base", ["high-bounce", "moving", "sprung"])
def test_values_are_uniform_on_a_logarithmic_scale(base):
    found = vs.sweep({**SWEEP, "base": base, **(MOUNT if base == "sprung" else {})})
    decades = np.log10(found.amplitude.values)
    assert -2.0 <= decades.min() < -1.9 < 0.9 < decades.max() <= 1.0
    assert np.histogram(decades, bins=3)[0].min() > 45
    assert found.attrs["design"] == "log-uniform"


def test_a_file_in_chunks_holds_the_same_bits_and_passes_verify(tmp_path):
    path = tmp_path / "out.h5"
    with vs.run(SWEEP, path, chunk=23, threads=1) as found:
        in_memory = vs.sweep(SWEEP)
        assert np.array_equal(found.amplitude, in_memory.amplitude)
        assert np.array_equal(found.rebound_height_max, in_memory.rebound_height_max)
    assert verify(path, sample=5).passed


def test_an_edited_function_is_another_sweep(monkeypatch):
    from vibrosweep.scene import design

    before = identity(keyword_spec(SWEEP))
    monkeypatch.setattr(design, "DESIGNS", dict(design.DESIGNS))
    vs.register_design("log-uniform", lambda unit, low, high: low * (high / low) ** (unit * unit))
    now = identity(keyword_spec(SWEEP))
    assert {key for key in now if now[key] != before[key]} == {"code of the design"}


def test_a_name_that_is_taken_is_refused():
    with pytest.raises(vs.errors.ParameterError, match="taken"):
        vs.register_design("sobol", log_uniform)
