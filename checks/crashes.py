"""Simulate a power cut at every moment of a run, and count what is lost.

    python checks/crashes.py [--states 400] [--seed 1] [--write]

All operations of a run on its files are recorded: names that appear and disappear, bytes written,
flushes.  The power may fail after each of these operations.  Data that were flushed by then are on
the disk; all others may be there completely, partly or not at all: a name without its bytes or
bytes without a name, a write that stopped half way or left zeros, and of two operations only the
later one.  Each such state is laid out in a directory and the same command is given again: it must
succeed, recompute no finished chunk, and none at all once the parts were being removed, give the
bytes of an undisturbed run, and leave no other file.  At no moment may anything but a complete file
have the name of the result.
"""

from __future__ import annotations

import io
import os
import platform
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple
from unittest import mock

import numpy as np

from accuracy import options_of, processor, show, table
from vibrosweep.cli import main as command
from vibrosweep.store.disk import Disk
from vibrosweep.store.parts import LOCK, MANIFEST, Parts, run_directory

REPORT = Path(__file__).parent / "README.md"
OUTPUT, SPEC = "out.h5", "sweep.toml"
SWEEP = """title = "A sweep whose power is cut"
[scene]
particles = 2
[sample]
realizations = {realizations}
seed = 3
amplitude = [0.001, 3.0]
restitution = [0.5, 0.99]
[measure]
separation = true
impact_budget = 32
"""
CREATED = {"created": "2000-01-01T00:00:00+00:00"}
ENDS = (f"/{MANIFEST}", f"/{LOCK}")  # their removal shows that a run is clearing away its parts
MODES = ("kept", "dropped", "no bytes", "zeros", "torn", "any")
Tree = dict[str, bytes | None]  # contents of each path; None for a directory


class Scenario(NamedTuple):
    """A command, and whether it replaces a result."""

    chunk: int
    chunks: int
    words: tuple[str, ...] = ()
    replaces: bool = False


SCENARIOS = {
    "one chunk": Scenario(4, 1),
    "3 chunks": Scenario(2, 3),
    "200 chunks": Scenario(1, 200),
    "an old result replaced": Scenario(2, 3, ("--force",), replaces=True),
    "a retry": Scenario(2, 12, ("--retry-failed", "--impact-budget", "1000000"), replaces=True),
}


class Operation(NamedTuple):
    """An operation on a numbered file or on a name, or the end of a chunk."""

    kind: str
    path: str = ""
    file: int = -1  # or the number of the chunk
    old: str = ""  # the name before a renaming
    place: int = 0
    data: bytes = b""

    @property
    def folder(self) -> str:
        """Directory of the name."""
        return self.path.rpartition("/")[0] or "."


class Recorder:
    """Record of the operations of this process on names and new files below a directory.

    HDF5 writes through an object of Python, so that nothing is hidden in its library.
    """

    def __init__(self, root: Path) -> None:
        self.root = root
        self.operations: list[Operation] = []
        self._files: dict[int, int] = {}  # numbers of files, by inode
        self._count = 0

    def _inside(self, path: Any) -> str | None:
        """Path below the directory; None outside."""
        inside = os.path.relpath(os.path.realpath(path), self.root)
        return None if inside.startswith("..") else inside

    def _note(self, kind: str, path: Any, **more: Any) -> None:
        inside = self._inside(path)
        if inside is not None:
            self.operations.append(Operation(kind, inside, **more))

    def begins(self, path: Any) -> None:
        """Note a new file."""
        self._files[Path(path).stat().st_ino] = self._count
        self._note("create", path, file=self._count)
        self._count += 1

    def _moves(self, kind: str, old: Any, new: Any) -> None:
        file = self._files.get(Path(new).stat().st_ino, -1)
        self._note(kind, new, old=self._inside(old) or "", file=file)

    def _flushes(self, descriptor: int) -> None:
        found = os.fstat(descriptor)
        if not stat.S_ISDIR(found.st_mode):
            self.operations.append(Operation("flush", file=self._files[found.st_ino]))
            return
        for path in (self.root, run_directory(self.root / OUTPUT)):
            if path.exists() and os.path.samestat(found, path.stat()):
                self._note("flush names", path)

    @contextmanager
    def recording(self) -> Iterator[None]:
        """Record all operations inside the block."""
        opening, beginning, writing, cutting = os.open, Disk.__init__, Disk.write, Disk.truncate
        finishing = Parts.write

        def opened(path: Any, flags: int, *rest: Any, **more: Any) -> int:
            new = flags & os.O_CREAT and not os.path.lexists(path)
            descriptor = opening(path, flags, *rest, **more)
            if new and self._inside(path):
                self.begins(path)
            return descriptor

        def begun(disk: Disk, path: Path, output: Path) -> None:
            beginning(disk, path, output)
            self.begins(path)

        def write(disk: Disk, data: Any, /) -> int:
            file, place = self._files[os.fstat(disk.fileno()).st_ino], disk.tell()
            self.operations.append(
                Operation("write", file=file, place=place, data=bytes(memoryview(data)))
            )
            return writing(disk, data)

        def cut(disk: Disk, size: int | None = None, /) -> int:
            size, file = cutting(disk, size), self._files[os.fstat(disk.fileno()).st_ino]
            self.operations.append(Operation("cut", file=file, place=size))
            return size

        def finished(parts: Parts, index: int, columns: Any) -> None:
            finishing(parts, index, columns)
            self.operations.append(Operation("finished", file=index))

        notes: Mapping[str, Callable[..., object]] = {
            "fsync": self._flushes,
            "replace": partial(self._moves, "rename"),
            "link": partial(self._moves, "link"),
            "unlink": partial(self._note, "unlink"),
            "mkdir": lambda path, *mode: self._note("mkdir", path),
            "rmdir": partial(self._note, "rmdir"),
        }
        with ExitStack() as stack:
            patch = lambda *what: stack.enter_context(mock.patch.object(*what))  # noqa: E731
            for name, note in notes.items():
                patch(os, name, _noting(getattr(os, name), note))
            patch(os, "open", opened)
            patch(Parts, "write", finished)
            patch(Disk, "__init__", begun)
            patch(Disk, "write", write)
            patch(Disk, "truncate", cut)
            yield


