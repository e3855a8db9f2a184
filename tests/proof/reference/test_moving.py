"""The proved moving base: published landings, closed forms, first roots, rests, its Jacobian."""

import math

import numpy as np
import pytest
from flint import arb, ctx
from hypothesis import given, settings
from hypothesis import strategies as st

from proved_pieces import first_landing
from tests.cases import each_of
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.proof.reference.arithmetic import UndecidableError
from vibrosweep.proof.reference.laws import Constant
from vibrosweep.proof.reference.moving import MovingMap
from vibrosweep.proof.reference.trajectories import trajectory

TABLE_1 = {name: one.default for name, one in PARAMETERS.items()} | {
    "launch_time": 0.125,
    "duration": 12.0,
}


def number(low, high):
    return st.floats(low, high, allow_subnormal=False)


def run(**changes):
    return trajectory(base="moving", **(TABLE_1 | changes))


def in_periods(gamma, e, x, y, **changes):
    """Trajectory in forcing periods, launched at phase x with a speed relative to the base."""
    alpha = gamma / math.pi
    u = y + alpha * math.sin(2.0 * math.pi * x)
    scene = {"gravity": 2.0, "amplitude": alpha * (1.0 + e), "restitution": e, "launch_time": x}
    return run(**(scene | {"launch_velocity": u, "duration": 40.0} | changes))


@pytest.mark.parametrize(
    ("n", "landing", "rebound"),
    [
        (1, 1.1426997789962376, 5.422728901359235),
        (2, 2.2379823108328307, 5.986374088708485),
        (8, 8.404779815953377, 5.517958309647759),
    ],
)
def test_published_impacts(n, landing, rebound):
    result = run()
    assert result.landing_time[n - 1] == pytest.approx(landing, rel=0, abs=6e-16)
    assert result.rebound_velocity[n - 1] == pytest.approx(rebound, rel=0, abs=6e-16)


@each_of("e", [0.1, 0.5, 0.9])
@each_of("k", [1, 2, 3])
def test_locked_orbit(e, k):
    least = math.pi * k * (1.0 - e) / (1.0 + e)
    widest = 2.0 * (1.0 + e * e) / (1.0 + e) ** 2
    gamma = math.hypot(least, 0.5 * widest)
    x = 0.5 - math.asin(least / gamma) / (2.0 * math.pi)
    few, many = (in_periods(gamma, e, x, 2.0 * e * k / (1.0 + e), duration=d) for d in (9.0, 400.0))
    assert few.precision_bits == many.precision_bits
    last = many.impacts[-1]
    with ctx.workprec(300):
        a = arb(gamma / math.pi * (1.0 + e))  # the amplitude as it was given, in periods
        locked = 0.5 - ((1 - arb(e)) * k / a).asin() / (2 * arb.pi())
        assert abs(last.phase - locked) < 1e-19
        assert abs(last.flight.duration - k) < 1e-19
        u = (1 - arb(e)) / (1 + arb(e)) * k + 2 * arb(e) / (1 + arb(e)) * k
        cosine = (2 * locked).cos_pi()
        apex = (u * u - 2 * a / (1 + arb(e)) / arb.pi() * cosine) / 4
        assert abs(last.flight.height - apex) < 1e-18
    assert len(many.impacts) > 390 // k


def clearance(alpha, x, y, s):
    """Height above the base as the difference of two heights, in doubles."""
    base = -alpha / (4.0 * math.pi) * np.cos(2.0 * math.pi * (x + s))
    u = y + alpha * math.sin(2.0 * math.pi * x)
    return s * (u - s) / 2.0 - alpha / (4.0 * math.pi) * math.cos(2.0 * math.pi * x) - base


@settings(max_examples=300, deadline=None)
@given(
    e=number(0.0, 1.0),
    gamma=st.one_of(number(1e-3, 1.0), number(1.0, 6.0), number(6.0, 50.0)),
    x=number(-0.5, 0.5),
    y=st.one_of(number(1e-6, 1e-2), number(0.01, 1.0), number(1.0, 20.0)),
)
def test_landing_is_the_first(e, gamma, x, y):
    a = gamma / math.pi * (1.0 + e)
    s, z = first_landing(e, a, x, y)
    alpha, end = a / (1.0 + e), float(s)
    assert end > 0.0
    assert z > 0.0
    tried = np.linspace(0.0, end, 20_001)[1:-1]
    assert np.all(clearance(alpha, x, y, tried) > -1e-13 * (1.0 + end) ** 2)
    speed = clearance(alpha, x, y, end + 1e-6) - clearance(alpha, x, y, end - 1e-6)
    assert abs(clearance(alpha, x, y, end)) < 1e-13 * (1.0 + end) ** 2
    assert speed / 2e-6 == pytest.approx(-float(z) / 2.0, rel=1e-3, abs=1e-5 * (1.0 + gamma))


