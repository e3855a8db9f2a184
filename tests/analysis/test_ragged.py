"""Records without empty places, and the way back to a rectangle."""

from argparse import Namespace

import h5py
import numpy as np
import pytest
import xarray as xr

import vibrosweep as vs
from vibrosweep.commands.describe import describe
from vibrosweep.commands.results import figures
from vibrosweep.errors import DataError
from vibrosweep.store.disk import LENGTH

SCENES = {
    "one": {},
    "map": {"amplitude": [0.3, 1.2, 3.0], "launch_time": [0.0, 0.4, 11.9], "duration": 12.0},
    "moving": {"base": "moving", "base_acceleration": [0.5, 3.0], "particles": 2, "duration": 9.0},
    "sprung": {"base": "sprung", "mass_ratio": [0.01, 0.1], "mount_frequency": 3.0, "particles": 2},
    "none": {"launch_time": 11.9, "duration": 12.0},
}


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_a_ragged_record_is_the_rectangle_without_its_empty_places(scene):
    full, ragged = vs.simulate(**scene), vs.simulate(**scene, ragged=True)
    assert ragged.sizes["landing"] == full.impact_count.sum()
    assert ragged.impact_count.attrs["sample_dimension"] == "landing"
    assert np.array_equal(ragged.impact_count, full.impact_count.values.ravel())
    again = vs.rectangle(ragged)
    full.attrs.pop("notes", None)
    assert again.identical(full)


def test_a_rectangle_says_how_much_of_it_is_empty():
    half = vs.simulate(launch_time=[0.0, 6.0], duration=12.0)
    assert "notes" not in half.attrs
    found = vs.simulate(launch_time=[0.0, 11.0, 11.0, 11.0], duration=12.0)
    empty = 1.0 - float(found.impact_count.sum()) / (4 * found.sizes["impact"])
    assert empty > 0.5
    assert found.attrs["notes"].startswith(f"{empty:.0%} of the ")


def test_functions_that_need_a_rectangle_name_the_conversion():
    ragged = vs.simulate(ragged=True)
    for take in (vs.analysis.landing_phases, vs.figures.return_map):
        with pytest.raises(DataError, match=r"vibrosweep.rectangle\(record\)"):
            take(ragged)
    with pytest.raises(DataError, match=r"simulate\(\.\.\., ragged=True\)"):
        vs.rectangle(vs.simulate())
    with pytest.raises(DataError, match=r"11 landings where impact_count has"):
        vs.rectangle(ragged.isel(landing=slice(11)))


RECORDED = {"restitution": 0.5, "amplitude": 3.0, "launch": [0.0, 5.0, 5.9], "particles": 3}
SWEEP = {"restitution": [0.8, 0.9], "amplitude": [1.0, 2.0], "duration": 6.0}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The same sweep with a ragged record and with a rectangle."""
    folder = tmp_path_factory.mktemp("ragged")
    for name, ragged in (("ragged", True), ("full", False)):
        record = {**RECORDED, "ragged": ragged}
        vs.run({**SWEEP, "record": record}, folder / f"{name}.h5").close()
    return folder / "ragged.h5", folder / "full.h5"


def test_a_ragged_record_in_a_file_is_its_rectangle_without_empty_places(files):
    with vs.open_record(files[0]) as ragged, vs.open_record(files[1]) as full:
        assert ragged.sizes["landing"] == full.impact_count.sum()
        assert ragged.impact_count.attrs["sample_dimension"] == "landing"
        again = vs.rectangle(ragged)
        assert full.attrs.pop("notes").endswith("ragged = true in [record] leaves them out")
        assert again.identical(full)


def test_a_file_names_the_dimension_of_its_landings_by_its_own_name(files):
    with h5py.File(files[0]) as file:
        record = file["record"]
        assert record["landing_time"].dims[0][0].name == "/record/record_landing"
        assert record["impact_count"].attrs["sample_dimension"] == "record_landing"
    with xr.open_datatree(files[0], engine="h5netcdf") as tree:
        assert tree["record"].sizes["record_trajectory"] == 3


def test_a_ragged_record_depends_on_neither_threads_nor_chunks(files, tmp_path):
    other = tmp_path / "other.h5"
    vs.run({**SWEEP, "record": {**RECORDED, "ragged": True}}, other, threads=1, chunk=1).close()
    with h5py.File(files[0]) as one, h5py.File(other) as two:
        for name in one["record"]:
            assert one["record"][name][()].tobytes() == two["record"][name][()].tobytes(), name


def test_a_description_states_the_form_and_its_empty_places(files):
    told = ["\n".join(describe(path)) for path in files]
    assert "landings, one after the other" in told[0]
    assert "places are empty" not in told[0]
    assert "landings, in the group" in told[1]
    assert "ragged = true in [record] leaves them out" in told[1]


def test_figures_and_verify_take_a_ragged_record(files, tmp_path):
    figures(Namespace(result=files[0], output=tmp_path))
    assert (tmp_path / "fig4_return_map.png").exists()
    copy = tmp_path / "copy.h5"
    copy.write_bytes(files[0].read_bytes()[:-LENGTH])
    assert vs.verify(copy).passed
    for name in ("landing_time", "particle_index"):
        with h5py.File(copy, "r+") as file:
            before = file["record"][name][2]
            file["record"][name][2] = before + 1
        report = vs.verify(copy)
        assert [n for n, v in report.variables().items() if v.outside] == [f"record/{name}"]
        with h5py.File(copy, "r+") as file:
            file["record"][name][2] = before
    with h5py.File(copy, "r+") as file:
        file["record"]["impact_count"][0] -= 1
    with pytest.raises(DataError, match="landing_time"):
        vs.verify(copy)
