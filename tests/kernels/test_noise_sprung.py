"""Noise over a base of finite mass: the moving base for massless particles, and momentum."""

import numpy as np
import pytest

import vibrosweep as vs
from tests.scenes import RIGID
from vibrosweep.kernels.bases.sprung import mount, recoil_from
from vibrosweep.kernels.noise import noise_of
from vibrosweep.kernels.restitution import Constant
from vibrosweep.kernels.waveforms import Sine
from vibrosweep.model.parameters import dimensionless, mounts

NOISE = {"restitution_noise": 0.1, "kick_noise": 0.1}


def test_without_mass_particles_move_as_over_the_moving_base():
    scene = {"restitution": 0.8, "amplitude": 1.4, "launch_time": [0.0, 0.3], "duration": 6.0}
    scene |= {**NOISE, "noise_seed": 5, "noise_stream": [0, 7]}
    moving = vs.simulate(base="moving", **scene)
    sprung = vs.simulate(base="sprung", mass_ratio=0.0, mount_frequency=0.4, **scene, **RIGID)
    assert np.array_equal(sprung.impact_count, moving.impact_count)
    for key in ("landing_time", "rebound_velocity"):
        np.testing.assert_allclose(sprung[key], moving[key], rtol=1e-9, atol=1e-9)


def test_a_realization_of_a_sweep_is_replayed():
    scene = {"restitution": 0.8, "amplitude": [1.2, 1.4], "particles": 2, "duration": 6.0}
    mount = {"base": "sprung", "mass_ratio": 0.2, "mount_frequency": 0.4}
    random = NOISE | {"noise_seed": 5, "restitution_law": "plastic", "restitution_speed": 4.0}
    sweep = vs.sweep(scene | mount | random | {"per_particle": True})
    record = vs.simulate(sweep.isel(amplitude=1))
    assert (record.impact_count.values == sweep.particle_impact_count.values[1]).all()
    still = vs.sweep(scene | mount | {"per_particle": True})
    assert (still.flight_time_mean != sweep.flight_time_mean).all()


def test_momentum_is_conserved(parameters):
    batch = parameters(mount_frequency=0.4, mount_damping=0.1, mass_ratio=0.2, restitution=0.8)
    problem, noise = dimensionless(batch, 1.0), noise_of((1, 1, None, None), 0)
    fixed = mount(problem, mounts(batch, Constant(), Sine()), 0)
    for c, w in ((0.3, 0.1), (2.0, 3.0)):
        lost = recoil_from(noise, fixed, 0, c, w)
        assert lost == pytest.approx(0.2 * (c + w - lost), rel=1e-14)
