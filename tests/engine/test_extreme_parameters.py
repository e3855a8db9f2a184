"""Absurd parameters get a status, and harm no other realization."""

import numpy as np
import pytest
import xarray as xr

from vibrosweep.commands.describe import describe

TABLE = """restitution,amplitude,frequency
0.9,0.0,1.0
0.9,1e30,1e9
0.8,0.0,1.0
0.9,1.0,1e9
"""
ROWS = """
[scene]
particles = 2
duration = 1e7
launch = [0.0, 0.25]
[sample]
design = "table.csv"
[measure]
transient = 0.5
separation = true
per_particle = true
regimes = true
trust = true
"""


@pytest.mark.parametrize("chunk", [1, 2, None])
def test_absurd_rows_are_refused_and_harm_no_other(compute, tmp_path, chunk):
    (tmp_path / "table.csv").write_text(TABLE)
    mixed = xr.load_dataset(compute(ROWS, chunk=chunk))
    assert mixed["status"].values.tolist() == [0, 3, 0, 3]
    refused = mixed.isel(realization=[1, 3])
    measured = (n for n, v in refused.data_vars.items() if "realization" in v.dims)
    for name, variable in ((n, refused[n]) for n in measured):
        if name in ("status", "particle_status"):
            assert (variable == 3).all()
        elif variable.dtype.kind == "f":
            assert np.isnan(variable).all(), name
        else:
            assert (variable == -1).all(), name
            assert -1 in variable.attrs.get("flag_values", [-1])
    (tmp_path / "table.csv").write_text("restitution,amplitude,frequency\n0.9,0,1\n0.8,0,1\n")
    alone = xr.load_dataset(compute(ROWS))
    xr.testing.assert_identical(mixed.isel(realization=[0, 2]).drop_attrs(), alone.drop_attrs())


def test_a_retry_is_offered_for_those_that_a_larger_budget_may_complete(compute, tmp_path):
    (tmp_path / "table.csv").write_text(TABLE)
    lines = list(describe(compute(f"{ROWS}impact_budget = 3")))
    retry = "vibrosweep run --retry-failed --impact-budget N for 2 of them"
    assert f"realizations that did not complete: 4; {retry}" in lines


def test_refused_rows_are_listed_and_not_verified(compute, tmp_path):
    pytest.importorskip("flint")
    from vibrosweep.proof.verifying import verify

    (tmp_path / "table.csv").write_text(TABLE)
    path = compute(ROWS)
    lines = list(describe(path))
    assert (
        "realizations that did not complete: 2; a larger impact budget helps none of them" in lines
    )
    assert lines[-2].split()[:2] == ["1", "refused,"]
    assert lines[-2].endswith("restitution 0.9, amplitude 1e+30, frequency 1e+09")
    report = verify(path)
    assert report.passed
    assert [o.state.name for o in report.outcomes] == ["COMPARED", "NOT_COMPLETED"] * 2