def _noting(call: Callable[..., Any], note: Callable[..., object]) -> Callable[..., Any]:
    def noting(*arguments: Any, **more: Any) -> Any:
        result = call(*arguments, **more)
        note(*arguments)
        return result

    return noting


class Recorded:
    """A run, and the states that a power cut at one of its moments may leave."""

    def __init__(self, first: Tree, operations: list[Operation]) -> None:
        self.first = first
        self.operations = operations

    def durable(self, moment: int) -> list[bool]:
        """Return, for each operation until a moment, whether it was flushed by then."""
        flushed: set[int | str] = set()
        found = []
        for one in reversed(self.operations[:moment]):
            if one.kind == "flush":
                flushed.add(one.file)
            elif one.kind == "flush names":
                flushed.add(one.path)
            of = one.file if one.kind in ("write", "cut") else one.folder
            found.append(of in flushed)
        return found[::-1]

    def left(self, moment: int, mode: str, rng: np.random.Generator) -> Tree:
        """Return the state after a cut at a moment; data that were not flushed are as in `mode`."""
        names: dict[str, int | None] = dict.fromkeys((".", *self.first))
        data: dict[int, bytearray] = {}
        for number, (path, held) in enumerate(self.first.items(), start=1):
            if held is not None:
                names[path], data[-number] = -number, bytearray(held)
        for one, safe in zip(self.operations[:moment], self.durable(moment), strict=True):
            fate = "kept" if safe else str(rng.choice(MODES[:-1])) if mode == "any" else mode
            if one.kind in ("write", "cut"):
                _write(data.setdefault(one.file, bytearray()), one, fate)
            elif fate != "dropped" and one.folder in names:
                _name(names, one)
        return {
            path: None if file is None else bytes(data.get(file, b""))
            for path, file in names.items()
            if path != "."
        }

    def promised(self, moment: int) -> tuple[set[int], bool]:
        """Chunks that were finished by a moment, and whether the parts were being cleared away."""
        done = self.operations[:moment]
        chunks = {one.file for one in done if one.kind == "finished"}
        ended = any(one.kind == "unlink" and one.path.endswith(ENDS) for one in done)
        return chunks, ended


