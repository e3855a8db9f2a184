"""Runs that are interrupted or fail."""

import errno
import os
import shutil
import tomllib
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import fields
from multiprocessing import get_context

import numpy as np
import pytest
import xarray as xr

import vibrosweep
import vibrosweep as vs
from vibrosweep.cli import main
from vibrosweep.commands.describe import describe
from vibrosweep.engine import measure as engine
from vibrosweep.errors import DataError, ExistingOutputError, Interruption, OutputError, RunError
from vibrosweep.model.observables import Measures
from vibrosweep.runs import chunks, result
from vibrosweep.runs.chunks import in_process
from vibrosweep.runs.driver import retry_failed, run_sweep
from vibrosweep.runs.result import unsettled
from vibrosweep.scene.sweep import parse_spec, read_spec
from vibrosweep.store.disk import Disk
from vibrosweep.store.parts import Parts, holding, read_manifest, run_directory

# Finished chunks survive any end of a run, and nothing wrong is kept with them.

SWEEP = """title = "A sweep of a test"
[scene]
particles = 3
duration = 4.0
[sample]
seed = 3
realizations = 11
restitution = [0.8, 0.98]
frequency = [0.5, 3.0]
[measure]
separation = true
[record]
restitution = 0.9
frequency = 1.0
"""
CHUNKS = 6  # of two realizations


class Killed(BaseException):
    """The process ends here."""


@pytest.fixture
def sweep_survival(tmp_path, monkeypatch):
    """Run the sweep in chunks of two; the time and the threads in the file are fixed."""
    monkeypatch.setattr(result, "provenance", lambda threads: {"threads": 1})

    def compute(text=SWEEP, output="out.h5", **options):
        spec = tmp_path / "sweep.toml"
        spec.write_text(text)
        return run_sweep(
            read_spec(spec), tmp_path / output, **({"threads": 1, "chunk": 2} | options)
        )

    return compute


@pytest.fixture
def expected(sweep_survival, tmp_path):
    """The bytes of the result of a run that nothing disturbs."""
    sweep_survival(output="whole.h5", chunk=None)
    return (tmp_path / "whole.h5").read_bytes()


@pytest.fixture
def computed():
    """Numbers of the chunks that runs with `noting` compute, in their order."""
    return []


def noting(numbers, threads=1):
    """Return a runner that notes the chunks which it computes."""

    def run(job, indices, tick):
        numbers.extend(indices)
        return chunks.in_process(threads)(job, indices, tick)

    return run


def ending(after, error):
    """Return a runner that ends with an error after some chunks."""

    def run(job, indices, tick):
        chunks.in_process(1)(job, indices[:after], tick)
        raise error

    return run


@contextmanager
def unfinished(sweep, after=3, error=Killed, **options):
    """End a run after some chunks."""
    with pytest.raises((error, Interruption)):
        sweep(runner=ending(after, error()), **options)
    yield


def parts(tmp_path):
    return sorted(p.name for p in run_directory(tmp_path / "out.h5").glob("chunk-*"))


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("chunk", [1, 7, 1000])
def test_the_same_file_however_it_is_cut(sweep_survival, expected, tmp_path, threads, chunk):
    sweep_survival(threads=threads, chunk=chunk)
    assert (tmp_path / "out.h5").read_bytes() == expected
    assert not run_directory(tmp_path / "out.h5").exists()


@pytest.mark.parametrize("after", [0, 3, CHUNKS - 1])
def test_a_run_continues_with_what_is_missing(sweep_survival, expected, computed, tmp_path, after):
    with unfinished(sweep_survival, after):
        assert len(parts(tmp_path)) == after
        assert not (tmp_path / "out.h5").exists()
    # other threads and chunks are asked for, but the run keeps its division into chunks
    told = []
    runner = noting(computed, threads=2)
    sweep_survival(threads=2, chunk=5, runner=runner, advance=lambda *now: told.append(now))
    assert computed == list(range(after, CHUNKS))
    assert told[0] == (2 * after, 11)
    assert told[-1] == (11, 11)
    assert (tmp_path / "out.h5").read_bytes() == expected
    assert not run_directory(tmp_path / "out.h5").exists()


