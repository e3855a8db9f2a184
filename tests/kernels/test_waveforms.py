"""The map with any waveform: known trajectories, bounds of rounding, and rests."""

import flint
import numpy as np
import pytest

import vibrosweep as vs
from tests.scenes import TWO_TONES
from vibrosweep.kernels.waveforms import (
    Parabolic,
    Sine,
    kick_slope,
    left_out,
    lift_offs,
    rise_of,
    shape_of,
    velocity,
)
from vibrosweep.model.shapes import Waveform

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


def test_a_known_trajectory():
    """The expected numbers were computed to 40 digits without this program."""
    one = vs.simulate(
        amplitude=1.2, launch_time=0.2, waveform={"harmonics": [[1, 1.0, 0.0], [2, 0.2, 0.0]]}
    )
    lands, speeds = (one[name].values[0, 0] for name in ("landing_time", "rebound_velocity"))
    assert lands[:2] == pytest.approx([1.219367991845056, 2.395303123620822], abs=1e-14)
    assert speeds[:2] == pytest.approx([5.767961821360131, 5.692615952193482], abs=1e-13)
    assert lands[7] == pytest.approx(8.416088615464953, abs=1e-13)


def test_one_tone_is_the_sine_and_the_weight_scales():
    scene = {"amplitude": [0.3, 1.2, 2.0], "launch_time": [0.2, 0.0], "duration": 60.0}
    sine = vs.simulate(**scene)
    for weight in (1.0, 2.0):
        shaped = vs.simulate(
            **{**scene, "amplitude": [0.3 / weight, 1.2 / weight, 2.0 / weight]},
            waveform={"harmonics": [[1, weight, 0.0]]},
        )
        for name in NAMES:
            np.testing.assert_array_equal(shaped[name].values, sine[name].values)


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
        "realizations": 60,
        "seed": 3,
        "particles": 4,
        "duration": 400.0,
        "regimes": True,
        "lyapunov": True,
        "separation": True,
        "trust": True,
    }
    long = vs.sweep(scene, threads=1)
    again = vs.sweep(scene, threads=2)
    for name in long.data_vars:
        np.testing.assert_array_equal(long[name].values, again[name].values)
    assert np.isfinite(long["landing_time_error"].values).any()
    resting = long["cycle_rests"].values
    assert (resting == 1).any()
    assert (resting > 1).any()
    assert np.isneginf(long["lyapunov_largest"].values[resting > 0]).all()
    for i in np.flatnonzero((resting > 1).any(axis=1))[:3].tolist():
        given = {n: float(long[n][i]) for n in ("amplitude", "restitution")}
        every = vs.simulate(**given, waveform=RISES, particles=4, duration=400.0)
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
            assert missed <= left_out(shape, 1.0, x, abs(off)) + 1e-15


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
        duration=3000.0,
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
