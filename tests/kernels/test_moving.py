"""Flights over the moving base, and bounds of their errors."""

import math
from functools import partial

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import assume, given
from hypothesis import strategies as st

from first_roots import (
    LARGEST_ERROR,
    MOST_GRAZES,
    Flights,
    clearance,
    first_root,
    judge,
    lift_offs,
    shaped,
    touching,
    wide,
)
from proved_pieces import first_landing
from tests import general
from tests.cases import each_of
from vibrosweep.engine.landings import recorded
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels import bases
from vibrosweep.kernels.advance import Options, Share, advance, memory_around
from vibrosweep.kernels.arithmetic import ROUNDING
from vibrosweep.kernels.bases import StateError, constants, fitted
from vibrosweep.kernels.cycles import empty_cycles, empty_rests
from vibrosweep.kernels.impact import Batch, base_of, impact, launch, launch_speed
from vibrosweep.kernels.record import Units
from vibrosweep.kernels.settle import EXACT, GROWTH_SIZE, Search, empty_orbits, settle
from vibrosweep.kernels.statistics import empty_statistics, scratch
from vibrosweep.kernels.trust import empty_trust, trust
from vibrosweep.model.measures import Regime, Status
from vibrosweep.model.parameters import PARAMETERS, Launches, dimensionless, launches
from vibrosweep.proof.reference.trajectories import trajectory
from vibrosweep.scene.scene import Scene

# Streaming over the moving base in passes, against whole flights followed one by one.

PARTICLES = 5


def problem(size, most, periods, seed=1, **fixed):
    """Realizations with accelerations of the base up to `most`."""
    draw = np.random.default_rng(seed)
    restitution = fixed.get("restitution", draw.uniform(0.0, 1.0, size))
    given = {name: np.full(size, p.default) for name, p in PARAMETERS.items()}
    given["restitution"] = restitution
    acceleration = draw.uniform(0.0, most, size)
    given["amplitude"] = (1.0 + restitution) * acceleration * 9.81 / (2.0 * np.pi)
    given["contact_time"] = 10.0 ** draw.uniform(-6.0, -2.0, size)
    return dimensionless(given, periods), launches("staggered", PARTICLES, given["frequency"])


def streamed(base, scene, launch, budget=600_000, run=general.advance):
    total = scene.kick.size * PARTICLES
    out, memory = empty_statistics(total), memory_around(scratch())
    given = Batch(base, scene, launch), Options(budget), None, memory, out, None, None
    lanes = run(Share(0, total, 0), *given)
    while lanes:
        lanes = run(Share(total, total, lanes), *given)
    return out


def same(one, other, which=slice(None)):
    names = ("totals", "at_rest", "status")
    pairs = ((getattr(one, name)[..., which], getattr(other, name)[..., which]) for name in names)
    return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)


def followed(batch, landing, lift_off, rests):
    """Times of landings and lift-offs in periods, one impact after the other."""
    problem, particles = batch.problem, batch.launches.whole.shape[1]
    for t in range(rests.size):
        i, p = t // particles, t % particles
        fixed = constants(batch.base, problem, i)
        n, x = launch(batch.launches, i, p, problem.phase[i])
        u = launch_speed(fixed, problem, i, x)
        for k in range(landing.shape[1]):
            hit = impact(fixed, n, x, u)
            if not hit.n - problem.end_count[i] <= problem.end_phase[i] - hit.x:
                break
            landing[t, k] = hit.n + hit.x
            rests[t] += 0 if hit.leaves else 1
            n, x, u = hit.n_off, hit.x_off, hit.u
            if n == np.inf:
                break
            lift_off[t, k] = n + x


def one_by_one(batch, capacity):
    size = batch.problem.kick.size * PARTICLES
    landing, lift_off = (np.full((size, capacity), np.nan) for _ in range(2))
    rests = np.zeros(size, np.int64)
    followed(batch, landing, lift_off, rests)
    return landing, lift_off, rests


