"""Basins and slots."""

import math

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import vibrosweep as vs
from tests.cases import each_of
from tests.scans import basins
from vibrosweep import simulate
from vibrosweep.analysis.basins import basin_measures, capacity, share_interval, summary
from vibrosweep.engine.measure import measure
from vibrosweep.errors import DataError, ParameterError, SpecError
from vibrosweep.figures import basin_shares, basins_of_attraction
from vibrosweep.model.measures import Regime
from vibrosweep.scene.sweep import keyword_spec

# Basins against the regimes that a sweep finds, and against the symmetry of the model.

SCENE = keyword_spec(
    {"amplitude": 3.4, "restitution": 0.95, "phase": 0.7, "duration": 4000.0}
).scene
TIMES = np.linspace(0.0, 1.0, 16, endpoint=False)


def test_every_launch_is_on_the_attractor_that_a_sweep_finds(workers):
    speeds = np.linspace(0.0, 9.0, 10)
    found = basins(SCENE, TIMES, speeds)
    launch = keyword_spec(
        {
            "duration": 2000.0,
            "amplitude": 3.4,
            "restitution": 0.95,
            "phase": 0.7,
            "particles": 16,
            "launch": TIMES.tolist(),
        }
    ).scene
    observation = launch.only(regimes=True)
    observation = type(observation)(**{**vars(observation), "duration": 4000.0})
    measured = measure(launch.parameters({"launch_velocity": speeds}), observation, workers)
    settled = found["basin"].values >= 0
    at = found["basin"].values[settled]
    for name in ("cycle_impacts", "cycle_periods", "cycle_rests", "regime"):
        assert np.array_equal(found[name].values[at], measured[name][settled]), name
    assert (measured["regime"][~settled] == Regime.UNSETTLED).all()


CYCLES = [
    {"base": "high-bounce", "amplitude": 0.5, "restitution": 0.8, "rebound": "reflect"},
    {"base": "high-bounce", "amplitude": 3.4, "restitution": 0.95, "phase": 0.7},
    {"base": "high-bounce", "amplitude": 2.0, "restitution": 0.3},
    {"base": "high-bounce", "amplitude": 2.5, "restitution": 0.8, "rebound": "reflect"},
    {"base": "moving", "base_acceleration": 0.6866, "restitution": 0.9466, "phase": 2.361},
    {"base": "moving", "base_acceleration": 2.5, "restitution": 0.4},
    {"base": "moving", "base_acceleration": 6.0, "restitution": 0.2},
]


@each_of("scene", CYCLES)
def test_the_impact_of_an_attractor_is_the_one_before_its_shortest_flight(scene):
    times, speeds, end = [0.0, 0.09, 0.3, 0.62], [0.5, 3.0, 7.4], 3000.0
    found = basins(keyword_spec({**scene, "duration": end}).scene, times, speeds)
    cycles = np.flatnonzero(found["cycle_impacts"].values > 0)
    assert cycles.size
    for i in cycles:
        one = found.isel(attractor=i)
        row, column = np.argwhere(found["basin"].values == i)[0]
        launch = {"launch_time": times[column], "launch_velocity": speeds[row]}
        record = simulate(**scene, **launch, duration=end)
        count = int(one["cycle_impacts"])
        names = ("landing_time", "liftoff_time", "rebound_velocity")
        landed, left, speed = (record[name].values[0, 0, -count - 1 :] for name in names)
        flights = landed[1:] - left[:-1]
        shortest = np.flatnonzero(flights - flights.min() < 1e-8)
        turns = landed[shortest] + scene.get("phase", 0.0) / (2.0 * np.pi)
        phase = (turns - float(one["impact_phase"]) + 0.5) % 1.0 - 0.5
        apart = np.hypot(phase, speed[shortest] - float(one["rebound_velocity"]))
        assert apart.min() < 1e-8


def test_fractions_count_the_launches():
    found = basins(SCENE, TIMES, np.linspace(0.0, 9.0, 10))
    basin = found["basin"].values
    assert found["fraction"].values == pytest.approx(np.bincount(basin[basin >= 0]) / 160.0)
    rest = float(found["unsettled_fraction"])
    assert found["fraction"].values.sum() == pytest.approx(1.0 - rest)
    assert (np.diff(found["fraction"]) <= 0.0).all()


def test_a_launch_one_period_later_is_one_slot_further():
    found = basins(SCENE, np.concatenate([TIMES, TIMES + 1.0]), np.linspace(0.5, 9.0, 10))
    now, later = found.isel(launch_time=slice(0, 16)), found.isel(launch_time=slice(16, 32))
    recurs = now["slot"].values >= 0
    assert recurs.mean() > 0.5
    assert np.array_equal(now["basin"], later["basin"])
    periods = found["cycle_periods"].values[now["basin"].values]
    assert periods.max() > 1
    shifted = np.mod(now["slot"].values + 1, np.maximum(periods, 1))
    assert np.array_equal(later["slot"].values[recurs], shifted[recurs])


