"""Greatest speed of impact, and whether the law of restitution holds there."""

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.engine.measure import impact_speeds
from vibrosweep.kernels.statistics import IMPACT_SPEED, KINDS, Statistics
from vibrosweep.model.measures import Status
from vibrosweep.model.restitution_laws import fastest_in_range, range_of

LIMITED = {"restitution_law": "viscoelastic", "restitution": 0.8, "restitution_speed": 0.01}


def test_the_restitution_at_the_fastest_impact_of_the_range_is_the_least():
    e = np.array([0.46, 0.6, 0.8, 0.99])
    fastest = fastest_in_range("viscoelastic", e, np.full(4, 0.2))
    assert fastest[0] == pytest.approx(0.2, rel=1e-14)
    assert vs.theory.restitution_at(fastest, e, "viscoelastic", 0.2) == pytest.approx(0.46)
    unlimited = fastest_in_range("viscoelastic", np.ones(1), np.ones(1))
    assert np.isinf(unlimited)
    assert np.isinf(fastest_in_range("plastic", e, e)).all()


def test_results_without_landings_state_the_range_of_the_law():
    inputs = {"restitution": 0.8, "restitution_speed": 0.01}
    limit = fastest_in_range("viscoelastic", np.array([0.8]), np.array([0.01])).item()
    assert f"up to {limit:.4g} m s-1" in range_of("viscoelastic", inputs)
    assert "e(v) is at least 0.46;" in range_of("viscoelastic", {})
    assert range_of("plastic", inputs) == ""
    found = vs.windows({**LIMITED, "amplitude": [0.4, 0.5], "conditions": ["locked(1)"]})
    assert found.restitution_law_range == range_of("viscoelastic", inputs)


def test_impacts_outside_the_range_are_always_flagged():
    """On a base that does not kick, the first impact is the fastest: it has the launch speed."""
    limit = fastest_in_range("viscoelastic", np.array([0.8]), np.array([0.01])).item()
    speeds = [0.1 * limit, 0.999 * limit, 1.001 * limit]
    found = vs.sweep(**LIMITED, amplitude=0.0, launch_velocity=speeds, duration=20.0)
    assert found.impact_speed_max.values.ravel() == pytest.approx(speeds, rel=1e-14)
    assert found.law_in_range.values.ravel().tolist() == [1, 1, 0]
    every = vs.simulate(**LIMITED, amplitude=0.0, launch_velocity=speeds, duration=20.0)
    assert every.law_in_range.values.tolist() == [1, 1, 0]
    assert f"up to {limit:.4g} m s-1" in every.restitution_law_range


def test_incomplete_realizations_are_undetermined_unless_they_left_the_range():
    totals = np.zeros((len(KINDS) + 1, 4))
    totals[0], totals[-1] = [3, 3, 0, 3], [1.0, 9.0, -np.inf, 9.0]
    spent, lost = Status.BUDGET_EXCEEDED, Status.NON_FINITE
    status = np.array([spent, spent, Status.COMPLETED, lost], np.int8)
    found = Statistics((*KINDS, IMPACT_SPEED), totals, np.zeros(4, np.int64), status)
    given = {"gravity": 2.0, "frequency": 0.5, "restitution": 0.46, "restitution_speed": 4.0}
    arrays = {name: np.full(4, value) for name, value in given.items()}
    measured = impact_speeds(found, arrays, "viscoelastic")
    assert measured["law_in_range"].tolist() == [-1, 0, 1, -1]
    assert np.array_equal(measured["impact_speed_max"], [2.0, 18.0, np.nan, np.nan], equal_nan=True)
