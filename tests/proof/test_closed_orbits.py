"""Proofs of periodic orbits: closed forms under every shape and law, and files of orbits."""

import math

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.api.result_kinds import ORBITS
from vibrosweep.errors import ParameterError
from vibrosweep.model.shapes import Waveform
from vibrosweep.proof.orbits import orbit_of
from vibrosweep.proof.reference.arithmetic import arb, ctx, variables
from vibrosweep.proof.reference.closed_orbits import RESTING, cycle, prove_event, prove_orbit
from vibrosweep.proof.reference.laws import Laws
from vibrosweep.store.writing import save_result

SINE, PARABOLIC = Waveform(), Waveform("parabolic")
TWO_TONES = Waveform("harmonics", ((1, 1.0, 0.0), (2, 0.4, 1.1)))
UNIT = {"restitution": 0.8, "frequency": 1.0, "gravity": 2.0, "contact_time": 1e-4}  # speeds are 1
BASES = ("high-bounce", "moving")


def orbit(base="high-bounce", waveform=SINE, law="constant", rebound="rest", speed=None, q=1):
    inputs = UNIT if speed is None else {**UNIT, "restitution_speed": speed}
    return orbit_of(base, Laws(rebound, law, waveform), inputs, 1, q)


def phase_where_it_falls(waveform, value):
    """Phase at which the velocity of the base falls through a value."""
    x = np.linspace(0.0, 1.0, 100_001)
    w = waveform.velocity(x)
    i = np.flatnonzero((w[:-1] > value) & (w[1:] <= value))[0]
    return x[i] + (w[i] - value) / (w[i] - w[i + 1]) * (x[i + 1] - x[i])


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("waveform", [SINE, TWO_TONES, PARABOLIC], ids=lambda w: w.name)
def test_one_impact_has_the_multipliers_of_the_closed_forms(base, waveform):
    """z^2 - (1 + e + a w') z + e, and z^2 - (1 + e^2 + (1 + e) a w' / 2) z + e^2."""
    e, a = 0.8, 0.3
    x = phase_where_it_falls(waveform, (1.0 - e) / a)
    proved = prove_orbit(orbit(base, waveform), [x], arb(a))
    slope = float(waveform.slope(x))
    trace, determinant = 1.0 + e + a * slope, e
    if base == "moving":
        trace, determinant = 1.0 + e * e + 0.5 * (1.0 + e) * a * slope, e * e
    assert float(proved.box[0]) == pytest.approx(x, abs=1e-8)
    assert float(proved.cycle.trace.v) == pytest.approx(trace, abs=1e-6)
    assert float(proved.cycle.determinant.v) == pytest.approx(determinant, rel=1e-15)
    assert float(proved.box[0].rad()) < 1e-25


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("law", ["plastic", "viscoelastic"])
def test_under_a_law_the_slope_takes_the_place_of_the_restitution(base, law):
    """The slope at the arrival speed c: c = 1 on the map, c + E(c) = 2 over the moving base."""
    speed = 0.5
    c, step = 1.0, 1e-6

    def left(v):
        return float(vs.theory.restitution_at(v, 0.8, law, speed)) * v

    if base == "moving":
        for _ in range(300):
            c = 2.0 - left(c)
    q = (left(c + step) - left(c - step)) / (2.0 * step)
    a = 0.6
    rises = (c - left(c)) / a if base == "high-bounce" else (c - 1.0) * 1.8 / a
    x = 0.5 - math.asin(rises) / (2.0 * math.pi)
    proved = prove_orbit(orbit(base, law=law, speed=speed), [x], arb(a))
    assert float(proved.cycle.flights[0].arrives.v) == pytest.approx(c, rel=1e-12)
    share = 1.0 if base == "high-bounce" else left(c) / c
    assert float(proved.cycle.determinant.v) == pytest.approx(q * share, rel=1e-8)


def test_the_derivative_of_a_slope_is_that_of_differences():
    with ctx.workprec(160):
        for law in ("plastic", "viscoelastic"):
            own, h = orbit(law=law, speed=0.5).law, arb(2) ** -50
            difference = (own.slope(1 + h) - own.slope(1 - h)) / (2 * h)
            assert float(own.bend(arb(1))) == pytest.approx(float(difference), rel=1e-9)
        assert not orbit(law="plastic", speed=0.5).law.bend(arb(0.5, 1e-3)).is_finite()


