"""Interrupt random sweeps at random places, change them in between, and continue.

    python checks/resumes.py [--specs 500] [--seed 1] [--write]

A random sweep file is computed in chunks and interrupted before, in or after a chunk, while the
result is written from the parts, or at its record.  It is then continued, now and then with a
changed key: this must be refused with the name of the key, and harm nothing.  A change that changes
no number (a comment, a default written out) must be accepted.  Every final result must be that of
an undisturbed run, byte for byte apart from the time of its creation.  Sweeps whose impact budget
is spent are then computed again with a larger one, and must equal those with that budget.
"""

from __future__ import annotations

import platform
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import h5py
import numpy as np

from accuracy import options_of, processor, show, table
from kills import REPORT, contents
from vibrosweep.errors import RunError
from vibrosweep.runs import result
from vibrosweep.runs.driver import retry_failed, run_sweep
from vibrosweep.scene.sweep import Sweep, parse_spec
from vibrosweep.store.parts import Parts, run_directory

Tables = dict[str, dict[str, Any]]
# where a run may be interrupted: owner and name of a function
PLACES = ((Parts, "write"), (Parts, "read"), (result, "kinds"), (result, "write_record"))
MODELS = (
    {"rebound": "rest"},
    {"rebound": "reflect"},
    {"base": "moving"},
    {"base": "sprung", "mass_ratio": 0.02, "mount_frequency": 0.6},
)
MOUNT = ("mass_ratio", "mount_frequency")
OTHER = {"rest": "reflect", "reflect": "rest", "moving": "high-bounce", "sprung": "moving"}
SWITCHES = ("separation", "per_particle", "regimes", "lyapunov", "trust")
COUPLED_SWITCHES = ("separation", "per_particle", "joint")
FORCINGS = {  # at 1 Hz, up to fifty times gravity
    "amplitude": (0.1, 3.5, 150.0),
    "base_velocity": (0.1, 2.0, 78.0),
    "base_displacement": (0.01, 0.3, 12.4),
    "base_acceleration": (0.05, 3.0, 50.0),
}
BUDGET = "impact_budget"


@dataclass
class Findings:
    """Counts of a campaign."""

    specs: int = 0
    interruptions: int = 0
    resumes: int = 0
    refused: int = 0
    harmless: int = 0
    retries: int = 0
    wrongly_refused: int = 0
    wrongly_taken: int = 0
    unnamed: int = 0
    harmed: int = 0
    different: int = 0
    retried_differently: int = 0

    @property
    def failures(self) -> int:
        return (
            self.wrongly_refused
            + self.wrongly_taken
            + self.unnamed
            + self.harmed
            + self.different
            + self.retried_differently
        )


def random_tables(rng: np.random.Generator) -> Tables:
    """Tables of a sweep file that takes a moment to compute."""
    particles = int(rng.integers(1, 5))
    launch = [round(float(t), 3) for t in rng.uniform(0.0, 2.0, particles)]
    grid = rng.random() < 0.2
    model, forcing = MODELS[rng.integers(len(MODELS))], str(rng.choice(list(FORCINGS)))
    coupled = model.get("base") == "sprung"
    low, high, highest = FORCINGS[forcing]
    if rng.random() < 0.2:
        high = highest
    ends = np.sort(rng.uniform(low, high, 2)).round(4).tolist()
    in_periods = "_periods" if rng.random() < 0.5 else ""
    tables: Tables = {
        "": {"title": "A sweep to be interrupted"},
        "scene": {
            "particles": particles,
            f"duration{in_periods}": float(rng.choice([6.0, 40.0, 400.0])),
            **model,
            "frequency": round(float(rng.uniform(0.5, 3.0)), 3),
            "launch": launch if rng.random() < 0.5 else "staggered",
        },
        "sample": {
            "design": "grid" if grid else str(rng.choice(["uniform", "latin", "sobol"])),
            "restitution": [0.6, 0.8, 0.9, 0.97] if grid else [0.5, 0.98],
            forcing: [*ends, 2.0 * high] if grid else ends,
        },
        "measure": {
            name: bool(rng.random() < 0.4) for name in (COUPLED_SWITCHES if coupled else SWITCHES)
        },
    }
    if not grid:
        tables["sample"] |= {"realizations": int(rng.integers(4, 30)), "seed": 7}
    tables["measure"][f"transient{in_periods}"] = float(rng.choice([0.0, 3.0]))
    tables["measure"][BUDGET] = int(rng.choice([24, 200, 10**6]))
    if rng.random() < 0.3:
        tables["record"] = {"restitution": 0.9, "amplitude": 1.2, "duration": 8.0}
        tables["record"] |= {name: model[name] for name in MOUNT if name in model}
    return tables