def test_noise_is_the_same_however_a_run_is_cut_and_continued(sweep_survival, tmp_path):
    noise = "restitution_noise = 0.05\nkick_noise = 0.1\ndrive_noise = 0.4\nnoise_seed = 3\n"
    noisy = SWEEP.replace("[sample]", f"{noise}[sample]")
    sweep_survival(noisy, output="whole.h5", chunk=None)
    expected = (tmp_path / "whole.h5").read_bytes()
    with unfinished(sweep_survival, text=noisy):
        assert len(parts(tmp_path)) == 3
    sweep_survival(noisy, threads=2)
    assert (tmp_path / "out.h5").read_bytes() == expected


def test_an_interruption_says_what_is_kept(sweep_survival):
    runner = ending(2, KeyboardInterrupt())
    with pytest.raises(Interruption, match=r"2 of 6 chunks are finished.*same command again"):
        sweep_survival(runner=runner)
    with pytest.raises(Interruption, match=r"without force=True"):
        sweep_survival(runner=runner, force=True)


def test_a_replacing_run_continues_without_force(sweep_survival, expected, computed, tmp_path):
    old = tmp_path / "out.h5"
    old.write_bytes(b"old")
    with unfinished(sweep_survival, 4, force=True):
        assert old.read_bytes() == b"old"
    sweep_survival(runner=noting(computed))
    assert computed == [4, 5]
    assert old.read_bytes() == expected


def test_an_output_that_appeared_meanwhile_is_kept(sweep_survival, tmp_path):
    with unfinished(sweep_survival):
        (tmp_path / "out.h5").write_bytes(b"other")
    with pytest.raises(OutputError, match="was not replaced"):
        sweep_survival()
    assert len(parts(tmp_path)) == 3


@pytest.mark.parametrize("place", [0.0, 0.4, 0.999])
def test_a_flipped_bit_is_noticed(sweep_survival, expected, computed, tmp_path, place):
    with unfinished(sweep_survival, 5):
        directory = run_directory(tmp_path / "out.h5")
        path = directory / parts(tmp_path)[1]
        data = bytearray(path.read_bytes())
        data[int(place * len(data))] ^= 4
        path.write_bytes(data)
    summary = sweep_survival(runner=noting(computed))
    assert summary.repaired == 1
    assert computed == [5]
    assert (tmp_path / "out.h5").read_bytes() == expected


def test_a_disk_that_changes_its_data_is_reported(sweep_survival, tmp_path, monkeypatch):
    monkeypatch.setattr(Parts, "read", lambda *arguments: None)
    with pytest.raises(OutputError, match="damaged"):
        sweep_survival()
    assert not (tmp_path / "out.h5").exists()


# identity
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("particles = 3", "particles = 4", ["scene.particles: was 3, is 4"]),
        ("[0.8, 0.98]", "[0.8, 0.99]", ["restitution: was [0.8, 0.98], is [0.8, 0.99]"]),
        ("seed = 3\n", "", ["sample.seed: was 3, is 0"]),
        ("[record]\nrestitution = 0.9", "[record]\nrestitution = 0.91", ["record.restitution"]),
        (SWEEP[SWEEP.index("[record]") :], "", ["record.restitution: was 0.9, is not given"]),
        (
            "separation = true",
            "trust = true",
            ["measure.separation: was true, is false", "measure.trust: was false, is true"],
        ),
    ],
)
def test_a_changed_sweep_does_not_continue(sweep_survival, tmp_path, old, new, words):
    assert old in SWEEP
    with unfinished(sweep_survival):
        before = parts(tmp_path)
    with pytest.raises(RunError, match=r"3 of 6 chunks finished") as caught:
        sweep_survival(SWEEP.replace(old, new))
    lines = [line.strip() for line in str(caught.value).splitlines()]
    assert all(any(line.startswith(word) for line in lines) for word in words)
    assert "kernels" not in str(caught.value)
    assert "force=True" in lines[-1]
    assert parts(tmp_path) == before
    sweep_survival(SWEEP.replace(old, new), force=True)
    assert (tmp_path / "out.h5").exists()


def test_a_change_that_affects_no_number_does_not_prevent_continuing(
    sweep_survival, computed, tmp_path
):
    with unfinished(sweep_survival):
        text = "# a comment\n" + SWEEP.replace("[sample]", 'rebound = "rest"\n[sample]')
    sweep_survival(text, runner=noting(computed))
    assert computed == [3, 4, 5]
    assert xr.load_dataset(tmp_path / "out.h5").attrs["sweep_file"].startswith("# a comment")


