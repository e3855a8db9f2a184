"""Flights over a parabolic base against exact rational arithmetic and proved trajectories."""

import json
import os
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest

from vibrosweep.kernels.arithmetic import HALF_ULP
from vibrosweep.kernels.bases.chained import first_guess, try_stretch
from vibrosweep.kernels.bases.moving import ChainedConstants
from vibrosweep.kernels.bases.moving_errors import along
from vibrosweep.kernels.impact import base_of
from vibrosweep.kernels.noise import SILENT, STILL
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.model.shapes import Waveform
from vibrosweep.proof.reference.trajectories import trajectory

SHAPE = Waveform("parabolic")


def fixed_of(alpha):
    x_lift = 0.25 if alpha > 0.5 else np.nan
    base = base_of("moving", "rest", SHAPE)
    return ChainedConstants(base, 0.8, alpha, 1e-4, 0.0, x_lift, SILENT, STILL)


def exact_clearance(alpha, x, y, s):
    """Clearance, its derivative, minus its second derivative, and the time to the next corner."""
    alpha, x, y, s = map(Fraction, (alpha, x, y, s))

    def stretch(phase):
        low = phase - (phase + Fraction(1, 4)) % 1
        place = phase - low  # from the corner at -1/4
        return (
            (1, place - Fraction(1, 4)) if place < Fraction(1, 2) else (-1, place - Fraction(3, 4))
        )

    def velocity(phase):
        sign, place = stretch(phase)
        return 4 * sign * place

    def level(phase):
        sign, place = stretch(phase)
        return sign * (2 * place**2 - Fraction(1, 8))

    rise = level(x + s) - level(x) - s * velocity(x)
    gain = velocity(x + s) - velocity(x)
    sign, place = stretch(x + s)
    left = Fraction(1, 4) - place
    return (
        s * (y - s) / 2 - alpha / 2 * rise,
        y / 2 - s - alpha / 2 * gain,
        1 + 2 * sign * alpha,
        left,
    )


def has_root(f, f1, bend, left):
    """Return whether f + f1 s - bend s^2 / 2, positive at first, has a zero for 0 < s < left."""
    ends = f + f1 * left - bend * left**2 / 2 < 0
    dips = bend < 0 and f1 < 0 and f1 / bend < left and f1**2 + 2 * bend * f > 0
    return ends or dips


FOLLOW = """
import json, sys
import vibrosweep as vs
scene, launches = json.load(sys.stdin)
one = vs.simulate(**scene, launch_time=launches)
names = ("landing_time", "liftoff_time", "rebound_velocity")
found = [one[name].values[:, :, :].tolist() for name in names]
swept = vs.sweep(**scene, launch=launches, per_particle=True)
names = ("particle_impact_count", "particle_rest_count", "particle_rebound_height_max")
print(json.dumps([found, [swept[name].values.tolist() for name in names]]))
"""
SCENE = {"restitution": 0.5, "base_velocity": [0.4, 0.9, 2.6], "phase": 0.3, "duration": 3.0}
SCENE |= {"base": "moving", "waveform": "parabolic", "contact_time": 3e-2}
LAUNCHES = [0.0, 0.3]


@pytest.fixture(scope="module")
def interpreted():
    """Landings, and statistics of the vector kernel, in plain Python: nothing is compiled."""
    ran = subprocess.run(
        [sys.executable, "-c", FOLLOW],
        input=json.dumps([SCENE, LAUNCHES]),
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(ran.stdout)


def test_landings_are_those_of_the_proof(interpreted):
    (landings, lift_offs, speeds), (counts, rests, _) = interpreted
    given = {name: one.default for name, one in PARAMETERS.items()}
    given |= {"restitution": 0.5, "phase": 0.3, "contact_time": 3e-2}
    rested = 0
    for i, velocity in enumerate(SCENE["base_velocity"]):
        for j, launch in enumerate(LAUNCHES):
            moved = given | {"amplitude": 1.5 * velocity, "launch_time": launch, "duration": 3.0}
            impacts = trajectory(base="moving", waveform=SHAPE, **moved).impacts
            for k, impact in enumerate(impacts):
                exact = impact.landing_time, impact.liftoff_time, impact.rebound_velocity
                for found, known in zip((landings, lift_offs, speeds), exact, strict=True):
                    expected = np.nan if known is None else float(known)
                    close = pytest.approx(expected, rel=0.0, abs=1e-10, nan_ok=True)
                    assert found[i][j][k] == close
            assert counts[i][j] == len(impacts)
            assert rests[i][j] == sum(impact.rested for impact in impacts)
            rested += rests[i][j]
    assert rested > 2


@pytest.fixture(scope="module")
def flights():
    random = np.random.default_rng(11)
    found = []
    for _ in range(400):
        alpha, x = (
            random.choice([0.1, 0.6, 2.0, 20.0]) * random.uniform(0.5, 2.0),
            random.uniform(-0.5, 0.5),
        )
        y = random.choice([1e-6, 1e-2, 1.0, 5.0]) * random.uniform(0.1, 2.0) * max(1.0, alpha)
        guess = first_guess(alpha, x, y)
        time, landed, tried = guess.begin, False, []
        while not landed:
            tried.append(time)
            time, v, landed, _ = try_stretch(alpha, x, y, guess, time)
        found.append((alpha, x, y, time, v, tried))
    return found


def test_a_flight_solves_its_equation_within_rounding(flights):
    """The bound adds errors where the stretch begins, and roundings of the terms and the root."""
    for alpha, x, y, s, v, tried in flights:
        f, f1, _, _ = map(float, exact_clearance(alpha, x, y, s))
        begin, at = tried[-1], along(fixed_of(alpha), x, y, tried[-1])
        first, slope, bend, _ = map(float, exact_clearance(alpha, x, y, begin))
        step = s - begin
        terms = abs(first) + abs(slope) * step + abs(bend) * step**2 / 2
        bound = at.f_error + 0.5 * step * at.z_error + HALF_ULP * (8.0 * terms + s * abs(f1))
        assert abs(f) <= bound
        # v = 2 sqrt(F'^2 + 2 (1 + G) F) with values from there; the landing is off by the residual
        square = slope**2 + 2.0 * abs(bend) * abs(first)
        off = 4.0 * abs(bend) * (at.f_error + bound) + 2.0 * abs(slope) * at.z_error
        assert abs(v + 2.0 * f1) * v <= off + 16.0 * HALF_ULP * square


def test_no_first_landing_is_missed(flights):
    for alpha, x, y, s, _, _ in flights:
        time = Fraction(0)
        while True:
            f, f1, bend, left = exact_clearance(alpha, x, y, time)
            if time + left >= Fraction(s):
                break
            first = time == 0 and (f1 > 0 or bend < 0)
            if first and bend > 0:
                assert 2 * f1 / bend > left
            else:
                assert not has_root(f, f1, bend, left)
            time += left
