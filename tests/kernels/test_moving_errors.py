"""The Jacobian and the bounds of errors on the moving base, against exact impacts and orbits."""

import math

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import assume, given
from hypothesis import strategies as st

from proved_pieces import first_landing
from vibrosweep.kernels import bases
from vibrosweep.kernels.advance import Options, Share, advance, memory_around
from vibrosweep.kernels.arithmetic import ROUNDING
from vibrosweep.kernels.bases import StateError
from vibrosweep.kernels.cycles import empty_cycles, empty_rests
from vibrosweep.kernels.impact import Batch, base_of, impact, launch_speed
from vibrosweep.kernels.settle import EXACT, GROWTH_SIZE, Search, empty_orbits, settle
from vibrosweep.kernels.statistics import empty_statistics, scratch
from vibrosweep.kernels.trust import empty_trust, trust
from vibrosweep.model.measures import Regime, Status
from vibrosweep.model.parameters import Launches, dimensionless
from vibrosweep.proof.reference.trajectories import trajectory

BITS = 256
BASE = base_of("moving", "rest")

restitutions = st.sampled_from([0.0, 1.0]) | st.floats(0.0, 1.0)
accelerations = st.just(0.0) | st.floats(-2.0, 1.0).map(lambda power: 10.0**power)
phases = st.sampled_from([-0.5, -0.25, 0.0, 0.25]) | st.floats(-0.5, 0.5)
speeds = st.floats(-5.0, 0.7).map(lambda power: 10.0**power)
fractions = st.floats(-1.0, 1.0)


@pytest.fixture(scope="session")
def problem_of(parameters):
    """Realizations in units of the forcing: gravity 2 and frequency 1, so that A is the kick."""

    def make(e, gamma, duration=1.0, transient=-math.inf, r=1e-4, **given):
        a = (1.0 + np.asarray(e)) * np.asarray(gamma) / math.pi
        given = {"gravity": 2.0, "frequency": 1.0, "contact_time": r} | given
        scene = parameters(restitution=e, amplitude=a, **given)
        return dimensionless(scene, duration, transient)

    return make


def flight_of(fixed, x, y):
    return impact(fixed, 0.0, x, y).flight


def exact_image(e, a, x, y):
    """Phase and speed after an impact, as balls; x and y may be balls too."""
    s, z = first_landing(e, a, x, y, bits=BITS) if a > 0.0 else (y, y)
    return x + s, e * z


@given(restitutions, accelerations, phases, speeds)
def test_the_jacobian_is_the_derivative_of_the_exact_impact(problem_of, e, gamma, x, y):
    problem = problem_of(e, gamma)
    fixed = bases.constants(BASE, problem, 0)
    flight = flight_of(fixed, x, y)
    added = bases.landing_added(fixed, flight, EXACT)
    assume(added.phase < 1e-9)  # no graze
    xx, xu, ux, uu, terms = bases.jacobian(fixed, flight)
    of_phase, of_speed, _ = bases.jacobian_error(fixed, flight, 0.0, EXACT)
    with ctx.workprec(BITS):
        a, h, x, y = float(problem.kick[0]), arb(2) ** -80, arb(x), arb(y)
        pairs = (
            ((xx, ux), of_phase, exact_image(e, a, x + h, y), exact_image(e, a, x - h, y)),
            ((xu, uu), of_speed, exact_image(e, a, x, y + h), exact_image(e, a, x, y - h)),
        )
        for entries, changed, ahead, behind in pairs:
            # the third derivative times h^2, which exceeds a rounding error only next to a graze
            allowed = ROUNDING * terms + changed + 2.0**-100 * terms**5
            for entry, one, other in zip(entries, ahead, behind, strict=True):
                assert float(abs((one - other) / (2 * h) - entry).abs_upper()) <= allowed
    determinant = xx * uu - xu * ux
    size = (abs(xx) + abs(xu)) * (abs(ux) + abs(uu))
    relative = (of_phase + of_speed + 4.0 * ROUNDING * terms) * (abs(xx) + abs(xu) + abs(uu) + 1.0)
    assert determinant == pytest.approx(e * flight.u / flight.v, abs=relative + 1e-15 * size)