def test_a_mode_under_two_tones_ends_in_a_proved_fold():
    """At e = 0.85 the mode has folds at 0.1688, 0.2852 and 0.2855, where w'(x) = 0."""
    own = orbit(waveform=TWO_TONES)._replace(e=arb(0.85))
    x = np.linspace(0.0, 1.0, 10_001)
    w, slope = TWO_TONES.velocity(x), TWO_TONES.slope(x)
    kicks = sorted(0.15 / w[i] for i in np.flatnonzero(np.diff(np.sign(slope))) if w[i] > 0.0)
    assert kicks == pytest.approx([0.1688, 0.2852, 0.2855], abs=5e-5)
    for i in np.flatnonzero(np.diff(np.sign(slope))):
        if w[i] > 0.0:
            event = prove_event(own, 1, [x[i], 0.15 / w[i]])
            assert float(event.box[1]) == pytest.approx(0.15 / w[i], abs=1e-6)
            assert float(event.box[1].rad()) < 1e-28


def test_reflection_reverses_the_speed_and_the_determinant():
    """A particle that is pushed into the base leaves with the speed -(e u + a sin)."""
    e, a = 0.8, 1.9
    x = 1.0 - math.asin((1.0 + e) / a) / (2.0 * math.pi)
    proved = prove_orbit(orbit(rebound="reflect"), [x], arb(a))
    assert float(proved.cycle.determinant.v) == pytest.approx(-e)
    assert proved.cycle.obstacle == ""
    assert float(proved.cycle.trace.v) == pytest.approx(
        1.0 - e - 2.0 * math.pi * a * math.cos(2.0 * math.pi * x)
    )


def test_at_a_corner_of_the_parabolic_waveform_an_orbit_is_proved_and_no_bifurcation():
    """Its slope jumps there, and with it the multipliers."""
    own = orbit(waveform=PARABOLIC)
    assert prove_orbit(own, [0.25 + 1e-9], arb(0.2) * (1 + arb(2) ** -40)) is not None
    with ctx.workprec(160):
        (flight,) = cycle(own, variables([arb(0.25, 1e-3), arb(0.2)])).flights
        assert not flight.step[2].d[0].is_finite()
        assert flight.after.v.contains(1)


def test_an_orbit_that_rests_is_reported_as_resting():
    own = orbit()._replace(rest=arb(2))
    x = phase_where_it_falls(SINE, 0.2 / 0.3)
    assert prove_orbit(own, [x], arb(0.3)).cycle.obstacle == RESTING


@pytest.fixture(scope="module", params=BASES)
def found(request):
    return vs.orbits(restitution=[0.5, 0.9], amplitude=[1.2, 6.0], base=request.param, impacts=2)


def test_every_number_of_a_file_of_orbits_is_within_its_claim(found, tmp_path):
    path = save_result(found, tmp_path / "found.h5", ORBITS)
    report = vs.verify(path)
    assert report.passed
    lines = "\n".join(report.lines())
    assert "4 of 4 realizations" in lines
    judged = report.variables()
    assert len(judged["impact_phase"].errors) == int(found.cycle_impacts.sum())
    assert max(judged["rebound_velocity"].claims) < 1e-9
    assert "seeds: it describes the search for orbits" in lines
    assert vs.verify(path, sample=2).total == 4


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("impact_phase", 1e-10),
        ("flight_time", 1e-10),
        ("arrival_velocity", 1e-9),
        ("multiplier_real", 1e-6),
        ("stable", 1),
    ],
)
def test_a_wrong_number_is_reported_with_its_orbit(found, name, change, tmp_path):
    wrong = found.copy(deep=True)
    at = (1, 1, 0) + (0,) * (found[name].ndim - 3)
    wrong[name].values[at] = (
        1 - wrong[name].values[at] if name == "stable" else (wrong[name].values[at] + change)
    )
    report = vs.verify(save_result(wrong, tmp_path / "wrong.h5", ORBITS))
    assert not report.passed
    told = f"realization 3: {name} of orbit 0 is "
    assert any(complaint.startswith(told) for complaint in report.complaints())


def test_orbits_have_no_observables(found, tmp_path):
    longest = vs.Observable(
        "longest", lambda landing: landing.flight_time, "x", "s", landings="max"
    )
    path = save_result(found, tmp_path / "found.h5", ORBITS)
    with pytest.raises(ParameterError, match="vibrosweep orbits has none"):
        vs.verify(path, observables=[longest])
    with pytest.raises(ParameterError, match="sample = 0"):
        vs.verify(path, sample=0)
