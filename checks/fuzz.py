"""Feed the command line with damaged and invented input, and see that it never fails badly.

    python checks/fuzz.py [--specs 2000] [--tables 1000] [--results 1000] [--seed 1] [--write]

Sweep files and tables are made of valid ones by changes of bytes, lines and values; result files
are cut, have bits flipped, bytes overwritten, and variables left out or of another type.  Each
attempt must end in time, without a traceback, with exit code 0, 2, or 1 for a failed verification,
and write nothing but its output.  A damaged result must be refused,
or show what the sound one does.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import io
import os
import platform
import signal
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from accuracy import processor, table, write_section
from vibrosweep.cli import main as vibrosweep
from vibrosweep.errors import VibrosweepError
from vibrosweep.model.times import in_periods
from vibrosweep.spec.design import open_design
from vibrosweep.spec.sweep import SweepSpec, read_spec

REPORT = Path(__file__).parents[1] / "docs" / "robustness.md"
PATIENCE = 600  # s, after which an attempt hangs: a busy machine compiles for minutes
MOST_WORK = 1e6  # impacts or so, up to which a sweep that is valid is computed too
SPEC = """title = "A sweep to be spoilt"
[scene]
frequency = 1.0
particles = 2
launch = "staggered"
duration = 3.0
rebound = "rest"
[sample]
design = "uniform"
realizations = 4
seed = 1
restitution = [0.80, 0.98]
amplitude = [0.2, 3.5]
gravity = 9.81
[measure]
transient = 0.5
separation = true
per_particle = true
regimes = true
trust = true
tolerance = 1e-9
impact_budget = 10_000
[record]
restitution = 0.9
amplitude = 1.2
launch = [0.0, 0.125]
"""
MOTIONS = {
    "high-bounce": SPEC,
    "moving": SPEC.replace('rebound = "rest"', 'base = "moving"'),
    "sprung": (
        SPEC.replace(
            'rebound = "rest"', 'base = "sprung"\nmass_ratio = 0.01\nmount_frequency = 1.5'
        ).replace("regimes = true\ntrust = true\ntolerance = 1e-9\n", "joint = true\n")
    ),
}
FORCINGS = {  # at 1 Hz: up to twice gravity, and to fifty times
    "amplitude": (3.5, 150.0),
    "base_velocity": (3.0, 78.0),
    "base_displacement": (0.5, 12.4),
    "base_acceleration": (2.0, 50.0),
}
TABLE = "restitution,amplitude,frequency\n0.9,1.2,1.0\n0.8,0.4,2.0\n0.95,3.0,1.5\n"
VALUES = (
    "0", "-1", "1e308", "-1e308", "1e-320", "nan", "inf", "-inf", "9" * 400, "9" * 5000, "2**3",
    '""', r'"\u0000"', '"../../out"', '"/etc/passwd"', '"/dev/zero.csv"', '"."', '"x.nc"', "[]",
    "[[]]", "{}", "[1, 2]", "[2, 1]", "[nan, nan]", "true", "1979-05-27T07:32:00Z", "\'\'\'",
    "[" * 2000, "{ start = 0.1, stop = 0.9, num = 3 }",
    "{ start = 0.1, stop = 0.9, num = 1000000 }",
    '"$(touch owned)"', "\"__import__('os').system('touch owned')\"", "1_0", "0x10", "1e400",
    r'"\uD7FF\U0010FFFF"', r'"\u001b[2J"', '"moving"', '"sprung"', '"reflect"',
    '"sobol"', '"latin"', '"grid"', '"table.csv"',
)  # fmt: skip


@dataclass
class Findings:
    """How the attempts on one kind of input ended."""

    ends: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)


class Hang(BaseException):
    """An attempt did not end in time."""


@contextlib.contextmanager
def limited() -> Iterator[None]:
    def late(number: int, frame: object) -> None:
        raise Hang

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(PATIENCE)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def attempt(*words: object) -> tuple[str, str]:
    """Call a command here; return how it ended and what it printed."""
    out, messages = io.StringIO(), io.StringIO()
    try:
        with limited(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(messages):
            code = vibrosweep([str(word) for word in words])
    except Hang:
        return "hang", ""
    except SystemExit as ending:
        code = ending.code
    except BaseException:
        return "traceback", traceback.format_exc()
    if "Traceback" in messages.getvalue():
        return "traceback", messages.getvalue()
    if code == 2 and not messages.getvalue().startswith("vibrosweep: "):
        return "no message", messages.getvalue()
    return {0: "accepted", 1: "found wrong", 2: "refused"}.get(code, f"code {code}"), out.getvalue()


def random_sweep(rng: np.random.Generator, base: str) -> str:
    """A valid sweep over a base, driven by any forcing, with times in seconds or in periods."""
    forcing = str(rng.choice(list(FORCINGS)))
    text = MOTIONS[base].replace(
        "amplitude = [0.2, 3.5]", f"{forcing} = [0.2, {rng.choice(FORCINGS[forcing])}]"
    )
    for key in ("duration", "transient"):
        text = text.replace(f"{key} =", str(rng.choice([f"{key} =", f"{key}_periods ="])))
    return text


def spoilt_text(rng: np.random.Generator, text: str, values: tuple[str, ...] = VALUES) -> bytes:
    """Change a text in one place or a few: values, lines, bytes."""
    data = text.encode()
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        lines = data.split(b"\n")
        place = int(rng.integers(len(lines)))
        kind = rng.integers(7)
        if kind <= 2:
            key = lines[place].split(b"=")[0]
            value = values[rng.integers(len(values))].encode()
            lines[place] = (key + b"= " + value) if b"=" in lines[place] else value
        elif kind == 3:
            del lines[place]
        elif kind == 4:
            lines.insert(place, lines[rng.integers(len(lines))])
        data = b"\n".join(lines)
        if kind == 5:
            data = spoilt_bytes(rng, data)
        elif kind == 6 and data.strip():
            words = data.split()
            data = data.replace(words[rng.integers(len(words))], words[rng.integers(len(words))])
    return data


def spoilt_bytes(rng: np.random.Generator, data: bytes, head: int | None = None) -> bytes:
    """Flip bits, overwrite bytes, put zeros, or cut."""
    kind, spoilt = rng.integers(5), bytearray(data or b"x")
    reach = len(spoilt) if head is None else min(head, len(spoilt))
    count = int(rng.choice([1, 1, 3, 20]))
    if kind <= 1:
        for place in rng.integers(reach, size=count):
            spoilt[place] ^= 1 << int(rng.integers(8))
    elif kind == 2:
        for place in rng.integers(reach, size=count):
            spoilt[place] = int(rng.integers(256))
    elif kind == 3:
        place, width = int(rng.integers(reach)), int(rng.choice([1, 8, 64, 512]))
        spoilt[place : place + width] = bytes(len(spoilt[place : place + width]))
    else:
        del spoilt[int(rng.integers(len(spoilt))) :]
    return bytes(spoilt)


def work(spec: SweepSpec) -> float:
    """Impacts that a sweep may take, generously: an impact each tenth of a period."""
    frequency = spec.fixed.get("frequency", 1e3)
    scenes = spec.particles * open_design(spec).realizations
    if spec.record is not None:
        scenes += spec.record.particles
        frequency = max(frequency, spec.record.parameters["frequency"])
    times = [spec.duration, *([spec.record.duration] if spec.record else [])]
    longest = max(float(in_periods(time, np.array([frequency]))[0]) for time in times)
    return scenes * min(10.0 * longest + 10.0, 4.0 * spec.measures.impact_budget)


def try_spec(directory: Path, findings: Findings, spoilt: object) -> None:
    """Read a sweep file, and compute it where it is valid and small."""
    before = snapshot(directory)
    with contextlib.suppress(VibrosweepError):
        if work(read_spec(directory / "sweep.toml")) > MOST_WORK:
            findings.ends["valid, too long to compute"] += 1
            return
    end, said = attempt("run", directory / "sweep.toml", "-o", directory / "out.h5", "--threads", 1)
    note(findings, end, said, spoilt)
    after = snapshot(directory)
    expected = {"out.h5"} if end == "accepted" else set()
    if set(after) - set(before) != expected or any(after[n] != before[n] for n in before):
        findings.failures.append(f"wrote {set(after) ^ set(before)}: {spoilt!r}")
    if end == "accepted":
        shown, said = attempt("info", directory / "out.h5")
        if shown != "accepted":
            note(findings, f"result {shown}", said, spoilt)
        (directory / "out.h5").unlink()


def snapshot(directory: Path) -> dict[str, bytes]:
    return {p.name: p.read_bytes() if p.is_file() else b"" for p in directory.iterdir()}


def note(findings: Findings, end: str, said: str, spoilt: object) -> None:
    findings.ends[end] += 1
    if end not in ("accepted", "refused", "found wrong"):
        findings.failures.append(f"{end}: {spoilt!r}\n{said}")


def fuzz_specs(directory: Path, rng: np.random.Generator, number: int) -> Findings:
    findings = Findings()
    (directory / "table.csv").write_text(TABLE)
    for _ in range(number):
        data = spoilt_text(rng, random_sweep(rng, str(rng.choice(list(MOTIONS)))))
        (directory / "sweep.toml").write_bytes(data)
        try_spec(directory, findings, data)
    return findings


def fuzz_tables(directory: Path, rng: np.random.Generator, number: int) -> Findings:
    """Tables of text, and one in five in netCDF, each of which is tried in a process of its own."""
    findings = Findings()
    with h5py.File(directory / "sound.nc", "w") as file:
        for name, values in (("restitution", [0.9, 0.8]), ("amplitude", [1.2, 0.4])):
            file[name] = np.array(values)
            file[name].dims[0].label = "row"
    sound = (directory / "sound.nc").read_bytes()
    sweep = 'title = "x"\n[scene]\nduration = 3.0\n[sample]\ndesign = "table.{}"\n'
    for number_now in range(number):
        ending = "nc" if number_now % 5 == 0 else "csv"
        (directory / "sweep.toml").write_text(sweep.format(ending))
        csv = spoilt_text(rng, TABLE, (*VALUES, "0.9,1.2", "0.9,1.2,1,1", "a,b,c", ",,", '"'))
        data = spoilt_bytes(rng, sound) if ending == "nc" else csv
        (directory / f"table.{ending}").write_bytes(data)
        try_spec(directory, findings, data)
    return findings


def fuzz_results(directory: Path, rng: np.random.Generator, number: int) -> Findings:
    """Damaged results through the commands that read them."""
    findings = Findings()
    commands: list[tuple[str, tuple[object, ...]]] = [
        ("info", ()),
        ("verify", ("--sample", 1)),
        ("figures", ("-o", directory / "figures")),
    ]

    def sound(base: str) -> Path:
        return directory / f"{base}.h5"

    @functools.cache
    def contents(base: str) -> bytes:
        (directory / "sweep.toml").write_text(random_sweep(rng, base))
        end, said = attempt("run", directory / "sweep.toml", "-o", sound(base))
        if end != "accepted":
            raise RuntimeError(f"a sound sweep: {end}: {said}")
        return sound(base).read_bytes()

    @functools.cache
    def expected(name: str, base: str) -> str:
        return attempt(name, sound(base), *dict(commands)[name])[1]

    for round_number in range(number):
        base = str(rng.choice(list(MOTIONS)))
        whole = contents(base)
        name, words = commands[0 if round_number % 10 else rng.integers(len(commands))]
        path = directory / "damaged.h5"
        sealed = bool(rng.random() < 0.7)  # what has no seal is read in a process of its own first
        given = whole if sealed else whole[: whole.rindex(b"\nvibrosweep seal")]
        # a third of the attempts go to the parts at the beginning that say what is where
        data = spoilt_bytes(rng, given, 8192 if rng.random() < 0.3 else None)
        path.write_bytes(data)
        if rng.random() < 0.2:
            changed(rng, path, whole)
            sealed = False  # HDF5 writes over the seal
        end, said = attempt(name, path, *words)
        note(findings, end, said, f"{name} of attempt {round_number}")
        accepted = sealed and end == "accepted"
        if accepted and said.replace(str(path), str(sound(base))) != expected(name, base):
            findings.failures.append(f"{name}, attempt {round_number}: accepted, other numbers")
    return findings


def changed(rng: np.random.Generator, path: Path, whole: bytes) -> None:
    """Leave variables or attributes out, or give them another type, with HDF5 itself."""
    path.write_bytes(whole)
    with h5py.File(path, "r+") as file:
        names = [n for n in file if isinstance(file[n], h5py.Dataset)]
        for name in rng.choice(names, size=2, replace=False):
            change: Callable[[], object] = (
                lambda n=name: file.__delitem__(n),
                lambda n=name: file[n].attrs.clear(),
                lambda n=name: (file.__delitem__(n), file.create_dataset(n, data=b"text")),
                lambda n=name: (file.__delitem__(n), file.create_dataset(n, data=np.ones((2, 2)))),
                lambda n=name: (file.__delitem__(n), file.create_group(n)),
            )[rng.integers(5)]
            change()
        if rng.random() < 0.3:
            del file.attrs[str(rng.choice(list(file.attrs)))]


FUZZERS = {"sweep files": fuzz_specs, "tables": fuzz_tables, "result files": fuzz_results}


def campaign(numbers: dict[str, int], seed: int) -> dict[str, Findings]:
    found = {}
    for name, number in numbers.items():
        with tempfile.TemporaryDirectory() as place:
            directory = Path(place) / "inner"
            directory.mkdir()
            before = Path.cwd()
            os.chdir(directory)
            try:
                found[name] = FUZZERS[name](directory, np.random.default_rng(seed), number)
            finally:
                os.chdir(before)
            if [p.name for p in Path(place).iterdir()] != ["inner"]:
                found[name].failures.append(f"wrote outside: {list(Path(place).iterdir())}")
    return found


def report(found: dict[str, Findings], seconds: float, seed: int) -> str:
    ends = ("refused", "accepted", "valid, too long to compute", "found wrong")
    rows = []
    for name, findings in found.items():
        counts = [findings.ends[end] for end in ends]
        bad = findings.ends.total() - sum(counts)
        rows.append((name, findings.ends.total(), *counts, bad, len(findings.failures)))
    head = ("input", "tried", *ends, "tracebacks or hangs", "all failures")
    made = f"Python {platform.python_version()}; {processor()}; seed {seed}; {seconds:.0f} s"
    return f"{table(head, rows)}\n\n*{made}.*"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    for name, default in (("specs", 2000), ("tables", 1000), ("results", 1000), ("seed", 1)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--write", action="store_true", help="write the table into the report")
    options = parser.parse_args()
    began = time.perf_counter()
    numbers = dict(zip(FUZZERS, (options.specs, options.tables, options.results), strict=True))
    found = campaign(numbers, options.seed)
    for name, findings in found.items():
        for failure in findings.failures:
            print(f"{name}: {failure}\n")
    text = report(found, time.perf_counter() - began, options.seed)
    print(text) if not options.write else write_section("fuzz", text, REPORT)
    raise SystemExit(any(findings.failures for findings in found.values()))


if __name__ == "__main__":
    main()
