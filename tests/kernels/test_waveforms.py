"""Kicks and flights under any waveform."""

from fractions import Fraction

import flint
import numpy as np
import pytest

import vibrosweep as vs
from accuracy import bare_problem
from first_roots import drawn
from tests.general import everything_plain
from tests.scenes import TWO_TONES
from vibrosweep.kernels import bases
from vibrosweep.kernels.arithmetic import HALF_ULP
from vibrosweep.kernels.bases.moving import MovingConstants
from vibrosweep.kernels.bases.moving_errors import along
from vibrosweep.kernels.bases.parabolic import first_guess, try_stretch
from vibrosweep.kernels.impact import base_of
from vibrosweep.kernels.noise import SILENT, STILL
from vibrosweep.kernels.waveforms import (
    Parabolic,
    Sine,
    kick_remainder,
    kick_slope,
    lift_offs,
    rise_of,
    shape_of,
    velocity,
)
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.model.shapes import Waveform
from vibrosweep.proof.reference.trajectories import trajectory
from vibrosweep.proof.report import ProofState
from vibrosweep.proof.verifying import verify

# The map with any waveform: known trajectories, bounds of rounding, and rests.

# two rises of the kick through the threshold of rest in every period
RISES = {"harmonics": [[1, 0.3, 0.0], [2, 1.0, 0.5]]}
NAMES = ("landing_time", "liftoff_time", "rebound_velocity", "rested", "impact_count")


def waveform(given):
    return Waveform("harmonics", tuple(tuple(tone) for tone in given["harmonics"]))


def exact(one, x, order=0):
    """Derivative of w at a double x, in ball arithmetic."""
    total = flint.arb(0)
    for h, c, psi in one.tones:
        angle = 2 * flint.arb.pi() * h * flint.arb(x) + flint.arb(psi)
        size = flint.arb(c) * (2 * flint.arb.pi() * h) ** order
        total += size * (angle.sin() if order == 0 else angle.cos())
    return total


# what runs in plain Python
ONE_TONE = {"amplitude": [0.3, 1.2, 2.0], "launch_time": [0.2, 0.0], "duration": 12.0}
TWICE = {"amplitude": [0.15, 0.6, 1.0], "waveform": {"harmonics": [[1, 2.0, 0.0]]}}
ONE_TONE_MOVING = {"amplitude": [1.0, 3.0, 5.0], "launch_time": [0.2, 0.0], "duration": 6.0}
ONE_TONE_MOVING |= {"base": "moving", "restitution": 0.3}
SCENE = {"restitution": 0.5, "base_velocity": [0.4, 0.9, 2.6], "phase": 0.3, "duration": 3.0}
SCENE |= {"base": "moving", "waveform": "parabolic", "contact_time": 3e-2}
LAUNCHES = [0.0, 0.3]


@pytest.fixture(scope="module")
def interpreted():
    """Landings of scenes, and counts of the vector kernel for the last of them."""
    tone = {"waveform": {"harmonics": [[1, 1.0, 0.0]]}}
    asked = [ONE_TONE | tone, ONE_TONE | TWICE, ONE_TONE_MOVING | tone]
    with pytest.MonkeyPatch.context() as patch:
        everything_plain(patch)
        found = [vs.simulate(**scene) for scene in (*asked, SCENE | {"launch_time": LAUNCHES})]
        return found, vs.sweep(SCENE | {"launch": LAUNCHES, "per_particle": True})


def test_a_known_trajectory():
    """The expected numbers were computed to 40 digits without this program."""
    one = vs.simulate(amplitude=1.2, launch_time=0.2, waveform=TWO_TONES)
    lands, speeds = (one[name].values[0, 0] for name in ("landing_time", "rebound_velocity"))
    assert lands[:2] == pytest.approx([1.21936799184505602, 2.31276695452635529], abs=1e-14)
    assert speeds[:2] == pytest.approx([5.36312191195177318, 5.47875273604222883], abs=1e-13)
    assert lands[7] == pytest.approx(8.31803752140725671, abs=1e-13)


