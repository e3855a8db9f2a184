"""A base of finite mass."""

import math

import numpy as np
import pytest
from flint import acb, arb, ctx
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

import vibrosweep as vs
from tests.cases import each_of
from tests.general import everything_plain
from tests.scenes import RIGID
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
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.proof.reference.laws import Laws
from vibrosweep.proof.reference.sprung import coupled
from vibrosweep.scene.scene import waveform_of
from vibrosweep.theory.sprung import mount_propagator

# A base of finite mass: free motion against ball arithmetic, momentum and energy at impacts.

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


@each_of(
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


# Noise over a base of finite mass: the moving base for massless particles, and momentum.

NOISE = {"restitution_noise": 0.1, "kick_noise": 0.1}


def test_without_mass_particles_move_as_over_the_moving_base():
    scene = {"restitution": 0.8, "amplitude": 1.4, "launch_time": [0.0, 0.3], "duration": 6.0}
    scene |= {**NOISE, "noise_seed": 5, "noise_stream": [0, 7]}
    moving = vs.simulate(base="moving", **scene)
    sprung = vs.simulate(base="sprung", mass_ratio=0.0, mount_frequency=0.4, **scene, **RIGID)
    assert np.array_equal(sprung.impact_count, moving.impact_count)
    for key in ("landing_time", "rebound_velocity"):
        np.testing.assert_allclose(sprung[key], moving[key], rtol=1e-9, atol=1e-9)


# A base of finite mass with other waveforms than the sine, against proved trajectories.

SCENE = {"restitution": 0.3, "amplitude": 3.2, "phase": 0.3, "contact_time": 1e-2}
SCENE |= {"launch_velocity": 3.0}
SCENE |= {"mass_ratio": 0.2, "mount_frequency": 1.6, "mount_damping": 0.1}
LAUNCHES = [0.0, 0.3, 0.55]
DURATION = 2.5
SHAPES = [{"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]}, "parabolic"]


@pytest.fixture(scope="module")
def followed():
    """Landings in plain Python, since compiling would take longer than a few dozen of them."""
    given = SCENE | {"base": "sprung", "launch_time": LAUNCHES, "duration": DURATION}
    names = ("landing_time", "liftoff_time", "rebound_velocity")
    with pytest.MonkeyPatch.context() as patch:
        everything_plain(patch)
        found = [vs.simulate(waveform=shape, **given) for shape in SHAPES]
    return [[one[name].values[0] for name in names] for one in found]


@pytest.mark.parametrize("number", range(len(SHAPES)))
def test_landings_are_those_of_the_proof(followed, number):
    """Under a load, with rests and lift-offs."""
    shape = SHAPES[number]
    waveform = waveform_of(shape)
    given = {name: one.default for name, one in PARAMETERS.items()} | SCENE
    proved = coupled(given, LAUNCHES, DURATION, laws=Laws(waveform=waveform))
    rests = 0
    for particle, known in enumerate(proved.particles):
        rows = [np.array(row[particle], dtype=float) for row in followed[number]]
        for k, impact in enumerate(known.impacts):
            rests += impact.rested
            exact = (impact.landing_time, impact.liftoff_time, impact.rebound_velocity)
            for row, value in zip(rows, exact, strict=True):
                expected = np.nan if value is None else float(value)
                assert row[k] == pytest.approx(expected, rel=0.0, abs=1e-10, nan_ok=True)
        assert np.isnan(rows[0][len(known.impacts) :]).all()
    assert rests > 2


# Motion and recoil of a base of finite mass as parts of another machine, the impact damper.
#
# The impact damper of Masri and Caughey (1966), J. Appl. Mech. 33, 586, without dash-pot: a
# particle of mass mu flies freely between two walls, d apart, of an undamped oscillator of mass 1,
# which would swing with the amplitude B without the particle, and hits each wall once in a cycle.

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
