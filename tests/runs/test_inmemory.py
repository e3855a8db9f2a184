"""A result in memory: values that were not computed are never filled in."""

import numpy as np
import pytest

from vibrosweep import sweep
from vibrosweep.errors import RunError
from vibrosweep.model.measures import VARIABLES, Status
from vibrosweep.runs import driver
from vibrosweep.runs.driver import InMemory


@pytest.mark.parametrize("rows", [0, 3])
@pytest.mark.parametrize("name", ["impact_count", "dt_min", "status", "restitution"])
def test_a_result_in_which_values_are_missing_is_refused(name, rows):
    found = InMemory()
    found.dimensions({"realization": 4})
    found.coordinate("restitution", ("realization",), {})
    for variable in ("impact_count", "dt_min", "status"):
        found.variable(VARIABLES[variable])
    for other in {"impact_count", "dt_min", "status", "restitution"} - {name}:
        found.write(other, 0, np.ones(4))
    found.write(name, 0, np.ones(rows))
    assert found.awaits(name)
    with pytest.raises(RunError, match=f"the result: {name}: rows are missing"):
        found.dataset()
    found.write(name, rows, np.ones(4 - rows))
    assert not found.awaits(name)
    assert found.dataset()[name].values.tolist() == [1.0] * 4


@pytest.mark.parametrize("name", sorted(VARIABLES))
def test_every_variable_begins_with_its_code_for_no_value(name, monkeypatch):
    memory = np.empty  # the memory that it returns may still hold old numbers
    monkeypatch.setattr(np, "empty", lambda *a, **k: np.full_like(memory(*a, **k), 1))
    found, variable = InMemory(), VARIABLES[name]
    found.dimensions({"realization": 2, "particle": 3})
    found.coordinate("amplitude", ("realization",), {})
    found.variable(variable)
    values, amplitude = (found._arrays[one][1] for one in (name, "amplitude"))
    assert np.isnan(amplitude).all()
    if variable.dtype == "float64":
        assert np.isnan(values).all()
    else:
        codes = dict(variable.flags) or {-1: ""}
        assert (values == (-1 if -1 in codes else Status.REFUSED)).all()


@pytest.mark.parametrize("grid", [False, True])
def test_a_sweep_that_loses_rows_or_columns_gives_no_result(grid, monkeypatch):
    real = driver.compute_rows
    asks = {"amplitude": [0.5, 1.0, 2.0], "duration": 3.0} if grid else {"realizations": 3}
    if not grid:
        asks |= {"amplitude": (0.5, 2.0)}

    def without_rows(*arguments):
        return ({n: v[:-1] for n, v in columns.items()} for columns in real(*arguments))

    def without_a_column(*arguments):
        return (
            {n: v for n, v in columns.items() if n != "rest_count"} for columns in real(*arguments)
        )

    def without_pieces(*arguments):
        return iter(())

    for fault in (without_rows, without_a_column, without_pieces):
        monkeypatch.setattr(driver, "compute_rows", fault)
        with pytest.raises(RunError, match="please report it"):
            sweep(asks)