def test_one_tone_is_the_sine_and_the_weight_scales(interpreted):
    sine = vs.simulate(**ONE_TONE)
    for shaped in interpreted[0][:2]:
        for name in NAMES:
            np.testing.assert_array_equal(shaped[name], sine[name])


@pytest.mark.parametrize("seed", range(4))
def test_sums_are_within_their_bounds(seed):
    random = np.random.default_rng(seed)
    numbers = np.sort(random.choice(np.arange(1, 17), random.integers(1, 9), replace=False))
    one = Waveform(
        "harmonics",
        tuple((int(h), float(random.normal()), float(random.uniform(-9, 9))) for h in numbers),
    )
    shape = shape_of(one)
    for x in [0.0, 0.5, -0.5, 0.25, 1e-12, 0.4999999, *random.uniform(-0.5, 0.5, 60)]:
        assert abs(exact(one, x) - flint.arb(velocity(shape, x))) <= shape.rounding
        off = abs(exact(one, x, 1) - flint.arb(kick_slope(shape, 1.0, x)))
        assert off <= shape.slope_rounding


def test_a_resting_particle_is_lifted_at_the_next_of_several_rises():
    one = waveform(RISES)
    shape, r = shape_of(one), 0.01
    phases = np.array(lift_offs(shape, 1.0, r, 0.0))
    assert phases.size == 2
    assert one.velocity(phases) == pytest.approx(np.full(2, r), abs=1e-14)
    assert (one.slope(phases) > 0.0).all()
    # launched particles rest at once and leave at the next of these phases
    starts = np.array([-0.45, -0.3, -0.1, 0.05, 0.2, 0.4])
    starts = starts[one.velocity(starts) < 0.0]
    scene = {
        "waveform": RISES,
        "amplitude": 0.5 * 9.81,
        "restitution": 0.0,
        "contact_time": r,
        "launch_velocity": 1e-9,
        "launch_time": starts.tolist(),
        "duration": 3.0,
    }
    found = vs.simulate(**scene)
    ahead = (phases[:, None] - starts) % 1.0
    due = starts + ahead.min(axis=0)
    assert found.rested.values[0, :, 0].all()
    assert found.liftoff_time.values[0, :, 0] == pytest.approx(due, abs=1e-9)


