"""Impacts, rests, and the interface of a base."""

import inspect
import json
import math
from typing import NamedTuple

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import assume, given
from hypothesis import strategies as st

from proved_pieces import step
from tests.general import as_the_engine_chooses
from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import jit
from vibrosweep.kernels.arithmetic import COSINE_ERROR, HALF_ULP, ROUNDING
from vibrosweep.kernels.bases import StateError, after_rest, lift_off, rebound
from vibrosweep.kernels.impact import base_of, impact, land
from vibrosweep.kernels.memory import LANES, ROW, STRIDE
from vibrosweep.kernels.noise import noise_of
from vibrosweep.kernels.statistics import OF_LANDINGS, scratch
from vibrosweep.model.parameters import LAWS, PARAMETERS, dimensionless

# Generic functions of each base and law, against exact arithmetic and their declarations.

BITS = 400
TURN = 2.0 * math.pi
laws = st.sampled_from(LAWS)
restitutions = st.sampled_from([0.0, 1.0]) | st.floats(0.0, 1.0)
kicks = st.just(0.0) | st.floats(1e-6, 10.0)
phases = st.sampled_from([-0.5, -0.25, 0.0, 0.25, 0.5]) | st.floats(-0.5, 0.5)
flights = st.floats(1e-6, 100.0)


def exact_image(law, e, a, x, u):
    """Instant and speed after an impact, as balls; arguments may be balls."""
    phase, count, w = step(e, a, x, u, bits=BITS)
    return phase + count, abs(w) if law == "reflect" else w


@given(laws, restitutions, kicks, phases, flights)
def test_the_jacobian_is_the_derivative_of_the_exact_map(constants_of, law, e, a, x, u):
    fixed = constants_of(law, e, a)
    hit = impact(fixed, 0.0, x, u)
    w = float(step(e, a, x, u, bits=BITS)[2].mid())
    assume(abs(w) > 1e-9)  # |w| has no derivative where w = 0
    xx, xu, ux, uu, terms = bases.jacobian(fixed, hit.flight)
    sign = -1.0 if law == "reflect" and w < 0.0 else 1.0
    # the cosine's error, and its change by the rounding of the phase of the landing
    allowed = ROUNDING * terms + TURN * a * (COSINE_ERROR + TURN * HALF_ULP)
    with ctx.workprec(BITS):
        h, x, u = arb(2) ** -100, arb(x), arb(u)  # h^2 is below every error
        by_phase = exact_image(law, e, a, x + h, u), exact_image(law, e, a, x - h, u)
        by_speed = exact_image(law, e, a, x, u + h), exact_image(law, e, a, x, u - h)
        for entries, (ahead, behind) in (((xx, ux), by_phase), ((xu, uu), by_speed)):
            for entry, one, other in zip(entries, ahead, behind, strict=True):
                assert float(abs((one - other) / (2 * h) - entry).abs_upper()) <= allowed
    assert terms >= abs(xx) + abs(xu)
    assert terms >= abs(ux) + abs(uu) - ROUNDING * terms
    # the determinant is uu - ux, whose larger term is rounded
    assert abs(xx * uu - xu * ux - sign * e) <= 2.0 * HALF_ULP * terms
    assert bases.contraction(fixed, hit.v) == e
    if e > 0.0:  # else the determinant is 0 and has no sign
        assert bases.reverses(fixed, hit.x, hit.v) == sign


@given(laws, restitutions, kicks, st.floats(-0.4, 0.4), flights, st.floats(-0.1, 0.1))
def test_the_jacobian_changes_by_no_more_than_its_error(constants_of, law, e, a, x, v, off):
    fixed = constants_of(law, e, a)
    assume(bases.reverses(fixed, x, v) == bases.reverses(fixed, x + off, v))
    assume(e > 0.0)  # with e = 0 `reverses` is 1, also where the particle is turned back
    flights = [bases.Flight(0.0, v, v, phase, v) for phase in (x, x + off)]
    here, there = (bases.jacobian(fixed, flight) for flight in flights)
    spread = StateError(abs(off), 0.0)
    _, _, by_landing = bases.jacobian_error(fixed, flights[0], abs(off), spread)
    allowed = by_landing + TURN * a * 2.0 * COSINE_ERROR
    assert here[:2] == there[:2]
    for one, other in zip(here[2:4], there[2:4], strict=True):
        assert abs(one - other) <= allowed + ROUNDING * here.size


