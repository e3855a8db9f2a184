"""Return map, order of landings, preservation of separations: closed forms and invariants."""

import numpy as np
import pytest
import xarray as xr

from vibrosweep import simulate, theory
from vibrosweep.analysis.order import order_of_landings
from vibrosweep.analysis.preservation import separation_changes
from vibrosweep.analysis.records import return_map
from vibrosweep.errors import DataError


def made(times):
    """A record that holds nothing but landing times."""
    return xr.Dataset(
        {"landing_time": (("realization", "particle", "impact"), np.asarray(times, float))},
        coords={"contact_time": 1e-4},
    )


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


def test_particles_of_one_orbit_keep_their_order():
    # mode 5 spans five forcing periods: five slots, one particle in each
    phase = float(theory.locked_phase(5, 0.9, 3.0))
    record = simulate(
        amplitude=3.0, launch_velocity=5 * 4.905, launch_time=phase + np.arange(5), duration=100.0
    )
    found = order_of_landings(record)
    assert int(found["sequence_pairs"][0]) == int(record["impact_count"].sum()) - 5
    assert int(found["sequence_changes"][0]) == int(found["overtakings"][0]) == 0
    changes = separation_changes(record)
    assert float(changes["change_max"][0]) < 1e-9
    assert float(changes["preserved_fraction"][0]) == 1.0


def test_changes_of_the_order_are_counted():
    # landings A B, A B, B A: the sequence ABABBA differs from itself two places on at its end;
    # between the second and third impact B overtakes A
    found = order_of_landings(made([[[0.0, 1.0, 2.5], [0.4, 1.4, 2.2]]]))
    assert [int(found[n][0]) for n in ("sequence_changes", "sequence_pairs")] == [2, 4]
    assert [int(found[n][0]) for n in ("overtakings", "impact_pairs")] == [1, 2]
    assert float(order_of_landings(made([[[0.0], [1.0]]]))["overtakings"][0]) == 0


def test_landings_before_the_window_do_not_count():
    found = order_of_landings(made([[[0.0, 1.0, 2.5], [0.4, 1.4, 2.2]]]), since=0.9)
    assert [int(found[n][0]) for n in ("sequence_changes", "sequence_pairs")] == [2, 2]


def test_changes_of_separations_are_those_of_the_times():
    times = [[[0.0, 1.0, 2.0, np.nan], [0.5, 1.50005, 2.75005, 3.0]]]
    found = separation_changes(made(times))
    np.testing.assert_allclose(found["change_max"], [0.25])
    assert int(found["steps"][0]) == 2
    np.testing.assert_allclose(found["preserved_fraction"], [0.5])
    later = separation_changes(made(times), landed_before=1)
    assert int(later["steps"][0]) == 1
    assert int(separation_changes(made([[[0.0]]]))["steps"][0]) == 0


def test_without_excitation_all_separations_are_preserved():
    record = simulate(amplitude=0.0, launch_time=[0.0, 0.01, 0.3], duration=9.0)
    # every particle makes the same flights: separations are those of the launches
    assert float(separation_changes(record)["change_max"][0]) < 1e-12


def test_a_missing_variable_is_named():
    with pytest.raises(DataError, match=r"return_map needs variable.*rebound_velocity"):
        return_map(made([[[0.0]]]))
    with pytest.raises(DataError, match=r"separation_changes needs variable.*landing_time"):
        separation_changes(xr.Dataset())
    with pytest.raises(DataError, match=r"order_of_landings needs variable.*landing_time"):
        order_of_landings(xr.Dataset())
