"""Coupled realizations: the order of proved landings, and the estimate of errors in doubles."""

import cmath
import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.model.observables import Measures
from vibrosweep.proof.claims import prove
from vibrosweep.proof.measures import prove_measures
from vibrosweep.proof.reference.sprung import coupled
from vibrosweep.proof.report import CHANGE
from vibrosweep.proof.sampling import Realization
from vibrosweep.scene.scene import Scene

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
    scene = Scene(
        particles=len(launch_times),
        launch=launch_times,
        duration=duration,
        measures=Measures(transient=transient),
        base="sprung",
    )
    return Realization(scene, PARAMETERS | changes)


def landings_of(trajectories):
    pairs = [(t, p) for p, one in enumerate(trajectories) for t in one.landing_time.tolist()]
    return sorted(pairs)


@pytest.mark.parametrize("transient", [0.0, 2.5])
def test_order_of_the_landings(transient):
    one = realization(transient=transient)
    trajectories, _ = prove(one, 1000)
    values = prove_measures(one, trajectories).values
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


@pytest.mark.parametrize(("mass_ratio", "open_"), [(0.0, True), (0.05, False)])
def test_the_order_of_particles_that_land_together_again_is_not_claimed(mass_ratio, open_):
    """Rounding may part them later, unless their first landing makes their motions differ."""
    one = realization((0.0, 0.2, 0.2), mass_ratio=mass_ratio)
    trajectories, estimate = prove(one, 1000)
    claims = estimate.claims(one, prove_measures(one, trajectories))
    assert (claims["order_changes"] is None) == (claims["gap_median"] is None) == open_


def test_the_estimate_is_of_the_size_of_the_effect_of_a_small_change():
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


@pytest.mark.parametrize(
    ("launches", "duration", "resting", "changes"),
    [
        pytest.param(
            (0.94, 2.0, 1.95, 5.28),
            6.0,
            4,
            {
                "restitution": 0.064,
                "amplitude": 4.3,
                "frequency": 0.15,
                "phase": -3.58,
                "gravity": 1.0,
                "launch_velocity": 1.82,
                "contact_time": 2e-5,
                "mount_frequency": 150.0,
            },
            id="a particle sticks while others fly",
        ),
        pytest.param(
            (0.0, 0.0, 0.0),
            0.5,
            0,
            {
                "restitution": 0.86,
                "amplitude": 0.0034,
                "frequency": 9.4,
                "phase": -0.08,
                "gravity": 15.3,
                "launch_velocity": 1.91,
                "contact_time": 3e-4,
                "mount_frequency": 9400.0,
            },
            id="landings at once that rounding parts",
        ),
    ],
)
def test_estimate_holds_where_a_recoil_decays_at_once(launches, duration, resting, changes):
    """The base has forgotten a recoil after 1e-7 periods."""
    stiff = {"mass_ratio": 1e-3, "mount_damping": 1e3}
    one = realization(launches, duration, **changes, **stiff)
    trajectories, estimate = prove(one, 100)
    found = vs.simulate(
        base="sprung", launch_time=list(launches), duration=duration, **one.parameters
    )
    assert found.rested.sum() == resting
    for p, proved in enumerate(trajectories):
        own = found.isel(realization=0, particle=p, impact=slice(len(proved.impacts)))
        assert int(own.impact_count) == len(proved.impacts)
        for name, claim in (
            ("landing_time", estimate.time),
            ("rebound_velocity", estimate.velocity),
        ):
            np.testing.assert_allclose(own[name], getattr(proved, name), rtol=0.0, atol=claim)


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("side", [-1, 1])
def test_nothing_is_claimed_where_rounding_may_decide(number, side):
    """A landing next to the end of the observation, on either side, may count or not."""
    landing = prove(realization(duration=3.0), 1000)[0][0].impacts[number].landing_time
    near = Fraction(float(landing)) + side * Fraction(2.0**-50)
    assert prove(realization(duration=near), 1000)[1] is None
    assert prove(realization(duration=near + side * Fraction(1, 1000)), 1000)[1] is not None


def test_every_measure_has_a_claim():
    one = realization(transient=1.0)
    trajectories, estimate = prove(one, 1000)
    measured = prove_measures(one, trajectories)
    claims = estimate.claims(one, measured)
    assert claims.keys() == measured.values.keys()
    exact = {name for name, claim in claims.items() if claim == 0.0}
    assert exact >= {"impact_count", "particle_rest_count", "status", "order_changes"}
    rest = {name: claim for name, claim in claims.items() if name not in exact}
    assert all(claim is None or 0.0 < claim < 1e-6 for claim in rest.values())
