"""Tables of realizations in memory: the same checks and results as for a file."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import vibrosweep as vs
from vibrosweep.errors import ExistingOutputError, ParameterError, SpecError, TableError
from vibrosweep.scene.design import GivenTable
from vibrosweep.scene.realizations import open_design
from vibrosweep.scene.sweep import keyword_spec, parse_spec

PAIRS = {"restitution": [0.5, 0.9, 0.7], "amplitude": [1.0, 2.0, 0.5], "ball": ["a", "", "b"]}


def opened(table, **keywords):
    return open_design(keyword_spec({"design": table, **keywords}))


def test_all_kinds_of_tables_give_the_same_design(tmp_path):
    frame = pd.DataFrame({**PAIRS, "ball": ["a", None, "b"]})
    frame.to_csv(tmp_path / "table.csv", index=False)
    dataset = xr.Dataset({name: ("run", values) for name, values in PAIRS.items()})
    tables = (PAIRS, frame, frame.set_index("ball"), dataset, str(tmp_path / "table.csv"))
    for table in tables:
        design = opened(table)
        assert design.realizations == 3
        taken = design.take(0, 3)
        assert taken["restitution"].tolist() == PAIRS["restitution"]
        assert taken["amplitude"].tolist() == PAIRS["amplitude"]
        assert design.labels["ball"].values.tolist() == PAIRS["ball"]


def test_units_of_a_dataset_are_converted():
    speed = ("run", [1000.0, 500.0], {"units": "mm s-1"})
    table = xr.Dataset({"restitution": ("run", [0.5, 0.6]), "amplitude": speed})
    assert opened(table).take(0, 2)["amplitude"].tolist() == [1.0, 0.5]


def test_a_grid_is_a_table_too():
    grid = xr.Dataset(coords={"restitution": [0.5, 0.6], "amplitude": [1.0, 2.0, 3.0]})
    taken = opened(grid).take(0, 6)
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


@pytest.mark.parametrize(
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
        opened(table)
    assert "sample." not in str(caught.value)


def test_masked_values_and_spreads_beside_a_table_are_refused():
    masked = {"restitution": np.ma.masked_less([0.1, 0.9], 0.5), "amplitude": [1.0, 2.0]}
    with pytest.raises(ParameterError, match=r"^restitution: "):
        opened(masked)
    with pytest.raises(SpecError, match="because the table"):
        opened(PAIRS, frequency=(1.0, 2.0))
    with pytest.raises(TableError, match='column "amplitude" is also fixed'):
        opened(PAIRS, amplitude=1.0)
