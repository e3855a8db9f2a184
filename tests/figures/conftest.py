"""Small datasets, and sweeps that are measured from records by plain code."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot

from vibrosweep import simulate
from vibrosweep.model.measures import VARIABLES
from vibrosweep.model.parameters import PARAMETERS

TABLE_1 = {name: one.default for name, one in PARAMETERS.items()}


def build_record(launch_time=(0.0,), duration=12.0, rebound="rest", **changed):
    """Record of every landing, with no more variables and attributes than figures need."""
    launches = [*np.atleast_1d(launch_time)]
    scene = {"launch_time": launches, "duration": duration, "rebound": rebound}
    record = simulate(**scene, **TABLE_1 | changed)
    record.attrs = {"rebound": rebound}
    record = record.set_coords([*TABLE_1, "duration"]).drop_vars("base_acceleration")
    names = ("landing_time", "liftoff_time", "rebound_velocity", "rested", "impact_count", "status")
    return record[[*names]]


def describe(sweep):
    """Give every variable the attributes that it has in a file."""
    for name, variable in sweep.data_vars.items():
        variable.attrs = VARIABLES[name].attributes
    return sweep


def smallest_separation(times):
    """Smallest difference between landings of different particles, NaN if there is none."""
    particle = np.broadcast_to(np.arange(times.shape[0])[:, None], times.shape)
    known = np.isfinite(times)
    order = np.argsort(times[known])
    t, who = times[known][order], particle[known][order]
    gaps = np.diff(t)[np.diff(who) != 0]
    return gaps.min() if gaps.size else np.nan


def measure(record, separation=True):
    """Measured variables of every realization of a record, as a sweep lays them out."""
    g = record["gravity"]
    rebound = (record["rebound_velocity"] ** 2 / (2 * g)).max(("particle", "impact"))
    launch = record["launch_velocity"] ** 2 / (2 * g)
    sweep = xr.Dataset(
        {
            "rebound_height_max": rebound,
            "flight_height_max": np.fmax(rebound, launch),
            "impact_count": record["impact_count"].sum("particle"),
            "status": record["status"].max("particle"),
        },
        coords={k: record[k] for k in (*TABLE_1, "duration")},
        attrs=record.attrs,
    ).assign_coords(transient=0.0)
    if separation:
        gaps = [smallest_separation(times) for times in record["landing_time"].values]
        shared = np.array([gap < 1e-4 for gap in gaps], dtype=np.int8)
        sweep["dt_min"] = ("realization", gaps)
        sweep["base_shared"] = ("realization", shared)
        sweep["collision_free"] = ("realization", 1 - shared)
        sweep["particle_impact_count"] = record["impact_count"]
        sweep["rest_count"] = record["rested"].sum(("particle", "impact"))
        sweep["at_rest_count"] = 0 * sweep["rest_count"]
    return describe(sweep)


def build_sweep(count=200, particles=20, seed=1, separation=True, duration=12.0, **changed):
    """Sweep over a random restitution and amplitude, unless they are given."""
    random = np.random.default_rng(seed)
    sampled = {
        "restitution": random.uniform(0.80, 0.98, count),
        "amplitude": random.uniform(0.2, 3.5, count),
    }
    launches = np.arange(particles) / particles
    return measure(build_record(launches, duration, **{**sampled, **changed}), separation)


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
