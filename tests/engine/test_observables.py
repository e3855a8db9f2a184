"""Observables in the streaming kernel, compared with the record of every landing."""

from dataclasses import replace

import numba
import numpy as np
import pytest

from vibrosweep.engine.measure import measure, measure_all
from vibrosweep.engine.workers import Workers
from vibrosweep.errors import ParameterError
from vibrosweep.kernels.statistics import compiled
from vibrosweep.model.observables import Landing, Observable

QUANTITIES = ("count", "phase", "flight_time", "arrival", "rebound", "rests")
LANDING = Landing(0.1, 1.0, 1.0, 0.9, False)
DURATION, TRANSIENT = 40.0, 7.3


def everything(totals, landing):
    """Sum each quantity; the phase is squared, so that signs do not cancel."""
    totals[0] += 1.0
    totals[1] += landing.phase * landing.phase
    totals[2] += landing.flight_time
    totals[3] += landing.arrival
    totals[4] += landing.rebound
    totals[5] += 1.0 if landing.rests else 0.0


def beyond(totals, landing):
    totals[1] += 1.0


def of_no_type(totals, landing):
    totals[0] += landing.colour


def without_limits(text, **outside):
    """A function g compiled by the user, without checks of indices."""
    names = dict(outside)
    exec(text, names)
    return numba.njit(names["g"])


ALL = Observable(
    "everything", everything, "sums", along="quantity", values=range(6), particles="each"
)


@pytest.fixture(scope="module")
def scenes(parameters):
    """Scenes of which some lock, some rest and some rest for good; none is chaotic for long."""
    rng = np.random.default_rng(5)
    return parameters(
        restitution=rng.uniform(0.3, 0.95, 12),
        amplitude=np.concatenate([rng.uniform(0.2, 2.0, 10), [0.0, 4.0]]),
        phase=rng.uniform(-3.0, 3.0, 12),
        frequency=rng.uniform(0.8, 1.5, 12),
    )


def sums_of(inputs, scene, found, base):
    """The same sums from a record, in its order; landings before the transient are left out."""
    f, g = (inputs[name][:, np.newaxis, np.newaxis] for name in ("frequency", "gravity"))
    e, a = (inputs[name][:, np.newaxis, np.newaxis] for name in ("restitution", "amplitude"))
    turn, shift, unit = 2.0 * np.pi, inputs["phase"][:, np.newaxis, np.newaxis], g / (2.0 * f)
    down, up, rested = found["landing_time"], found["liftoff_time"], found["rested"] == 1
    alpha = a / (1.0 + e) if base == "moving" else 0.0 * a

    def platform(time):
        return alpha * np.sin(turn * f * time + shift)

    particles = scene.particles
    launch = np.arange(particles)[np.newaxis, :, np.newaxis] / (particles * f)
    before = np.concatenate([launch, up[..., :-1]], axis=-1)
    rise = np.concatenate(
        [np.broadcast_to(inputs["launch_velocity"][:, np.newaxis, np.newaxis], launch.shape),
         found["rebound_velocity"][..., :-1]],
        axis=-1,
    )  # fmt: skip
    phase = f * down + shift / turn
    seen = np.isfinite(down) & (down >= scene.measures.transient)
    arrival = g * (down - before) - rise + platform(down)
    rebound = np.nan_to_num(found["rebound_velocity"] - platform(up))
    each = [
        np.ones_like(down),
        (phase - np.round(phase)) ** 2,
        f * (down - before),
        arrival / unit,
        rebound / unit,
        rested,
    ]
    return np.stack([np.where(seen, q, 0.0).sum(axis=-1) for q in each], axis=-1)


