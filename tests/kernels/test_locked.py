"""Locked orbits of the kernel against their closed forms, and the determinant of any orbit."""

import math

import numpy as np
import pytest

from vibrosweep import simulate, theory

FORCING = {"frequency": 1.7, "gravity": 9.81}


def flights(found):
    """Phases of impact in turns, and flight times in forcing periods, of the only particle."""
    one = found[{"realization": 0, "particle": 0}]
    f, g = one.frequency.item(), one.gravity.item()
    turns = one.landing_time.values * f + one.phase.item() / (2.0 * math.pi)
    return turns - np.rint(turns), one.rebound_velocity.values * 2.0 * f / g


@pytest.mark.parametrize("rebound", ["rest", "reflect"])
@pytest.mark.parametrize("k", [1, 2, 3, 4])
@pytest.mark.parametrize("e", [0.8, 0.9])
def test_a_locked_orbit_attracts_to_its_closed_form(k, e, rebound):
    low, high = theory.amplitude_min(k, e, **FORCING), theory.amplitude_max(k, e, **FORCING)
    amplitude, phi = float(low + 0.5 * (high - low)), 0.3
    x = float(theory.locked_phase(k, e, amplitude, **FORCING))
    impacts = 600  # errors of 1e-3 shrink by sqrt(e) each: 0.9^300 1e-3 = 2e-17
    found = simulate(
        restitution=e,
        amplitude=amplitude,
        phase=phi,
        launch_velocity=float(theory.locked_velocity(k, **FORCING)) * 1.002,
        launch_time=(x - 1e-3 - phi / (2.0 * math.pi)) / FORCING["frequency"],
        duration=impacts * k / FORCING["frequency"],
        rebound=rebound,
        **FORCING,
    )
    phase, flight = flights(found)
    assert not found.rested.any()
    assert phase.size in (impacts - 1, impacts)
    assert abs(phase[0] - x) > 1e-4
    # 2400 periods are rounded to 3e-13
    assert phase[-5:] == pytest.approx(x, rel=0, abs=1e-12)
    assert flight[-5:] == pytest.approx(k, rel=2e-12)
    height = found.rebound_velocity.values[0, 0, -5:] ** 2 / (2.0 * FORCING["gravity"])
    assert height == pytest.approx(float(theory.locked_height(k, **FORCING)), rel=4e-12)


@pytest.mark.parametrize("k", [1, 2, 3, 4])
def test_errors_of_a_locked_orbit_shrink_by_its_multipliers(k):
    e = 0.9
    low, high = theory.amplitude_min(k, e), theory.amplitude_max(k, e)
    # close below the upper edge the multipliers are real
    amplitude = float(high - 1e-4 * (high - low))
    x = float(theory.locked_phase(k, e, amplitude))
    found = simulate(
        restitution=e,
        amplitude=amplitude,
        launch_velocity=float(theory.locked_velocity(k)),
        launch_time=x + 1e-7,
        duration=200.5 * k,
    )
    leading = theory.multipliers(k, e, amplitude)[0]
    assert leading.imag == 0.0
    apart = flights(found)[0] - x
    # the other multiplier, near -e, has died out; the rounding of times is 1e-13 against 1e-7
    rate = (apart[190] / apart[150]) ** (1.0 / 40.0)
    assert rate == pytest.approx(abs(leading.real), abs=1e-6)


@pytest.mark.parametrize("k", [1, 3])
@pytest.mark.parametrize(("side", "grows"), [(-1, False), (1, True)])
def test_the_upper_edge_divides_decay_from_growth(k, side, grows):
    e, relative = 0.9, 1e-7
    # an alternation of 1e-6 is far above rounding (1e-16 per impact), and small enough for its
    # own square, 1e-12, not to move the edge by 1e-7; in 20,000 impacts it changes by 1e-3
    impacts, alternation = 20_000, 1e-6
    amplitude = float(theory.amplitude_max(k, e)) * (1.0 + side * relative)
    found = simulate(
        restitution=e,
        amplitude=amplitude,
        launch_velocity=float(theory.locked_velocity(k)),
        launch_time=float(theory.locked_phase(k, e, amplitude)) + alternation,
        duration=(impacts + 0.5) * k,
    )
    _, flight = flights(found)
    swing = np.abs(np.diff(flight))
    early, late = swing[1000], swing[-2]
    assert late / early == pytest.approx(1.0, abs=0.1)
    assert (late > early * (1.0 + 1e-5)) == grows
    assert (late < early * (1.0 - 1e-5)) != grows


