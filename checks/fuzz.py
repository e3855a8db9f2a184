"""Feed the command line with damaged and invented input, and check that it never fails badly.

    python checks/fuzz.py [--specs 2000] [--tables 1000] [--results 1000] [--again 1000] [--seed 1]
                          [--write]

Sweep files and tables are made of valid ones by changes of bytes, lines and values; result files
are cut, have bits flipped, bytes overwritten, and variables left out or of another type; results of
every kind are saved again with other values, types, attributes and links, of which some lead to a
pipe.  Each attempt must end in time, without a traceback, with exit code 0, 2, or 1 for a failed
verification, and write nothing but its output.  A damaged result must be refused, or show what the
sound one does.
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
from vibrosweep.model.parameters import in_periods
from vibrosweep.scene.design import open_design
from vibrosweep.scene.sweep import Sweep, read_spec
from vibrosweep.store.disk import append_seal

REPORT = Path(__file__).parent / "README.md"
PATIENCE = 600  # s until an attempt counts as hanging; a busy machine compiles for minutes
MOST_WORK = 1e6  # impacts, roughly, up to which a valid sweep is also computed
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
    """Counts of how the attempts on one kind of input ended."""

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


def work(spec: Sweep) -> float:
    """Impacts that a sweep may take, generously: an impact each tenth of a period."""
    frequency = spec.scene.inputs.get("frequency", 1e3)
    scenes = spec.scene.particles * open_design(spec).realizations
    if spec.record is not None:
        scenes += spec.record.particles
        frequency = max(frequency, spec.record.inputs["frequency"])
    times = [spec.scene.duration, *([spec.record.duration] if spec.record else [])]
    longest = max(float(in_periods(time, np.array([frequency]))[0]) for time in times)
    return scenes * min(10.0 * longest + 10.0, 4.0 * spec.scene.measures.impact_budget)


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
    """Text tables, and one in five in netCDF, which is first read in a separate process."""
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
    """Give damaged results to the commands that read them."""
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
        sealed = bool(rng.random() < 0.7)  # without, it is first read in a separate process
        given = whole if sealed else whole[: whole.rindex(b"\nvibrosweep seal")]
        # a third of the attempts damage the metadata at the beginning
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


SCANS = {
    "windows": """title = "Windows to be spoilt"
[scene]
particles = 2
duration = 60.0
[sample]
design = "grid"
restitution = [0.7, 0.8]
amplitude = { start = 0.2, stop = 4.0, num = 8 }
[windows]
conditions = ["locked(1)", "periodic"]
""",
    "bifurcation": """title = "A diagram to be spoilt"
[scene]
particles = 2
duration = 60.0
[sample]
design = "grid"
amplitude = [1.2, 1.3, 1.4]
""",
    "basins": """title = "Basins to be spoilt"
[scene]
particles = 3
duration = 60.0
[sample]
design = "grid"
launch_velocity = [1.0, 5.0, 9.0]
""",
}
GRID = SPEC.replace(
    SPEC[SPEC.index("design") : SPEC.index("gravity")],
    """design = "grid"
