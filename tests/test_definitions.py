"""The quick part of checks/definitions.py: each measure has one meaning, over every base."""

import math

import numpy as np
import pytest

import definitions
import vibrosweep as vs
from vibrosweep.engine.workers import Workers


@pytest.mark.parametrize("base", definitions.BASES)
def test_measures_of_windows_that_begin_and_end_anywhere(base):
    rng, compared = np.random.default_rng(21), 0
    with Workers(1) as workers:
        for _ in range(12):
            count, wrong = definitions.windows(rng, base, workers)
            assert not wrong
            compared += count
    assert compared > 24


def test_bases_agree_in_their_common_limit():
    rng, compared = np.random.default_rng(22), 0
    with Workers(1) as workers:
        for _ in range(16):
            count, wrong = definitions.limit(rng, workers)
            assert not wrong
            compared += count
    assert compared > 24


@pytest.mark.parametrize("base", definitions.BASES)
def test_realizations_do_not_depend_on_what_was_computed_before(base):
    compared, wrong = definitions.orders(np.random.default_rng(0), base)
    assert compared > 0
    assert not wrong


def test_the_campaign_sees_a_stay_that_is_left_out(monkeypatch):
    """A window may begin or end in a stay."""
    monkeypatch.setattr(definitions.Recorded, "stay_ends", lambda own, landed: landed[0])
    rng, wrong = np.random.default_rng(21), []
    with Workers(1) as workers:
        for _ in range(12):
            wrong += definitions.windows(rng, "moving", workers)[1]
    assert any("base_shared" in one for one in wrong)


def test_a_record_knows_the_lift_off_after_a_stay_in_progress_at_the_end():
    scene = {"restitution": 0.2, "base_acceleration": 1.3, "launch_velocity": 3.0}
    mount = {"mass_ratio": 0.0, "mount_frequency": 0.5}
    last = [
        vs.simulate(base=base, duration=9.2, **scene, **of).isel(impact=-1).squeeze()
        for base, of in (("moving", {}), ("sprung", mount))
    ]
    for name in ("landing_time", "liftoff_time", "rebound_velocity"):
        assert float(last[1][name]) == pytest.approx(float(last[0][name]), rel=1e-13)
    assert float(last[0].landing_time) < 9.2 < float(last[1].liftoff_time)


def test_a_joint_cycle_without_mass_is_that_of_the_particles_together():
    """Rounding neither triples the joint cycle nor reorders particles that coincide."""
    rng = np.random.default_rng(5)
    scenes = {
        "restitution": np.append(rng.uniform(0.0, 0.9, 40), 0.7568630633759008),
        "base_acceleration": np.append(rng.uniform(0.2, 3.0, 40), 0.9230077991579027),
    }
    launched = {"launch": [0.0, 0.3, 0.77], "duration": 300.0}
    each = vs.sweep(base="moving", design=scenes, regimes=True, **launched)
    joint = vs.sweep(
        base="sprung", design=scenes, joint=True, mass_ratio=0.0, mount_frequency=2.8, **launched
    )
    compared = rested = 0
    for i in range(41):
        periods = each.cycle_periods.values[i].tolist()
        if min(periods) == 0 or joint.joint_cycle_impacts[i] == 0:
            continue
        whole = math.lcm(*periods)
        assert joint.joint_cycle_periods[i] == whole
        for name in ("impacts", "rests"):
            own = each[f"cycle_{name}"].values[i].tolist()
            together = sum(n * whole // p for n, p in zip(own, periods, strict=True))
            assert joint[f"joint_cycle_{name}"][i] == together
        compared, rested = compared + 1, rested + int(joint.joint_cycle_rests[i] > 0)
    assert compared > 10
    assert rested > 3
