"""Order of the landings of independent particles, from recorded landings by plain code."""

from itertools import pairwise

import numpy as np
import pytest

import vibrosweep as vs
from study.records import order_of_landings
from vibrosweep.engine.measure import measure

HARMONICS = {"order_1": 1, "order_2": 2, "order_3": 3, "order_half": 1 / 2, "order_third": 1 / 3}
LAUNCH = (0.0, 0.2, 0.2, 0.7)  # two particles coincide from the beginning


def plain(times, frequency, begin, end):
    """Order of landings at these times, shape (particle, impact), between begin and end."""
    landings = sorted((t, p) for p, own in enumerate(times) for t in own[~np.isnan(own)])
    last, changes = {}, 0
    for number, (time, particle) in enumerate(landings):
        waits = particle in last and last[particle] > min(last.values())
        changes += waits and time >= begin
        last[particle] = number
    late = max(begin, end - 1.0 / frequency)
    gaps = [b[0] - a[0] for a, b in pairwise(landings) if a[1] != b[1] and b[0] >= late]
    turns = frequency * np.array([landings[number][0] for number in last.values()])
    found = {name: abs(np.exp(2j * np.pi * h * turns).mean()) for name, h in HARMONICS.items()}
    found |= {"gap_median": np.median(gaps), "gap_min": min(gaps)} if gaps else {}
    return found | {"order_changes": changes}


@pytest.mark.parametrize("base", ["high-bounce", "moving"])
@pytest.mark.parametrize("transient", [0.0, 3.1])
def test_order_is_that_of_the_recorded_landings(
    base, transient, parameters, observe, workers, record
):
    rng = np.random.default_rng(3)
    drawn = {"restitution": rng.uniform(0.3, 0.95, 30), "amplitude": rng.uniform(0.3, 4.0, 30)}
    drawn["frequency"] = rng.uniform(0.8, 1.2, 30)
    given = parameters(**{name: np.tile(values, 2) for name, values in drawn.items()})
    scene = observe(LAUNCH, duration=7.0, transient=transient, base=base, ordering=True)
    found, landed = measure(given, scene, workers), record(given, scene)["landing_time"]
    for i in range(60):  # the second half equals the first and is not computed
        for name, value in plain(landed[i], given["frequency"][i], transient, 7.0).items():
            assert found[name][i] == pytest.approx(value, rel=0.0, abs=1e-12), name
    assert found["order_changes"].max() > 20


def test_particles_that_keep_their_order_keep_their_sequence():
    found = vs.simulate(
        base="moving",
        restitution=0.9,
        base_acceleration=np.linspace(0.2, 0.7, 20),
        launch_velocity=9.81,  # into the slots of mode 2
        launch_time=[0.4, 1.42],
        duration=40.0,
        transient=20.0,
        ordering=True,
    )
    kept = found.order_changes.values == 0
    assert 0 < kept.sum() < 20
    assert not order_of_landings(found, since=20.0).sequence_changes.values[kept].any()


def test_the_order_is_unknown_beyond_the_impact_budget(parameters, observe, workers):
    # the cycle is counted to the end, and landings are not followed that far
    given = parameters(restitution=0.5, amplitude=5.1, launch_velocity=9.81)
    scene = observe((0.3, 1.3), duration=1e5, ordering=True, impact_budget=1000, base="moving")
    found = measure(given, scene, workers)
    assert found["status"] == 0
    assert found["impact_count"] > 10_000
    assert found["order_changes"] == -1
    assert np.isnan([found[name] for name in (*HARMONICS, "gap_median", "gap_min")]).all()
