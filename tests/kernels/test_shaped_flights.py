"""Landings on a base of harmonics against a search that cannot miss one."""

import flint
import numpy as np
import pytest

import vibrosweep as vs
from accuracy import bare_problem
from shaped_roots import drawn, judge
from tests.scenes import TWO_TONES
from vibrosweep.kernels import bases
from vibrosweep.kernels.bases.moving_errors import along
from vibrosweep.kernels.impact import base_of
from vibrosweep.model.shapes import Waveform
from vibrosweep.proof.report import State
from vibrosweep.proof.verifying import verify

NAMES = ("landing_time", "liftoff_time", "rebound_velocity")


def tones_of(given):
    return Waveform("harmonics", tuple(tuple(tone) for tone in given["harmonics"]))


def test_no_first_landing_is_missed():
    random = np.random.default_rng(7)
    found = judge(drawn(3, random), 20_000, random)
    assert not found.missed.any()
    assert found.error.max() <= 1.0
    assert found.speed_error.max() <= 1.0


def test_a_known_trajectory():
    """The expected numbers were computed to 40 digits without this program."""
    scene = {"restitution": 0.85, "phase": 0.3, "base": "moving", "waveform": TWO_TONES}
    one = vs.simulate(**scene, base_velocity=[0.7, 3.0])
    lands, speeds = (one[name].values[0, 0, :2] for name in ("landing_time", "rebound_velocity"))
    assert lands == pytest.approx([1.017557260259823, 2.078479057686624], abs=1e-14)
    assert speeds == pytest.approx([5.238099419590123, 5.544664747235231], abs=1e-14)


def test_one_tone_is_the_sine():
    """Up to rounding, as long as that has not grown; rests and lift-offs included."""
    scene = {"amplitude": [1.0, 3.0, 5.0], "launch_time": [0.2, 0.0], "base": "moving"}
    scene["restitution"] = 0.3
    sine = vs.simulate(**scene, duration=6.0)
    one = vs.simulate(**scene, duration=6.0, waveform={"harmonics": [[1, 1.0, 0.0]]})
    assert sine.rested.values.any()
    np.testing.assert_array_equal(one.impact_count, sine.impact_count)
    for name in NAMES:
        np.testing.assert_allclose(one[name].values, sine[name].values, rtol=1e-9, atol=1e-9)


def test_lanes_and_records_agree_for_any_number_of_threads():
    """Statistics of the vector kernel are those of the landings, which are followed one by one."""
    scene = {"waveform": TWO_TONES, "base": "moving", "restitution": 0.6, "duration": 20.0}
    scene |= {"amplitude": [0.5, 2.0, 5.0], "particles": 3}
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
    assert all(outcome.state is State.COMPARED for outcome in report.outcomes)


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