@pytest.mark.parametrize(("base", "transient"), [("high-bounce", TRANSIENT), ("moving", 0.0)])
def test_every_landing_in_the_window_is_seen(base, transient, scenes, observe, record, workers):
    scene = observe(
        particles=5, transient=transient, observables=(ALL,), base=base, duration=DURATION
    )
    found = measure(scenes, scene, workers)
    expected = sums_of(scenes, scene, record(scenes, scene), base)
    np.testing.assert_array_equal(found["everything"][..., 0], found["particle_impact_count"])
    np.testing.assert_array_equal(found["everything"][..., 5], found["particle_rest_count"])
    np.testing.assert_allclose(found["everything"], expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
def test_other_measures_and_threads_change_no_bit(base, scenes, observe):
    """In 400 periods most orbits repeat; other measures count cycles, observables follow them."""
    plain = observe(particles=5, duration=400.0, base=base, regimes=True)
    asked = plain.with_measures(observables=(ALL,))
    with Workers(1) as one, Workers(3) as three:
        without = measure(scenes, plain, one)
        found, again = measure(scenes, asked, one), measure(scenes, asked, three)
    assert found.keys() == without.keys() | {"everything"}
    for name, values in found.items():
        assert values.tobytes() == again[name].tobytes()
        assert name not in without or values.tobytes() == without[name].tobytes()
    np.testing.assert_array_equal(found["everything"][..., 0], found["particle_impact_count"])
    assert (found["locked_count"] + found["resting_count"] > 0).any()


def test_units_and_sums_over_particles(scenes, observe, workers):
    whole = replace(ALL, name="arrivals", units="m s-1", particles="sum")
    found = measure(scenes, observe(particles=5, observables=(ALL, whole)), workers)
    unit = scenes["gravity"] / (2.0 * scenes["frequency"])
    expected = unit[:, np.newaxis] * found["everything"].sum(axis=1)
    np.testing.assert_allclose(found["arrivals"], expected, rtol=1e-13)


def test_realizations_that_cannot_be_computed_are_nan(parameters, observe, workers):
    inputs = parameters(amplitude=[1.0, 1e300], restitution=0.9)
    found = measure_all(inputs, observe(particles=2, observables=(ALL,)), workers)
    assert found["status"].tolist() == [0, 3]
    assert np.isfinite(found["everything"][0]).all()
    assert np.isnan(found["everything"][1]).all()


def test_mistakes_in_a_function(scenes, observe, workers):
    one = Observable("seen", beyond, "one index too far")
    with pytest.raises(ParameterError, match="'seen': its function raised IndexError: index"):
        measure(scenes, observe(particles=2, observables=(one,)), workers)
    one = Observable("seen", of_no_type, "no such quantity")
    with pytest.raises(ParameterError, match=r"^[^:]*'seen': its function: numba cannot .*colour"):
        measure(scenes, observe(particles=2, observables=(one,)), workers)


def test_division_by_zero_is_an_error_as_in_python():
    def divided(totals, landing):
        totals[0] += 1 // int(landing.rests)

    with pytest.raises(ZeroDivisionError):
        compiled(Observable("seen", divided, "without remainder"))(np.zeros(1), LANDING)


def test_functions_that_it_calls_are_compiled_with_it():
    """A number that they use may have changed since, and bad indices must raise an error."""
    helper = without_limits("def g(totals, k): totals[k] += K", K=1.0)
    room = np.zeros(4)
    helper(room, 0)

    def calling(k):
        def function(totals, landing):
            helper(totals, k)

        return function

    helper.py_func.__globals__["K"] = 2.0
    first, beyond = (compiled(Observable("seen", calling(k), "one number")) for k in (0, 1))
    first(room[:1], LANDING)
    assert room.tolist() == [3.0, 0.0, 0.0, 0.0]
    with pytest.raises(IndexError):
        beyond(room[:1], LANDING)


def test_functions_that_it_calls_may_be_plain_python_and_recursive():
    def factorial(n):
        return 1 if n < 2 else n * factorial(n - 1)

    def function(totals, landing):
        totals[0] += factorial(5)

    totals = np.zeros(1)
    compiled(Observable("seen", function, "a number"))(totals, LANDING)
    assert totals.tolist() == [120.0]