restitution = [0.8, 0.9]
amplitude = [0.4, 1.2, 3.0]
""",
)


ELSEWHERE = ("external", "external file", "raw", "virtual")


def fuzz_saved_again(directory: Path, rng: np.random.Generator, number: int) -> Findings:
    """Results of every kind, saved again by another program with other contents."""
    findings = Findings()
    texts = {**MOTIONS, "grid": GRID, **SCANS}
    path, page = directory / "again.h5", directory / "page.html"
    commands: tuple[tuple[object, ...], ...] = (
        ("info", path),
        ("verify", path, "--sample", 1),
        ("figures", path, "-o", directory / "figures"),
        ("explore", path, "-o", page, "--force"),
    )

    @functools.cache
    def contents(name: str) -> bytes:
        (directory / "sweep.toml").write_text(texts[name])
        command = name if name in SCANS else "run"
        end, said = attempt(command, directory / "sweep.toml", "-o", directory / f"{name}.h5")
        if end != "accepted":
            raise RuntimeError(f"a sound {name}: {end}: {said}")
        whole = (directory / f"{name}.h5").read_bytes()
        return whole[: whole.rindex(b"\nvibrosweep seal")]

    os.mkfifo(directory / "pipe")
    for round_number in range(number):
        name = str(rng.choice(list(texts)))
        path.unlink(missing_ok=True)
        path.write_bytes(contents(name))
        done = saved_again(rng, path)
        if done.endswith(ELSEWHERE) and rng.random() < 0.5:  # as if this program had written it
            with path.open("r+b") as file:
                append_seal(file)
        for words in commands if round_number % 4 == 0 else [commands[rng.integers(4)]]:
            end, said = attempt(*words)
            note(findings, end, said, f"{words[0]} of {name}, attempt {round_number}: {done}")
    return findings


def saved_again(rng: np.random.Generator, path: Path) -> str:
    """Change variables, attributes or links of a result, with HDF5 itself; say how."""
    with h5py.File(path, "r+") as file:
        groups = [file, *(file[name] for name in ("record", "identity") if name in file)]
        group = groups[rng.integers(len(groups)) if rng.random() < 0.3 else 0]
        kind = rng.random()
        if kind < 0.6 and names_of(group):
            chosen = rng.choice(names_of(group), size=int(rng.choice([1, 1, 3])), replace=False)
            return ", ".join(replaced(rng, group, str(name)) for name in chosen)
        if kind < 0.85:
            names = names_of(group)
            holder = group[str(rng.choice(names))] if names and rng.random() < 0.5 else group
            return other_attribute(rng, holder)
        return linked(rng, group, path.parent)


def names_of(group: h5py.Group) -> list[str]:
    return [name for name, one in group.items() if isinstance(one, h5py.Dataset)]


def replaced(rng: np.random.Generator, group: h5py.Group, name: str) -> str:
    """Give a variable other values, with its dimensions and attributes where they still fit."""
    old = group[name]
    shape, kept = old.shape or (), {k: v for k, v in old.attrs.items() if "DIM" not in k}
    scales = [[scale.name for scale in old.dims[i].values()] for i in range(len(shape))]
    number = np.random.default_rng(int(rng.integers(1 << 30))).random(shape)
    what, data = (
        ("strings", np.full(shape, "text", object)),
        ("bytes", np.full(shape, b"\xff\xfe")),
        ("compound", np.zeros(shape, [("a", "f8"), ("b", "i4")])),
        ("opaque", np.full(shape, b"abcd", "V4")),
        ("empty", h5py.Empty("f8")),
        ("length 0", np.empty((0,) * max(len(shape), 1))),
        ("1e308", np.full(shape, 1e308)),
        ("-1e308", np.full(shape, -1e308)),
        ("both", np.where(number < 0.5, -1e308, 1e308)),
        ("1e-320", np.full(shape, 1e-320)),
        ("nan", np.full(shape, np.nan)),
        ("inf", np.full(shape, np.inf)),
        ("some inf", np.where(number < 0.5, np.inf, number)),
        ("negative", -number),
        ("complex", number + 1j),
        ("large", np.full(shape, 2**64 - 1, np.uint64)),
        ("-128", np.full(shape, -128, np.int8)),
        ("bool", number < 0.5),
        ("half", number.astype(np.float16)),
        ("big-endian", number.astype(">f8")),
        ("scalar", np.float64(0.9)),
        ("longer", np.zeros(tuple(n + 1 for n in shape) or (2,))),
        ("flat", np.zeros(int(np.prod(shape)))),
        ("deeper", np.zeros((*shape, 2))),
    )[rng.integers(24)]
    along = []
    for other in names_of(group) if "CLASS" in kept else ():
        for i in range(len(group[other].shape or ())):
            with contextlib.suppress(RuntimeError):  # HDF5 does not always find them
                if old in group[other].dims[i].values():
                    group[other].dims[i].detach_scale(old)
                    along.append((other, i))
    del old, group[name]
    kind = {"dtype": h5py.string_dtype()} if what == "strings" else {}
    new = group.create_dataset(name, data=data, **kind)
    for key, value in kept.items():
        if key not in ("CLASS", "NAME", "REFERENCE_LIST", "_Netcdf4Dimid", "_Netcdf4Coordinates"):
            new.attrs[key] = value
    if "CLASS" in kept:
        new.make_scale(name)
        for other, i in along:
            with contextlib.suppress(RuntimeError, ValueError):  # fails if the new one is no array
                group[other].dims[i].attach_scale(new)
    elif new.shape == shape:
        for i, found in enumerate(scales):
            for scale in found:
                with contextlib.suppress(RuntimeError):
                    new.dims[i].attach_scale(group.file[scale])
    return f"{group.name}/{name}: {what}"


def other_attribute(rng: np.random.Generator, holder: h5py.Group | h5py.Dataset) -> str:
    """Give one attribute another value, or take it away."""
    names = [n for n in holder.attrs if "DIM" not in n and n not in ("CLASS", "REFERENCE_LIST")]
    name = str(rng.choice([*names, "title", "units"]))
    if rng.random() < 0.15 and name in holder.attrs:
        del holder.attrs[name]
        return f"{holder.name} without {name}"
    value = (
        np.bytes_(b"\xff\xfe"), np.bytes_(b"text"), "", "text", "<script>", "a\n\tb", 1e308,
        np.nan, -1, np.array([1.0, 2.0]), np.array([], float), np.array(["a", "b"], object),
        h5py.Empty("f8"), h5py.Empty("S1"), np.zeros(2, [("a", "f8")]), np.void(b"abcd"), 2**63,
        True, 1j, "\ud7ff\U0010ffff", "reflect", "moving", "sprung", "windows", "staggered",
    )[rng.integers(25)]  # fmt: skip
    if name in holder.attrs:
        del holder.attrs[name]
    if isinstance(value, np.ndarray) and value.dtype == object:
        holder.attrs.create(name, value, dtype=h5py.string_dtype())
    elif isinstance(value, np.bytes_) and rng.random() < 0.5:
        holder.attrs.create(name, value, dtype=h5py.string_dtype())  # of variable length
    else:
        holder.attrs[name] = value
    return f"{holder.name}: {name} = {value!r}"


def linked(rng: np.random.Generator, group: h5py.Group, directory: Path) -> str:
    """Make a member of a group a link: to a pipe, which blocks, or in a circle."""
    name = str(rng.choice([*group, "new"]))
    pipe = str(directory / "pipe")
    shape = getattr(group.get(name), "shape", None) or (3,)
    if name in group:
        del group[name]
    what = str(rng.choice([*ELSEWHERE, "nothing", "soft", "circle", "group"]))
    if what == "external":
        group[name] = h5py.ExternalLink(pipe, "/x")
    elif what == "external file":
        group[name] = h5py.ExternalLink(str(next(directory.glob("*.h5"))), "/status")
    elif what == "nothing":
        group[name] = h5py.SoftLink("/nowhere")
    elif what == "soft":
        group[name] = h5py.SoftLink("/gravity")
    elif what == "circle":
        group[name] = group.file["/"]
    elif what == "group":
        group.create_group(name)
    elif what == "raw":
        group.create_dataset(name, shape, "f8", external=[(pipe, 0, h5py.h5f.UNLIMITED)])
    else:
        layout = h5py.VirtualLayout(shape, "f8")
        layout[...] = h5py.VirtualSource(pipe, "x", shape)
        group.create_virtual_dataset(name, layout)
    return f"{group.name}/{name}: {what}"


FUZZERS = {
    "sweep files": fuzz_specs,
    "tables": fuzz_tables,
    "result files": fuzz_results,
    "results saved again": fuzz_saved_again,
}


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
    for name, default in (
        ("specs", 2000), ("tables", 1000), ("results", 1000), ("again", 1000), ("seed", 1),
    ):  # fmt: skip
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--write", action="store_true", help="write the table into the report")
    options = parser.parse_args()
    began = time.perf_counter()
    wanted = options.specs, options.tables, options.results, options.again
    numbers = dict(zip(FUZZERS, wanted, strict=True))
    found = campaign(numbers, options.seed)
    for name, findings in found.items():
        for failure in findings.failures:
            print(f"{name}: {failure}\n")
    text = report(found, time.perf_counter() - began, options.seed)
    print(text) if not options.write else write_section("fuzz", text, REPORT)
    raise SystemExit(any(findings.failures for findings in found.values()))


if __name__ == "__main__":
    main()
