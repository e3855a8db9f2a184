"""Sweeps on Dask workers: the bytes of a local run, whatever dies."""

import builtins
import logging
import os
import re
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from vibrosweep.cli import main
from vibrosweep.errors import OutputError, RunError
from vibrosweep.runs import cluster
from vibrosweep.runs.driver import run_sweep
from vibrosweep.scene.sweep import parse_spec, read_spec
from vibrosweep.store.parts import Parts

distributed = pytest.importorskip("distributed")

SWEEP = """
title = "A sweep on a cluster"
[scene]
particles = 3
launch_velocity = 2.0
duration = 3.0
[sample]
design = "sobol"
realizations = 40
restitution = [0.8, 0.98]
amplitude = [0.2, 3.5]
[measure]
separation = true
per_particle = true
regimes = true
[record]
restitution = 0.9
amplitude = 1.2
"""


@pytest.fixture(scope="module")
def two():
    """Two worker processes."""
    with cluster.local_workers(2) as client:
        yield client


@pytest.fixture
def one():
    """A scheduler and a worker of one thread in this process."""
    with in_this_process(1) as running:
        yield running


def in_this_process(workers):
    return distributed.LocalCluster(
        n_workers=workers,
        threads_per_worker=1,
        processes=False,
        protocol="tcp",
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
        memory_limit=None,
    )


@pytest.fixture(scope="module")
def local(tmp_path_factory):
    """The result of a run without a cluster."""
    path = tmp_path_factory.mktemp("local") / "local.h5"
    run_sweep(parse_spec(SWEEP), path, threads=1)
    return xr.load_dataset(path)


def same_bytes(path, local):
    """Compare every variable of a result byte by byte."""
    found = xr.load_dataset(path)
    assert set(found.variables) == set(local.variables)
    for name, variable in local.variables.items():
        assert found[name].values.tobytes() == variable.values.tobytes(), name
    record = xr.load_dataset(path, group="record")
    assert np.nansum(record["landing_time"]) > 0
    return True


