"""Mistakes as data, and the dialects in which messages are written.

A mistake holds a key, the value given, the rule that it breaks and the remedy.  A text is a tuple
of parts: plain strings, and parts that a sweep file, Python and the command line write differently.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

ABSENT: Final = object()
LONGEST: Final = 60  # characters of a value that are shown


class Key(NamedTuple):
    """A key of a sweep file by its path, as ``scene.duration``; in Python the keyword."""

    path: str


class Value(NamedTuple):
    """A value; a tuple is a range."""

    value: object


class Word(NamedTuple):
    """A word that a sweep file, Python and the command line spell differently."""

    file: str
    python: str
    option: str = ""  # by default as in a sweep file


class Cell(NamedTuple):
    """A place in a table of realizations: a value, a column, a row or the whole table."""

    table: str  # its file
    column: str | None = None
    row: int = 0  # counted from 1 after the line of names; 0 for no row

    def __str__(self) -> str:
        row = f"row {self.row} (the first row of values is 1)" if self.row else ""
        return row if self.column is None else f'column "{self.column}"{row and f", {row}"}'


class Mistake(NamedTuple):
    """One mistake: what was given, and how to correct it."""

    # Path in a sweep file, or a cell; a path that ends with a dot stands for a whole table
    key: str | Cell
    rule: Text  # the allowed values, or the contradiction
    value: object = ABSENT
    remedy: Text = ()


Text: TypeAlias = "str | Key | Value | Word | Mistake | tuple[Text, ...]"


def table(name: str) -> Word:
    """Return a table of a sweep file, which is a mapping in Python."""
    return Word(f"[{name}]", name)


def argument(name: str) -> Word:
    """Return what stands before the value of an argument: ``points = ``, or ``--points `` there."""
    return Word(f"{name} = ", f"{name} = ", f"--{name.replace('_', '-')} ")


RANGE: Final = Word("[low, high]", "(low, high)")
SWITCH: Final = Word("true or false", "True or False")
OUTPUT: Final = Word("output=", "output=", "-o")
FORCE: Final = Word("force=True", "force=True", "--force")
CHUNK: Final = Word("chunk=", "chunk=", "--chunk")
IMPACT_BUDGET: Final = Word("impact_budget=", "impact_budget=", "--impact-budget")


class Dialect(NamedTuple):
    """Functions that write keys, values and words in one style."""

    key: Callable[[str], str]
    value: Callable[[object], str]
    word: Callable[[Word], str]

    def write(self, text: Text) -> str:
        """Return a text in this style, without characters that a terminal takes as commands."""
        return visible(self._written(text))

    def _written(self, text: Text) -> str:
        if isinstance(text, str):
            return text
        if isinstance(text, Key):
            return self.key(text.path)
        if isinstance(text, Value):
            return cut(self.value(text.value))
        if isinstance(text, Word):
            return self.word(text)
        if isinstance(text, Mistake):
            return self._mistake(text)
        return "".join(map(self._written, text))

    def _mistake(self, mistake: Mistake) -> str:
        rest = "; ".join(filter(None, map(self._written, (mistake.rule, mistake.remedy))))
        if isinstance(mistake.key, Cell):
            return f"{_place(mistake)} {rest}".lstrip()
        head = self.key(mistake.key)
        if mistake.value is not ABSENT:
            head += f" = {cut(self.value(mistake.value))}"
        return f"{head}: {rest}" if head else rest


def _place(mistake: Mistake) -> str:
    """Write a cell of a table, with the value that it holds."""
    if mistake.value is ABSENT:
        return str(mistake.key)
    text = str(mistake.value) or "nothing"
    return f"{mistake.key}: {cut(text) if text.isprintable() else repr(text)}"


def visible(text: str) -> str:
    """Write characters that cannot be printed, apart from ends of lines, as Python does."""
    if text.replace("\n", "").isprintable():
        return text
    return "".join(c if c == "\n" or c.isprintable() else repr(c)[1:-1] for c in text)


def escaped(path: object) -> str:
    """Return a hint if a path holds a character that a backslash in double quotes has made."""
    if str(path).isprintable():
        return ""
    return "; write a path with backslashes in single quotes, as in 'C:\\temp\\a.csv'"


def cut(text: str) -> str:
    """Shorten a text to a readable length."""
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def toml(value: object, most: int | None = None) -> str:
    """Write a value as TOML does; of a list, only the first `most` members."""
    if isinstance(value, bool):
        return str(value).lower()
    import json  # only a mistake needs it

    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, list | tuple):
        return f"[{', '.join(toml(v, most) for v in value[:most])}]"
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{k} = {toml(v, most)}' for k, v in value.items())} }}"
    if isinstance(value, int) and value.bit_length() > 1000:
        return "a huge number"  # Python refuses to print integers of many thousand digits
    if isinstance(value, int | float):
        return str(value)
    return json.dumps(getattr(value, "name", str(value)))


def _python(value: object) -> str:
    value = value.tolist() if hasattr(value, "tolist") else value
    huge = isinstance(value, int) and value.bit_length() > 1000
    return "a huge number" if huge else repr(value)


TOML: Final = Dialect(
    lambda path: path.removesuffix("."), lambda value: toml(value, LONGEST), lambda word: word.file
)
COMMAND_LINE: Final = Dialect(TOML.key, TOML.value, lambda word: word.option or word.file)
PYTHON: Final = Dialect(lambda path: path.rpartition(".")[2], _python, lambda word: word.python)


class Mistakes:
    """All mistakes in one description of a computation.

    `where` is the name of its file, with which messages begin, and `dialect` the dialect in which
    they are written.  `given` holds the keyword arguments as the user gave them, for messages.
    """

    def __init__(
        self, where: str = "", dialect: Dialect = TOML, given: Mapping[str, Any] | None = None
    ) -> None:
        self.where, self.dialect, self.given = where, dialect, given or {}
        self.listed: list[Mistake] = []
        # Keys, or whole tables, with an invalid value.  Rules that involve one of them are not
        # checked, so that one mistake is never reported twice.
        self.broken: set[str] = set()

    def add_cell(
        self,
        rule: Text,
        column: str | None = None,
        row: int = 0,
        value: object = ABSENT,
        remedy: Text = (),
    ) -> None:
        """Add a mistake in a table of realizations."""
        self.listed.append(Mistake(Cell(self.where, column, row), rule, value, remedy))

    def add(
        self,
        key: str,
        rule: Text,
        value: object = ABSENT,
        remedy: Text = (),
        involves: Iterable[str] = (),
    ) -> None:
        """Add a mistake of ``key`` against a rule that also involves the keys ``involves``."""
        if not any(self.is_broken(k) for k in (key, *involves)):
            value = value if value is ABSENT else self.given.get(PYTHON.key(key), value)
            self.listed.append(Mistake(key, rule, value, remedy))

    def add_broken(self, key: str, rule: Text, value: object, remedy: Text = ()) -> None:
        """Add a mistake in the value of ``key`` itself."""
        value = self.given.get(PYTHON.key(key), value)
        self.listed.append(Mistake(key, rule, value, remedy))
        self.broken.add(key)

    def is_broken(self, key: str) -> bool:
        """Return whether ``key`` or the table that holds it is invalid."""
        return key in self.broken or key.partition(".")[0] in self.broken


def nearest(word: str, known: Iterable[str], least: float = 0.6) -> str | None:
    """Return the known word that ``word`` was probably meant to be, or None.

    At least a share `least` of their letters is equal.
    """
    import difflib  # only a mistake needs it

    found = difflib.get_close_matches(word.lower(), list(known), n=1, cutoff=least)
    return found[0] if found else None


def separator_mistake(names: Sequence[str]) -> str:
    """Return the mistake of a CSV header with another separator than the comma, or ""."""
    for mark, word in ((";", "semicolons"), ("\t", "tabs")):
        if len(names) == 1 and mark in names[0]:
            return (
                f"has columns separated by {word}; separate them by commas, and write decimals "
                f"with a point"
            )
    return ""


def quoted(words: Iterable[str]) -> str:
    """List words in quotes: ``"a", "b" or "c"``."""
    *first, last = (f'"{word}"' for word in words)
    return f"{', '.join(first)} or {last}" if first else last
