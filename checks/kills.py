"""Kill runs of a sweep at random moments, and count what is lost.

    python checks/kills.py [--kills 200] [--workers 0] [--minutes 60] [--seed 1] [--write]

A sweep of 60 chunks is started, killed with SIGKILL after a random time, and started again, until
it is complete; then the next round begins.  After every kill each part is read and its checksum
compared, and no part that was there before may be gone.  After every round the result must be that
of an undisturbed run on threads, byte for byte apart from the time of its creation.

With --workers, that many processes of Dask compute: after random times one of them is killed, or,
one time in eight, the process that holds the scheduler and the run, which is started again after
that, and if it has ended because no workers were left.
"""

from __future__ import annotations

import argparse
import platform
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import psutil

from accuracy import options_of, processor, show, table
from vibrosweep.store.disk import LENGTH
from vibrosweep.store.parts import Parts, read_manifest, run_directory

REPORT = Path(__file__).parent / "README.md"
COMMAND = (sys.executable, "-c", "import sys; from vibrosweep.cli import main; sys.exit(main())")
CHUNK, CHUNKS = 400, 60
SWEEP = f"""
title = "A sweep to be killed"
[scene]
particles = 20
[sample]
realizations = {CHUNK * CHUNKS}
seed = 1
restitution = [0.80, 0.98]
amplitude = [0.2, 3.5]
[measure]
separation = true
"""
SPRUNG = """[scene]
base = "sprung"
mass_ratio = 0.01
mount_frequency = 0.37
duration_periods = 4.0"""
SWEEPS = {
    "high-bounce": SWEEP,
    "moving": SWEEP.replace("[scene]", '[scene]\nbase = "moving"').replace(
        "amplitude = [0.2, 3.5]", "base_acceleration = [0.1, 5.0]"
    ),
    "noise": SWEEP.replace(
        "[scene]", "[scene]\nkick_noise = 0.05\nrestitution_noise = 0.02\ndrive_noise = 0.1"
    ),
    "sprung": SWEEP.replace("[scene]", SPRUNG).replace("particles = 20", "particles = 4"),
}
# For workers every landing is computed, for error bounds or coupled particles: a chunk takes a
# second
LONGER = {
    base: sweep.replace("duration_periods = 4.0", "duration_periods = 60.0")
    if base == "sprung"
    else sweep.replace("[scene]", "[scene]\nduration_periods = 400.0") + "trust = true\n"
    for base, sweep in SWEEPS.items()
}
RUN = 1 / 8  # share of the kills that hit the process of the run rather than a worker
STOPPED = (
    b"all workers of the Dask cluster are gone",
    b"run the same command again to continue",
)
PHASES = {
    "start": "... before the first new chunk was finished",
    "chunks": "... while chunks were computed",
    "result": "... while the result was written from the parts",
    "end": "... after the result had its name",
}
OF_WORKERS = {
    "workers": "SIGKILLs to workers",
    "stopped": "runs that ended without workers and were continued",
}
FAILURES = {
    "lost": "finished chunks lost",
    "torn": "torn or damaged files",
    "different": "results that differ from that of an undisturbed run",
}


def finished(directory: Path) -> tuple[dict[int, Path], int]:
    """Parts that are there, and how many of them are damaged."""
    manifest = read_manifest(directory) if directory.exists() else None
    if manifest is None:
        return {}, 0
    parts = Parts(directory, manifest)
    found = parts.finished()
    # a kill while parts are removed, after the result is complete, may leave any of them
    torn = sum(parts.read(index, path) is None for index, path in found.items())
    return found, torn


def contents(path: Path) -> bytes:
    """Bytes of a result without the time of its creation and the seal, which covers it."""
    with h5py.File(path) as file:
        created = file.attrs["created"]
    data = path.read_bytes()[:-LENGTH]
    assert data.count(created.encode()) == 1
    return data.replace(created.encode(), b"-" * len(created))


def workers_of(process: subprocess.Popen) -> list[psutil.Process]:
    try:
        children = psutil.Process(process.pid).children()
        return [child for child in children if "spawn_main" in " ".join(child.cmdline())]
    except psutil.Error:  # something has just ended
        return []


