"""Proved orbits, windows, exponents and claims."""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from flint import arb as arb_claims
from flint import arb as arb_exponents

import vibrosweep as vs
from tests.cases import each_of
from vibrosweep.analysis.conditions import Condition
from vibrosweep.analysis.continuation import FIX_E
from vibrosweep.analysis.orbits import Plane, branches_along
from vibrosweep.analysis.windows import NO_WINDOW, OPEN_END, PROVED
from vibrosweep.api.result_kinds import ORBITS, WINDOWS
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.bifurcations import DOUBLING, SADDLE_NODE
from vibrosweep.model.measures import VARIABLES
from vibrosweep.model.observables import Measures
from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.model.shapes import Waveform
from vibrosweep.proof.claims import MAX_CYCLE, ErrorBounds, largest_exponent, mean_growth
from vibrosweep.proof.measures import ProvedMeasures
from vibrosweep.proof.orbits import NO_ORBIT, UNBOUNDED, orbit_of
from vibrosweep.proof.reference.arithmetic import Jet, arb, ctx, exact, variables
from vibrosweep.proof.reference.closed_orbits import (
    EARLIER,
    NOT_ATTRACTING,
    RESTING,
    ClosedOrbit,
    cover,
    cycle,
    prove_event,
    prove_orbit,
)
from vibrosweep.proof.reference.high_bounce import BounceMap
from vibrosweep.proof.reference.laws import Laws
from vibrosweep.proof.reference.motion import EPS, ProvedFlight
from vibrosweep.proof.reference.trajectories import trajectory
from vibrosweep.proof.report import judge
from vibrosweep.proof.sampling import ExactRealization
from vibrosweep.proof.verifying import JUDGES
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import keyword_spec
from vibrosweep.store.writing import save_result

# Proofs of windows: closed forms lie in the enclosures, and each missing proof has a reason.

BASES = ("high-bounce", "moving")
DIGITS = "1.016310712304622804660571"  # of Gamma at e = 9/10 exactly, k = 1


def waves(turns):
    """Sine and cosine of a phase in turns."""
    sine, cosine = (2 * turns.v).sin_cos_pi()
    turn = 2 * arb.pi()
    return (
        Jet(sine, [turn * cosine * a for a in turns.d]),
        Jet(cosine, [-turn * sine * a for a in turns.d]),
    )


def orbit(base, e, p=1, q=1, rest=1e-4):
    return ClosedOrbit(base, e, p, q, arb(rest))


def lines_of(base, e, p, q):
    scene = keyword_spec({"restitution": e, "amplitude": [0.1, 8.0], "base": base}).scene
    values = np.array([0.1, 2.0, 4.0, 8.0])
    with Workers(1) as workers:
        lines = branches_along(
            Plane(scene, "amplitude", np.array([e]), values, 2000), FIX_E, (p, q), 0, workers
        )
    return [line for line in lines if (line.p, line.q) == (p, q)]


def test_the_end_of_the_first_mode_at_nine_tenths_has_the_digits_known():
    with ctx.workprec(160):
        e = exact(Fraction(9, 10))
        alpha = 1.016310712304623 / math.pi
        need = 0.1 / (1.9 * alpha)
        guess = [0.5 - math.asin(need) / (2.0 * math.pi), 1.9 * alpha]
        event = prove_event(orbit("moving", e), -1, guess)
        gamma = arb.pi() * event.box[-1] / (1 + e)
        assert gamma.str(25, radius=False).startswith(DIGITS[:-1])
        assert float(gamma.rad()) < 1e-29


@each_of("base", BASES)
@each_of("e", [0.3, 0.9, 0.99])
@each_of("k", [1, 3])
def test_closed_forms_lie_in_the_enclosures(base, e, k):
    with ctx.workprec(160):
        exactly = arb(e)
        born = (1 - exactly) * k
        last = 2 * (1 + exactly**2) / (1 + exactly) if base == "moving" else 1 + exactly
        kicks = {1: born, -1: (born**2 + (last / arb.pi()) ** 2).sqrt()}
        for multiplier, kick in kicks.items():
            ratio = min(1.0, (1 - e) * k / float(kick))
            guess = [0.5 - math.asin(ratio) / (2.0 * math.pi), float(kick)]
            event = prove_event(orbit(base, exactly, 1, k), multiplier, guess)
            assert event.box[-1].overlaps(kick)
            assert float(event.box[-1].rad()) < 1e-28