def test_graze_is_decided_between_neighbouring_doubles():
    def flight(y):
        return first_landing(0.5, 3.0, 0.0, y)

    # whether the particle clears the base's next crest depends on its speed
    below, above = 1.8, 1.9
    assert flight(below)[0] < 0.5
    assert flight(above)[0] > 1.0
    while math.nextafter(below, above) < above:
        middle = 0.5 * (below + above)
        if flight(middle)[0] < 0.5:
            below = middle
        else:
            above = middle
    assert flight(below)[0] < 0.5
    assert flight(above)[0] > 1.0
    assert 0.0 < float(flight(below)[1]) < 1e-6
    with pytest.raises(UndecidableError, match="grazes"):
        first_landing(0.5, 3.0, 0.0, below, bits=48, max_bits=48)


@settings(max_examples=60, deadline=None)
@given(e=number(0.0, 1.0), gamma=number(0.01, 10.0), x=number(-0.5, 0.5), y=number(0.01, 5.0))
def test_jacobian_is_the_limit_of_differences(e, gamma, x, y):
    with ctx.workprec(400):
        alpha = arb(gamma) / arb.pi()
        m = MovingMap(Constant(arb(e)), alpha, arb(0))

        def image(x, y):
            found = m.impact(x, y, m.flight(x, y, 1), 1)
            return (x + found.duration, found.speed), found

        step = arb(2) ** -150
        _, found = image(arb(x), arb(y))
        plus_x, plus_y = image(x + step, arb(y))[0], image(arb(x), y + step)[0]
        minus_x, minus_y = image(x - step, arb(y))[0], image(arb(x), y - step)[0]
        for row, *ends in zip(found.rows, plus_x, minus_x, plus_y, minus_y, strict=True):
            by_x, by_y = (ends[0] - ends[1]) / (2 * step), (ends[2] - ends[3]) / (2 * step)
            assert abs(row[0] - by_x) < arb(2) ** -100 / found.speed**5 or e == 0.0
            assert abs(row[1] - by_y) < arb(2) ** -100 / found.speed**5 or e == 0.0
        (a, b), (c, d) = found.rows
        assert found.determinant.overlaps(a * d - b * c)


@each_of("gamma", [1.001, 1.2, 2.0, 3.0, math.sqrt(1.0 + math.pi**2), 5.0])
def test_first_flight_after_a_lift_off(gamma):
    # e = 0 and a slow launch: the particle rests at once
    result = in_periods(gamma, 0.0, 0.0, 1e-3)
    first = result.impacts[0]
    assert first.rested
    with ctx.workprec(300):
        exact = arb.pi() * 2 * arb(gamma / math.pi) / 2
        lift = (first.liftoff_time * 2).cos_pi()
        assert abs(lift + 1 / exact) < 1e-18
        q = 2 * arb.pi() * first.flight.duration
        law = 1 + ((q * q / 2 + q.cos() - 1) / (q - q.sin())) ** 2
        assert abs(law - exact**2) < 1e-17
        assert first.flight.speed == 0


@pytest.mark.parametrize("gamma", [1.0 + 2.0**-51, 1.0 + 1e-14, 1.0 + 1e-9])
def test_a_base_that_throws_for_a_moment(gamma):
    # for short flights the law of the test above becomes Gamma^2 = 1 + (q / 4)^2
    first = in_periods(gamma, 0.0, 0.0, 1e-3).impacts[0]
    with ctx.workprec(300):
        exact = arb.pi() * arb(gamma / math.pi)
        q = 2 * arb.pi() * first.flight.duration
        assert abs(q / (4 * (exact**2 - 1).sqrt()) - 1) < q * q


def test_at_rest_for_good_where_the_base_never_falls_faster_than_gravity():
    result = in_periods(math.nextafter(1.0, 0.0), 0.5, 0.3, 2.0, duration=1e6)
    assert result.at_rest
    assert result.impacts[-1].flight is None
    assert not any(i.rested for i in result.impacts[:-1])
    above = in_periods(1.0 + 1e-9, 0.5, 0.3, 2.0)
    assert above.rested.any()
    assert not above.at_rest