@given(
    restitutions,
    accelerations,
    phases,
    speeds,
    st.tuples(*2 * [st.floats(-16.0, -3.0).map(lambda power: 10.0**power)]),
    st.tuples(fractions, fractions),
)
def test_every_state_within_an_error_lands_within_its_bound(
    problem_of, e, gamma, x, y, spread, part
):
    spread = StateError(spread[0], spread[1] * y)
    problem = problem_of(e, gamma)
    fixed = bases.constants(BASE, problem, 0)
    flight = flight_of(fixed, x, y)
    added = bases.landing_added(fixed, flight, spread)
    assume(added.phase < np.inf)
    xx, xu, ux, uu, terms = bases.jacobian(fixed, flight)
    kicked = bases.rebound_error(fixed, flight, added, added.phase, spread)
    dx, dy = spread.phase * part[0], spread.speed * part[1]
    slack = ROUNDING * terms * (abs(dx) + abs(dy))
    with ctx.workprec(BITS):
        x_land, w = exact_image(e, float(problem.kick[0]), arb(x) + dx, arb(y) + dy)
        off = x_land - flight.landing - (xx * dx + xu * dy)
        off -= round(float(off))
        assert float(abs(off).abs_upper()) <= added.phase + slack
        off = w - bases.rebound(fixed, flight.landing, flight.v) - (ux * dx + uu * dy)
        assert float(abs(off).abs_upper()) <= kicked + slack


def test_few_flights_are_in_doubt(problem_of):
    rng = np.random.default_rng(3)
    gammas = 10.0 ** rng.uniform(-2.0, 1.0, 400)
    problem = problem_of(rng.uniform(0.0, 1.0, 400), gammas)
    found = []
    for i, gamma in enumerate(gammas):
        fixed = bases.constants(BASE, problem, i)
        flight = flight_of(fixed, rng.uniform(-0.5, 0.5), 10.0 ** rng.uniform(-5.0, 0.7))
        found.append(bases.landing_added(fixed, flight, StateError(1e-12, 1e-12 * flight.u)).phase)
        assert gamma > 1.0 or found[-1] < 1e-10
    assert np.mean(np.array(found) < 1e-9) > 0.99


def test_a_landing_that_may_come_earlier_is_in_doubt(problem_of):
    fixed = bases.constants(BASE, problem_of(0.5, 5.0), 0)
    doubted = 0
    for x in np.linspace(-0.45, 0.45, 19).tolist():
        grid = np.linspace(0.05, 3.0, 400)
        s = np.array([bases.fly(fixed, x, y)[0] for y in grid.tolist()])
        for k in np.flatnonzero(np.abs(np.diff(s)) > 0.2):
            low, high = grid[k], grid[k + 1]  # in between, a root appears or vanishes
            while high - low > 4.0 * np.spacing(low):
                middle = 0.5 * (low + high)
                near_low = abs(bases.fly(fixed, x, middle)[0] - s[k]) < 0.1
                low, high = (middle, high) if near_low else (low, middle)
            for y in (low, high):
                flight = flight_of(fixed, x, float(y))
                assert bases.landing_added(fixed, flight, StateError(1e-15, 1e-15)) == (
                    np.inf,
                    np.inf,
                )
                doubted += 1
    assert doubted > 10


@pytest.mark.parametrize("gamma", [0.3, 1.7, 6.0])
def test_a_doubtful_rest_is_reported(problem_of, gamma):
    fixed = bases.constants(BASE, problem_of(0.5, gamma, r=1e-3), 0)
    doubt = bases.rest_is_doubtful
    assert doubt(fixed, 0.1, 1e-3, StateError(1e-9, 1e-9))
    assert not doubt(fixed, 0.1, 1.1e-3, StateError(1e-9, 1e-9))
    assert not doubt(fixed, 0.1, 0.9e-3, StateError(1e-9, 1e-9))
    if gamma > 1.0:  # where the base falls faster than gravity, there is no rest
        edge = fixed.x_lift
        assert edge == pytest.approx(math.acos(-1.0 / gamma) / (2.0 * math.pi), abs=1e-15)
        assert not doubt(fixed, edge + 1e-6, 1e-3, StateError(1e-9, 1e-9))
        assert doubt(fixed, -edge + 1e-10, 0.9e-3, StateError(1e-9, 1e-9))
        assert not doubt(fixed, -edge + 1e-6, 0.9e-3, StateError(1e-9, 1e-9))