@pytest.mark.parametrize("base", BASES)
def test_bifurcations_of_two_impacts_are_proved_where_they_are_found(base):
    for line in lines_of(base, 0.5, 2, 1):
        for event in line.events:
            if event.kind in (SADDLE_NODE, DOUBLING):
                multiplier = 1 if event.kind == SADDLE_NODE else -1
                proved = prove_event(
                    orbit(base, arb(0.5), 2, 1), multiplier, [*event.z[:2], event.z[-1]]
                )
                assert abs(float(proved.box[-1]) - event.z[-1]) < 1e-14


def test_an_orbit_is_proved_with_its_multipliers():
    proved = prove_orbit(orbit("high-bounce", arb(0.9)), [0.43], arb(0.244648))
    box, found, _ = proved
    assert float(box[0]) == pytest.approx(0.4329824, abs=1e-5)
    with ctx.workprec(160):
        assert found.determinant.v.overlaps(arb(0.9))
        turn = 2 * arb.pi() * box[1] * (2 * box[0]).cos_pi()
        assert found.trace.v.overlaps(1 + arb(0.9) + turn)
    assert found.obstacle == ""


def test_a_branch_is_covered_only_where_it_attracts_and_does_not_rest():
    """An orbit must attract, which it does not beyond its period doubling, and must not rest."""
    (line,) = (one for one in lines_of("high-bounce", 0.9, 1, 1) if one.events)
    rows = [i for i, z in enumerate(line.z) if any(np.array_equal(z, e.z) for e in line.events)]
    points = line.z[:, [0, -1]].tolist()
    low, high = sorted(rows)[:2]
    own = orbit("high-bounce", arb(0.9))
    assert cover(own, points[low : high + 1], []) == NOT_ATTRACTING
    inside = points[low + 2 : high - 1]
    assert cover(own, inside, []) == ""
    assert cover(own._replace(rest=arb(2)), inside, []) == RESTING


def test_where_an_earlier_landing_is_not_excluded_nothing_is_proved():
    """A short flight over a base that falls faster than gravity may come down on the way."""
    (line,) = (one for one in lines_of("moving", 0.5, 2, 1) if one.events)
    (low, high) = (
        next(i for i, z in enumerate(line.z) if np.array_equal(z, e.z))
        for e in line.events
        if e.kind in (SADDLE_NODE, DOUBLING)
    )
    low, high = sorted((low, high))
    points = line.z[low + 1 : high, [0, 1, -1]].tolist()
    assert cover(orbit("moving", arb(0.5), 2, 1), points, []) == EARLIER


@pytest.mark.parametrize("base", BASES)
def test_windows_are_proved_from_end_to_end(base):
    found = vs.windows(
        restitution=[0.5, 0.9],
        amplitude=np.linspace(0.1, 6.0, 10),
        conditions=["locked(1)", "locked(2)"],
        base=base,
        prove=True,
    )
    window = found.window_count.values > 0
    assert window.all()
    one = found.isel(direction=0, window=0)
    for name in ("min", "max"):
        codes = one[f"{name}_proof"].values
        assert set(codes.ravel()) <= {PROVED, OPEN_END}
        ends = one[f"A_{name}"].values
        half = 0.5 * one[f"A_{name}_bracket"].values
        inside = (one[f"A_{name}_low"] <= ends + half) & (one[f"A_{name}_high"] >= ends - half)
        assert inside.values[codes == PROVED].all()
        wide = one[f"A_{name}_high"] - one[f"A_{name}_low"]
        assert (wide.values[codes == PROVED] < 1e-14).all()
    assert (one.inside_proof == PROVED).all()
    (first, *_) = [line for line in WINDOWS.lines(found) if "proved" in line]
    assert "attraction inside 2 of 2" in first