def test_the_order_of_the_launches_does_not_matter():
    speeds = np.linspace(0.0, 9.0, 10)
    shuffled = np.random.default_rng(2).permutation
    mixed = basins(SCENE, shuffled(np.repeat(TIMES, 2)), shuffled(speeds))
    assert mixed.equals(basins(SCENE, TIMES, speeds))


def test_more_launches_than_fit_into_memory_are_refused_with_a_remedy_that_exists():
    with pytest.raises(ParameterError, match=r"launches need .* GiB.*fewer of them") as caught:
        basins(SCENE, np.linspace(0.0, 1.0, 10**6), np.linspace(0.0, 9.0, 10**6))
    assert "--chunk" not in str(caught.value)


def test_without_excitation_every_launch_comes_to_rest():
    found = basins(
        keyword_spec({"duration": 2000.0, "amplitude": 0.0}).scene, [0.0, 0.3], [0.0, 2.0]
    )
    assert found.sizes["attractor"] == 1
    assert found["regime"].item() == Regime.AT_REST
    assert found["fraction"].item() == 1.0


def test_mistakes_are_named():
    for given, key in (
        ({"launch": [np.nan], "launch_velocity": [1.0]}, "scene.launch"),
        ({"launch_velocity": [-1.0]}, "sample.launch_velocity"),
        ({"amplitude": [1.0, 2.0]}, "sample.launch_velocity"),
        ({"frequency": [1.0, 2.0], "launch_velocity": [1.0]}, "sample.frequency"),
        (
            {"restitution": [0.9], "amplitude": [1.0], "launch_velocity": [1.0]},
            "sample.amplitude",
        ),
    ):
        with pytest.raises(SpecError) as caught:
            vs.basins(**given)
        assert [mistake.key for mistake in caught.value.mistakes] == [key]


def test_basins_say_how_the_forcing_was_given():
    scene = keyword_spec({"base_displacement": 0.1, "duration_periods": 50.0}).scene
    found = basins(scene, [0.0], [1.0])
    amplitude = 1.9 * 2.0 * np.pi * 0.1
    assert found["base_displacement"].item() == 0.1
    np.testing.assert_allclose(found["amplitude"], amplitude, rtol=1e-15)
    np.testing.assert_allclose(found["base_acceleration"], 0.4 * np.pi**2 / 9.81, rtol=1e-15)
    assert found.attrs["forcing"] == "base_displacement"


@pytest.fixture(scope="module")
def along():
    """Basins at two amplitudes at which mode 1 exists, and at one at which nothing locks."""
    launched = {"launch_velocity": np.linspace(0.0, 9.0, 10), "particles": 16, "duration": 4000.0}
    values = [1.2, 1.0, 0.3]
    one = [vs.basins(amplitude=a, **launched) for a in values]
    return vs.basins(amplitude=values, **launched), dict(zip(values, one, strict=True))


def test_along_a_parameter_each_value_has_the_basins_that_it_has_alone(along):
    found, alone = along
    assert found["basin"].dims == ("amplitude", "launch_velocity", "launch_time")
    assert found["amplitude"].values.tolist() == [0.3, 1.0, 1.2]
    for a, one in alone.items():
        here = found.sel(amplitude=a)
        held = np.flatnonzero(here["fraction"].values)
        assert sorted(here["fraction"].values[held]) == sorted(one["fraction"].values)
        assert float(here["basin_entropy"]) == float(one["basin_entropy"])
        for i in np.unique(one["basin"].values):
            (now,) = np.unique(here["basin"].values[one["basin"].values == i])
            for name in ("regime", "cycle_periods", "cycle_impacts", "fraction_high"):
                assert here[name].values[now] == one[name].values[i], name
    share = found["fraction"].sum("attractor") + found["unsettled_fraction"]
    assert share.values == pytest.approx(1.0)
    assert (np.diff(found["fraction"].sum("amplitude")) <= 0.0).all()


def test_an_attractor_keeps_its_index_along_a_parameter(along):
    found, _ = along
    kinds = list(zip(found["regime"].values, found["cycle_periods"].values, strict=True))
    locked = [i for i, (regime, _) in enumerate(kinds) if regime == Regime.LOCKED]
    mode = next(i for i in locked if found["cycle_periods"][i] == 1)
    assert (found["fraction"][:, mode] > 0.0).values.tolist() == [False, True, True]
    assert found["rebound_velocity"][1:, mode].values == pytest.approx(4.905, abs=1e-9)
    text = "".join(summary(found))
    assert "at 2 values of amplitude, the first 1, the last 1.2" in text


