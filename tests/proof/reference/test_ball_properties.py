"""The proved reference against independent slow computations, on parameters found by hypothesis."""

import math
from decimal import ROUND_CEILING, Decimal, localcontext

import numpy as np
from flint import arb, ctx
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from vibrosweep.proof.reference.arithmetic import Enclosure
from vibrosweep.proof.reference.high_bounce import BallMap
from vibrosweep.proof.reference.laws import Constant
from vibrosweep.proof.reference.trajectories import trajectory


def number(low, high):
    return st.floats(low, high, allow_subnormal=False)


SCENES = st.fixed_dictionaries(
    {
        "restitution": st.one_of(st.just(0.0), st.just(1.0), number(0.3, 1.0)),
        "amplitude": st.one_of(st.just(0.0), number(1e-12, 5.0)),
        "frequency": number(0.3, 3.0),
        "phase": number(-10.0, 10.0),
        "gravity": number(3.0, 20.0),
        "launch_velocity": number(0.0, 8.0),
        "contact_time": number(1e-4, 0.2),
        "launch_time": number(-20.0, 20.0),
    }
)
LAWS = st.sampled_from(["rest", "reflect"])
IMPACTS = 25


@settings(max_examples=150, deadline=None)
@given(scene=SCENES, rebound=LAWS)
def test_invariants(scene, rebound):
    result = trajectory(duration=1e6, max_impacts=IMPACTS, rebound=rebound, **scene)
    with ctx.workprec(2 * result.precision_bits):
        e, amplitude = arb(scene["restitution"]), arb(scene["amplitude"])
        rest = arb(scene["gravity"]) * arb(scene["contact_time"]) / 2
        arrival, now = arb(scene["launch_velocity"]), arb(scene["launch_time"])
        bound = arrival if e == 1 else arrival.max(amplitude / (1 - e)).max(rest)
        for impact in result.impacts:
            flight = impact.landing_time - now
            assert flight.overlaps(2 * arrival / arb(scene["gravity"]))
            if impact.rebound_velocity is None:
                break
            speed = impact.rebound_velocity
            assert not impact.liftoff_time < impact.landing_time
            if impact.rested:
                assert speed.overlaps(rest)
            else:
                signs = (1,) if rebound == "rest" else (1, -1)
                assert any(not abs(sign * speed - e * arrival) > amplitude for sign in signs)
                assert speed > rest
            assert e == 1 or not speed > bound
            arrival, now = speed, impact.liftoff_time
    assert np.all(np.diff(result.landing_time) >= 0)


@settings(max_examples=60, deadline=None)
@given(scene=SCENES, rebound=LAWS)
def test_balls_of_higher_precision_lie_inside(scene, rebound):
    few, more = (
        trajectory(duration=1e6, max_impacts=IMPACTS, rebound=rebound, digits=d, **scene)
        for d in (4, 50)
    )
    for a, b in zip(few.impacts, more.impacts, strict=True):
        assert a.rested == b.rested
        assert a.landing_time.contains(b.landing_time.mid())
        if a.liftoff_time is not None:
            assert a.liftoff_time.contains(b.liftoff_time.mid())
            assert a.rebound_velocity.overlaps(b.rebound_velocity)


@settings(max_examples=60, deadline=None)
@given(
    e=number(0.0, 1.0),
    amplitude=number(0.0, 3.0),
    speed=number(0.0, 8.0),
    radius=number(1e-12, 1e-3),
    corner=st.tuples(number(-1.0, 1.0), number(-1.0, 1.0)),
    reflect=st.booleans(),
)
def test_enclosure_keeps_every_point(e, amplitude, speed, radius, corner, reflect):
    """A point of the first set, mapped alone, stays in the balls of the mapped set."""
    with ctx.workprec(400):
        m = BallMap(
            restitution=Constant(arb(e)),
            amplitude=arb(amplitude),
            half_turns_at_launch=arb(0.3),
            half_turn_rate=arb(4),
            gravity=arb(9.81),
        )
        point = (arb(radius) * arb(corner[0]), arb(speed) + arb(radius) * arb(corner[1]))
        state = Enclosure(arb(0, radius), arb(speed, radius))
        for _ in range(12):
            flown, half_turns, w = m.carry(state)
            point = m.impact(*point)
            assert flown.contains(point[0])
            assert half_turns.contains(m.half_turns(point[0]))
            assert w.contains(point[1])
            if reflect and w < 0:
                state.mirror()
                point = (point[0], -point[1])