@given(
    laws,
    st.lists(
        st.tuples(restitutions, kicks, st.floats(1e-9, 1.0), phases, flights),
        min_size=1,
        max_size=LANES,
    ),
)
def test_constants_in_scratch_memory_are_taken_back(constants_of, law, drawn):
    memory = scratch()
    several = [constants_of(law, e, a, r) for e, a, r, _, _ in drawn]
    for j, fixed in enumerate(several):
        bases.put(fixed, memory, j)
    for j, (fixed, (_, a, r, x, u)) in enumerate(zip(several, drawn, strict=True)):
        taken = bases.take(base_of("high-bounce", law), memory, j)
        w = bases.rebound(fixed, x, u)
        assert bases.rebound(taken, x, u) == w
        left, then = (bases.lift_off(one, 7.0, x, w) for one in (fixed, taken))
        if left[0] < np.inf:
            assert then == left
        else:  # a rest for good leaves no phase
            assert math.isnan(then[1])
            assert then[2:] == left[2:]
        if a > r:
            assert taken == fixed
    assert not memory[: ROW.CONSTANTS].any()
    assert not memory[OF_LANDINGS:].any()
    rows = memory[ROW.CONSTANTS : OF_LANDINGS].reshape(-1, STRIDE)
    assert not rows[:, len(several) :].any()


KINDS = [("high-bounce", "noise", "viscoelastic"), ("moving", "rest", "plastic")]


@jit
def ask_all(base, problem, i, x, u, s):
    fixed = bases.constants(base, problem, i)
    bases.put(fixed, s, i)
    taken = bases.take(base, s, i)
    flight, v = bases.fly(fixed, x, u)
    w = bases.rebound(fixed, x, v)
    there = bases.Flight(x, u, flight, x, v)
    s[ROW.X + i], s[ROW.U + i] = x, u
    bases.prepare(base, s, i + 1)
    random = bases.random(fixed, 3.0, 5.0, 7.0, x)
    time, _, landed = bases.approach(fixed, s, i)
    error = StateError(1e-9, 1e-9)
    return (
        bases.approach(fixed, s, i),
        (bases.end_pass(fixed, s, i, time, landed, True), bases.pending(base, s, i)),
        (bases.leave(fixed, x, u), bases.speed(fixed, x, u), bases.common_age(base)),
        bases.counted(fixed, there, w),
        bases.counted_now(fixed, s, i, flight, w),
        (bases.abandons(base, s, i, 6), bases.may_land(fixed, s, i, 100.0)),
        (flight, v, w, bases.reverses(fixed, x, v)),
        (bases.contraction(fixed, v), bases.density(fixed, u), bases.lifts_alike(base)),
        bases.lift_off(fixed, 7.0, x, w),
        bases.lift_off(taken, 7.0, x, w),
        bases.lift_off(fixed, 7.0, x, -1.0),
        bases.lift_off(random, 7.0, x, bases.rebound(random, x, v)),
        bases.later_lift_off(fixed, 7.0, x, 2.0),
        bases.after_rest(fixed),
        bases.jacobian(fixed, there),
        bases.contact_time(fixed),
        (*bases.chord(fixed, x, 2.0), bases.clearing(fixed, there)),
        bases.slopes(fixed, there),
        bases.fixed_residual(fixed, x, 2.0, 1.0),
        bases.fixed_attracts(fixed, x, 2.0),
        bases.fixed_holds(fixed, x, 2.0),
        bases.jacobian_error(fixed, there, 1e-9, error),
        bases.launch_error(fixed, x, u),
        bases.landing_added(fixed, there, error),
        bases.landing_rounding(there),
        bases.rebound_error(fixed, there, StateError(1e-16, 1e-16), 1e-9, error),
        bases.absolute_error(fixed, x, u, error),
        bases.rest_is_doubtful(fixed, x, w, StateError(0.1, 0.1)),
        bases.liftoff_error(fixed),
        bases.liftoff_error_after(random, 7.0, x, 1e-9, bases.Instant(8.0, 0.1)),
        bases.unless_doubtful(error, x, 1e-9, bases.Instant(8.0, 0.1)),
    )


