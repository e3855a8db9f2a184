"""A finished result grows: the sweep with more realizations equals one computed at once."""

import tomllib

import numpy as np
import pytest
import xarray as xr

import vibrosweep as vs
from tests.runs.test_retry import SWEEP, bits, ending
from vibrosweep.errors import ExistingOutputError, Interruption
from vibrosweep.runs.chunks import in_process
from vibrosweep.runs.driver import run_sweep
from vibrosweep.scene.sweep import parse_spec
from vibrosweep.store.parts import run_directory


def sweep(realizations, design="uniform", budget=32):
    text = SWEEP.format(budget=budget, design=design, regimes="")
    return parse_spec(text.replace("realizations = 16", f"realizations = {realizations}"))


@pytest.fixture
def output(tmp_path):
    return tmp_path / "out.h5"


@pytest.mark.parametrize("design", ["uniform", "sobol"])
def test_the_result_is_that_of_the_larger_sweep(output, tmp_path, design):
    run_sweep(sweep(16, design), output, threads=1)
    told, rows = [], []

    def noting(job, indices, tick):
        rows.extend(job.rows)
        return in_process(1)(job, indices, tick)

    summary = run_sweep(
        sweep(37, design), output, threads=2, chunk=5, runner=noting,
        advance=lambda *now: told.append(now),
    )  # fmt: skip
    assert rows == list(range(16, 37))
    assert told[-1] == (21, 21)
    assert (summary.realizations, summary.kept) == (37, 16)
    run_sweep(sweep(37, design), tmp_path / "large.h5", threads=1)
    assert bits(output) == bits(tmp_path / "large.h5")
    attributes, large = (xr.open_dataset(path).attrs for path in (output, tmp_path / "large.h5"))
    for name in ("created", "threads", "cpu"):
        attributes.pop(name), large.pop(name)
    assert attributes == large
    assert not run_directory(output).exists()


def test_a_run_that_adds_realizations_and_is_ended_continues(output, tmp_path):
    run_sweep(sweep(16), output, threads=1)
    old = output.read_bytes()
    with pytest.raises(Interruption, match="2 of 4"):
        run_sweep(sweep(20), output, threads=1, chunk=1, runner=ending)
    assert output.read_bytes() == old
    assert run_sweep(sweep(20), output, threads=1).kept == 18
    run_sweep(sweep(20), tmp_path / "large.h5", threads=1)
    assert bits(output) == bits(tmp_path / "large.h5")


def test_what_a_killed_run_left_beside_the_grown_result_is_in_nobodys_way(output, monkeypatch):
    run_sweep(sweep(16), output, threads=1)
    for larger, then in ((20, 20), (24, 28)):  # opened, or grown once more
        with monkeypatch.context() as patch:
            patch.setattr("vibrosweep.runs.driver.abandon", lambda directory: 1 / 0)
            with pytest.raises(ZeroDivisionError):
                run_sweep(sweep(larger), output, threads=1)
        assert run_directory(output).exists()
        text = sweep(then).text
        with vs.run(tomllib.loads(text), output, progress=False) as found:
            assert found.sizes["realization"] == then
        assert not run_directory(output).exists()


def test_vs_run_grows_a_result_and_refuses_what_it_cannot_continue(output):
    asked = {"amplitude": (0.2, 3.5), "restitution": 0.9, "duration": 3.0}
    for realizations in (4, 9):
        with vs.run({**asked, "realizations": realizations}, output, progress=False) as found:
            values = found.rebound_height_max.values
    direct = vs.sweep(**asked, realizations=9, progress=False)
    np.testing.assert_array_equal(values, direct.rebound_height_max)
    kept = output.read_bytes()
    for changed, words in (
        ({"realizations": 4}, "sample.realizations: was 9, is 4"),
        ({"realizations": 12, "seed": 1}, "sample.seed"),
        ({"realizations": 12, "duration": 4.0}, "duration"),
    ):
        with pytest.raises(ExistingOutputError, match=words):
            vs.run({**asked, **changed}, output, progress=False)
    assert output.read_bytes() == kept


def test_a_latin_hypercube_is_refused_with_the_reason(output):
    run_sweep(sweep(16, "latin"), output, threads=1)
    with pytest.raises(ExistingOutputError, match=r"Latin hypercube .* other points"):
        vs.run(tomllib.loads(sweep(20, "latin").text), output, progress=False)
