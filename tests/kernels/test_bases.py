"""Impacts, rests, and the interface of a base."""

import math
import os
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import assume, given
from hypothesis import strategies as st

from proved_pieces import step
from tests.cases import each_of
from tests.general import as_the_engine_chooses
from vibrosweep import simulate, theory
from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import jit
from vibrosweep.kernels.arithmetic import COSINE_ERROR, HALF_ULP, ROUNDING
from vibrosweep.kernels.bases import StateError, after_rest, lift_off, rebound
from vibrosweep.kernels.impact import base_of, impact, land
from vibrosweep.kernels.memory import LANES, ROW, STRIDE
from vibrosweep.kernels.statistics import OF_LANDINGS, scratch
from vibrosweep.model.parameters import LAWS

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


SAME_BITS = """
import json
import numpy as np
from vibrosweep.kernels import bases
from vibrosweep.kernels._jit import jit

from vibrosweep.kernels.bases import StateError
from vibrosweep.kernels.impact import base_of
from vibrosweep.kernels.memory import ROW
from vibrosweep.kernels.noise import noise_of
from vibrosweep.kernels.statistics import scratch
from vibrosweep.model.parameters import PARAMETERS, dimensionless

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
        own |= {n: np.full(size, 0.3) for n in ("restitution_noise", "kick_noise", "drive_noise")}
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
    print(json.dumps([kind, numbers, room.tolist(), of_base]))
"""


def test_every_generic_function_is_compared():
    declared = [
        f"bases.{name}("
        for name, function in vars(bases).items()
        if name.islower() and getattr(function, "__module__", None) == bases.__name__
    ]
    assert len(declared) > 40  # else the search for them has failed
    assert [call for call in declared if call not in SAME_BITS] == []


