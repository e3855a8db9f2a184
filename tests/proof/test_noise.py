"""Results with noise: trajectories under the stored noise stream are proved like any others."""

import h5py
import pytest

import vibrosweep as vs
from tests.scenes import RIGID
from vibrosweep.proof.report import State

NOISE = {"restitution_noise": 0.3, "kick_noise": 0.2}
RECORD = {"restitution": 0.4, "amplitude": 0.3, "duration": 2.5}
# noise reverses some kicks, and the kick jumps where a forcing period begins
DRIVE = {"drive_noise": 0.9, "contact_time": 0.06, "record": RECORD}


@pytest.mark.parametrize(
    "scene",
    [
        DRIVE,
        {**DRIVE, "phase": 8.0, "trust": True},
        {"base": "moving"},
        {"base": "sprung", "mass_ratio": 0.05, "mount_frequency": 2.3, **RIGID},
    ],
    ids=["high-bounce", "turned", "moving", "sprung"],
)
def test_the_stored_stream_is_proved(scene, tmp_path):
    path = tmp_path / "noisy.h5"
    asked = {"restitution": (0.5, 0.95), "amplitude": (0.2, 2.0), "realizations": 4, "seed": 1}
    asked |= {**NOISE, **scene, "particles": 2, "duration": 2.5, "noise_seed": 5}
    vs.run(asked, path).close()
    report = vs.verify(path)
    assert report.passed
    assert report.count(State.COMPARED) == report.total == 4
    assert not report.not_compared()
    for name, found in report.variables().items():
        assert found.errors, name
        assert not found.undecided
    with h5py.File(path, "r+") as file:
        file["noise_stream"][2] += 1.0
    outside = vs.verify(path).variables()
    assert outside["noise_stream"].outside
    assert outside["rebound_height_mean"].outside == {"realization 2"}
