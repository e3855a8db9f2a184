"""Results of the engine over a moving base, against the closed forms of `vibrosweep.theory`."""

import numpy as np

from vibrosweep import simulate, theory
from vibrosweep.engine.measure import measure
from vibrosweep.model.measures import Regime
from vibrosweep.scene.sweep import keyword_spec


def test_first_flights_after_a_rest_last_as_long_as_the_closed_form_says():
    gamma = np.concatenate([1.0 + np.geomspace(1e-4, 0.5, 40), np.linspace(1.6, 11.0, 60)])
    record = simulate(base="moving", restitution=0.0, base_acceleration=gamma, duration=14.0)
    landing, left, rested = (
        record[name].values[:, 0] for name in ("landing_time", "liftoff_time", "rested")
    )
    flights = np.where(rested[:, :-1] == 1, landing[:, 1:] - left[:, :-1], np.nan)
    exact = theory.liftoff_flight(gamma)[:, np.newaxis]
    seen = np.isfinite(flights)
    assert seen.any(axis=1).all()
    assert np.all(np.abs(flights - exact)[seen] < 1e-10)


def test_locked_orbits_contract_as_the_multipliers_say(workers):
    k, e, share = (v.ravel() for v in np.meshgrid((1, 2, 3), (0.2, 0.5, 0.7, 0.9), (0.1, 0.5, 0.9)))
    low, high = theory.amplitude_min(k, e), theory.amplitude_max(k, e, base="moving")
    amplitude = low + share * (high - low)
    phase = theory.locked_phase(k, e, amplitude)
    pair = theory.multipliers(k, e, amplitude, base="moving")
    for i in range(k.size):
        scene = keyword_spec(
            {
                "base": "moving",
                "restitution": e[i],
                "amplitude": amplitude[i],
                "launch": [phase[i] + 1e-3],
                "launch_velocity": float(theory.locked_velocity(k[i])),
                "duration_periods": float(theory.recognition_periods(e[i], k[i], "moving"))
                + 400.0 * k[i],
            }
        ).scene
        found = measure(scene.parameters({}), scene.only(lyapunov=True), workers)
        assert found["regime"].item() == Regime.LOCKED
        assert (found["cycle_impacts"].item(), found["cycle_periods"].item()) == (1, k[i])
        leading = np.log(np.abs(pair[i]).max())
        # multipliers that nearly coincide move by the root of a rounding
        apart = abs(np.subtract(*pair[i]))
        error = found["lyapunov_largest_error"].item() + min(1e-7, 1e-14 / apart)
        assert abs(found["lyapunov_largest"].item() - leading) <= error
        total = theory.exponent_sum(e[i], "moving")
        assert (
            abs(found["lyapunov_sum"].item() - total) <= found["lyapunov_sum_error"].item() + 1e-14
        )


def test_exponents_of_orbits_without_rests_sum_to_twice_the_logarithm(workers):
    rng = np.random.default_rng(5)
    e = rng.uniform(0.3, 0.98, 300)
    scene = keyword_spec(
        {"base": "moving", "particles": 2, "duration": 800.0, "phase": 0.3, "launch_velocity": 7.0}
    ).scene
    parameters = scene.parameters(
        {"restitution": e, "base_acceleration": rng.uniform(0.1, 3.0, e.size)}
    )
    found = measure(parameters, scene.only(lyapunov=True, regimes=True), workers)
    locked = found["regime"] == Regime.LOCKED
    apart = found["lyapunov_sum"] - theory.exponent_sum(e, "moving")[:, np.newaxis]
    assert locked.sum() > 100
    assert np.all(np.abs(apart[locked]) <= found["lyapunov_sum_error"][locked] + 1e-14)


def test_flights_keep_to_their_bounds():
    rng = np.random.default_rng(8)
    e, gamma = rng.uniform(0.0, 0.95, 200), rng.uniform(0.1, 8.0, 200)
    record = simulate(
        base="moving", restitution=e, base_acceleration=gamma, launch_time=[0.0, 0.4], duration=40.0
    )
    kick = gamma * (1.0 + e) / np.pi
    launched = np.full(e.size, 2.0 * 5.0 / 9.81)
    speed = record["rebound_velocity"].values * 2.0 / 9.81
    bound = theory.liftoff_speed_bound(launched, kick, e, "moving")
    assert np.all(np.nanmax(speed, axis=(1, 2), initial=0.0) <= bound * (1.0 + 1e-12))
    time = record["landing_time"].values[:, :, 1:] - record["liftoff_time"].values[:, :, :-1]
    longest = theory.flight_time_bound(launched, kick, e, "moving")
    assert np.all(np.nanmax(time, axis=(1, 2), initial=0.0) <= longest * (1.0 + 1e-12))
    assert np.nanmax(speed, axis=(1, 2), initial=0.0).max() > 0.5 * bound.min()