@pytest.mark.weekly
def test_overlapping_windows_under_two_tones_are_proved_with_their_folds():
    """At e = 0.85, k = 1: 0.1688 to 0.2855, where it ends in a fold, and 0.2852 to 0.6657."""
    unit = 4.905
    found = vs.windows(
        restitution=0.85,
        amplitude=np.linspace(0.02, 1.2, 12) * unit,
        waveform={"harmonics": [[1, 1.0, 0.0], [2, 0.4, 1.1]]},
        duration=3000.0,
        prove=True,
    ).isel(condition=0, direction=0, restitution=0)
    assert set(found.min_proof.values) == set(found.max_proof.values) == {PROVED}
    assert found.inside_proof.values.tolist() == [PROVED, PROVED]
    assert found.A_min_low.values / unit == pytest.approx([0.1688, 0.2852], abs=5e-5)
    assert found.A_max_high.values / unit == pytest.approx([0.2855, 0.6657], abs=5e-5)


def test_windows_are_proved_under_a_law_of_restitution():
    """On the map v - E(v) < A < hypot(v - E(v), v (1 + E'(v)) / pi) in mode 1, with v = g / 2f."""
    found = vs.windows(
        restitution=0.9,
        amplitude=np.linspace(0.1, 6.0, 6),
        restitution_law="plastic",
        restitution_speed=4.0,
        duration=2000.0,
        prove=True,
    )
    one = found.isel(condition=0, direction=0, restitution=0, window=0)
    v = 4.905
    left = 0.9 * v * (4.0 / v) ** 0.25
    for name, end in (
        ("min", v - left),
        ("max", math.hypot(v - left, (v + 0.75 * left) / math.pi)),
    ):
        assert int(one[f"{name}_proof"]) == PROVED
        assert float(one[f"A_{name}_low"]) == pytest.approx(end, rel=1e-14)
        assert 0.0 < float(one[f"A_{name}_high"] - one[f"A_{name}_low"]) < 1e-14
    assert int(one.inside_proof) == PROVED


@pytest.mark.parametrize(
    ("name", "symbol", "scale"),
    [
        ("base_acceleration", "Gamma", 1.0),
        ("base_velocity", "V0", 9.81 / (2.0 * math.pi)),
        ("base_displacement", "B", 9.81 / (2.0 * math.pi) ** 2),
    ],
)
def test_other_forcings_are_enclosed_in_their_own_unit(name, symbol, scale):
    values = [0.1 * scale, 0.5 * scale, 2.0 * scale]
    found = vs.windows(restitution=0.9, base="moving", prove=True, **{name: values})
    one = found.isel(condition=0, direction=0, restitution=0, window=0)
    low, high = float(one[f"{symbol}_max_low"]), float(one[f"{symbol}_max_high"])
    assert low == pytest.approx(scale * 1.0163107123046228, rel=1e-15)
    assert 0.0 < high - low < 1e-14
    assert int(one.inside_proof) == PROVED


def test_ends_that_belong_to_no_orbit_say_so():
    low = Condition("low", lambda ds: ds["rebound_height_max"] < 2.0, ("rebound_height_max",))
    found = vs.windows(
        restitution=0.9, amplitude=[0.5, 1.0, 2.0, 3.0], conditions=[low], prove=True
    )
    codes = found.min_proof.values[found.window_ends.values != NO_WINDOW]
    assert (codes == NO_ORBIT).all()
    assert (found.inside_proof.values[found.window_ends.values != NO_WINDOW] == UNBOUNDED).all()


def test_derivatives_of_waves_are_exact():
    with ctx.workprec(100):
        (x,) = variables([arb(0.125)])
        sine, cosine = waves(x * x)
        angle = 2 * arb.pi() / 64
        assert sine.v.overlaps(angle.sin())
        assert sine.d[0].overlaps(angle.cos() * arb.pi() / 2)
        assert cosine.d[0].overlaps(-angle.sin() * arb.pi() / 2)
        ratio = 1 / (x + 1) - x / (2 - x)
        assert ratio.d[0].overlaps(-1 / arb(1.125) ** 2 - 2 / arb(1.875) ** 2)


# Proofs of periodic orbits: closed forms under every shape and law, and files of orbits.

SINE, PARABOLIC = Waveform(), Waveform("parabolic")
TWO_TONES = Waveform("harmonics", ((1, 1.0, 0.0), (2, 0.4, 1.1)))
UNIT = {"restitution": 0.8, "frequency": 1.0, "gravity": 2.0, "contact_time": 1e-4}  # speeds are 1