@pytest.mark.parametrize("name", ["programs", "version"])
def test_another_version_does_not_continue(sweep_survival, tmp_path, monkeypatch, name):
    with unfinished(sweep_survival):
        monkeypatch.setattr(chunks, name, lambda *arguments: "another")
    with pytest.raises(RunError, match="is another"):
        sweep_survival()
    assert len(parts(tmp_path)) == 3


def test_the_contents_of_a_table_are_part_of_the_sweep(sweep_survival, tmp_path):
    table = tmp_path / "table.csv"
    rows = "restitution,amplitude\n" + "".join(f"0.9,{k}\n" for k in range(1, 9))
    text = 'title = "x"\n[sample]\ndesign = "table.csv"\n'
    table.write_text(rows)
    with unfinished(sweep_survival, text=text):
        table.write_text(rows.replace("0.9,8", "0.9,7"))
    with pytest.raises(RunError, match=r"table: was digest \w+, is digest \w+"):
        sweep_survival(text)
    table.write_text(rows)
    sweep_survival(text)
    assert xr.load_dataset(tmp_path / "out.h5")["amplitude"].values.tolist() == list(range(1, 9))


def test_a_table_that_changes_while_it_runs_is_noticed(sweep_survival, tmp_path):
    """As a worker on another machine may see it; here another process does."""
    (tmp_path / "table.csv").write_text("restitution,amplitude\n0.9,1\n0.9,2\n0.9,3\n")

    def elsewhere(job, numbers, tick):
        (tmp_path / "table.csv").write_text("restitution,amplitude\n0.9,1\n0.9,2\n0.9,4\n")
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as workers:
            workers.submit(chunks.compute_chunk, job, numbers[0], threads=1).result()

    with pytest.raises(RunError, match=r"another sweep.* table"):
        sweep_survival('title = "x"\n[sample]\ndesign = "table.csv"\n', runner=elsewhere)
    assert parts(tmp_path) == []


def test_two_runs_on_one_output(sweep_survival, expected, tmp_path):
    with (
        holding(tmp_path / "out.h5"),
        pytest.raises(RunError, match="another run"),
    ):
        sweep_survival(force=True)
    sweep_survival()
    assert (tmp_path / "out.h5").read_bytes() == expected


def test_a_damaged_manifest_needs_force(sweep_survival, expected, tmp_path):
    with unfinished(sweep_survival):
        (run_directory(tmp_path / "out.h5") / "manifest.json").write_bytes(b"{}")
    with pytest.raises(RunError, match=r"manifest.json: is damaged.*force=True"):
        sweep_survival()
    sweep_survival(force=True)
    assert (tmp_path / "out.h5").read_bytes() == expected


# failures
def test_a_chunk_that_fails_once_is_computed_again(sweep_survival, expected, tmp_path, monkeypatch):
    def measure(*arguments):
        failed.append(arguments)
        if len(failed) == 6:
            raise FloatingPointError("a moment")
        return original(*arguments)

    failed, original = [], engine.measure
    monkeypatch.setattr(engine, "measure", measure)
    sweep_survival()
    assert len(failed) > 6
    assert (tmp_path / "out.h5").read_bytes() == expected


@pytest.fixture
def failing(sweep_survival, tmp_path):
    """Make every batch that holds certain realizations fail, while a block lasts."""
    sweep_survival(output="column.h5")
    restitution = xr.load_dataset(tmp_path / "column.h5")["restitution"].values
    (tmp_path / "column.h5").unlink()

    @contextmanager
    def fail(*realizations, but_for=0):
        def measure(parameters, *rest):
            calls.append(parameters)
            if len(calls) > but_for and np.isin(parameters["restitution"], bad).any():
                raise FloatingPointError("always")
            return original(parameters, *rest)

        calls, original, bad = [], engine.measure, restitution[list(realizations)]
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(engine, "measure", measure)
            yield calls

    return fail


@pytest.mark.parametrize("pilot", [4, 0], ids=["planned", "unplanned"])
def test_a_chunk_that_fails_does_not_end_the_others(
    sweep_survival, expected, computed, failing, tmp_path, pilot
):
    with (
        failing(4, 9, but_for=pilot),
        pytest.raises(RunError, match=r"2 of 6 chunks failed twice \(numbers 2, 4; .*Floating"),
    ):
        sweep_survival()
    assert len(parts(tmp_path)) == 4
    assert not (tmp_path / "out.h5").exists()
    sweep_survival(runner=noting(computed))
    assert computed == [2, 4]
    assert (tmp_path / "out.h5").read_bytes() == expected


