"""Trajectories in ball arithmetic."""

import importlib
import math
import sys
from decimal import ROUND_CEILING, Decimal, localcontext

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from proved_pieces import sine, step
from tests.cases import each_of
from vibrosweep.errors import VibrosweepError
from vibrosweep.model.measures import Status
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.proof.reference.arithmetic import OrbitEnclosure, UndecidableError
from vibrosweep.proof.reference.high_bounce import BallMap
from vibrosweep.proof.reference.laws import Constant
from vibrosweep.proof.reference.trajectories import trajectory

# The proved reference: published trajectories, closed forms, ties, errors.

TABLE_1 = {name: one.default for name, one in PARAMETERS.items()} | {
    "launch_time": 0.0,
    "duration": 12.0,
}


def run(**changes):
    return trajectory(**(TABLE_1 | changes))


@each_of(
    ("launch_time", "n", "landing", "rebound"),
    [
        (0.125, 1, 1.144367991845056, 5.445257903944113),
        (0.125, 2, 2.254512314769442, 6.100249854183906),
        (0.125, 8, 8.374024148418671, 5.805960455572309),
        (0.0, 4, 3.245842008111699, 3.309928793279521),
        (0.0, 8, 5.468637186500151, 2.382765998128135),
    ],
)
def test_published_impacts(launch_time, n, landing, rebound):
    result = run(launch_time=launch_time)
    assert result.landing_time[n - 1] == pytest.approx(landing, rel=0, abs=6e-16)
    assert result.rebound_velocity[n - 1] == pytest.approx(rebound, rel=0, abs=6e-16)
    assert not result.rested[n - 1]
    assert result.liftoff_time[n - 1] == result.landing_time[n - 1]


def test_published_rest():
    result = run()
    assert np.flatnonzero(result.rested)[0] == 17
    assert result.landing_time[17] == pytest.approx(8.845289992383421, rel=0, abs=2e-15)
    assert result.liftoff_time[17] == pytest.approx(9.000065054584800, rel=0, abs=2e-15)
    assert result.rebound_velocity[17] == pytest.approx(9.81 * 1e-4 / 2, rel=1e-15)
    assert not result.at_rest
    assert result.status is Status.COMPLETED


@each_of("rebound", ["rest", "reflect"])
@each_of("digits", [5, 20, 60])
def test_every_ball_is_as_narrow_as_asked(rebound, digits):
    result = run(rebound=rebound, digits=digits, amplitude=3.4, contact_time=0.1, duration=30.0)
    tolerance = arb(10) ** -digits
    assert any(result.rested)
    for impact in result.impacts:
        assert impact.landing_time.rad() <= tolerance * impact.landing_time
        assert impact.liftoff_time.rad() <= tolerance * impact.liftoff_time
        assert impact.rebound_velocity.rad() <= tolerance * impact.rebound_velocity
        assert impact.phase.rad() <= tolerance
        assert abs(impact.phase.mid()) <= 0.5


@pytest.mark.parametrize("rebound", ["rest", "reflect"])
def test_more_digits_lie_inside_the_balls_of_fewer(rebound):
    few, more = (run(rebound=rebound, amplitude=3.4, digits=d, duration=60.0) for d in (10, 80))
    assert few.precision_bits < more.precision_bits
    assert len(few.impacts) == len(more.impacts) > 50
    for a, b in zip(few.impacts, more.impacts, strict=True):
        assert (a.rested, a.count) == (b.rested, b.count)
        assert a.landing_time.contains(b.landing_time)
        assert a.liftoff_time.contains(b.liftoff_time)
        assert a.phase.contains(b.phase)
        # a lift-off velocity is one exact number, rounded here to two precisions
        assert a.rebound_velocity.overlaps(b.rebound_velocity)


def test_doubles_are_those_nearest_to_the_balls():
    fine = run(digits=60)
    for impact, time, speed in zip(
        fine.impacts, fine.landing_time, fine.rebound_velocity, strict=True
    ):
        assert 2 * abs(impact.landing_time - time) <= np.spacing(time)
        assert 2 * abs(impact.rebound_velocity - speed) <= np.spacing(speed)