@pytest.mark.parametrize("name", ["high-bounce", "moving"])
def test_a_record_equals_impacts_that_are_followed_one_by_one(name):
    """There are more trajectories than lanes in a block, and some have too little room."""
    scene, starts = problem(20, 6.0, 10.0)
    base = base_of(name, "rest")
    landing, lift_off, rests = one_by_one(Batch(base, scene, starts), 3000)
    room = np.isfinite(landing).sum(axis=1)
    room[::7] //= 3
    ones = np.ones(scene.kick.size)
    like = Scene(particles=PARTICLES, base=name, duration=10.0).recorded()
    with Workers(2) as workers:
        found, each = recorded(scene, starts, like, workers, Units(ones, ones), room)
    kept = np.arange(3000) < room[:, np.newaxis]
    phase = np.repeat(scene.phase, PARTICLES)[:, np.newaxis]
    assert found.landing_time == pytest.approx((landing - phase)[kept], rel=1e-15, abs=1e-15)
    assert found.liftoff_time == pytest.approx(
        (lift_off - phase)[kept], rel=1e-15, abs=1e-15, nan_ok=True
    )
    assert np.array_equal(each.landings, np.isfinite(landing).sum(axis=1))
    assert np.array_equal(each.total("rests"), rests)


def test_without_arcs_the_bits_are_the_same():
    scene, launch = problem(200, 1.0, 40.0)
    base = base_of("moving", "rest")
    less = fitted(base, scene)
    assert less.beyond_gravity is None
    assert same(streamed(base, scene, launch), streamed(less, scene, launch, run=advance))
    lifting, _ = problem(200, 2.0, 40.0)
    assert fitted(base, lifting) == base


def test_passes_over_all_lanes_equal_flights_that_are_followed_one_by_one():
    scene, starts = problem(20, 6.0, 10.0)
    base = base_of("moving", "rest")
    found = streamed(base, scene, starts)
    assert set(found.status) == {Status.COMPLETED}
    landing, lift_off, rests = one_by_one(Batch(base, scene, starts), int(found.landings.max()) + 1)
    seen = np.isfinite(landing)
    assert np.array_equal(seen.sum(axis=1), found.landings)
    assert np.array_equal(rests, found.total("rests"))
    # all flights but the last one, which ends after the record does
    flown = np.nansum(landing[:, 1:] - lift_off[:, :-1], axis=1)
    assert np.all(found.total("flight_sum") >= flown - 1e-11)
    stays = found.at_rest == 1  # no flight follows
    assert found.total("flight_sum")[stays] == pytest.approx(flown[stays], rel=1e-12, abs=1e-13)


@pytest.mark.parametrize("budget", [6, 12, 24])
def test_a_budget_cuts_off_after_so_many_impacts(budget):
    scene, launch = problem(60, 4.0, 25.0, seed=3)
    base = base_of("moving", "rest")
    whole, cut = streamed(base, scene, launch), streamed(base, scene, launch, budget)
    over = whole.landings > budget
    assert np.array_equal(cut.status == Status.BUDGET_EXCEEDED, over)
    assert np.all(cut.landings[over] == budget)
    assert same(whole, cut, ~over)


def test_accelerations_beyond_all_shakers_get_a_status():
    scene, launch = problem(4, 1e12, 10.0, restitution=np.full(4, 0.5))
    found = streamed(base_of("moving", "rest"), scene, launch)
    assert set(found.status) == {Status.NON_FINITE}


# Landings on the moving base against a search that cannot miss one (checks/first_roots.py).


@pytest.mark.parametrize(
    "draw",
    [
        *(wide, lift_offs, touching),
        pytest.param(partial(shaped, harmonics=3), marks=pytest.mark.weekly),
    ],
)
def test_no_first_landing_is_missed(draw):
    found = judge(draw(20_000, np.random.default_rng(7)), threads=1)
    assert not found.missed.any()
    assert np.nanmax(found.error) <= LARGEST_ERROR
    assert np.nanmax(found.speed_error) <= LARGEST_ERROR


def test_a_search_that_could_go_round_in_a_circle_ends():
    """The clearance almost touches zero before the only root: steps from there go far beyond it."""
    flights = [
        (3.302346846384233, -0.43936362171441556, 1.5382503131016738),
        (3.316581779056401, -0.44437260812262924, 1.5150245044985238),
        (3.2723546059369837, -0.4267990149481009, 1.5932871441334888),
        (3.775636337046582, 0.4143900441613707, 0.6750001320711176),
        (3.8301911075977197, 0.39186915745876116, 0.5458878846101514),
    ]
    gamma, x, y = np.array(flights).T
    found = judge(Flights(gamma / math.pi, x.copy(), y.copy()), threads=1)
    assert not found.missed.any()
    assert np.max(found.error) <= LARGEST_ERROR
    assert np.max(found.speed_error) <= LARGEST_ERROR


