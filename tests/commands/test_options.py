"""Absurd values of every option of every command: exit code 0 or 2, one message, no traceback."""

import argparse

import pytest

from tests.cases import each_of
from vibrosweep.cli import _parser, main
from vibrosweep.commands import COMMANDS
from vibrosweep.errors import ParameterError

SPEC = """
title = "One ball"
[scene]
duration = 5.0
"""
ABSURD = ("nan", "inf", "-1", "0", "1e400", "", "1.5", "9" * 400, "é\n", "--", "-")


def leaves(parser, words=()):
    """Yield each command, or part of one, as its words and its parser."""
    inside = [one for one in parser._actions if isinstance(one, argparse._SubParsersAction)]
    if not inside:
        yield words, parser
    for one in inside:
        for name, added in one.choices.items():
            yield from leaves(added, (*words, name))


def needs_file(action):
    return not action.option_strings and action.nargs != "*"


LEAVES = {
    words: [one for one in parser._actions if one.dest != "help"]
    for words, parser in leaves(_parser(COMMANDS))
}
VALUED = [
    words
    for words, actions in LEAVES.items()
    if any(one.option_strings and one.nargs != 0 for one in actions)
]
FILES = [w for w, actions in LEAVES.items() if any(needs_file(one) for one in actions)]


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("options")
    (folder / "one.toml").write_text(SPEC, encoding="utf-8")
    # read after the options, and missing: nothing is computed
    (folder / "none.toml").write_text(f'{SPEC}[sample]\ndesign = "no.csv"\n', encoding="utf-8")
    (folder / "bad.csv").write_text("nothing\n1\n", encoding="utf-8")
    assert main(["run", str(folder / "one.toml"), "-o", str(folder / "one.h5"), "-q"]) == 0
    return folder


@pytest.fixture(autouse=True)
def elsewhere(tmp_path, monkeypatch):
    """Relative paths are written into a folder of their own; nothing is served or distributed."""

    def refused(*arguments):
        raise ParameterError("not here")

    monkeypatch.chdir(tmp_path)
    for name in ("runs.cluster.local_workers", "runs.cluster.connected", "explorer.server.serve"):
        monkeypatch.setattr(f"vibrosweep.{name}", refused)


def complete(words, place):
    """Return a command with the files that it needs, which hold little or nothing to compute."""
    result = "one.h5" if words == ("verify",) else "bad.csv"  # drawing takes longer than proofs
    files = {"result": result, "tracks": "bad.csv"}
    needed = [files.get(one.dest, "none.toml") for one in LEAVES[words] if needs_file(one)]
    return [*words, *(str(place / name) for name in needed)]


def ended(words, capsys):
    """Run a command; return its exit code, after a look at its message."""
    try:
        code = main(words)
    except SystemExit as end:  # of argparse
        code = end.code
    message = capsys.readouterr().err
    assert code == 0 or (code == 2 and message.strip()), words
    assert "Traceback" not in message, words
    assert len(message) < 3000, words
    return code


@pytest.mark.parametrize("words", VALUED, ids=" ".join)
def test_absurd_values(words, place, capsys):
    for one in LEAVES[words]:
        if one.option_strings and one.nargs != 0:
            for value in (*ABSURD, str(place), str(place / "none" / "x")):
                ended([*complete(words, place), f"{one.option_strings[-1]}={value}"], capsys)


GRID = """
title = "A grid"
[sample]
design = "grid"
restitution = [0.8, 0.9]
amplitude = [1.0, 2.0]
"""


@each_of(
    ("command", "option", "value"),
    [
        ("bifurcation", "--observable", "height"),
        ("branches", "--points", "1"),
        ("branches", "--doublings", "99"),
        ("boundaries", "--impacts", "999999"),
        ("orbits", "--periods", "999999"),
    ],
)
def test_a_message_names_an_option_as_it_was_typed(command, option, value, place, capsys):
    text = GRID if command == "boundaries" else GRID.replace("restitution = [0.8, 0.9]\n", "")
    (place / "grid.toml").write_text(text, encoding="utf-8")
    words = [command, str(place / "grid.toml"), option, value, "-o", str(place / "new.h5")]
    assert main(words) == 2
    assert option in capsys.readouterr().err


@each_of("words", FILES)
def test_absurd_files(words, place, capsys):
    names = ("", ".", "none.h5", str(place / "bad.csv"), "x" * 300, "é\n", "nan")
    for name in names:
        assert ended([*complete(words, place)[:-1], name], capsys) == 2, name


@each_of("words", LEAVES)
def test_unknown_options(words, place, capsys):
    assert ended([*complete(words, place), "--nope"], capsys) == 2