def orbit_closed_orbits(
    base="high-bounce", waveform=SINE, law="constant", rebound="rest", speed=None, q=1
):
    inputs = UNIT if speed is None else {**UNIT, "restitution_speed": speed}
    return orbit_of(base, Laws(rebound, law, waveform), inputs, 1, q)


def phase_where_it_falls(waveform, value):
    """Phase at which the velocity of the base falls through a value."""
    x = np.linspace(0.0, 1.0, 100_001)
    w = waveform.velocity(x)
    i = np.flatnonzero((w[:-1] > value) & (w[1:] <= value))[0]
    return x[i] + (w[i] - value) / (w[i] - w[i + 1]) * (x[i + 1] - x[i])


@each_of("base", BASES)
@each_of("waveform", [SINE, TWO_TONES, PARABOLIC])
def test_one_impact_has_the_multipliers_of_the_closed_forms(base, waveform):
    """z^2 - (1 + e + a w') z + e, and z^2 - (1 + e^2 + (1 + e) a w' / 2) z + e^2."""
    e, a = 0.8, 0.3
    x = phase_where_it_falls(waveform, (1.0 - e) / a)
    proved = prove_orbit(orbit_closed_orbits(base, waveform), [x], arb(a))
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
    proved = prove_orbit(orbit_closed_orbits(base, law=law, speed=speed), [x], arb(a))
    assert float(proved.cycle.flights[0].arrives.v) == pytest.approx(c, rel=1e-12)
    share = 1.0 if base == "high-bounce" else left(c) / c
    assert float(proved.cycle.determinant.v) == pytest.approx(q * share, rel=1e-8)


@pytest.mark.weekly
def test_windows_between_points_are_closed_forms_and_proved():
    """0 < -G < 2 (1 + q e) / ((1 + q) (1 + e)), with e and q at the speed c + E(c) = k g / f."""
    pairs, frequency = [[0.1, 0.95], [2.0, 0.85]], 25.0
    found = vs.windows(
        base="moving", frequency=frequency, restitution_law="points", restitution_points=pairs,
        base_acceleration=np.linspace(0.05, 2.0, 12), conditions=["locked(1)", "locked(2)"],
        prove=True,
    )  # fmt: skip
    unit = 9.81 / (2.0 * frequency)
    for k in (1, 2):
        c = k * unit
        for _ in range(500):
            c += 0.5 * (2.0 * k * unit - c * (1.0 + np.interp(c, *np.transpose(pairs))))
        e = np.interp(c, *np.transpose(pairs))
        q = e - c * 0.1 / 1.9
        low = math.pi * (c / unit - k)
        high = math.hypot(low, 2.0 * (1.0 + q * e) / ((1.0 + q) * (1.0 + e)))
        one = found.isel(condition=k - 1, direction=0, window=0)
        assert (one.Gamma_min, one.Gamma_max) == pytest.approx((low, high), rel=1e-8)
        for proof in ("min_proof", "max_proof", "inside_proof"):
            assert one[proof] == 1, proof


def test_the_derivative_of_a_slope_is_that_of_differences():
    with ctx.workprec(160):
        for law in ("plastic", "viscoelastic"):
            own, h = orbit_closed_orbits(law=law, speed=0.5).law, arb(2) ** -50
            difference = (own.slope(1 + h) - own.slope(1 - h)) / (2 * h)
            assert float(own.bend(arb(1))) == pytest.approx(float(difference), rel=1e-9)
        assert (
            not orbit_closed_orbits(law="plastic", speed=0.5).law.bend(arb(0.5, 1e-3)).is_finite()
        )


def test_a_mode_under_two_tones_ends_in_a_proved_fold():
    """At e = 0.85 the mode has folds at 0.1688, 0.2852 and 0.2855, where w'(x) = 0."""
    own = orbit_closed_orbits(waveform=TWO_TONES)._replace(e=arb(0.85))
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
    proved = prove_orbit(orbit_closed_orbits(rebound="reflect"), [x], arb(a))
    assert float(proved.cycle.determinant.v) == pytest.approx(-e)
    assert proved.cycle.obstacle == ""
    assert float(proved.cycle.trace.v) == pytest.approx(
        1.0 - e - 2.0 * math.pi * a * math.cos(2.0 * math.pi * x)
    )


