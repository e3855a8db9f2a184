"""Analyses of records over a moving base: identities of energy, motion and tangent map."""

import numpy as np
import pytest
import xarray as xr

from vibrosweep import theory
from vibrosweep.analysis.decay import slot_decay
from vibrosweep.analysis.energy import energy_balance
from vibrosweep.analysis.equal_heights import crossings
from vibrosweep.analysis.heights import heights_against_restitution
from vibrosweep.analysis.records import arrival_speeds, base_motion, course, flights, return_map
from vibrosweep.errors import DataError

STRONG = {"restitution": 0.6, "amplitude": 7.0, "phase": 0.4}  # Gamma = 2.8: some rests end


def locked(moving_record, mode, e, share, duration=60.0, launches=(0.0,), **changed):
    """Record of particles close to a locked orbit."""
    low, high = theory.amplitude_min(mode, e), theory.amplitude_max(mode, e, base="moving")
    amplitude = float(low + share * (high - low))
    phase = float(theory.locked_phase(mode, e, amplitude))
    return moving_record(
        phase + np.asarray(launches),
        duration,
        restitution=e,
        amplitude=amplitude,
        launch_velocity=float(theory.locked_velocity(mode)),
        **changed,
    )


def test_two_proved_trajectories(moving_record):
    """Table 1, proved in ball arithmetic."""
    record = moving_record([0.125])
    time, speed = (record[name].values[0, 0] for name in ("landing_time", "rebound_velocity"))
    proved = [
        (1, 1.1426997789962376, 5.422728901359235),
        (2, 2.2379823108328307, 5.986374088708485),
        (8, 8.404779815953377, 5.517958309647759),
    ]
    for n, landing, rebound in proved:
        assert time[n - 1] == pytest.approx(landing, rel=1e-12)
        assert speed[n - 1] == pytest.approx(rebound, rel=1e-12)


@pytest.mark.parametrize("changed", [{}, STRONG, {"amplitude": 9.0, "restitution": 0.2}])
def test_flights_begin_and_end_on_the_base(moving_record, changed):
    record = moving_record([0.0, 0.13, 0.4], **changed)
    base = base_motion(record.isel(realization=0), "test")
    each = flights(record, 0, "test")
    lasting = each.end - each.start
    ending = each.height + lasting * (each.velocity - 0.5 * 9.81 * lasting)
    landed = each.end < 12.0
    assert np.count_nonzero(landed) > 10
    np.testing.assert_allclose(ending[landed], base.height(each.end[landed]), atol=1e-12)
    np.testing.assert_array_equal(each.height, base.height(each.start))
    # the velocity of the base is the derivative of its height
    t, step = np.linspace(0.0, 3.0, 50), 1e-6
    slope = (base.height(t + step) - base.height(t - step)) / (2.0 * step)
    np.testing.assert_allclose(slope, base.velocity(t), atol=1e-8)


def test_a_flight_in_progress_is_known_unless_its_particle_was_given_up(moving_record):
    record = moving_record([0.125], duration=2.0).isel(realization=0)
    base = base_motion(record, "test")
    assert course(record, base, 2.0).flies.tolist() == [[True, True]]
    given_up = record.assign(status=record["status"] + 1)
    assert course(given_up, base, 2.0).flies.tolist() == [[True, False]]


@pytest.mark.parametrize("changed", [{}, STRONG, {"amplitude": 9.0, "restitution": 0.2}])
def test_an_impact_turns_the_relative_speed_by_the_restitution(moving_record, changed):
    one = moving_record([0.0, 0.3], **changed).isel(realization=0)
    base, e = base_motion(one, "test"), float(one["restitution"])
    bounced = (one["rested"].values == 0) & np.isfinite(one["landing_time"].values)
    surface = base.velocity(one["landing_time"].values)[bounced]
    arrival = arrival_speeds(one, "test")[bounced]
    leaving = one["rebound_velocity"].values[bounced]
    np.testing.assert_allclose(leaving - surface, e * (arrival + surface), atol=1e-11)


def test_energy_is_given_by_the_base_and_dissipated(moving_record):
    for changed in ({}, STRONG, {"amplitude": 9.0, "restitution": 0.2}):
        record = moving_record([0.0, 0.3, 0.7], 20.0, **changed)
        found = energy_balance(record)
        assert (int(found["rests"].sum()) > 0) == bool(changed)
        one = record.isel(realization=0)
        base = base_motion(one, "test")
        parts = found["end_effect"] + found["flight_effect"] + found["rest_effect"]
        np.testing.assert_allclose(found["balance"], parts, atol=1e-12)
        np.testing.assert_allclose(
            found["base_work"] - found["dissipated_energy"], found["energy_balance"], atol=1e-12
        )
        # no energy is lost in flight: impacts add that of the last flight less that of the first
        for i, count in enumerate(found["balanced_impacts"].values[0]):
            first, last = one["launch_time"].values[i], one["liftoff_time"].values[i, count - 1]
            speed = one["rebound_velocity"].values[i, count - 1]
            gained = 0.5 * (speed**2 - 25.0) + 9.81 * (base.height(last) - base.height(first))
            assert float(found["energy_balance"][0, i]) * count == pytest.approx(gained, abs=1e-9)