@settings(max_examples=60, deadline=None)
@given(
    speed=number(-8.0, 8.0),
    radius=number(1e-12, 1e-3),
    corner=st.tuples(number(-1.0, 1.0), number(-1.0, 1.0)),
    slopes=st.tuples(number(-3.0, 3.0), number(-3.0, 3.0)),
    bits=st.sampled_from([20, 53, 400]),
)
def test_a_mirrored_set_holds_the_mirrored_points(speed, radius, corner, slopes, bits):
    """At any precision, also below that of the centre, and after the set has been turned."""
    with ctx.workprec(400):
        by_flown, by_speed = (arb(slope) for slope in slopes)
        state = Enclosure(arb(0, radius), arb(speed, radius))
        state.turn(state.flown, state.speed / 3, ((arb(1), arb(1)), (by_flown, by_speed)))
        off = [arb(radius) * arb(part) for part in corner]
        flown, v = off[0] + off[1], arb(speed) / 3 + by_flown * off[0] + by_speed * off[1]
        with ctx.workprec(bits):
            state.mirror()
        assert (state.flown + state.change(arb(1), arb(0))).contains(flown.mid())
        assert (state.speed + state.change(arb(0), arb(1))).contains(-v.mid())


def decimal_pi():
    """Machin's formula."""

    def arctan_inverse(n):
        total, power, k = Decimal(0), Decimal(1) / n, 0
        while abs(power) > Decimal(10) ** -110:
            total += power / (2 * k + 1)
            power, k = -power / (n * n), k + 1
        return total

    return 16 * arctan_inverse(5) - 4 * arctan_inverse(239)


def decimal_sine(angle, pi):
    """Taylor's series of the reduced angle."""
    angle -= 2 * pi * (angle / (2 * pi)).to_integral_value()
    total, term, k = Decimal(0), angle, 1
    while abs(term) > Decimal(10) ** -110:
        total, term, k = total + term, -term * angle * angle / ((k + 1) * (k + 2)), k + 2
    return total


def decimal_arcsine(value, pi):
    """Newton's method from the double's value."""
    angle = Decimal(math.asin(value))
    for _ in range(7):
        cosine = decimal_sine(angle + pi / 2, pi)
        angle -= (decimal_sine(angle, pi) - value) / cosine
    return angle


def plain_trajectory(scene, rebound, impacts):
    """The map as published, in physical units and absolute time, to 100 digits."""
    s = {name: Decimal(value) for name, value in scene.items()}
    pi, g, amplitude = decimal_pi(), s["gravity"], s["amplitude"]
    omega, rest = 2 * pi * s["frequency"], g * s["contact_time"] / 2
    t, v, rows = s["launch_time"], s["launch_velocity"], []
    for _ in range(impacts):
        landing = t = t + 2 * v / g
        w = s["restitution"] * v + amplitude * decimal_sine(omega * t + s["phase"], pi)
        v = abs(w) if rebound == "reflect" else w
        rested = v <= rest
        if rested and amplitude <= rest:
            return [*rows, (landing, None, None, True)]
        if rested:
            v, angle = rest, decimal_arcsine(rest / amplitude, pi) - s["phase"]
            turns = ((omega * t - angle) / (2 * pi)).to_integral_value(rounding=ROUND_CEILING)
            t = (angle + 2 * pi * turns) / omega
        rows.append((landing, t, v, rested))
    return rows


def decimal_of(ball):
    mantissa, exponent = ball.mid().man_exp()
    return Decimal(int(mantissa)) * Decimal(2) ** int(exponent)


@settings(max_examples=100, deadline=None)
@given(scene=SCENES, rebound=LAWS)
def test_against_a_hundred_digits(scene, rebound):
    assume(scene["amplitude"] == 0.0 or scene["amplitude"] > 1e-3)
    result = trajectory(duration=1e6, max_impacts=12, rebound=rebound, **scene)
    with localcontext(prec=100):
        expected = plain_trajectory(scene, rebound, 12)
        assert len(expected) == len(result.impacts)
        for impact, (landing, liftoff, speed, rested) in zip(result.impacts, expected, strict=True):
            assert impact.rested == rested
            assert abs(decimal_of(impact.landing_time) - landing) < Decimal("1e-18")
            if speed is not None:
                assert abs(decimal_of(impact.liftoff_time) - liftoff) < Decimal("1e-18")
                assert abs(decimal_of(impact.rebound_velocity) - speed) < Decimal("1e-18")