def test_a_sweep_of_one_chunk_that_fails(sweep_survival, failing, tmp_path):
    with failing(4, but_for=4), pytest.raises(RunError, match=r"failed twice after 0 of 11 .*Floa"):
        sweep_survival(chunk=11)
    assert {p.name for p in tmp_path.iterdir()} == {"sweep.toml"}


def test_a_sweep_whose_sample_fails_is_cut(sweep_survival, failing, tmp_path):
    with failing(3), pytest.raises(RunError, match=r"1 of 11 chunks failed twice \(numbers 3"):
        sweep_survival(chunk=None)
    assert len(parts(tmp_path)) == 10


@pytest.mark.parametrize("room", [1000, 12_000])
def test_a_full_disk_loses_nothing(sweep_survival, expected, computed, tmp_path, room, limited):
    """It fills up while parts are written, or while the result is."""
    with unfinished(sweep_survival):
        before = parts(tmp_path)
        largest = max(p.stat().st_size for p in run_directory(tmp_path / "out.h5").iterdir())
        assert 1000 < largest < 12_000 < len(expected)
    with limited(room), pytest.raises(OutputError, match=r"too large.*\d of 6 chunks are finished"):
        sweep_survival()
    assert set(before) <= set(parts(tmp_path))
    assert not (tmp_path / "out.h5").exists()
    assert not list(tmp_path.rglob("*.partial"))
    sweep_survival(runner=noting(computed))
    assert len(computed) == (3 if room == 1000 else 0)
    assert (tmp_path / "out.h5").read_bytes() == expected


def test_a_directory_that_becomes_read_only(sweep_survival, expected, computed, tmp_path):
    """Simulated, because the tests may run as a user whom no permission stops."""

    def refuse(self, partial, path):
        if partial.parent.suffix == ".parts" and len(parts(tmp_path)) == 4:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        original(self, partial, path)

    original = Disk.__init__
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Disk, "__init__", refuse)
        with pytest.raises(OutputError, match=r"Read-only file system.*4 of 6 chunks are finished"):
            sweep_survival()
    sweep_survival(runner=noting(computed))
    assert computed == [4, 5]
    assert (tmp_path / "out.h5").read_bytes() == expected


@pytest.mark.parametrize("what", ["out.h5.parts", "."])
def test_a_directory_that_is_removed(sweep_survival, expected, tmp_path, what):
    place = tmp_path / "place"
    place.mkdir()

    def removing(job, indices, tick):
        chunks.in_process(1)(job, indices[:3], tick)
        shutil.rmtree(place / what)
        return chunks.in_process(1)(job, indices[3:], tick)

    with pytest.raises(OutputError, match=r"was removed.* chunks were removed"):
        sweep_survival(output="place/out.h5", runner=removing)
    assert not run_directory(place / "out.h5").exists()
    place.mkdir(exist_ok=True)
    sweep_survival(output="place/out.h5")
    assert (place / "out.h5").read_bytes() == expected


LEFT = {
    "all": [],
    "no manifest": ["manifest.json"],
    "some parts": ["manifest.json", "chunk-0000000000*", "chunk-0000000003*"],
    "the lock": ["manifest.json", "chunk-*"],
}


@pytest.fixture
def left(sweep_survival, tmp_path):
    """Kill a run after its result got its name, and leave only these files in its directory."""

    def leave(kept, **options):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                "vibrosweep.runs.driver.abandon", lambda path: exec("raise Killed", globals())
            )
            with pytest.raises(Killed):
                sweep_survival(**options)
        directory = run_directory(tmp_path / "out.h5")
        for path in [path for pattern in LEFT[kept] for path in directory.glob(pattern)]:
            path.unlink()
        return directory

    return leave


