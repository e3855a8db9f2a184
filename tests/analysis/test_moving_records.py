"""Analyses of records over a moving base: identities of energy, motion and tangent map."""

import numpy as np
import pytest

from vibrosweep.analysis.records import arrival_speeds, base_motion, course, positions, return_map
from vibrosweep.errors import DataError

STRONG = {"restitution": 0.6, "amplitude": 7.0, "phase": 0.4}  # Gamma = 2.8: some rests end


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


@pytest.mark.parametrize("changed", [{}, STRONG, {"amplitude": 9.0, "restitution": 0.2}])
def test_flights_begin_and_end_on_the_base(moving_record, changed):
    one = moving_record([0.0, 0.13, 0.4], **changed).isel(realization=0)
    base = base_motion(one, "test")
    each = course(one, base, 12.0)
    lasting = (each.end - each.start)[each.flies]
    begins, velocity = each.height[each.flies], each.velocity[each.flies]
    ending = begins + lasting * (velocity - 0.5 * 9.81 * lasting)
    ends = each.end[each.flies]
    landed = ends < 12.0
    assert np.count_nonzero(landed) > 10
    np.testing.assert_allclose(ending[landed], base.height(ends[landed]), atol=1e-12)
    np.testing.assert_array_equal(begins, base.height(each.start[each.flies]))
    # the velocity of the base is the derivative of its height
    t, step = np.linspace(0.0, 3.0, 50), 1e-6
    slope = (base.height(t + step) - base.height(t - step)) / (2.0 * step)
    np.testing.assert_allclose(slope, base.velocity(t), atol=1e-8)


def test_a_record_without_the_motion_of_its_base_is_refused(moving_record):
    with pytest.raises(DataError, match=r"positions needs variable.*restitution"):
        positions(moving_record([0.1], 3.0).drop_vars("restitution"), [1.0])
    with pytest.raises(DataError, match=r"return_map needs variable.*liftoff_time"):
        return_map(moving_record([0.1], 3.0).drop_vars("liftoff_time"))
