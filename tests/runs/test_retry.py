"""Realizations that did not settle are computed again, as by a run with the larger budget."""

from dataclasses import fields

import numpy as np
import pytest
import xarray as xr

from vibrosweep.commands.describe import describe
from vibrosweep.errors import DataError, Interruption, RunError
from vibrosweep.model.observables import Measures
from vibrosweep.runs.chunks import in_process
from vibrosweep.runs.driver import retry_failed, run_sweep
from vibrosweep.runs.result import unsettled
from vibrosweep.scene.sweep import parse_spec, read_spec
from vibrosweep.store.parts import run_directory

SWEEP = """title = "Some particles bounce on small kicks for long"
[scene]
particles = 2
[sample]
design = "{design}"
realizations = 16
amplitude = [0.001, 3.0]
restitution = [0.5, 0.99]
[measure]
separation = true
{regimes}
impact_budget = {budget}
[record]
amplitude = 1.2
restitution = 0.9
"""


@pytest.fixture
def sweep(tmp_path):
    def spec(budget, design="uniform", regimes=""):
        path = tmp_path / f"{budget}.toml"
        path.write_text(SWEEP.format(budget=budget, design=design, regimes=regimes))
        return read_spec(path)

    return spec


@pytest.fixture
def output(tmp_path):
    return tmp_path / "out.h5"


def bits(path):
    found = {}
    for group in (None, "record"):
        with xr.open_dataset(path, group=group) as result:
            found |= {(group, n): v.values.tobytes() for n, v in result.variables.items()}
    return found


@pytest.mark.parametrize(
    ("design", "regimes"), [("uniform", "regimes = true"), ("sobol", ""), ("latin", "")]
)
def test_the_result_is_that_of_the_larger_budget(sweep, output, tmp_path, design, regimes):
    small, large = (sweep(budget, design, regimes) for budget in (32, 1000))
    run_sweep(small, output, threads=1)
    failed = int(np.sum(xr.load_dataset(output)["base_shared"] == -1))
    assert 0 < failed < 16
    run_sweep(large, tmp_path / "large.h5", threads=1)
    summary, again = retry_failed(small, output, threads=2, impact_budget=1000, chunk=3)
    assert again == failed
    assert summary.realizations == 16
    assert bits(output) == bits(tmp_path / "large.h5")
    attributes = xr.open_dataset(output).attrs
    assert attributes["impact_budget"] == 1000
    assert not run_directory(output).exists()
    # also by the sweep file with the new budget
    summary, again = retry_failed(large, output, threads=1)
    left = int(np.sum(xr.load_dataset(output)["base_shared"] == -1))
    assert again == left
    assert summary.landings == int(xr.load_dataset(output)["impact_count"].sum())


def test_only_what_failed_is_computed(sweep, output):
    run_sweep(sweep(32), output, threads=1)
    status = xr.load_dataset(output)["status"].values
    told, rows = [], []

    def noting(job, indices, tick):
        rows.extend(job.rows)
        return in_process(1)(job, indices, tick)

    retry_failed(
        sweep(32),
        output,
        threads=1,
        impact_budget=1000,
        runner=noting,
        advance=lambda *now: told.append(now),
    )
    assert rows == np.flatnonzero(status).tolist()
    assert told[-1] == (len(rows), len(rows))


def ending(job, indices, tick):
    in_process(1)(job, indices[:2], tick)
    raise KeyboardInterrupt


@pytest.mark.parametrize("force", [False, True])
def test_an_unfinished_run_is_not_retried(sweep, output, force):
    with pytest.raises(Interruption, match="2 of"):
        run_sweep(sweep(32), output, threads=1, chunk=1, runner=ending)
    with pytest.raises(RunError, match="is not finished"):
        retry_failed(sweep(32), output, threads=1, impact_budget=1000, force=force)
    assert len(list(run_directory(output).glob("*.part"))) == 2


def test_a_retry_that_is_ended_continues(sweep, output, tmp_path):
    run_sweep(sweep(32), output, threads=1)
    old = output.read_bytes()
    with pytest.raises(Interruption, match="2 of"):
        retry_failed(sweep(32), output, threads=1, impact_budget=1000, chunk=1, runner=ending)
    assert output.read_bytes() == old
    with pytest.raises(RunError, match=r"rows computed again: was \d+ "):
        run_sweep(sweep(1000), output, threads=1)
    told = []
    retry_failed(
        sweep(32), output, threads=1, impact_budget=1000, advance=lambda *now: told.append(now)
    )
    assert told[0][0] == 2
    run_sweep(sweep(1000), tmp_path / "large.h5", threads=1)
    assert bits(output) == bits(tmp_path / "large.h5")


