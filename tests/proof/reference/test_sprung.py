"""Trajectories over a base of finite mass, and waves."""

import math
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from tests.cases import each_of
from vibrosweep.errors import ParameterError
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.model.shapes import SINE, Waveform
from vibrosweep.proof.reference.arithmetic import UndecidableError
from vibrosweep.proof.reference.laws import Constant, Laws, next_of, wave_of
from vibrosweep.proof.reference.sprung import (
    LANDING,
    LAUNCH,
    LIFTOFF,
    Arc,
    Bodies,
    CoupledSystem,
    ExactMount,
    Launch,
    bodies_of,
    coupled,
)
from vibrosweep.proof.reference.trajectories import trajectory
from vibrosweep.proof.sampling import deviates_of

# The proved base of finite mass: the moving base as its limit, budgets, a locked orbit, ties.

PARABOLIC = Waveform("parabolic")
TABLE_1 = {name: one.default for name, one in PARAMETERS.items()} | {
    "mass_ratio": 0.05,
    "mount_frequency": 0.37,
    "mount_damping": 0.05,
}
# e, amplitude, mass ratio, mount frequency, damping: light, undamped, critical, overdamped, stiff
SCENES = [
    (0.7, 2.0, 0.01, 0.37, 0.05),
    (0.5, 3.2, 0.05, 0.77, 0.0),
    (0.4, 4.0, 0.2, 1.6, 1.0),
    (0.3, 3.0, 0.2, 1.6, 1.5),
    (0.6, 2.6, 0.5, 4.0, 0.1),
    (0.0, 4.5, 0.1, 0.21, 0.05),
]


def number(low, high):
    return st.floats(low, high, allow_subnormal=False)


def run(launch_times, duration, **changes):
    return coupled(TABLE_1 | changes, launch_times, duration)


def scene(e, amplitude, mass_ratio, mount_frequency, mount_damping):
    return {
        "restitution": e,
        "amplitude": amplitude,
        "mass_ratio": mass_ratio,
        "mount_frequency": mount_frequency,
        "mount_damping": mount_damping,
        "contact_time": 5e-3,
    }


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"amplitude": 4.0, "restitution": 0.4},
        {"amplitude": 0.0, "restitution": 0.7},
        {"kick_noise": 0.3, "restitution_noise": 0.2},
    ],
)
def test_particles_without_mass_see_the_moving_base(changes):
    launch_times = (0.0, 0.3, 0.3)
    alone = TABLE_1 | {"contact_time": 1e-2} | changes
    drawn = partial(deviates_of, 5, 7.0) if "kick_noise" in changes else None
    found = coupled(alone | {"mass_ratio": 0.0}, launch_times, 4.0, deviates=drawn)
    for name in ("mass_ratio", "mount_frequency", "mount_damping"):
        del alone[name]
    for particle, time in enumerate(launch_times):
        own, deviates = found.particles[particle], None if drawn is None else drawn(particle)
        other = trajectory(
            base="moving", launch_time=time, duration=4.0, deviates=deviates, **alone
        )
        assert own.at_rest == other.at_rest
        assert own.launch.duration.overlaps(other.launch.duration)
        for a, b in zip(own.impacts, other.impacts, strict=True):
            assert a.rested == b.rested
            assert a.count == b.count
            assert a.landing_time.overlaps(b.landing_time)
            if a.flight is not None:
                assert a.liftoff_time.overlaps(b.liftoff_time)
                assert a.rebound_velocity.overlaps(b.rebound_velocity)
                for name in ("speed", "height", "duration"):
                    assert getattr(a.flight, name).overlaps(getattr(b.flight, name)), name
    assert all(event.deviation == 0 for event in found.events)


