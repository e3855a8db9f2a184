"""Kill runs of a sweep at random moments, and count what is lost.

    python checks/kills.py [--kills 200] [--seed 1] [--write]

A sweep of 60 chunks is started, killed with SIGKILL after a random time, and started again, until
it is complete; then the next round begins.  After every kill each part is read and its checksum
compared, and no part that was there before may be gone.  After every round the result must be that
of an undisturbed run, byte for byte apart from the time of its creation.
"""

from __future__ import annotations

import platform
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

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
PHASES = ("start", "chunks", "result", "end")


@dataclass
class Findings:
    """Counts of a campaign."""

    kills: Counter[str] = field(default_factory=Counter)
    rounds: int = 0
    chunks: int = 0
    lost: int = 0
    torn: int = 0
    different: int = 0

    @property
    def failures(self) -> int:
        return self.lost + self.torn + self.different


def run_words(directory: Path, extra: Sequence[str]) -> list[str]:
    spec, output = directory / "sweep.toml", directory / "out.h5"
    return [*COMMAND, "run", str(spec), "-o", str(output), "--chunk", str(CHUNK), *extra]


def killed(words: Sequence[str], delay: float) -> bool:
    """Run a command for some seconds; return whether it had to be killed."""
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        try:
            _, message = process.communicate(timeout=delay)
        except subprocess.TimeoutExpired:
            process.kill()
            return True
        if process.returncode:
            raise SystemExit(f"the run ended with {process.returncode}: {message.decode()}")
        return False


def finished(directory: Path, output: Path) -> tuple[dict[int, Path], int]:
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


def campaign(directory: Path, sweep: str, kills: int, seed: int) -> Findings:
    """Kill runs of a sweep until the number of kills is reached."""
    rng = np.random.default_rng(seed)
    (directory / "sweep.toml").write_text(sweep, encoding="utf-8")
    output = directory / "out.h5"
    words = run_words(directory, ())
    began = time.perf_counter()
    killed(words, 600.0)
    whole = time.perf_counter() - began
    expected = contents(output)
    output.unlink()
    findings, before = Findings(), set()
    while findings.kills.total() < kills:
        was_killed = killed(words, rng.uniform(0.0, whole))
        found, torn = finished(run_directory(output), output)
        findings.torn += torn
        if output.exists():  # it is complete, whether the kill came after that or not at all
            findings.kills["end"] += was_killed
            findings.rounds += 1
            findings.chunks += CHUNKS - len(before)
            findings.different += contents(output) != expected
            output.unlink()
            before = set()
            if run_directory(output).exists():  # remains of the kill, which do no harm
                killed(words, 600.0)
                findings.different += contents(output) != expected
                output.unlink()
            continue
        findings.lost += len(before - set(found))
        findings.chunks += len(set(found) - before)
        findings.kills[phase(len(before), len(found))] += was_killed
        before = set(found)
    return findings


def phase(before: int, now: int) -> str:
    """Infer from the parts that are left in which phase of a run the kill came."""
    if now == CHUNKS:
        return "result"
    return "chunks" if now > before else "start"


def report(found: dict[str, Findings], seconds: float, seed: int) -> str:
    each = found.values()
    rows = [
        ("SIGKILLs", *(f.kills.total() for f in each)),
        ("... before the first new chunk was finished", *(f.kills["start"] for f in each)),
        ("... while chunks were computed", *(f.kills["chunks"] for f in each)),
        ("... while the result was written from the parts", *(f.kills["result"] for f in each)),
        ("... after the result had its name", *(f.kills["end"] for f in each)),
        (f"rounds, each of {CHUNKS} chunks, that reached their end", *(f.rounds for f in each)),
        ("chunks finished", *(f.chunks for f in each)),
        ("finished chunks lost", *(f.lost for f in each)),
        ("torn or damaged files", *(f.torn for f in each)),
        ("results that differ from that of an undisturbed run", *(f.different for f in each)),
    ]
    made = f"Python {platform.python_version()}; {processor()}; seed {seed}; {seconds:.0f} s"
    return f"{table(('scene', *found), rows)}\n\n*{made}.*"


def main() -> None:
    options = options_of(__doc__, kills=(200, "of each scene"), seed=1)
    began, found = time.perf_counter(), {}
    for base, sweep in SWEEPS.items():
        with tempfile.TemporaryDirectory() as directory:
            found[base] = campaign(Path(directory), sweep, options.kills, options.seed)
    text = report(found, time.perf_counter() - began, options.seed)
    show(options, "kills", text, REPORT)
    raise SystemExit(1 if any(findings.failures for findings in found.values()) else 0)


if __name__ == "__main__":
    main()
