"""Designs and tables of realizations."""

import threading

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

import vibrosweep as vs
from tests.cases import each_of
from vibrosweep.errors import ExistingOutputError, ParameterError, SpecError, TableError
from vibrosweep.mistakes import ABSENT, Cell
from vibrosweep.runs.driver import retry_failed
from vibrosweep.scene.design import MAX_LATIN_VALUES, GivenTable, open_design
from vibrosweep.scene.sweep import keyword_spec, parse_spec

# Designs: any chunking gives the same bits, values stay in range, strata are filled.

DRAWN = ("uniform", "latin", "sobol")
DESIGNS = (*DRAWN, "grid")
GRID = "restitution = { start = 0.8, stop = 0.9, num = 10 }\namplitude = [1.0, 3.0, 2.0, 0.5]"


def opened(design, realizations=40, seed=1, ranges=None):
    ranges = ranges or "restitution = [0.8, 0.98]\namplitude = [0.2, 3.5]"
    count = "" if design == "grid" else f"realizations = {realizations}\nseed = {seed}\n"
    body = GRID if design == "grid" else ranges
    return open_design(parse_spec(f'title = "x"\n[sample]\ndesign = "{design}"\n{count}{body}'))


@pytest.mark.parametrize("name", DESIGNS)
def test_shape_order_and_range(name):
    design = opened(name)
    values = design.take(0, 40)
    assert design.realizations == 40
    assert tuple(values) == design.sampled == ("restitution", "amplitude")
    for array, low, high in zip(values.values(), (0.8, 0.2), (0.98, 3.5), strict=True):
        assert array.shape == (40,)
        assert array.dtype == np.float64
        assert low <= array.min() < array.max() <= high


WHOLE = {name: opened(name).take(0, 40) for name in DESIGNS}


@given(st.sampled_from(DESIGNS), st.lists(st.tuples(st.integers(0, 40), st.integers(0, 40))))
def test_any_chunk_in_any_order_gives_the_same_bits(name, chunks):
    design = opened(name)
    for ends in chunks:
        start, stop = sorted(ends)
        part = design.take(start, stop)
        for key, whole in WHOLE[name].items():
            assert part[key].tobytes() == whole[start:stop].tobytes()


@pytest.mark.parametrize("name", DRAWN)
def test_the_seed_decides(name):
    again, other = opened(name).take(0, 40), opened(name, seed=2).take(0, 40)
    assert np.array_equal(again["amplitude"], WHOLE[name]["amplitude"])
    assert not np.intersect1d(other["amplitude"], WHOLE[name]["amplitude"]).size


def test_uniform_is_the_generator_row_by_row():
    rows = np.random.Generator(np.random.PCG64(1)).random((40, 2))
    assert np.array_equal(WHOLE["uniform"]["restitution"], 0.8 + rows[:, 0] * (0.98 - 0.8))
    assert np.array_equal(WHOLE["uniform"]["amplitude"], 0.2 + rows[:, 1] * (3.5 - 0.2))


@pytest.mark.parametrize(("name", "count"), [("latin", 40), ("sobol", 64)])
def test_one_value_in_each_stratum(name, count):
    values = opened(name, count, ranges="phase = [0.0, 1.0]\namplitude = [0.0, 1.0]").take(0, count)
    for array in values.values():
        strata = np.ceil(array * count) - 1 if name == "latin" else np.floor(array * count)
        assert sorted(strata) == list(range(count))


def test_sobol_fills_every_elementary_box():
    values = opened("sobol", 256, ranges="phase = [0.0, 1.0]\namplitude = [0.0, 1.0]").take(0, 256)
    x, y = values["phase"], values["amplitude"]
    for columns in (1, 2, 4, 8, 16, 32, 64, 128, 256):
        rows = 256 // columns
        boxes = np.floor(x * columns) * rows + np.floor(y * rows)
        assert np.unique(boxes).size == 256