@pytest.mark.parametrize("by", ["command", "python"])
@pytest.mark.parametrize("kept", LEFT)
def test_killed_after_the_result_had_its_name(left, expected, tmp_path, capsys, by, kept):
    """The same command again finds the result complete and clears away what is left."""
    directory = left(kept)
    spec, output = tmp_path / "sweep.toml", tmp_path / "out.h5"
    if kept == "all":
        assert len(parts(tmp_path)) == CHUNKS
    if by == "command":
        assert main(["run", str(spec), "-o", str(output)]) == 0
        assert "out.h5: is the finished result of exactly this sweep" in capsys.readouterr().out
    else:
        vibrosweep.run(spec, output).close()
    assert output.read_bytes() == expected
    assert not directory.exists()


def test_killed_after_a_result_was_replaced(left, sweep_survival, expected, tmp_path):
    (tmp_path / "out.h5").write_bytes(b"old")
    directory = left("all", force=True)
    sweep_survival()
    assert (tmp_path / "out.h5").read_bytes() == expected
    assert not directory.exists()


def test_an_unfinished_run_of_another_sweep_is_not_cleared_away(
    sweep_survival, expected, tmp_path, capsys
):
    spec, output = tmp_path / "sweep.toml", tmp_path / "out.h5"
    with unfinished(sweep_survival, text=SWEEP.replace("seed = 3", "seed = 4")):
        before = parts(tmp_path)
    output.write_bytes(expected)
    spec.write_text(SWEEP)
    assert main(["run", str(spec), "-o", str(output)]) == 2
    assert "is the finished result of exactly this sweep;" in capsys.readouterr().err
    assert parts(tmp_path) == before


def test_leftovers_that_cannot_be_cleared_away_do_no_harm(left, expected, tmp_path):
    directory = left("all")
    with holding(tmp_path / "out.h5"):
        vibrosweep.run(tmp_path / "sweep.toml", tmp_path / "out.h5").close()
    assert directory.exists()
    assert (tmp_path / "out.h5").read_bytes() == expected


def test_killed_while_the_parts_are_removed(sweep_survival, expected, computed, tmp_path):
    with unfinished(sweep_survival):
        (run_directory(tmp_path / "out.h5") / "manifest.json").unlink()
        assert len(parts(tmp_path)) == 3
    sweep_survival(runner=noting(computed))
    assert computed == list(range(CHUNKS))  # parts without a manifest are invalid
    assert read_manifest(run_directory(tmp_path / "out.h5")) is None
    assert (tmp_path / "out.h5").read_bytes() == expected


# columns
def another(value):
    """Another value of the type of a measure."""
    return str(not value).lower() if isinstance(value, bool) else repr(type(value)(value + 1))


# the keys of measures that a sweep over this base can have
OF_THIS_BASE = [
    field
    for field in fields(Measures)
    if field.metadata and not getattr(field.metadata["entry"], "coupled", None)
]


@pytest.mark.parametrize("field", OF_THIS_BASE, ids=lambda field: field.name)
def test_a_resume_with_any_other_measure_is_refused(sweep_survival, expected, tmp_path, field):
    text = f"{field.name} = {another(field.default)}\n"
    text = SWEEP.replace("separation = true\n", text if field.name != "separation" else "")
    with unfinished(sweep_survival):
        before = parts(tmp_path)
    with pytest.raises(RunError, match=f"\n  measure.{field.name}: was ") as caught:
        sweep_survival(text)
    assert "programs" not in str(caught.value)
    assert parts(tmp_path) == before
    sweep_survival()
    assert (tmp_path / "out.h5").read_bytes() == expected


@pytest.mark.parametrize("lost", ["dt_min", "restitution", "status"])
@pytest.mark.parametrize("chunk", [2, None])
def test_a_column_that_is_not_computed_is_never_filled(
    sweep_survival, tmp_path, monkeypatch, lost, chunk
):
    """A fault in the engine, or in the run that made some of the parts, would lose it."""

    def batch(*arguments):
        columns = original(*arguments)
        calls.append(columns)
        if len(calls) > 2:
            del columns[lost]
        return columns

    calls, original = [], chunks.compute_batch
    monkeypatch.setattr(chunks, "compute_batch", batch)
    monkeypatch.setattr(chunks, "TRAJECTORIES_PER_BATCH", 3)
    with pytest.raises(RunError, match=r"other columns|failed twice|not as the result"):
        sweep_survival(chunk=chunk)
    assert not (tmp_path / "out.h5").exists()


# Realizations that did not settle are computed again, as by a run with the larger budget.

