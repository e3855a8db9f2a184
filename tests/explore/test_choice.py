"""Choices for a simulation: bases, launches and times."""

from dataclasses import replace

import numpy as np
import pytest

from vibrosweep.engine.landings import launch_times
from vibrosweep.explorer.points import MOST_PERIODS, Choice, Spread
from vibrosweep.model.parameters import PARAMETERS, Periods
from vibrosweep.scene.scene import Scene

TABLE_1 = {name: one.default for name, one in PARAMETERS.items()}
MOUNT = {"mass_ratio": 0.001, "mount_frequency": 0.37, "mount_damping": 0.05}


@pytest.fixture
def choice():
    return Choice(Scene(inputs=TABLE_1, particles=4, rebound="reflect"), mount=MOUNT)


def test_launches_are_staggered_as_a_sweep_staggers_them(choice):
    times = choice.with_inputs(frequency=1.7).launch_time
    assert np.array_equal(times, launch_times("staggered", 4, 1.7))


def test_launches_can_be_shifted_and_spread(choice):
    spread = choice.with_inputs(frequency=2.0).launched(Spread(0.5, 0.1))
    assert np.allclose(spread.launch_time, 0.25 + 0.05 * np.arange(4) / 4, rtol=0, atol=1e-15)


def test_listed_launches_stay_until_their_number_changes(choice):
    times = (0.0, 0.1, 0.3, 0.4)
    listed = replace(choice, scene=replace(choice.scene, launch=times), spread=None)
    assert listed.with_particles(4).launch_time == (0.0, 0.1, 0.3, 0.4)
    assert len(listed.with_particles(7).launch_time) == 7


def test_the_mount_counts_over_a_sprung_base_only(choice):
    assert "mass_ratio" not in choice.keywords()
    assert choice.over("sprung").keywords()["mass_ratio"] == 0.001
    assert choice.over("sprung").over("moving") == choice.over("moving")


def test_another_base_gets_the_law_of_rebound_that_every_base_has(choice):
    assert choice.over("high-bounce").scene.rebound == "reflect"
    assert choice.over("moving").scene.rebound == "rest"


def test_long_observations_are_drawn_in_part(choice):
    assert choice.shortened() == choice
    longer = choice.lasting(5000.0).shortened()
    assert longer.scene.duration == Periods(MOST_PERIODS)
    assert longer.periods == MOST_PERIODS


def test_observations_are_of_the_same_particles(choice):
    launched = choice.over("moving")
    observed = launched.settle()
    assert observed.regime.shape == (1, 4)
    assert float(observed.duration[()]) == 2000.0
    coupled = choice.over("sprung").observe()
    record = choice.over("sprung").simulate()
    assert int(coupled.impact_count[0]) == int(record.impact_count.sum())
