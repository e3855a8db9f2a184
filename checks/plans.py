"""Compare the estimates of plans with the runs that follow.

    python checks/plans.py [--only NAME] [--write]

Each sweep is planned in one process and run in another; the table gives the spread of the ratios of
measured to estimated quantities over all sweeps.
"""

from __future__ import annotations

import json
import platform
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np

from accuracy import options_of, processor, show, table
from kills import REPORT
from vibrosweep.engine.workers import Workers
from vibrosweep.runs.driver import run_sweep
from vibrosweep.runs.plan import estimate, make_plan, refined
from vibrosweep.scene.sweep import read_spec

SWEEPS = Path(__file__).parents[1] / "sweeps"
THREADS = 2
OTHERS = {
    "all measures": """
title = "Everything that can be measured"
[scene]
particles = 20
[sample]
realizations = 20_000
restitution = [0.80, 0.98]
amplitude = [0.2, 3.5]
[measure]
separation = true
per_particle = true
regimes = true
trust = true
""",
    "all measures, moving base": """
title = "Everything that can be measured, over a base that throws"
[scene]
base = "moving"
particles = 20
duration_periods = 12.0
[sample]
realizations = 20_000
restitution = [0.50, 0.98]
base_acceleration = [0.1, 50.0]
[measure]
separation = true
per_particle = true
regimes = true
lyapunov = true
trust = true
""",
    "all measures, sprung base": """
title = "Everything that can be measured of coupled particles"
[scene]
base = "sprung"
particles = 20
duration_periods = 40.0
[sample]
realizations = 500
restitution = [0.80, 0.98]
base_acceleration = [0.1, 5.0]
mass_ratio = [0.0001, 0.02]
mount_frequency = [0.2, 2.0]
[measure]
separation = true
per_particle = true
joint = true
""",
    "long orbits": """
title = "A million periods, most of them skipped"
[scene]
particles = 20
duration = 1e6
[sample]
realizations = 200
restitution = [0.80, 0.98]
amplitude = [0.2, 3.5]
[measure]
regimes = true
""",
    "grid of long orbits": """
title = "A grid of long orbits, most of them skipped"
[scene]
particles = 20
duration = 4e5
[sample]
design = "grid"
restitution = { start = 0.80, stop = 0.98, num = 12 }
amplitude = { start = 0.2, stop = 3.5, num = 20 }
""",
}


def planned(spec: Path, output: Path) -> dict[str, float]:
    """Make a plan and return its estimates; called in a new process."""
    sweep = read_spec(spec)
    with Workers(THREADS) as workers:
        plan = refined(sweep, make_plan(sweep, workers), workers, 2.0)  # as the command does
        needs = estimate(sweep, plan, workers)
    return asdict(needs) | {"chunks": plan.chunks}


def measured(spec: Path, output: Path) -> dict[str, float]:
    """Run a sweep and return its measured costs; called in a new process."""
    began = time.perf_counter()
    summary = run_sweep(read_spec(spec), output, threads=THREADS)
    status = Path("/proc/self/status").read_text(encoding="ascii")
    peak = next(line for line in status.splitlines() if line.startswith("VmHWM"))
    return {
        "seconds": time.perf_counter() - began,
        "impacts": summary.landings,
        "memory": int(peak.split()[1]) * 1024,
        "result": output.stat().st_size,
    }


def apart(what: str, spec: Path, output: Path) -> dict[str, float]:
    words = [sys.executable, __file__, what, str(spec), str(output)]
    return json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)


QUANTITIES = {"impacts": "impacts", "seconds": "time", "memory": "memory", "result": "disk"}


def ratios(spec: Path, directory: Path) -> list[float]:
    """Return measured over estimated, for each quantity."""
    output = directory / "out.h5"
    foreseen, found = apart("planned", spec, output), apart("measured", spec, output)
    output.unlink()
    return [found[key] / foreseen[key] for key in QUANTITIES]


def main() -> None:
    options = options_of(__doc__, only=("", "sweeps whose name contains this"))
    each = []
    with tempfile.TemporaryDirectory() as directory:
        specs = {path.stem: path for path in sorted(SWEEPS.glob("*.toml"))}
        for name, text in OTHERS.items():
            specs[name] = Path(directory) / f"{name}.toml"
            specs[name].write_text(text, encoding="utf-8")
        for name, spec in specs.items():
            if options.only in name:
                each.append(ratios(spec, Path(directory)))
                print(name, *(f"{ratio:.2f}" for ratio in each[-1]), sep=" | ", flush=True)
    spread = np.quantile(each, [0.0, 0.5, 1.0], axis=0).T
    rows = [
        (name, *(f"{ratio:.2f}" for ratio in one))
        for name, one in zip(QUANTITIES.values(), spread, strict=True)
    ]
    made = f"{len(each)} sweeps, {THREADS} threads; Python {platform.python_version()}"
    head = ("measured over estimated", "least", "median", "largest")
    text = f"{table(head, rows)}\n\n*{made}; {processor()}.*"
    show(options, "plans", text, REPORT)


if __name__ == "__main__":
    if len(sys.argv) == 4 and sys.argv[1] in ("planned", "measured"):
        function = {"planned": planned, "measured": measured}[sys.argv[1]]
        print(json.dumps(function(Path(sys.argv[2]), Path(sys.argv[3]))))
    else:
        main()
