"""Coupled realizations: the order of proved landings, and the estimate of errors in doubles."""

import cmath
import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.proof.coupled import CHANGE, prove, with_order
from vibrosweep.proof.measured import measures
from vibrosweep.proof.reference.coupled import coupled
from vibrosweep.proof.sample import Realization

PARAMETERS = {
    "restitution": 0.6,
    "amplitude": 2.2,
    "frequency": 1.3,
    "phase": 0.4,
    "gravity": 9.81,
    "launch_velocity": 5.0,
    "contact_time": 5e-3,
    "mass_ratio": 0.05,
    "mount_frequency": 0.5,
    "mount_damping": 0.05,
}


def realization(launch_times=(0.0, 0.2, 0.45), duration=5.0, transient=0.0, **changes):
    return Realization(
        parameters=PARAMETERS | changes,
        launch_times=tuple(map(Fraction, launch_times)),
        transient=transient,
        duration=duration,
        windowed=transient > 0.0,
        launch_rounding=0.0,
        rebound="rest",
        base="sprung",
    )


def landings_of(trajectories):
    pairs = [(t, p) for p, one in enumerate(trajectories) for t in one.landing_time.tolist()]
    return sorted(pairs)


@pytest.mark.parametrize("transient", [0.0, 2.5])
def test_order_of_the_landings(transient):
    one = realization(transient=transient)
    trajectories, _ = prove(one, 1000)
    values = with_order(measures(one, trajectories), one, trajectories).values
    last = [t.landing_time[-1] for t in trajectories]
    for name, h in (("1", 1), ("2", 2), ("3", 3), ("half", 1 / 2), ("third", 1 / 3)):
        mean = sum(cmath.exp(2j * math.pi * h * 1.3 * t) for t in last) / 3
        assert float(values[f"order_{name}"]) == pytest.approx(abs(mean), rel=0.0, abs=1e-12)
    landings = landings_of(trajectories)
    begin = max(transient, 5.0 - 1 / 1.3)
    neighbours = pairwise(landings)
    gaps = [b[0] - a[0] for a, b in neighbours if a[1] != b[1] and b[0] >= begin]
    assert len(gaps) > 2
    assert float(values["gap_min"]) == pytest.approx(min(gaps), rel=0.0, abs=1e-14)
    assert float(values["gap_median"]) == pytest.approx(np.median(gaps), rel=0.0, abs=1e-14)
    changes = 0
    for n, (time, particle) in enumerate(landings):
        before = [p for _, p in landings[:n]]
        turns = {p: n - 1 - before[::-1].index(p) for p in before}
        first = min(turns, key=turns.get, default=particle)
        changes += particle in turns and first != particle and time >= transient
    assert values["order_changes"] == changes > 0


def test_estimate_is_what_small_changes_do():
    one = realization()
    trajectories, estimate = prove(one, 1000)
    shifted = PARAMETERS | {"launch_velocity": 5.0 * (1.0 + CHANGE)}
    other = coupled(shifted, one.launch_times, one.duration, digits=30).particles
    moved = max(
        abs(float(a.landing_time - b.landing_time))
        for t, u in zip(trajectories, other, strict=True)
        for a, b in zip(t.impacts, u.impacts, strict=True)
    )
    assert moved / 10.0 < estimate.time < 1000.0 * moved
    assert estimate.velocity > 0.0
    assert estimate.height > 0.0
    again = prove(realization(duration=1.0), 1000)[1]
    assert again.time < estimate.time  # errors grow


def test_a_recoil_that_decays_at_once_ends_no_flight():
    """A particle sticks while three others fly; the base forgets it within 1e-7 periods."""
    launches = (0.94, 2.0, 1.95, 5.28)
    one = realization(
        launch_times=launches,
        duration=6.0,
        restitution=0.064,
        amplitude=4.3,
        frequency=0.15,
        phase=-3.58,
        gravity=1.0,
        launch_velocity=1.82,
        contact_time=2e-5,
        mass_ratio=1e-3,
        mount_frequency=150.0,
        mount_damping=1e3,
    )
    trajectories, estimate = prove(one, 100)
    found = vs.simulate(base="sprung", launch_time=launches, duration=6.0, **one.parameters)
    assert found.rested.sum() > 2
    for p, proved in enumerate(trajectories):
        times = found.landing_time.values[0, p, : len(proved.impacts)]
        assert int(found.impact_count[0, p]) == len(proved.impacts)
        np.testing.assert_allclose(times, proved.landing_time, rtol=0.0, atol=estimate.time)


def test_estimate_holds_where_rounding_parts_landings_at_once():
    """The base has forgotten a recoil after 1e-7 periods, and changes within much shorter times."""
    launches = (0.0, 0.0, 0.0)
    one = realization(
        launch_times=launches,
        duration=0.5,
        restitution=0.86,
        amplitude=0.0034,
        frequency=9.4,
        phase=-0.08,
        gravity=15.3,
        launch_velocity=1.91,
        contact_time=3e-4,
        mass_ratio=1e-3,
        mount_frequency=9400.0,
        mount_damping=1e3,
    )
    trajectories, estimate = prove(one, 100)
    found = vs.simulate(base="sprung", launch_time=launches, duration=0.5, **one.parameters)
    for p, proved in enumerate(trajectories):
        speeds = found.rebound_velocity.values[0, p, : len(proved.impacts)]
        np.testing.assert_allclose(
            speeds, proved.rebound_velocity, rtol=0.0, atol=estimate.velocity
        )


def test_nothing_is_claimed_where_rounding_may_decide():
    """A landing next to the end of the observation may count or not."""
    first = prove(realization(duration=2.0), 1000)[0][0].impacts[0].landing_time
    near = Fraction(float(first)) + Fraction(2.0**-50)
    assert prove(realization(duration=near), 1000)[1] is None
    assert prove(realization(duration=near + Fraction(1, 1000)), 1000)[1] is not None


def test_claims_are_of_every_measure():
    one = realization(transient=1.0)
    trajectories, estimate = prove(one, 1000)
    measured = with_order(measures(one, trajectories), one, trajectories)
    claims = estimate.claims(one, measured)
    assert claims.keys() == measured.values.keys()
    exact = {name for name, claim in claims.items() if claim == 0.0}
    assert exact >= {"impact_count", "particle_rest_count", "status", "order_changes"}
    rest = {name: claim for name, claim in claims.items() if name not in exact}
    assert all(claim is None or 0.0 < claim < 1e-6 for claim in rest.values())