@pytest.mark.parametrize("away", [1e-15, 1e-12, 1e-6, 0.1, 9.0])
def test_the_phase_of_a_lift_off_is_within_its_error(problem_of, away):
    problem = problem_of(0.7, 1.0 + away)
    fixed = bases.constants(BASE, problem, 0)
    error, of_speed = bases.liftoff_error(fixed)
    with ctx.workprec(BITS):
        gamma = arb.pi() * arb(float(problem.kick[0])) / (1 + arb(0.7))
        if not gamma > 1 or away < 1e-14:
            assert error == np.inf
            return
        exact = (-1 / gamma).acos() / (2 * arb.pi())
        assert (
            float(abs(exact - float(fixed.x_lift)).abs_upper())
            <= error
            < 1e-15 / min(1.0, away) ** 0.5
        )
    assert of_speed == 0.0
    still = bases.constants(BASE, problem_of(0.7, 1.0 - away), 0)
    assert bases.liftoff_error(still)[0] == (0.0 if away > 1e-14 else np.inf)


def scenes(size, seed):
    rng = np.random.default_rng(seed)
    e, gamma = rng.uniform(0.0, 1.0, size), 10.0 ** rng.uniform(-2.0, 1.0, size)
    e[::9] = 0.0
    return e, gamma, rng.uniform(0.0, 3.0, size), 2.0 * math.pi * rng.uniform(-0.5, 0.5, size)


def test_every_landing_lies_within_its_bound(problem_of):
    size, duration = 120, 20.0
    e, gamma, speed, phase = scenes(size, 5)
    problem = problem_of(e, gamma, duration, r=1e-3, launch_velocity=speed, phase=phase)
    batch = Batch(BASE, problem, Launches(np.zeros((1, 1)), np.zeros((1, 1))))
    out = empty_trust(size)
    trust(0, size, batch, np.full(size, 1e-9), 10_000, out)
    known = 0
    for i in np.flatnonzero(np.isfinite(out.landing_error)):
        given = {"restitution": e[i], "amplitude": (1.0 + e[i]) * gamma[i] / math.pi}
        exact = trajectory(
            **given,
            frequency=1.0,
            gravity=2.0,
            phase=phase[i],
            launch_velocity=speed[i],
            contact_time=1e-3,
            launch_time=0.0,
            duration=duration,
            base="moving",
        )
        fixed = bases.constants(BASE, problem, i)
        n, x = 0.0, problem.phase[i]
        u = launch_speed(fixed, problem, i, x)
        for truth in exact.impacts:
            hit = impact(fixed, n, x, u)
            whole = round(float(truth.phase) + truth.count - hit.n - hit.x)  # turns of the phase
            off = (truth.phase - float(hit.x)) + (truth.count - int(hit.n) - whole)
            assert float(abs(off).abs_upper()) <= out.landing_error[i]
            assert truth.rested == (not hit.leaves)
            if truth.rebound_velocity is not None:
                left = bases.speed(fixed, hit.x_off, hit.u)
                faster = float(abs(truth.rebound_velocity - left).abs_upper())
                assert faster <= out.flight_error[i]
            n, x, u = hit.n_off, hit.x_off, hit.u
            known += 1
    assert known > 1000
    assert np.isfinite(out.landing_error).mean() > 0.9
    assert np.nanmedian(out.landing_error) < 1e-11


def test_the_errors_of_a_particle_put_on_the_base_are_bounded(problem_of):
    problem = problem_of(0.6, [0.5, 2.0], 5.0, launch_velocity=0.0)
    batch = Batch(BASE, problem, Launches(np.zeros((1, 1)), np.zeros((1, 1))))
    out = empty_trust(2)
    trust(0, 2, batch, np.full(2, 1e-9), 10_000, out)
    assert np.all(out.landing_error < 1e-12)


