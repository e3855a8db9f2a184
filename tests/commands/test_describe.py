import h5py
import numpy as np
import pytest
import xarray as xr

from vibrosweep.commands.describe import describe
from vibrosweep.errors import DataError


def test_a_result_is_described(paper):
    text = "\n".join(describe(paper))
    lines = {line.split()[0]: line for line in text.splitlines()}
    assert text.startswith("Table 1 with 200 random realizations")
    assert "dimensions: realization 200, particle 20" in text
    assert lines["gravity"].split() == ["gravity", "9.81", "m", "s-2", "(default)"]
    assert lines["contact_time"].split() == ["contact_time", "0.0001", "s", "(default)"]
    assert lines["restitution"].split()[2] == "..."
    assert lines["duration"].split() == ["duration", "12", "s"]
    assert lines["rebound"].split() == ["rebound", "rest"]
    record = xr.load_dataset(paper, group="record")
    assert f"{int(record['impact_count'].sum())} landings, in the group 'record'" in text
    assert lines["source"].split() == ["source", "vibrosweep", "0.1.0"]
    assert "numba" in lines["libraries"]
    assert lines["impact_count"].split()[1] == "222"
    assert "completed 200 (100.0%)" in lines["status"]


def test_reading_rows_in_slices_gives_the_same_description(paper, monkeypatch):
    expected = list(describe(paper))
    monkeypatch.setattr("vibrosweep.store.arranged.ROWS_OF_A_SLICE", 64)
    assert list(describe(paper)) == expected


def damaged(data, rng):
    for _ in range(rng.integers(1, 200)):
        data[rng.integers(data.size)] = rng.integers(256)
    return data


# after a failed open the file object of h5netcdf complains again when it is garbage-collected
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("seed", range(8))
def test_damage_is_reported_or_harmless(paper, tmp_path, seed):
    rng = np.random.default_rng(seed)
    data = np.frombuffer(paper.read_bytes(), np.uint8).copy()
    data = damaged(data, rng) if seed % 2 else data[: rng.integers(data.size)]
    path = tmp_path / "bad.h5"
    path.write_bytes(data.tobytes())
    try:
        lines = list(describe(path))
    except DataError as error:
        lines = str(error).splitlines()
    said = ("is not a result of vibrosweep, or is damaged", "is damaged, or was changed")
    assert lines[0].startswith(("Table", *(f"{path}: {words}" for words in said)))


def test_files_that_are_no_results_are_refused(tmp_path):
    text, empty, foreign = (tmp_path / name for name in ("text.h5", "empty.h5", "foreign.h5"))
    text.write_text("no HDF5")
    empty.touch()
    with h5py.File(foreign, "w") as file:
        file["x"] = np.arange(3)
    for path in (text, empty, foreign, tmp_path, tmp_path / ("x" * 300)):
        with pytest.raises(DataError, match="not a result"):
            list(describe(path))
    with pytest.raises(DataError, match="no such"):
        list(describe(tmp_path / "none.h5"))
