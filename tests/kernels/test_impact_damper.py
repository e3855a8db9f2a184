"""Motion and recoil of a base of finite mass as parts of another machine, the impact damper."""

import math

import pytest
from scipy.optimize import brentq

from vibrosweep.kernels.bases.drives import Phase
from vibrosweep.kernels.bases.sprung import Mount, loaded, move, recoil
from vibrosweep.kernels.restitution import Constant
from vibrosweep.model.coupled_theory import impact_damper

TWO_PI = 2.0 * math.pi
GAP = 1.0


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