def test_sobol_from_several_threads():
    design, wrong = opened("sobol"), []

    def check(start):
        for _ in range(20):
            part = design.take(start, start + 10)["amplitude"]
            if not np.array_equal(part, WHOLE["sobol"]["amplitude"][start : start + 10]):
                wrong.append(start)

    threads = [threading.Thread(target=check, args=(s,)) for s in (0, 10, 20, 30)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_grid_order():
    values = opened("grid").take(0, 40)
    assert np.array_equal(values["amplitude"][:5], [1.0, 3.0, 2.0, 0.5, 1.0])
    assert np.array_equal(np.unique(values["restitution"]), np.linspace(0.8, 0.9, 10))
    assert np.all(np.diff(values["restitution"]) >= 0)


@pytest.mark.parametrize("name", DRAWN)
def test_values_stay_in_a_range_of_two_neighbouring_numbers(name):
    high = float(np.nextafter(0.3, 1))
    values = opened(name, 50, ranges=f"restitution = [0.3, {high!r}]").take(0, 50)["restitution"]
    assert set(values) <= {0.3, high}


def test_far_chunks_of_an_enormous_design_are_cheap():
    design = opened("uniform", 10**12)
    assert design.take(10**12 - 3, 10**12)["amplitude"].shape == (3,)


def test_nothing_sampled():
    design = open_design(parse_spec('title = "x"'))
    assert (design.realizations, design.sampled) == (1, ())
    assert design.take(0, 1) == {}


def test_chunk_beyond_the_end():
    with pytest.raises(IndexError, match="41 among 40"):
        opened("uniform").take(3, 41)


def test_latin_hypercube_too_large():
    with pytest.raises(SpecError) as caught:
        opened("latin", MAX_LATIN_VALUES)
    said = str(caught.value)
    assert f"realizations = {MAX_LATIN_VALUES}" in said
    assert f"at most {MAX_LATIN_VALUES}" in said
    assert '"sobol" or "uniform"' in said


def test_more_realizations_than_sobol_points():
    with pytest.raises(SpecError, match=r"realizations = 4294967297: .* 4294967296 points"):
        opened("sobol", 2**32 + 1)


# Tables: each mistake is named by file, column, row, value and allowed values.


def opened_table(path, extra=""):
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
    design = opened_table(
        csv("amplitude, restitution\n1.2000000000000002,0.9\n3,0.30000000000000004\n")
    )
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
    design = opened_table(path)
    assert design.sampled == ("restitution", "amplitude", "contact_time")
    assert np.array_equal(design.take(0, 3)["contact_time"], rows)
    assert design.take(0, 3)["amplitude"].dtype == np.float64


def test_only_the_chosen_columns_are_used(csv, netcdf):
    path = csv("label,amplitude,gravity\na,1.0,x\nb,2.0,y\n")
    assert opened_table(path, 'columns = ["amplitude"]').sampled == ("amplitude",)
    path = netcdf(amplitude=("realization", [1.0]), gravity=9.81, label=("other", ["a", "b"]))
    assert opened_table(path, 'columns = ["amplitude"]').sampled == ("amplitude",)


def test_a_fixed_number_stands_for_a_column(csv):
    assert opened_table(csv("restitution\n0.9\n"), "amplitude = 1.0").sampled == ("restitution",)


GOOD = "restitution,amplitude\n"
THREE = "restitution,amplitude,{}\n0.9,1,{}\n"
# text of the table, text of the sweep; column, row and value of its mistake
BAD_CELLS = {
    "no rows": (GOOD, "", None, 0, ABSENT),
    "unknown": ("restitution,amplitud\n0.9,1\n", "", "amplitud", 0, ABSENT),
    "lacking": ("restitution\n0.9\n", "", "amplitude", 0, ABSENT),
    "lacking chosen": (GOOD + "0.9,1\n", 'columns = ["phase"]', "phase", 0, ABSENT),
    "twice": ("amplitude,restitution,amplitude\n1,0.9,1\n", "", "amplitude", 0, ABSENT),
    "fixed too": (THREE.format("phase", 2), "phase = 1.5", "phase", 0, ABSENT),
    "empty cell": (GOOD + "0.9,1\n0.8,\n", "", "amplitude", 2, ""),
    "nan": (GOOD + "nan,1\n", "", "restitution", 1, "nan"),
    "inf": (GOOD + "0.9,inf\n", "", "amplitude", 1, "inf"),
    "text": (GOOD + "0.9,1\nhigh,1\n", "", "restitution", 2, "high"),
    "bool": (GOOD + "0.9,True\n", "", "amplitude", 1, "True"),
    "range": (GOOD + "0.9,1\n1.5,1\n", "", "restitution", 2, "1.5"),
    "underscore": (GOOD + "0.9,1_2\n", "", "amplitude", 1, "1_2"),
    "other digits": (GOOD + "0.9,\u0661\n", "", "amplitude", 1, "\u0661"),
    "nearly": (THREE.format("restitutoin", 1), "", "restitutoin", 0, ABSENT),
    "abbreviated": (THREE.format("freq", 17), "", "freq", 0, ABSENT),
    "symbol": (THREE.format("f", 17), "", "f", 0, ABSENT),
    "name of a result": (THREE.format("dt_min", "a"), "", "dt_min", 0, ABSENT),
    "key": (THREE.format("particles", 3), "", "particles", 0, ABSENT),
    "no name": (THREE.format("", 3), "", "", 0, ABSENT),
    "long row": (GOOD + "0.9,1\n0.9,1,3\n", "", None, 2, ABSENT),
    "short row": (GOOD + "0.9,1\n\n0.9\n", "", None, 2, ABSENT),
}


@each_of(("text", "extra", "column", "row", "value"), BAD_CELLS.values())
def test_a_mistake_names_its_file_column_row_and_value(csv, text, extra, column, row, value):
    path = csv(text)
    with pytest.raises(TableError) as caught:
        opened_table(path, extra)
    (mistake,) = caught.value.mistakes
    assert mistake.key == Cell(str(path), column, row)
    assert mistake.value is value or mistake.value == value
    said = str(caught.value)
    assert said.startswith(f"{path}: {mistake.key}".rstrip())
    assert "\n" not in said


@each_of(
    ("text", "extra", "parts"),
    [
        ("", "", ["is empty", "column names"]),
        (b"\xff\xfe\x00", "", ["not UTF-8"]),
        ("restitution;amplitude\n0,9;1\n", "", ["semicolons", "by commas", "point"]),
        ("restitution\tamplitude\n0.9\t1\n", "", ["tabs", "by commas"]),
        (GOOD + "0.9,1\n", "realizations = 2", ["1 rows", "sample.realizations = 2"]),
        (GOOD + "0.9,1\n0.8,\n", "", ['column "amplitude", row 2', "nothing is not allowed"]),
        (GOOD + "0.9,1\n\n0.9\n", "", ["line 4 has 1 values for 2 columns"]),
        (THREE.format("freq", 17), "", ['did you mean "frequency"?', "rename it"]),
        ("restitution\n0.9\n", "", ["sweep.toml", "columns found: restitution; allowed values"]),
    ],
)
def test_a_message_tells_the_remedy(csv, text, extra, parts):
    with pytest.raises(TableError) as caught:
        opened_table(csv(text), extra)
    for part in parts:
        assert part in str(caught.value)


def test_all_mistakes_of_a_table_are_told_at_once(csv):
    path = csv("restitution,phase,amplitude,dt_min\n1.5,0,x,1\n0.9,0\n0.9,0,-2,1\n0.9,inf,2,1\n")
    with pytest.raises(TableError) as caught:
        opened_table(path, "phase = 1.0")
    head, *lines = str(caught.value).splitlines()
    assert head == f"{path}: 7 mistakes"
    assert len(lines) == 7
    assert [(one.key.column, one.key.row, one.value) for one in caught.value.mistakes] == [
        (None, 2, ABSENT),
        ("phase", 0, ABSENT),
        ("dt_min", 0, ABSENT),
        ("restitution", 1, "1.5"),
        ("amplitude", 1, "x"),
        ("amplitude", 3, "-2"),
        ("phase", 4, "inf"),
    ]


def test_very_many_mistakes_are_counted(csv):
    with pytest.raises(TableError, match=r"1000 mistakes(?s:.*)\.\.\. and 980 more$"):
        opened_table(csv(GOOD + "0.9,-1\n" * 1000))


LABELS = "run,restitution,day,amplitude,number,note,code\n"
LABELLED = LABELS + "a,0.9,3,1,,x y,007\n,0.8,4.5,2,7,,008\nc,0.7,5,3,8,z,009\n"


def test_labels_reach_the_result(csv, compute):
    """In one piece or in chunks."""
    csv(LABELLED)
    expected = {
        "run": ["a", "", "c"],
        "day": [3.0, 4.5, 5.0],
        "number": [np.nan, 7.0, 8.0],
        "note": ["x y", "", "z"],
        "code": ["007", "008", "009"],
    }
    for chunk in (None, 1):
        for engine in ("h5netcdf", "netcdf4"):
            path = compute('[sample]\ndesign = "rows.csv"\n', chunk=chunk)
            found = xr.load_dataset(path, engine=engine)
            for name, values in expected.items():
                assert found[name].dims == ("realization",)
                assert name in found.coords
                assert name in found["impact_count"].coords
                np.testing.assert_array_equal(found[name].values, np.array(values))


def test_a_result_computed_again_keeps_its_labels(csv, compute, tmp_path):
    csv(LABELLED)
    text = (
        '[scene]\nduration = 50.0\n[sample]\ndesign = "rows.csv"\n[measure]\nimpact_budget = {}\n'
    )
    path = compute(text.format(6))
    assert xr.load_dataset(path)["status"].any()
    spec = parse_spec('title = "A sweep of a test"\n' + text.format(6), tmp_path / "again.toml")
    retry_failed(spec, path, threads=1, impact_budget=10**6)
    found = xr.load_dataset(path)
    assert not found["status"].any()
    assert found["run"].values.tolist() == ["a", "", "c"]


def test_chosen_columns_may_be_labels(csv):
    path = csv(LABELLED)
    design = opened_table(path, 'columns = ["run", "amplitude", "restitution"]')
    assert design.sampled == ("restitution", "amplitude")
    assert list(design.labels) == ["run"]


UNITS = {
    "amplitude": {
        "m s-1": 1.0,
        "m/s": 1.0,
        "mm s-1": 1e3,
        "cm/s": 1e2,
        "mm.s^-1": 1e3,
        "m min-1": 60,
    },
    "frequency": {"Hz": 1.0, "kHz": 1e-3, "rpm": 60.0, "s-1": 1.0, "1/s": 1.0, "min**-1": 60.0},
    "phase": {"rad": 1.0, "deg": 180.0 / np.pi, "degrees": 180.0 / np.pi, "mrad": 1e3},
    "gravity": {"m s-2": 1.0, "mm/s2": 1e3, "cm s^-2": 1e2, "m/s/s": 1.0},
    "contact_time": {"s": 1.0, "ms": 1e3, "us": 1e6, "\N{MICRO SIGN}s": 1e6},
    "restitution": {"1": 1.0, "%": 1e2, "percent": 1e2},
}


@pytest.mark.parametrize("number", range(6))
def test_units_of_a_netcdf_table_are_honoured(netcdf, number):
    """Each table has one unit of every parameter."""
    plain, given = np.array([0.25, 0.75]), {}
    for name, units in UNITS.items():
        unit, factor = list(units.items())[number % len(units)]
        given[name] = "run", plain * factor, {"units": unit}
    found = opened_table(netcdf(**given)).take(0, 2)
    for name in UNITS:
        np.testing.assert_allclose(found[name], plain, rtol=1e-15)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("amplitude", "m"),
        ("amplitude", "furlong s-1"),
        ("amplitude", "m s-2"),
        ("amplitude", ""),
        ("frequency", "rad s-1"),
        ("frequency", "s"),
        ("phase", "1"),
        ("gravity", "g"),
    ],
)
def test_an_unknown_unit_is_refused(netcdf, name, unit):
    columns = {"restitution": [0.9], "amplitude": [0.5]} | {name: [0.5]}
    given = {n: ("run", v, {"units": unit} if n == name else {}) for n, v in columns.items()}
    with pytest.raises(TableError) as caught:
        opened_table(netcdf(**given))
    said = str(caught.value)
    assert f'column "{name}" is in {unit!r}' in said
    assert "known are products of m, km, cm, mm" in said