@pytest.mark.parametrize("budget", [1000, 64])
def test_a_retry_that_is_killed_after_its_result_had_its_name(sweep, output, monkeypatch, budget):
    """The next retry leaves the same result, whether or not the new budget settled all."""
    run_sweep(sweep(32), output, threads=1)
    with monkeypatch.context() as patch:
        patch.setattr("vibrosweep.runs.driver.abandon", lambda directory: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            retry_failed(sweep(32), output, threads=1, impact_budget=budget)
    made = bits(output)
    assert run_directory(output).exists()
    _, again = retry_failed(sweep(32), output, threads=1, impact_budget=budget)
    assert again == np.sum(unsettled(xr.load_dataset(output)))
    assert bits(output) == made
    assert not run_directory(output).exists()


def test_a_retry_of_a_run_that_was_killed_after_its_result_had_its_name(sweep, output, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setattr("vibrosweep.runs.driver.abandon", lambda directory: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            run_sweep(sweep(32), output, threads=1, chunk=2)
    assert run_directory(output).exists()
    retry_failed(sweep(32), output, threads=1, impact_budget=1000)
    assert not run_directory(output).exists()


def test_a_retry_by_another_sweep_is_refused(sweep, output, tmp_path):
    with pytest.raises(DataError, match="no such result"):
        retry_failed(sweep(32), output, threads=1)
    run_sweep(sweep(32), output, threads=1)
    with pytest.raises(RunError, match=r"\n  sample.design: was uniform"):
        retry_failed(sweep(64, "sobol"), output, threads=1)
    with pytest.raises(RunError, match="impact_budget="):
        retry_failed(sweep(8), output, threads=1)
    with xr.load_dataset(output) as result:
        result.to_netcdf(tmp_path / "foreign.h5", engine="h5netcdf")
    with pytest.raises(DataError, match="not a result"):
        retry_failed(sweep(32), tmp_path / "foreign.h5", threads=1)
    assert not run_directory(output).exists()


LONG = """title = "Bounds that a small budget does not carry to the end"
[scene]
duration = 1000.0
[sample]
realizations = 12
amplitude = [1.19, 1.21]
restitution = [0.8, 0.95]
[measure]
trust = true
{other}
impact_budget = {budget}
"""


@pytest.mark.parametrize("other", ["", "regimes = true\nlyapunov = true\nper_particle = true"])
def test_bounds_that_the_budget_cut_off_are_reported_and_computed_again(tmp_path, output, other):
    """Error bounds follow every landing, even of an orbit that a cycle completes early."""
    small, large = (parse_spec(LONG.format(budget=budget, other=other)) for budget in (300, 10**6))
    run_sweep(small, output, threads=1)
    before = xr.load_dataset(output)
    cut = np.isnan(before["landing_time_error"]).values
    completed = (before["status"] == 0).values
    assert (cut & completed).sum() > 3
    assert (before["trusted_until"].values[cut] < 1000.0).all()
    listed = [line for line in describe(output) if "error bounds undetermined" in line]
    assert len(listed) == (cut & completed).sum()
    run_sweep(large, tmp_path / "large.h5", threads=1)
    _, again = retry_failed(small, output, threads=1, impact_budget=10**6)
    assert again == (cut | ~completed).sum()
    assert not np.isnan(xr.load_dataset(output)["landing_time_error"]).any()
    xr.testing.assert_identical(
        xr.load_dataset(output).drop_attrs(), xr.load_dataset(tmp_path / "large.h5").drop_attrs()
    )


def test_a_retry_with_any_other_measure_is_refused(tmp_path, output):
    run_sweep(parse_spec(LONG.format(budget=300, other="")), output, threads=1)
    for field in fields(Measures):
        if field.name == "impact_budget" or not field.metadata:
            continue
        spec = parse_spec(LONG.format(budget=300, other=""))
        value = getattr(spec.scene.measures, field.name)
        other = {field.name: not value if isinstance(value, bool) else value + 1}
        spec = spec.with_measures(**other)
        with pytest.raises(RunError, match=rf"\n  measure.{field.name}: "):
            retry_failed(spec, output, threads=1, impact_budget=1000)


def test_a_record_that_alone_lacks_landings_is_computed_again(tmp_path, output):
    def spec(budget):
        return parse_spec(
            'title = "Only the record is long"\n[scene]\nparticles = 2\nduration = 2.0\n'
            "[sample]\nrealizations = 5\nrestitution = [0.5, 0.9]\n"
            f"[measure]\nimpact_budget = {budget}\n[record]\nrestitution = 0.9\nduration = 100.0\n"
        )

    whole = tmp_path / "whole.h5"
    run_sweep(spec(10_000), whole, threads=1)
    run_sweep(spec(36), output, threads=1)
    with xr.open_dataset(output) as result, xr.open_dataset(output, group="record") as record:
        assert (result.status == 0).all()
        assert (record.status != 0).any()
    retry_failed(spec(36), output, threads=1, impact_budget=10_000)
    assert bits(output) == bits(whole)
