"""Analyses of records."""

from argparse import Namespace

import h5py
import numpy as np
import pytest
import xarray as xr

import vibrosweep as vs
from tests.cases import each_of
from vibrosweep import simulate, theory
from vibrosweep.analysis.records import arrival_speeds, base_motion, course, positions, return_map
from vibrosweep.commands.describe import describe
from vibrosweep.commands.results import figures
from vibrosweep.errors import DataError, ParameterError
from vibrosweep.store.disk import LENGTH

# Positions at any times: parabolas in flight, the base during rests, NaN where unknown.

BASES = {
    "high-bounce": {},
    "moving": {"base_acceleration": 1.4},
    "sprung": {
        "base_acceleration": 1.5,
        "mass_ratio": 0.1,
        "mount_frequency": 1.6,
        "restitution": 0.3,
    },
}


def scene(base, **changed):
    """A few particles, of which some rest between flights."""
    asked = {"restitution": 0.6, "launch_time": [0.0, 0.3, 0.7], "duration": 8.0} | BASES[base]
    return vs.simulate(base=base, **{**asked, **changed})


@pytest.mark.parametrize("base", BASES)
def test_every_flight_is_a_parabola_from_landing_to_landing(base):
    record = scene(base).isel(realization=0)
    for n in range(3):
        one = record.isel(particle=n)
        begin, end = one.liftoff_time.values[:-1], one.landing_time.values[1:]
        lasts = np.isfinite(end) & (end - begin > 1e-3)
        begin, end, speed = begin[lasts], end[lasts], one.rebound_velocity.values[:-1][lasts]
        assert begin.size > 2
        share = np.array([0.0, 0.2, 0.5, 0.9])
        times = begin + share[:, np.newaxis] * (end - begin)
        found = vs.positions(record.expand_dims("realization"), times.ravel()).isel(realization=0)
        height = found.height.values[n].reshape(times.shape)
        base_height = found.base_height.values.reshape(times.shape)
        # in flight, relative to the start: v s - g s^2 / 2; before that it is on the base
        since = times[1:] - begin
        fallen = height[1:] - base_height[0]
        np.testing.assert_allclose(fallen, since * (speed - 9.81 / 2.0 * since), atol=1e-12)
        landed = vs.positions(record.expand_dims("realization"), end).isel(realization=0)
        np.testing.assert_allclose(landed.height.values[n], landed.base_height, atol=1e-12)


@pytest.mark.parametrize("base", BASES)
def test_a_particle_at_rest_follows_the_base_and_none_is_below_it(base):
    record = scene(base)
    found = vs.positions(record, np.linspace(0.0, 8.0, 4001)).isel(realization=0)
    clearance = (found.height - found.base_height).values
    one = record.isel(realization=0)
    rests = np.zeros(clearance.shape, bool)
    for n in range(3):
        mine = one.isel(particle=n)
        for begin, end in zip(
            mine.landing_time.values[mine.rested == 1],
            mine.liftoff_time.values[mine.rested == 1],
            strict=True,
        ):
            rests[n] |= (found.time.values >= begin) & ~(found.time.values >= end)
    assert np.count_nonzero(rests) > 100
    assert np.all(clearance[rests] == 0.0)
    assert np.nanmin(clearance) > -1e-12
    if base == "high-bounce":
        assert np.all(found.base_height == 0.0)


def test_the_moving_base_is_the_sine_of_the_forcing():
    times = np.linspace(0.0, 8.0, 300)
    found = vs.positions(scene("moving", frequency=2.0, phase=0.4), times)
    displacement = 1.4 * 9.81 / (4.0 * np.pi) ** 2
    expected = -displacement * np.cos(4.0 * np.pi * times + 0.4)
    np.testing.assert_allclose(found.base_height.values[0], expected, atol=1e-14)


def test_a_rest_for_good_lasts_to_the_end_and_before_its_launch_a_particle_is_nowhere():
    record = vs.simulate(base="moving", base_acceleration=0.5, launch_time=[1.0], duration=60.0)
    found = vs.positions(record, [0.5, 1.0, 60.0])
    assert np.isnan(found.height.values[0, 0, 0])
    np.testing.assert_array_equal(found.height.values[0, 0, 1:], found.base_height.values[0, 1:])


def test_positions_after_a_particle_was_given_up_are_nan():
    record = scene("moving", impact_budget=2)
    assert np.isnan(vs.positions(record, [8.0]).height).all()


def test_realizations_are_apart():
    record, times = vs.simulate(restitution=[0.7, 0.9], launch_time=[0.0, 0.125]), [0.5, 3.0, 11.0]
    found = vs.positions(record, times).isel(realization=1)
    alone = vs.positions(record.isel(realization=[1]), times)
    np.testing.assert_array_equal(alone.height.values[0], found.height.values)


