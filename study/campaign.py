"""A campaign: claims are saved as they are decided, so that a stopped campaign can be resumed."""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Final

import vibrosweep
from study import collect
from study.samples import Plan
from study.texts import texts
from study.verdict import Claim, Outcome
from vibrosweep.errors import SpecError

# Samples from which all claims are judged in two minutes
QUICK: Final = Plan(seeds=5, realizations=40)
FULL: Final = Plan()
# Seconds of processor time for claims from quick samples (AMD EPYC); others take less than one
SECONDS: Final = {
    "1": 1,
    "2": 1,
    "3": 1,
    "4a": 3,
    "4b": 1,
    "5": 3,
    "7": 6,
    "9": 3,
    "10": 3,
    "13": 8,
    "14": 4,
    "16": 11,
    "24": 8,
    "27": 1,
    "29": 3,
    "31": 1,
    "32": 1,
}
OF_FULL: Final = 6  # times as long take full samples
COMPILED: Final = 5  # minutes to compile all kernels


def chosen(asked: Iterable[str]) -> list[str]:
    """Keys of claims in order: all if none is selected; 4 stands for 4a and 4b."""
    asked = tuple(asked)
    if unknown := [one for one in asked if not _of(one)]:
        last = list(collect.TESTS)[-1]
        raise SpecError(f"--claims: there is no claim {unknown[0]}; claims are 1 to {last}")
    return [key for key in collect.TESTS if not asked or any(key in _of(one) for one in asked)]


def _of(asked: str) -> list[str]:
    return [key for key in collect.TESTS if asked in (key, key.rstrip("ab"))]


def _number(keys: Iterable[str]) -> int:
    """Number of claims, of which 4a and 4b are one."""
    return len({key.rstrip("ab") for key in keys})


def _counted(keys: Iterable[str]) -> str:
    number = _number(keys)
    return "1 claim" if number == 1 else f"{number} claims"


@dataclass(frozen=True)
class Campaign:
    """Claims to be judged from the samples of a plan, saved in a directory until all are."""

    plan: Plan
    keys: Sequence[str]
    directory: Path  # of the page
    libraries: str  # their names and versions, as a result of the package records them

    @property
    def room(self) -> Path:
        """Where decided claims are saved."""
        return self.directory / ".decided"

    @property
    def mark(self) -> bytes:
        """What outcomes depend on: the code, the libraries and the samples."""
        found = sha256(f"{replace(self.plan, threads=1)} {self.libraries}".encode())
        for package in (Path(__file__).parent, Path(vibrosweep.__file__).parent):
            for path in sorted(package.rglob("*.py")) + sorted(package.glob("*.toml")):
                found.update(path.read_bytes())
        return found.digest()

    def kept(self) -> dict[str, Outcome]:
        """Outcomes that a stopped campaign of the same mark has saved."""
        mark = self.mark
        paths = {key: self.room / key for key in self.keys}
        read = {key: path.read_bytes() for key, path in paths.items() if path.is_file()}
        size = sha256().digest_size
        return {
            key: pickle.loads(content[size:])
            for key, content in read.items()
            if content[:size] == sha256(mark + content[size:]).digest()
        }

    def judged(self) -> Iterator[Claim]:
        """Yield the claims one after the other, each saved first."""
        kept, mark, words = self.kept(), self.mark, texts()["claims"]
        for key in self.keys:
            if key not in kept:
                kept[key] = collect.TESTS[key](self.plan)
                self._keep(key, mark, pickle.dumps(kept[key]))
            yield Claim(key=key, **words[key], outcome=kept[key])

    def _keep(self, key: str, mark: bytes, content: bytes) -> None:
        self.room.mkdir(exist_ok=True)
        path = self.room / f"{key}.partial"
        path.write_bytes(sha256(mark + content).digest() + content)
        path.replace(self.room / key)

    def forecast(self) -> Iterator[str]:
        """Lines that say what is computed, and how long it takes."""
        open_ones = [key for key in self.keys if key not in self.kept()]
        samples = f"{self.plan.seeds} seeds of up to {self.plan.realizations} realizations"
        yield f"{_counted(self.keys)} of {_number(collect.TESTS)}, from {samples}"
        if len(open_ones) < len(self.keys):
            decided = _number(key for key in self.keys if key not in open_ones)
            yield f"{decided} are decided, {_number(open_ones)} are left"
        quick = sum(SECONDS.get(key, 0) for key in open_ones)
        seconds = quick * (OF_FULL if self.plan.seeds == FULL.seeds else 1)
        yield (
            f"about {10 * max(1, round(seconds / 10))} s of processor time; the first time kernels "
            f"are compiled, for up to {COMPILED} min more"
        )

    def state(self, decided: int) -> list[str]:
        """Sentences for the page: which claims are missing from it, and that samples are quick."""
        lines = []
        if decided < len(self.keys):
            shown = _number(self.keys[:decided])
            lines.append(f"{shown} of {_counted(self.keys)} are decided so far.")
        if len(self.keys) < len(collect.TESTS):
            lines.append(f"{_counted(self.keys)} of {_number(collect.TESTS)} were selected.")
        if self.plan.seeds < FULL.seeds:
            lines.append(
                f"Quick samples: {self.plan.seeds} seeds of {self.plan.realizations} realizations "
                f"instead of {FULL.seeds} of {FULL.realizations}, so that more claims cannot be "
                f"judged. python -m study --full takes the full samples."
            )
        return lines

    def forget(self) -> None:
        """Remove the claims of this campaign, all of which its page shows."""
        for key in self.keys:
            (self.room / key).unlink(missing_ok=True)
        if not any(self.room.iterdir()):
            self.room.rmdir()
