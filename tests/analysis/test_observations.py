"""Analyses that keep no landings skip what is known already, and find the same."""

import dataclasses
import math

import numpy as np
import pytest
import xarray as xr

from tests.scans import find_windows
from vibrosweep import sobol, sweep
from vibrosweep.analysis.conditions import NAMED
from vibrosweep.engine import landings
from vibrosweep.engine import measure as engine
from vibrosweep.engine.landings import all_parameters, record_landings
from vibrosweep.lab.compare import predict, scene_of
from vibrosweep.model.shapes import SINE
from vibrosweep.scene.scene import Scene
from vibrosweep.scene.sweep import keyword_spec

SCAN = np.linspace(0.3, 3.5, 9)
IMPACTS = xr.Dataset(
    {
        "flight_time": (("particle", "impact"), np.ones((3, 2))),
        "liftoff_time": (("particle", "impact"), np.arange(3.0)[:, np.newaxis] / [3.0, 3.0]),
        "impact_speed": (("particle", "impact"), np.full((3, 2), 5.0)),
    },
    attrs={"end": 60.0, "base_motion": "level"},
)
ANALYSES = {
    **{
        f"windows of {name}": lambda workers, name=name: find_windows(
            keyword_spec({"particles": 3, "duration": 300.0}).scene,
            [0.85, 0.9],
            SCAN,
            [name],
            tolerance=1e-3,
        )
        for name in NAMED
    },
    "sweep": lambda workers: sweep(amplitude=SCAN, separation=True, particles=20, duration=300.0),
    "sensitivity": lambda workers: sobol(amplitude=(0.3, 3.5), particles=5, realizations=64),
    "lab compare": lambda workers: predict(
        IMPACTS,
        all_parameters({"amplitude": SCAN}),
        [SINE] * SCAN.size,
        scene_of(IMPACTS, "rest", SINE, "constant"),
        workers,
    ),
}


@pytest.fixture
def asked(monkeypatch):
    """Observations that the engine and a recorder of landings are called with."""
    seen = []
    for module, name in ((engine, "follow"), (landings, "statistics")):
        function = getattr(module, name)

        def watched(*arguments, function=function, **others):
            seen.extend(a for a in arguments if hasattr(a, "skip"))
            return function(*arguments, **others)

        monkeypatch.setattr(module, name, watched)
    return seen


@pytest.mark.parametrize("name", ANALYSES)
def test_an_analysis_that_keeps_no_landing_skips_what_is_known(name, asked, workers):
    ANALYSES[name](workers)
    assert asked
    assert all(one.skip for one in asked)


def test_a_record_follows_every_landing(asked, workers):
    observation = Scene(2, "staggered", 12.0, "rest").recorded(1000)
    record_landings(all_parameters({}), observation, workers)
    assert asked
    assert not any(one.skip for one in asked)


@pytest.mark.parametrize("name", NAMED)
def test_skips_do_not_change_a_window(name):
    scene = keyword_spec({"particles": 3, "duration": 300.0}).scene
    skipped, followed = (
        find_windows(dataclasses.replace(scene, skip=skip), [0.85, 0.9], SCAN, [name])
        for skip in (True, False)
    )
    assert followed.identical(skipped)


def test_skips_do_not_change_a_count(workers):
    random = np.random.default_rng(3)
    ranges = {"restitution": (0.8, 0.98), "amplitude": (0.2, 3.5)}
    parameters = all_parameters({n: random.uniform(*ends, 24) for n, ends in ranges.items()})
    observation = Scene(6, "staggered", 3000.0, "rest").recorded(10_000_000)
    assert observation.measures.transient == -math.inf
    skipped, followed = (
        engine.measure(parameters, dataclasses.replace(observation, skip=skip), workers)
        for skip in (True, False)
    )
    assert np.array_equal(skipped["impact_count"], followed["impact_count"])
    assert np.array_equal(skipped["rebound_height_max"], followed["rebound_height_max"])
