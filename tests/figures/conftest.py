"""Small datasets from a plain loop over the map, independent of the package's own kernels."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot

from vibrosweep.model.measures import VARIABLES
from vibrosweep.model.parameters import PARAMETERS

TABLE_1 = {name: one.default for name, one in PARAMETERS.items()}


def liftoff(t, p, w_rest):
    """First instant from t on at which the kick rises through the speed of rest."""
    if p["amplitude"] <= w_rest:
        return math.nan
    turn = math.asin(w_rest / p["amplitude"]) / (2 * math.pi)
    x = p["frequency"] * t + p["phase"] / (2 * math.pi)
    return t + (math.ceil(x - turn) + turn - x) / p["frequency"]


def trajectory(p, launch, duration, rebound="rest"):
    """Rows of (landing, lift-off, rebound velocity, rested) of one particle."""
    w_rest = p["gravity"] * p["contact_time"] / 2
    t, v, rows = launch, p["launch_velocity"], []
    while True:
        t += 2 * v / p["gravity"]
        if not t <= duration:
            return rows
        kick = p["amplitude"] * math.sin(2 * math.pi * p["frequency"] * t + p["phase"])
        v = p["restitution"] * v + kick
        if rebound == "reflect":
            v = abs(v)
        if v > w_rest:
            rows.append((t, t, v, 0))
            continue
        up = liftoff(t, p, w_rest)
        v = math.nan if math.isnan(up) else w_rest
        rows.append((t, up, v, 1))
        t = up


def build_record(launch_time=(0.0,), duration=12.0, rebound="rest", **changed):
    """Record of every landing, as `simulate` lays it out."""
    parameters = {**TABLE_1, **changed}
    count = max(np.size(v) for v in parameters.values())
    launches = np.atleast_1d(np.asarray(launch_time, dtype=np.float64))
    rows = [
        [
            trajectory(
                {k: float(np.broadcast_to(v, count)[r]) for k, v in parameters.items()},
                float(launch),
                duration,
                rebound,
            )
            for launch in launches
        ]
        for r in range(count)
    ]
    impacts = max(1, max(len(one) for some in rows for one in some))
    table = np.full((4, count, launches.size, impacts), np.nan)
    for r, some in enumerate(rows):
        for i, one in enumerate(some):
            if one:
                table[:, r, i, : len(one)] = np.array(one).T
    dims = ("realization", "particle", "impact")
    return xr.Dataset(
        {
            "landing_time": (dims, table[0]),
            "liftoff_time": (dims, table[1]),
            "rebound_velocity": (dims, table[2]),
            "rested": (dims, np.nan_to_num(table[3]).astype(np.int8)),
            "impact_count": (dims[:2], np.isfinite(table[0]).sum(axis=-1)),
            "status": (dims[:2], np.zeros((count, launches.size), np.int8)),
        },
        coords={
            **{k: ((dims[0],) if np.ndim(v) else (), v) for k, v in parameters.items()},
            "launch_time": ((dims[1],), launches),
            "duration": ((), duration),
        },
        attrs={"rebound": rebound},
    )


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