def test_labels_of_a_netcdf_table(netcdf):
    path = netcdf(
        restitution=("run", [0.9, 0.8]),
        amplitude=("run", np.array([1200.0, 900.0]), {"units": "mm s-1"}),
        run=("run", ["first", "second"]),
        mass=("run", [3, 4], {"units": "g", "long_name": "mass of the ball"}),
        apparatus="shaker",
        spectrum=(("run", "line"), [[1.0, 2.0], [3.0, 4.0]]),
    )
    design = opened_table(path)
    assert design.take(0, 2)["amplitude"].tolist() == [1.2, 0.9]
    assert {name: label.values.tolist() for name, label in design.labels.items()} == {
        "run": ["first", "second"],
        "mass": [3.0, 4.0],
    }
    assert design.labels["mass"].attributes == {"units": "g", "long_name": "mass of the ball"}


def test_missing_table(tmp_path):
    for name, part in {"none.csv": "no such table", "dir.nc": "is not a file"}.items():
        (tmp_path / "dir.nc").mkdir(exist_ok=True)
        with pytest.raises(TableError, match=part) as caught:
            opened_table(tmp_path / name)
        assert str(tmp_path / name) in str(caught.value)


def test_broken_netcdf(tmp_path):
    path = tmp_path / "rows.nc"
    path.write_text("restitution,amplitude\n")
    with pytest.raises(TableError, match="netCDF-4") as caught:
        opened_table(path)
    assert str(path) in str(caught.value)