def test_unforced_flights_shrink_by_the_restitution():
    result = run(amplitude=0.0, restitution=0.7, launch_velocity=5.0, duration=100.0)
    e, rest = arb(0.7), arb(9.81) * arb(1e-4) / 2
    with ctx.workprec(300):
        for n, impact in enumerate(result.impacts[:-1], start=1):
            assert impact.rebound_velocity.overlaps(e**n * 5)
            assert impact.landing_time.overlaps(arb(10) / arb(9.81) * (1 - e**n) / (1 - e))
        last = len(result.impacts)
        assert e**last * 5 <= rest < e ** (last - 1) * 5
    assert result.at_rest
    assert result.impacts[-1].rebound_velocity is None
    assert math.isnan(result.liftoff_time[-1])


def test_locked_orbit_attracts_and_needs_no_more_precision_in_time():
    result = run(launch_time=0.42, launch_velocity=4.9, duration=3000.0)
    assert len(result.impacts) > 2990
    assert result.precision_bits == run(launch_time=0.42, launch_velocity=4.9).precision_bits
    with ctx.workprec(300):
        # launched exactly on the locked orbit this would hold at once; |multipliers| = 0.9487
        needed = (1 - arb(0.9)) * arb(9.81) / 2 / arb(1.2)
        locked = 0.5 - needed.asin() / (2 * arb.pi())
        distance = [abs(impact.phase - locked) for impact in result.impacts]
        assert distance[0] > 1e-3
        assert distance[999] < 1e-19
        assert distance[-1] < 1e-20
        assert abs(result.impacts[-1].flight.duration - 1) < 1e-20


def test_chaos_costs_precision_in_proportion():
    # reflected at every push into the base: no rest erases the error
    chaos = {"amplitude": 4.0, "rebound": "reflect", "duration": 1e6}
    bits = [run(max_impacts=n, **chaos).precision_bits for n in (100, 1600)]
    assert bits[0] < bits[1] <= 4096


def test_two_thousand_irregular_impacts():
    chaos = {"restitution": 0.7, "amplitude": 1.6, "rebound": "reflect"}
    result = run(duration=1e5, max_impacts=2_000, **chaos)
    assert result.status is Status.BUDGET_EXCEEDED
    assert len(result.impacts) == 2_000
    assert np.all(np.diff(result.landing_time) > 0)
    assert len(np.unique(np.round(result.rebound_velocity, 6))) > 1_000


def test_time_shifted_by_a_thousand_million_periods_changes_no_phase():
    near, far = run(), run(launch_time=1e9, duration=1e9 + 12.0)
    assert len(near.impacts) == len(far.impacts)
    for a, b in zip(near.impacts, far.impacts, strict=True):
        assert b.count - a.count == 10**9
        assert a.phase.overlaps(b.phase)
        assert b.phase.rad() <= 1e-20
        assert a.rebound_velocity.overlaps(b.rebound_velocity)


@pytest.mark.parametrize("duration", [1.0, 1.5, 1.75])
def test_landing_exactly_at_the_end_counts(duration):
    # every landing is on a zero of the sine: flights of 1, 1/2, 1/4 s, each exact
    changes = {"restitution": 0.5, "launch_velocity": 9.81 / 2, "duration": duration}
    unforced = run(amplitude=0.0, **changes)
    assert unforced.landing_time[-1] == duration
    assert unforced.impacts[-1].landing_time.is_exact()
    forced = run(**changes)
    assert forced.landing_time[-1] == duration
    before = run(**(changes | {"duration": math.nextafter(duration, 0.0)}))
    assert len(before.impacts) == len(forced.impacts) - 1


def test_rest_on_equality_and_liftoff_only_above_it():
    # e v = v_rest exactly rests; A = v_rest exactly never lifts
    changes = {"restitution": 0.5, "gravity": 2.0, "launch_velocity": 1.0, "launch_time": 0.0}
    equal = run(amplitude=0.0, contact_time=0.5, **changes)
    assert equal.at_rest
    assert len(equal.impacts) == 1
    changes |= {"restitution": 0.0, "contact_time": 0.5}
    assert run(amplitude=0.5, **changes).at_rest
    lifted = run(amplitude=math.nextafter(0.5, 1.0), **changes)
    assert not lifted.at_rest
    assert lifted.liftoff_time[0] == pytest.approx(1.25, abs=1e-7)