@pytest.fixture(scope="session")
def followed(problem_of):
    """Statistics, cycles and orbits of 700 particles, with and without skipping of cycles."""
    e, gamma, speed, phase = scenes(700, 11)
    problem = problem_of(e, gamma, 400.0, launch_velocity=speed, phase=phase)
    batch = Batch(BASE, problem, Launches(np.zeros((1, 1)), np.zeros((1, 1))))
    found = []
    for jump in (1, 0):
        out, memory = empty_statistics(700), memory_around(scratch())
        cycles, rests = empty_cycles(700), empty_rests(out.kinds)
        given = batch, Options(600_000, 0.0, 1, jump), False, memory, out, cycles, rests
        advance(Share(700, 700, advance(Share(0, 700, 0), *given)), *given)
        found.append((out, cycles))
    orbits = empty_orbits(700)
    plain, search = found[0][0]._replace(kinds=()), Search(600_000, 1)
    settle(0, 700, batch, plain, found[0][1], search, np.empty(GROWTH_SIZE), orbits)
    return e, gamma, found[0][0], found[1][0], orbits


def test_skipping_of_cycles_changes_sums_by_rounding_only(followed):
    _, _, skipped, simulated, _ = followed
    for name in ("flight_sum", "height_sum"):
        assert skipped.total(name) == pytest.approx(simulated.total(name), rel=1e-12)
    for name in ("landings", "rests", "height_max"):
        assert np.array_equal(skipped.total(name), simulated.total(name)), name
    assert np.array_equal(skipped.at_rest, simulated.at_rest)
    assert np.all(simulated.status == Status.COMPLETED)
    assert np.all(skipped.status == Status.COMPLETED)


def test_regimes_of_the_moving_base(followed):
    e, gamma, each, _, orbits = followed
    counts = {regime: np.count_nonzero(orbits.regime == regime) for regime in Regime}
    assert all(counts[regime] > 10 for regime in Regime)
    assert np.array_equal(orbits.regime == Regime.AT_REST, each.at_rest == 1)
    assert not np.any(each.at_rest[gamma > 1.0])
    assert not np.any(orbits.rests[gamma <= 1.0])
    rests = (orbits.regime == Regime.RESTING) | (orbits.regime == Regime.AT_REST)
    assert np.all(orbits.largest[rests] == -np.inf)
    locked = (orbits.regime == Regime.LOCKED) & (e > 0.0)
    assert np.all(orbits.uncertain[locked] == 0)
    # the larger multiplier has at least the modulus sqrt(det), e per impact; a pair has just that
    per_impact = np.abs(orbits.multiplier[locked]) ** (1.0 / orbits.impacts[locked])
    assert np.all(per_impact >= e[locked] * (1.0 - 1e-6))


def test_exponents_sum_to_twice_the_logarithm_of_the_restitution(followed):
    e, _, _, _, orbits = followed
    bounces = np.isfinite(orbits.total)
    assert bounces.sum() > 50
    off = np.abs(orbits.total[bounces] - 2.0 * np.log(e[bounces]))
    assert np.all(off <= orbits.total_error[bounces])
    assert np.median(orbits.total_error[bounces]) < 1e-10


def test_decisions_of_locked_orbits_at_a_closed_form(problem_of):
    # the exact orbit: sin(2 pi x) = (1 - e) k / a with cos < 0, flights of k periods
    e, gamma = 0.3, 2.0
    problem = problem_of(e, gamma)
    fixed = bases.constants(BASE, problem, 0)
    x = 0.5 - math.asin((1.0 - e) / float(problem.kick[0])) / (2.0 * math.pi)
    y = e * 2.0 / (1.0 + e)  # z = 2 k / (1 + e)
    flight = flight_of(fixed, x, y)
    assert flight.time == pytest.approx(1.0, abs=1e-14)
    assert flight.v == pytest.approx(y / e, abs=1e-13)
    assert max(bases.landing_added(fixed, flight, EXACT)) < 1e-14