def test_at_a_corner_of_the_parabolic_waveform_an_orbit_is_proved_and_no_bifurcation():
    """Its slope jumps there, and with it the multipliers."""
    own = orbit_closed_orbits(waveform=PARABOLIC)
    assert prove_orbit(own, [0.25 + 1e-9], arb(0.2) * (1 + arb(2) ** -40)) is not None
    with ctx.workprec(160):
        (flight,) = cycle(own, variables([arb(0.25, 1e-3), arb(0.2)])).flights
        assert not flight.step[2].d[0].is_finite()
        assert flight.after.v.contains(1)


def test_an_orbit_that_rests_is_reported_as_resting():
    own = orbit_closed_orbits()._replace(rest=arb(2))
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


def test_wrong_numbers_are_reported_each_with_its_orbit(found, tmp_path):
    changes = {"impact_phase": 1e-10, "flight_time": 1e-10, "impact_speed": 1e-9}
    changes |= {"multiplier_real": 1e-6, "stable": 1}
    wrong = found.copy(deep=True)
    for orbit, (name, change) in enumerate(changes.items()):
        values = wrong[name].values[1, 1, orbit]
        if name == "stable":
            wrong[name].values[1, 1, orbit] = 1 - values
        else:
            values[0] += change
    report = vs.verify(save_result(wrong, tmp_path / "wrong.h5", ORBITS))
    assert not report.passed
    told = list(report.complaints())
    for orbit, name in enumerate(changes):
        begin = f"realization 3: {name} of orbit {orbit} is "
        assert any(complaint.startswith(begin) for complaint in told), name


def test_orbits_have_no_observables(found, tmp_path):
    longest = vs.Observable(
        "longest", lambda landing: landing.flight_time, "x", "s", landings="max"
    )
    path = save_result(found, tmp_path / "found.h5", ORBITS)
    with pytest.raises(ParameterError, match="vibrosweep orbits has none"):
        vs.verify(path, observables=[longest])
    with pytest.raises(ParameterError, match="sample = 0"):
        vs.verify(path, sample=0)


# Exponents of proved cycles against closed forms, and of proved orbits against plain products.

SCENE = {name: one.default for name, one in PARAMETERS.items()}


@each_of("rebound", ["rest", "reflect"])
@each_of("k", [1, 2])
@each_of("restitution", [0.3, 0.9, 0.999])
@each_of("place", [0.001, 0.5, 0.999])
def test_locked_orbit(rebound, k, restitution, place):
    e = restitution
    least = (1.0 - e) * k
    a = least + place * (math.hypot(least, (1.0 + e) / math.pi) - least)
    x = 0.5 - math.asin(least / a) / (2.0 * math.pi)
    trace = 1.0 + e + 2.0 * math.pi * a * math.cos(2.0 * math.pi * x)
    modulus = np.abs(np.roots([1.0, -trace, e])).max()
    scene = SCENE | {"restitution": e, "amplitude": a * 9.81 / 2.0}
    found = largest_exponent(
        lambda: BounceMap.from_parameters(scene, Laws(rebound)),
        (arb_exponents(x), arb_exponents(k)),
        1,
        k,
    )
    assert float(found) == pytest.approx(math.log(modulus), abs=1e-11)
    assert found.rad() < 1e-20
    # twice the way round is the same cycle
    twice = largest_exponent(
        lambda: BounceMap.from_parameters(scene, Laws(rebound)),
        (arb_exponents(x), arb_exponents(k)),
        2,
        2 * k,
    )
    assert twice.overlaps(found)


def test_without_a_proved_cycle_there_is_no_exponent():
    def table_1():
        return BounceMap.from_parameters(SCENE, Laws())

    state = arb_exponents(0.4329824002), arb_exponents(1)
    assert largest_exponent(table_1, state, 1, 1) is not None
    assert largest_exponent(table_1, (arb_exponents(0.2), arb_exponents(1)), 1, 1) is None
    assert largest_exponent(table_1, state, 1, 2) is None
    assert largest_exponent(table_1, state, MAX_CYCLE + 1, MAX_CYCLE + 1) is None