def test_bad_netcdf(netcdf):
    path = netcdf(restitution=("n", [0.9, 0.8]), amplitude=(("n", "m"), [[1.0], [2.0]]))
    with pytest.raises(TableError, match=r'column "amplitude" has the dimensions \(n, m\)'):
        opened_table(path)
    path = netcdf(restitution=("n", [0.9, 0.8]), amplitude=("m", [1.0, 2.0]))
    with pytest.raises(TableError, match=r'column "amplitude" has the dimensions \(m\)'):
        opened_table(path)
    path = netcdf(restitution=("n", [0.9, np.nan]), amplitude=("n", [1.0, 2.0]))
    with pytest.raises(TableError, match='column "restitution", row 2'):
        opened_table(path)
    path = netcdf(restitution=("n", ["a"]), amplitude=("n", [1.0]))
    with pytest.raises(TableError, match=r'column "restitution", row 1.*: a '):
        opened_table(path)


@pytest.mark.parametrize("way", ["base_velocity", "base_displacement", "base_acceleration"])
def test_a_table_gives_the_forcing_in_any_way(csv, way):
    design = opened_table(csv(f"{way},restitution\n0.25,0.5\n0.5,0.9\n"))
    assert design.sampled == ("restitution", way)
    assert design.take(0, 2)[way].tolist() == [0.25, 0.5]


