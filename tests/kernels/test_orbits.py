"""Orbits on which trajectories settle, and closed orbits by search."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.cases import each_of
from tests.general import everything_plain
from vibrosweep import simulate, theory
from vibrosweep.engine.measure import find_orbits
from vibrosweep.kernels.bases import (
    Flight,
    after_rest,
    chord,
    clearing,
    constants,
    fly,
    jacobian,
)
from vibrosweep.kernels.bases.moving_errors import height
from vibrosweep.kernels.closed import (
    ADMISSIBLE,
    Wanted,
    begin_shortest,
    empty_closed,
    find_closed,
    primitive,
    same,
)
from vibrosweep.kernels.fixed import ABSENT, ATTRACTS, REPELS, empty_fixed, find_fixed
from vibrosweep.kernels.impact import base_of, carry, impact, stretch
from vibrosweep.model.measures import Regime
from vibrosweep.model.parameters import LAWS, PARAMETERS, dimensionless, launches
from vibrosweep.model.shapes import HARMONICS_NAME, SINE, Waveform

# Orbits of trajectories: multipliers and exponents against closed forms and plain loops.


@pytest.fixture
def settled(observe, workers):
    """Orbit of each particle; arrays of shape (realization, particle)."""

    def find(inputs, duration, transient=0.0, launch=(0.0,), **changes):
        scene = observe(launch, duration=duration, **changes)
        problem = dimensionless(inputs, duration, transient)
        launch = launches(scene.launch, scene.particles, inputs["frequency"])
        orbits = find_orbits(problem, launch, scene, workers)
        return {n: v.reshape(-1, launch.whole.shape[1]) for n, v in orbits._asdict().items()}

    return find


def at_locked_orbit(parameters, k, e, amplitude, away=0.0):
    """Launch `away` from the closed form of a locked orbit; one realization for each amplitude."""
    phase = theory.locked_phase(k, e, amplitude)
    return parameters(
        restitution=e,
        amplitude=amplitude,
        launch_velocity=theory.locked_velocity(k),
        phase=2.0 * np.pi * (phase + away),
    )


@each_of("k", [1, 2, 3, 4])
@each_of("e", [0.3, 0.9])
def test_multipliers_of_locked_orbits_are_the_closed_form(k, e, parameters, settled):
    low, high = float(theory.amplitude_min(k, e)), float(theory.amplitude_max(k, e))
    amplitude = low + np.array([0.05, 0.5, 0.99]) * (high - low)
    found = settled(at_locked_orbit(parameters, k, e, amplitude, away=1e-3), 20_000.0)
    exact = theory.multipliers(k, e, amplitude)
    leading = exact[np.arange(3), np.argmax(np.abs(exact), axis=1)]
    value = found["multiplier"][:, 0]
    assert found["impacts"].ravel().tolist() == [1, 1, 1]
    assert found["periods"].ravel().tolist() == [k, k, k]
    assert value.real == pytest.approx(leading.real, rel=1e-9)
    assert np.abs(value.imag) == pytest.approx(np.abs(leading.imag), rel=1e-9)
    off = np.abs(found["largest"][:, 0] - np.log(np.abs(leading)))
    assert np.all(off <= found["largest_error"][:, 0])
    assert np.all(found["largest_error"] < 1e-9)
    assert found["phase"][:, 0] == pytest.approx(theory.locked_phase(k, e, amplitude), abs=1e-12)


@each_of("k", [1, 2, 3, 4])
@each_of("e", [0.3, 0.9])
def test_the_exponent_of_a_locked_orbit_changes_sign_at_the_upper_edge(k, e, parameters, settled):
    amplitude = float(theory.amplitude_max(k, e)) * (1.0 + np.array([-1e-4, 1e-4]))
    modulus = np.abs(theory.multipliers(k, e, amplitude)).max(axis=1)
    # above the edge the rounding of the launch needs 36 / ln(modulus) impacts to grow to 1
    assert 36.0 / np.log(modulus[1]) > 2000.0
    found = settled(at_locked_orbit(parameters, k, e, amplitude), 2000.5 * k)
    largest = found["largest"][:, 0]
    assert largest[0] < 0.0 < largest[1]
    # a mean over 2000 impacts depends on the first tangent vector
    assert largest == pytest.approx(np.log(modulus), abs=5.0 / 2000.0)


@each_of("k", [1, 2, 3, 4])
@each_of("e", [0.3, 0.6, 0.9])
def test_recurrence_finds_the_doubled_period_right_above_the_edge(k, e, parameters, settled):
    edge = float(theory.amplitude_max(k, e))
    amplitude = edge * (1.0 + np.array([-1e-3, 1e-3]))
    # the doubled orbit attracts by 1 - O(1e-3) for each two impacts
    found = settled(at_locked_orbit(parameters, k, e, amplitude, away=1e-3), 1e6 * k)
    assert found["impacts"].ravel().tolist() == [1, 2]
    assert found["periods"].ravel().tolist() == [k, 2 * k]
    assert (found["largest"] < 0.0).all()


def jacobians(phase, e, a, turned):
    k = 2.0 * math.pi * a * np.cos(2.0 * math.pi * phase)
    sign = np.where(turned, -1.0, 1.0)
    return np.stack(
        [
            np.stack([np.ones_like(k), np.ones_like(k)], -1),
            np.stack([sign * k, sign * (e + k)], -1),
        ],
        -2,
    )


def follow(found, i, e, a, reflect):
    """Jacobians along the cycle that was found, from its representative, by a plain loop."""
    x, u = float(found["phase"][i, 0]), float(found["flight"][i, 0])
    phases, turned = [], []
    for _ in range(int(found["impacts"][i, 0])):
        x += u
        w = e * u + a * math.sin(2.0 * math.pi * x)
        phases.append(x)
        turned.append(reflect and w < 0.0)
        u = abs(w) if reflect else w
    assert (x - found["phase"][i, 0] - found["periods"][i, 0]) == pytest.approx(0.0, abs=1e-9)
    assert u == pytest.approx(found["flight"][i, 0], abs=1e-9)
    return jacobians(np.array(phases), e, a, np.array(turned))


@pytest.mark.parametrize("rebound", ["rest", "reflect"])
def test_multipliers_of_any_cycle_are_the_eigenvalues_of_its_jacobians(
    rebound, parameters, settled
):
    rng = np.random.default_rng(5)
    inputs = parameters(
        restitution=rng.uniform(0.5, 0.97, 300), amplitude=rng.uniform(2.0, 6.0, 300)
    )
    found = settled(inputs, 5000.0, launch=(0.37,), rebound=rebound)
    cycles = np.flatnonzero((found["regime"][:, 0] == Regime.LOCKED) & (found["impacts"][:, 0] < 9))
    assert cycles.size > 30
    assert (found["impacts"][cycles, 0] > 1).sum() > 10
    for i in cycles:
        e, a = float(inputs["restitution"][i]), 2.0 * float(inputs["amplitude"][i]) / 9.81
        product = np.eye(2)
        for jacobian in follow(found, i, e, a, rebound == "reflect"):
            product = jacobian @ product
        exact = np.linalg.eigvals(product)
        leading = exact[np.argmax(np.abs(exact))]
        value = found["multiplier"][i, 0]
        # the cycle is known to 1e-12, and a double eigenvalue to the square root of that
        assert abs(value.real - leading.real) + abs(abs(value.imag) - abs(leading.imag)) < 1e-5
        exponent = np.log(abs(leading)) / found["impacts"][i, 0]
        assert found["largest"][i, 0] == pytest.approx(exponent, abs=1e-6)


def test_an_orbit_that_rests_is_superstable(parameters, settled):
    # Table 1 with a launch whose orbit is known to rest, and no excitation at all
    found = settled(parameters(amplitude=[1.2, 0.0]), 2000.0)
    assert found["regime"].ravel().tolist() == [Regime.RESTING, Regime.AT_REST]
    assert found["rests"].ravel().tolist() == [1, 0]
    for name in ("largest", "total"):
        assert np.all(found[name] == -np.inf)
        assert np.all(found[f"{name}_error"] == 0.0)
    # at rest for good, the state to go on from is on the base
    assert found["flight"][1, 0] == 0.0
    assert found["whole"][1, 0] + found["phase"][1, 0] == pytest.approx(
        float(theory.unforced_rest_time(5.0, 0.9, 1e-4)) - 2.0 * 9.81e-4 / 2.0 / 9.81, abs=1e-3
    )


# far beyond the cascade; with so short a contact time hardly any of 1e5 impacts is a rest
CHAOS = {"restitution": 0.5, "amplitude": 12.0, "contact_time": 1e-12}


def test_exponents_of_an_aperiodic_orbit_are_means_along_it(parameters, settled):
    duration, transient = 900.0, 100.0
    launch = 0.41
    found = settled(parameters(**CHAOS), duration, transient, launch=(launch,), rebound="reflect")
    assert found["regime"].item() == Regime.APERIODIC
    one = simulate(**CHAOS, launch_time=launch, duration=duration, rebound="reflect")
    times = one.landing_time.values[0, 0]
    kick = 2.0 * CHAOS["amplitude"] / 9.81
    flight = one.rebound_velocity.values[0, 0] * 2.0 / 9.81
    arrival = np.concatenate([[10.0 / 9.81], flight[:-1]])
    turned = CHAOS["restitution"] * arrival + kick * np.sin(2.0 * np.pi * times) < 0.0
    inside = times >= transient
    vector, grown = np.array([1.0, 0.0]), 0.0
    for jacobian in jacobians(times, CHAOS["restitution"], kick, turned)[inside]:
        vector = jacobian @ vector
        length = np.hypot(*vector)
        grown, vector = grown + np.log(length), vector / length
    assert found["largest"].item() == pytest.approx(grown / inside.sum(), abs=1e-8)
    assert found["largest"].item() > 10.0 * found["largest_error"].item() > 0.0


def test_the_stated_error_of_an_exponent_is_its_scatter(parameters, settled):
    launch = tuple(np.linspace(0.0, 0.99, 300))
    reflect = {"rebound": "reflect", "launch": launch}
    found = settled(parameters(**CHAOS), 1500.0, 300.0, **reflect)
    chaotic = found["regime"][0] == Regime.APERIODIC
    assert chaotic.mean() > 0.8
    value, error = found["largest"][0, chaotic], found["largest_error"][0, chaotic]
    deviation = (value - value.mean()) / error
    # 300 orbits give the scatter to 4 %; blocks of an orbit that does not quite mix miss a little
    assert 0.8 < np.sqrt(np.mean(deviation**2)) < 1.3


@pytest.mark.parametrize("rebound", ["rest", "reflect"])
def test_exponents_of_a_thousand_orbits_sum_to_the_logarithm_of_the_restitution(
    rebound, random_scenes, settled
):
    rng = np.random.default_rng(18)
    ranges = {
        "restitution": rng.uniform(0.3, 1.0, 14_000),
        "amplitude": rng.uniform(0.0, 3.5, 14_000),
    }
    inputs = random_scenes(seed=17, size=14_000, gravity=9.81, frequency=1.0, **ranges)
    found = settled(inputs, 300.0, rebound=rebound)
    bounces = np.isfinite(found["total"][:, 0])
    assert bounces.sum() >= 1000
    off = np.abs(found["total"][bounces, 0] - np.log(inputs["restitution"][bounces]))
    error = found["total_error"][bounces, 0]
    assert np.all(off <= error)
    assert np.median(error) < 1e-12


def test_without_restitution_the_exponents_sum_to_minus_infinity(parameters, settled):
    inputs = parameters(restitution=0.0, amplitude=np.linspace(5.0, 12.0, 40))
    found = settled(inputs, 300.0, launch=(0.2, 0.41))
    assert np.all(found["total"] == -np.inf)
    assert np.all(found["total_error"] == 0.0)
    assert np.isfinite(found["largest"]).any()
    nothing = settled(parameters(restitution=0.0, launch_velocity=60.0), 5.0)
    assert np.isnan(nothing["total"]).all()


@pytest.mark.parametrize(("e", "amplitude"), [(0.8, 1.0), (0.9, 1.2)])
def test_a_cycle_that_rounding_decides_is_uncertain(e, amplitude, parameters, settled):
    # under `reflect` a hundred chaotic impacts from rest to rest: rounding decides their number
    inputs = parameters(restitution=e, amplitude=amplitude)
    found = settled(inputs, 2000.0, launch=np.arange(20) / 20.0, rebound="reflect")
    resting = found["regime"] == Regime.RESTING
    assert resting.any()
    assert np.all(found["impacts"][resting] > 50)
    assert np.all(found["uncertain"][resting] == 1)
    assert np.all(found["largest_error"][resting] == np.inf)
    locked = found["regime"] == Regime.LOCKED
    assert np.all(found["uncertain"][locked] == 0)
    assert np.all(found["largest_error"][locked] < 1e-9)


def test_certain_cycles_survive_a_change_by_rounding(parameters, settled):
    """With an amplitude changed by one ulp, certain cycles remain what they are."""
    rng = np.random.default_rng(21)
    drawn = {
        "restitution": rng.uniform(0.6, 0.97, 400),
        "amplitude": rng.uniform(0.5, 3.5, 400),
    }
    for rebound in ("rest", "reflect"):
        found, moved = (
            settled(
                parameters(**(drawn | {"amplitude": drawn["amplitude"] * factor})),
                3000.0,
                launch=(0.4,),
                rebound=rebound,
            )
            for factor in (1.0, 1.0 + 2.0**-52)
        )
        resting = (found["rests"] > 0) & (moved["rests"] > 0)
        certain = resting & (found["uncertain"] == 0)
        assert certain.sum() > 20
        assert np.array_equal(found["impacts"][certain], moved["impacts"][certain])
        assert np.array_equal(found["periods"][certain], moved["periods"][certain])
    # under `reflect` most orbits that rest change by one unit in the last place of the kick
    changed = resting & (found["impacts"] != moved["impacts"])
    assert changed.sum() > 10
    assert np.all(found["uncertain"][changed] == 1)


# Small changes of state through an impact, against the impact itself.

phases = st.floats(-0.49, 0.49)
flights = st.floats(0.01, 8.0)
restitutions = st.floats(0.05, 1.0)
kicks = st.floats(0.01, 2.0)
laws = st.sampled_from(LAWS)


@given(st.floats(-4.0, 4.0), phases, flights, restitutions, kicks, laws)
def test_a_frame_stays_orthonormal_and_its_area_shrinks_by_the_restitution(
    constants_of, angle, x, v, e, a, law
):
    derivative = jacobian(constants_of(law, e, a), Flight(0.0, v, v, x, v))
    c, s, along, across, slack = stretch(np.cos(angle), np.sin(angle), derivative)
    assert c * c + s * s == pytest.approx(1.0, rel=1e-15)
    assert np.hypot(*carry(np.cos(angle), np.sin(angle), derivative)) == pytest.approx(along)
    assert abs(np.log(along * across) - np.log(e)) <= slack + 1e-15
    assert slack < 1e-10


# Closed orbits: each one is an orbit; closed forms, and what trajectories hold, are found.

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
    given_ = problem(0.5, draw.uniform(1.0, 4.0, 30))
    base = base_of("moving", "rest", waveform)
    for i in range(30):
        fixed = constants(base, given_, i)
        x = after_rest(fixed)[0] - draw.uniform(0.0, 0.02)  # the base soon falls faster than g
        s, u = draw.uniform(0.05, 1.0), draw.uniform(0.0, 0.01)
        times = np.geomspace(1e-3, s, 200)
        f = np.array([height(fixed, x, u, time)[0] for time in times])
        low = 1 + np.flatnonzero((f[1:-1] < f[:-2]) & (f[1:-1] < f[2:]))
        if f[-1] > f[-2] or not low.size:
            continue
        least = low[np.argmin(f[low])]
        early += times[least] < 1.0 / 32.0
        assert clearing(fixed, Flight(x, u, s, x, 1.0)) == pytest.approx(f[least], abs=2e-3)
    assert early > 0


# Fixed orbits from Newton's method on the map against their closed forms.

UNITS = {"frequency": 1.0, "gravity": 2.0}  # an amplitude is then its kick


def solved(e, a, k, r=1e-4, sign=1.0):
    e, a, k, r = (np.array(v) for v in np.broadcast_arrays(e, a, k, r))
    given = {name: np.full(e.size, p.default) for name, p in PARAMETERS.items()}
    given |= {name: np.full(e.size, value) for name, value in UNITS.items()}
    given |= {"restitution": e.astype(float), "amplitude": a.astype(float), "contact_time": r}
    found, base = empty_fixed(e.size), base_of("high-bounce", "rest" if sign > 0.0 else "reflect")
    find_fixed(0, e.size, base, dimensionless(given, 1.0), k, sign, found)
    return found


@each_of("k", [1, 2, 3, 4])
@each_of("e", [0.0, 0.3, 0.7, 0.9, 0.99])
def test_states_change_at_the_edges_of_the_closed_forms(k, e):
    near = np.array([-1e-3, -1e-9, -1e-12, 1e-12, 1e-9])
    lower = float(theory.amplitude_min(k, e, **UNITS)) * (1.0 + near)
    upper = float(theory.amplitude_max(k, e, **UNITS)) * (1.0 + near)
    assert solved(e, lower, k).state.tolist() == [ABSENT] * 3 + [ATTRACTS] * 2
    assert solved(e, upper, k).state.tolist() == [ATTRACTS] * 3 + [REPELS] * 2


@pytest.mark.parametrize("k", [1, 3])
def test_the_phase_is_the_closed_form(k):
    e = np.linspace(0.3, 0.99, 40)
    low, high = theory.amplitude_min(k, e, **UNITS), theory.amplitude_max(k, e, **UNITS)
    a = low + 0.4 * (high - low)
    assert solved(e, a, k).phase == pytest.approx(theory.locked_phase(k, e, a, **UNITS), abs=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_orbit_attracts_where_its_jacobian_contracts(sign):
    random = np.random.default_rng(4)
    e, a, k = random.uniform(0.0, 1.0, 400), random.uniform(0.0, 3.0, 400), 1
    found = solved(e, a, k, sign=sign)
    assert np.array_equal(found.state == ABSENT, a < (1.0 - sign * e) * k)
    slope = 2.0 * np.pi * a * np.cos(2.0 * np.pi * found.phase)
    for state, s, one in zip(found.state, slope, e, strict=True):
        if state != ABSENT:
            jacobian = np.array([[1.0, 1.0], [sign * s, sign * (one + s)]])
            assert (np.abs(np.linalg.eigvals(jacobian)).max() < 1.0) == (state == ATTRACTS)
    assert set(found.state.tolist()) == {ABSENT, ATTRACTS, REPELS}


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_nothing_attracts_where_no_energy_is_lost(sign):
    a = np.linspace(0.0, 5.0, 20_001)
    assert ATTRACTS not in solved(1.0, a, 1, sign=sign).state


def test_an_orbit_with_flights_no_longer_than_a_contact_does_not_exist():
    assert solved(0.9, 0.3, 1, r=np.array([0.9, 1.0, 2.0])).state.tolist() == [
        ATTRACTS,
        ABSENT,
        ABSENT,
    ]


def test_plain_python_gives_the_bits_of_the_machine_code(monkeypatch):
    given = {name: np.full(3, p.default) for name, p in PARAMETERS.items()}
    given |= {"restitution": np.array([0.9, 0.5, 0.3]), "gravity": np.full(3, 2.0)}
    asked = dimensionless(given | {"amplitude": np.array([0.3, 0.2, 0.75])}, 1.0), np.ones(3, int)
    bases = [base_of(name, "rest") for name in ("high-bounce", "moving")]

    def found():
        outs = [empty_fixed(3) for _ in bases]
        for base, out in zip(bases, outs, strict=True):
            find_fixed(0, 3, base, *asked, 1.0, out)
        return outs

    compiled = found()
    everything_plain(monkeypatch)
    for one, other in zip(compiled, found(), strict=True):
        assert one.state.tolist() == [ATTRACTS, ABSENT, ATTRACTS]
        np.testing.assert_array_equal(one.state, other.state)
        np.testing.assert_array_equal(one.phase, other.phase)
