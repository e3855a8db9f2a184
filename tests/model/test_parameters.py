"""Physical parameters, and the change to dimensionless form against exact arithmetic."""

import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import example, given
from hypothesis import strategies as st

from vibrosweep.errors import ParameterError
from vibrosweep.model.parameters import (
    MAX_PERIODS,
    MOUNT,
    PARAMETERS,
    SMALLEST,
    STAGGERED,
    Periods,
    dimensionless,
    launches,
    mounts,
    representable,
)


def turns_off(count, phase, exact):
    """Distance in turns between the sum of count and phase and the exact value."""
    return abs(Fraction(float(count)) + Fraction(float(phase)) - exact)


@given(phi=st.floats(-1e9, 1e9, allow_subnormal=False))
@example(phi=math.pi)
@example(phi=-math.pi)
@example(phi=1e9)
@example(phi=5e8 * math.pi)
def test_phase_in_turns_is_that_of_the_exact_radians(phi, parameters):
    turns = dimensionless(parameters(phase=phi), 12.0).phase[0]
    with ctx.workprec(200):
        exact = arb(phi) / (2 * arb.pi())
        off = abs(exact - arb(turns) - round(float(exact) - turns))
        # the last sum is below 1 and rounded, as is the reduced quotient
        assert off < 2.0**-53
    assert -0.5 <= turns <= 0.5


def test_table_1_in_dimensionless_form(parameters):
    problem = dimensionless(parameters(amplitude=1.2), 12.0)
    assert problem.kick[0] == pytest.approx(0.244648, abs=5e-7)
    assert problem.launch_flight[0] == pytest.approx(1.019368, abs=5e-7)
    assert problem.rest_flight[0] == 1e-4
    assert (problem.end_count[0], problem.end_phase[0]) == (12.0, 0.0)
    assert (problem.begin_count[0], problem.begin_phase[0]) == (0.0, 0.0)


def test_the_arrays_of_kernels_have_one_layout(parameters):
    """Kernels are compiled for each layout that they meet, which takes seconds."""
    given = parameters()
    columns = np.stack([np.repeat(values, 3) for values in given.values()], axis=1)
    strided = dict(zip(given, columns.T, strict=True))
    repeated = {name: np.broadcast_to(values[0], 3) for name, values in given.items()}
    for passed in (strided, repeated):
        problem = dimensionless(passed, Periods(2.0), 0.5)
        assert problem.noise is None
        for values in problem._replace(noise=problem.kick):
            assert values.shape == (3,)
            assert values.flags.c_contiguous
            assert values.flags.writeable


def test_dimensionless_form_is_that_of_exact_arithmetic(random_scenes):
    scenes = random_scenes(seed=1, size=300)
    problem = dimensionless(scenes, 12.0, transient=3.0)
    for i in range(300):
        p = {name: Fraction(float(values[i])) for name, values in scenes.items()}
        unit = 2 * p["frequency"] / p["gravity"]
        for found, exact, roundings in (
            (problem.kick[i], unit * p["amplitude"], 2),
            (problem.launch_flight[i], unit * p["launch_velocity"], 2),
            (problem.rest_flight[i], p["frequency"] * p["contact_time"], 1),
        ):
            assert abs(Fraction(float(found)) - exact) <= exact * roundings * Fraction(1, 2**52) / 2
        shared = Fraction(float(problem.phase[i]))
        for seconds, count, phase in (
            (3, problem.begin_count[i], problem.begin_phase[i]),
            (12, problem.end_count[i], problem.end_phase[i]),
        ):
            assert turns_off(count, phase, p["frequency"] * seconds + shared) <= Fraction(3, 2**54)
    assert np.array_equal(problem.restitution, scenes["restitution"])


def test_a_resting_particle_lifts_off_where_the_kick_rises_through_the_contact_time(random_scenes):
    problem = dimensionless(random_scenes(seed=2, size=300), 12.0)
    lifts = problem.kick > problem.rest_flight
    assert 0 < lifts.sum() < lifts.size
    x, a, r = problem.liftoff_phase[lifts], problem.kick[lifts], problem.rest_flight[lifts]
    assert np.all((x >= 0.0) & (x <= 0.25))
    assert np.all(np.abs(a * np.sin(2.0 * np.pi * x) - r) <= 1e-15 * a)
    assert np.all(problem.liftoff_phase[~lifts] == 0.0)


def test_an_endless_window_begins_before_every_landing(parameters):
    problem = dimensionless(parameters(), 12.0, transient=-math.inf)
    assert problem.begin_count[0] == -math.inf