@pytest.mark.parametrize(
    ("header", "extra"),
    [
        ("restitution,amplitude,base_velocity", ""),
        ("restitution,base_velocity,gravity", "[scene]\namplitude = 1.0"),
    ],
)
def test_a_table_gives_the_forcing_once(csv, header, extra):
    with pytest.raises(TableError, match="amplitude and base_velocity"):
        opened_table(csv(f"{header}\n0.5,1.0,1.0\n"), extra)


@each_of("name", ["case", "sample", "plate", "speed", "time", "run", "day"])
def test_a_word_that_only_resembles_a_parameter_is_a_label(csv, name):
    design = opened_table(csv(f"{name},restitution,amplitude\n1,0.85,1.1\nB,0.9,1.3\n"))
    assert list(design.labels[name].values) == ["1", "B"]


@pytest.mark.parametrize("name", ["restituton", "Amplitudes", "e", "gravty"])
def test_a_misspelled_parameter_is_no_label(csv, name):
    with pytest.raises(TableError, match="did you mean"):
        opened_table(csv(f"{name},restitution,amplitude\n1,0.85,1.1\n"))


def test_no_column_name_reaches_a_terminal_raw(csv):
    with pytest.raises(TableError) as caught:
        opened_table(csv("a\x1b[31mb,\u202ec,restitution,amplitude\n1,2,0.85,1.1\n"))
    assert r"a\x1b[31mb" in str(caught.value)
    assert str(caught.value).replace("\n", "").isprintable()


def test_a_path_whose_backslash_became_a_tab(tmp_path):
    text = 'title = "x"\n[sample]\ndesign = "C:\\temp.csv"\n'
    with pytest.raises(TableError, match="backslashes in single quotes"):
        open_design(parse_spec(text, tmp_path / "sweep.toml"))


# Tables of realizations in memory: the same checks and results as for a file.

PAIRS = {"restitution": [0.5, 0.9, 0.7], "amplitude": [1.0, 2.0, 0.5], "ball": ["a", "", "b"]}


def opened_columns(table, **keywords):
    return open_design(keyword_spec({"design": table, **keywords}))