def text_of(tables: Tables) -> str:
    """Sweep file of the tables."""
    lines = []
    for section, keys in tables.items():
        lines += [f"[{section}]"] if section else []
        lines += [f"{key} = {_toml(value)}" for key, value in keys.items()]
    return "\n".join(lines) + "\n"


def _toml(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else repr(value).replace("'", '"')


def changed(tables: Tables, rng: np.random.Generator) -> tuple[Tables, str]:
    """Tables with one key changed, and its name in a refusal; empty if it must be accepted."""
    now = {section: dict(keys) for section, keys in tables.items()}
    if rng.random() < 0.2:  # a default that is written out
        now["scene"] |= {"gravity": 9.81, "phase": 0.0}
        return now, ""
    section = str(rng.choice([s for s in now if s]))
    key = str(rng.choice(list(now[section])))
    value = now[section][key]
    if key in ("design", "launch"):
        section, key = "measure", "separation"
        value = now[section][key]
    if isinstance(value, bool):
        now[section][key] = not value
    elif isinstance(value, str):
        now[section][key] = OTHER[value]
        for one in MOUNT if value == "sprung" else ():
            del now["scene"][one]
            now.get("record", {}).pop(one, None)
        if value == "sprung":
            now["measure"].pop("joint", None)
    elif isinstance(value, list):
        now[section][key] = [value[0] * 0.75, *value[1:]]
    elif key == "particles":
        now[section] |= {key: value + 1, "launch": "staggered"}
    else:
        now[section][key] = value + 1 if isinstance(value, int) else value * 0.9375 + 0.001
    if key == "regimes" and now["measure"].get("lyapunov"):  # lyapunov includes regimes
        return now, ""
    parameters = {"restitution", "frequency", *FORCINGS, *MOUNT}
    known = key in parameters and section != "record"
    return now, key if known else f"{section}.{key.removesuffix('_periods')}"


class _Counted:
    """Interrupts the n-th call of any function of `PLACES`, before or after its work."""

    def __init__(self, calls: int, late: bool) -> None:
        self.left, self.late = calls, late

    def around(self, original: Any) -> Any:
        def call(*arguments: Any) -> Any:
            self.left -= 1
            if not self.left and not self.late:
                raise KeyboardInterrupt
            result = original(*arguments)
            if not self.left:
                raise KeyboardInterrupt
            return result

        return call


@contextmanager
def interrupting(rng: np.random.Generator, most: int) -> Iterator[None]:
    """Interrupt the code inside at a random place, if it is reached."""
    counted = _Counted(int(rng.integers(1, most)), bool(rng.random() < 0.5))
    with ExitStack() as stack:
        for owner, name in PLACES:
            around = counted.around(getattr(owner, name))
            stack.enter_context(mock.patch.object(owner, name, around))
        yield


def values(path: Path) -> dict[str, bytes]:
    """Every number of a result, to the last bit."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(
            lambda name, one: (
                found.update({name: one[()].tobytes()}) if isinstance(one, h5py.Dataset) else None
            )
        )
    return found


def parts_of(output: Path) -> dict[str, bytes]:
    """Names and bytes of the parts beside an output."""
    return {p.name: p.read_bytes() for p in run_directory(output).glob("chunk-*")}


def one_sweep(directory: Path, rng: np.random.Generator, findings: Findings) -> None:
    """Compute a random sweep with interruptions and changes, and compare it."""
    tables, threads = random_tables(rng), int(rng.integers(1, 3))
    output, whole = directory / "out.h5", directory / "whole.h5"
    spec, chunk = parse_spec(text_of(tables)), int(rng.integers(1, 9))
    findings.specs += 1
    while not output.exists():
        most = 3 * (spec.design.realizations or 12) // chunk + 4
        try:
            with interrupting(rng, most):
                run_sweep(spec, output, threads=threads, chunk=chunk)
        except KeyboardInterrupt:
            findings.interruptions += 1
        if not output.exists() and run_directory(output).exists():
            spec = _resumed(tables, spec, output, threads, rng, findings)
    run_sweep(spec, whole, threads=threads)
    findings.different += contents(output) != contents(whole)
    if spec.scene.measures.impact_budget < 10**6:
        _retried(tables, spec, output, whole, findings)
    output.unlink()
    whole.unlink()


def _resumed(
    tables: Tables,
    spec: Sweep,
    output: Path,
    threads: int,
    rng: np.random.Generator,
    findings: Findings,
) -> Sweep:
    """Try to continue with a changed sweep; return the sweep to continue with."""
    findings.resumes += 1
    if rng.random() < 0.4:
        return spec
    tables, key = changed(tables, rng)
    other, before = parse_spec("# a comment\n" + text_of(tables)), parts_of(output)
    if not key:
        findings.harmless += 1
        try:
            with interrupting(rng, 3):
                run_sweep(other, output, threads=threads)
        except RunError:
            findings.wrongly_refused += 1
        except KeyboardInterrupt:
            findings.interruptions += 1
        return other
    try:
        run_sweep(other, output, threads=threads)
    except RunError as error:
        findings.refused += 1
        findings.unnamed += f"\n  {key}" not in str(error)
    else:
        findings.wrongly_taken += 1
        output.unlink()
    findings.harmed += parts_of(output) != before
    return spec


def _retried(tables: Tables, spec: Sweep, output: Path, whole: Path, findings: Findings) -> None:
    """Compute again, with a larger budget, what exceeded a small one; compare with a direct run."""
    larger = {**tables, "measure": tables["measure"] | {BUDGET: 10**6}}
    run_sweep(parse_spec(text_of(larger)), whole, threads=1, force=True)
    _, again = retry_failed(spec, output, threads=1, impact_budget=10**6)
    findings.retries += again > 0
    findings.retried_differently += values(output) != values(whole)


def campaign(directory: Path, specs: int, seed: int) -> Findings:
    """Compute `specs` random sweeps."""
    findings = Findings()
    for number in range(specs):
        one_sweep(directory, np.random.default_rng([seed, number]), findings)
    return findings


def report(findings: Findings, seconds: float, seed: int) -> str:
    rows = [
        ("random sweeps", findings.specs),
        ("interruptions", findings.interruptions),
        ("resumes", findings.resumes),
        ("... with a changed sweep, refused", findings.refused),
        ("... with a change that changes no number", findings.harmless),
        ("sweeps computed again with a larger impact budget", findings.retries),
        ("harmless changes that were refused", findings.wrongly_refused),
        ("changes that were not refused", findings.wrongly_taken),
        ("refusals that do not name the change", findings.unnamed),
        ("refusals that changed a finished chunk", findings.harmed),
        ("results that differ from that of an undisturbed run", findings.different),
        ("retried results that differ from a direct run", findings.retried_differently),
    ]
    made = f"Python {platform.python_version()}; {processor()}; seed {seed}; {seconds:.0f} s"
    return f"{table(('', 'number'), rows)}\n\n*{made}.*"


def main() -> None:
    options = options_of(__doc__, specs=500, seed=1)
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as directory:
        findings = campaign(Path(directory), options.specs, options.seed)
    text = report(findings, time.perf_counter() - began, options.seed)
    show(options, "resumes", text, REPORT)
    raise SystemExit(1 if findings.failures else 0)


if __name__ == "__main__":
    main()
