"""Proofs of windows: closed forms lie in the enclosures, and each missing proof has a reason."""

import math
from fractions import Fraction

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.analysis.branches import Plane, branches_along
from vibrosweep.analysis.conditions import Condition
from vibrosweep.analysis.continuation import FIX_E
from vibrosweep.analysis.windows import NO_WINDOW, OPEN_END, PROVED
from vibrosweep.api.result_kinds import WINDOWS
from vibrosweep.engine.workers import Workers
from vibrosweep.kernels.bifurcations import DOUBLING, SADDLE_NODE
from vibrosweep.proof.orbits import NO_ORBIT, UNBOUNDED
from vibrosweep.proof.reference.arithmetic import Jet, arb, ctx, exact, variables
from vibrosweep.proof.reference.closed_orbits import (
    EARLIER,
    NOT_ATTRACTING,
    RESTING,
    ClosedOrbit,
    cover,
    prove_event,
    prove_orbit,
)
from vibrosweep.scene.sweep import keyword_spec

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


@pytest.mark.parametrize("base", BASES)
@pytest.mark.parametrize("e", [0.3, 0.9, 0.99])
@pytest.mark.parametrize("k", [1, 3])
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
        amplitude=np.linspace(0.1, 6.0, 30),
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


def test_overlapping_windows_under_two_tones_are_proved_with_their_folds():
    """At e = 0.85, k = 1: 0.1688 to 0.2855, where it ends in a fold, and 0.2852 to 0.6657."""
    unit = 4.905
    found = vs.windows(
        restitution=0.85,
        amplitude=np.linspace(0.02, 1.2, 60) * unit,
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
        amplitude=np.linspace(0.1, 6.0, 30),
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
