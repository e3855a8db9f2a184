"""The Jacobian of an impact against the impact itself."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep.kernels.impact import land, rebound
from vibrosweep.kernels.tangent import carry, kick_slope, stretch

phases = st.floats(-0.49, 0.49)
flights = st.floats(0.01, 8.0)
restitutions = st.floats(0.05, 1.0)
kicks = st.floats(0.01, 2.0)


@given(phases, flights, restitutions, kicks, st.sampled_from([None, 1]))
def test_a_small_change_of_state_is_carried_by_the_jacobian(x, u, e, a, reflect):
    h = 2.0**-17

    def image(dx, du):
        landed, passed = land(x + dx, u + du)
        return landed + passed, rebound(landed, u + du, e, a, reflect)

    landed, _ = land(x, u)
    w = rebound(landed, u, e, a, None)
    if abs(w) < 10.0 * h * (1.0 + 2.0 * np.pi * a):  # |w| has no derivative where w = 0
        return
    sign = -1.0 if reflect is not None and w < 0.0 else 1.0
    k = kick_slope(landed, a)
    for dx, du in ((1.0, 0.0), (0.0, 1.0), (0.6, -0.8)):
        ahead, behind = image(h * dx, h * du), image(-h * dx, -h * du)
        slope = (np.array(ahead) - np.array(behind)) / (2.0 * h)
        # a central difference leaves out a sixth of the third derivative
        left_out = (2.0 * np.pi) ** 3 * a * (dx + du) ** 2 * h * h
        assert slope == pytest.approx(carry(dx, du, e, k, sign), rel=0, abs=left_out + 1e-15 / h)


@given(st.floats(-4.0, 4.0), restitutions, st.floats(-12.0, 12.0), st.sampled_from([1.0, -1.0]))
def test_a_frame_stays_orthonormal_and_its_area_shrinks_by_the_restitution(angle, e, k, sign):
    c, s, along, across, slack = stretch(np.cos(angle), np.sin(angle), e, k, sign)
    assert c * c + s * s == pytest.approx(1.0, rel=1e-15)
    assert np.hypot(*carry(np.cos(angle), np.sin(angle), e, k, sign)) == pytest.approx(along)
    assert abs(np.log(along * across) - np.log(e)) <= slack + 1e-15
    assert slack < 1e-10