@pytest.mark.parametrize("rebound", ["rest", "reflect"])
@pytest.mark.parametrize("amplitude", [1.2, 3.5])
def test_mean_growth_is_that_of_the_product_of_jacobians(rebound, amplitude):
    parameters = SCENE | {"amplitude": amplitude}
    proved = trajectory(**parameters, launch_time=0.125, duration=30.0, rebound=rebound)
    impacts = proved.impacts[: next((n for n, i in enumerate(proved.impacts) if i.rested), None)]
    flights = [proved.launch, *(i.flight for i in impacts[:-1])]
    phases = [arb_exponents(0.125), *(i.phase for i in impacts[:-1])]
    m, errors = BounceMap.from_parameters(parameters, Laws(rebound)), (1e-12, 1e-11)
    found = mean_growth(m, phases, flights, errors)
    change = np.array([1.0, 0.0])
    kick = 2.0 * amplitude / 9.81
    for impact, flight in zip(impacts, flights, strict=True):
        x = float(impact.phase)
        k = 2.0 * math.pi * kick * math.cos(2.0 * math.pi * x)
        pushed = 0.9 * float(flight.speed) + kick * math.sin(2.0 * math.pi * x) < 0.0
        change = np.array([[1.0, 1.0], [k, 0.9 + k]]) @ change * [1.0, -1.0 if pushed else 1.0]
    assert found.value == pytest.approx(math.log(np.hypot(*change)) / len(impacts), abs=1e-13)
    assert 0.0 < found.claim < 1e-8
    # an orbit that is off by the error bounds has an exponent that is off by less than the claim
    moved = [x + 1e-12 * (-1) ** n for n, x in enumerate(phases)]
    other = mean_growth(m, moved, flights, errors)
    assert 0.0 < abs(other.value - found.value) < found.claim
    assert abs(other.standard_error - found.standard_error) < found.claim


# Claims that follow from the bounds of a dataset, and judgements of numbers by these claims.

SCENE_CLAIMS = ExactRealization(
    Scene(particles=2, duration=9.0, measures=Measures(transient=1.0)),
    parameters={
        "restitution": 0.9,
        "amplitude": 1.2,
        "frequency": 2.0,
        "phase": 0.0,
        "gravity": 10.0,
        "launch_velocity": 5.0,
        "contact_time": 1e-4,
    },
)
MEASURED = ProvedMeasures(
    values={
        "dt_min": arb_claims("0.5"),
        "dt_min_same_index": None,
        "impact_speed_max": arb_claims(4),
        "gap_min": arb_claims("0.25"),
        "gap_median": None,
    },
    fastest=arb_claims(4),
    flights=[ProvedFlight(arb_claims("1.6"), arb_claims("0.8"), arb_claims("1.6"), None)],
    landed=[ProvedFlight(arb_claims("1.6"), arb_claims("0.8"), arb_claims("1.6"), None)],
    longest=30,
    edge=arb_claims("0.1"),
    launch_depth=Fraction(-1, 4),
    apart=arb_claims("0.2"),
    last_period=arb_claims("0.1"),
    overlap=arb_claims("0.2"),
)
BOUNDS = ErrorBounds(1e-6, 1e-5)


def test_claims_of_a_window_that_is_clear():
    found = BOUNDS.claims(SCENE_CLAIMS, MEASURED)
    assert found["impact_count"] == found["status"] == found["base_shared"] == 0.0
    assert found["rebound_height_max"] == pytest.approx((2 * 4 * 1e-5 + 1e-10) / 20, rel=1e-6)
    assert found["flight_time_mean"] == pytest.approx(2 * 1e-5 / 10, rel=1e-6)
    assert found["dt_min"] == pytest.approx(2e-6, rel=1e-6)
    assert found["impact_speed_max"] == pytest.approx((1 + 2 * 1) * 1e-5, rel=1e-6)
    assert None not in found.values()


def test_every_variable_that_is_proved_has_a_claim():
    by_proof = JUDGES["measure"].by_proof
    proved = {v.name for v in VARIABLES.values() if JUDGES[v.judged].by_proof is by_proof}
    assert BOUNDS.claims(SCENE_CLAIMS, MEASURED).keys() == proved