def _write(data: bytearray, one: Operation, fate: str) -> None:
    """Perform a change of a file, completely or as the power cut leaves it."""
    if fate in ("dropped", "no bytes"):
        return
    if one.kind == "cut":
        del data[one.place :]
        data.extend(bytes(one.place - len(data)))
        return
    new = {"zeros": bytes(len(one.data)), "torn": one.data[: len(one.data) // 2]}.get(
        fate, one.data
    )
    data.extend(bytes(max(0, one.place - len(data))))
    data[one.place : one.place + len(new)] = new


def _name(names: dict[str, int | None], one: Operation) -> None:
    """Perform a change of names."""
    if one.kind == "mkdir":
        names[one.path] = None
    elif one.kind in ("create", "link", "rename"):
        names[one.path] = one.file
        if one.kind == "rename":
            names.pop(one.old, None)
    elif one.kind == "unlink" or (
        one.kind == "rmdir" and not any(path.startswith(f"{one.path}/") for path in names)
    ):
        names.pop(one.path, None)


def tree_of(root: Path) -> Tree:
    """Read the contents of a directory."""
    found = sorted(root.rglob("*"))
    return {str(p.relative_to(root)): None if p.is_dir() else p.read_bytes() for p in found}


def lay_out(tree: Tree, root: Path) -> None:
    """Make a directory that holds a tree, and nothing else."""
    shutil.rmtree(root, ignore_errors=True)
    root.mkdir()
    for path, held in sorted(tree.items()):
        (root / path).mkdir() if held is None else (root / path).write_bytes(held)


def given(root: Path, scenario: Scenario, words: tuple[str, ...]) -> tuple[int, str]:
    """Run the command; return its exit code and output."""
    said, output = io.StringIO(), str(root / OUTPUT)
    chunk = ("--chunk", str(scenario.chunk), "--threads", "1")
    with (
        redirect_stdout(said),
        redirect_stderr(said),
        mock.patch("vibrosweep.runs.result.provenance", return_value=CREATED),
    ):
        code = command(["run", str(root / SPEC), "-o", output, *chunk, *words])
    return code, said.getvalue()


def record(root: Path, scenario: Scenario) -> tuple[Recorded, bytes]:
    """Record a run; return it and the result."""
    spec = SWEEP.format(realizations=scenario.chunk * scenario.chunks)
    lay_out({SPEC: spec.encode()}, root)
    if scenario.replaces:
        given(root, scenario, ())
    recorder = Recorder(root.resolve())
    first = tree_of(root)
    with recorder.recording():
        code, said = given(root, scenario, scenario.words)
    run = Recorded(first, recorder.operations)
    found = tree_of(root)
    if code or run.left(len(run.operations), "kept", np.random.default_rng()) != found:
        raise SystemExit(f"the record does not give the files that the run left ({code}): {said}")
    result = found[OUTPUT]
    assert result is not None
    return run, result


@dataclass
class Findings:
    """Counts of a campaign."""

    operations: int = 0
    states: int = 0
    finished: int = 0
    lost: int = 0
    incomplete: int = 0
    refused: int = 0
    different: int = 0
    left: int = 0

    @property
    def failures(self) -> int:
        return self.lost + self.incomplete + self.refused + self.different + self.left


def again(root: Path, scenario: Scenario, tree: Tree, result: bytes) -> bool:
    """Run the command again; return whether it succeeds."""
    lay_out(tree, root)
    # a run begun with --force continues without it; if none was begun, --force is given again
    tries = ((), scenario.words) if scenario.words == ("--force",) else (scenario.words,)
    for words in tries:
        code, said = given(root, scenario, words)
        if code == 0:
            return True
        if tree == {SPEC: tree[SPEC], OUTPUT: result}:
            return "is the finished result of exactly this sweep" in said
    return False


def campaign(root: Path, scenario: Scenario, states: int, seed: int) -> Findings:
    """Continue from a number of different states, or from all if there are fewer."""
    run, result = record(root, scenario)
    rng, seen = np.random.default_rng(seed), set()
    findings = Findings(operations=len(run.operations))
    moments = np.arange((len(run.operations) + 1) * len(MODES))
    for number in rng.permutation(moments).tolist():
        moment, mode = divmod(number, len(MODES))
        tree = run.left(moment, MODES[mode], rng)
        if (key := hash(frozenset(tree.items()))) not in seen:
            seen.add(key)
            _try(root, scenario, run, moment, tree, result, findings)
        if len(seen) == states:
            break
    return findings


def _try(
    root: Path,
    scenario: Scenario,
    run: Recorded,
    moment: int,
    tree: Tree,
    result: bytes,
    findings: Findings,
) -> None:
    """Continue from the state that a cut at a moment leaves, and compare."""
    chunks, ended = run.promised(moment)
    findings.states += 1
    findings.finished += len(chunks)
    findings.incomplete += tree.get(OUTPUT) not in (
        (result,) if ended else (result, run.first.get(OUTPUT))
    )
    computed: list[int] = []
    writing = Parts.write

    def write(parts: Parts, index: int, columns: Any) -> None:
        computed.append(index)
        writing(parts, index, columns)

    with (
        mock.patch.object(Parts, "write", write),
        mock.patch.object(os, "fsync", return_value=None),
    ):
        findings.refused += not again(root, scenario, tree, result)
    findings.lost += len(computed) if ended else len(chunks & set(computed))
    found = tree_of(root)
    findings.different += found.pop(OUTPUT, None) != result
    findings.left += set(found) != {SPEC}


def report(found: Mapping[str, Findings], seconds: float, seed: int) -> str:
    each = found.values()
    rows = [
        ("operations on files", *(f.operations for f in each)),
        ("states after a power cut from which the run was continued", *(f.states for f in each)),
        ("finished chunks in these states", *(f.finished for f in each)),
        ("finished chunks lost", *(f.lost for f in each)),
        ("incomplete files under the name of the result", *(f.incomplete for f in each)),
        ("states from which the same command does not continue", *(f.refused for f in each)),
        ("results that differ from that of an undisturbed run", *(f.different for f in each)),
        ("results with other files left beside them", *(f.left for f in each)),
    ]
    made = f"Python {platform.python_version()}; {processor()}; seed {seed}; {seconds:.0f} s"
    return f"{table(('', *found), rows)}\n\n*{made}.*"


def main() -> None:
    options = options_of(__doc__, states=(400, "of each kind of run, at most"), seed=1)
    began, found = time.perf_counter(), {}
    for name, scenario in SCENARIOS.items():
        with tempfile.TemporaryDirectory() as directory:
            root = Path(directory) / "disk"
            found[name] = campaign(root, scenario, options.states, options.seed)
    text = report(found, time.perf_counter() - began, options.seed)
    show(options, "crashes", text, REPORT)
    raise SystemExit(1 if any(findings.failures for findings in found.values()) else 0)


if __name__ == "__main__":
    main()