def test_the_record_of_a_sweep_gives_the_same_as_the_scene(tmp_path):
    scene = {"amplitude": 1.1, "particles": 3, "duration": 8.0}
    vs.run({"record": scene}, tmp_path / "out.h5").close()
    times = np.linspace(0.0, 8.0, 100)
    with vs.open_record(tmp_path / "out.h5") as record:
        kept = vs.positions(record, times).height.values
    direct = vs.positions(
        vs.simulate(amplitude=1.1, launch_time=np.arange(3) / 3, duration=8.0), times
    )
    np.testing.assert_allclose(kept, direct.height.values, atol=1e-9)


@pytest.mark.parametrize("times", [[[0.0]], [np.nan], 1.0])
def test_times_must_be_a_list_of_finite_numbers(times):
    with pytest.raises(ParameterError, match="times"):
        vs.positions(vs.simulate(), times)


def test_times_after_the_end_of_the_record_are_refused():
    with pytest.raises(DataError, match="12 s"):
        vs.positions(vs.simulate(), [0.0, 12.1])


# The motion of a base of finite mass, against the flights and the momentum of a record.

SCENE = {
    "base": "sprung",
    "mount_frequency": 1.6,
    "restitution": 0.6,
    "base_acceleration": 1.5,
    "launch_time": np.arange(4) / 4.0,
    "contact_time": 1e-2,
    "duration": 6.0,
}


@pytest.fixture(scope="module")
def one():
    return simulate(mass_ratio=0.1, **SCENE).isel(realization=0)


def lift_offs(one):
    """Instants and speeds at which the flights that end with each landing begin."""
    launch = one.launch_time.values[:, np.newaxis]
    speed = np.full_like(launch, float(one.launch_velocity))
    return (
        np.concatenate([launch, one.liftoff_time.values[:, :-1]], axis=1),
        np.concatenate([speed, one.rebound_velocity.values[:, :-1]], axis=1),
    )


def test_every_flight_begins_and_ends_on_the_base(one):
    base, landing = base_motion(one, "test"), one.landing_time.values
    begin, speed = lift_offs(one)
    time = landing - begin
    fallen = base.height(begin) + (speed - float(one.gravity) / 2.0 * time) * time
    assert np.isfinite(fallen).sum() > 30
    np.testing.assert_allclose(fallen, base.height(landing), rtol=0, atol=1e-13)


def test_momentum_is_conserved_and_restitution_is_that_of_the_scene(one):
    base, v = base_motion(one, "test"), -arrival_speeds(one, "test")
    after, rested = one.rebound_velocity.values, one.rested.values == 1
    # where others ride it, the base may have another mass
    alone = np.isfinite(v) & (one.landing_time.values < np.min(one.liftoff_time.values[rested]))
    alone &= ~rested
    assert alone.sum() > 10
    with np.errstate(invalid="ignore"):
        then = base.velocity(one.landing_time.values)
        before = then + 0.1 * (after - v)
    np.testing.assert_allclose((after - then)[alone], (0.6 * (before - v))[alone], atol=1e-12)


def test_the_reach_of_the_base_is_that_of_its_samples(one):
    base = base_motion(one, "test")
    assert base.reach == np.max(np.abs(base.height(np.linspace(0.0, 6.0, 386))))
    assert base.reach != base.displacement


def test_massless_particles_do_not_change_the_motion_of_the_base():
    one = simulate(mass_ratio=0.0, **SCENE).isel(realization=0)
    base, times = base_motion(one, "test"), np.linspace(-1.0, 7.0, 200)
    angle = 2.0 * np.pi * times
    np.testing.assert_allclose(base.height(times), -base.displacement * np.cos(angle), atol=1e-14)
    np.testing.assert_allclose(base.velocity(times), base.speed * np.sin(angle), atol=1e-13)


def test_a_record_without_some_of_the_particles_is_refused(one):
    with pytest.raises(DataError, match=r"^crossings: "):
        base_motion(one.isel(particle=[0, 2]), "crossings")


# Records without empty places, and the way back to a rectangle.

SCENES = {
    "one": {},
    "map": {"amplitude": [0.3, 1.2, 3.0], "launch_time": [0.0, 0.4, 11.9], "duration": 12.0},
    "moving": {"base": "moving", "base_acceleration": [0.5, 3.0], "particles": 2, "duration": 9.0},
    "sprung": {"base": "sprung", "mass_ratio": [0.01, 0.1], "mount_frequency": 3.0, "particles": 2},
    "none": {"launch_time": 11.9, "duration": 12.0},
}