def test_claims_without_errors_are_roundings():
    found = ErrorBounds(0.0, 0.0).claims(SCENE_CLAIMS, MEASURED)
    assert found["rebound_height_mean"] == pytest.approx(42 * EPS * 25 / 20)
    assert found["flight_time_mean"] == pytest.approx(42 * EPS * 8 / 10)
    assert found["dt_min"] == pytest.approx(EPS * (1.0 + 1.0))


def test_nothing_is_claimed_of_a_window_whose_beginning_is_too_near_to_a_landing():
    found = BOUNDS.claims(SCENE_CLAIMS, replace(MEASURED, edge=arb_claims("5e-7")))
    unclaimed = {name for name, claim in found.items() if claim is None}
    assert {"impact_count", "rest_count", "dt_min", "rebound_height_max"} <= unclaimed
    assert not {"status", "at_rest_count", "base_shared"} & unclaimed


def test_landings_that_may_come_in_either_order_leave_turns_undecided():
    found = BOUNDS.claims(SCENE_CLAIMS, replace(MEASURED, apart=arb_claims("1e-6")))
    assert {n for n, claim in found.items() if claim is None} == {"order_changes", "gap_median"}


def test_gaps_are_undecided_where_a_landing_is_next_to_the_last_period():
    found = BOUNDS.claims(SCENE_CLAIMS, replace(MEASURED, last_period=arb_claims("5e-7")))
    assert {n for n, claim in found.items() if claim is None} == {"gap_min", "gap_median"}


@pytest.mark.parametrize("overlap", ["1e-6", "0", "-2e-6"])
def test_touching_stays_are_not_decided(overlap):
    found = BOUNDS.claims(SCENE_CLAIMS, replace(MEASURED, overlap=arb_claims(overlap)))
    assert {n for n, claim in found.items() if claim is None} == {"base_shared", "collision_free"}


@pytest.mark.parametrize("overlap", ["4e-6", "-4e-6", None])
def test_stays_farther_apart_than_their_errors_are_decided(overlap):
    near = replace(MEASURED, overlap=None if overlap is None else arb_claims(overlap))
    assert BOUNDS.claims(SCENE_CLAIMS, near)["base_shared"] == 0.0


def test_launch_on_the_edge_of_the_window():
    found = BOUNDS.claims(SCENE_CLAIMS, replace(MEASURED, launch_depth=Fraction(1, 10**18)))
    assert {n for n, claim in found.items() if claim is None} == {"flight_height_max"}


def test_a_kick_that_barely_lifts_leaves_stays_undecided():
    weak = replace(
        SCENE_CLAIMS, parameters=SCENE_CLAIMS.parameters | {"amplitude": 5e-4 * (1 + 1e-15)}
    )
    assert BOUNDS.claims(weak, MEASURED)["base_shared"] is None
    assert BOUNDS.record_claims(weak, 1.0)["liftoff_time"] == math.inf


@each_of(
    ("stored", "proved", "claim", "sound"),
    [
        (1.0, arb_claims(1), 0.0, True),
        (1.0 + 1e-9, arb_claims(1), 1e-8, True),
        (1.0 + 1e-9, arb_claims(1), 1e-10, False),
        (1.0 + 1e-9, arb_claims(1, "2e-9"), 0.0, True),  # the proof does not exclude it
        (math.nan, arb_claims(1), 1.0, False),
        (math.inf, arb_claims(1), 1.0, False),
        (math.nan, None, 0.0, True),
        (0.0, None, 1.0, False),
        (3.0, 3, 0.0, True),
        (4.0, 3, 0.0, False),
        (4.0, 3, None, True),
    ],
)
def test_judge(stored, proved, claim, sound):
    judgement = judge("dt_min", None, stored, proved, claim)
    assert (judgement.complaint == "") is sound


def test_digits():
    assert judge("dt_min", None, 2.0, arb_claims(2), 2e-6).digits == pytest.approx(6.0)
    assert judge("dt_min", None, 2.0, arb_claims(2, "1e-6"), 1e-6).digits == pytest.approx(6.0)
    assert judge("dt_min", None, 2e-9, arb_claims("2e-9"), 1e-6).digits == 0.0
    assert judge("dt_min", None, 0.0, arb_claims(0), 1e-6).digits is None
    assert judge("impact_count", None, 5.0, 5, 0.0).digits is None
