"""Tables: each mistake is named by file, column, row, value and what is allowed."""

import numpy as np
import pytest
import xarray as xr

from vibrosweep.errors import TableError
from vibrosweep.sweep.design import open_design
from vibrosweep.sweep.spec import parse_spec


def opened(path, extra=""):
    text = f'title = "x"\n[sample]\ndesign = "{path.name}"\n{extra}'
    return open_design(parse_spec(text, path.parent / "sweep.toml"))


@pytest.fixture
def csv(tmp_path):
    def write(text):
        path = tmp_path / "rows.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


@pytest.fixture
def netcdf(tmp_path):
    def write(**variables):
        path = tmp_path / "rows.nc"
        xr.Dataset(variables).to_netcdf(path, engine="h5netcdf")
        return path

    return write


def test_csv_exactly(csv):
    design = opened(csv("amplitude, restitution\n1.2000000000000002,0.9\n3,0.30000000000000004\n"))
    assert design.realizations == 2
    assert design.sampled == ("restitution", "amplitude")
    values = design.take(0, 2)
    assert values["amplitude"].tolist() == [1.2000000000000002, 3.0]
    assert values["restitution"].tolist() == [0.9, 0.30000000000000004]
    assert design.take(1, 2)["amplitude"].tolist() == [3.0]


def test_netcdf(netcdf):
    rows = np.array([1e-4, 2e-4, 3e-4])
    path = netcdf(
        restitution=("realization", [0.9, 0.8, 0.7]),
        amplitude=("realization", np.array([1, 2, 3], dtype=np.int32)),
        contact_time=("realization", rows, {"units": "s"}),
        realization=("realization", [7, 8, 9]),
    )
    design = opened(path)
    assert design.sampled == ("restitution", "amplitude", "contact_time")
    assert np.array_equal(design.take(0, 3)["contact_time"], rows)
    assert design.take(0, 3)["amplitude"].dtype == np.float64


def test_columns_choose(csv, netcdf):
    path = csv("label,amplitude,gravity\na,1.0,x\nb,2.0,y\n")
    assert opened(path, 'columns = ["amplitude"]').sampled == ("amplitude",)
    path = netcdf(amplitude=("realization", [1.0]), gravity=9.81, label=("other", ["a", "b"]))
    assert opened(path, 'columns = ["amplitude"]').sampled == ("amplitude",)


def test_a_fixed_number_stands_for_a_column(csv):
    assert opened(csv("restitution\n0.9\n"), "amplitude = 1.0").sampled == ("restitution",)


GOOD = "restitution,amplitude\n"
BAD_CSV = {
    "empty": ("", "", ["is empty", "column names"]),
    "no rows": (GOOD, "", ["has no rows"]),
    "unknown": (
        "restitution,amplitud\n0.9,1\n",
        "",
        ['column "amplitud"', 'did you mean "amplitude"?', "gravity", "sample.columns"],
    ),
    "lacking": (
        "restitution\n0.9\n",
        "",
        ['column "amplitude" is missing', "sweep.toml", "restitution", "at most 1e+30"],
    ),
    "lacking chosen": (
        GOOD + "0.9,1\n",
        'columns = ["phase"]',
        ['column "phase" is missing', "sample.columns", "columns found: restitution, amplitude"],
    ),
    "twice": ("amplitude,restitution,amplitude\n1,0.9,1\n", "", ['"amplitude" appears twice']),
    "fixed too": (
        "restitution,amplitude,phase\n0.9,1,2\n",
        "phase = 1.5",
        ['column "phase" is also fixed', "phase = 1.5", "keep one"],
    ),
    "empty cell": (
        GOOD + "0.9,1\n0.8,\n",
        "",
        ['column "amplitude", row 2', "nothing is not allowed"],
    ),
    "nan": (GOOD + "nan,1\n", "", ['column "restitution", row 1', "nan", "at most 1"]),
    "inf": (GOOD + "0.9,inf\n", "", ['column "amplitude", row 1', "inf", "at most 1e+30"]),
    "text": (GOOD + "0.9,1\nhigh,1\n", "", ['column "restitution", row 2', "high is not allowed"]),
    "bool": (GOOD + "0.9,True\n", "", ['column "amplitude", row 1', "True is not allowed"]),
    "range": (
        GOOD + "0.9,1\n1.5,1\n1.6,1\n",
        "",
        ['column "restitution", row 2', "1.5", "at least 0 and at most 1", "2 such rows"],
    ),
    "long row": (GOOD + "0.9,1\n0.9,1,3\n", "", ["line 3 has 3 values for 2 columns"]),
    "short row": (GOOD + "0.9,1\n\n0.9\n", "", ["line 4 has 1 values for 2 columns"]),
    "not text": (b"\xff\xfe\x00", "", ["not UTF-8"]),
    "count": (GOOD + "0.9,1\n", "realizations = 2", ["1 rows", "sample.realizations = 2"]),
}


@pytest.mark.parametrize(("text", "extra", "parts"), BAD_CSV.values(), ids=BAD_CSV)
def test_bad_csv(csv, text, extra, parts):
    path = csv(text)
    with pytest.raises(TableError) as caught:
        opened(path, extra)
    said = str(caught.value)
    assert said.startswith(str(path))
    assert "\n" not in said
    for part in parts:
        assert part in said


def test_missing_table(tmp_path):
    for name, part in {"none.csv": "no such table", "dir.nc": "is not a file"}.items():
        (tmp_path / "dir.nc").mkdir(exist_ok=True)
        with pytest.raises(TableError, match=part) as caught:
            opened(tmp_path / name)
        assert str(tmp_path / name) in str(caught.value)


def test_broken_netcdf(tmp_path):
    path = tmp_path / "rows.nc"
    path.write_text("restitution,amplitude\n")
    with pytest.raises(TableError, match="not a readable netCDF-4 file") as caught:
        opened(path)
    assert str(path) in str(caught.value)


def test_bad_netcdf(netcdf):
    path = netcdf(restitution=("n", [0.9, 0.8]), amplitude=(("n", "m"), [[1.0], [2.0]]))
    with pytest.raises(TableError, match=r'column "amplitude" has the dimensions \(n, m\)'):
        opened(path)
    path = netcdf(restitution=("n", [0.9, 0.8]), amplitude=("m", [1.0, 2.0]))
    with pytest.raises(TableError, match=r'column "amplitude" has the dimensions \(m\)'):
        opened(path)
    path = netcdf(restitution=("n", [0.9, np.nan]), amplitude=("n", [1.0, 2.0]))
    with pytest.raises(TableError, match='column "restitution", row 2'):
        opened(path)
    path = netcdf(restitution=("n", ["a"]), amplitude=("n", [1.0]))
    with pytest.raises(TableError, match=r'column "restitution", row 1.*: a is not allowed'):
        opened(path)