def all_answers():
    """What every generic function gives for each kind of base, as text, in which NaN equals NaN."""
    answers = []
    rng = np.random.default_rng(5)
    size = 40
    given = {name: np.full(size, p.default) for name, p in PARAMETERS.items()}
    given["restitution"] = rng.choice([0.0, 1.0, 0.3, 0.9], size)
    given["restitution_speed"] = rng.choice([0.01, 1.0, 100.0], size)
    given["amplitude"] = rng.choice([0.0, 1e-3, 1.2, 4.0], size) * rng.uniform(0.5, 1.0, size)
    given["contact_time"] = 10.0 ** rng.uniform(-9.0, -0.5, size)
    states = rng.uniform((-0.5, 0.0), (0.5, 3.0), (size, 2))
    for kind in KINDS:
        room, law, own = scratch(), kind[1], dict(given)
        if law == "noise":
            own |= {
                n: np.full(size, 0.3) for n in ("restitution_noise", "kick_noise", "drive_noise")
            }
            own["noise_stream"], own["amplitude"] = np.arange(size), own["amplitude"] + 1.0
            law = "rest"
        if kind[2] != "constant":  # the viscoelastic law needs 0.46 or more
            own["restitution"] = np.maximum(own["restitution"], 0.5)
        problem = dimensionless(own, 1.0)
        noise = noise_of(problem.noise, 7)
        base = base_of(kind[0], law, restitution=kind[2], noise=noise)
        found = [ask_all(base, problem, i, *states[i].tolist(), room) for i in range(size)]
        numbers = [np.concatenate([np.ravel(part) for part in row]).tolist() for row in found]
        low = bases.lowest(base, problem)
        of_base = bases.lifts(base, problem).tolist(), None if low is None else low.tolist()
        assert bases.fitted(base, problem) == base
        answers.append(json.dumps([kind, numbers, room.tolist(), of_base]))
    return answers


def test_every_generic_function_is_compared():
    declared = [
        f"bases.{name}("
        for name, function in vars(bases).items()
        if name.islower() and getattr(function, "__module__", None) == bases.__name__
    ]
    compared = inspect.getsource(inspect.unwrap(ask_all)) + inspect.getsource(all_answers)
    assert len(declared) > 40  # else the search for them has failed
    assert [call for call in declared if call not in compared] == []


@pytest.mark.weekly
def test_every_generic_function_gives_the_same_bits_compiled_and_in_plain_python(monkeypatch):
    plain = all_answers()
    as_the_engine_chooses(monkeypatch)
    assert all_answers() == plain


class Unknown(NamedTuple):
    """Constants of a base that does not exist."""

    e: float


@jit
def fly_compiled(fixed, x, u):
    return bases.fly(fixed, x, u)


@pytest.mark.parametrize("ask", [bases.fly, fly_compiled])
@pytest.mark.parametrize("wrong", [Unknown(0.9), 0.9])
def test_an_unknown_base_is_named(ask, wrong):
    with pytest.raises(TypeError, match=r"^fly has no .*(Unknown|[Ff]loat)"):
        ask(wrong, 0.1, 1.0)


# One impact against proved balls, and the two decisions that follow it.

STATES = 600  # checks/map_error.py draws millions
HALF_ULP_IMPACT = 2.0**-53
SINE_ERROR = 2.4e-16  # see test_sine.py


