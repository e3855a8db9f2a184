"""A base of finite mass: free motion against ball arithmetic, momentum and energy at impacts."""

import numpy as np
import pytest
from flint import acb, arb, ctx
from hypothesis import given
from hypothesis import strategies as st

from vibrosweep.kernels.bases.sprung import (
    Mount,
    Phase,
    bounds,
    forced_motion,
    free_motion,
    loaded,
    move,
    phase_of,
    recoil,
)
from vibrosweep.kernels.restitution import Constant

EPS = 2.0**-52


def mount_of(e, alpha, mu, w, zeta):
    return Mount(e, alpha, 1e-4, Constant(), 0.0, mu, w, zeta)


def exact(load, s):
    """Rise and gain of the motions from a deviation of 1, and from a velocity of 1."""
    k, b, t = arb(load.stiffness), arb(load.drag), arb(float(s))
    root = acb(b * b - k).sqrt()
    slow, fast = acb(-b) + root, acb(-b) - root
    first, second = (slow * t).exp(), (fast * t).exp()
    odd = (first - second) / (slow - fast)
    even = (slow * second - fast * first) / (slow - fast)  # from a deviation of 1, at rest
    turned = (slow * first - fast * second) / (slow - fast)
    fell = -k * odd
    return [float(x.real) for x in (even - 1, fell, odd - t, turned - 1)]


@pytest.mark.parametrize(
    "damping", [0.0, 1e-9, 0.05, 0.9, 1.0 - 1e-9, 1.0, 1.0 + 2.0**-52, 1.0 + 1e-9, 1.3, 20.0, 1e3]
)
def test_free_motion_is_accurate_however_short(damping):
    rng = np.random.default_rng(7)
    with ctx.workprec(400):
        for s in np.geomspace(1e-12, 4.0, 60):
            w = rng.uniform(0.5, 15.0)
            load = loaded(mount_of(0.9, 0.3, 0.0, w, damping), 0, 1.0)
            d, v = rng.uniform(-1.0, 1.0, 2)
            fall, slowed, lag, gained = exact(load, s)
            rise, gain, _, _ = free_motion(load, d, v + load.slow * d, s)
            # the phase w s is rounded; terms of d and v may cancel each other
            few = 16.0 * EPS * (1.0 + (1.0 + damping) * w * s)
            size = abs(d * fall) + abs(v * lag)
            if damping > 1.0:  # a difference, once the fast part has decayed
                size += abs(d) + abs(v * s)
            assert abs(rise - (d * fall + v * lag)) <= few * size
            assert abs(gain - (d * slowed + v * gained)) <= few * (
                abs(d * slowed) + abs(v * gained) + abs(v) * load.drag * s
            )


@pytest.mark.parametrize("damping", [1.0 + 1e-9, 1.3, 20.0, 1e3])
def test_the_acceleration_keeps_its_digits_once_a_recoil_has_decayed(damping):
    load = loaded(mount_of(0.9, 0.0, 0.0, 5.0, damping), 0, 1.0)
    with ctx.workprec(400):
        k, b = arb(load.stiffness), arb(load.drag)
        root = (b * b - k).sqrt()
        for s in np.geomspace(80.0 / load.fast, 100.0 / load.fast + 1.0 / load.slow, 10):
            slow, fast = b - root, b + root
            first, second = (-slow * s).exp(), (-fast * s).exp()
            pull = float((fast**2 * second - slow**2 * first) / (2 * root))
            moved = move(load, Phase(0.0, 0.0, 1.0), 0.0, -1.0, s)  # from a velocity of -1
            # slow s, which is rounded, is at most 100
            assert moved.pull == pytest.approx(pull, rel=400.0 * EPS)


@pytest.mark.parametrize("damping", [0.0, 0.3, 1.5, 30.0])
def test_bounds_hold(damping):
    rng = np.random.default_rng(8)
    for _ in range(30):
        load = loaded(mount_of(0.9, 0.3, 0.1, rng.uniform(0.5, 60.0), damping), 2, 1.0)
        d, v = rng.normal(0.0, (0.05, 1.0))
        b = v + load.slow * d
        limit = bounds(load, d, b)
        for s in np.geomspace(1e-6, 3.0, 40):
            x = rng.uniform(-0.5, 0.5)
            moved = move(load, phase_of(x), d, b, s)
            turned = x + s
            forced = forced_motion(load.drive, phase_of(turned - np.rint(turned)))
            assert forced.height + load.level + moved.d <= limit.height + 1e-12
            assert abs(moved.pull) <= limit.pull * (1.0 + 1e-9)
            assert abs(moved.jerk) <= limit.jerk * (1.0 + 1e-9)


@given(
    st.floats(1e-6, 1.0),
    st.floats(0.0, 1.0),
    st.integers(0, 5),
    st.floats(1e-6, 10.0),
    st.booleans(),
)
def test_an_impact_keeps_momentum_and_takes_the_energy_that_restitution_says(
    mu, e, riders, c, sticks
):
    """The particle arrives at -c on a base at rest, in units of the mass of the base."""
    taken = recoil(mount_of(e, 0.3, mu, 1.0, 0.05), riders, c, sticks)
    e = 0.0 if sticks else e
    mass, leaves = 1.0 + riders * mu, -taken + e * c
    before, after = -mu * c, mu * leaves - mass * taken
    assert after == pytest.approx(before, rel=1e-13)
    lost = 0.5 * mu * c**2 - 0.5 * (mu * leaves**2 + mass * taken**2)
    reduced = mu * mass / (mu + mass)
    assert lost == pytest.approx(0.5 * reduced * (1.0 - e**2) * c**2, abs=1e-13 * mu * c**2)