@each_of("values", SCENES)
def test_momentum_and_energy_of_each_impact(values):
    changes = scene(*values)
    found = run((0.0, 0.21, 0.4), 4.0, **changes)
    riders = kinds = 0
    with ctx.workprec(2 * found.precision_bits):
        mu, e = arb(changes["mass_ratio"]), arb(changes["restitution"])
        for event, then in pairwise(found.events):
            if event.kind is LANDING:
                sticks = event.relative is None
                thrown = then.kind is LIFTOFF and then.turns is event.turns
                # the colliding masses: the particle, and the base with the riders that stay
                mass = 1 + mu * (0 if thrown else riders)
                change = mass * (event.base - event.base_before)
                assert (mu * (event.after - event.before) + change).overlaps(arb(0))
                c = event.base_before - event.before
                lost = mu * (event.before**2 - event.after**2)
                lost += mass * (event.base_before**2 - event.base**2)
                kept = arb(0) if sticks else e
                assert (lost / 2).overlaps(mass * mu / (2 * (mass + mu)) * (1 - kept**2) * c**2)
                if thrown:
                    assert then.after.overlaps(event.base_before)
                    assert then.relative > changes["contact_time"]
                kinds |= 1 << (2 * sticks + (riders > 0))
            riders = event.riders
    assert kinds & 5 == 5  # some bounce and some stick


@each_of("values", SCENES)
def test_flights_begin_and_end_on_the_base(values):
    found = run((0.0, 0.21, 0.4), 3.0, **scene(*values))
    with ctx.workprec(2 * found.precision_bits):
        alpha = bodies_of(TABLE_1 | scene(*values)).mount.alpha
        left = {}
        for event in found.events:
            own = -alpha / (2 * arb.pi()) * (2 * event.turns).cos_pi()
            assert event.height.overlaps(own + event.deviation)
            if event.kind is LANDING:
                start = left.pop(event.particle)
                s = event.turns - start.turns
                assert event.height.overlaps(start.height + s * start.after - s * s)
                assert event.before.overlaps(start.after - 2 * s)
            if event.relative is not None:
                left[event.particle] = event


def test_the_base_responds_to_every_impact_by_its_own_oscillation():
    """Without riders D is the sum of the responses to all impacts; no flight crosses the base."""
    changes = {"mass_ratio": 0.1, "mount_damping": 0.2, "amplitude": 3.0}
    found = run((0.0, 0.3, 0.8), 8.0, **changes)
    assert not any(event.riders for event in found.events)
    mount = bodies_of(TABLE_1 | changes).mount
    w0, zeta, alpha = (float(v) for v in (mount.natural, mount.damping, mount.alpha))
    w = w0 * math.sqrt(1.0 - zeta**2)
    hits = [
        (float(e.turns), float(e.base - e.base_before)) for e in found.events if e.kind is LANDING
    ]

    def base(t):
        height = -alpha / (2.0 * math.pi) * np.cos(2.0 * math.pi * t)
        for time, velocity in hits:
            s = np.maximum(t - time, 0.0)
            height += velocity / w * np.exp(-zeta * w0 * s) * np.sin(w * s)
        return height

    left = {}
    for event in found.events:
        t = float(event.turns)
        assert float(event.height) == pytest.approx(float(base(t)), rel=0.0, abs=1e-12)
        if event.kind is LANDING:
            start = left[event.particle]
            s = np.linspace(0.0, t - float(start.turns), 1001)[1:-1]
            flown = float(start.height) + s * (float(start.after) - s)
            assert np.all(flown > base(float(start.turns) + s))
        left[event.particle] = event
    assert len(hits) > 20


@each_of("mass_ratio", [0.01, 0.2, 0.5])
@each_of(("k", "nu"), [(1, 0.37), (2, 0.77), (1, 4.3)])
def test_locked_orbit_without_damping(mass_ratio, k, nu):
    """The sine of the landing phase is Gamma_k (1 + mu) / Gamma: one impact every k periods."""
    with ctx.workprec(300):
        e, mu, w0 = arb(0.8), arb(mass_ratio), 2 * arb.pi() * arb(nu)
        least = arb.pi() * k * (1 - e) / (1 + e) * (1 + mu)
        gamma = least * 1.1
        x = (1 - (least / gamma).asin() / arb.pi()) / 2
        recoil = 2 * k * mu
        half = w0 * k / 2
        deviation = -recoil / 2 / (w0 * half.sin()) * half.cos()
        mount = ExactMount(gamma / arb.pi(), w0, arb(0), mu)
        bodies = Bodies(mount, Constant(e), arb(1e-4), arb(k))
        system = CoupledSystem(bodies, [Launch(x, (0,))], x + 9 * k, deviation, -recoil / 2)
        while system.landings < 6:
            assert system.advance()
        for n, event in enumerate(system.events):
            assert event.turns.overlaps(x + n * k)
            assert event.after.overlaps(arb(k))
            assert event.deviation.overlaps(deviation)
            assert event.rate.overlaps(-recoil / 2)
            assert event.turns.rad() < 1e-40


