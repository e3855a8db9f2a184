"""Time the kernels against their sine, with each width of vectors that this processor has.

    python benchmarks/processors.py             print the table
    python benchmarks/processors.py --write     and put it into benchmarks/README.md
    python benchmarks/processors.py --here      time in this process only, and print JSON

Each width is timed in a separate process, in which all jobs take turns: a figure is the median
ratio of the processor time of a job to that of the sine just before it, which other programs
disturb little.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from llvmlite import binding

PAGE = Path(__file__).parent / "README.md"
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
ROUNDS = 15
SECONDS = 60.0  # after which no further round is begun
REPETITIONS = 20_000
# a processor with AVX2 and no more: half the registers, and no masks
HASWELL = {"NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma,+bmi,+bmi2,+sse4.2"}
# name in the table: what the processor must have, and the environment of its process
WAYS = {
    "512": ("avx512f", {"VIBROSWEEP_VECTOR_BITS": "512"}),
    "256": ("avx512f", {"VIBROSWEEP_VECTOR_BITS": "256"}),
    "256 (AVX2)": ("avx2", HASWELL | {"VIBROSWEEP_VECTOR_BITS": "256"}),
    "128 (AVX2)": ("avx2", HASWELL | {"VIBROSWEEP_VECTOR_BITS": "128"}),
    "128 (NEON)": ("neon", {}),
}


class Job(NamedTuple):
    """A function to time, and the units of work of a call."""

    run: object
    work: float


def jobs(workers):
    """All jobs by name, the sine first; their unit of work is an impact, or one sine."""
    from loops import LANES, bare_map, lanes, sine_only
    from methods.scenes import paper_parameters
    from test_kernels import scene
    from vibrosweep.engine.measure import batch_of, measure, statistics

    sines, maps = lanes(), lanes()
    passes = REPETITIONS * LANES
    found = {
        "sine": Job(lambda: sine_only(sines, REPETITIONS), passes),
        "bare map": Job(lambda: bare_map(maps, REPETITIONS), passes),
    }
    for name, realizations, periods in (("12 periods", 20_000, 12.0), ("1000 periods", 200, 1e3)):
        problem, launch, observation = scene(realizations, 20, periods)

        def stream(problem=problem, launch=launch, observation=observation):
            return statistics(batch_of(problem, launch, observation), observation, workers)

        found[name] = Job(stream, float(stream().landings.sum()))
    parameters, (*_, observation) = paper_parameters(1000), scene(1000, 100, 12.0, separation=True)

    def separate():
        return measure(parameters, observation, workers)

    found["separations"] = Job(separate, float(separate()["impact_count"].sum()))
    return found


def measure():
    """Median time of the sine in ns, and of every other job as a multiple of the sine's."""
    from vibrosweep.engine.workers import Workers

    def nanoseconds(job):
        began = time.process_time()
        job.run()
        return 1e9 * (time.process_time() - began) / job.work

    until = time.monotonic() + SECONDS
    with Workers(1) as workers:
        todo = jobs(workers)
        sine = todo.pop("sine")
        times, ratios = [nanoseconds(sine)], {name: [] for name in todo}
        for _ in range(ROUNDS):
            for name, job in todo.items():
                times.append(nanoseconds(sine))
                ratios[name].append(nanoseconds(job) / times[-1])
            if time.monotonic() > until:
                break
    return {"sine": statistics.median(times)} | {
        name: statistics.median(values) for name, values in ratios.items()
    }


def ways():
    """The widths that this processor has."""
    features = binding.get_host_cpu_features()
    return [name for name, (feature, _) in WAYS.items() if features.get(feature)]


def measured(way):
    """Run `measure` with vectors of a given width, in a new process."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith("NUMBA_CPU")}
    done = subprocess.run(
        [sys.executable, __file__, "--here"],
        env=inherited | WAYS[way][1],
        stdout=subprocess.PIPE,
        check=True,
    )
    return json.loads(done.stdout)


def table(found):
    """The figures as a table in Markdown."""
    from vibrosweep.store.writing import provenance

    processor = f"{provenance(threads=1)['cpu']} ({binding.get_host_cpu_name()})"
    names = [name for name in next(iter(found.values())) if name != "sine"]
    lines = [
        f"Measured on {datetime.now(UTC).date().isoformat()}; load of the machine "
        f"{os.getloadavg()[0]:.1f}.",
        "",
        f"| processor | vectors | sine (ns) | {' | '.join(names)} |",
        "|---" * (3 + len(names)) + "|",
    ]
    for way, figures in found.items():
        ratios = " | ".join(f"{figures[name]:.2f}" for name in names)
        lines.append(f"| {processor} | {way} | {figures['sine']:.3f} | {ratios} |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--write", action="store_true", help="put the table into benchmarks/README.md"
    )
    parser.add_argument("--here", action="store_true", help="time in this process, print JSON")
    options = parser.parse_args()
    if options.here:
        print(json.dumps(measure()))
        return
    text = table({way: measured(way) for way in ways()})
    print(text)
    if options.write:
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
        _, _, after = rest.partition(END)
        PAGE.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()
