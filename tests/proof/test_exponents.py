"""Exponents of proved cycles against closed forms, and of proved orbits against plain products."""

import math

import numpy as np
import pytest
from flint import arb

from vibrosweep.model.parameters import PARAMETERS
from vibrosweep.proof.claims import MAX_CYCLE, largest_exponent, mean_growth
from vibrosweep.proof.reference.high_bounce import BounceMap
from vibrosweep.proof.reference.laws import Laws
from vibrosweep.proof.reference.trajectories import trajectory

SCENE = {name: one.default for name, one in PARAMETERS.items()}


@pytest.mark.parametrize("rebound", ["rest", "reflect"])
@pytest.mark.parametrize("k", [1, 2])
@pytest.mark.parametrize("restitution", [0.3, 0.9, 0.999])
@pytest.mark.parametrize("place", [0.001, 0.5, 0.999])
def test_locked_orbit(rebound, k, restitution, place):
    e = restitution
    least = (1.0 - e) * k
    a = least + place * (math.hypot(least, (1.0 + e) / math.pi) - least)
    x = 0.5 - math.asin(least / a) / (2.0 * math.pi)
    trace = 1.0 + e + 2.0 * math.pi * a * math.cos(2.0 * math.pi * x)
    modulus = np.abs(np.roots([1.0, -trace, e])).max()
    scene = SCENE | {"restitution": e, "amplitude": a * 9.81 / 2.0}
    found = largest_exponent(
        lambda: BounceMap.from_parameters(scene, Laws(rebound)), (arb(x), arb(k)), 1, k
    )
    assert float(found) == pytest.approx(math.log(modulus), abs=1e-11)
    assert found.rad() < 1e-20
    # twice the way round is the same cycle
    twice = largest_exponent(
        lambda: BounceMap.from_parameters(scene, Laws(rebound)), (arb(x), arb(k)), 2, 2 * k
    )
    assert twice.overlaps(found)


def test_without_a_proved_cycle_there_is_no_exponent():
    def table_1():
        return BounceMap.from_parameters(SCENE, Laws())

    state = arb(0.4329824002), arb(1)
    assert largest_exponent(table_1, state, 1, 1) is not None
    assert largest_exponent(table_1, (arb(0.2), arb(1)), 1, 1) is None
    assert largest_exponent(table_1, state, 1, 2) is None
    assert largest_exponent(table_1, state, MAX_CYCLE + 1, MAX_CYCLE + 1) is None


@pytest.mark.parametrize("rebound", ["rest", "reflect"])
@pytest.mark.parametrize("amplitude", [1.2, 3.5])
def test_mean_growth_is_that_of_the_product_of_jacobians(rebound, amplitude):
    parameters = SCENE | {"amplitude": amplitude}
    proved = trajectory(**parameters, launch_time=0.125, duration=30.0, rebound=rebound)
    impacts = proved.impacts[: next((n for n, i in enumerate(proved.impacts) if i.rested), None)]
    flights = [proved.launch, *(i.flight for i in impacts[:-1])]
    phases = [arb(0.125), *(i.phase for i in impacts[:-1])]
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
