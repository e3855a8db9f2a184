"""Motion and recoil of a base of finite mass as parts of another machine, the impact damper.

The impact damper of Masri and Caughey (1966), J. Appl. Mech. 33, 586, without dash-pot: a particle
of mass mu flies freely between two walls, d apart, of an undamped oscillator of mass 1, which would
swing with the amplitude B without the particle, and hits each wall once in a cycle.
"""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from vibrosweep.kernels.bases.sprung import Mount, Phase, loaded, move, recoil
from vibrosweep.kernels.restitution import Constant
from vibrosweep.model.coupled_theory import mount_propagator

TWO_PI = 2.0 * math.pi
GAP = 1.0


def impact_damper(gap, amplitude, e, mu, natural):
    """Return (u, phase) of each cycle with two impacts; there are at most two.

    Half a period after an impact everything has changed its sign.  With the speed u of the
    particle, momentum and restitution give the velocity of the oscillator
    -u (1 - e + 2 mu) / (1 + e) before an impact at the wall ahead.  Its free part, z- = -R z+ with
    z+ - z- = (0, 2 mu u) and R its rotation in half a period, is -(mu u / w0) tan(w0 T / 4) in
    position and -mu u in velocity; and the particle travels 2 X + d = u T / 2.  Hence the driven
    part has, at an impact,

        position  u p - d / 2,    p = T / 4 + (mu / w0) tan(w0 T / 4)
        velocity  -u q,           q = (1 - e) (1 + mu) / (1 + e)

    and (u p - d / 2)^2 + (u q T / 2 pi)^2 = B^2 gives u.

    Gap d and amplitude B are in one unit of length, the natural frequency in units of that of the
    forcing, T = 1.  The phase, in turns, is that of the impact at the wall ahead, where the driven
    part is B sin(2 pi phase).
    """
    w0 = TWO_PI * natural
    p = 0.25 + mu / w0 * np.tan(0.25 * w0)
    q = (1.0 - e) * (1.0 + mu) / (1.0 + e)
    speeds = np.roots([p * p + (q / TWO_PI) ** 2, -gap * p, 0.25 * gap * gap - amplitude**2])
    return [
        (float(u), float(np.arctan2(u * p - 0.5 * gap, -u * q / TWO_PI) / TWO_PI))
        for u in np.sort(speeds)
        if np.isreal(u) and u > 0.0
    ]


@pytest.mark.parametrize(
    ("amplitude", "e", "mu", "natural"),
    [(1.0, 0.8, 0.1, 0.9), (1.0, 0.5, 0.05, 1.2), (1.0, 0.3, 0.2, 0.7)],
)
def test_a_particle_between_two_walls_repeats_the_impact_damper(amplitude, e, mu, natural):
    """No gravity and a wall on either side; an impact at the wall ahead is mirrored."""
    of = Mount(e, TWO_PI * amplitude, 0.0, Constant(), 0.0, mu, TWO_PI * natural, 0.0)
    load = loaded(of, 0, 1.0)
    for speed, phase in impact_damper(GAP, amplitude, e, mu, natural):
        # just before the impact at the wall ahead
        place, velocity = speed / 4.0 - GAP / 2.0, -speed * (1.0 - e + 2.0 * mu) / (1.0 + e)
        x = phase + 0.25  # the kernel's drive is -B cos(2 pi x)
        particle, u, side = place + GAP / 2.0, speed, 1.0
        for _ in range(2):
            approach = side * (u - velocity)
            taken = recoil(of, 0, approach, False)
            velocity += side * taken
            u -= side * taken / mu
            side = -side
            d = place + amplitude * math.cos(TWO_PI * x)
            v = velocity - TWO_PI * amplitude * math.sin(TWO_PI * x)
            start = (load, Phase(x, math.sin(TWO_PI * x), math.cos(TWO_PI * x)), d, v)

            def ahead(s, start=start, place=place, velocity=velocity, particle=particle, u=u):
                """Clearance of the particle from the wall that it flies to."""
                base = place + velocity * s + move(*start, s).rise
                return GAP / 2.0 - math.copysign(1.0, u) * (particle + u * s - base)

            s = brentq(ahead, 0.1, 0.9, xtol=1e-15, rtol=1e-15)
            assert s == pytest.approx(0.5, abs=1e-10)
            moved = move(*start, s)
            place, velocity = place + velocity * s + moved.rise, velocity + moved.gain
            particle, x = particle + u * s, x + s
            assert abs(u) == pytest.approx(speed, rel=1e-10)


def follow_damper(gap, amplitude, e, mu, natural, speed, phase):
    """Follow a particle from its impact at the wall ahead to its impact at the other wall."""
    b = amplitude

    def oscillator(state, since, t):
        """Position and velocity of the oscillator after a free motion."""
        x, v = mount_propagator(natural, 0.0, since) @ state
        return x + b * np.sin(TWO_PI * t), v + TWO_PI * b * np.cos(TWO_PI * t)

    def collide(x, v, t):
        """State of the oscillator's free part, and the particle's velocity, after an impact."""
        total, apart = v[0] + mu * v[1], -e * (v[1] - v[0])
        new = (total - mu * apart) / (1.0 + mu)
        driven = np.array([b * np.sin(TWO_PI * t), TWO_PI * b * np.cos(TWO_PI * t)])
        return np.array([x, new]) - driven, new + apart

    # just before the impact at the wall ahead, from the closed form
    x = speed / 4.0 - gap / 2.0
    v = -speed * (1.0 - e + 2.0 * mu) / (1.0 + e)
    free, u = collide(x, (v, speed), phase)
    place = x + gap / 2.0
    other = phase + 0.5
    assert place + 0.5 * u == pytest.approx(oscillator(free, 0.5, other)[0] - gap / 2.0, abs=1e-12)
    inside = np.linspace(0.0, 0.5, 200)[1:-1]
    shifted = [place + u * s - oscillator(free, s, phase + s)[0] for s in inside]
    assert np.max(np.abs(shifted)) < gap / 2.0
    x2, v2 = oscillator(free, 0.5, other)
    assert (x2, v2, u) == pytest.approx((-x, -v, -speed), abs=1e-12)


@pytest.mark.parametrize(
    ("natural", "mu", "e"), [(0.9, 0.1, 0.8), (1.2, 0.05, 0.5), (0.7, 0.2, 0.3)]
)
def test_the_impact_damper_repeats_with_its_sign_changed(natural, mu, e):
    solutions = impact_damper(1.0, 1.0, e, mu, natural)
    assert len(solutions) == 1  # the walls are closer than the oscillator swings
    follow_damper(1.0, 1.0, e, mu, natural, *solutions[0])


def test_the_impact_damper_has_two_solutions_between_far_walls_and_none_between_farther_ones():
    numbers = {"amplitude": 0.4, "e": 0.8, "mu": 0.1, "natural": 0.9}
    solutions = impact_damper(1.0, **numbers)
    assert len(solutions) == 2
    for speed, phase in solutions:
        follow_damper(1.0, 0.4, 0.8, 0.1, 0.9, speed, phase)
    assert impact_damper(1e3, **numbers) == []
