"""Laws of restitution over a base of finite mass: massless particles, recoil and its slope."""

import numpy as np
import pytest

import vibrosweep as vs
from tests.scenes import STILL_MOVING
from vibrosweep.kernels.bases.sprung import mount, recoil, recoil_share
from vibrosweep.kernels.restitution import ratio, restitution_of, slope
from vibrosweep.kernels.waveforms import Sine
from vibrosweep.model.parameters import dimensionless, mounts

FALLING = ("plastic", "viscoelastic")


def test_without_mass_particles_move_as_over_the_moving_base():
    scene = {"restitution": 0.8, "amplitude": 1.4, "launch_time": [0.0, 0.3], "duration": 6.0}
    scene |= {"restitution_law": "plastic", "restitution_speed": 1.0}
    moving = vs.simulate(base="moving", **scene)
    mount = {"base": "sprung", "mass_ratio": 0.0, "mount_frequency": 0.4}
    sprung = vs.simulate(**scene, **mount, **STILL_MOVING)
    assert np.array_equal(sprung.impact_count, moving.impact_count)
    for key in ("landing_time", "rebound_velocity"):
        np.testing.assert_allclose(sprung[key], moving[key], rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("name", FALLING)
def test_momentum_is_conserved_and_the_slope_is_the_derivative(parameters, name):
    given = {"restitution": 0.8, "restitution_speed": 1.0, "mass_ratio": 0.2}
    batch = parameters(mount_frequency=0.4, mount_damping=0.1, gravity=2.0, **given)
    known = mounts(batch, restitution_of(name), Sine())
    fixed = mount(dimensionless(batch, 1.0), known, 0)
    for c in (0.3, 2.0, 7.0):
        lost = recoil(fixed, 0, c, False)
        # the base loses the momentum that the particle gains: 0.2 times c + E(c) less the recoil
        gained = c + ratio(fixed.law, fixed.e, fixed.scale, c) * c - lost
        assert lost == pytest.approx(0.2 * gained, rel=1e-14)
        change = recoil(fixed, 0, c + 1e-5, False) - recoil(fixed, 0, c - 1e-5, False)
        q = slope(fixed.law, fixed.e, fixed.scale, c)
        assert recoil_share(fixed, 0, q, False) == pytest.approx(change / 2e-5, rel=1e-8)