@each_of("scene", SCENES.values())
def test_a_ragged_record_is_the_rectangle_without_its_empty_places(scene):
    full, ragged = vs.simulate(**scene), vs.simulate(**scene, ragged=True)
    assert ragged.sizes["landing"] == full.impact_count.sum()
    assert ragged.impact_count.attrs["sample_dimension"] == "landing"
    assert np.array_equal(ragged.impact_count, full.impact_count.values.ravel())
    again = vs.rectangle(ragged)
    full.attrs.pop("notes", None)
    assert again.identical(full)


def test_a_rectangle_says_how_much_of_it_is_empty():
    half = vs.simulate(launch_time=[0.0, 6.0], duration=12.0)
    assert "notes" not in half.attrs
    found = vs.simulate(launch_time=[0.0, 11.0, 11.0, 11.0], duration=12.0)
    empty = 1.0 - float(found.impact_count.sum()) / (4 * found.sizes["impact"])
    assert empty > 0.5
    assert found.attrs["notes"].startswith(f"{empty:.0%} of the ")


def test_functions_that_need_a_rectangle_name_the_conversion():
    ragged = vs.simulate(ragged=True)
    for take in (vs.analysis.landing_phases, vs.figures.return_map):
        with pytest.raises(DataError, match=r"vibrosweep.rectangle\(record\)"):
            take(ragged)
    with pytest.raises(DataError, match=r"simulate\(\.\.\., ragged=True\)"):
        vs.rectangle(vs.simulate())
    with pytest.raises(DataError, match=r"11 landings where impact_count has"):
        vs.rectangle(ragged.isel(landing=slice(11)))


RECORDED = {"restitution": 0.5, "amplitude": 3.0, "launch": [0.0, 5.0, 5.9], "particles": 3}
SWEEP = {"restitution": [0.8, 0.9], "amplitude": [1.0, 2.0], "duration": 6.0, "particles": 2}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The same sweep with a ragged record and with a rectangle."""
    folder = tmp_path_factory.mktemp("ragged")
    for name, ragged in (("ragged", True), ("full", False)):
        record = {**RECORDED, "ragged": ragged}
        vs.run({**SWEEP, "record": record}, folder / f"{name}.h5").close()
    return folder / "ragged.h5", folder / "full.h5"


def test_a_ragged_record_in_a_file_is_its_rectangle_without_empty_places(files):
    with vs.open_record(files[0]) as ragged, vs.open_record(files[1]) as full:
        assert ragged.sizes["landing"] == full.impact_count.sum()
        assert ragged.impact_count.attrs["sample_dimension"] == "landing"
        again = vs.rectangle(ragged)
        assert full.attrs.pop("notes").endswith("ragged = true in [record] leaves them out")
        assert again.identical(full)


def test_a_file_names_the_dimension_of_its_landings_by_its_own_name(files):
    with h5py.File(files[0]) as file:
        record = file["record"]
        assert record["landing_time"].dims[0][0].name == "/record/record_landing"
        assert record["impact_count"].attrs["sample_dimension"] == "record_landing"
    with xr.open_datatree(files[0], engine="h5netcdf") as tree:
        assert tree["record"].sizes["record_trajectory"] == 3


def test_a_ragged_record_depends_on_neither_threads_nor_chunks(files, tmp_path):
    other = tmp_path / "other.h5"
    vs.run({**SWEEP, "record": {**RECORDED, "ragged": True}}, other, threads=1, chunk=1).close()
    with h5py.File(files[0]) as one, h5py.File(other) as two:
        for name in one["record"]:
            assert one["record"][name][()].tobytes() == two["record"][name][()].tobytes(), name


def test_a_description_states_the_form_and_its_empty_places(files):
    told = ["\n".join(describe(path)) for path in files]
    assert "landings, one after the other" in told[0]
    assert "places are empty" not in told[0]
    assert "landings, in the group" in told[1]
    assert "ragged = true in [record] leaves them out" in told[1]


def test_figures_and_verify_take_a_ragged_record(files, tmp_path):
    figures(Namespace(result=files[0], output=tmp_path))
    assert (tmp_path / "fig4_return_map.png").exists()
    copy = tmp_path / "copy.h5"
    copy.write_bytes(files[0].read_bytes()[:-LENGTH])
    assert vs.verify(copy).passed
    for name in ("landing_time", "particle_index"):
        with h5py.File(copy, "r+") as file:
            before = file["record"][name][2]
            file["record"][name][2] = before + 1
        report = vs.verify(copy)
        assert [n for n, v in report.variables().items() if v.outside] == [f"record/{name}"]
        with h5py.File(copy, "r+") as file:
            file["record"][name][2] = before
    with h5py.File(copy, "r+") as file:
        file["record"]["impact_count"][0] -= 1
    with pytest.raises(DataError, match="landing_time"):
        vs.verify(copy)


# Analyses of records over a moving base: identities of energy, motion and tangent map.

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


# The return map: closed forms and invariants.


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
