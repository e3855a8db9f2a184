"""Closed orbits: each one is an orbit; closed forms, and what trajectories hold, are found."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibrosweep.kernels.bases import Flight, after_rest, constants, fly
from vibrosweep.kernels.bases.chords import chord, clearing, height
from vibrosweep.kernels.closed import (
    ADMISSIBLE,
    Wanted,
    begin_shortest,
    empty_closed,
    find_closed,
    primitive,
    same,
)
from vibrosweep.kernels.impact import base_of, impact
from vibrosweep.model.parameters import dimensionless
from vibrosweep.model.shapes import HARMONICS_NAME, SINE, Waveform

GRAVITY = 9.81
ROOM = 300
TONES = Waveform(HARMONICS_NAME, ((1, 1.0, 0.0), (2, 0.4, 1.1)))


def problem(e, a, contact_time=1e-4):
    """Dimensionless problems at f = 1 Hz."""
    e, a = np.broadcast_arrays(np.asarray(e, float), np.asarray(a, float))
    one = np.ones(e.size)
    return dimensionless(
        {
            "restitution": e.ravel().copy(),
            "amplitude": a.ravel() * GRAVITY / 2.0,
            "frequency": one,
            "phase": 0.0 * one,
            "gravity": GRAVITY * one,
            "launch_velocity": one,
            "contact_time": contact_time * one,
        },
        12.0,
    )


def search(base, e, a, impacts=3, periods=3, waveform=SINE):
    given_ = problem(e, a)
    wanted = Wanted(impacts, periods, 8, base == "high-bounce")
    found = empty_closed(given_.kick.size, ROOM, wanted)
    find_closed(0, given_.kick.size, base_of(base, "rest", waveform), given_, wanted, found)
    assert (found.orbits >= 0).all()
    return found


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
def test_every_orbit_is_one_that_the_engine_follows(base):
    e, a = [0.5, 0.8, 0.9], [0.9, 0.7, 0.62]
    found, given_ = search(base, e, a), problem(e, a)
    for i in range(3):
        fixed = constants(base_of(base, "rest"), given_, i)
        taken = np.flatnonzero(found.admissible[i, : found.orbits[i]] == ADMISSIBLE)
        assert taken.size
        for k in taken:
            p, q = found.impacts[i, k], found.periods[i, k]
            times = found.times[i, k, :p]
            for j in range(p):
                x = times[j] - np.rint(times[j])
                shift = 0.0 if base == "high-bounce" else fixed.alpha * math.sin(2 * math.pi * x)
                hit = impact(fixed, 0.0, x, found.speed[i, k, j] - shift)
                end = times[j + 1] if j + 1 < p else times[0] + q
                assert hit.leaves
                assert hit.flight.time == pytest.approx(end - times[j], abs=1e-11)
                assert hit.v == pytest.approx(found.arrival[i, k, j], abs=1e-10)
                after = found.speed[i, k, (j + 1) % p]
                turned = math.sin(2.0 * math.pi * hit.x)
                own = hit.u + (0.0 if base == "high-bounce" else fixed.alpha * turned)
                assert own == pytest.approx(after, abs=1e-10)


@pytest.mark.parametrize(("base", "power"), [("high-bounce", 1), ("moving", 2)])
def test_determinants_are_powers_of_the_restitution(base, power):
    """The product of the multipliers over a cycle is e^p, or e^(2p)."""
    found = search(base, [0.4, 0.9], [0.8, 0.6])
    for i, e in enumerate((0.4, 0.9)):
        k = slice(0, found.orbits[i])
        expected = e ** (power * found.impacts[i, k])
        assert found.determinant[i, k] == pytest.approx(expected, rel=1e-9)


@given(st.floats(0.3, 0.99), st.floats(0.02, 1.3), st.sampled_from(["high-bounce", "moving"]))
@settings(max_examples=40, deadline=None)
def test_orbits_of_one_impact_are_the_closed_forms(e, a, base):
    """Landing phases with sin = (1 - e) k / a, and their traces, two for each k that exists."""
    found = search(base, e, a, impacts=1, periods=4)
    expected = []
    for k in range(1, 5):
        need = (1.0 - e) * k / a
        if abs(need - 1.0) < 1e-9:
            return  # the two orbits nearly coincide
        if need < 1.0:
            x = math.asin(need) / (2.0 * math.pi)
            expected += [(k, x), (k, 0.5 - x)]
    own = slice(0, found.orbits[0])
    landed = np.column_stack([found.periods[0, own], found.times[0, own, 0]])
    assert landed.shape[0] == len(expected)
    for k, x in expected:
        at = np.argmin(np.abs(landed[:, 0] - k) + np.abs(landed[:, 1] - x))
        slope = 2.0 * math.pi * a * math.cos(2.0 * math.pi * x)
        trace = 1.0 + e + slope
        if base == "moving":
            trace = 1.0 + e * e + (1.0 + e) * slope / 2.0
        # the error of the phase is inversely proportional to the slope of the sine
        assert landed[at, 1] == pytest.approx(x, abs=4e-15 / abs(math.cos(2.0 * math.pi * x)))
        assert found.trace[0, own][at] == pytest.approx(trace, abs=1e-9)


@given(st.floats(0.5, 0.95), st.floats(0.1, 1.1))
@settings(max_examples=12, deadline=None)
def test_solutions_of_the_map_balance(e, a):
    """Those with a real multiplier above 1 are as many as the others, off bifurcations."""
    found = search("high-bounce", e, a)
    trace, det = found.trace[0, : found.orbits[0]], found.determinant[0, : found.orbits[0]]
    if np.any(np.abs(1.0 - trace + det) < 1e-4) or np.any(np.abs(1.0 + trace + det) < 1e-4):
        return  # next to a bifurcation
    assert found.saddles.tolist() == found.others.tolist()


def test_one_orbit_has_doubled():
    """Just above the end of the mode k = 1 at e = 0.9 one orbit has 2 impacts in 2 periods."""
    found = search("high-bounce", 0.9, 0.62, impacts=2, periods=2)
    own = (found.impacts[0] == 2) & (found.periods[0] == 2)
    assert own.sum() == 1


@given(st.floats(0.3, 0.99), st.floats(0.02, 2.0))
@settings(max_examples=40, deadline=None)
def test_all_orbits_of_one_impact_are_found_under_harmonics(e, a):
    """There are as many as roots of a w(x) = (1 - e) k."""
    found = search("high-bounce", e, a, impacts=1, periods=4, waveform=TONES)
    w = TONES.velocity(np.linspace(0.0, 1.0, 20_001))
    extremes = np.abs(w[1:-1][(np.diff(w)[1:] > 0.0) != (np.diff(w)[:-1] > 0.0)])
    for k in range(1, 5):
        need = (1.0 - e) * k / a
        if np.abs(extremes - need).min() < 1e-6:
            return  # two orbits nearly coincide
        roots = np.count_nonzero((w[1:] > need) != (w[:-1] > need))
        assert np.count_nonzero(found.periods[0, : found.orbits[0]] == k) == roots


def test_orbits_do_not_depend_on_how_a_waveform_is_scaled():
    """Weights ten times as large with a tenth of the kick are the same motion."""
    scaled = Waveform(HARMONICS_NAME, tuple((h, 10.0 * c, psi) for h, c, psi in TONES.harmonics))
    one = search("high-bounce", 0.7, 0.8, 2, 2, TONES)
    other = search("high-bounce", 0.7, 0.08, 2, 2, scaled)
    assert one.orbits[0] == other.orbits[0] > 4
    assert np.sort(one.trace[0, : one.orbits[0]]) == pytest.approx(
        np.sort(other.trace[0, : one.orbits[0]]), rel=1e-6
    )


def test_many_seeds_find_nothing_more():
    """At e = 0.6 over the moving base sixteen times as many seeds find the same orbits."""
    given_, base = problem(0.6, 1.1), base_of("moving", "rest")
    counts = []
    for seeds in (8, 128):
        wanted = Wanted(3, 3, seeds, False)
        found = empty_closed(1, ROOM, wanted)
        find_closed(0, 1, base, given_, wanted, found)
        counts.append(int(found.orbits[0]))
    assert counts[0] == counts[1] > 4


@pytest.mark.parametrize(
    ("base", "waveform"), [("high-bounce", SINE), ("moving", SINE), ("moving", TONES)]
)
def test_two_landings_determine_the_speeds_of_the_flight_between_them(base, waveform):
    given_ = problem([0.8], [1.4])
    fixed = constants(base_of(base, "rest", waveform), given_, 0)
    for x, u in ((-0.3, 0.7), (0.1, 1.9), (0.45, 0.3)):
        time, v = fly(fixed, x, u)
        assert chord(fixed, x, time) == pytest.approx((u, v), abs=1e-13)


def test_too_little_room_is_reported():
    wanted = Wanted(1, 4, 8, True)
    found = empty_closed(1, 2, wanted)
    find_closed(0, 1, base_of("high-bounce", "rest"), problem(0.9, 0.9), wanted, found)
    assert found.orbits[0] == -1


def test_an_orbit_is_the_same_from_any_impact_and_period():
    one = np.array([0.1, 0.8, 1.3])
    other = np.array([0.8, 1.3, 4.1]) - 7.0
    assert same(one, other, 3, 4)
    assert not same(one, other + np.array([0.0, 1e-3, 0.0]), 3, 4)
    assert primitive(np.array([0.2, 0.9, 2.2, 2.9]), 4, 4) == 2
    assert primitive(np.array([0.2, 0.9, 2.2, 2.9]), 4, 5) == 4
    scratch = np.empty(3)
    begin_shortest(other, 3, 4, scratch)
    assert other == pytest.approx([-0.2, 0.3, 3.1])


@pytest.mark.parametrize("waveform", [SINE, TONES])
def test_the_least_clearance_of_a_flight_is_found_however_short_its_rise_is(waveform):
    """Also where a flight first rises and falls again within a few hundredths of a period."""
    draw, early = np.random.default_rng(7), 0
    given_ = problem(0.5, draw.uniform(1.0, 4.0, 400))
    base = base_of("moving", "rest", waveform)
    for i in range(400):
        fixed = constants(base, given_, i)
        x = after_rest(fixed)[0] - draw.uniform(0.0, 0.02)  # the base soon falls faster than g
        s, u = draw.uniform(0.05, 1.0), draw.uniform(0.0, 0.01)
        times = np.geomspace(1e-3, s, 500)
        f = np.array([height(fixed, x, u, time)[0] for time in times])
        low = 1 + np.flatnonzero((f[1:-1] < f[:-2]) & (f[1:-1] < f[2:]))
        if f[-1] > f[-2] or not low.size:
            continue
        least = low[np.argmin(f[low])]
        early += times[least] < 1.0 / 32.0
        assert clearing(fixed, Flight(x, u, s, x, 1.0)) == pytest.approx(f[least], abs=2e-3)
    assert early > 0