@pytest.mark.parametrize("chunk", [7, 1000])
def test_two_workers_give_the_bytes_of_a_local_run(two, local, tmp_path, chunk):
    ticks = []
    output = tmp_path / "out.h5"
    run_sweep(
        parse_spec(SWEEP),
        output,
        threads=1,
        chunk=chunk,
        runner=cluster.on_dask(two, cluster.LOCAL_ABSENCE),
        advance=lambda done, total: ticks.append((done, total)),
    )
    assert same_bytes(output, local)
    assert ticks[0] == (0, 40)
    assert ticks[-1] == (40, 40)
    assert len(ticks) == 1 + -(-40 // chunk)
    assert [path.name for path in tmp_path.iterdir()] == ["out.h5"]


def test_a_table_is_found_by_workers_elsewhere(two, tmp_path, monkeypatch):
    (tmp_path / "table.csv").write_text("restitution,amplitude\n0.9,1.2\n0.8,1.1\n")
    (tmp_path / "sweep.toml").write_text('title = "x"\n[sample]\ndesign = "table.csv"')
    monkeypatch.chdir(tmp_path)
    output = Path("out.h5")
    run_sweep(
        read_spec("sweep.toml"),
        output,
        threads=1,
        chunk=1,
        runner=cluster.on_dask(two, cluster.LOCAL_ABSENCE),
    )
    assert xr.load_dataset(output)["restitution"].values.tolist() == [0.9, 0.8]


def test_a_worker_that_is_killed_costs_its_chunk_only(two, local, tmp_path):
    """Every worker is killed once, each while it computes."""
    output = tmp_path / "out.h5"
    pids = set(two.run(os.getpid).values())
    assert len(pids) == 2
    killed = []

    def advance(done, total):
        if done >= 10 * (len(killed) + 1) and pids:
            killed.append(pids.pop())
            os.kill(killed[-1], signal.SIGKILL)

    run_sweep(
        parse_spec(SWEEP),
        output,
        threads=1,
        chunk=1,
        runner=cluster.on_dask(two, cluster.LOCAL_ABSENCE),
        advance=advance,
    )
    assert len(killed) == 2
    assert same_bytes(output, local)


def writing(client, write):
    """Return a runner whose workers write parts by ``write(self, index, columns)``."""

    class Writing(Parts):  # inside a function: Dask then sends its code to the workers
        pass

    Writing.write = write

    def run(job, indices, tick):
        parts = Writing(job.parts.directory, job.parts.manifest)
        return cluster.on_dask(client, cluster.LOCAL_ABSENCE)(
            replace(job, parts=parts), indices, tick
        )

    return run


@pytest.mark.weekly
def test_a_chunk_that_kills_every_worker_is_reported(two, tmp_path, monkeypatch):
    # Dask gives a chunk up after four deaths; starting workers is what takes the time.  After one,
    # it also gives up what else the dead worker had.
    monkeypatch.setattr(two.cluster.scheduler, "allowed_failures", 0)

    def deadly(parts, index, columns):
        if index == 3:
            os.kill(os.getpid(), signal.SIGKILL)
        Parts.write(parts, index, columns)

    with pytest.raises(
        RunError, match=r"of 6 chunks failed twice \(numbers .*3.*; .* died"
    ) as told:
        run_sweep(
            parse_spec(SWEEP),
            tmp_path / "out.h5",
            threads=1,
            chunk=7,
            runner=writing(two, deadly),
        )
    failed = int(re.search(r"(\d) of 6 chunks", str(told.value))[1])
    assert failed < 6
    assert len(list(tmp_path.glob("out.h5.parts/chunk-*.part"))) == 6 - failed


@pytest.mark.parametrize(
    ("error", "expected", "words"),
    [
        (ZeroDivisionError("no"), RunError, "6 of 6 chunks failed .*ZeroDivisionError: no"),
        (OutputError("the disk is full"), OutputError, "the disk is full"),
        (ModuleNotFoundError("No module"), RunError, "install the same version"),
    ],
)
def test_an_error_on_a_worker_is_reported(one, tmp_path, error, expected, words):
    def failing(parts, index, columns):
        raise error

    with cluster.connected(one.scheduler_address) as client, pytest.raises(expected, match=words):
        run_sweep(
            parse_spec(SWEEP),
            tmp_path / "out.h5",
            threads=1,
            chunk=7,
            runner=writing(client, failing),
        )
    assert not (tmp_path / "out.h5").exists()


def test_parts_on_another_file_system(one, tmp_path, monkeypatch):
    """The output of the worker is not seen here."""
    monkeypatch.setattr(cluster, "VISIBLE_WITHIN", 0.0)
    with (
        cluster.connected(one.scheduler_address) as client,
        pytest.raises(RunError, match=r"^.*: 6 parts .* one file system"),
    ):
        run_sweep(
            parse_spec(SWEEP),
            tmp_path / "out.h5",
            threads=1,
            chunk=7,
            runner=writing(client, lambda parts, index, columns: None),
        )


def test_a_scheduler_that_dies(local, tmp_path, monkeypatch):
    """The run ends with one message; the same command without the cluster finishes it."""
    monkeypatch.setattr(cluster, "PATIENCE", 2)
    (tmp_path / "sweep.toml").write_text(SWEEP)
    script = """
import sys, time
import distributed
cluster = distributed.LocalCluster(n_workers=1, threads_per_worker=1, processes=False,
    protocol="tcp", host="127.0.0.1", dashboard_address="127.0.0.1:0", memory_limit=None)
print(cluster.scheduler_address, flush=True)
time.sleep(60)
"""
    scheduler = subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    output = tmp_path / "out.h5"

    def advance(done, total):
        if done >= 5:
            scheduler.kill()
            scheduler.wait()

    spec = read_spec(tmp_path / "sweep.toml")
    with (
        cluster.connected(scheduler.stdout.readline().strip()) as client,
        pytest.raises(RunError, match=r"scheduler .* \d+ of 40"),
    ):
        run_sweep(
            spec,
            output,
            threads=1,
            chunk=1,
            runner=cluster.on_dask(client, cluster.LOCAL_ABSENCE),
            advance=advance,
        )
    scheduler.stdout.close()
    kept = len(list(tmp_path.glob("out.h5.parts/chunk-*.part")))
    assert 5 <= kept < 40
    done = []
    run_sweep(spec, output, threads=1, advance=lambda number, total: done.append(number))
    assert done[0] == kept
    assert same_bytes(output, local)


def test_a_run_whose_workers_have_all_gone_ends(one, local, tmp_path):
    """The message says what is kept; the same call without the cluster finishes the run."""

    def advance(done, total):
        if done >= 5:
            one.scale(0)

    output = tmp_path / "out.h5"
    words = r"all workers .* are gone, .* for 1 s; (\d+) of 40 chunks .* saved in .* again"
    with cluster.connected(one.scheduler_address) as client:
        runner = cluster.on_dask(client, absence=1.0)
        with pytest.raises(RunError, match=words) as error:
            run_sweep(parse_spec(SWEEP), output, threads=1, chunk=1, runner=runner, advance=advance)
    kept = len(list(tmp_path.glob("out.h5.parts/chunk-*.part")))
    assert 5 <= kept < 40
    assert f"; {kept} of 40" in str(error.value)
    done = []
    run_sweep(parse_spec(SWEEP), output, threads=1, advance=lambda now, total: done.append(now))
    assert done[0] == kept
    assert same_bytes(output, local)


def test_a_run_waits_for_its_first_worker(local, tmp_path):
    """Jobs of a batch system start late: the limit applies only once there have been workers."""
    output = tmp_path / "out.h5"
    with in_this_process(0) as late, cluster.connected(late.scheduler_address) as client:
        starting = threading.Timer(2 * cluster.LOOK, late.scale, [1])
        starting.start()
        runner = cluster.on_dask(client, absence=0.0)
        run_sweep(parse_spec(SWEEP), output, threads=1, chunk=7, runner=runner)
        starting.join()
    assert same_bytes(output, local)


def test_the_command(tmp_path, local, capsys, one):
    (tmp_path / "sweep.toml").write_text(SWEEP)
    output = tmp_path / "out.h5"
    words = ["run", str(tmp_path / "sweep.toml"), "-o", str(output)]
    assert main([*words, "--scheduler", one.scheduler_address]) == 0
    out, messages = capsys.readouterr()
    assert f"on the workers of {one.scheduler_address}\n" in out
    assert messages == ""
    assert same_bytes(output, local)


def any_left(group):
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_the_command_interrupted_from_a_terminal(tmp_path):
    """Ctrl-C reaches all processes of a terminal: one message, no process left, chunks kept."""
    (tmp_path / "sweep.toml").write_text(
        SWEEP.replace("= 40", "= 1_000_000").replace("sobol", "uniform")
    )
    command = "import sys; from vibrosweep.cli import main; sys.exit(main())"
    process = subprocess.Popen(
        [sys.executable, "-c", command, "run", "sweep.toml", "--workers", "1", "--chunk", "100"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(cluster.__file__).parents[2])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    until = time.monotonic() + 60
    try:
        while len(list(tmp_path.glob("sweep.h5.parts/chunk-*.part"))) < 2:
            assert time.monotonic() < until
            assert process.poll() is None, process.stderr.read()
            time.sleep(0.1)
        os.killpg(process.pid, signal.SIGINT)
        messages = process.communicate(timeout=60)[1]
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
    assert process.returncode == 130
    assert messages.count("\n") == 1
    assert messages.startswith("vibrosweep: interrupted; ")
    while any_left(process.pid):
        assert time.monotonic() < until
        time.sleep(0.1)
    assert len(list(tmp_path.glob("sweep.h5.parts/chunk-*.part"))) >= 2


@pytest.mark.parametrize(
    ("address", "reason"), [("nonsense", "missing port"), ("tcp://127.0.0.1:9", "Timed out")]
)
def test_no_scheduler_answers(monkeypatch, capsys, tmp_path, address, reason):
    monkeypatch.setattr(cluster, "PATIENCE", 1)
    (tmp_path / "sweep.toml").write_text(SWEEP)
    words = ["run", str(tmp_path / "sweep.toml"), "-o", str(tmp_path / "out.h5")]
    assert main([*words, "--scheduler", address]) == 2
    message = capsys.readouterr().err
    assert message.startswith(f"vibrosweep: no Dask scheduler answers at {address} ({reason}")
    assert [path.name for path in tmp_path.iterdir()] == ["sweep.toml"]


def test_without_dask_one_message_says_what_to_install(monkeypatch, capsys, tmp_path):
    real = builtins.__import__

    def without(name, *arguments):
        if name in ("dask", "distributed"):
            raise ImportError(name)
        return real(name, *arguments)

    monkeypatch.setattr(builtins, "__import__", without)
    (tmp_path / "sweep.toml").write_text(SWEEP)
    words = ["run", str(tmp_path / "sweep.toml"), "-o", str(tmp_path / "out.h5")]
    assert main([*words, "--workers", "2"]) == 2
    assert 'pip install "vibrosweep[cluster]"' in capsys.readouterr().err


def test_logs_of_dask_are_silent_only_while_connected(one):
    handlers = logging.getLogger("distributed").handlers
    before = [handler.level for handler in handlers]
    with cluster.connected(one.scheduler_address):
        assert all(handler.level > logging.CRITICAL for handler in handlers)
    assert [handler.level for handler in handlers] == before
