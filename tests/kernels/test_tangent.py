"""Small changes of state through an impact, against the impact itself."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep.kernels.bases import Flight, jacobian, rebound
from vibrosweep.kernels.impact import carry, impact, stretch
from vibrosweep.model.parameters import LAWS

phases = st.floats(-0.49, 0.49)
flights = st.floats(0.01, 8.0)
restitutions = st.floats(0.05, 1.0)
kicks = st.floats(0.01, 2.0)
laws = st.sampled_from(LAWS)


@given(phases, flights, restitutions, kicks, laws)
def test_a_small_change_of_state_is_carried_by_the_jacobian(constants_of, x, u, e, a, law):
    h = 2.0**-17
    fixed = constants_of(law, e, a)

    def image(dx, du):
        hit = impact(fixed, 0.0, x + dx, u + du)
        return hit.x + hit.n, rebound(fixed, hit.x, hit.v)

    hit = impact(fixed, 0.0, x, u)
    if abs(rebound(fixed, hit.x, hit.v)) < 10.0 * h * (1.0 + 2.0 * np.pi * a):
        return  # |w| has no derivative where w = 0
    derivative = jacobian(fixed, hit.flight)
    for dx, du in ((1.0, 0.0), (0.0, 1.0), (0.6, -0.8)):
        ahead, behind = image(h * dx, h * du), image(-h * dx, -h * du)
        slope = (np.array(ahead) - np.array(behind)) / (2.0 * h)
        # a central difference leaves out a sixth of the third derivative
        left_out = (2.0 * np.pi) ** 3 * a * (dx + du) ** 2 * h * h
        assert slope == pytest.approx(carry(dx, du, derivative), rel=0, abs=left_out + 1e-15 / h)


@given(st.floats(-4.0, 4.0), phases, flights, restitutions, kicks, laws)
def test_a_frame_stays_orthonormal_and_its_area_shrinks_by_the_restitution(
    constants_of, angle, x, v, e, a, law
):
    derivative = jacobian(constants_of(law, e, a), Flight(0.0, v, v, x, v))
    c, s, along, across, slack = stretch(np.cos(angle), np.sin(angle), derivative)
    assert c * c + s * s == pytest.approx(1.0, rel=1e-15)
    assert np.hypot(*carry(np.cos(angle), np.sin(angle), derivative)) == pytest.approx(along)
    assert abs(np.log(along * across) - np.log(e)) <= slack + 1e-15
    assert slack < 1e-10