def test_launches_that_have_not_settled_are_no_attractor():
    found = basins(keyword_spec({"duration": 20.0}).scene, TIMES, [3.0, 5.0])
    assert Regime.UNSETTLED not in found["regime"].values
    share = float((found["basin"] == -1).mean())
    assert share == float(found["unsettled_fraction"]) > 0.1
    assert float(found["fraction"].sum()) == pytest.approx(1.0 - share)
    assert "unsettled, on no attractor" in "".join(summary(found))
    names = [text.get_text() for text in basins_of_attraction(found).get_legend().get_texts()]
    assert any(name.startswith("unsettled, ") for name in names)


def test_the_figures_of_one_value_and_along_a_parameter_refuse_each_other(along):
    found, alone = along
    assert len(basin_shares(found, ax=Figure().add_subplot()).collections)
    with pytest.raises(DataError, match="one value of amplitude"):
        basins_of_attraction(found)
    with pytest.raises(DataError, match="amplitudes"):
        basin_shares(alone[1.2])


# Capacity: slots of known attractors.


def test_table_1_has_three_slots_to_lock_in():
    # modes 1 and 2 exist (a / (1 - e) = 2.4): one slot and two; the orbit with rests has one
    found = capacity(
        basins(
            keyword_spec({"duration": 4000.0}).scene, np.arange(20) / 20, np.linspace(1.0, 11.0, 11)
        )
    )
    assert int(found["capacity_without_rests"]) == 3
    assert int(found["capacity"]) == 4
    assert float(found["unsettled_fraction"]) == 0.0
    assert sorted(found["slots"].values) == [1, 1, 2]


def test_without_excitation_there_is_no_slot():
    found = capacity(
        basins(keyword_spec({"amplitude": 0.0, "duration": 100.0}).scene, [0.0], [1.0, 5.0])
    )
    assert int(found["capacity"]) == 0
    assert float(found["unsettled_fraction"]) == 1.0


def test_a_missing_variable_is_named():
    with pytest.raises(DataError, match=r"^capacity .*basins.*cycle_periods"):
        capacity(xr.Dataset({"regime": ("attractor", [2])}))


# Measures of basins against cases whose values are known.

SPEEDS = np.linspace(0.0, 10.0, 200)


def measures(index, speeds=SPEEDS):
    return {name: value[1] for name, value in basin_measures(np.asarray(index), speeds).items()}


def test_one_basin_has_no_entropy_and_no_boundary():
    found = measures(np.zeros((200, 50), int))
    assert found["basin_entropy"] == 0.0
    assert math.isnan(found["boundary_entropy"])
    assert math.isnan(found["uncertainty_exponent"])


def test_a_smooth_boundary_has_the_exponent_one():
    """The share of launches within some distance of a line grows with that distance."""
    index = (SPEEDS[:, np.newaxis] > 5.1 + 0.0 * np.arange(50)).astype(int)
    found = measures(index)
    assert found["uncertainty_exponent"] == pytest.approx(1.0, abs=1e-12)
    assert 0.0 < found["boundary_entropy"] <= math.log(2.0)


def test_basins_mixed_at_random_have_the_exponent_zero_and_the_entropy_of_a_coin():
    index = np.random.default_rng(1).integers(0, 2, (200, 400))
    found = measures(index)
    assert found["uncertainty_exponent"] == pytest.approx(0.0, abs=0.01)
    # mean of the entropy of 25 fair coins: log 2 less 1 / (2 * 25), to first order
    assert found["basin_entropy"] == pytest.approx(math.log(2.0) - 0.02, abs=2e-3)


def test_unsettled_launches_are_no_attractor():
    index = -np.random.default_rng(2).integers(0, 2, (200, 50))
    found = measures(index)
    assert found["basin_entropy"] == 0.0
    assert found["unsettled_fraction"] == pytest.approx((index == -1).mean())


def test_intervals_hold_the_share_and_stay_within_0_and_1():
    ends = share_interval(np.array([0, 3, 10]), 10)
    assert (ends["low"] <= [0.0, 0.3, 1.0]).all()
    assert (ends["high"] >= [0.0, 0.3, 1.0]).all()
    assert ends["low"][0] == 0.0 < ends["high"][0]
    assert ends["high"][2] == 1.0 > ends["low"][2]


def test_uneven_or_few_speeds_have_no_exponent():
    index = np.random.default_rng(3).integers(0, 2, (200, 50))
    assert math.isnan(measures(index, speeds=SPEEDS**2)["uncertainty_exponent"])
    assert math.isnan(measures(index[:20], speeds=SPEEDS[:20])["uncertainty_exponent"])


def test_basins_hold_the_measures():
    found = vs.basins(launch_velocity=[3.0, 4.0, 5.0], particles=20, duration=2000.0)
    assert (found.fraction_low <= found.fraction).all()
    assert (found.fraction_high >= found.fraction).all()
    assert float(found.unsettled_fraction) == 0.0
