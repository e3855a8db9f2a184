"""What claims ask of a record, against closed forms, invariants and dense samples."""

import numpy as np
import pytest
import xarray as xr

from study.bases import FIXED
from study.records import (
    crossings,
    energy_balance,
    first_shared_base,
    flights,
    order_of_landings,
    separation_changes,
)
from study.samples import Plan
from study.slots import decay_in_slot, fitted_modulus
from vibrosweep import positions, simulate, sweep, theory

STRONG = {"restitution": 0.6, "amplitude": 7.0, "phase": 0.4}  # some rests end


def made(times):
    """A record that holds nothing but landing times."""
    return xr.Dataset(
        {"landing_time": (("realization", "particle", "impact"), np.asarray(times, float))},
        coords={"contact_time": 1e-4},
    )


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
    late = order_of_landings(made([[[0.0, 1.0, 2.5], [0.4, 1.4, 2.2]]]), since=0.9)
    assert [int(late[n][0]) for n in ("sequence_changes", "sequence_pairs")] == [2, 2]


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


def test_particles_that_share_the_base_meet():
    """As the kernels find it, apart from realizations that they could not follow."""
    swept = sweep(
        restitution=(0.2, 0.98), amplitude=(0.2, 3.5), realizations=150, particles=3, duration=5.0,
        separation=True,
    )  # fmt: skip
    found = first_shared_base(simulate(swept))
    shared = np.isfinite(found["first_shared_time"].values)
    np.testing.assert_array_equal(shared, swept["base_shared"].values == 1)
    assert 20 < shared.sum() < 130


def test_first_meeting_is_the_newcomers_landing():
    record = simulate(launch_time=np.arange(5) / 5, duration=12.0)
    found = first_shared_base(record).isel(realization=0)
    time, who = float(found["first_shared_time"]), int(found["newcomer"])
    assert time in record["landing_time"].values[0, who]
    on = int(found["occupant"])
    landing, liftoff = (record[n].values[0, on] for n in ("landing_time", "liftoff_time"))
    stays = (landing <= time) & (time < np.maximum(liftoff, landing + 1e-4))
    assert stays.sum() == 1
    assert on != who
    alone = first_shared_base(simulate(launch_time=[0.0], duration=12.0))
    assert np.isnan(alone["first_shared_time"][0])
    assert int(alone["occupant"][0]) == -1


@pytest.mark.parametrize("base", FIXED)
def test_crossings_are_all_found_and_at_one_height(base):
    record = simulate(**STRONG, base=base, launch_time=[0.0, 0.13, 0.4], duration=6.0)
    found, each = crossings(record), flights(record)
    at = np.linspace(0.0, 6.0, 200_001)
    where = []
    for particle in range(3):
        y = np.full(at.size, np.nan)
        for own in np.flatnonzero(each.particle == particle):
            x = at - each.start[own]
            inside = (x >= 0.0) & (at <= each.end[own])
            y[inside] = (each.height[own] + x * (each.velocity[own] - 0.5 * 9.81 * x))[inside]
        where.append(y)
    sampled = 0
    for i, j in ((0, 1), (0, 2), (1, 2)):
        apart = where[i] - where[j]  # NaN while one of them rests
        sampled += np.count_nonzero(apart[1:] * apart[:-1] < 0.0)
    assert found.sizes["crossing"] == sampled > 10
    assert np.all(np.diff(found["time"]) >= 0.0)
    assert int(found["pairs"]) == int(found["pairs_crossing"]) == 3
    heights = positions(record, found["time"].values)["height"].values[0]
    for number, pair in enumerate(zip(found["first"].values, found["second"].values, strict=True)):
        np.testing.assert_allclose(heights[[*pair], number], found["height"][number], atol=1e-12)


