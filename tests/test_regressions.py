"""The comparison of benchmark figures with stored ones, on made-up numbers."""

import inspect
import json
import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from llvmlite import binding

from regressions import Collector, Verdict, again, better, compare, report

FAMILY = binding.get_host_cpu_name()
BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


def words(stored, measured):
    return {v.name: v.word for v in compare(stored, measured)}


@pytest.mark.parametrize(
    ("slower", "word", "fails"),
    [(1.26, "WORSE", True), (1.24, "as before", False), (1.0, "as before", False),
     (1 / 1.24, "as before", False), (1 / 1.26, "improved", False)],
)  # fmt: skip
def test_a_figure_is_worse_if_the_time_grows_by_more_than_a_quarter(slower, word, fails):
    (verdict,) = compare({"a": 8.0}, {"a": 8.0 / slower})
    assert verdict.word == word
    assert verdict.fails == fails


def test_a_missing_figure_fails_and_a_new_one_is_told():
    verdicts = compare({"gone": 1.0, "kept": 2.0}, {"kept": 2.0, "fresh": 3.0})
    assert [(v.name, v.word, v.fails) for v in verdicts] == [
        ("fresh", "new", False),
        ("gone", "MISSING", True),
        ("kept", "as before", False),
    ]


def test_the_report_names_figures_and_another_family():
    verdicts = [Verdict("a", 8.0, 5.0), Verdict("b", 1.0, None), Verdict("c", 1.0, 2.0)]
    text = report(verdicts, "one", ["one", "two"])
    assert [line.split()[0] for line in text.splitlines()] == ["WORSE", "MISSING", "improved"]
    assert "8 ->        5  a" in text
    assert "judged" not in text
    assert "no figures are stored for two, only for one: nothing is judged" in report(
        verdicts, "two", ["one"]
    )


def test_worse_and_failed_tests_are_run_again_and_the_better_run_counts():
    found = Collector()
    found.figures, found.failed = {"a": 1.0, "b": 2.0, "c": 3.0}, {"c"}
    stored = {"a": 2.0, "b": 2.0, "c": 3.0, "gone": 1.0}
    assert again(stored, found) == ["a", "c"]
    assert better(found.figures, {"a": 1.9, "c": 2.0}) == {"a": 1.9, "b": 2.0, "c": 3.0}


RACES = """
import os
import time

def test_race(race):
    race(lambda: spin(float(os.environ["SUBJECT"])), lambda: spin(0.01), rounds=5)
    assert "MISS" not in os.environ

def test_can_fail():
    assert "FAIL" not in os.environ

def spin(seconds):
    until = time.process_time() + seconds
    while time.process_time() < until:
        pass
"""
NAME = "benchmarks/test_made_up.py::test_race"


@pytest.fixture
def command(tmp_path):
    """The real command in a folder with two made-up benchmarks; returns exit code and output."""
    folder = tmp_path / "benchmarks"
    folder.mkdir()
    (tmp_path / "pyproject.toml").write_text("[tool.pytest.ini_options]\n", encoding="utf-8")
    (folder / "test_made_up.py").write_text(RACES, encoding="utf-8")
    for name in ("conftest.py", "regressions.py"):
        (folder / name).write_bytes((BENCHMARKS / name).read_bytes())

    def run(*options, **environment):
        done = subprocess.run(
            [sys.executable, str(folder / "regressions.py"), *options],
            env={**os.environ, **environment},
            capture_output=True,
            text=True,
            check=False,
        )
        print(done.stdout, done.stderr)  # shown where the test fails
        return done.returncode, done.stdout

    run.stored = folder / "ratios.json"
    return run


def test_the_command_stores_compares_and_fails(command):
    assert command("--store", SUBJECT="0.005")[0] == 0
    stored = json.loads(command.stored.read_text(encoding="utf-8"))[FAMILY]
    assert stored["processor"] != ""
    assert stored["ratios"] == {NAME: pytest.approx(2.0, rel=0.2)}
    code, said = command(SUBJECT="0.005")
    assert (code, "as before" in said) == (0, True)
    code, said = command(SUBJECT="0.015")
    assert code == 1
    assert re.search(rf"^WORSE .* {re.escape(NAME)}$", said, re.MULTILINE)
    assert said.count("times the speed") == 2  # it was given a second chance
    code, said = command(SUBJECT="0.005", FAIL="1")
    assert code == 1
    assert "FAILED, twice: benchmarks/test_made_up.py::test_can_fail" in said
    code, said = command(SUBJECT="0.005", MISS="1")
    assert (code, f"misses a target, twice: {NAME}" in said) == (0, True)


@pytest.mark.weekly
def test_a_missing_figure_fails_and_storing_drops_it(command):
    gone = "benchmarks/test_gone.py::test"
    known = {"ratios": {NAME: 2.0, gone: 1.0}}
    command.stored.write_text(json.dumps({FAMILY: known}), encoding="utf-8")
    code, said = command(SUBJECT="0.005")
    assert code == 1
    assert re.search(rf"^MISSING .* {re.escape(gone)}$", said, re.MULTILINE)
    assert command("--store", SUBJECT="0.005")[0] == 0
    assert list(json.loads(command.stored.read_text(encoding="utf-8"))[FAMILY]["ratios"]) == [NAME]


@pytest.mark.weekly
def test_a_figure_that_misses_a_target_is_stored_and_a_broken_test_keeps_its_own(command):
    broken = "benchmarks/test_made_up.py::test_can_fail"
    known = {"ratios": {NAME: 9.0, broken: 3.0}}
    command.stored.write_text(json.dumps({FAMILY: known}), encoding="utf-8")
    code, said = command("--store", SUBJECT="0.005", MISS="1", FAIL="1")
    assert code == 1  # for the broken one
    assert f"misses a target, twice: {NAME}" in said
    ratios = json.loads(command.stored.read_text(encoding="utf-8"))[FAMILY]["ratios"]
    assert ratios == {NAME: pytest.approx(2.0, rel=0.2), broken: 3.0}


@pytest.mark.weekly
def test_another_family_is_measured_and_not_judged(command):
    known = {"abacus": {"ratios": {NAME: 1e9, "benchmarks/test_gone.py::test": 1.0}}}
    command.stored.write_text(json.dumps(known), encoding="utf-8")
    code, said = command(SUBJECT="0.005")
    assert code == 0
    assert re.search(rf"^new .* {re.escape(NAME)}$", said, re.MULTILINE)
    assert "only for abacus: nothing is judged" in said
    assert command("--store", SUBJECT="0.005")[0] == 0
    stored = json.loads(command.stored.read_text(encoding="utf-8"))
    assert stored["abacus"] == known["abacus"]
    assert stored[FAMILY]["ratios"][NAME] == pytest.approx(2.0, rel=0.2)


def test_every_stored_figure_is_of_a_test_that_exists():
    families = json.loads((BENCHMARKS / "ratios.json").read_text(encoding="utf-8"))
    assert families
    for stored in families.values():
        assert {"processor", "date", "versions"} < set(stored)
        assert len(stored["ratios"]) >= 10
        for name, ratio in stored["ratios"].items():
            path, _, test = name.partition("::")
            function = runpy.run_path(str(BENCHMARKS.parent / path))[test.partition("[")[0]]
            assert "race" in inspect.signature(function).parameters
            assert ratio > 0.0