@pytest.mark.parametrize("side", [-1, 1])
def test_a_locked_orbit_lives_only_above_the_lower_edge(side):
    k, e = 1, 0.9
    amplitude = float(theory.amplitude_min(k, e)) * (1.0 + side * 1e-3)
    found = simulate(
        restitution=e,
        amplitude=amplitude,
        launch_velocity=float(theory.locked_velocity(k)),
        launch_time=0.26,
        duration=2000.0,
    )
    _, flight = flights(found)
    stays = bool(np.all(np.abs(flight[-100:] - k) < 1e-6))
    assert stays == (side > 0)


def images(launches, flights_, kept, **scene):
    """Time and flight time after some landings of particles with each launch and first flight."""
    found = simulate(
        launch_time=launches,
        launch_velocity=flights_,  # gravity 2 and frequency 1: a speed is its flight time
        gravity=2.0,
        frequency=1.0,
        duration=100.0,
        **scene,
    )
    assert not found.rested[..., :kept].any()
    return found.landing_time.values[..., kept - 1], found.rebound_velocity.values[..., kept - 1]


@pytest.mark.parametrize(
    ("rebound", "e", "amplitude", "t", "u", "kept"),
    [
        ("rest", 0.9, 0.25, 0.4, 1.03, 12),
        ("reflect", 0.9, 0.25, 0.4, 1.03, 12),
        ("reflect", 0.8, 0.7, 0.1, 0.9, 5),  # turned back at the second and third landing
    ],
)
def test_areas_of_states_shrink_by_the_restitution_at_each_impact(
    rebound, e, amplitude, t, u, kept
):
    h = 2.0**-22
    times, speeds = images(
        [t - h, t, t + h],
        [u - h, u, u + h],
        kept,
        restitution=e,
        amplitude=amplitude,
        rebound=rebound,
    )
    jacobian = np.array(
        [
            [v[1, 2] - v[1, 0] for v in (times, speeds)],
            [v[2, 1] - v[0, 1] for v in (times, speeds)],
        ]
    ) / (2.0 * h)
    stretch = np.linalg.norm(jacobian)
    # a central difference is off by the square of 2 pi h stretch, and by some 1e-15 / h
    share = (2.0 * math.pi * h * stretch) ** 2 + 1e-14 / h / stretch
    assert stretch**2 * share < 1e-2 * e**kept
    determinant = abs(np.linalg.det(jacobian))
    assert determinant == pytest.approx(e**kept, rel=0, abs=stretch**2 * share)


@pytest.mark.parametrize(
    ("rebound", "e", "amplitude"),
    [("reflect", 0.9, 3.2), ("reflect", 0.5, 8.0), ("rest", 0.9, 0.8), ("rest", 0.9, 1.2)],
)
def test_lyapunov_exponents_sum_to_the_logarithm_of_the_restitution(rebound, e, amplitude):
    found = simulate(
        restitution=e, amplitude=amplitude, launch_time=0.41, duration=400.0, rebound=rebound
    )
    one = found[{"realization": 0, "particle": 0}]
    landings = np.argmax(one.rested.values) or one.sizes["impact"]
    phase, flight = flights(found)
    kick = 2.0 * amplitude / 9.81
    frame, grown = np.eye(2), np.zeros(2)
    arrival = np.concatenate([[2.0 * 5.0 / 9.81], flight[:-1]])
    for n in range(landings):
        slope = 2.0 * math.pi * kick * math.cos(2.0 * math.pi * phase[n])
        w = e * arrival[n] + kick * math.sin(2.0 * math.pi * phase[n])
        assert abs(abs(w) - flight[n]) < 1e-9
        jacobian = np.array([[1.0, 1.0], [slope, e + slope]])
        frame, triangle = np.linalg.qr(jacobian @ frame)
        grown += np.log(np.abs(np.diag(triangle)))
    assert landings > 50
    # each factor is rounded a few times relative to its largest entry
    assert grown.sum() / landings == pytest.approx(math.log(e), abs=1e-12)