def test_equal_flights_cross_half_way():
    # thrown upwards s apart with one speed v they meet at t = s / 2 + v / g after the first
    record = simulate(amplitude=0.0, launch_time=[0.0, 0.2], duration=1.1, gravity=10.0)
    found = crossings(record)
    np.testing.assert_allclose(found["time"].values[:1], [0.1 + 0.5])
    assert (int(found["first"][0]), int(found["second"][0])) == (0, 1)


def test_particles_that_fly_together_do_not_cross():
    found = crossings(simulate(launch_time=[0.0, 0.0], duration=5.0))
    assert found.sizes["crossing"] == 0
    assert int(found["flights_alike"]) == int(found["flight_overlaps"]) > 3
    assert int(found["pairs_crossing"]) == 0


def test_a_particle_at_rest_for_good_flies_no_more():
    record = simulate(amplitude=0.0, restitution=0.2, launch_time=[0.0, 0.5], duration=50.0)
    each = flights(record)
    assert np.all(each.end[each.particle == 0] < 2.0)
    assert np.all(each.end > each.start)


def test_without_rests_the_balance_is_the_difference_of_the_ends():
    rng = np.random.default_rng(3)
    record = simulate(
        restitution=rng.uniform(0.3, 0.98, 30),
        amplitude=rng.uniform(0.2, 3.5, 30),
        frequency=rng.uniform(0.5, 3.0, 30),
        phase=rng.uniform(-3.0, 3.0, 30),
        launch_time=[0.0, 0.3, 0.7],
        duration=20.0,
    )
    found = energy_balance(record)
    free = found["rests"].values == 0
    assert 0 < free.sum() < 80
    parts = found["balance"] - found["end_effect"]
    np.testing.assert_allclose(parts.values[free], 0.0, atol=1e-11)
    assert np.all(np.abs(parts.values[~free]) > 1e-6)


@pytest.mark.parametrize("base", FIXED)
@pytest.mark.parametrize("mode", [1, 2, 3])
def test_a_locked_orbit_is_in_balance(base, mode):
    amplitude = float(theory.amplitude_min(mode, 0.9)) * 1.5
    phase = float(theory.locked_phase(mode, 0.9, amplitude))
    speed = float(theory.locked_velocity(mode))
    record = simulate(
        amplitude=amplitude, launch_velocity=speed, launch_time=phase, duration=200.0, base=base
    )
    found = energy_balance(record, impacts=1)
    assert int(found["balanced_impacts"][0, 0]) == 1
    np.testing.assert_allclose(found["mean_loss"], 0.1 * speed, rtol=1e-9)
    assert abs(float(found["balance"][0, 0])) < 1e-9


def test_a_doubled_orbit_is_in_balance_over_two_impacts_only():
    # right above A_max(1) = 3.00677 the orbit has two impacts in two periods
    record = simulate(amplitude=3.05, launch_velocity=4.905, launch_time=0.4737, duration=2000.0)
    both, one = energy_balance(record, impacts=2), energy_balance(record, impacts=1)
    assert abs(float(both["balance"][0, 0])) < 1e-10
    assert abs(float(one["balance"][0, 0])) > 0.1


@pytest.mark.parametrize("base", FIXED)
def test_a_slot_closes_at_the_rate_of_the_leading_multiplier(base):
    found = decay_in_slot(Plan(), base, 1.2, 1e-4)
    predicted = float(found["modulus_predicted"])
    assert predicted == pytest.approx(0.9 ** (0.5 if base == "high-bounce" else 1.0))
    # one per cent of the rate, which is the logarithm
    fitted = float(found["modulus_fitted"])
    np.testing.assert_allclose(np.log(fitted), np.log(predicted), rtol=0.01)
    decay = float(found["closing_time"]) * np.log(predicted)
    assert np.exp(decay) == pytest.approx(1e-4 / 0.5)


def test_no_decay_is_fitted_where_there_is_none():
    assert np.isnan(fitted_modulus(np.full(100, 0.1)))
    assert np.isnan(fitted_modulus(1e-5 * 0.5 ** np.arange(5)))
