"""Independent landings agree with chance in their separations, order and gaps."""

import numpy as np
import pytest
import xarray as xr
from scipy.stats import kstest

import vibrosweep as vs
from vibrosweep.analysis import order_against_chance, separations_against_chance
from vibrosweep.errors import DataError, ParameterError
from vibrosweep.model.measures import Status

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
