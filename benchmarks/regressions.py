"""Compare every figure of the benchmarks with the stored one; fail if one is worse by a quarter.

    python benchmarks/regressions.py            compare with benchmarks/ratios.json
    python benchmarks/regressions.py --store    replace those of this family of processors

Figures are stored for each family of processors, as LLVM names it (`znver4`, `sapphirerapids`),
since ratios differ between families.  On a family without stored figures they are measured and
shown, and not judged.

A figure is what the fixture `race` measures: how many times as fast as a reference in the same run
a subject is, here by processor time, which other programs on the machine disturb little.  A test
that fails, or whose figure is worse, is run a second time, and the better figure counts.  The exit
code is 1 if a figure is worse or missing, or if a test fails without one.  If a test gives a figure
but misses its target in wall time, this is reported, and the figure is compared and
stored like any other; `pytest benchmarks` judges targets.  A test that fails without a figure keeps
the stored one.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from llvmlite import binding

from vibrosweep.store.writing import provenance

ROOT = Path(__file__).parents[1]
STORED = ROOT / "benchmarks" / "ratios.json"
WORSE = 1.25  # time of the subject in units of its reference, over the stored one
LIBRARIES = ("numpy", "numba", "pynamicalsys")


class Verdict(NamedTuple):
    """Change of a figure.

    Attributes
    ----------
    name
        The test.
    stored, measured
        Speeds in units of the reference's; None where there is none.
    """

    name: str
    stored: float | None
    measured: float | None

    @property
    def word(self) -> str:
        """`as before`, `improved`, `new`, `WORSE` or `MISSING`."""
        if self.measured is None:
            return "MISSING"
        if self.stored is None:
            return "new"
        if self.stored > WORSE * self.measured:
            return "WORSE"
        return "improved" if self.measured > WORSE * self.stored else "as before"

    @property
    def fails(self) -> bool:
        return self.word in ("WORSE", "MISSING")


def compare(stored: Mapping[str, float], measured: Mapping[str, float]) -> list[Verdict]:
    """A verdict on every figure that is stored or measured, in alphabetical order."""
    names = sorted({*stored, *measured})
    return [Verdict(name, stored.get(name), measured.get(name)) for name in names]


def report(verdicts: Iterable[Verdict], family: str, stored: Iterable[str]) -> str:
    """The verdicts as text, and a remark where no figures of this family are stored."""
    lines = []
    for v in verdicts:
        was, now = ("-" if ratio is None else f"{ratio:.3g}" for ratio in (v.stored, v.measured))
        lines.append(f"{v.word:10} {was:>8} -> {now:>8}  {v.name}")
    if family not in stored:
        lines.append(
            f"no figures are stored for {family}, only for {', '.join(sorted(stored)) or 'none'}: "
            f"nothing is judged; --store keeps these"
        )
    return "\n".join(lines)


class Collector:
    """A pytest plugin that records the figures of the races, and the tests that failed."""

    def __init__(self) -> None:
        self.figures: dict[str, float] = {}
        self.failed: set[str] = set()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.failed.add(report.nodeid)
        figures = dict(report.user_properties)
        if report.when == "call" and "processor_ratio" in figures:
            self.figures[report.nodeid] = figures["processor_ratio"]


def run(tests: Iterable[str]) -> Collector:
    """Run tests, named from the root on, and collect their figures."""
    found = Collector()
    options = ["-q", "-s", "--rootdir", str(ROOT), "-c", str(ROOT / "pyproject.toml")]
    code = pytest.main([*options, *(str(ROOT / test) for test in tests)], plugins=[found])
    if code not in (pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED):
        raise SystemExit(f"the benchmarks could not be run: {code!r}")
    return found


def again(stored: Mapping[str, float], found: Collector) -> list[str]:
    """Tests to run a second time: those that failed, and those whose figure is worse."""
    worse = {v.name for v in compare(stored, found.figures) if v.word == "WORSE"}
    return sorted(worse | found.failed)


def better(first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
    """For every figure the better of two runs."""
    names = {*first, *second}
    return {n: max(run[n] for run in (first, second) if n in run) for n in names}


def store(figures: Mapping[str, float], family: str, known: Mapping[str, Any]) -> None:
    """Write the figures of a family with processor, date and versions; keep those of others."""
    own = {
        "processor": str(provenance(threads=1)["cpu"]),
        "date": datetime.now(UTC).date().isoformat(),
        "versions": {name: version(name) for name in LIBRARIES if find_spec(name)},
        "ratios": {name: float(f"{figures[name]:.4g}") for name in sorted(figures)},
    }
    content = dict(sorted({**known, family: own}.items()))
    STORED.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--store", action="store_true", help="replace the stored figures")
    options = parser.parse_args()
    family = binding.get_host_cpu_name()
    known = json.loads(STORED.read_text(encoding="utf-8")) if STORED.exists() else {}
    stored = {} if options.store else known.get(family, {}).get("ratios", {})
    found = run(["benchmarks"])
    figures, failed = found.figures, found.failed
    repeated = again(stored, found)
    if repeated:
        second = run(repeated)
        figures, failed = better(figures, second.figures), second.failed
    for name in sorted(failed):
        print(f"{'misses a target' if name in figures else 'FAILED'}, twice: {name}")
    broken = failed - set(figures)
    if options.store:
        former = known.get(family, {}).get("ratios", {})
        store({n: former[n] for n in broken & set(former)} | figures, family, known)
        print(f"{len(figures)} figures written to {STORED}")
        return 1 if broken else 0
    verdicts = compare(stored, figures)
    print(report(verdicts, family, known))
    return 1 if broken or any(v.fails for v in verdicts) else 0


if __name__ == "__main__":
    sys.exit(main())
