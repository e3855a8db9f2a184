"""A base of finite mass with other waveforms than the sine, against proved trajectories."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.proof.reference.laws import Laws
from vibrosweep.proof.reference.sprung import coupled
from vibrosweep.scene.scene import waveform_of

SCENE = {"restitution": 0.3, "amplitude": 3.2, "phase": 0.3, "contact_time": 1e-2}
SCENE |= {"launch_velocity": 3.0}
SCENE |= {"mass_ratio": 0.2, "mount_frequency": 1.6, "mount_damping": 0.1}
LAUNCHES = [0.0, 0.3, 0.55]
DURATION = 2.5
SHAPES = [{"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}, "parabolic"]
# interpreted, since compiling would take longer than a few dozen landings
FOLLOW = """
import json, sys
import vibrosweep as vs
shapes, scene = json.load(sys.stdin)
found = []
for shape in shapes:
    one = vs.simulate(base="sprung", waveform=shape, **scene)
    names = ("landing_time", "liftoff_time", "rebound_velocity")
    found.append([one[name].values[0].tolist() for name in names])
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def followed():
    given = SCENE | {"launch_time": LAUNCHES, "duration": DURATION}
    ran = subprocess.run(
        [sys.executable, "-c", FOLLOW],
        input=json.dumps([SHAPES, given]),
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(ran.stdout)


@pytest.mark.parametrize("number", range(len(SHAPES)))
def test_landings_are_those_of_the_proof(followed, number):
    """Under a load, with rests and lift-offs."""
    shape = SHAPES[number]
    waveform = waveform_of(shape)
    given = {name: one.default for name, one in PARAMETERS.items()} | SCENE
    proved = coupled(given, LAUNCHES, DURATION, laws=Laws(waveform=waveform))
    rests = 0
    for particle, known in enumerate(proved.particles):
        rows = [np.array(row[particle], dtype=float) for row in followed[number]]
        for k, impact in enumerate(known.impacts):
            rests += impact.rested
            exact = (impact.landing_time, impact.liftoff_time, impact.rebound_velocity)
            for row, value in zip(rows, exact, strict=True):
                expected = np.nan if value is None else float(value)
                assert row[k] == pytest.approx(expected, rel=0.0, abs=1e-10, nan_ok=True)
        assert np.isnan(rows[0][len(known.impacts) :]).all()
    assert rests > 2