@pytest.mark.parametrize("particles", [1, 2, 3, 7, 20])
def test_staggered_launches_share_one_period_evenly(particles):
    count, phase = launches(STAGGERED, particles, np.array([0.3, 7.0]))
    assert count.shape == phase.shape == (1, particles)
    exact = [Fraction(j, particles) for j in range(particles)]
    for j in range(particles):
        assert turns_off(count[0, j], phase[0, j], exact[j]) <= Fraction(1, 2**53)


def test_listed_launches_at_one_frequency_are_kept_once():
    found = launches((0.0, 0.3, -1.25), 3, np.array([2.0, 2.0]))
    assert found.whole.shape == (1, 3)
    assert np.array_equal(found.whole[0], [0, 1, -2])
    assert np.array_equal(found.phase[0], [0.0, 0.6 - 1.0, -0.5])


def test_listed_launches_follow_the_frequency():
    times, frequency = (0.0, 0.3, -1.25, 1e6), np.array([0.7, 2.0])
    found = launches(times, 4, frequency)
    for i in range(2):
        for j in range(4):
            exact = Fraction(float(frequency[i])) * Fraction(times[j])
            assert turns_off(found.whole[i, j], found.phase[i, j], exact) <= Fraction(1, 2**53)


def test_every_default_is_allowed():
    for parameter in PARAMETERS.values():
        assert parameter.accepts(parameter.default)


@pytest.mark.parametrize("name", PARAMETERS)
def test_a_range_is_kept_and_put_into_words(name):
    parameter = PARAMETERS[name]
    below = np.nextafter(parameter.low, -math.inf)
    above = np.nextafter(parameter.high, math.inf)
    assert not parameter.accepts([math.nan, math.inf, -math.inf, below, above]).any()
    assert parameter.accepts([parameter.low, parameter.high]).all()
    assert f"at least {parameter.low:g} and at most {parameter.high:g}" in parameter.allowed
    assert parameter.units == "1" or parameter.units in parameter.allowed


def test_no_corner_of_the_ranges_leaves_double_precision(parameters):
    """Neither inputs of kernels, nor squares of flights, nor units of results."""
    ends = [(p.low, p.high) for p in PARAMETERS.values()]
    corners = dict(zip(PARAMETERS, np.array(list(itertools.product(*ends))).T, strict=True))
    with np.errstate(all="raise"):
        problem = dimensionless(parameters(**corners), 1e-9)
        flights = np.stack([problem.kick, problem.launch_flight, problem.rest_flight])
        tiny = np.finfo(float).tiny
        some = flights[flights > 0.0]
        assert np.all(some**2 > tiny)
        # at e = 1 a flight grows by a kick at each of at most MAX_PERIODS landings
        period = corners["gravity"] / (8.0 * corners["frequency"] ** 2)
        assert np.all(period > tiny)
        assert np.isfinite((flights * MAX_PERIODS) ** 2 * MAX_PERIODS * period).all()


@pytest.mark.parametrize("time", [1e16, 1e302, 1e308, -1e308])
def test_times_beyond_counting_are_refused_without_a_warning(time, parameters):
    scene = parameters(frequency=[1e9, 1.0, SMALLEST])
    assert representable(scene, [time]).tolist() == [False, False, abs(time) < 1e40]
    with pytest.raises(ParameterError, match=r"^duration = "):
        dimensionless(scene, time)
    with pytest.raises(ParameterError, match=r"^launch time = "):
        launches((0.0, time), 2, scene["frequency"])


def test_periods_that_cannot_be_counted_are_refused(parameters):
    scene = parameters(frequency=[1.0, 4.0])
    assert dimensionless(scene, MAX_PERIODS / 4.0).end_count[1] == MAX_PERIODS
    with pytest.raises(ParameterError, match=r"^duration = 1e\+15 s is 4e\+15 forcing periods"):
        dimensionless(scene, 1e15)
    with pytest.raises(ParameterError, match=r"^transient = 1e\+15 s is 4e\+15 forcing periods"):
        dimensionless(scene, 12.0, transient=1e15)
    with pytest.raises(ParameterError, match=r"^launch time = 1e\+16 s is 1e\+16 forcing periods"):
        launches((0.0, -1e16), 2, np.array([1.0]))


def test_a_mount_is_expressed_in_units_of_the_forcing(parameters):
    given = {"mass_ratio": 0.004, "mount_frequency": 3.0, "mount_damping": 0.1}
    scene = parameters(frequency=[6.0, 12.0]) | {n: np.full(2, v) for n, v in given.items()}
    found = mounts(scene, None, None)
    assert np.array_equal(found.mass_ratio, [0.004, 0.004])
    assert np.array_equal(found.natural, [0.5, 0.25])
    assert np.array_equal(found.damping, [0.1, 0.1])
    assert tuple(MOUNT) == tuple(given)