@pytest.fixture(scope="module")
def impacts(constants_of):
    """Random states, their images by the kernel, and proved balls."""
    rng = np.random.default_rng(11)
    e = rng.choice([0.0, 1.0, 0.9], STATES)
    e[::2] = rng.uniform(0.0, 1.0, STATES // 2)
    a = rng.choice([0.0, 1.0], STATES) * 10.0 ** rng.uniform(-6.0, 2.0, STATES)
    x = rng.uniform(-0.5, 0.5, STATES)
    x[::5] = rng.choice([-0.5, -0.25, 0.0, 0.25, 0.5], x[::5].size)
    u = 10.0 ** rng.uniform(-9.0, 6.0, STATES)
    u[::7] = rng.integers(0, 9, u[::7].size) / 4.0
    rows = []
    for state in np.stack([e, a, x, u], axis=1).tolist():
        fixed = constants_of("rest", *state[:2])
        hit = impact(fixed, 0.0, *state[2:])
        w = rebound(fixed, hit.x, hit.v)
        rows.append((state, (hit.x, hit.n, w), step(*state, bits=128)))
    return rows


def test_a_landing_is_reduced_and_rounded_once(impacts):
    for (_, _, _, u), (phase, count, _), (exact_phase, exact_count, _) in impacts:
        assert -0.5 <= phase <= 0.5
        assert count in (math.floor(u) - 1, math.floor(u), math.ceil(u), math.ceil(u) + 1)
        # x and u - round(u) are exact, their sum is below 1; -1/2 and 1/2 are one instant
        off = (exact_phase - phase) + (exact_count - int(count))
        assert float(abs(off).abs_upper()) <= HALF_ULP_IMPACT / 2.0


def test_a_rebound_is_rounded_as_its_terms_are(impacts):
    for (e, a, _, u), (phase, _, w), (_, _, exact) in impacts:
        # roundings of the landing, the sine, the product and the sum
        sine, slope = abs(math.sin(2 * math.pi * phase)), 2 * math.pi * HALF_ULP_IMPACT / 2.0
        allowed = a * (SINE_ERROR + HALF_ULP_IMPACT * sine + slope) + HALF_ULP_IMPACT * abs(w)
        assert float(abs(exact - w).abs_upper()) <= allowed * (1.0 + 1e-9) + 1e-300
        assert abs(w - e * u) <= a * (1.0 + 2.0**-50) + HALF_ULP_IMPACT * (abs(w) + e * u) * 2.0


def test_reflect_turns_a_particle_back(impacts, constants_of):
    for (e, a, _, u), (phase, _, w), _ in impacts:
        assert rebound(constants_of("reflect", e, a), phase, u) == abs(w)


@pytest.fixture
def resting(constants_of):
    """A scene with a threshold of rest of 0.1, which the kick passes at a phase of 0.05."""
    fixed = constants_of("rest", 0.9, 0.1 / math.sin(0.1 * math.pi), 0.1)
    assert after_rest(fixed) == (pytest.approx(0.05), 0.1)
    return fixed


@pytest.mark.parametrize("x", [-0.5, -0.2, 0.0, 0.1])
def test_a_particle_above_the_threshold_leaves_at_once(x, resting):
    w = float(np.nextafter(0.1, 1.0))
    assert lift_off(resting, 7.0, x, w) == (7.0, x, w, True)


def test_a_rest_ends_at_the_next_rise_of_the_kick(resting):
    rise, _ = after_rest(resting)
    behind = float(np.nextafter(rise, 1.0))
    for x, later in ((-0.5, 0), (-0.2, 0), (rise, 0), (behind, 1), (0.5, 1)):
        for w in (0.1, -3.0):  # w = r rests
            assert lift_off(resting, 7.0, x, w) == (7.0 + later, rise, 0.1, False)


def test_without_excitation_a_rest_never_ends(constants_of):
    still = constants_of("rest", 0.9, 0.0, 0.1)
    assert lift_off(still, 7.0, -0.2, 0.0) == (math.inf, 0.0, 0.0, False)


def test_whole_periods_do_not_change_a_landing():
    for u in (0.3, 0.75, 0.015625):
        for whole in (1.0, 1e6, 2.0**40):
            later = whole + u
            kept = later - whole  # u as rounded in a double of that size
            assert land(0.2, later) == (land(0.2, kept)[0], land(0.2, kept)[1] + whole)