class Campaign:
    """Runs of one sweep in a directory, and the counts of what was killed and found."""

    def __init__(self, directory: Path, sweep: str, workers: int, seed: int) -> None:
        (directory / "sweep.toml").write_text(sweep, encoding="utf-8")
        self.output, self.workers = directory / "out.h5", workers
        self.parts = run_directory(self.output)
        self.rng, self.counts = np.random.default_rng(seed), Counter[str]()
        words = ["run", str(directory / "sweep.toml"), "-o", str(self.output)]
        self.words = [*COMMAND, *words, "--chunk", str(CHUNK)]
        began = time.perf_counter()
        subprocess.run(self.words, check=True, stdout=subprocess.DEVNULL)
        self.whole = time.perf_counter() - began
        self.expected = contents(self.output)
        self.output.unlink()

    @property
    def kills(self) -> int:
        """Number of kills until now."""
        return sum(self.counts[name] for name in (*PHASES, "workers"))

    def killed(self, until: float) -> bool:
        """Run the command, and kill it or its workers until a time; return if it was killed.

        Workers are killed once they have finished a chunk: if one dies before all have started, the
        run ends with a message that says so.  Workers that Dask starts in their place may be killed
        as they start; if none is left, the run ends and says how to continue.
        """
        before, most = finished(self.parts)[0].keys(), 4.0 if self.workers else self.whole
        words = [*self.words, *(["--workers", str(self.workers)] if self.workers else [])]
        with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
            while True:
                try:
                    _, message = process.communicate(timeout=self.rng.uniform(0.0, most))
                    break
                except subprocess.TimeoutExpired:
                    if time.perf_counter() > until:
                        continue
                    at_work = self.workers and finished(self.parts)[0].keys() - before
                    victims = workers_of(process) if at_work else []
                    if not self.workers or self.rng.random() < RUN:
                        process.kill()
                        return True
                    if victims:
                        with suppress(psutil.Error):  # it has just ended
                            victims[self.rng.integers(len(victims))].kill()
                            self.counts["workers"] += 1
            if process.returncode == 2 and all(part in message for part in STOPPED):
                self.counts["stopped"] += 1
            elif process.returncode:
                raise SystemExit(f"the run ended with {process.returncode}: {message.decode()}")
            return False

    def carry_out(self, kills: int, seconds: float) -> Counter[str]:
        """Kill until the number of kills or the time is reached, and finish the last round."""
        ends, before = time.perf_counter() + seconds, set[int]()
        while (more := self.kills < kills and time.perf_counter() < ends) or before:
            was_killed = self.killed(ends if more else 0.0)
            found, torn = finished(self.parts)
            self.counts["torn"] += torn
            if self.output.exists():  # complete, whether the kill came after that or not at all
                self.counts["end"] += was_killed
                self.counts["rounds"] += 1
                self.counts["chunks done"] += CHUNKS - len(before)
                self.counts["different"] += contents(self.output) != self.expected
                before = set()
                if self.parts.exists():  # remains of the kill, which do no harm
                    self.output.unlink()
                    self.killed(0.0)
                    self.counts["different"] += contents(self.output) != self.expected
                self.output.unlink()
                continue
            self.counts["lost"] += len(before - set(found))
            self.counts["chunks done"] += len(set(found) - before)
            # the parts that are left tell in which phase of a run the kill came
            during = "chunks" if len(found) > len(before) else "start"
            self.counts["result" if len(found) == CHUNKS else during] += was_killed
            before = set(found)
        return self.counts


def report(found: Mapping[str, Counter[str]], options: argparse.Namespace, seconds: float) -> str:
    each = found.values()
    names = {
        **PHASES,
        **(OF_WORKERS if options.workers else {}),
        "rounds": f"rounds, each of {CHUNKS} chunks of {CHUNK}, that reached their end",
        "chunks done": "chunks finished",
        **FAILURES,
    }
    rows = [("SIGKILLs to the run", *(sum(one[name] for name in PHASES) for one in each))]
    rows += [(text, *(one[name] for one in each)) for name, text in names.items()]
    made = f"{options.workers} workers; " if options.workers else ""
    made += f"Python {platform.python_version()}; {processor()}; seed {options.seed}"
    return f"{table(('scene', *found), rows)}\n\n*{made}; {seconds:.0f} s.*"


def main() -> None:
    options = options_of(
        __doc__,
        kills=(200, "of each scene"),
        workers=(0, "processes of Dask; 0: threads"),
        minutes=60.0,
        seed=1,
    )
    began, found = time.perf_counter(), {}
    for base, sweep in (LONGER if options.workers else SWEEPS).items():
        with tempfile.TemporaryDirectory() as directory:
            campaign = Campaign(Path(directory), sweep, options.workers, options.seed)
            found[base] = campaign.carry_out(options.kills, 60.0 * options.minutes / len(SWEEPS))
    text = report(found, options, time.perf_counter() - began)
    show(options, "kills on Dask" if options.workers else "kills", text, REPORT)
    raise SystemExit(any(one[name] for one in found.values() for name in FAILURES))


if __name__ == "__main__":
    main()
