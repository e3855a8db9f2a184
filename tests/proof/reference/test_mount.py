"""The proved motion of the base on its mount: its equation, its bounds, its parts."""

import math

import numpy as np
import pytest
from flint import arb, ctx
from scipy.integrate import solve_ivp

from vibrosweep.model.shapes import SINE, Waveform
from vibrosweep.proof.reference.sprung import Arc, Mount

X, D, V = 0.3, 0.12, -0.4


TWO_TONES = Waveform("harmonics", ((1, 1.0, 0.0), (2, 0.4, 1.1)))


def arc_of(nu, zeta, mu, riders, waveform=SINE, after=0.0):
    mount = Mount(arb(0.4), 2 * arb.pi() * arb(nu), arb(zeta), arb(mu), waveform)
    side = -1 if mount.has_corners else 1
    return Arc(mount, arb(X), (arb(D), arb(V)), riders, arb(after), 1, side)


MOUNTS = [
    (nu, zeta, mu, riders)
    for nu, zeta in ((0.37, 0.0), (0.37, 0.05), (1.6, 1.0), (1.6, 2.5), (4.0, 0.3))
    for mu, riders in ((0.2, 0), (0.2, 3))
] + [(0.5, 2.0, 1.0, 3)]  # damping that is critical for the load


PARABOLIC = Waveform("parabolic")


@pytest.mark.parametrize("shape", [SINE, TWO_TONES, PARABOLIC], ids=lambda one: one.name)
@pytest.mark.parametrize(("nu", "zeta", "mu", "riders"), MOUNTS)
def test_motion_solves_its_equation(nu, zeta, mu, riders, shape):
    w0, load = 2.0 * math.pi * nu, riders * mu

    def force(t, state):
        own = 0.4 * float(shape.height(X + t)), 0.4 * float(shape.velocity(X + t))
        push = 0.4 * float(shape.slope(X + t)) - 2.0 * load
        push += 2.0 * zeta * w0 * (own[1] - state[1]) + w0 * w0 * (own[0] - state[0])
        return state[1], push / (1.0 + load)

    start = D + 0.4 * float(shape.height(X)), V + 0.4 * float(shape.velocity(X))
    times = np.linspace(0.0, 0.44 if shape == PARABOLIC else 2.0, 21)  # up to a corner at 0.45
    path = solve_ivp(force, (0.0, times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-13)
    arc = arc_of(nu, zeta, mu, riders, shape)
    for t, y, v in zip(times, *path.y, strict=True):
        s = arb(t)
        assert float(arc.derivative(0, s)) == pytest.approx(y, rel=0.0, abs=1e-10)
        assert float(arc.derivative(1, s)) == pytest.approx(v, rel=0.0, abs=1e-9)
        assert float(arc.derivative(2, s)) == pytest.approx(force(t, (y, v))[1], abs=1e-8)


@pytest.mark.parametrize(("nu", "zeta", "mu", "riders"), MOUNTS)
def test_parts_and_bounds(nu, zeta, mu, riders):
    with ctx.workprec(400):
        arc, step = arc_of(nu, zeta, mu, riders), arb(2) ** -120
        most = [arc.most(order, arb(0)) for order in range(6)]
        for t in np.linspace(0.0, 3.0, 13):
            s = arb(t)
            for order in range(4):
                ends = arc.derivative(order, s + step), arc.derivative(order, s - step)
                assert abs((ends[0] - ends[1]) / (2 * step) - arc.derivative(order + 1, s)) < 1e-20
            for order in range(5):
                mean = arc.level if order == 0 else 0
                assert abs(arc.derivative(order, s) - mean) < most[order] + arb(1e-30)
                assert arc.most(order, s) < most[order] + arb(1e-30)
            far, fast = arc.since(s)
            zero = arb(0)
            line = arc.derivative(0, zero) + s * arc.derivative(1, zero)
            assert far.overlaps(arc.derivative(0, s) - line)
            assert fast.overlaps(arc.derivative(1, s) - arc.derivative(1, zero))
            own = -arb(0.4) / (2 * arb.pi()) * (2 * (arb(X) + s)).cos_pi()
            deviation, rate = arc.deviation(s)
            assert (deviation + own).overlaps(arc.derivative(0, s))
            velocity = arb(0.4) * (2 * (arb(X) + s)).sin_pi()
            assert (rate + velocity).overlaps(arc.derivative(1, s))


@pytest.mark.parametrize(("nu", "zeta", "mu", "riders"), MOUNTS)
def test_state_of_another_instant_gives_the_same_motion(nu, zeta, mu, riders):
    with ctx.workprec(200):
        arc, late = arc_of(nu, zeta, mu, riders), arb(0.01)
        mount = Mount(arb(0.4), 2 * arb.pi() * arb(nu), arb(zeta), arb(mu))
        again = Arc(mount, arb(X), arc.deviation(late), riders, late, 1)
        for order in range(3):
            assert again.derivative(order, arb(0.7)).overlaps(arc.derivative(order, arb(0.7)))