@settings(max_examples=20, deadline=None)
@given(
    mu=number(1e-3, 2.0),
    nu=number(0.1, 3.0),
    u=number(0.5, 5.0),
    gap=number(0.05, 2.0),
)
def test_elastic_particles_on_an_undamped_base_keep_their_energy(mu, nu, u, gap):
    still = {"restitution": 1.0, "amplitude": 0.0, "contact_time": 1e-9, "gravity": 2.0}
    mounted = {"mass_ratio": mu, "mount_frequency": nu, "mount_damping": 0.0}
    # irrational factors, because simple ratios lead to ties
    times, speed = (0.0, gap / math.pi), u / math.e
    found = run(times, 3.0 * speed, launch_velocity=speed, **still, **mounted)
    with ctx.workprec(2 * found.precision_bits):
        w0, mass = 2 * arb.pi() * arb(nu), arb(mu)
        flying, launched, total = {}, 0, None
        for event in found.events:
            if event.relative is not None:
                flying[event.particle] = event
            launched += event.kind is LAUNCH
            energy = (event.rate**2 + w0**2 * event.deviation**2) / 2
            for start in flying.values():  # the energy is constant along a parabola
                energy += mass * (start.after**2 / 2 + 2 * start.height)
            if launched == 2 and event.kind is LANDING:
                assert energy.overlaps(total)
            elif event.kind is LAUNCH:
                total = energy


def test_particles_in_the_same_state_land_in_the_order_of_their_numbers():
    found = run((0.2, 0.0, 0.0), 3.0, restitution=0.6, amplitude=2.0, contact_time=1e-2)
    landings = [event for event in found.events if event.kind is LANDING]
    first, second = (event for event in landings if event.number <= 2)
    assert (first.particle, second.particle) == (1, 2)
    assert first.turns is second.turns
    assert second.base_before.overlaps(first.base)
    assert second.base < first.base
    assert first.after > second.after


def test_undecided_events_are_named():
    still = {"amplitude": 0.0, "gravity": 2.0, "launch_velocity": 1.0}
    with pytest.raises(UndecidableError, match="launch of particle 1"):
        run((0.0, 1.0), 3.0, **still)
    assert len(run((0.0,), 1.0, **still).particles[0].impacts) == 1  # exactly at the end
    resonant = {"mount_frequency": 1.5, "mass_ratio": 1.25, "mount_damping": 0.0}
    with pytest.raises(UndecidableError, match="resonance"):
        run((0.0,), 3.0, restitution=0.0, **resonant)


@pytest.mark.parametrize("launch_time", [0.25, 0.75])
def test_a_launch_at_a_corner_of_the_drive_is_decided(launch_time):
    """Exactly there the acceleration of the base jumps."""
    given = TABLE_1 | {"amplitude": 3.0, "phase": 0.0, "mass_ratio": 0.0}
    own = coupled(given, (launch_time,), 4.0, laws=Laws(waveform=PARABOLIC)).particles[0]
    for name in ("mass_ratio", "mount_frequency", "mount_damping"):
        del given[name]
    other = trajectory(
        base="moving", waveform=PARABOLIC, launch_time=launch_time, duration=4.0, **given
    )
    for a, b in zip(own.impacts, other.impacts, strict=True):
        assert a.landing_time.overlaps(b.landing_time)
    assert len(own.impacts) > 1


def test_at_rest_for_good_is_known_at_the_end():
    """The free oscillation must have decayed so far that it can no longer lift the particle."""
    slow = {"restitution": 0.0, "amplitude": 1.0, "mount_frequency": 0.5, "mass_ratio": 0.5}
    rests = [
        run((0.0,), duration, mount_damping=damping, launch_velocity=9.0, **slow).particles[0]
        for duration, damping in ((3.0, 0.02), (12.0, 0.02), (12.0, 0.0))
    ]
    assert [own.at_rest for own in rests] == [False, True, False]
    assert all(own.impacts[-1].rested for own in rests)
    # the first lifts off half a period after the end; this is still part of its last stay
    assert [own.impacts[-1].flight is None for own in rests] == [False, True, True]
    assert 3.5 < float(rests[0].impacts[-1].liftoff_time) < 3.6


