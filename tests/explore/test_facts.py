"""Facts in words agree with a sweep of the same realization."""

from pathlib import Path

import numpy as np
import pytest

import vibrosweep as vs
from vibrosweep.explorer.points import Choice, of_result
from vibrosweep.explorer.words import facts, facts_html
from vibrosweep.model.parameters import BASES, PARAMETERS
from vibrosweep.scene.scene import Scene

TABLE_1 = {name: one.default for name, one in PARAMETERS.items()}
MOUNT = {"mass_ratio": 0.001, "mount_frequency": 0.37, "mount_damping": 0.05}


@pytest.mark.parametrize("base", BASES)
def test_facts_are_those_of_the_observation(base):
    choice = Choice(Scene(inputs=TABLE_1, particles=2, duration=60.0), mount=MOUNT).over(base)
    observed, settled = choice.observe(), None if base == "sprung" else choice.settle()
    said = dict(facts(choice, observed, settled))
    one = observed.isel(realization=0)
    assert said["observed"] == "60 forcing periods"
    assert said["base"] == base
    assert said["largest rebound height"] == f"{float(one['rebound_height_max']):.5g} m"
    if base == "sprung":
        exponent = float(one["joint_exponent"])
        assert said["largest Lyapunov exponent per period"] == f"{exponent:.5g}"
    else:
        assert "regimes after 2000 periods" in said
        assert said["orbits, slots"].startswith(f"{int(settled.orbit_count[0])}, ")
    assert f"<td>{base}</td>" in facts_html(choice)


def test_a_missing_value_is_shown_as_not_known():
    choice = Choice(Scene(inputs=TABLE_1, particles=2))
    observed = choice.observe()
    observed = observed.assign(
        {name: observed[name] * np.nan for name in ("dt_min", "rebound_height_max")}
    )
    said = dict(facts(choice, observed, None))
    assert said["smallest separation Δt min"] == "not known"
    assert said["largest rebound height"] == "not known"


def test_separations_are_those_of_the_window_of_the_result():
    scene = {"restitution": [0.8, 0.9], "amplitude": 1.9, "particles": 5, "duration": 9.0}
    for window in ({"transient": 3.0}, {"transient_periods": 2.5}):
        found = vs.sweep(**scene, **window, separation=True)
        choice = of_result(found, Path("memory.h5"), "sweep").choice(1).shortened()
        said = dict(facts(choice, choice.observe(), None))
        assert said["smallest separation Δt min"] == f"{found.dt_min.values[1]:.5g} s"
        begin = next(iter(window.values()))
        assert said["observed"] == f"{begin:g} to 9 forcing periods"
