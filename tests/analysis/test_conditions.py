"""Conditions hold, fail or are undetermined, and ends next to undetermined points say so."""

import numpy as np
import pytest
import xarray as xr

from tests.scans import find_windows
from vibrosweep.analysis.conditions import FAILS, HOLDS, UNDETERMINED, Condition, named
from vibrosweep.analysis.windows import (
    ENDS,
    OPEN_ABOVE,
    OPEN_BELOW,
    UNDETERMINED_ABOVE,
    UNDETERMINED_BELOW,
    summary,
)
from vibrosweep.engine.measure import measure
from vibrosweep.model.measures import VARIABLES, Regime, Status
from vibrosweep.scene.sweep import keyword_spec

AT_REST, RESTING, LOCKED, UNSETTLED, APERIODIC = Regime
SCAN = np.linspace(0.2, 3.4, 30)


def held(particles=2, **values):
    """One realization with these measured values."""
    data = {
        name: (VARIABLES[name].dims, np.asarray([value], VARIABLES[name].dtype))
        for name, value in {"status": Status.COMPLETED, **values}.items()
    }
    return xr.Dataset(data, {"contact_time": ("realization", [1e-4])}, {"particles": particles})


@pytest.mark.parametrize(
    ("name", "measured", "code"),
    [
        ("ordered", {"regime": [LOCKED, LOCKED]}, HOLDS),
        ("ordered", {"regime": [LOCKED, RESTING]}, FAILS),
        ("ordered", {"regime": [LOCKED, UNSETTLED]}, UNDETERMINED),
        ("ordered", {"regime": [LOCKED, UNDETERMINED]}, UNDETERMINED),
        ("ordered", {"regime": [APERIODIC, UNSETTLED]}, FAILS),
        ("periodic", {"regime": [LOCKED, RESTING]}, HOLDS),
        ("periodic", {"regime": [RESTING, UNSETTLED]}, UNDETERMINED),
        ("periodic", {"regime": [AT_REST, UNSETTLED]}, FAILS),
        ("regular", {"regime": [LOCKED, RESTING], "lyapunov_largest": [-0.1, -np.inf]}, HOLDS),
        ("regular", {"regime": [LOCKED, APERIODIC], "lyapunov_largest": [-0.1, 0.3]}, FAILS),
        ("regular", {"regime": [UNSETTLED] * 2, "lyapunov_largest": [-0.1, -0.2]}, UNDETERMINED),
        ("regular", {"regime": [LOCKED] * 2, "lyapunov_largest": [-0.1, np.nan]}, UNDETERMINED),
        ("separated", {"dt_min": 2e-4, "base_shared": 0}, HOLDS),
        ("separated", {"dt_min": 1e-5, "base_shared": 1}, FAILS),
        ("separated", {"dt_min": np.nan, "base_shared": 0}, HOLDS),
        ("separated", {"dt_min": np.nan, "base_shared": UNDETERMINED}, UNDETERMINED),
        ("collision_free", {"collision_free": 1}, HOLDS),
        ("collision_free", {"collision_free": 0}, FAILS),
        ("collision_free", {"collision_free": UNDETERMINED}, UNDETERMINED),
    ],
    ids=str,
)
def test_a_named_condition_has_three_codes(name, measured, code):
    assert named(name).judge(held(**measured)).tolist() == [code]


@pytest.mark.parametrize("name", ["separated", "collision_free"])
def test_one_particle_is_separated_and_free_of_collisions(name):
    lost = {"dt_min": np.nan, "base_shared": UNDETERMINED, "collision_free": UNDETERMINED}
    assert named(name).judge(held(1, **lost)).tolist() == [HOLDS]
    # it may land, never land, or be given up
    for changes in ({"duration": 12.0}, {"duration": 0.1}, {"duration": 12.0, "impact_budget": 6}):
        for base in ("high-bounce", "moving"):
            found = find_windows(
                keyword_spec({"duration": 2000.0, "base": base, **changes}).scene,
                [0.9],
                [0.5, 1.0, 3.0],
                [name],
            )
            assert found["window_count"].item() == 1
            assert found[ENDS.name].item() == OPEN_BELOW + OPEN_ABOVE


@pytest.mark.parametrize(
    ("measured", "code"),
    [
        ({"rebound_height_max": 1.0}, HOLDS),
        ({"rebound_height_max": 3.0}, FAILS),
        ({"rebound_height_max": np.nan}, UNDETERMINED),
        ({"rebound_height_max": 1.0, "status": Status.BUDGET_EXCEEDED}, UNDETERMINED),
    ],
    ids=str,
)
def test_booleans_of_ones_own_are_undetermined_where_nothing_is_known(measured, code):
    low = Condition("low", lambda ds: ds["rebound_height_max"] < 2.0, ("rebound_height_max",))
    assert low.judge(held(**measured)).tolist() == [code]
    flags = Condition("free", lambda ds: ds["collision_free"] == 0, ("collision_free",))
    assert flags.judge(held(collision_free=UNDETERMINED)).tolist() == [UNDETERMINED]


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("ordered", {"duration": 60.0}),
        ("periodic", {"duration": 60.0, "base": "moving"}),
        ("regular", {"duration": 150.0}),
        ("collision_free", {"duration": 12.0, "launch": [0.0, 0.3], "impact_budget": 24}),
        ("separated", {"duration": 12.0, "base": "moving", "impact_budget": 18}),
    ],
)
def test_beyond_an_end_the_condition_fails_or_the_end_says_that_it_is_undetermined(
    name, changes, workers
):
    scene, condition = (
        keyword_spec({"duration": 2000.0, "particles": 2, **changes}).scene,
        named(name),
    )
    windows = find_windows(scene, [0.5, 0.95], SCAN, [name], tolerance=1e-6)
    found = windows.isel(condition=0, direction=0)
    observation = scene.only(**condition.measures)

    def codes(e, *amplitudes):
        parameters = scene.parameters(
            {"restitution": np.full(len(amplitudes), e), "amplitude": np.array(amplitudes)}
        )
        measured = measure(parameters, observation, workers)
        data = {n: (VARIABLES[n].dims, v) for n, v in measured.items()}
        times = {"contact_time": ("realization", parameters["contact_time"])}
        return condition.judge(xr.Dataset(data, times, {"particles": 2})).tolist()

    def around(e, amplitude):
        """Codes at an end of a bracket and at the doubles next to it."""
        return codes(e, *(np.nextafter(amplitude, to) for to in (0.0, amplitude, np.inf)))

    unknown = 0
    for i, e in enumerate(found["restitution"].values.tolist()):
        row = found.isel(restitution=i)
        expected = codes(e, *SCAN)
        assert row["holds"].values.tolist() == expected
        unknown += expected.count(UNDETERMINED)
        for j in range(int(row["window_count"])):
            one = row.isel(window=j)
            for end, sign, bit in (
                ("A_min", -1.0, UNDETERMINED_BELOW),
                ("A_max", 1.0, UNDETERMINED_ABOVE),
            ):
                edge, half = float(one[end]), 0.5 * float(one[f"{end}_bracket"])
                if np.isfinite(edge):
                    beyond = UNDETERMINED if int(one[ENDS.name]) & bit else FAILS
                    assert HOLDS in around(e, edge - sign * half)
                    assert beyond in around(e, edge + sign * half)
    assert unknown
    (line,) = summary(windows)
    assert f"undetermined at {unknown} of 60 points of the scan" in line
