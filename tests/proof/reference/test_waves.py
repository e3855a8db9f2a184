"""Shapes of the motion in ball arithmetic: known trajectories, identities, phases of lift-offs."""

import numpy as np
import pytest
from flint import arb, ctx

from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.model.shapes import SINE, Waveform
from vibrosweep.proof.reference.laws import next_of, wave_of
from vibrosweep.proof.reference.trajectories import trajectory

TWO = Waveform("harmonics", ((1, 1.0, 0.0), (2, 0.4, 1.1)))
THREE = Waveform("harmonics", ((1, 0.3, 0.0), (3, 1.0, 0.5)))
PARABOLIC = Waveform("parabolic")
SHAPES = [SINE, TWO, THREE, PARABOLIC]


def run(**given):
    scene = {name: one.default for name, one in PARAMETERS.items()}
    return trajectory(**(scene | {"launch_time": 0.0, "duration": 9.0} | given))


def test_known_trajectories():
    """Computed to 40 digits, independently of this package."""
    over = run(
        base="moving",
        waveform=TWO,
        restitution=0.85,
        amplitude=0.7 * 1.85,
        phase=0.3,
        launch_velocity=5.0,
    )
    assert over.landing_time[:2] == pytest.approx([1.017557260259823, 2.078479057686624], abs=4e-15)
    speeds = [5.238099419590123, 5.544664747235231]
    assert over.rebound_velocity[:2] == pytest.approx(speeds, abs=1e-14)
    even = Waveform("harmonics", ((1, 1.0, 0.0), (2, 0.2, 0.0)))
    on = run(waveform=even, amplitude=1.2, launch_time=0.2, launch_velocity=5.0)
    assert on.landing_time[7] == pytest.approx(8.416088615464953, abs=2e-15)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_balls_hold_the_shape_and_its_differences(shape):
    wave, bounds = wave_of(shape), wave_of(shape).bounds
    for x in np.random.default_rng(1).uniform(-2.0, 2.0, 40).tolist():
        for s in (1e-6, 0.1, 0.3, 4.7):
            h, begun = 2 * arb(x), wave.at_liftoff(2 * arb(x))
            then = h + 2 * arb(s)
            rise = wave.level(then) - wave.level(h) - arb(s) * wave.velocity(h)
            assert rise.overlaps(wave.rise(begun, arb(s)))
            assert wave.gain(begun, arb(s)).overlaps(wave.velocity(then) - wave.velocity(h))
        assert float(wave.velocity(h)) == pytest.approx(float(shape.velocity(x)), abs=1e-13)
        assert float(wave.level(h)) == pytest.approx(float(shape.height(x)), abs=1e-13)
        assert float(wave.slope(h)) == pytest.approx(float(shape.slope(x)), abs=1e-11)
        for value, bound in ((wave.level, bounds.top), (wave.slope, bounds.steep)):
            assert abs(value(h)) <= bound + arb(2) ** -40
    wide = wave.velocity(arb(0.5, 0.3))  # a ball of phases gives a ball of all their values
    assert all(wide.overlaps(wave.velocity(arb(h))) for h in np.linspace(0.25, 0.75, 9).tolist())


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_phases_of_lift_offs_are_all_found(shape):
    x = np.linspace(-0.5, 0.5, 200_001)
    with ctx.workprec(200):
        wave = wave_of(shape)
        for level in (0.02, 0.4):
            risen = np.diff((shape.velocity(x) > level).astype(int)) > 0
            found = wave.rises(arb(1), arb(level), 1)
            assert len(found) == risen.sum()
            assert all((wave.velocity(2 * one) - arb(level)).contains(0) for one in found)
            assert all(one.rad() < 1e-40 for one in found)
        falls, presses = wave.falls(arb(0.6), 1)
        thrown = 1.0 + 0.3 * shape.slope(x) < 0.0
        assert len(falls) == (np.diff(thrown.astype(int)) > 0).sum()
        assert len(presses) == len(falls)
        first = next_of(falls, arb(7.3), 1)
        assert 7.3 <= float(first) <= 8.3
        assert all(
            float(one) - float(first) > -1e-9 for one in [next_of([f], arb(7.3), 1) for f in falls]
        )