def test_all_kinds_of_tables_give_the_same_design(tmp_path):
    frame = pd.DataFrame({**PAIRS, "ball": ["a", None, "b"]})
    frame.to_csv(tmp_path / "table.csv", index=False)
    dataset = xr.Dataset({name: ("run", values) for name, values in PAIRS.items()})
    tables = (PAIRS, frame, frame.set_index("ball"), dataset, str(tmp_path / "table.csv"))
    for table in tables:
        design = opened_columns(table)
        assert design.realizations == 3
        taken = design.take(0, 3)
        assert taken["restitution"].tolist() == PAIRS["restitution"]
        assert taken["amplitude"].tolist() == PAIRS["amplitude"]
        assert design.labels["ball"].values.tolist() == PAIRS["ball"]


def test_units_of_a_dataset_are_converted():
    speed = ("run", [1000.0, 500.0], {"units": "mm s-1"})
    table = xr.Dataset({"restitution": ("run", [0.5, 0.6]), "amplitude": speed})
    assert opened_columns(table).take(0, 2)["amplitude"].tolist() == [1.0, 0.5]


def test_a_grid_is_a_table_too():
    grid = xr.Dataset(coords={"restitution": [0.5, 0.6], "amplitude": [1.0, 2.0, 3.0]})
    taken = opened_columns(grid).take(0, 6)
    assert taken["restitution"].tolist() == [0.5] * 3 + [0.6] * 3
    assert taken["amplitude"].tolist() == [1.0, 2.0, 3.0] * 2


def test_memory_and_file_hold_the_same_and_a_changed_table_is_noticed(tmp_path):
    asks = {"design": PAIRS, "particles": 2}
    with vs.run(asks, tmp_path / "out.h5", chunk=2) as stored:
        xr.testing.assert_equal(stored.load(), vs.sweep(asks))
    vs.run(asks, tmp_path / "out.h5").close()
    other = {**PAIRS, "ball": ["a", "", "c"]}
    with pytest.raises(ExistingOutputError, match="table: was"):
        vs.run({**asks, "design": other}, tmp_path / "out.h5")
    with pytest.raises(SpecError, match="design"):  # it cannot be read again
        parse_spec(vs.sweep(asks).attrs["sweep_file"])


def test_the_digest_is_that_of_names_and_values():
    one = GivenTable.from_table(PAIRS)
    assert one == GivenTable.from_table(dict(PAIRS))
    for changed in ({"ball": ["a", "", "x"]}, {"amplitude": [1.0, 2.0, 0.25]}, {"n": [1, 2, 3]}):
        assert one != GivenTable.from_table({**PAIRS, **changed})


@each_of(
    ("table", "message"),
    [
        ({"restitution": [0.5, 1.5], "amplitude": [1, 2]}, 'column "restitution", row 2 .* 1.5'),
        ({"restitution": [0.5]}, 'column "amplitude" is missing .* write amplitude as a number'),
        ({"restitution": [0.5, 0.6], "amplitude": [1.0]}, "its columns differ in length"),
        ({"restitution": 0.5, "amplitude": 1.0}, "2 mistakes"),
        ({"restitution": [0.5], "amplitude": [[2.0]]}, "must share a single dimension"),
        ({"restitution": [0.5], "amplitude": [2.0], "dt_min": [1]}, "the name of a variable"),
        ({"e": [0.5], "A": [2.0]}, 'did you mean "restitution"'),
        ({"restitution": [], "amplitude": []}, "has no rows"),
        ({"restitution": [0.5], "amplitude": [[1], [2, 3]]}, "is not a list of values"),
        (3, "design: an object of type int is not a table; give a pandas.DataFrame"),
        (pd.DataFrame([[0.5, 0.6]], columns=["restitution"] * 2), "appears twice"),
    ],
)
def test_mistakes_in_a_table_are_told(table, message):
    with pytest.raises(TableError, match=message) as caught:
        opened_columns(table)
    assert "sample." not in str(caught.value)


def test_masked_values_and_spreads_beside_a_table_are_refused():
    masked = {"restitution": np.ma.masked_less([0.1, 0.9], 0.5), "amplitude": [1.0, 2.0]}
    with pytest.raises(ParameterError, match=r"^restitution: "):
        opened_columns(masked)
    with pytest.raises(SpecError, match="because the table"):
        opened_columns(PAIRS, frequency=(1.0, 2.0))
    with pytest.raises(TableError, match='column "amplitude" is also fixed'):
        opened_columns(PAIRS, amplitude=1.0)
