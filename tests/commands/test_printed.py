"""What commands print: lines, one JSON object, or nothing; and the help that they give."""

import json
import re
import sys
from types import SimpleNamespace

import pytest

import vibrosweep as vs
from tests.cases import each_of
from vibrosweep.cli import main
from vibrosweep.commands import COMMANDS

NAMESPACES = (vs, vs.analysis, vs.figures, vs.figures.style, vs.theory, vs.theory.sprung, vs.lab)
SPEC = """
title = "Three balls"
[scene]
duration = 5.0
[sample]
design = "grid"
restitution = [0.7, 0.8, 0.9]
"""


@pytest.fixture(scope="module")
def spec(tmp_path_factory):
    path = tmp_path_factory.mktemp("printed") / "three.toml"
    path.write_text(SPEC, encoding="utf-8")
    assert main(["run", str(path), "-o", str(path.with_suffix(".h5")), "-q"]) == 0
    return path


def printed(capsys, *words):
    """Return the JSON object that a command prints, and its exit code."""
    code = main([*map(str, words), "--json"])
    return json.loads(capsys.readouterr().out, parse_constant=pytest.fail), code


@each_of("space", [*NAMESPACES, vs.errors])
def test_a_public_namespace_lists_its_public_names_only(space):
    assert dir(space) == sorted(space.__all__)


def test_a_result_as_json(spec, capsys):
    found, code = printed(capsys, "info", spec.with_suffix(".h5"))
    assert (code, found["kind"], found["finished"]) == (0, "sweep", True)
    assert found["attributes"]["title"] == "Three balls"
    restitution = found["variables"]["restitution"]
    assert (restitution["min"], restitution["max"], restitution["units"]) == (0.7, 0.9, "1")
    assert found["summary"]["variables"]["status"] == {"completed": 3}
    heights = vs.open_sweep(spec.with_suffix(".h5")).rebound_height_max
    assert found["summary"]["variables"]["rebound_height_max"]["max"] == float(heights.max())


def test_a_run_a_plan_and_a_proof_as_json(spec, tmp_path, capsys):
    planned, code = printed(capsys, "plan", spec, "-o", tmp_path / "new.h5")
    assert (code, planned["realizations"], planned["chunks"]) == (0, 3, 1)
    done, code = printed(capsys, "run", spec, "-o", tmp_path / "new.h5")
    assert (code, done["realizations"], done["computed"]) == (0, 3, 3)
    assert done["landings"] == planned["impacts"]
    again, code = printed(capsys, "run", spec, "-o", tmp_path / "new.h5", "--retry-failed")
    assert (code, again["computed"]) == (0, 0)
    assert again["notes"] == done["notes"] == planned["notes"] != {}
    proved, code = printed(capsys, "verify", tmp_path / "new.h5")
    assert (code, proved["passed"], proved["drawn"]["compared"]) == (0, True, 3)
    assert proved["variables"]["rebound_height_max"]["outside"] == 0


def test_nothing_is_printed_when_quiet(spec, tmp_path, capsys):
    for words in (["run", spec, "-o", tmp_path / "q.h5"], ["verify", tmp_path / "q.h5"]):
        assert main([*map(str, words), "-q"]) == 0
    assert main(["run", str(spec), "-o", str(tmp_path / "q.h5"), "--quiet"]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "exists and was not replaced" in err


@pytest.mark.parametrize(
    ("word", "meant"), [("rnu", '"run"'), ("windws", '"windows"'), ("zzz", "there are examples")]
)
def test_the_command_that_was_meant(word, meant, capsys):
    assert main([word, "a.toml"]) == 2
    assert re.fullmatch(
        f"vibrosweep: '{word}' is not a command; .*{meant}.*\n", capsys.readouterr()[1]
    )


@each_of("name", [name for name in COMMANDS if name != "lab"])
def test_each_help_ends_with_an_example_that_is_understood(name, capsys):
    from vibrosweep.cli import _parser

    with pytest.raises(SystemExit) as end:
        main([name, "--help"])
    assert end.value.code == 0
    example = capsys.readouterr().out.rstrip().splitlines()[-1]
    program, *words = example.removeprefix("example: ").split()
    assert program == "vibrosweep"
    assert _parser(words).parse_args(words).perform


def test_completion_knows_every_option(monkeypatch, capsys):
    options = set()

    def complete(parser, shell):
        (commands,) = (
            one
            for one in parser._actions
            if getattr(one, "choices", None) and one.dest != "print_completion"
        )
        assert [*commands.choices] == [*COMMANDS]
        for command in commands.choices.values():
            options.update(word for one in command._actions for word in one.option_strings)
        return f"# for {shell}"

    monkeypatch.setitem(sys.modules, "shtab", SimpleNamespace(complete=complete))
    with pytest.raises(SystemExit) as end:
        main(["--print-completion", "zsh"])
    assert (end.value.code, capsys.readouterr().out) == (0, "# for zsh\n")
    assert {"--threads", "--sample", "--observable", "--frame-in", "--all", "-q"} <= options
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert main(["--print-completion", "bash"]) == 2
    assert 'pip install "vibrosweep[completion]"' in capsys.readouterr().err