def test_rest_ends_at_the_first_rise_of_the_kick():
    # at rest at phase 0 < lift-off phase: the same period; without kick at 3/4: the next one
    same = run(launch_velocity=0.0, launch_time=0.0)
    late = run(launch_velocity=0.0, launch_time=0.75)
    assert same.liftoff_time[0] == pytest.approx(math.asin(9.81e-4 / 2.4) / (2 * math.pi))
    assert late.liftoff_time[0] - same.liftoff_time[0] == pytest.approx(1.0, abs=1e-15)


def test_laws_differ_where_the_kick_pushes_into_the_base():
    # landing at phase 3/4 with little speed: w is near -A
    changes = {"launch_time": 0.75 - 2 * 0.01 / 9.81, "launch_velocity": 0.01, "duration": 0.8}
    resting, reflected = run(**changes), run(rebound="reflect", **changes)
    assert resting.rested[0]
    assert resting.liftoff_time[0] > 1.0
    assert not reflected.rested[0]
    assert reflected.rebound_velocity[0] == pytest.approx(1.2 - 0.009, abs=1e-4)


def test_a_tie_through_a_sine_is_reported():
    # gravity 3, v0 = 1/8: phase 1/12, kick 1.5 sin(pi / 6) = 0.75 = v_rest, through an inexact 1/3
    with pytest.raises(UndecidableError, match="w > v_rest") as caught:
        trajectory(
            restitution=0.0,
            amplitude=1.5,
            frequency=1.0,
            phase=0.0,
            gravity=3.0,
            launch_velocity=0.125,
            contact_time=0.5,
            launch_time=0.0,
            duration=12.0,
            max_bits=2048,
        )
    assert (caught.value.impact, caught.value.bits) == (1, 1536)
    assert isinstance(caught.value, VibrosweepError)


def test_too_little_precision_is_reported():
    with pytest.raises(UndecidableError, match="raise max_bits"):
        run(amplitude=4.0, rebound="reflect", duration=1e6, max_bits=512)


def test_no_impact():
    result = run(duration=1.0)
    assert result.impacts == ()
    assert result.landing_time.shape == result.rested.shape == (0,)
    assert not result.at_rest


def test_missing_flint_is_one_clear_error(monkeypatch):
    monkeypatch.setitem(sys.modules, "flint", None)
    for name in ("arithmetic", "laws", "motion", "high_bounce", "moving", "trajectories"):
        monkeypatch.delitem(sys.modules, f"vibrosweep.proof.reference.{name}", raising=False)
    with pytest.raises(VibrosweepError, match=r'pip install "vibrosweep\[verify\]"'):
        importlib.import_module("vibrosweep.proof.reference.trajectories")


def test_step_separates_whole_periods():
    phase, count, w = step(0.9, 0.25, 0.375, 1e9 + 0.25)
    assert count == 10**9 + 1
    assert phase == -0.375
    with ctx.workprec(300):
        expected = arb(0.9) * (10**9 + arb(0.25)) - arb(0.25) * arb(0.5).sqrt()
    assert w.overlaps(expected)
    assert w.rel_accuracy_bits() > 250


def test_sine_of_special_phases():
    assert sine(0.25) == 1
    assert sine(-0.25) == -1
    assert sine(0.5) == sine(0.0) == 0
    assert abs(sine(0.125) ** 2 - 0.5) < 1e-15
    assert float(sine(1e-300)) == pytest.approx(2e-300 * math.pi, rel=1e-15)


# The proved reference against independent slow computations, on parameters found by hypothesis.


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
        state = OrbitEnclosure(arb(0, radius), arb(speed, radius))
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
        state = OrbitEnclosure(arb(0, radius), arb(speed, radius))
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