def test_cycles_with_different_rests_are_found_and_counted():
    """Jumps over cycles change no count; orbits that rest at several phases are all recognised."""
    scene = {
        "waveform": RISES,
        "amplitude": (0.3, 3.0),
        "restitution": (0.1, 0.6),
        "realizations": 12,
        "seed": 3,
        "particles": 2,
        "duration": 100.0,
        "regimes": True,
        "lyapunov": True,
    }
    long = vs.sweep(scene, threads=1)
    again = vs.sweep(scene, threads=2)
    for name in long.data_vars:
        np.testing.assert_array_equal(long[name].values, again[name].values)
    resting = long["cycle_rests"].values
    assert (resting == 1).any()
    assert (resting > 1).any()
    assert np.isneginf(long["lyapunov_largest"].values[resting > 0]).all()
    for i in np.flatnonzero((resting > 1).any(axis=1))[:2].tolist():
        given = {n: float(long[n][i]) for n in ("amplitude", "restitution")}
        every = vs.simulate(**given, waveform=RISES, particles=2, duration=100.0)
        assert int(every.impact_count.sum()) == int(long.impact_count[i])
        rested = every.rested.values[0]
        for p in np.flatnonzero(resting[i] > 1):
            # rests of a cycle are the shortest block of lift-off phases that repeats
            lifts = every.liftoff_time.values[0, p][rested[p] == 1] % 1.0
            block, count = int(resting[i, p]), int(np.isfinite(lifts).sum())
            late = lifts[count // 2 : count]
            apart = np.abs(late[block:] - late[:-block])
            assert np.minimum(apart, 1.0 - apart).max() < 1e-9
            assert len(set(np.round(late[-block:], 9))) > 1


@pytest.mark.parametrize("shape", [Sine(), Parabolic()], ids=str)
def test_a_kick_rises_and_falls_through_a_threshold_at_the_same_distance_from_its_peak(shape):
    for ratio in (1e-6, 0.3, 0.999):
        x = rise_of(shape, ratio)
        assert velocity(shape, x) == pytest.approx(ratio, rel=1e-12)
        assert velocity(shape, 0.5 - x) == pytest.approx(ratio, rel=1e-9)
        assert velocity(shape, -x) == -velocity(shape, x)


def test_the_triangle_keeps_its_bounds_at_its_corners():
    """A landing within an error of a corner is bounded by twice the change of the slope."""
    shape = Parabolic()
    for x in (0.25, -0.25, 0.2499999, 0.1):
        for off in (1e-7, -1e-7, 3e-8):
            change = velocity(shape, x + off) - velocity(shape, x)
            missed = abs(change - kick_slope(shape, 1.0, x) * off)
            assert missed <= kick_remainder(shape, 1.0, x, abs(off)) + 1e-15


def test_a_mode_has_two_windows_one_of_which_ends_in_a_fold():
    """Windows of all branches, and particles launched on the orbit of each."""
    one, e = waveform(TWO_TONES), 0.85
    scene = {"waveform": TWO_TONES, "gravity": 2.0, "restitution": e}
    found = vs.windows(**scene, amplitude=np.linspace(0.1, 1.0, 19), conditions=["locked(1)"])
    low, high = (found[name].values.ravel() for name in ("A_min", "A_max"))
    assert low == pytest.approx([0.1688, 0.2852], abs=5e-5)
    assert high == pytest.approx([0.2855, 0.6657], abs=5e-5)
    assert (found.A_max_bracket.values < 1e-11).all()
    held = found.holds.values.ravel()
    np.testing.assert_array_equal(
        held, (found.scan.values > low[0]) & (found.scan.values < high[1])
    )
    a, x = 0.5 * (low + high), np.linspace(0.0, 1.0, 1_000_001)
    off = [kick * one.velocity(x) - (1.0 - e) for kick in a]
    falls = [x[1:][(y[:-1] > 0.0) & (y[1:] <= 0.0)] for y in off]
    swept = vs.sweep(
        **scene,
        launch_velocity=1.001,
        duration=600.0,
        amplitude=a.tolist(),
        particles=2,
        launch=[float(falls[0][0]), float(falls[1][-1])],
        regimes=True,
    )
    for k in range(2):  # each particle is launched on the orbit of one of the amplitudes
        for name, value in (("cycle_impacts", 1), ("cycle_periods", 1), ("cycle_rests", 0)):
            assert swept[name].values[k, k] == value


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
def test_kicks_follow_the_waveform(base):
    given = {"waveform": TWO_TONES, "gravity": 2.0, "restitution": 0.85, "amplitude": 0.5}
    given |= {"base": base, "launch_velocity": 1.0, "launch_time": [0.45, 0.46], "duration": 400.0}
    found = vs.analysis.return_map(vs.simulate(**given), since=300.0)
    assert not found["rested"].any()
    kick = 0.5 * waveform(TWO_TONES).velocity(found["landing_time"].values)
    np.testing.assert_allclose(found["kick"], kick, atol=1e-9)


# Landings on a base of harmonics against a search that cannot miss one.

NAMES_SHAPED_FLIGHTS = ("landing_time", "liftoff_time", "rebound_velocity")


def tones_of(given):
    return Waveform("harmonics", tuple(tuple(tone) for tone in given["harmonics"]))


def test_a_known_trajectory_shaped_flights():
    """The expected numbers were computed to 40 digits without this program."""
    scene = {"restitution": 0.85, "phase": 0.3, "base": "moving", "waveform": TWO_TONES}
    one = vs.simulate(**scene, base_velocity=[0.7, 3.0])
    lands, speeds = (one[name].values[0, 0, :2] for name in ("landing_time", "rebound_velocity"))
    assert lands == pytest.approx([1.017557260259823, 2.078479057686624], abs=1e-14)
    assert speeds == pytest.approx([5.238099419590123, 5.544664747235231], abs=1e-14)


def test_one_tone_is_the_sine(interpreted):
    """Up to rounding, as long as that has not grown; rests and lift-offs included."""
    sine, one = vs.simulate(**ONE_TONE_MOVING), interpreted[0][2]
    assert sine.rested.values.any()
    np.testing.assert_array_equal(one["impact_count"], sine.impact_count)
    for name in NAMES_SHAPED_FLIGHTS:
        np.testing.assert_allclose(one[name], sine[name].values, rtol=1e-9, atol=1e-9)


def test_lanes_and_records_agree_for_any_number_of_threads():
    """Statistics of the vector kernel are those of the landings, which are followed one by one."""
    scene = {"waveform": TWO_TONES, "base": "moving", "restitution": 0.6, "duration": 10.0}
    scene |= {"amplitude": [0.5, 5.0], "particles": 2}
    measures = dict.fromkeys(("separation", "regimes", "lyapunov", "trust"), True)
    swept, again = (vs.sweep(scene | measures, threads=threads) for threads in (2, 1))
    each = vs.simulate(**scene)
    np.testing.assert_array_equal(each.impact_count.sum("particle"), swept.impact_count)
    for name in swept.data_vars:
        np.testing.assert_array_equal(swept[name].values, again[name].values)
    assert (swept.landing_time_error < 1e-9).all()
    bounces = np.isfinite(swept.lyapunov_sum.values)
    off = np.abs(swept.lyapunov_sum.values - 2.0 * np.log(0.6))[bounces]
    assert off.size
    assert (off <= swept.lyapunov_sum_error.values[bounces]).all()


def test_a_sweep_and_its_bounds_of_errors_are_proved(tmp_path):
    """Launches, flights, rests at several phases, bounds, exponents: all in ball arithmetic."""
    scene = {"waveform": TWO_TONES, "base": "moving", "restitution": 0.6, "duration": 8.0}
    scene |= {"amplitude": [0.9, 3.0], "particles": 3, "phase": 0.4}
    measures = dict.fromkeys(("separation", "regimes", "lyapunov", "trust"), True)
    vs.run(scene | measures, tmp_path / "two.h5").close()
    report = verify(tmp_path / "two.h5")
    assert report.passed
    assert all(outcome.state is ProofState.COMPARED for outcome in report.outcomes)


def test_a_locked_orbit_has_the_multipliers_of_its_closed_form():
    """Roots of z^2 - (1 + e^2 + (1 + e)^2 G) z + e^2 at a w(x) = (1 - e) k."""
    e, one = 0.6, tones_of(TWO_TONES)
    x = np.linspace(0.2, 0.5, 7)[2:5]
    a = (1.0 - e) / one.velocity(x)
    problem = bare_problem(np.full(x.size, e), a)
    base = base_of("moving", "rest", one)
    for i in range(x.size):
        fixed = bases.constants(base, problem, i)
        y = 2.0 * e / (1.0 + e)
        time, v = bases.fly(fixed, float(x[i]), y)
        assert time == pytest.approx(1.0, abs=1e-14)
        xx, xu, ux, uu, _ = bases.jacobian(fixed, bases.Flight(float(x[i]), y, time, x[i], v))
        g = 0.5 * a[i] / (1.0 + e) * one.slope(x[i])
        assert xx + uu == pytest.approx(1.0 + e * e + (1.0 + e) ** 2 * g, abs=1e-12)
        assert xx * uu - xu * ux == pytest.approx(e * e, abs=1e-13)


def test_clearance_and_speed_are_within_their_bounds():
    """Against ball arithmetic, at times from chatter to many periods."""
    random, one = np.random.default_rng(3), drawn(3, np.random.default_rng(5))
    fixed = bases.constants(
        base_of("moving", "rest", one), bare_problem(np.zeros(1), np.ones(1)), 0
    )
    for power in np.repeat([-6.0, -2.0, -0.5, 0.5, 1.5], 20):
        x, y, t = random.uniform(-0.5, 0.5), random.uniform(0.0, 3.0), 10.0**power
        at = along(fixed, float(x), float(y), float(t))
        f, z = exact_course(one, fixed.alpha, x, y, t)
        assert float(abs(f - at.f).abs_upper()) <= at.f_error
        assert float(abs(z - at.z).abs_upper()) <= at.z_error
        assert at.f_error <= 1e-13 * t * (y + t + 1.0)


def exact_course(one, alpha, x, y, t):
    """Clearance and relative speed from their definition."""
    x, y, t, alpha = (flint.arb(float(value)) for value in (x, y, t, alpha))
    with flint.ctx.workprec(200):
        turn, rise, fast, slow = 2 * flint.arb.pi(), flint.arb(0), flint.arb(0), flint.arb(0)
        for h, c, psi in one.tones:
            begin, end = (turn * h * at + flint.arb(psi) for at in (x, x + t))
            rise += flint.arb(c) * (begin.cos() - end.cos()) / (turn * h)
            fast += flint.arb(c) * end.sin()
            slow += flint.arb(c) * begin.sin()
        f = t * (y + alpha * slow - t) / 2 - alpha * rise / 2
        return f, 2 * t - y + alpha * (fast - slow)


def test_a_resting_particle_leaves_where_the_base_falls_faster_than_gravity():
    one = vs.simulate(
        waveform=TWO_TONES,
        base="moving",
        restitution=0.0,
        base_acceleration=1.5,
        launch_velocity=0.0,
        duration=4.0,
    )
    rested = one.rested.values[0, 0] == 1
    phases = one.liftoff_time.values[0, 0][rested]
    phases = phases[np.isfinite(phases)]
    assert phases.size
    of_base = tones_of(TWO_TONES)
    acceleration = 1.5 * of_base.slope(phases) / of_base.fall
    assert acceleration == pytest.approx(np.full(phases.size, -1.0), abs=1e-9)
    assert (of_base.slope(phases + 1e-6) < of_base.slope(phases)).all()


def test_positions_show_the_base_as_it_moves():
    forcing = {"base": "moving", "base_velocity": 1.5, "phase": 0.4}
    one = vs.simulate(waveform=TWO_TONES, restitution=0.8, duration=6.0, **forcing)
    lands = one.landing_time.values[0, 0, :4]
    film = vs.positions(one, np.concatenate([lands, np.linspace(0.0, 6.0, 500)]))
    above = (film.height - film.base_height).values[0, 0]
    assert np.abs(above[:4]).max() < 1e-12
    assert above.min() > -1e-12


# Flights over a parabolic base against exact rational arithmetic and proved trajectories.

SHAPE = Waveform("parabolic")


def fixed_of(alpha):
    x_lift = 0.25 if alpha > 0.5 else np.nan
    base = base_of("moving", "rest", SHAPE)
    return MovingConstants(base, 0.8, alpha, 1e-4, 0.0, x_lift, SILENT, STILL)


def exact_clearance(alpha, x, y, s):
    """Clearance, its derivative, minus its second derivative, and the time to the next corner."""
    alpha, x, y, s = map(Fraction, (alpha, x, y, s))

    def stretch(phase):
        low = phase - (phase + Fraction(1, 4)) % 1
        place = phase - low  # from the corner at -1/4
        return (
            (1, place - Fraction(1, 4)) if place < Fraction(1, 2) else (-1, place - Fraction(3, 4))
        )

    def velocity(phase):
        sign, place = stretch(phase)
        return 4 * sign * place

    def level(phase):
        sign, place = stretch(phase)
        return sign * (2 * place**2 - Fraction(1, 8))

    rise = level(x + s) - level(x) - s * velocity(x)
    gain = velocity(x + s) - velocity(x)
    sign, place = stretch(x + s)
    left = Fraction(1, 4) - place
    return (
        s * (y - s) / 2 - alpha / 2 * rise,
        y / 2 - s - alpha / 2 * gain,
        1 + 2 * sign * alpha,
        left,
    )


def has_root(f, f1, bend, left):
    """Return whether f + f1 s - bend s^2 / 2, positive at first, has a zero for 0 < s < left."""
    ends = f + f1 * left - bend * left**2 / 2 < 0
    dips = bend < 0 and f1 < 0 and f1 / bend < left and f1**2 + 2 * bend * f > 0
    return ends or dips


def test_landings_are_those_of_the_proof(interpreted):
    (*_, parabolic), swept = interpreted
    counts, rests = (swept[f"particle_{name}_count"].values for name in ("impact", "rest"))
    landings, lift_offs, speeds = (parabolic[name].values for name in NAMES_SHAPED_FLIGHTS)
    given = {name: one.default for name, one in PARAMETERS.items()}
    given |= {"restitution": 0.5, "phase": 0.3, "contact_time": 3e-2}
    rested = 0
    for i, velocity in enumerate(SCENE["base_velocity"]):
        for j, launch in enumerate(LAUNCHES):
            moved = given | {"amplitude": 1.5 * velocity, "launch_time": launch, "duration": 3.0}
            impacts = trajectory(base="moving", waveform=SHAPE, **moved).impacts
            for k, impact in enumerate(impacts):
                exact = impact.landing_time, impact.liftoff_time, impact.rebound_velocity
                for found, known in zip((landings, lift_offs, speeds), exact, strict=True):
                    expected = np.nan if known is None else float(known)
                    close = pytest.approx(expected, rel=0.0, abs=1e-10, nan_ok=True)
                    assert found[i][j][k] == close
            assert counts[i][j] == len(impacts)
            assert rests[i][j] == sum(impact.rested for impact in impacts)
            rested += rests[i][j]
    assert rested > 2


@pytest.fixture(scope="module")
def flights():
    random = np.random.default_rng(11)
    found = []
    for _ in range(400):
        alpha, x = (
            random.choice([0.1, 0.6, 2.0, 20.0]) * random.uniform(0.5, 2.0),
            random.uniform(-0.5, 0.5),
        )
        y = random.choice([1e-6, 1e-2, 1.0, 5.0]) * random.uniform(0.1, 2.0) * max(1.0, alpha)
        guess = first_guess(alpha, x, y)
        time, landed, tried = guess.begin, False, []
        while not landed:
            tried.append(time)
            time, v, landed, _ = try_stretch(alpha, x, y, guess, time)
        found.append((alpha, x, y, time, v, tried))
    return found


def test_a_flight_solves_its_equation_within_rounding(flights):
    """The bound adds errors where the stretch begins, and roundings of the terms and the root."""
    for alpha, x, y, s, v, tried in flights:
        f, f1, _, _ = map(float, exact_clearance(alpha, x, y, s))
        begin, at = tried[-1], along(fixed_of(alpha), x, y, tried[-1])
        first, slope, bend, _ = map(float, exact_clearance(alpha, x, y, begin))
        step = s - begin
        terms = abs(first) + abs(slope) * step + abs(bend) * step**2 / 2
        bound = at.f_error + 0.5 * step * at.z_error + HALF_ULP * (8.0 * terms + s * abs(f1))
        assert abs(f) <= bound
        # v = 2 sqrt(F'^2 + 2 (1 + G) F) with values from there; the landing is off by the residual
        square = slope**2 + 2.0 * abs(bend) * abs(first)
        off = 4.0 * abs(bend) * (at.f_error + bound) + 2.0 * abs(slope) * at.z_error
        assert abs(v + 2.0 * f1) * v <= off + 16.0 * HALF_ULP * square


def test_no_first_landing_is_missed_chained(flights):
    for alpha, x, y, s, _, _ in flights:
        time = Fraction(0)
        while True:
            f, f1, bend, left = exact_clearance(alpha, x, y, time)
            if time + left >= Fraction(s):
                break
            first = time == 0 and (f1 > 0 or bend < 0)
            if first and bend > 0:
                assert 2 * f1 / bend > left
            else:
                assert not has_root(f, f1, bend, left)
            time += left
