"""Realizations along one dimension, or along the axes of a grid."""

import h5netcdf
import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import vibrosweep as vs
from vibrosweep.commands.describe import describe
from vibrosweep.proof.sampling import read_sample
from vibrosweep.store import arranged as rows
from vibrosweep.store.arranged import boxes, flat, read_rows, row_count, row_dims

GRID = {
    "restitution": [0.5, 0.8, 0.9],
    "base_acceleration": [0.5, 2.0],
    "frequency": [17.0, 10.0, 30.0, 12.0],
    "duration_periods": 20,
    "particles": 2,
    "per_particle": True,
}
SIZES = st.lists(st.integers(1, 5), min_size=1, max_size=4)


@given(SIZES, st.data())
def test_boxes_hold_a_range_of_elements_in_order(sizes, data):
    array = np.arange(np.prod(sizes)).reshape(sizes)
    start, stop = sorted(data.draw(st.integers(0, array.size)) for _ in range(2))
    cut = [array[box].ravel() for box in boxes(sizes, start, stop)]
    assert np.concatenate([np.empty(0, int), *cut]).tolist() == list(range(start, stop))
    assert len(cut) <= 2 * len(sizes) - 1


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("grid") / "grid.h5"
    vs.run(GRID, path, chunk=5).close()
    return path


def test_a_grid_has_its_axes_as_dimensions(path):
    with xr.open_dataset(path) as found:
        assert found.impact_count.dims == ("restitution", "base_acceleration", "frequency")
        assert found.particle_status.dims[-1] == "particle"
        for name in ("restitution", "base_acceleration", "frequency"):
            assert found.indexes[name].tolist() == GRID[name]
        # a quantity that follows from some of the axes lies along those
        assert found.duration.dims == ("frequency",)
        assert np.array_equal(found.duration, 20 / found.frequency)
        assert found.amplitude.dims == found.impact_count.dims
        one = found.sel(restitution=0.8, base_acceleration=2.0, frequency=30.0)
        alone = vs.sweep(**{**GRID, "restitution": 0.8, "base_acceleration": 2.0, "frequency": 30})
        for name in alone.data_vars:
            same = alone[name].isel(realization=0, missing_dims="ignore").values
            assert np.array_equal(one[name].values, same, equal_nan=True), name
        assert one.amplitude == alone.amplitude


def test_a_quantity_lies_only_along_axes_from_which_it_follows():
    found = vs.sweep(restitution=[0.5, 0.9], amplitude=[1.0, 2.0, 3.0], phase=[0.0, 1.0])
    assert found.base_acceleration.dims == ("restitution", "amplitude")
    same = vs.sweep(restitution=[0.5, 0.9], amplitude=[1.0, 2.0, 3.0])
    assert np.array_equal(found.base_acceleration, same.base_acceleration)


def test_random_designs_keep_the_dimension_of_realizations():
    found = vs.sweep(restitution=(0.5, 0.9), realizations=3)
    assert found.impact_count.dims == ("realization",)
    assert flat(found) is found


def test_flat_numbers_realizations_as_the_design_does(path):
    with xr.open_dataset(path) as found:
        stacked = flat(found)
        axes = (GRID[n] for n in ("restitution", "base_acceleration", "frequency"))
        mesh = np.meshgrid(*axes, indexing="ij")
        for name, values in zip(
            ("restitution", "base_acceleration", "frequency"), mesh, strict=True
        ):
            assert stacked[name].dims == ("realization",)
            assert stacked[name].values.tolist() == values.ravel().tolist()
        assert np.array_equal(stacked.impact_count, found.impact_count.values.ravel())
        plane = flat(found.isel(frequency=1))
        assert plane.sizes["realization"] == 6
        assert plane.frequency.item() == 10.0


@pytest.mark.parametrize("block", [7, rows.ROWS_AT_A_TIME])
def test_rows_are_those_of_the_stacked_dataset(path, monkeypatch, block):
    monkeypatch.setattr(rows, "ROWS_AT_A_TIME", block)
    rng = np.random.default_rng(3)
    with h5netcdf.File(path, "r") as file, xr.open_dataset(path) as found:
        assert row_dims(file) == found.impact_count.dims
        assert row_count(file) == 24
        stacked = flat(found.load())
        for name in ("status", "particle_status", "duration", "amplitude", "restitution"):
            whole = stacked[name].values
            for start, stop in np.sort(rng.integers(0, 25, (20, 2)), axis=1).tolist():
                assert np.array_equal(read_rows(file, name, slice(start, stop)), whole[start:stop])
            chosen = np.sort(rng.choice(24, 5, replace=False))
            assert np.array_equal(read_rows(file, name, chosen), whole[chosen])


def test_a_grid_of_an_earlier_version_is_read_as_before(path, tmp_path):
    """In such a file realizations and sampled parameters lie along one dimension."""
    earlier = tmp_path / "earlier.h5"
    with xr.open_dataset(path) as found:
        flat(found).to_netcdf(earlier, engine="h5netcdf")
    before, now = (read_sample(p, 5, 1)[0] for p in (earlier, path))
    assert before.rows.tolist() == now.rows.tolist()
    for name, values in now.stored.items():
        assert np.array_equal(before.stored[name], values, equal_nan=True), name
    for name, values in now.coordinates.items():
        assert np.array_equal(before.coordinates[name], values), name
    measured = [[line for line in describe(p) if "impact" in line] for p in (earlier, path)]
    assert measured[0] == measured[1]
    with vs.open_sweep(earlier) as opened:
        assert opened.sizes["realization"] == 24
