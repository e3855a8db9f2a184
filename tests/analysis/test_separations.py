"""Separations, and what chance would give."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import binomtest, kstest

import vibrosweep as vs
from vibrosweep import theory
from vibrosweep.analysis import order_against_chance, separations_against_chance, share_against
from vibrosweep.analysis.datasets import remedy, require
from vibrosweep.analysis.separations import (
    compare_separations,
    separation_against,
    separation_distribution,
)
from vibrosweep.engine.measure import measure
from vibrosweep.errors import DataError, ParameterError
from vibrosweep.figures import share_curves
from vibrosweep.model.measures import Status

# Statistics of separations, and their decay inside a slot.


def made(dt, free, **coordinates):
    """A sweep that holds nothing but separations."""
    return xr.Dataset(
        {
            "dt_min": ("realization", np.asarray(dt, float)),
            "collision_free": ("realization", np.asarray(free, np.int8)),
        },
        coords={
            "duration": 12.0,
            **{name: ("realization", np.asarray(v, float)) for name, v in coordinates.items()},
        },
        attrs={"particles": 7},
    )


def test_distribution_is_that_of_the_values():
    found = separation_distribution(
        made([0.3, 0.0, np.nan, 0.1, 0.0, 0.2], [1, 0, -1, 1, 0, 1]), quantiles=[0.0, 0.5, 1.0]
    )
    assert int(found["known"]) == 5
    np.testing.assert_array_equal(found["separation"], [0.0, 0.0, 0.1, 0.2, 0.3])
    np.testing.assert_allclose(found["cumulative_fraction"], [0.2, 0.4, 0.6, 0.8, 1.0])
    np.testing.assert_array_equal(found["separation_quantile"], [0.0, 0.1, 0.3])
    assert float(found["zero_fraction"]) == 0.4
    assert float(found["collision_free_fraction"]) == 0.6
    # Wilson: (p + z^2 / 2n -+ z sqrt(p q / n + z^2 / 4n^2)) / (1 + z^2 / n), z = 1.959964
    np.testing.assert_allclose(found["collision_free_low"], 0.2307, atol=1e-4)
    np.testing.assert_allclose(found["collision_free_high"], 0.8824, atol=1e-4)


def test_bins_hold_the_realizations_between_their_ends():
    random = np.random.default_rng(0)
    e, dt = random.uniform(0.8, 0.98, 400), random.uniform(0, 1, 400)
    found = separation_against(made(dt, dt > 0.5, restitution=e), "restitution", bins=5)
    np.testing.assert_array_equal(found["known"], [80] * 5)
    for part in range(5):
        low, high = (float(found[f"restitution_{end}"][part]) for end in ("low", "high"))
        own = (e >= low) & ((e <= high) if part == 4 else (e < high))
        assert float(found["collision_free_fraction"][part]) == np.mean(dt[own] > 0.5)


def test_sweeps_are_compared_by_particles_and_duration():
    found = compare_separations([made([0.1], [1]), made([0.0], [0]).assign_attrs(particles=9)])
    np.testing.assert_array_equal(found["particles"], [7, 9])
    np.testing.assert_array_equal(found["duration"], [12.0, 12.0])
    np.testing.assert_array_equal(found["collision_free_fraction"], [1.0, 0.0])


def test_mistakes_are_named():
    with pytest.raises(DataError, match=r"dt_min .*separation = true in the \[measure\]"):
        separation_distribution(made([0.1], [1]).drop_vars("dt_min"))
    with pytest.raises(ParameterError, match="measure = 'gap'"):
        separation_distribution(made([0.1], [1]), measure="gap")
    for quantiles in ([2.0], 0.5, "half", [float("nan")]):
        with pytest.raises(ParameterError, match=r"^quantiles = "):
            separation_distribution(made([0.1], [1]), quantiles=quantiles)
    with pytest.raises(DataError, match="differ in restitution"):
        separation_against(made([0.1, 0.2], [1, 1], restitution=[0.9, 0.9]), "restitution")


def test_measured_separation_decays_at_the_rate_of_the_multiplier(parameters, observe, workers):
    # dt_min of two particles in one slot, in later and later windows of the same length; the
    # multipliers are real here: with complex ones the separation oscillates while it decays, and
    # the smallest of a few does not follow the rate closely
    amplitude = 0.993 * float(theory.amplitude_max(1, 0.5))
    phase = float(theory.locked_phase(1, 0.5, amplitude))
    multipliers = theory.multipliers(1, 0.5, amplitude)
    assert np.all(multipliers.imag == 0.0)
    begins = np.arange(50.0, 250.0, 10.0)
    scene = parameters(launch_velocity=4.905, amplitude=amplitude, restitution=0.5)
    dt = [
        measure(
            scene,
            observe((phase, phase + 1e-3), duration=t + 10.0, transient=t, separation=True),
            workers,
        )["dt_min"][0]
        for t in begins
    ]
    slope = np.polyfit(begins, np.log(dt), 1)[0]
    assert dt[0] > 1e3 * dt[-1] > 0.0
    np.testing.assert_allclose(slope, np.log(np.abs(multipliers).max()), rtol=0.01)


# Independent landings agree with chance in their separations, order and gaps.

PERIODS = 1500
LANDINGS = 60
REALIZATIONS = 400


def independent(phases, particles=5, realizations=REALIZATIONS, frequency=2.0):
    """A record of landings in random periods, at most one in each, at the phases given."""
    random = np.random.default_rng(3)
    shape = realizations, particles
    period = np.stack([random.permutation(PERIODS)[:LANDINGS] for _ in range(np.prod(shape))])
    turns = np.sort(period.reshape(*shape, LANDINGS), axis=2) + phases(random, (*shape, LANDINGS))
    return xr.Dataset(
        {
            "landing_time": (("realization", "particle", "impact"), turns / frequency),
            "rested": (("realization", "particle", "impact"), np.zeros((*shape, LANDINGS), int)),
            "frequency": frequency,
            "phase": 0.0,
            "duration": PERIODS / frequency,
        }
    )


def uniform(random, shape):
    return random.uniform(0.0, 1.0, shape)


def peaked(random, shape):
    """The overlap of two such densities is I_0(8) / I_0(4)^2 = 3.35."""
    return random.vonmises(0.0, 4.0, shape) / (2.0 * np.pi) % 1.0


@pytest.mark.parametrize(("phases", "overlap"), [(uniform, 1.0), (peaked, 3.346)])
def test_independent_landings_are_exponential(phases, overlap):
    found = order_against_chance(independent(phases), surrogates=1)
    assert kstest(found["dt_min_over_chance"], "expon").pvalue > 0.01
    assert kstest(found["dt_min_chance"], "uniform").pvalue > 0.01
    assert float(found["phase_factor"].mean()) == pytest.approx(overlap, rel=0.02)


def test_peaked_phases_look_like_attraction_if_they_are_taken_as_uniform():
    """Without the overlap of phases, z would be smaller by that factor, and not exponential."""
    found = order_against_chance(independent(peaked), surrogates=1)
    naive = found["dt_min_over_chance"] / found["phase_factor"]
    assert kstest(naive, "expon").pvalue < 1e-6


def test_independent_phases_have_no_order_and_no_wide_gaps():
    found = order_against_chance(independent(uniform, particles=20), surrogates=1)
    for name in ("order_chance", "gap_chance"):
        assert kstest(found[name], "uniform").pvalue > 0.01


@pytest.mark.parametrize("phases", [uniform, peaked])
def test_shifts_by_whole_periods_leave_independent_landings_as_they_are(phases):
    found = order_against_chance(independent(phases, realizations=200), surrogates=39)
    assert kstest(found["dt_min_surrogate_share"], "uniform").pvalue > 0.01


def test_particles_that_avoid_each_other_are_not_chance():
    """Each of five lands in every fifth period, no two in the same: few surrogates keep that."""
    random = np.random.default_rng(5)
    period = 5.0 * np.arange(LANDINGS) + np.arange(5.0)[:, np.newaxis]
    record = independent(uniform, realizations=20, frequency=1.0)
    times = period + random.uniform(0.2, 0.8, (20, 5, LANDINGS))
    record["landing_time"] = ("realization", "particle", "impact"), times
    found = order_against_chance(record.assign(duration=5.0 * LANDINGS))
    assert float(found["dt_min_chance"].min()) > 0.95
    assert float(found["dt_min_surrogate_share"].min()) > 0.9


def test_locked_and_resting_particles_have_no_density_of_phases():
    locked = vs.simulate(launch_time=[0.1, 0.6], launch_velocity=4.905, duration=300.0)
    resting = vs.simulate(amplitude=5.0, launch_time=[0.1, 0.6], duration=60.0)
    chatter = vs.simulate(restitution=0.98, amplitude=0.0, launch_time=[0.1, 0.6], duration=30.0)
    for record in (locked, resting, chatter):
        found = order_against_chance(record, since=20.0)
        assert np.isnan(found["dt_min_over_chance"].item())
        assert 0.0 < found["dt_min_surrogate_share"].item() <= 1.0


def test_shifts_do_not_change_particles_locked_one_to_one():
    record = vs.simulate(launch_time=[0.43, 0.44, 1.5], launch_velocity=4.905, duration=600.0)
    found = order_against_chance(record, since=500.0)
    assert found["dt_min_surrogate_share"].item() == 1.0


def test_a_sweep_takes_uniform_phases():
    """The rate, sum n_i n_j over ordered pairs / window, is that of a record for uniform phases."""
    given = {"rebound": "reflect", "duration": 60.0, "restitution": 0.9}
    sweep = vs.sweep(
        **given,
        amplitude=[5.0, 7.0],
        launch=[0.0, 0.3, 0.6],
        separation=True,
        per_particle=True,
        progress=False,
    )
    record = vs.simulate(**given, amplitude=[5.0, 7.0], launch_time=[0.0, 0.3, 0.6])
    single = order_against_chance(record, surrogates=1)
    found = separations_against_chance(sweep)
    expected = single["coincidence_rate"] / single["phase_factor"]
    np.testing.assert_allclose(found["coincidence_rate"], expected, rtol=1e-12)
    np.testing.assert_array_equal(found["dt_min"], sweep["dt_min"])
    sweep["status"].values[1] = record["status"].values[1, 2] = Status.BUDGET_EXCEEDED
    for lost in (separations_against_chance(sweep), order_against_chance(record, surrogates=1)):
        assert np.isfinite(lost["dt_min_over_chance"].values).tolist() == [True, False]


def test_impossible_comparisons_with_chance_are_refused():
    record = vs.simulate(duration=5.0)
    with pytest.raises(ParameterError, match="less than a forcing period"):
        order_against_chance(record, since=4.5)
    with pytest.raises(ParameterError, match="at least 1"):
        order_against_chance(record, surrogates=0)
    with pytest.raises(DataError, match="per_particle"):
        separations_against_chance(vs.sweep(realizations=2, separation=True, progress=False))
    assert np.isnan(order_against_chance(record)["dt_min_surrogate_share"].item())


# A dataset that lacks what an analysis needs: the message names variable and key.


def test_variables_that_are_present_pass():
    dataset = xr.Dataset({"dt_min": ("realization", [1.0])}, coords={"amplitude": 1.2})
    require(dataset, "separation statistics", "dt_min", "amplitude")


def test_each_missing_variable_is_named_with_its_key():
    dataset = xr.Dataset({"impact_count": ("realization", [1])})
    with pytest.raises(DataError) as caught:
        require(dataset, "separation statistics", "impact_count", "dt_min", "cycle_impacts")
    message = str(caught.value)
    assert "separation statistics" in message
    assert "dt_min (set separation = true in the [measure] section" in message
    assert "cycle_impacts (set regimes = true in the [measure] section" in message
    assert "impact_count" not in message


def test_the_function_is_named_whose_result_is_taken():
    basins = xr.Dataset({"regime": ("attractor", [2])})
    with pytest.raises(DataError, match=r"^capacity .*basins.*fraction$"):
        require(basins, "capacity", "regime", "fraction", source="basins")


def test_landings_come_from_a_record():
    assert "[record]" in remedy("landing_time")


# Shares against a parameter, of realizations, particles and replicas.


def shared(free, locked, amplitude):
    """A sweep of four particles that holds nothing but what shares need."""
    return xr.Dataset(
        {
            "collision_free": ("realization", np.asarray(free, np.int8)),
            "locked_count": ("realization", np.asarray(locked)),
        },
        coords={"amplitude": ("realization", np.asarray(amplitude, float))},
        attrs={"particles": 4},
    )


def test_shares_are_those_of_the_realizations_between_the_ends():
    random = np.random.default_rng(0)
    a, locked = random.uniform(0.5, 3.5, 400), random.integers(0, 5, 400)
    sweep = shared(a > 2.0, locked, a)
    for of, values in (("collision_free", a > 2.0), ("locked", locked / 4.0)):
        found = share_against(sweep, "amplitude", of=of, bins=5)
        assert found.sizes["part"] == 5
        for one in (found.isel(part=k) for k in range(5)):
            low, high = float(one.amplitude_low), float(one.amplitude_high)
            own = (a >= low) & ((a < high) | (high == a.max()))
            assert float(one.share) == pytest.approx(values[own].mean())
            assert float(one.share_low) <= float(one.share) <= float(one.share_high)


def test_intervals_are_exact_and_each_value_of_a_grid_has_its_own():
    free = [1, 1, 0, -1, 0, 0, 0, 0, -1, -1]
    found = share_against(
        shared(free, [0] * 10, [1.0] * 4 + [2.0] * 4 + [3.0] * 2), "amplitude", of="collision_free"
    )
    np.testing.assert_array_equal(found.amplitude_low, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(found.amplitude_high, [1.0, 2.0, 3.0])
    np.testing.assert_allclose(found.share, [2.0 / 3.0, 0.0, np.nan])
    for k, (held, tried) in enumerate([(2, 3), (0, 4)]):
        exact = binomtest(held, tried).proportion_ci(0.95, method="exact")
        ends = [float(found[f"share_{side}"][k]) for side in ("low", "high")]
        np.testing.assert_allclose(ends, [exact.low, exact.high], rtol=1e-9)


def test_regimes_of_a_grid_add_up_and_are_drawn():
    sweep = vs.sweep(
        restitution=[0.8, 0.9, 0.95], amplitude=[1.0, 2.0, 4.0, 7.0], particles=3, duration=60.0,
        separation=True, per_particle=True, regimes=True,
    )  # fmt: skip
    names = [regime.meaning for regime in vs.Regime]
    found = [share_against(sweep, "amplitude", of=name) for name in names]
    np.testing.assert_allclose(sum(one.share for one in found), 1.0)
    np.testing.assert_array_equal(found[0].amplitude_low, [1.0, 2.0, 4.0, 7.0])
    axes = share_curves(found, names)
    for line, one in zip(axes.lines, found, strict=True):
        np.testing.assert_array_equal(line.get_xdata(), one.amplitude_low)
        np.testing.assert_array_equal(line.get_ydata(), one.share)
    assert "$A$" in axes.get_xlabel()
    other = share_against(sweep, "restitution", of="locked")
    with pytest.raises(ParameterError, match=r"one parameter .*amplitude, restitution"):
        share_curves([found[0], other], ["a", "b"])
    with pytest.raises(ParameterError, match="labels: 1 of them for 2"):
        share_curves(found[:2], ["a"])
    with pytest.raises(DataError, match="result of share_against"):
        share_curves([sweep], ["a"])


def test_shares_of_windows_under_noise_are_those_of_the_replicas():
    windows = vs.windows(
        restitution=0.9, amplitude=[0.4, 0.6, 1.2], kick_noise=0.05, duration_periods=50.0,
        noise_replicas=20, tolerance=0.5,
    )  # fmt: skip
    found = share_against(windows, "amplitude", of="locked(1)")
    np.testing.assert_array_equal(found.share, windows.share.values.ravel())
    np.testing.assert_array_equal(found.amplitude_high, [0.4, 0.6, 1.2])
    assert found.share.values[0] == 0.0 < found.share.values[2]
    assert share_against(windows.isel(restitution=0), "amplitude", of="locked(1)").equals(found)
    with pytest.raises(ParameterError, match=r'of = .locked.*"locked\(1\)"'):
        share_against(windows, "amplitude", of="locked")
    with pytest.raises(ParameterError, match="must be amplitude"):
        share_against(windows, "restitution", of="locked(1)")
    with pytest.raises(DataError, match="one restitution"):
        share_against(windows.isel(restitution=[0, 0]), "amplitude", of="locked(1)")
    with pytest.raises(DataError, match="under noise"):
        share_against(windows.drop_vars("share"), "amplitude", of="locked(1)")


def test_what_a_sweep_does_not_know_is_named():
    sweep = shared([1, 0], [4, 0], [1.0, 2.0])
    with pytest.raises(ParameterError, match=r"of = .chaos.: must be .*unsettled"):
        share_against(sweep, "amplitude", of="chaos")
    with pytest.raises(DataError, match=r"resting_count .*regimes = true"):
        share_against(sweep, "amplitude", of="resting")
    with pytest.raises(DataError, match="differ in amplitude"):
        share_against(sweep.isel(realization=[0]), "amplitude", of="locked")
    with pytest.raises(DataError, match="is not a dataset"):
        share_against("out.h5", "amplitude", of="locked")