SWEEP_RETRY = """title = "Some particles bounce on small kicks for long"
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
def sweep_retry(tmp_path):
    def spec(budget, design="uniform", regimes=""):
        path = tmp_path / f"{budget}.toml"
        path.write_text(SWEEP_RETRY.format(budget=budget, design=design, regimes=regimes))
        return read_spec(path)

    return spec


@pytest.fixture
def output_retry(tmp_path):
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
def test_the_result_is_that_of_the_larger_budget(
    sweep_retry, output_retry, tmp_path, design, regimes
):
    small, large = (sweep_retry(budget, design, regimes) for budget in (32, 1000))
    run_sweep(small, output_retry, threads=1)
    failed = int(np.sum(xr.load_dataset(output_retry)["base_shared"] == -1))
    assert 0 < failed < 16
    run_sweep(large, tmp_path / "large.h5", threads=1)
    summary, again = retry_failed(small, output_retry, threads=2, impact_budget=1000, chunk=3)
    assert again == failed
    assert summary.realizations == 16
    assert bits(output_retry) == bits(tmp_path / "large.h5")
    attributes = xr.open_dataset(output_retry).attrs
    assert attributes["impact_budget"] == 1000
    assert not run_directory(output_retry).exists()
    # also by the sweep file with the new budget
    summary, again = retry_failed(large, output_retry, threads=1)
    left = int(np.sum(xr.load_dataset(output_retry)["base_shared"] == -1))
    assert again == left
    assert summary.landings == int(xr.load_dataset(output_retry)["impact_count"].sum())


def test_only_what_failed_is_computed(sweep_retry, output_retry):
    run_sweep(sweep_retry(32), output_retry, threads=1)
    status = xr.load_dataset(output_retry)["status"].values
    told, rows = [], []

    def noting(job, indices, tick):
        rows.extend(job.rows)
        return in_process(1)(job, indices, tick)

    retry_failed(
        sweep_retry(32),
        output_retry,
        threads=1,
        impact_budget=1000,
        runner=noting,
        advance=lambda *now: told.append(now),
    )
    assert rows == np.flatnonzero(status).tolist()
    assert told[-1] == (len(rows), len(rows))


def ending_retry(job, indices, tick):
    in_process(1)(job, indices[:2], tick)
    raise KeyboardInterrupt


@pytest.mark.parametrize("force", [False, True])
def test_an_unfinished_run_is_not_retried(sweep_retry, output_retry, force):
    with pytest.raises(Interruption, match="2 of"):
        run_sweep(sweep_retry(32), output_retry, threads=1, chunk=1, runner=ending_retry)
    with pytest.raises(RunError, match="is not finished"):
        retry_failed(sweep_retry(32), output_retry, threads=1, impact_budget=1000, force=force)
    assert len(list(run_directory(output_retry).glob("*.part"))) == 2


def test_a_retry_that_is_ended_continues(sweep_retry, output_retry, tmp_path):
    run_sweep(sweep_retry(32), output_retry, threads=1)
    old = output_retry.read_bytes()
    with pytest.raises(Interruption, match="2 of"):
        retry_failed(
            sweep_retry(32),
            output_retry,
            threads=1,
            impact_budget=1000,
            chunk=1,
            runner=ending_retry,
        )
    assert output_retry.read_bytes() == old
    with pytest.raises(RunError, match=r"rows computed again: was \d+ "):
        run_sweep(sweep_retry(1000), output_retry, threads=1)
    told = []
    retry_failed(
        sweep_retry(32),
        output_retry,
        threads=1,
        impact_budget=1000,
        advance=lambda *now: told.append(now),
    )
    assert told[0][0] == 2
    run_sweep(sweep_retry(1000), tmp_path / "large.h5", threads=1)
    assert bits(output_retry) == bits(tmp_path / "large.h5")


@pytest.mark.parametrize("budget", [1000, 64])
def test_a_retry_that_is_killed_after_its_result_had_its_name(
    sweep_retry, output_retry, monkeypatch, budget
):
    """The next retry leaves the same result, whether or not the new budget settled all."""
    run_sweep(sweep_retry(32), output_retry, threads=1)
    with monkeypatch.context() as patch:
        patch.setattr("vibrosweep.runs.driver.abandon", lambda directory: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            retry_failed(sweep_retry(32), output_retry, threads=1, impact_budget=budget)
    made = bits(output_retry)
    assert run_directory(output_retry).exists()
    _, again = retry_failed(sweep_retry(32), output_retry, threads=1, impact_budget=budget)
    assert again == np.sum(unsettled(xr.load_dataset(output_retry)))
    assert bits(output_retry) == made
    assert not run_directory(output_retry).exists()


def test_a_retry_of_a_run_that_was_killed_after_its_result_had_its_name(
    sweep_retry, output_retry, monkeypatch
):
    with monkeypatch.context() as patch:
        patch.setattr("vibrosweep.runs.driver.abandon", lambda directory: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            run_sweep(sweep_retry(32), output_retry, threads=1, chunk=2)
    assert run_directory(output_retry).exists()
    retry_failed(sweep_retry(32), output_retry, threads=1, impact_budget=1000)
    assert not run_directory(output_retry).exists()


def test_a_retry_by_another_sweep_is_refused(sweep_retry, output_retry, tmp_path):
    with pytest.raises(DataError, match="no such result"):
        retry_failed(sweep_retry(32), output_retry, threads=1)
    run_sweep(sweep_retry(32), output_retry, threads=1)
    with pytest.raises(RunError, match=r"\n  sample.design: was uniform"):
        retry_failed(sweep_retry(64, "sobol"), output_retry, threads=1)
    with pytest.raises(RunError, match="impact_budget="):
        retry_failed(sweep_retry(8), output_retry, threads=1)
    with xr.load_dataset(output_retry) as result:
        result.to_netcdf(tmp_path / "foreign.h5", engine="h5netcdf")
    with pytest.raises(DataError, match="not a result"):
        retry_failed(sweep_retry(32), tmp_path / "foreign.h5", threads=1)
    assert not run_directory(output_retry).exists()


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
def test_bounds_that_the_budget_cut_off_are_reported_and_computed_again(
    tmp_path, output_retry, other
):
    """Error bounds follow every landing, even of an orbit that a cycle completes early."""
    small, large = (parse_spec(LONG.format(budget=budget, other=other)) for budget in (300, 10**6))
    run_sweep(small, output_retry, threads=1)
    before = xr.load_dataset(output_retry)
    cut = np.isnan(before["landing_time_error"]).values
    completed = (before["status"] == 0).values
    assert (cut & completed).sum() > 3
    assert (before["trusted_until"].values[cut] < 1000.0).all()
    listed = [line for line in describe(output_retry) if "error bounds undetermined" in line]
    assert len(listed) == (cut & completed).sum()
    run_sweep(large, tmp_path / "large.h5", threads=1)
    _, again = retry_failed(small, output_retry, threads=1, impact_budget=10**6)
    assert again == (cut | ~completed).sum()
    assert not np.isnan(xr.load_dataset(output_retry)["landing_time_error"]).any()
    xr.testing.assert_identical(
        xr.load_dataset(output_retry).drop_attrs(),
        xr.load_dataset(tmp_path / "large.h5").drop_attrs(),
    )


def test_a_retry_with_any_other_measure_is_refused(tmp_path, output_retry):
    run_sweep(parse_spec(LONG.format(budget=300, other="")), output_retry, threads=1)
    for field in fields(Measures):
        if field.name == "impact_budget" or not field.metadata:
            continue
        spec = parse_spec(LONG.format(budget=300, other=""))
        value = getattr(spec.scene.measures, field.name)
        other = {field.name: not value if isinstance(value, bool) else value + 1}
        spec = spec.with_measures(**other)
        with pytest.raises(RunError, match=rf"\n  measure.{field.name}: "):
            retry_failed(spec, output_retry, threads=1, impact_budget=1000)


def test_a_record_that_alone_lacks_landings_is_computed_again(tmp_path, output_retry):
    def spec(budget):
        return parse_spec(
            'title = "Only the record is long"\n[scene]\nparticles = 2\nduration = 2.0\n'
            "[sample]\nrealizations = 5\nrestitution = [0.5, 0.9]\n"
            f"[measure]\nimpact_budget = {budget}\n[record]\nrestitution = 0.9\nduration = 100.0\n"
        )

    whole = tmp_path / "whole.h5"
    run_sweep(spec(10_000), whole, threads=1)
    run_sweep(spec(36), output_retry, threads=1)
    with (
        xr.open_dataset(output_retry) as result,
        xr.open_dataset(output_retry, group="record") as record,
    ):
        assert (result.status == 0).all()
        assert (record.status != 0).any()
    retry_failed(spec(36), output_retry, threads=1, impact_budget=10_000)
    assert bits(output_retry) == bits(whole)


# A finished result grows: the sweep with more realizations equals one computed at once.


def grown(realizations, design="uniform", budget=32):
    text = SWEEP_RETRY.format(budget=budget, design=design, regimes="")
    return parse_spec(text.replace("realizations = 16", f"realizations = {realizations}"))


@pytest.mark.parametrize("design", ["uniform", "sobol"])
def test_the_result_is_that_of_the_larger_sweep(output_retry, tmp_path, design):
    run_sweep(grown(16, design), output_retry, threads=1)
    told, rows = [], []

    def noting(job, indices, tick):
        rows.extend(job.rows)
        return in_process(1)(job, indices, tick)

    summary = run_sweep(
        grown(37, design), output_retry, threads=2, chunk=5, runner=noting,
        advance=lambda *now: told.append(now),
    )  # fmt: skip
    assert rows == list(range(16, 37))
    assert told[-1] == (21, 21)
    assert (summary.realizations, summary.kept) == (37, 16)
    run_sweep(grown(37, design), tmp_path / "large.h5", threads=1)
    assert bits(output_retry) == bits(tmp_path / "large.h5")
    attributes, large = (
        xr.open_dataset(path).attrs for path in (output_retry, tmp_path / "large.h5")
    )
    for name in ("created", "threads", "cpu"):
        attributes.pop(name), large.pop(name)
    assert attributes == large
    assert not run_directory(output_retry).exists()


def test_a_run_that_adds_realizations_and_is_ended_continues(output_retry, tmp_path):
    run_sweep(grown(16), output_retry, threads=1)
    old = output_retry.read_bytes()
    with pytest.raises(Interruption, match="2 of 4"):
        run_sweep(grown(20), output_retry, threads=1, chunk=1, runner=ending_retry)
    assert output_retry.read_bytes() == old
    assert run_sweep(grown(20), output_retry, threads=1).kept == 18
    run_sweep(grown(20), tmp_path / "large.h5", threads=1)
    assert bits(output_retry) == bits(tmp_path / "large.h5")


def test_what_a_killed_run_left_beside_the_grown_result_is_in_nobodys_way(
    output_retry, monkeypatch
):
    run_sweep(grown(16), output_retry, threads=1)
    for larger, then in ((20, 20), (24, 28)):  # opened, or grown once more
        with monkeypatch.context() as patch:
            patch.setattr("vibrosweep.runs.driver.abandon", lambda directory: 1 / 0)
            with pytest.raises(ZeroDivisionError):
                run_sweep(grown(larger), output_retry, threads=1)
        assert run_directory(output_retry).exists()
        text = grown(then).text
        with vs.run(tomllib.loads(text), output_retry, progress=False) as found:
            assert found.sizes["realization"] == then
        assert not run_directory(output_retry).exists()


def test_vs_run_grows_a_result_and_refuses_what_it_cannot_continue(output_retry):
    asked = {"amplitude": (0.2, 3.5), "restitution": 0.9, "duration": 3.0}
    for realizations in (4, 9):
        with vs.run({**asked, "realizations": realizations}, output_retry, progress=False) as found:
            values = found.rebound_height_max.values
    direct = vs.sweep(**asked, realizations=9, progress=False)
    np.testing.assert_array_equal(values, direct.rebound_height_max)
    kept = output_retry.read_bytes()
    for changed, words in (
        ({"realizations": 4}, "sample.realizations: was 9, is 4"),
        ({"realizations": 12, "seed": 1}, "sample.seed"),
        ({"realizations": 12, "duration": 4.0}, "duration"),
    ):
        with pytest.raises(ExistingOutputError, match=words):
            vs.run({**asked, **changed}, output_retry, progress=False)
    assert output_retry.read_bytes() == kept


def test_a_latin_hypercube_is_refused_with_the_reason(output_retry):
    run_sweep(grown(16, "latin"), output_retry, threads=1)
    with pytest.raises(ExistingOutputError, match=r"Latin hypercube .* other points"):
        vs.run(tomllib.loads(grown(20, "latin").text), output_retry, progress=False)
