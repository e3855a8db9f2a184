"""Facts in words agree with a sweep of the same realization."""

import numpy as np
import pytest

from vibrosweep.explore.choice import Choice
from vibrosweep.explore.facts import facts, facts_html
from vibrosweep.model.parameters import BASES, PARAMETERS
from vibrosweep.scene.scene import Scene

TABLE_1 = {name: one.default for name, one in PARAMETERS.items()}
MOUNT = {"mass_ratio": 0.001, "mount_frequency": 0.37, "mount_damping": 0.05}


@pytest.mark.parametrize("base", BASES)
def test_facts_are_those_of_the_observation(base):
    choice = Choice(Scene(inputs=TABLE_1, particles=2, duration=60.0), mount=MOUNT).over(base)
    observed = choice.sweep()
    said = dict(facts(choice, observed))
    one = observed.isel(realization=0)
    assert said["base"] == base
    assert said["largest rebound height"] == f"{float(one['rebound_height_max']):.5g} m"
    if base == "sprung":
        exponent = float(one["joint_exponent"])
        assert said["largest Lyapunov exponent per period"] == f"{exponent:.5g}"
    else:
        assert said["orbits, slots"].startswith(f"{int(one['orbit_count'])}, ")
    assert f"<td>{base}</td>" in facts_html(choice)


def test_what_has_no_value_is_not_known():
    choice = Choice(Scene(inputs=TABLE_1, particles=2))
    observed = choice.sweep()
    observed = observed.assign(
        {name: observed[name] * np.nan for name in ("dt_min", "rebound_height_max")}
    )
    said = dict(facts(choice, observed))
    assert said["smallest separation Δt min"] == "not known"
    assert said["largest rebound height"] == "not known"
