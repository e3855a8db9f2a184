"""A law of another package: its orbit, its proof, and an edit."""

from importlib import import_module

import numba
import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.errors import ParameterError
from vibrosweep.model.restitution_laws import OUTSIDE, RESTITUTION_LAWS

SCENE = {
    "restitution": 0.9,
    "amplitude": 1.2,
    "restitution_law": "softening",
    "restitution_speed": 4.905,
}


@pytest.fixture(scope="module", autouse=True)
def law():
    """The law, registered for these tests only."""
    others = list(RESTITUTION_LAWS)
    yield import_module("tests.extension.softening").SOFTENING
    RESTITUTION_LAWS[:] = others
    OUTSIDE.clear()


def test_each_rebound_speed_follows_the_law(law):
    found = vs.simulate(**SCENE, duration=12.0).isel(realization=0, particle=0)
    unit = 9.81 / 2.0
    speeds = np.concatenate([[5.0], found.rebound_velocity.values]) / unit
    kicks = 1.2 * np.sin(2.0 * np.pi * found.landing_time.values) / unit
    for v, w, kick, rested in zip(speeds, speeds[1:], kicks, found.rested.values, strict=False):
        expected = law.ratio(0.9, v) * v + kick
        assert rested == (expected <= 1e-4)
        if not rested:
            assert w == pytest.approx(expected, rel=1e-10)


def test_verification_passes(tmp_path):
    sweep = {
        **SCENE,
        "amplitude": (0.2, 3.5),
        "restitution": (0.3, 0.98),
        "realizations": 4,
        "seed": 1,
        "particles": 2,
        "duration": 6.0,
        "trust": True,
    }
    vs.run(sweep, tmp_path / "out.h5").close()
    assert vs.verify(tmp_path / "out.h5").passed


def test_an_invalid_law_is_refused(law):
    with pytest.raises(ParameterError, match="this package"):
        vs.register_law(vs.Law("plastic", law.ratio, law.slope, law.bend))
    with pytest.raises(ParameterError, match="ratio must take 2 arguments"):
        vs.Law("other", law.bend, law.slope, law.bend)


@pytest.mark.skipif(bool(numba.config.DISABLE_JIT), reason="nothing is compiled")
@pytest.mark.parametrize(
    ("ratio", "message"),
    [
        (lambda e, s: e * 1j, "its ratio returns complex128; it must be a real number"),
        (lambda e, s: e.colour, "its ratio: numba cannot compile it: .*colour"),
    ],
)
def test_a_ratio_that_is_no_real_number_is_refused(law, ratio, message):
    vs.register_law(vs.Law("wrong", ratio, law.slope, law.bend))
    with pytest.raises(ParameterError, match=f"law 'wrong': {message}"):
        vs.simulate(**SCENE | {"restitution_law": "wrong"}, duration=2.0)
