"""Edges between samples: each bracket has one end on either side, whatever the samples."""

import numpy as np
import pytest
import xarray as xr

from vibrosweep.analysis.conditions import Condition
from vibrosweep.analysis.sampled import sampled_edges
from vibrosweep.errors import DataError, ParameterError


def samples(size, seed=4):
    rng = np.random.default_rng(seed)
    units = {"restitution": "1", "amplitude": "m s-1"}
    values = {"restitution": rng.uniform(0.8, 0.98, size), "amplitude": rng.uniform(0.2, 3.5, size)}
    held = np.hypot((values["restitution"] - 0.89) / 0.05, values["amplitude"] - 1.8) < 1.0
    return xr.Dataset(
        {"collision_free": ("realization", held.astype(np.int8))},
        coords={n: ("realization", v, {"units": units[n]}) for n, v in values.items()},
        attrs={"particles": 2},
    )


def ellipse(restitution, amplitude):
    return np.hypot((restitution - 0.89) / 0.05, amplitude - 1.8)


def test_every_bracket_straddles_the_edge():
    found = sampled_edges(samples(200), "collision_free")
    assert found.sizes["edge"] > 30
    assert (ellipse(found["restitution_inside"], found["amplitude_inside"]) < 1.0).all()
    assert (ellipse(found["restitution_outside"], found["amplitude_outside"]) >= 1.0).all()
    assert found["holds"].values.sum() > 10


def test_brackets_are_as_narrow_as_samples_are_dense():
    def length(size):
        found = sampled_edges(samples(size), "collision_free")
        return float(np.median(np.abs(found["amplitude_inside"] - found["amplitude_outside"])))

    # a hundred times as many samples lie ten times as close
    assert length(20_000) == pytest.approx(length(200) / 10.0, rel=0.3)


def test_a_result_of_a_sweep(paper):
    with xr.open_dataset(paper, engine="h5netcdf") as dataset:
        found = sampled_edges(dataset, "collision_free")
        own = sampled_edges(
            dataset, Condition("still", lambda ds: (ds["rest_count"] == 0).values, ("rest_count",))
        )
        with pytest.raises(DataError, match="set lyapunov = true in the"):
            sampled_edges(dataset, "regular")
    assert found.sizes["edge"] > 0
    assert own.attrs["condition"] == "still"


def test_mistakes_are_named():
    with pytest.raises(ParameterError, match=r"locked\(1\) is about an orbit"):
        sampled_edges(samples(10), "locked(1)")
    with pytest.raises(DataError, match="at least three realizations"):
        sampled_edges(samples(2), "collision_free")
    varied = samples(10).assign_coords(frequency=("realization", np.linspace(1.0, 2.0, 10)))
    with pytest.raises(DataError, match="frequency varies too"):
        sampled_edges(varied, "collision_free")