def test_the_search_finds_the_first_change_of_sign_of_a_fine_scan():
    flights = wide(300, np.random.default_rng(8))
    for alpha, x, y in zip(*flights[:3], strict=True):
        root, undecided = first_root(flights.tones, alpha, x, y, np.empty((MOST_GRAZES, 2)))
        assert undecided == 0
        # from a tenth of the earliest possible root on, with steps in proportion to the root
        s = np.linspace(0.1 * y / (1.0 + math.pi * alpha), 1.0001 * root, 20_000)
        turned = 2.0 * math.pi * s
        values = s * (y - s) / 2.0 + alpha / (4.0 * math.pi) * (
            math.sin(2.0 * math.pi * x) * (turned - np.sin(turned))
            - math.cos(2.0 * math.pi * x) * 2.0 * np.sin(0.5 * turned) ** 2
        )
        assert (values[s < 0.9999 * root] > 0.0).all()
        assert values[-1] < 0.0


def test_a_clearance_that_touches_zero_is_undecided():
    flights = touching(2_000, np.random.default_rng(9))
    grazes = np.empty((MOST_GRAZES, 2))
    seen = 0
    for alpha, x, y in zip(*flights[:3], strict=True):
        _, undecided = first_root(flights.tones, alpha, x, y, grazes)
        for left, right in grazes[:undecided]:
            value, noise, _, _ = clearance(flights.tones, alpha, x, y, 0.5 * (left + right))
            assert abs(value) <= 100.0 * noise
            seen += 1
    assert seen > 100


# The Jacobian and the bounds of errors on the moving base, against exact impacts and orbits.

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
    for x in np.linspace(-0.45, 0.45, 7).tolist():
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
    assert doubted > 3


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


@each_of("away", [1e-15, 1e-12, 1e-6, 0.1, 9.0])
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
def followed_moving_errors(problem_of):
    """Statistics, cycles and orbits of 700 particles, with and without skipping of cycles."""
    e, gamma, speed, phase = scenes(700, 11)
    problem = problem_of(e, gamma, 400.0, launch_velocity=speed, phase=phase)
    batch = Batch(BASE, problem, Launches(np.zeros((1, 1)), np.zeros((1, 1))))
    found = []
    for jump in (1, 0):
        out, memory = empty_statistics(700), memory_around(scratch())
        cycles, rests = empty_cycles(700), empty_rests(out.kinds)
        given = batch, Options(600_000, 0.0, 1, jump), 1, memory, out, cycles, rests
        advance(Share(700, 700, advance(Share(0, 700, 0), *given)), *given)
        found.append((out, cycles))
    orbits = empty_orbits(700)
    plain, search = found[0][0]._replace(kinds=()), Search(600_000, 1)
    settle(0, 700, batch, plain, found[0][1], search, np.empty(GROWTH_SIZE), orbits)
    return e, gamma, found[0][0], found[1][0], orbits


def test_skipping_of_cycles_changes_sums_by_rounding_only(followed_moving_errors):
    _, _, skipped, simulated, _ = followed_moving_errors
    for name in ("flight_sum", "height_sum"):
        assert skipped.total(name) == pytest.approx(simulated.total(name), rel=1e-12)
    for name in ("landings", "rests", "height_max"):
        assert np.array_equal(skipped.total(name), simulated.total(name)), name
    assert np.array_equal(skipped.at_rest, simulated.at_rest)
    assert np.all(simulated.status == Status.COMPLETED)
    assert np.all(skipped.status == Status.COMPLETED)


def test_regimes_of_the_moving_base(followed_moving_errors):
    e, gamma, each, _, orbits = followed_moving_errors
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


def test_exponents_sum_to_twice_the_logarithm_of_the_restitution(followed_moving_errors):
    e, _, _, _, orbits = followed_moving_errors
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