def test_budget_of_landings():
    with pytest.raises(ParameterError, match="max_landings = 3:"):
        coupled(TABLE_1, (0.0, 0.1), 12.0, max_landings=3)


# The proved motion of the base on its mount: its equation, its bounds, its parts.

X, D, V = 0.3, 0.12, -0.4
TWO_TONES = Waveform("harmonics", ((1, 1.0, 0.0), (2, 0.4, 1.1)))


def arc_of(nu, zeta, mu, riders, waveform=SINE, after=0.0):
    mount = ExactMount(arb(0.4), 2 * arb.pi() * arb(nu), arb(zeta), arb(mu), waveform)
    return Arc(mount, arb(X), (arb(D), arb(V)), riders, arb(after), 1, round(2 * X))


MOUNTS = [
    (nu, zeta, mu, riders)
    for nu, zeta in ((0.37, 0.0), (0.37, 0.05), (1.6, 1.0), (1.6, 2.5), (4.0, 0.3))
    for mu, riders in ((0.2, 0), (0.2, 3))
] + [(0.5, 2.0, 1.0, 3)]  # damping that is critical for the load


@each_of("shape", [SINE, TWO_TONES, PARABOLIC])
@each_of(("nu", "zeta", "mu", "riders"), MOUNTS)
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


@each_of(("nu", "zeta", "mu", "riders"), MOUNTS)
def test_derivatives_and_parts(nu, zeta, mu, riders):
    with ctx.workprec(400):
        arc, step = arc_of(nu, zeta, mu, riders), arb(2) ** -120
        for t in np.linspace(0.0, 3.0, 13):
            s = arb(t)
            for order in range(4):
                ends = arc.derivative(order, s + step), arc.derivative(order, s - step)
                assert abs((ends[0] - ends[1]) / (2 * step) - arc.derivative(order + 1, s)) < 1e-20
            own = -arb(0.4) / (2 * arb.pi()) * (2 * (arb(X) + s)).cos_pi()
            deviation, rate = arc.deviation(s)
            assert (deviation + own).overlaps(arc.derivative(0, s))
            velocity = arb(0.4) * (2 * (arb(X) + s)).sin_pi()
            assert (rate + velocity).overlaps(arc.derivative(1, s))


@each_of("shape", [SINE, TWO_TONES, PARABOLIC])
@each_of(("nu", "zeta", "mu", "riders"), [*MOUNTS, (1.6, 1 + 2**-44, 0.2, 0)])
def test_the_ball_of_an_interval_holds_all_that_happens_in_it(nu, zeta, mu, riders, shape):
    """And its radius is of the order of the change of the motion, also near critical damping."""
    arc, fast = arc_of(nu, zeta, mu, riders, shape), 4.0 * math.pi * max(2.0 * nu * zeta, nu, 2.0)
    for start in (0.0, 0.1, 0.25):
        for order in range(5):
            for width in (0.18, 1e-3):
                inside = [arc.derivative(order, arb(start + width * k / 16)) for k in range(17)]
                ball = arc.derivative(order, arb(start).union(arb(start + width)))
                assert all(ball.contains(one) for one in inside)
            assert ball.rad() < width * fast ** (order + 1)


@each_of(("nu", "zeta", "mu", "riders"), MOUNTS)
def test_a_base_that_presses_for_good_never_falls_faster_than_gravity(nu, zeta, mu, riders):
    kinds = set()
    for alpha in (0.05, 0.4):
        mount = ExactMount(arb(alpha), 2 * arb.pi() * arb(nu), arb(zeta), arb(mu))
        arc = Arc(mount, arb(X), (arb(D) / 8, arb(V) / 8), riders, arb(0), 1)
        for since in (0.0, 2.0):
            later = np.linspace(since, since + 9.0, 300)
            falls = any(arc.derivative(2, arb(t)) < -2 for t in later)
            assert not (falls and arc.presses_for_good(arb(since)))
            kinds.add(arc.presses_for_good(arb(since)))
    assert False in kinds