def test_a_base_without_amplitude_is_the_high_bounce_base():
    still = {"amplitude": 0.0, "restitution": 0.7, "duration": 100.0}
    moving, other = run(**still), trajectory(**(TABLE_1 | still))
    assert moving.at_rest
    assert np.array_equal(moving.landing_time, other.landing_time)


def test_launch_slower_than_the_base_lands_at_once():
    result = run(launch_velocity=0.1, launch_time=0.2, duration=0.2)
    assert len(result.impacts) == 1
    assert result.landing_time[0] == 0.2
    with ctx.workprec(200):
        base = arb(1.2) / (1 + arb(0.9)) * (2 * arb(0.2)).sin_pi()
        left = base + arb(0.9) * (base - arb(0.1))
        assert result.impacts[0].rebound_velocity.overlaps(left)


SCENES = st.fixed_dictionaries(
    {
        "restitution": st.one_of(st.just(0.0), st.just(1.0), number(0.3, 1.0)),
        "amplitude": number(1e-3, 12.0),
        "frequency": number(0.3, 3.0),
        "phase": number(-10.0, 10.0),
        "gravity": number(3.0, 20.0),
        "launch_velocity": number(0.0, 8.0),
        "contact_time": number(1e-4, 0.2),
        "launch_time": number(-20.0, 20.0),
    }
)


@settings(max_examples=100, deadline=None)
@given(scene=SCENES)
def test_parabolas_begin_and_end_on_the_base(scene):
    result = run(duration=1e6, max_impacts=15, **scene)
    with ctx.workprec(2 * result.precision_bits):
        p = {name: arb(value) for name, value in scene.items()}
        omega, g, e = 2 * arb.pi() * p["frequency"], p["gravity"], p["restitution"]
        fastest = p["amplitude"] / (1 + e)

        def base(t):
            sine, cosine = (omega * t + p["phase"]).sin_cos()
            return -fastest / omega * cosine, fastest * sine

        now, velocity, flight = p["launch_time"], p["launch_velocity"], result.launch
        for impact in result.impacts:
            t = impact.landing_time
            flown = t - now
            height, landing = base(now)[0] + velocity * flown - g * flown**2 / 2, base(t)
            assert height.overlaps(landing[0])
            assert flown.overlaps(flight.duration / p["frequency"])
            # a particle that lands at once does not rise
            rising = arb(0) if flight.duration == 0 else velocity.max(arb(0))
            assert flight.height.overlaps(base(now)[0] + rising**2 / (2 * g))
            if impact.rebound_velocity is None:
                break
            relative = impact.rebound_velocity - landing[1]
            arrived = landing[1] - (velocity - g * flown)
            rest = g * p["contact_time"] / 2
            presses = g + omega * fastest * (omega * t + p["phase"]).cos()
            if impact.rested:
                assert not e * arrived > rest
                assert not presses < 0
                assert impact.rebound_velocity.overlaps(base(impact.liftoff_time)[1])
            else:
                assert relative.overlaps(e * arrived)
                assert not (e * arrived < rest and presses > 0)
            velocity, now, flight = impact.rebound_velocity, impact.liftoff_time, impact.flight
    assert np.all(np.diff(result.landing_time) >= 0)


@settings(max_examples=40, deadline=None)
@given(scene=SCENES)
def test_balls_of_higher_precision_lie_inside(scene):
    few, more = (run(duration=1e6, max_impacts=25, digits=d, **scene) for d in (4, 50))
    for a, b in zip(few.impacts, more.impacts, strict=True):
        assert a.rested == b.rested
        assert a.landing_time.contains(b.landing_time.mid())
        if a.flight is not None:
            assert a.rebound_velocity.overlaps(b.rebound_velocity)
            assert a.flight.duration.contains(b.flight.duration.mid())


def test_time_shifted_by_a_thousand_million_periods_changes_no_phase():
    near, far = run(), run(launch_time=1e9 + 0.125, duration=1e9 + 12.0)
    for a, b in zip(near.impacts, far.impacts, strict=True):
        assert b.count - a.count == 10**9
        assert a.phase.overlaps(b.phase)
        assert a.rebound_velocity.overlaps(b.rebound_velocity)