def test_the_work_of_the_base_is_force_times_velocity(moving_record):
    one = moving_record([0.2], restitution=0.7, amplitude=2.0).isel(realization=0)
    found = energy_balance(one.expand_dims("realization"))
    assert int(found["rests"].sum()) == 0
    base = base_motion(one, "test")
    surface = base.velocity(one["landing_time"].values)
    impulse = arrival_speeds(one, "test") + one["rebound_velocity"].values
    np.testing.assert_allclose(found["base_work"][0], np.mean(impulse * surface, axis=1))


@pytest.mark.parametrize(("mode", "e", "share"), [(1, 0.9, 0.5), (2, 0.5, 0.3), (3, 0.2, 0.8)])
def test_a_locked_orbit_is_in_balance(moving_record, mode, e, share):
    record = locked(moving_record, mode, e, share)
    found = energy_balance(record, impacts=1)
    speed = float(theory.locked_velocity(mode))
    np.testing.assert_allclose(found["mean_kick"], (1.0 - e) * speed, rtol=1e-9)
    assert abs(float(found["energy_balance"][0, 0])) < 1e-9
    assert abs(float(found["balance"][0, 0])) < 1e-9
    relative = 2.0 * speed / (1.0 + e)  # the base rises by (1 - e) / (1 + e) of the speed
    dissipated = (1.0 - e**2) * relative**2 / 2.0
    np.testing.assert_allclose(found["base_work"], dissipated, rtol=1e-9)


def test_a_record_without_the_motion_of_its_base_is_refused(moving_record):
    with pytest.raises(DataError, match=r"energy_balance needs variable.*phase"):
        energy_balance(moving_record([0.1], 3.0).drop_vars("phase"))
    with pytest.raises(DataError, match=r"crossings needs variable.*restitution"):
        crossings(moving_record([0.1], 3.0).drop_vars("restitution"))
    with pytest.raises(DataError, match=r"return_map needs variable.*liftoff_time"):
        return_map(moving_record([0.1], 3.0).drop_vars("liftoff_time"))


@pytest.mark.parametrize(
    ("mode", "e", "share"), [(1, 0.9, 0.1), (1, 0.9, 0.5), (1, 0.7, 0.9), (2, 0.8, 0.97)]
)
def test_a_slot_closes_at_the_rate_of_the_leading_multiplier(moving_record, mode, e, share):
    record = locked(moving_record, mode, e, share, duration=200.0 * mode, launches=(0.0, 3e-5))
    found = slot_decay(record).isel(realization=0)
    pair = theory.multipliers(mode, e, float(record["amplitude"]), base="moving")
    leading = float(np.abs(pair).max())
    assert int(found["equations"]) >= 8
    # the multipliers are those of the last impacts, which are as near to the orbit as time allows
    assert float(found["modulus_predicted"]) == pytest.approx(leading, rel=1e-6)
    assert float(found["modulus_fitted"]) == pytest.approx(leading, rel=2e-3)
    assert float(found["product_fitted"]) == pytest.approx(e**2, rel=2e-3)


def test_crossings_are_all_found_and_at_one_height(moving_record):
    record = moving_record([0.0, 0.13, 0.4], 6.0, **STRONG)
    found, each = crossings(record), flights(record, 0, "test")
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
    for time, height, *pair in zip(
        *(found[name].values for name in ("time", "height", "first", "second")), strict=True
    ):
        for particle in pair:
            assert np.interp(time, at, where[particle]) == pytest.approx(height, abs=1e-8)


@pytest.mark.parametrize("changed", [{}, STRONG, {"amplitude": 9.0, "restitution": 0.2}])
def test_return_points_lie_in_the_strip(moving_record, changed):
    record = moving_record(np.arange(7) / 7, 40.0, **changed)
    found = return_map(record)
    e, amplitude = float(record["restitution"]), float(record["amplitude"])
    bounced = found["rested"].values == 0
    assert np.all(np.abs(found["kick"].values[bounced]) <= amplitude + 1e-11)
    apart = np.abs(found["next_arrival_speed"].values - e * found["arrival_speed"].values)
    assert np.all(apart[bounced] <= amplitude * (3.0 + e) / (1.0 + e) + 1e-11)
    # each next speed of arrival is the first of the point that follows
    for particle in range(7):
        own = found["particle"].values == particle
        np.testing.assert_array_equal(
            found["next_arrival_speed"].values[own][:-1], found["arrival_speed"].values[own][1:]
        )


def test_heights_on_a_plateau_are_those_of_the_realization():
    e = np.array([0.9, 0.8, 0.7, 0.6, 0.9, 0.8])
    mode = np.array([1, 2, 1, 3, 2, 1])
    amplitude = theory.amplitude_min(mode, e) * 1.05
    apex = theory.locked_apex(mode, e, amplitude)
    apex[5] *= 1.01  # near a plateau, and not on it
    sweep = xr.Dataset(
        {
            "rebound_height_max": ("realization", apex),
            "rebound_height_mean": ("realization", apex),
        },
        coords={
            "restitution": ("realization", e),
            "amplitude": ("realization", amplitude),
            "frequency": 1.0,
            "gravity": 9.81,
        },
        attrs={"base": "moving"},
    )
    found = heights_against_restitution(sweep, bins=2)
    np.testing.assert_array_equal(found["mode"], [*mode[:5], 0])
    assert float(found["plateau_deviation"]) < 1e-14
    with pytest.raises(DataError, match=r"heights_against_restitution needs .*amplitude"):
        heights_against_restitution(sweep.drop_vars("amplitude"))