@each_of(("nu", "zeta", "mu", "riders"), MOUNTS)
def test_state_of_another_instant_gives_the_same_motion(nu, zeta, mu, riders):
    with ctx.workprec(200):
        arc, late = arc_of(nu, zeta, mu, riders), arb(0.01)
        mount = ExactMount(arb(0.4), 2 * arb.pi() * arb(nu), arb(zeta), arb(mu))
        again = Arc(mount, arb(X), arc.deviation(late), riders, late, 1)
        for order in range(3):
            assert again.derivative(order, arb(0.7)).overlaps(arc.derivative(order, arb(0.7)))


# Shapes of the motion in ball arithmetic: known trajectories, identities, phases of lift-offs.

TWO = Waveform("harmonics", ((1, 1.0, 0.0), (2, 0.4, 1.1)))
THREE = Waveform("harmonics", ((1, 0.3, 0.0), (3, 1.0, 0.5)))
SHAPES = [SINE, TWO, THREE, PARABOLIC]


def run_waves(**given):
    scene = {name: one.default for name, one in PARAMETERS.items()}
    return trajectory(**(scene | {"launch_time": 0.0, "duration": 9.0} | given))


def test_known_trajectories():
    """Computed to 40 digits, independently of this package."""
    over = run_waves(
        base="moving",
        waveform=TWO,
        restitution=0.85,
        amplitude=0.7 * 1.85,
        phase=0.3,
        launch_velocity=5.0,
    )
    assert over.landing_time[:2] == pytest.approx([1.017557260259823, 2.078479057686624], abs=4e-15)
    speeds = [5.238099419590123, 5.544664747235231]
    assert over.rebound_velocity[:2] == pytest.approx(speeds, abs=1e-14)
    even = Waveform("harmonics", ((1, 1.0, 0.0), (2, 0.2, 0.0)))
    on = run_waves(waveform=even, amplitude=1.2, launch_time=0.2, launch_velocity=5.0)
    assert on.landing_time[7] == pytest.approx(8.416088615464953, abs=2e-15)


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_balls_hold_the_shape_and_its_differences(shape):
    wave, bounds = wave_of(shape), wave_of(shape).bounds
    for x in np.random.default_rng(1).uniform(-2.0, 2.0, 40).tolist():
        for s in (1e-6, 0.1, 0.3, 4.7):
            h, begun = 2 * arb(x), wave.at_liftoff(2 * arb(x))
            then = h + 2 * arb(s)
            rise = wave.level(then) - wave.level(h) - arb(s) * wave.velocity(h)
            assert rise.overlaps(wave.rise(begun, arb(s)))
            assert wave.gain(begun, arb(s)).overlaps(wave.velocity(then) - wave.velocity(h))
        assert float(wave.velocity(h)) == pytest.approx(float(shape.velocity(x)), abs=1e-13)
        assert float(wave.level(h)) == pytest.approx(float(shape.height(x)), abs=1e-13)
        assert float(wave.slope(h)) == pytest.approx(float(shape.slope(x)), abs=1e-11)
        for value, bound in ((wave.level, bounds.top), (wave.slope, bounds.steep)):
            assert abs(value(h)) <= bound + arb(2) ** -40
    wide = wave.velocity(arb(0.5, 0.3))  # a ball of phases gives a ball of all their values
    assert all(wide.overlaps(wave.velocity(arb(h))) for h in np.linspace(0.25, 0.75, 9).tolist())


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_phases_of_lift_offs_are_all_found(shape):
    x = np.linspace(-0.5, 0.5, 200_001)
    with ctx.workprec(200):
        wave = wave_of(shape)
        for level in (0.02, 0.4):
            risen = np.diff((shape.velocity(x) > level).astype(int)) > 0
            found = wave.rises(arb(1), arb(level), 1)
            assert len(found) == risen.sum()
            assert all((wave.velocity(2 * one) - arb(level)).contains(0) for one in found)
            assert all(one.rad() < 1e-40 for one in found)
        falls, presses = wave.falls(arb(0.6), 1)
        thrown = 1.0 + 0.3 * shape.slope(x) < 0.0
        assert len(falls) == (np.diff(thrown.astype(int)) > 0).sum()
        assert len(presses) == len(falls)
        first = next_of(falls, arb(7.3), 1)
        assert 7.3 <= float(first) <= 8.3
        assert all(
            float(one) - float(first) > -1e-9 for one in [next_of([f], arb(7.3), 1) for f in falls]
        )
