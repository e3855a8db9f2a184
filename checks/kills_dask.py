"""Kill Dask workers, and now and then the run itself, and count what is lost.

    python checks/kills_dask.py [--kills 100] [--workers 2] [--minutes 60] [--seed 1] [--write]

Like `kills.py`, with worker processes: after random times one of them is killed with SIGKILL, or,
one time in eight, the process that holds the scheduler and the run.  After that, or if the run has
ended because no workers were left, it is started again.  After each round the result must be that
of an undisturbed run without Dask, byte for byte apart from the time of its creation.
"""

from __future__ import annotations

import platform
import subprocess
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil

from accuracy import options_of, processor, show, table
from kills import CHUNK, CHUNKS, SWEEPS, contents, finished, killed, run_words
from vibrosweep.store.parts import run_directory

REPORT = Path(__file__).parent / "README.md"
# every landing is computed, for error bounds or coupled particles: a chunk takes a second
LONGER = {
    base: sweep.replace("duration_periods = 4.0", "duration_periods = 60.0")
    if base == "sprung"
    else sweep.replace("[scene]", "[scene]\nduration_periods = 400.0") + "trust = true\n"
    for base, sweep in SWEEPS.items()
}
CLIENT = 1 / 8  # share of the kills that hit the process of the run
STOPPED = (
    b"all workers of the Dask cluster are gone",
    b"run the same command again to continue",
)


@dataclass
class Findings:
    """Counts of a campaign."""

    workers: int = 0
    clients: int = 0
    stopped: int = 0
    rounds: int = 0
    chunks: int = 0
    lost: int = 0
    torn: int = 0
    different: int = 0

    @property
    def kills(self) -> int:
        return self.workers + self.clients

    @property
    def failures(self) -> int:
        return self.lost + self.torn + self.different


def workers_of(process: subprocess.Popen) -> list[psutil.Process]:
    try:
        children = psutil.Process(process.pid).children()
        return [child for child in children if "spawn_main" in " ".join(child.cmdline())]
    except psutil.Error:  # something has just ended
        return []


def disturbed(
    words: list[str], run: Path, findings: Findings, rng: np.random.Generator, until: float
) -> None:
    """Run a command and kill its workers until it ends or is killed itself.

    Workers are killed once they have finished a chunk: if one dies before all have started, the
    run ends with a message that says so.  Workers that Dask starts in their place may be killed as
    they start; if none is left, the run ends and says how to continue.
    """
    before = finished(run, run)[0].keys()
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        while True:
            try:
                _, message = process.communicate(timeout=rng.uniform(0.0, 4.0))
            except subprocess.TimeoutExpired:
                at_work = finished(run, run)[0].keys() - before
                if time.perf_counter() > until:
                    continue
                victims = workers_of(process) if at_work else []
                if rng.random() < CLIENT:
                    process.kill()
                    findings.clients += 1
                    return
                if victims:
                    with suppress(psutil.Error):  # it has just ended
                        victims[rng.integers(len(victims))].kill()
                        findings.workers += 1
                continue
            if process.returncode == 2 and all(part in message for part in STOPPED):
                findings.stopped += 1
            elif process.returncode:
                raise SystemExit(f"the run ended with {process.returncode}: {message.decode()}")
            return


def campaign(
    directory: Path, sweep: str, kills: int, workers: int, seed: int, seconds: float
) -> Findings:
    """Kill until the number of kills or the time is reached, and finish the last round."""
    until = time.perf_counter() + seconds
    rng = np.random.default_rng(seed)
    (directory / "sweep.toml").write_text(sweep, encoding="utf-8")
    output = directory / "out.h5"
    killed(run_words(directory, ["--threads", "1"]), 600.0)
    expected = contents(output)
    output.unlink()
    run = run_directory(output)
    findings, before = Findings(), set()
    while (findings.kills < kills and time.perf_counter() < until) or before:
        disturbed(run_words(directory, ["--workers", str(workers)]), run, findings, rng, until)
        found, torn = finished(run, output)
        findings.torn += torn
        if output.exists():
            findings.rounds += 1
            findings.chunks += CHUNKS - len(before)
            findings.different += contents(output) != expected
            output.unlink()
            before = set()
            continue
        findings.lost += len(before - set(found))
        findings.chunks += len(set(found) - before)
        before = set(found)
    return findings


def report(found: dict[str, Findings], workers: int, seconds: float, seed: int) -> str:
    each = found.values()
    rows = [
        ("SIGKILLs to workers", *(f.workers for f in each)),
        ("SIGKILLs to the run with its scheduler", *(f.clients for f in each)),
        ("runs that ended without workers and were continued", *(f.stopped for f in each)),
        (
            f"rounds, each of {CHUNKS} chunks of {CHUNK}, that reached their end",
            *(f.rounds for f in each),
        ),
        ("chunks finished", *(f.chunks for f in each)),
        ("finished chunks lost", *(f.lost for f in each)),
        ("torn or damaged files", *(f.torn for f in each)),
        (
            "results that differ from that of an undisturbed run without Dask",
            *(f.different for f in each),
        ),
    ]
    made = f"{workers} workers; Python {platform.python_version()}; {processor()}; seed {seed}"
    return f"{table(('base', *found), rows)}\n\n*{made}; {seconds:.0f} s.*"


def main() -> None:
    options = options_of(
        __doc__,
        kills=100,
        workers=2,
        minutes=60.0,
        seed=1,
    )
    began, found = time.perf_counter(), {}
    seconds = 60.0 * options.minutes / len(LONGER)
    for base, sweep in LONGER.items():
        with tempfile.TemporaryDirectory() as directory:
            found[base] = campaign(
                Path(directory), sweep, options.kills, options.workers, options.seed, seconds
            )
    text = report(found, options.workers, time.perf_counter() - began, options.seed)
    show(options, "kills on Dask", text, REPORT)
    raise SystemExit(1 if any(findings.failures for findings in found.values()) else 0)


if __name__ == "__main__":
    main()
