"""Mistakes in a sweep: worded in the user's terms, collected, and raised together.

They are written as for a sweep file.  Where keywords of Python gave the sweep, `in_python` spells
them as Python does.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from vibrosweep.errors import SpecError
from vibrosweep.model.forcing import INPUTS
from vibrosweep.model.mount import OF_MOUNT
from vibrosweep.model.parameters import HIGH_BOUNCE, SPRUNG
from vibrosweep.spec.columns import GivenTable

ABSENT = object()
_LONGEST = 60
# What a sweep file calls `sample.restitution` or `[low, high]` -> what Python does
_IN_PYTHON: Final = tuple(
    (re.compile(pattern), text)
    for pattern, text in (
        (r"\b(?:scene|sample|measure|windows)\.(?=[a-z])", ""),
        (r"\[low, high\]", "(low, high)"),
        (r"\btrue or false\b", "True or False"),
        (r"a table: write \[\w+\] on a line of its own", "a mapping"),
        (r"at the top of the file|of \[(\w+)\]", "here"),
        (r"\bin \[(\w+)\]", "too"),
        (r"of this file too", "too"),
        (r"\bwrite \[([^\]]+)\]", r"write (\1)"),
        (r"\b(\w+) in \1\b", r"\1"),
    )
)


@dataclass
class Mistakes:
    """All that is wrong with one sweep."""

    # Name of the sweep file as messages print it; None where keywords gave the sweep
    file: str | None
    # The keywords as they were given, to be shown so
    given: Mapping[str, Any] = field(default_factory=dict)
    lines: list[str] = field(default_factory=list)  # one line for each mistake
    # Keys, or whole tables, with an invalid value.  Rules that involve one of them are not checked,
    # so that one mistake is never reported twice.
    broken: set[str] = field(default_factory=set)

    def add(
        self, key: str, text: str, value: object = ABSENT, involves: Iterable[str] = ()
    ) -> None:
        """Add a violation by ``key`` of a rule that also involves the keys ``involves``."""
        if not any(self.is_broken(k) for k in (key, *involves)):
            self._note(key, text, value)

    def add_broken(self, key: str, text: str, value: object) -> None:
        """Add a mistake in the value of ``key`` itself."""
        self._note(key, text, value)
        self.broken.add(key)

    def is_broken(self, key: str) -> bool:
        """Whether ``key`` or the table that holds it is invalid."""
        return key in self.broken or key.partition(".")[0] in self.broken

    def raise_any(self) -> None:
        """Raise one `SpecError` that lists every mistake, if there are any."""
        where = "" if self.file is None else f"{self.file}: "
        if len(self.lines) == 1:
            raise SpecError(f"{where}{self.lines[0]}")
        if self.lines:
            listed = "".join(f"\n  {line}" for line in self.lines)
            raise SpecError(f"{where}{len(self.lines)} mistakes{listed}")

    def _note(self, key: str, text: str, value: object) -> None:
        of = "" if value is ABSENT else f" = {shown(value)}"
        if self.file is None:
            key, text = in_python(key), in_python(text)
            if of and key in self.given:
                value = self.given[key]
                value = value.tolist() if hasattr(value, "tolist") else value
                of = f" = {_cut(repr(value))}"
            elif key == "scene":  # a rule between keywords
                self.lines.append(text)
                return
        self.lines.append(f"{key}{of}: {text}")


def in_python(text: str) -> str:
    """Spell a message about a sweep file for keywords of Python."""
    for pattern, python in _IN_PYTHON:
        text = pattern.sub(python, text)
    return text


def shown(value: object) -> str:
    """Format a value as in the TOML file, cut to a readable length."""
    # what lies beyond the longest text is never printed
    return _cut(toml(value, _LONGEST))


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def quoted(words: Iterable[str]) -> str:
    """List words in quotes: ``"a", "b" or "c"``."""
    *first, last = (f'"{word}"' for word in words)
    return f"{', '.join(first)} or {last}" if first else last


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that ``word`` was probably meant to be, or None."""
    import difflib  # only a mistake needs it

    found = difflib.get_close_matches(word.lower(), list(known), n=1)
    return found[0] if found else None


def likely_parameter(word: str, base: str = HIGH_BOUNCE) -> str | None:
    """Return the physical parameter of a base that an unknown word was probably meant to be."""
    short = word.lower()
    known = {n: p for n, p in INPUTS.items() if base == SPRUNG or n not in OF_MOUNT}
    for name, parameter in known.items():
        if word == parameter.symbol:  # v0 is not V0
            return name
    for name, parameter in known.items():
        if short and (short == parameter.symbol.lower() or name.startswith(short)):
            return name
    return nearest(word, known)


def toml(value: object, most: int | None = None) -> str:
    """Write a value as TOML does, of a list the first `most` members."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, list | tuple):
        return f"[{', '.join(toml(v, most) for v in value[:most])}]"
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{k} = {toml(v, most)}' for k, v in value.items())} }}"
    if isinstance(value, GivenTable):
        return json.dumps(str(value))
    if isinstance(value, int) and value.bit_length() > 1000:
        return "a huge number"  # Python refuses to print integers of many thousand digits
    return str(value)
