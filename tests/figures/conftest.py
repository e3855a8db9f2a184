"""Small datasets, and sweeps that are measured from records by plain code."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot

import vibrosweep as vs
from vibrosweep.model.measures import VARIABLES
from vibrosweep.model.parameters import PARAMETERS

TABLE_1 = {name: one.default for name, one in PARAMETERS.items()}


def build_record(launch_time=(0.0,), duration=12.0, rebound="rest", **changed):
    """Record of every landing, with no more variables and attributes than figures need."""
    launches = [*np.atleast_1d(launch_time)]
    scene = {"launch_time": launches, "duration": duration, "rebound": rebound}
    record = vs.simulate(**scene, **TABLE_1 | changed)
    record.attrs = {"rebound": rebound}
    record = record.set_coords([*TABLE_1, "duration"]).drop_vars("base_acceleration")
    names = ("landing_time", "liftoff_time", "rebound_velocity", "rested", "impact_count", "status")
    return record[[*names]]


def describe(sweep):
    """Give every variable the attributes that it has in a file."""
    for name, variable in sweep.data_vars.items():
        variable.attrs = VARIABLES[name].attributes
    return sweep


def build_sweep(count=200, particles=20, seed=1, separation=True, **changed):
    """Sweep over a random restitution and amplitude, unless they are given."""
    random = np.random.default_rng(seed)
    given = {
        "restitution": random.uniform(0.80, 0.98, count),
        "amplitude": random.uniform(0.2, 3.5, count),
        **changed,
    }
    columns = {name: value for name, value in given.items() if np.ndim(value)}
    others = {name: value for name, value in given.items() if name not in columns}
    launches = [*np.arange(particles) / particles]
    measured = {"separation": separation, "per_particle": separation}
    return vs.sweep(design=columns, launch=launches, particles=particles, **others, **measured)


def build_synthetic_sweep(count):
    """A sweep of any size whose variables are smooth in restitution and amplitude, plus noise."""
    random = np.random.default_rng(7)
    e, a = random.uniform(0.8, 0.98, count), random.uniform(0.2, 3.5, count)
    height = (a / (1 - e)) ** 2 / 50 * random.uniform(0.5, 1.5, count)
    gap = 10 ** (-6 * e * random.uniform(0.8, 1.2, count))
    gap[a < 0.5] = 0.0
    fixed = {k: v for k, v in TABLE_1.items() if k not in ("restitution", "amplitude")}
    sweep = xr.Dataset(
        {
            "rebound_height_max": ("realization", height),
            "flight_height_max": ("realization", np.maximum(height, 1.27)),
            "dt_min": ("realization", gap),
        },
        coords={
            "restitution": ("realization", e),
            "amplitude": ("realization", a),
            **fixed,
            "duration": 12.0,
            "transient": 0.0,
        },
    )
    return describe(sweep)


@pytest.fixture(autouse=True)
def closed():
    """Close the figures that a test leaves to pyplot."""
    yield
    pyplot.close("all")


@pytest.fixture(scope="session")
def twenty():
    """The paper's scene: Table 1, twenty staggered particles, 12 s."""
    return build_record(np.arange(20) / 20)


@pytest.fixture(scope="session")
def sweep():
    """Sixty random realizations of three particles."""
    return build_sweep(60, 3)


@pytest.fixture(scope="session")
def make_record():
    return build_record


@pytest.fixture(scope="session")
def make_sweep():
    return build_sweep


@pytest.fixture(scope="session")
def synthetic_sweep():
    return build_synthetic_sweep