@pytest.mark.weekly
def test_every_generic_function_gives_the_same_bits_compiled_and_in_plain_python(
    capsys, monkeypatch
):
    as_the_engine_chooses(monkeypatch)
    exec(SAME_BITS, {"__name__": __name__})
    compiled = capsys.readouterr().out.splitlines()
    plain = subprocess.run(
        [sys.executable, "-c", SAME_BITS],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout.splitlines()
    assert len(plain) == 2
    assert compiled == plain


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


def test_the_determinant_of_an_impact_is_the_restitution(impacts, constants_of):
    h = 2.0**-18
    for (e, a, x, u), _, _ in impacts:
        if u > 100.0 or a > 10.0:
            continue
        fixed = constants_of("rest", e, a)

        def image(dx, du, fixed=fixed, x=x, u=u):
            # the phase may leave the reduced interval by h, which the map allows
            hit = impact(fixed, 0.0, x + dx, u + du)
            return hit.x + hit.n, rebound(fixed, hit.x, hit.v)

        right, left, up, down = image(h, 0.0), image(-h, 0.0), image(0.0, h), image(0.0, -h)
        by_x = [(p - q) / (2 * h) for p, q in zip(right, left, strict=True)]
        by_u = [(p - q) / (2 * h) for p, q in zip(up, down, strict=True)]
        determinant = by_x[0] * by_u[1] - by_x[1] * by_u[0]
        # central differences leave (2 pi)^3 a h^2 / 6 in each slope, which cancel in the
        # determinant of the exact map; rounding of values up to e u + a leaves their ulp over h
        assert determinant == pytest.approx(e, rel=0, abs=1e-15 * (u + 10 * a + 1) / h)


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


# Locked orbits of the kernel against their closed forms, and the determinant of any orbit.

FORCING = {"frequency": 1.7, "gravity": 9.81}


def flights_locked(found):
    """Phases of impact in turns, and flight times in forcing periods, of the only particle."""
    one = found[{"realization": 0, "particle": 0}]
    f, g = one.frequency.item(), one.gravity.item()
    turns = one.landing_time.values * f + one.phase.item() / (2.0 * math.pi)
    return turns - np.rint(turns), one.rebound_velocity.values * 2.0 * f / g


@each_of("rebound", ["rest", "reflect"])
@each_of("k", [1, 2, 3, 4])
@each_of("e", [0.8, 0.9])
def test_a_locked_orbit_attracts_to_its_closed_form(k, e, rebound):
    low, high = theory.amplitude_min(k, e, **FORCING), theory.amplitude_max(k, e, **FORCING)
    amplitude, phi = float(low + 0.5 * (high - low)), 0.3
    x = float(theory.locked_phase(k, e, amplitude, **FORCING))
    impacts = 600  # errors of 1e-3 shrink by sqrt(e) each: 0.9^300 1e-3 = 2e-17
    found = simulate(
        restitution=e,
        amplitude=amplitude,
        phase=phi,
        launch_velocity=float(theory.locked_velocity(k, **FORCING)) * 1.002,
        launch_time=(x - 1e-3 - phi / (2.0 * math.pi)) / FORCING["frequency"],
        duration=impacts * k / FORCING["frequency"],
        rebound=rebound,
        **FORCING,
    )
    phase, flight = flights_locked(found)
    assert not found.rested.any()
    assert phase.size in (impacts - 1, impacts)
    assert abs(phase[0] - x) > 1e-4
    # 2400 periods are rounded to 3e-13
    assert phase[-5:] == pytest.approx(x, rel=0, abs=1e-12)
    assert flight[-5:] == pytest.approx(k, rel=2e-12)
    height = found.rebound_velocity.values[0, 0, -5:] ** 2 / (2.0 * FORCING["gravity"])
    assert height == pytest.approx(float(theory.locked_height(k, **FORCING)), rel=4e-12)


@pytest.mark.parametrize("k", [1, 3])
@pytest.mark.parametrize(("side", "grows"), [(-1, False), (1, True)])
def test_the_upper_edge_divides_decay_from_growth(k, side, grows):
    e, relative = 0.9, 1e-7
    # an alternation of 1e-6 is far above rounding (1e-16 per impact), and small enough for its
    # own square, 1e-12, not to move the edge by 1e-7; in 20,000 impacts it changes by 1e-3
    impacts, alternation = 20_000, 1e-6
    amplitude = float(theory.amplitude_max(k, e)) * (1.0 + side * relative)
    found = simulate(
        restitution=e,
        amplitude=amplitude,
        launch_velocity=float(theory.locked_velocity(k)),
        launch_time=float(theory.locked_phase(k, e, amplitude)) + alternation,
        duration=(impacts + 0.5) * k,
    )
    _, flight = flights_locked(found)
    swing = np.abs(np.diff(flight))
    early, late = swing[1000], swing[-2]
    assert late / early == pytest.approx(1.0, abs=0.1)
    assert (late > early * (1.0 + 1e-5)) == grows
    assert (late < early * (1.0 - 1e-5)) != grows


def images(launches, flights_, kept, **scene):
    """Time and flight time after some landings of particles with each launch and first flight."""
    found = simulate(
        launch_time=launches,
        launch_velocity=flights_,  # gravity 2 and frequency 1: a speed is its flight time
        gravity=2.0,
        frequency=1.0,
        duration=100.0,
        **scene,
    )
    assert not found.rested[..., :kept].any()
    return found.landing_time.values[..., kept - 1], found.rebound_velocity.values[..., kept - 1]


@pytest.mark.parametrize(
    ("rebound", "e", "amplitude", "t", "u", "kept"),
    [
        ("rest", 0.9, 0.25, 0.4, 1.03, 12),
        ("reflect", 0.9, 0.25, 0.4, 1.03, 12),
        ("reflect", 0.8, 0.7, 0.1, 0.9, 5),  # turned back at the second and third landing
    ],
)
def test_areas_of_states_shrink_by_the_restitution_at_each_impact(
    rebound, e, amplitude, t, u, kept
):
    h = 2.0**-22
    times, speeds = images(
        [t - h, t, t + h],
        [u - h, u, u + h],
        kept,
        restitution=e,
        amplitude=amplitude,
        rebound=rebound,
    )
    jacobian = np.array(
        [
            [v[1, 2] - v[1, 0] for v in (times, speeds)],
            [v[2, 1] - v[0, 1] for v in (times, speeds)],
        ]
    ) / (2.0 * h)
    stretch = np.linalg.norm(jacobian)
    # a central difference is off by the square of 2 pi h stretch, and by some 1e-15 / h
    share = (2.0 * math.pi * h * stretch) ** 2 + 1e-14 / h / stretch
    assert stretch**2 * share < 1e-2 * e**kept
    determinant = abs(np.linalg.det(jacobian))
    assert determinant == pytest.approx(e**kept, rel=0, abs=stretch**2 * share)
