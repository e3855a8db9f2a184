"""The return map: closed forms and invariants."""

import numpy as np
import pytest

from vibrosweep import simulate, theory
from vibrosweep.analysis.records import return_map
from vibrosweep.errors import DataError


@pytest.mark.parametrize("amplitude", [0.0, 0.4, 1.2, 3.4])
def test_return_points_lie_in_the_strip_of_slope_e(amplitude):
    record = simulate(amplitude=amplitude, launch_time=np.arange(7) / 7, duration=40.0)
    found = return_map(record)
    bounced = found["rested"].values == 0
    assert found.sizes["point"] == np.isfinite(record["rebound_velocity"].values).sum()
    assert np.all(np.abs(found["kick"].values[bounced]) <= amplitude + 1e-12)


def test_return_points_follow_each_other_from_the_launch():
    record = simulate(launch_time=[0.125], duration=12.0)
    found, rebound = return_map(record), record["rebound_velocity"].values[0, 0]
    np.testing.assert_array_equal(found["arrival_speed"], [5.0, *rebound[:-1]])
    np.testing.assert_array_equal(found["next_arrival_speed"], rebound)
    late = return_map(record, since=6.0)
    assert 0 < late.sizes["point"] < found.sizes["point"]
    assert np.all(late["landing_time"] >= 6.0)


def test_the_kick_of_a_locked_orbit_balances_its_loss():
    phase = float(theory.locked_phase(1, 0.9, 1.2))
    record = simulate(launch_velocity=4.905, launch_time=phase, duration=30.0)
    np.testing.assert_allclose(return_map(record)["kick"], 0.1 * 4.905, rtol=1e-9)


def test_a_missing_variable_is_named():
    record = simulate(duration=3.0).drop_vars("rebound_velocity")
    with pytest.raises(DataError, match=r"return_map needs variable.*rebound_velocity"):
        return_map(record)
